"""Masks in three dimensions: which voxels of an image belong to the object."""

from typing import Any

import numpy as np

from millisight.core import checked_array, checked_record, late, put, record
from millisight.data._grid import VoxelGrid
from millisight.data._mask import Mask
from millisight.data._mesh import TriangleMesh


@record
class VolumeMask:
    """The voxels of an object in an image.

    Attributes
    ----------
    grid : VoxelGrid
    inside : (X, Y, Z) bool
    """

    grid: VoxelGrid
    inside: np.ndarray

    def __post_init__(self) -> None:
        checked_record(self.grid, VoxelGrid, name="grid")
        put(self, inside=checked_array(self.inside, name="inside", shape=self.grid.shape, dtype=np.bool_))

    def __repr__(self) -> str:
        return f"VolumeMask({int(self.inside.sum())} of {' x '.join(map(str, self.grid.shape))} voxels inside)"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """`inside`, (X, Y, Z) bool, for `numpy.asarray(mask)`; read-only unless copied."""
        return np.array(self.inside, dtype=dtype, copy=copy)

    @property
    def mask(self) -> Mask:
        """The voxels seen along z: the pixels with at least one."""
        return Mask(grid_xy=self.grid.xy, inside=np.asarray(self.inside.any(axis=2)))

    def surface(self) -> TriangleMesh:
        """The closed surface of the voxels, see `millisight.meshes.mask_surface`.

        Raises
        ------
        InputError
            There are no voxels inside.
        """
        return late("millisight.meshes", "mask_surface")(self)

    def plot(self, **settings: Any) -> Any:
        """Plot the outline of the voxels, seen along z, y and x.

        Parameters
        ----------
        settings : of `millisight.viz.plot_volume`: the `image` below with its `dynamic_range_db` and `colormap`,
            `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_volume")(self, **settings)
