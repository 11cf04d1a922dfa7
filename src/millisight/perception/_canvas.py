"""The canvas that networks look at: square pixels of one size, and power on them in decibels below its maximum.

Images come with any spacing, extent and strength; here they become alike. Power is averaged onto pixels of `SPACING`.
Levels run from 0, `FLOOR_DB` below the maximum or less, to 1 at the maximum, so that neither a gain nor a unit changes
them. The image may be of either radar: 77 GHz as a rule, with 24 GHz as the other band.
"""

import numpy as np

from millisight.core.errors import InputError
from millisight.data import PixelGrid, SarImage

SPACING = 0.004
"""Of the canvas's pixels [m]."""
FLOOR_DB = 45.0

_MOST_PIXELS, _LONGEST = 1 << 20, 2048  # in all; along a side
_MOST_SAMPLES = 1 << 14  # of the image, along a side
_ROWS = 256  # of weights that are worked out at once


def canvas_axis(known: np.ndarray) -> np.ndarray:
    """(n,) pixel centres `SPACING` apart [m] that cover coordinates (k,), about their middle."""
    count = max(1, int(np.ceil((known[-1] - known[0]) / SPACING - 1e-6)) + 1)
    return (known[0] + known[-1]) / 2 + SPACING * (np.arange(count) - (count - 1) / 2)


def canvas_axes(grid: PixelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The canvas's pixels for an image on this grid: centres along x and y [m].

    Raises
    ------
    InputError
        They would be too many, or the image has too many samples.
    """
    extents = np.array([np.ptp(grid.x), np.ptp(grid.y)])
    sides = extents / SPACING + 1
    if max(grid.shape) > _MOST_SAMPLES:
        raise InputError(
            f"the image has {max(grid.shape)} samples along a side; expected {_MOST_SAMPLES} at most: cut it"
        )
    if not (sides.prod() <= _MOST_PIXELS and sides.max() <= _LONGEST):
        raise InputError(
            f"the image is {extents[0]:.3g} x {extents[1]:.3g} m wide; expected one of an everyday object, of "
            f"{_MOST_PIXELS} pixels of {SPACING * 1000:.0f} mm at most, {_LONGEST} a side: cut it, or check its unit"
        )
    return canvas_axis(grid.x), canvas_axis(grid.y)


def resampling_weights(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(w, k) float32 weights from coordinates `known` (k,) to `wanted` (w,): linear, means where these are coarser.

    A row adds up to 1, and is 0 where `wanted` lies more than half a step beyond what is known.
    """
    steps = [np.diff(axis).mean() if len(axis) > 1 else SPACING for axis in (known, wanted)]
    within, rows = np.clip(wanted, known[0], known[-1]), np.empty((len(wanted), len(known)), np.float32)
    for start in range(0, len(wanted), _ROWS):
        weights = np.maximum(1 - abs(within[start : start + _ROWS, None] - known) / max(steps), 0)
        rows[start : start + _ROWS] = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    rows[np.maximum(known[0] - wanted, wanted - known[-1]) > max(steps) / 2 + 1e-9] = 0
    return rows


def resampled_power(magnitude: np.ndarray, along_x: np.ndarray, along_y: np.ndarray) -> np.ndarray:
    """(A, B, Z) power |I|^2 from a magnitude (X, Y, Z), by weights (A, X) and (B, Y)."""
    power = np.square(magnitude, dtype=np.float32)
    columns, rows, depth = power.shape
    across = (along_x @ power.reshape(columns, rows * depth)).reshape(len(along_x), rows, depth)
    return np.tensordot(across, along_y, axes=(1, 1)).swapaxes(1, 2)


def canvas_power(image: SarImage, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(A, B, Z) power of an image on the canvas's pixels, 1 at most; 0 where there is no image."""
    along_x, along_y = resampling_weights(image.grid.x, x), resampling_weights(image.grid.y, y)
    magnitude = image.magnitude
    # Of any unit: squared as it is, a very weak image would vanish.
    peak = magnitude.max()
    return resampled_power(magnitude / (peak if peak > 0 else 1), along_x, along_y)


def power_levels(power: np.ndarray) -> np.ndarray:
    """Powers as levels: 1 at the maximum, 0 from `FLOOR_DB` below it on; 0 where all power is 0."""
    peak = power.max()
    if not peak > 0:
        return np.zeros(power.shape, np.float32)
    decibels = 10 * np.log10(np.maximum(power / peak, 10 ** (-FLOOR_DB / 10)))
    return (1 + decibels / FLOOR_DB).astype(np.float32)


def projected_levels(power: np.ndarray) -> np.ndarray:
    """(A, B) levels of the mean magnitude along z, as the published projection, of a power (A, B, Z)."""
    return power_levels(np.sqrt(power).mean(axis=2) ** 2)
