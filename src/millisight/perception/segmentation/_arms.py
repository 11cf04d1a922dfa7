"""Arms of things: thin, weaker parts that stick out of a mask, such as a tool's handle or the rings of scissors."""

from collections.abc import Sequence

import numpy as np

from millisight.data import SarImage
from millisight.perception.segmentation._borders import brightness_around
from millisight.perception.segmentation._heights import pixel_sides
from millisight.perception.segmentation._parts import parts_of

# Chosen on 20 objects without noise, 18 drawn things, and 28 objects by the virtual rig, in sight and in cartons.
_DIMMEST = -26.0  # of an arm, below the brightest of the mask [dB]
_FALLS, _NEARBY = -10.0, 0.008  # below the brightest within so far: what falls more is a brighter part's blur [dB, m]
_STANDS_OUT = 3.0  # times the median of what surrounds the mask
_BESIDE, _REACH = 0.005, 0.015  # from the mask, an arm begins at most, and ends at least [m]
_LEAST_AREA = 5e-5  # of an arm [m²]


def arms_of(masks: Sequence[np.ndarray], image: SarImage) -> list[np.ndarray]:
    """What sticks out of masks and shines, though a network misses it.

    An arm begins 5 mm from a mask at most, ends 15 mm from it or farther, lies on one side of it, and has at least
    half a square centimetre. By the brightest voxel along z it has no less than -26 dB of the mask's brightest, three
    times the median of what surrounds the mask, and -10 dB of the brightest within 8 mm. It does not reach the
    picture's edge, as streaks of clutter do.

    Parameters
    ----------
    masks : (A, B) bool each
    image : on the same pixels, its sheets taken off

    Returns
    -------
    of each mask (A, B) bool, its arms alone
    """
    from scipy.ndimage import maximum_filter

    level, sides = image.magnitude.max(axis=2), pixel_sides(image)
    if min(level.shape) < 2 or not min(sides):
        return [np.zeros_like(mask) for mask in masks]
    x, y = (np.arange(-int(_NEARBY / side), int(_NEARBY / side) + 1) * side for side in sides)
    crest = level >= 10 ** (_FALLS / 20) * maximum_filter(level, footprint=np.hypot(x[:, None], y) <= _NEARBY)
    return [_arms(mask, np.where(crest, level, 0), level, sides) if mask.any() else mask for mask in masks]


def _arms(mask: np.ndarray, crest: np.ndarray, level: np.ndarray, sides: Sequence[float]) -> np.ndarray:
    """(A, B) bool, the arms of a mask that is not empty.

    crest : (A, B) the level where it is no brighter part's blur, and 0 elsewhere
    """
    from scipy.ndimage import center_of_mass, distance_transform_edt, maximum, minimum

    away = np.asarray(distance_transform_edt(~mask, sampling=sides))
    least = max(10 ** (_DIMMEST / 20) * float(level[mask].max()), _STANDS_OUT * brightness_around(away, level))
    parts, count = parts_of((crest >= least) & ~mask)
    numbers = np.arange(count + 1)  # 0: none of them
    kept = (
        (np.bincount(parts.ravel()) * np.prod(sides) >= _LEAST_AREA)
        & (np.asarray(minimum(away, parts, numbers)) <= _BESIDE)
        & (np.asarray(maximum(away, parts, numbers)) >= _REACH)
    )
    for edge in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        kept[edge] = False
    kept[0] = False
    # What lies around the mask is the blur of an image out of focus.
    for number in np.flatnonzero(kept):
        middle = np.rint(center_of_mass(parts == number)).astype(int)
        kept[number] = away[tuple(middle)] > 0
    return kept[parts]
