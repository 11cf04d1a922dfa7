"""What the `wave` network looks at: channels on square pixels of one size, in decibels below an image's own maximum.

Images come with any spacing, extent and strength; here they become alike. Power is averaged onto pixels of `SPACING`,
and every channel tells levels, 0 from `FLOOR_DB` below the maximum on and 1 at the maximum, so that neither a gain nor
a unit changes them. The image may be of either radar: 77 GHz as a rule, with 24 GHz as the other band.
"""

from collections.abc import Sequence

import numpy as np

from millisight.errors import InputError
from millisight.imaging.grid import PixelGrid
from millisight.imaging.image import SarImage

SPACING = 0.004
"""Of the network's pixels [m]."""
FLOOR_DB = 45.0
SLICES = 8
"""Into which an image is cut along z, each seen by its brightest voxel."""
CHANNELS = ("mean", *(f"slice {i}" for i in range(SLICES)), "other", "has other", "image", "positive", "negative")
MULTIPLE = 8
"""Sides that the network can halve three times over."""

_MOST_PIXELS = 1 << 20


def canvas_axis(known: np.ndarray) -> np.ndarray:
    """(n,) pixel centres `SPACING` apart [m] that cover coordinates (k,), about their middle."""
    count = max(1, int(np.ceil((known[-1] - known[0]) / SPACING - 1e-6)) + 1)
    return (known[0] + known[-1]) / 2 + SPACING * (np.arange(count) - (count - 1) / 2)


def canvas_of(grid: PixelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The network's pixels for an image on this grid: centres along x and y [m].

    Raises
    ------
    InputError
        They would be too many.
    """
    extents = np.array([np.ptp(grid.x), np.ptp(grid.y)])
    if not (extents / SPACING + 1).prod() <= _MOST_PIXELS:
        raise InputError(
            f"the image is {extents[0]:.3g} x {extents[1]:.3g} m wide; expected one of an everyday object, of "
            f"{_MOST_PIXELS} pixels of {SPACING * 1000:.0f} mm at most: cut it, or check its unit"
        )
    return canvas_axis(grid.x), canvas_axis(grid.y)


def resampling(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(w, k) float32 weights from coordinates `known` (k,) to `wanted` (w,): linear, means where these are coarser.

    A row adds up to 1, and is 0 where `wanted` lies more than half a step beyond what is known.
    """
    steps = [np.diff(axis).mean() if len(axis) > 1 else SPACING for axis in (known, wanted)]
    away = abs(np.clip(wanted, known[0], known[-1])[:, None] - known) / max(steps)
    weights = np.maximum(1 - away, 0)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    beyond = np.maximum(known[0] - wanted, wanted - known[-1]) > max(steps) / 2 + 1e-9
    return np.where(beyond[:, None], 0, weights).astype(np.float32)


def resampled_power(magnitude: np.ndarray, along_x: np.ndarray, along_y: np.ndarray) -> np.ndarray:
    """(A, B, Z) power |I|^2 from a magnitude (X, Y, Z), by weights (A, X) and (B, Y)."""
    power = np.square(magnitude, dtype=np.float32)
    columns, rows, depth = power.shape
    across = (along_x @ power.reshape(columns, rows * depth)).reshape(len(along_x), rows, depth)
    return np.tensordot(across, along_y, axes=(1, 1)).swapaxes(1, 2)


def canvas_power(image: SarImage, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(A, B, Z) power of an image on the network's pixels, 1 at most; 0 where there is no image."""
    along_x, along_y = resampling(image.grid.x, x), resampling(image.grid.y, y)
    magnitude = image.magnitude
    # Of any unit: squared as it is, a very weak image would vanish.
    peak = magnitude.max()
    return resampled_power(magnitude / (peak if peak > 0 else 1), along_x, along_y)


def levels(power: np.ndarray) -> np.ndarray:
    """Powers as levels: 1 at the maximum, 0 from `FLOOR_DB` below it on; 0 where all power is 0."""
    peak = power.max()
    if not peak > 0:
        return np.zeros(power.shape, np.float32)
    decibels = 10 * np.log10(np.maximum(power / peak, 10 ** (-FLOOR_DB / 10)))
    return (1 + decibels / FLOOR_DB).astype(np.float32)


def seen_from_above(power: np.ndarray) -> np.ndarray:
    """(A, B) levels of the mean magnitude along z, as the published projection, of a power (A, B, Z)."""
    return levels(np.sqrt(power).mean(axis=2) ** 2)


def in_slices(power: np.ndarray) -> np.ndarray:
    """(SLICES, A, B) levels of a power (A, B, Z), its z cut into slices of one thickness, each by its maximum."""
    depth = power.shape[2]
    edges = np.arange(SLICES) * depth / SLICES
    parts = [power[:, :, int(a) : max(int(np.ceil(a + depth / SLICES)), int(a) + 1)].max(axis=2) for a in edges]
    return levels(np.stack(parts))


def stacked(
    power: np.ndarray,
    other: np.ndarray | None,
    points: Sequence[np.ndarray] = (np.zeros((0, 2), int), np.zeros((0, 2), int)),
) -> np.ndarray:
    """The network's input of one image.

    Parameters
    ----------
    power : (A, B, Z)
    other : (A, B, Z') of the other band on the same pixels; None: there is none
    points : positive and negative prompts (n, 2), indices into A and B

    Returns
    -------
    (C, A', B') float32, channels as `CHANNELS`; A' and B' are the next multiples of `MULTIPLE`, filled up with 0
    """
    across, along = power.shape[:2]
    shape = len(CHANNELS), *(-(-size // MULTIPLE) * MULTIPLE for size in (across, along))
    channels = np.zeros(shape, np.float32)
    inner = channels[:, :across, :along]
    inner[0] = seen_from_above(power)
    inner[1 : 1 + SLICES] = in_slices(power)
    if other is not None:
        inner[1 + SLICES] = seen_from_above(other)
        inner[2 + SLICES] = 1
    inner[3 + SLICES] = 1
    for channel, marked in zip((4 + SLICES, 5 + SLICES), points, strict=True):
        for i, j in marked:
            inner[channel, max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = 1
    return channels
