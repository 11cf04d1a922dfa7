"""Which parts of a mask are ghosts of steps that are too far apart: grating lobes, told by their wavenumbers.

Around a reflector that is seen in the direction u, an image is a wave exp(-2i k u.r) under an envelope: its wavenumbers
have the length 2k, for all k of the band, and point down. A ghost is seen in another direction than what causes it; its
wavenumbers along x and y lie beyond what voxels of a step's size can hold, and come back at other places of the image's
spectrum (aliasing), while that along z stays. So the three no longer have the length 2k.
"""

from collections.abc import Sequence

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import SarImage
from millisight.perception.segmentation._heights import tells_height
from millisight.perception.segmentation._parts import parts_of

BAND = 76e9, 81e9
"""Of radars at 77 GHz [Hz]."""

_MARGIN = 8  # voxels of zeros along each axis: what ends at one side of the image is not continued at the other
_LEAST_VOXELS = 4  # along each axis
_MOST = 0.5  # of the spectrum may be a reflector's; beyond, it tells nothing
_REFLECTOR, _GHOST = 0.95, 0.6  # of a part's power, what a reflector has at least, and a ghost at most
_BRIGHTEST = 0.85  # the brightest part has at least
_GHOST_IN_SIGHT = 0.8  # the most without a lid, whose leftovers lie among an object's power


def without_ghosts(masks: Sequence[np.ndarray], image: SarImage, *, covered: bool = False) -> list[np.ndarray]:
    """The parts of masks of which most of the power has a reflector's wavenumbers.

    Power is that of the strongest voxel along z above each pixel. One part must surely be a reflector: 85 % of the
    brightest part's power is so, or 95 % of that of another, which ghosts outshine; and its echo is as short along z as
    at 77 GHz. Else the image may be one of magnitudes or of another band, whose phases tell nothing, and all parts are
    kept.

    Parameters
    ----------
    masks : (X, Y) bool each, on the image's pixels
    image : at 77 GHz, seen along z, its phases as `form_image` leaves them, or their negatives; sheets taken off
    covered : whether there were any

    Returns
    -------
    list of (X, Y) bool
    """
    found = [parts_of(mask) for mask in masks]
    values = _of_reflectors(image) if any(count > 1 for _, count in found) else None
    if values is None:
        return list(masks)
    strongest = np.abs(image.values).argmax(axis=2)[..., None]
    of_both = (np.take_along_axis(np.abs(some), strongest, axis=2)[..., 0] for some in (image.values, values))
    seen, real = (np.square(one) for one in of_both)
    kept = []
    for mask, (parts, count) in zip(masks, found, strict=True):
        shares = [np.bincount(parts[mask], weights=one[mask], minlength=count + 1) for one in (real, seen)]
        share = shares[0] / np.maximum(shares[1], 1e-300)
        most, brightest = int(shares[0].argmax()), int(parts.ravel()[np.where(mask, seen, 0).argmax()])
        surely = any(
            share[part] >= enough and tells_height(parts == part, image)
            for part, enough in ((most, _REFLECTOR), (brightest, _BRIGHTEST))
        )
        least = _GHOST if covered or share[most] < _REFLECTOR else _GHOST_IN_SIGHT
        kept.append(mask & (share > least)[parts] if surely else mask)
    return kept


def _of_reflectors(image: SarImage) -> np.ndarray | None:
    """(X, Y, Z) the image's values but for the wavenumbers that no reflector has; None where these are not told."""
    from scipy import fft

    axes = image.grid.x, image.grid.y, image.grid.z
    if min(image.values.shape) < _LEAST_VOXELS:
        return None
    steps = [float(np.diff(axis).mean()) for axis in axes]
    if any(np.ptp(np.diff(axis)) > 1e-3 * step for axis, step in zip(axes, steps, strict=True)):
        return None
    sizes = [fft.next_fast_len(size + _MARGIN) for size in image.values.shape]
    x, y, z = (2 * np.pi * np.fft.fftfreq(size, step) for size, step in zip(sizes, steps, strict=True))
    across = np.square(x)[:, None] + np.square(y)
    least, most = (np.sqrt(np.maximum((4 * np.pi * f / SPEED_OF_LIGHT) ** 2 - across, 0)) for f in BAND)
    # Along z in units of the period with which wavenumbers come back.
    period = 2 * np.pi / steps[2]
    middle = ((least + most) / (2 * period)).astype(np.float32)[..., None]
    half = ((most - least) / (2 * period) + 1 / sizes[2]).astype(np.float32)[..., None]
    spectrum, found = fft.fftn(image.values.astype(np.complex64, copy=False), s=sizes), []
    for sign in (-1, 1):
        off = (sign / period * z).astype(np.float32) - middle
        kept = abs(off - np.rint(off)) <= half
        if np.count_nonzero(kept) > _MOST * kept.size:
            return None
        found.append((float(np.linalg.norm(spectrum[kept])), kept))
    _, kept = max(found, key=lambda one: one[0])
    return fft.ifftn(spectrum * kept)[tuple(slice(size) for size in image.values.shape)]
