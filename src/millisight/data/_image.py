"""The image: complex values on a voxel grid."""

from dataclasses import field
from typing import Any

import numpy as np

from millisight.core import Metadata, check_known, checked_array, checked_metadata, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._grid import VoxelGrid

_LARGEST = 1e15  # the sum of the squares of as many voxels as fit any memory is finite in float32


@record
class SarImage:
    """A synthetic-aperture image (paper Eq. 1, primer 4): a unit reflector has the value 1 at its position.

    Attributes
    ----------
    grid : VoxelGrid
    values : (X, Y, Z) complex64; or complex128 if given as such, as for some published images
    metadata : provenance; what JSON can hold
    """

    grid: VoxelGrid
    values: np.ndarray
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        checked_record(self.grid, VoxelGrid, name="grid")
        dtype = np.complex128 if getattr(self.values, "dtype", None) in ("<c16", ">c16") else np.complex64
        values = checked_array(self.values, name="values", shape=self.grid.shape, dtype=dtype)
        largest = max(
            float(abs(extreme)) for part in (np.real(values), np.imag(values)) for extreme in (part.min(), part.max())
        )
        if largest > _LARGEST:
            raise InputError(
                f"values reach {largest:.3g}; expected at most {_LARGEST:g}, where a unit reflector is 1: divide them "
                "by their maximum"
            )
        put(self, values=values, metadata=checked_metadata(self.metadata))

    def __repr__(self) -> str:
        return f"SarImage({self.values.dtype} on {self.grid!r})"

    def plot(self, **settings: Any) -> Any:
        """Plot the mean of |I| along z, y and x.

        Parameters
        ----------
        settings : of `millisight.viz.plot_image`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_image")(self, **settings)

    def _repr_html_(self) -> str:
        return late("millisight.viz", "html_card")(self)

    @property
    def magnitude(self) -> np.ndarray:
        """(X, Y, Z) float32 |I|; float64 of complex128 values."""
        return np.abs(self.values)

    def project(self, axis: str = "z", *, reduce: str = "mean") -> np.ndarray:
        """|I| seen along an axis: its "mean" (as published) or "max" over that axis, a 2-D array of floats.

        Raises
        ------
        UnknownNameError
        """
        check_known("axis", axis, ("x", "y", "z"))
        check_known("projection", reduce, ("mean", "max"))
        return getattr(self.magnitude, reduce)(axis="xyz".index(axis))

    @property
    def peak(self) -> np.ndarray:
        """(3,) centre of the brightest voxel [m]."""
        index = np.unravel_index(np.argmax(self.magnitude), self.values.shape)
        return np.array([axis[i] for axis, i in zip((self.grid.x, self.grid.y, self.grid.z), index, strict=True)])

    def to_xarray(self) -> Any:
        """The image as an `xarray.DataArray` with coordinates in metres.

        Raises
        ------
        ImportError
            xarray is not installed: `pip install "millisight[xarray]"`.
        """
        try:
            import xarray
        except ImportError as error:
            raise ImportError('to_xarray needs xarray: pip install "millisight[xarray]"') from error
        coords = {
            name: xarray.Variable(name, axis, {"units": "m"})
            for name, axis in zip("xyz", (self.grid.x, self.grid.y, self.grid.z), strict=True)
        }
        return xarray.DataArray(
            self.values, dims=("x", "y", "z"), coords=coords, name="image", attrs=dict(self.metadata)
        )
