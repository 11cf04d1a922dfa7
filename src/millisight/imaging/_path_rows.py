"""The rows of a path: stretches between its turns."""

from typing import NamedTuple

import numpy as np

from millisight.data import Trajectory

_JUMP = 5  # times the usual distance of neighbouring poses: the path is torn there
_SHORTEST_ROW = 0.5  # of the extent along the rows


class Row(NamedTuple):
    """A run of poses along the main direction: their numbers (n,) and the mean step from one to the next (3,) [m]."""

    poses: np.ndarray
    step: np.ndarray


def rows_of_path(trajectory: Trajectory) -> list[Row]:
    """The rows of a raster, in the order of their times; a run shorter than half of the extent is no row."""
    order = np.argsort(trajectory.times, kind="stable")
    places = trajectory.positions[order]
    if len(places) < 3:
        return []
    steps = np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    usual = np.median(lengths[lengths > 0]) if (lengths > 0).any() else 0.0
    torn = lengths > _JUMP * usual
    inner = steps[~torn] / np.maximum(lengths[~torn, None], 1e-12)
    direction = np.linalg.eigh(steps[~torn].T @ inner)[1][:, -1]
    along = places @ direction
    ways = np.sign(np.where(torn, 0.0, np.where(np.abs(steps @ direction) > 0.3 * usual, steps @ direction, 0.0)))
    rows, start = [], None
    for i, way in enumerate([*ways, 0.0]):
        if start is not None and way != ways[start]:
            if abs(along[i] - along[start]) > _SHORTEST_ROW * np.ptp(along):
                rows.append(Row(order[start : i + 1], (places[i] - places[start]) / (i - start)))
            start = None
        if start is None and way != 0:
            start = i
    return rows
