"""How high the parts of a mask lie, by which an object is told from what it stands on and from the lid over it."""

from typing import Any, cast

import numpy as np

from millisight.data import SarImage

_CLEARANCE = 0.008  # above its support and below its lid, an object's echo is at least so far away [m]
_FALLS = 0.5  # to this share of its maximum an echo's power falls within the image, or its height is unknown


def between(
    inside: np.ndarray, image: SarImage, *, support: float | None = None, lid: float | None = None
) -> np.ndarray:
    """The parts of a mask whose echo lies above the support and below the lid.

    The height of a part is that of the strongest slice of its power, by a parabola through the logarithms of three. Of
    one echo it is right to some millimetres, whatever the range resolution. A part whose echo does not fall to half its
    power within the image, as at 24 GHz, is kept: its height is unknown.

    Parameters
    ----------
    inside : (X, Y) bool, on the image's pixels
    image : with sheets taken off
    support, lid : their heights z [m]; None: unknown

    Returns
    -------
    (X, Y) bool
    """
    from scipy.ndimage import label

    if support is None and lid is None:
        return inside
    parts, count = cast("tuple[np.ndarray, int]", label(inside, structure=np.ones((3, 3))))
    kept = np.ones(count + 1, dtype=bool)
    for number in range(1, count + 1):
        height = _height(np.square(image.magnitude[parts == number], dtype=float).sum(axis=0), image.grid.z)
        if height is not None:
            above = support is None or height >= support + _CLEARANCE
            kept[number] = above and (lid is None or height <= lid - _CLEARANCE)
    return inside & kept[parts]


def _height(power: np.ndarray, z: np.ndarray) -> float | None:
    """Of the maximum of power (Z,) over z [m]; None where it falls too little."""
    if not power.min() < _FALLS * power.max():
        return None
    top = int(power.argmax())
    if not 0 < top < len(z) - 1:
        return float(z[top])
    below, here, above = np.log(np.maximum(power[top - 1 : top + 2], 1e-30 * power[top]))
    bend: Any = below - 2 * here + above
    return float(z[top] + (0.5 * (below - above) / bend if bend < 0 else 0.0) * (z[top + 1] - z[top]))
