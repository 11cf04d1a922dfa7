"""The voxel under the pointer: what a ray from the camera meets first of what is shown."""

from typing import NamedTuple

import numpy as np

from millisight.data import VoxelGrid
from millisight.viz import borders, grid_box
from millisight.viz.viewer._levels import Levels
from millisight.viz.viewer._settings import ViewSettings

_MOST_STEPS = 20_000


class Picked(NamedTuple):
    """A voxel that a ray met."""

    place: np.ndarray  # (3,) its centre [m]
    db: float  # under the image's own maximum
    magnitude: float  # |I|
    distance: float  # along the ray, to where it meets the voxel [m]


def pick(
    levels: Levels, settings: ViewSettings, threshold_db: float, origin: np.ndarray, direction: np.ndarray
) -> Picked | None:
    """What a ray meets first: a voxel that is shown as point or in the volume, or a slice's pixel.

    Where no shown pixel is met, that of the nearest slice counts, though it is too weak to be seen.

    Parameters
    ----------
    levels, settings : what is shown, and how
    threshold_db : voxels under it are hidden, dB under the image's own maximum
    origin, direction : (3,) the ray, in the image's frame [m]
    """
    box = np.array([np.maximum(grid_box(levels.grid)[0], settings.limits[0]),
                    np.minimum(grid_box(levels.grid)[1], settings.limits[1])])  # fmt: skip
    direction = direction / np.linalg.norm(direction)
    span = _span(box, origin, direction)
    if span is None:
        return None
    met: list[Picked] = []
    if settings.points or settings.volume:
        met += _first_voxel(levels, threshold_db, origin, direction, span)
    hidden: list[Picked] = []
    if settings.slices:
        for axis, at in enumerate(settings.at):
            coordinates = (levels.grid.x, levels.grid.y, levels.grid.z)[axis]
            place = coordinates[int(np.abs(coordinates - at).argmin())]
            with np.errstate(divide="ignore"):
                distance = float((place - origin[axis]) / direction[axis])
            if span[0] <= distance <= span[1]:
                pixel = _voxel_at(levels, origin + distance * direction, distance)
                (met if pixel.db >= threshold_db else hidden).append(pixel)
    return min(met or hidden, key=lambda one: one.distance, default=None)


def _span(box: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[float, float] | None:
    """From where to where a ray is in a box [m]; None: nowhere."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (box - origin) / direction
    level = direction == 0
    if ((origin < box[0]) | (origin > box[1]))[level].any():
        return None
    first = float(np.max(ends[:, ~level].min(axis=0), initial=0.0))
    last = float(np.min(ends[:, ~level].max(axis=0)))
    return (first, last) if first <= last else None


def _first_voxel(
    levels: Levels, threshold_db: float, origin: np.ndarray, direction: np.ndarray, span: tuple[float, float]
) -> list[Picked]:
    """The first voxel on the ray that is not too weak, if there is one: looked for at every half voxel."""
    if levels.peak == 0:
        return []
    steps = [float(np.diff(axis).min()) for axis in (levels.grid.x, levels.grid.y, levels.grid.z) if len(axis) > 1]
    count = min(_MOST_STEPS, 2 + int(2 * (span[1] - span[0]) / min(steps, default=1e-3)))
    distances = np.linspace(*span, count)
    index = _index(levels.grid, origin + distances[:, None] * direction)
    strong = levels.db[tuple(index.T)] >= threshold_db
    if not strong.any():
        return []
    first = int(strong.argmax())
    return [_voxel_at(levels, origin + distances[first] * direction, float(distances[first]))]


def _voxel_at(levels: Levels, point: np.ndarray, distance: float) -> Picked:
    i, j, k = _index(levels.grid, point[None])[0]
    db = float(levels.db[i, j, k])
    place = np.array([levels.grid.x[i], levels.grid.y[j], levels.grid.z[k]])
    return Picked(place, db, levels.peak * 10 ** (db / 20), distance)


def _index(grid: VoxelGrid, points: np.ndarray) -> np.ndarray:
    """(n, 3) int: in which voxel each of (n, 3) points lies; outside, the nearest one."""
    found = [
        np.clip(np.searchsorted(borders(axis, 1e-3), values) - 1, 0, len(axis) - 1)
        for axis, values in zip((grid.x, grid.y, grid.z), points.T, strict=True)
    ]
    return np.stack(found, axis=1)
