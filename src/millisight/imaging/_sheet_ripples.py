"""What edges add to a sheet's echo: Fresnel ripples along the edges of the aperture and of the sheet.

Edges along x and y, as rectangular apertures and lids in line with them have, give ripples that change across the edge
and are alike along it. So do those of a turned lid, along its own axes.
"""

from collections.abc import Callable

import numpy as np

_FLOOR = 1e-3  # of the mean energy, where there is none


def total_of_grid(weights: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """`total` of places on a grid: weights (X, Y), values (X, Y, C)."""
    # A product of matrices: NumPy's sum along the middle of three axes takes ten times as long.
    if axis == 0:
        return (weights[:, None] @ values)[:, 0]
    return np.einsum("xy,xyc->yc", weights, values)


def spread_on_grid(table: np.ndarray, axis: int) -> np.ndarray:
    """`spread` to places on a grid."""
    return np.expand_dims(table, 1 - axis)


def rippled(
    flat: np.ndarray,
    smooth: np.ndarray,
    weights: np.ndarray,
    total: Callable[[np.ndarray, np.ndarray, int], np.ndarray],
    spread: Callable[[np.ndarray, int], np.ndarray],
    *,
    factors: int,
) -> np.ndarray:
    """(..., C) the smooth echo with its ripples.

    Parameters
    ----------
    flat : (..., C) measurements, the sheet's phase taken off
    smooth : (..., C) the smooth echo at the same places
    weights : (...) of the places
    total : weighted sums of values over all places with the same x (axis 0) or y (axis 1), (n, C)
    spread : brings such a table back to the places
    factors : first a factor of each x and each y, as in images, improved in turn so many times; then, in any case, a
        sum: a function of x times the mean along y, and the other way round, which goes on where the smooth echo ends
    """
    weights = weights.astype(np.float32)
    echo = smooth
    for axis in (0, 1) * factors:
        energy = total(weights, np.abs(echo) ** 2, axis)
        change = total(weights, echo.conj() * (flat - echo), axis)
        echo = echo * (1 + spread(change / (energy + _FLOOR * energy.mean()), axis))
    for axis in (0, 1):
        counts = total(weights, np.ones((*weights.shape, 1), dtype=np.float32), 1 - axis)
        along = spread(total(weights, echo, 1 - axis) / (counts + _FLOOR * counts.mean()), 1 - axis)
        along = np.broadcast_to(along, echo.shape)
        energy = total(weights, np.abs(along) ** 2, axis)
        change = total(weights, along.conj() * (flat - echo), axis)
        echo = echo + spread(change / (energy + _FLOOR * energy.mean()), axis) * along
    return echo
