"""What the classifiers look at: one object, masked, in levels, on square pixels of one size about the mask's middle.

Neither the image's spacing nor its strength matters, nor where the object lies; its size does.
"""

import numpy as np

from millisight.perception.wave_features import levels, resampling, seen_from_above

SIDE = 80
"""Pixels along x and y, as wide as those of `wave_features`, 4 mm: 32 cm."""
SLICES = 8
THICKNESS = 0.02
"""Of a slice along z [m]; together they reach 8 cm above and below the middle of the masked power."""
CHANNELS = ("mask", "magnitude", "level", *(f"slice {i}" for i in range(SLICES)), "other", "has other")

MAGNITUDE = CHANNELS.index("magnitude")
"""Of the paper's one channel: the mean of |I| along z, 1 from 80 % of its maximum on."""

_CLIPPED = 0.8  # of the maximum
_LEAST = 1e-30  # of a power that is told from 0


def masked_channels(
    power: np.ndarray, z: np.ndarray, inside: np.ndarray, other: np.ndarray | None = None
) -> np.ndarray:
    """A classifier's input of one object.

    Parameters
    ----------
    power : (A, B, Z) of the image on the pixels of `wave_features`
    z : (Z,) of its voxels [m], ascending
    inside : (A, B) share of each pixel that the mask covers, 0 to 1, not 0 throughout
    other : (A, B, Z') power of the other band on the same pixels; None: there is none

    Returns
    -------
    (C, SIDE, SIDE) float32, channels as `CHANNELS`, all of them 0 outside the mask; of an object beyond 32 cm a part
    """
    window = tuple(_window(inside.sum(axis=1 - axis)) for axis in (0, 1))
    inside = _cut(inside, window)
    seen = _cut(power, window) * inside[..., None]
    channels = np.zeros((len(CHANNELS), SIDE, SIDE), np.float32)
    channels[0] = inside
    flat = np.sqrt(seen).mean(axis=2)
    channels[MAGNITUDE] = np.minimum(flat / max(_CLIPPED * flat.max(), np.sqrt(_LEAST)), 1)
    channels[2] = seen_from_above(seen)
    channels[3 : 3 + SLICES] = levels(_slices(seen, z))
    if other is not None:
        channels[3 + SLICES] = seen_from_above(_cut(other, window) * inside[..., None])
        channels[4 + SLICES] = inside
    return channels


def _window(weights: np.ndarray) -> int:
    """Where the pixels begin, `SIDE` of them about the middle of what is weighed; perhaps below 0."""
    middle = float(np.arange(len(weights)) @ weights / weights.sum())
    return round(middle - (SIDE - 1) / 2)


def _cut(values: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
    """(SIDE, SIDE, ...) of values from these indices on, 0 where there are none."""
    cut = np.zeros((SIDE, SIDE, *values.shape[2:]), np.float32)
    places = [start + np.arange(SIDE) for start in starts]
    there = [(place >= 0) & (place < size) for place, size in zip(places, values.shape[:2], strict=True)]
    cut[np.ix_(*there)] = values[np.ix_(*(place[here] for place, here in zip(places, there, strict=True)))]
    return cut


def _slices(power: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(SLICES, A, B) power at depths `THICKNESS` apart about the middle of all power."""
    profile = power.sum(axis=(0, 1), dtype=np.float64)
    middle = float(z @ profile / max(profile.sum(), _LEAST)) if profile.any() else float(z.mean())
    depths = middle + THICKNESS * (np.arange(SLICES) - (SLICES - 1) / 2)
    return np.moveaxis(power @ resampling(z, depths).T, -1, 0)
