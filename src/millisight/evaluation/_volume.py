"""Metrics of masks in three dimensions, and true ones from meshes."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import check_known, checked_number, checked_record
from millisight.core.errors import InputError
from millisight.data import TriangleMesh, VolumeMask, VoxelGrid
from millisight.evaluation._metrics import check_same_grid, iou, precision, recall
from millisight.meshes import RayCaster


class VolumeScores(NamedTuple):
    """How well voxels were found, as shares. Where one is 0 / 0, it is 1 if both masks are empty, and 0 otherwise.

    Attributes
    ----------
    iou : TP / (TP + FP + FN)
    precision : TP / (TP + FP)
    recall : TP / (TP + FN)
    """

    iou: float
    precision: float
    recall: float


def score_volume(found: VolumeMask, truth: VolumeMask) -> VolumeScores:
    """Score voxels against true ones, such as `volume_truth`'s.

    Parameters
    ----------
    found, truth : on one grid

    Raises
    ------
    InputError
        They lie on different grids.
    """
    checked_record(found, VolumeMask, name="found")
    checked_record(truth, VolumeMask, name="truth")
    check_same_grid(found.grid, truth.grid)
    return VolumeScores(iou(found, truth), precision(found, truth), recall(found, truth))


def volume_truth(
    mesh: TriangleMesh | Sequence[TriangleMesh],
    grid: VoxelGrid,
    *,
    of: str = "surface",
    within: float | None = None,
) -> VolumeMask:
    """The voxels of an object of known shape, seen from above.

    Parameters
    ----------
    mesh : of the object, or of its parts, in the grid's frame
    grid : VoxelGrid
    of : "surface", the voxels at most `within` above or below the topmost point of the object in their column: what a
        radar above it can see; "solid": also those between its topmost and its lowest point in their column
    within : [m]; None: half the voxels' spacing along z

    Returns
    -------
    VolumeMask
        Empty in columns whose middle line misses the object.

    Raises
    ------
    InputError
        No mesh; or `within` is missing for a grid with a single voxel along z.
    UnknownNameError
    """
    check_known("truth", of, ("surface", "solid"))
    meshes = list(mesh) if isinstance(mesh, Sequence) else [mesh]
    if not meshes:
        raise InputError("mesh is empty; expected at least one TriangleMesh")
    meshes = [checked_record(one, TriangleMesh, name="mesh") for one in meshes]
    if within is None and len(grid.z) == 1:
        raise InputError("the grid has a single voxel along z, and so no spacing; pass within, in metres")
    reach = float(np.diff(grid.z).mean()) / 2 if within is None else checked_number(within, name="within", minimum=0)
    caster = RayCaster.of(meshes)
    bounds = np.array([one.bounds for one in meshes])
    x, y = (axis.ravel() for axis in np.meshgrid(grid.x, grid.y, indexing="ij"))
    starts = np.stack([x, y, np.full(len(x), bounds[:, 1, 2].max() + 0.01)], axis=1)
    down = np.broadcast_to([0.0, 0.0, -1.0], starts.shape)
    top = (starts[:, 2] - caster.first(starts, down)[1]).reshape(grid.xy.shape)
    low = top
    if of == "solid":
        starts[:, 2] = bounds[:, 0, 2].min() - 0.01
        low = (starts[:, 2] + caster.first(starts, -down)[1]).reshape(grid.xy.shape)
    return VolumeMask(grid=grid, inside=(grid.z <= top[..., None] + reach) & (grid.z >= low[..., None] - reach))
