"""The `wave` network's input: channels of an image and of a user's points on the canvas."""

from collections.abc import Sequence

import numpy as np

from millisight.perception import power_levels, projected_levels

WAVE_SLICES = 8
"""Into which an image is cut along z, each seen by its brightest voxel."""
WAVE_CHANNELS = (
    "mean", *(f"slice {i}" for i in range(WAVE_SLICES)), "other", "has other", "image", "positive", "negative"
)  # fmt: skip

_MULTIPLE = 8  # of the input's sides: the network halves them three times
_NO_POINTS = np.zeros((0, 2), int)


def wave_input(
    power: np.ndarray, other: np.ndarray | None, points: Sequence[np.ndarray] = (_NO_POINTS, _NO_POINTS)
) -> np.ndarray:
    """The network's input for one image.

    Parameters
    ----------
    power : (A, B, Z) on the canvas's pixels
    other : (A, B, Z') of the other band on the same pixels; None: there is none
    points : positive and negative prompts (n, 2), indices into A and B

    Returns
    -------
    (C, A', B') float32, channels as `WAVE_CHANNELS`; A' and B' are the next multiples of 8, filled up with 0
    """
    across, along = power.shape[:2]
    shape = len(WAVE_CHANNELS), *(-(-size // _MULTIPLE) * _MULTIPLE for size in (across, along))
    channels = np.zeros(shape, np.float32)
    inner = channels[:, :across, :along]
    inner[0] = projected_levels(power)
    inner[1 : 1 + WAVE_SLICES] = _slice_levels(power)
    if other is not None:
        inner[1 + WAVE_SLICES] = projected_levels(other)
        inner[2 + WAVE_SLICES] = 1
    inner[3 + WAVE_SLICES] = 1
    for channel, marked in zip((4 + WAVE_SLICES, 5 + WAVE_SLICES), points, strict=True):
        for i, j in marked:
            inner[channel, max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = 1
    return channels


def _slice_levels(power: np.ndarray) -> np.ndarray:
    """(WAVE_SLICES, A, B) levels of a power (A, B, Z): z in slices of one thickness, each by its maximum."""
    depth = power.shape[2]
    edges = np.arange(WAVE_SLICES) * depth / WAVE_SLICES
    parts = [power[:, :, int(a) : max(int(np.ceil(a + depth / WAVE_SLICES)), int(a) + 1)].max(axis=2) for a in edges]
    return power_levels(np.stack(parts))
