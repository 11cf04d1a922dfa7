"""Rims above flat tops: what tells the floor of an open vessel from the top of a can."""

import numpy as np

from millisight.data import SarImage
from millisight.perception.segmentation._heights import echo_height, pixel_sides

_ABOVE = 0.04, 0.15  # the floor: nearer, a range resolution of 37.5 mm does not part the two [m]
_BRIGHT = 10**-0.7  # of the floor's power, that a rim echoes at least
_STANDS_OUT = 10  # times the power of what lies beside at its height: what is left of a lid does not
_NEAR, _BESIDE = 0.006, 0.02  # to a part, where its rim may echo, and from a mask, where only a lid does [m]
_SECTORS, _AROUND = 8, 6  # of directions from the middle, and in how many of them a rim echoes at least
_DIM = 10**-1.5  # of the brightest of a rim, that echoes count in a sector


def rim_above(floor: np.ndarray, height: float, *, part: np.ndarray, mask: np.ndarray, image: SarImage) -> float | None:
    """How far above a flat top a rim echoes that goes around it [m]; None: there is none.

    Parameters
    ----------
    floor : (A, B) bool, the top's pixels
    height : of the top [m]
    part : (A, B) bool, the part of the mask that the top lies in
    mask : (A, B) bool
    image : seen from above, its sheets taken off
    """
    from scipy.ndimage import distance_transform_edt

    sides, values = pixel_sides(image), image.values
    around = (distance_transform_edt(~(part | floor), sampling=sides) <= _NEAR) & ~floor
    over = image.grid.z - height
    slices = np.flatnonzero((over > 0) & (over <= _ABOVE[1]))
    if len(slices) < 3 or not around.any():
        return None
    power = np.square(np.abs(values[around][:, slices]))
    # The brightest pixels of a rim, each at another height, know it worse than many do.
    echo, peaks = np.quantile(power, 0.9, axis=0), power.max(axis=0)
    level = np.square(np.abs(values[floor, abs(over).argmin()])).mean()
    rims = (over[slices] >= _ABOVE[0]) & (peaks > _BRIGHT * level)
    rims[1:] &= echo[1:] > echo[:-1]  # else it is the floor's own echo, which ends there
    beside = np.asarray(distance_transform_edt(~(mask | floor), sampling=sides)) > _BESIDE
    if rims.any() and beside.any():
        rest = np.quantile(np.abs(values[beside][:, slices[rims]]), 0.99, axis=0)
        rims[rims] = peaks[rims] > _STANDS_OUT * np.square(rest)
    if not rims[1:].any():
        return None
    best = 1 + int(np.where(rims, echo, 0)[1:].argmax())
    places, bright = np.argwhere(around), power[:, best]
    x, y = ((places - np.argwhere(floor).mean(axis=0)) * sides).T
    sectors = np.floor(np.arctan2(y, x) / (2 * np.pi) * _SECTORS).astype(int) % _SECTORS
    if len(set(sectors[bright > _DIM * bright.max()])) < _AROUND:
        return None
    lowest = max(int(np.flatnonzero(rims)[0]) - 1, 0)
    return float(echo_height(echo[lowest:], image.grid.z[slices[lowest:]])) - height
