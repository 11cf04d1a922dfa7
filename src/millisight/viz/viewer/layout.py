"""Panes side by side in one view, as if each had a camera of its own and all cameras moved alike.

One camera turns around the origin. The panes are put side by side across its line of sight, and each is turned by as
much as the camera sees it from aside: so all are seen from the same direction, wherever the camera is.
"""

import math
from typing import NamedTuple

import numpy as np

FOV = math.radians(24)
"""The view's angle, upright: narrow, so that what is beside is hardly seen from aside."""


class Placement(NamedTuple):
    """Where a pane goes: position (3,) [m], turn as quaternion (4,) w x y z; and where its title is in it (3,) [m]."""

    position: np.ndarray
    wxyz: np.ndarray
    title: np.ndarray


def rows_and_columns(count: int) -> tuple[int, int]:
    """How many panes stand above each other and beside each other: up to three in a row, then nearly a square."""
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    return math.ceil(count / columns), columns


def placed(count: int, radius: float, camera: np.ndarray, up: np.ndarray) -> list[Placement]:
    """Where `count` panes go, each in a ball of `radius` [m], for a camera at (3,) that looks at the origin.

    Parameters
    ----------
    up : (3,) what is up in the view; need not be exactly across the line of sight
    """
    ahead = _unit(-camera)
    right = np.cross(ahead, up)
    if np.linalg.norm(right) < 1e-6:  # straight down, where `up` says nothing
        right = np.array([1.0, 0.0, 0.0])
    right = _unit(right)
    above = np.cross(right, ahead)
    rows, columns = rows_and_columns(count)
    result = []
    for number in range(count):
        row, column = divmod(number, columns)
        in_row = min(columns, count - row * columns)
        offset = 2 * radius * ((column - (in_row - 1) / 2) * right + ((rows - 1) / 2 - row) * above)
        result.append(Placement(offset, _turn(ahead, _unit(offset - camera)), above * radius))
    return result


def start_camera(count: int, radius: float, *, aspect: float = 1.5) -> float:
    """How far off a camera sees all panes [m], in a view `aspect` times as wide as it is high."""
    rows, columns = rows_and_columns(count)
    half = max(rows, columns / aspect) * radius
    return 1.08 * half / math.tan(FOV / 2)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The quaternion w x y z of the shortest turn of one unit vector into another, less than half a turn away."""
    return _unit(np.concatenate([[1 + start @ end], np.cross(start, end)]))
