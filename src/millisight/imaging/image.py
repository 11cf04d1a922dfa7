"""The image: complex values on a voxel grid."""

from dataclasses import field
from typing import Any, overload

import numpy as np

from millisight.capture.capture import Capture
from millisight.errors import InputError, UnknownNameError
from millisight.imaging.grid import VoxelGrid
from millisight.records import (
    Metadata,
    checked_array,
    checked_metadata,
    checked_numbers,
    checked_record,
    put,
    record,
    with_step,
)

_LARGEST = 1e15  # the sum of the squares of as many voxels as fit any memory is finite in float32


@record
class SarImage:
    """A synthetic-aperture image (paper Eq. 1, primer 4): a unit reflector has the value 1 at its place.

    Attributes
    ----------
    grid : VoxelGrid
    values : (X, Y, Z) complex64; complex128 where they were given as such an array, as some published images are
    metadata : provenance; what JSON can hold
    """

    grid: VoxelGrid
    values: np.ndarray
    metadata: Metadata = field(default_factory=dict)

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
        if axis not in ("x", "y", "z"):
            raise UnknownNameError("axis", axis, "xyz")
        if reduce not in ("mean", "max"):
            raise UnknownNameError("projection", reduce, ("mean", "max"))
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


@overload
def combine(specular: SarImage, edge: SarImage, alpha: tuple[float, float]) -> SarImage: ...


@overload
def combine(specular: Capture, edge: Capture, alpha: tuple[float, float]) -> Capture: ...


def combine(specular, edge, alpha):
    """(a1 specular + a2 edge) / (a1 + a2) (paper Eq. 8, primer 14), for two images or for two captures.

    Imaging is linear, so combining the frames and imaging once gives the same as combining two images.

    Parameters
    ----------
    specular, edge : two SarImage on the same grid, or two Capture of the same radar and trajectory
    alpha : (a1, a2), not negative, not both zero

    Raises
    ------
    InputError
        The two do not belong together, or the weights cannot be right.
    """
    a1, a2 = checked_numbers(alpha, name="alpha", count=2, minimum=0)
    if not a1 + a2 > 0:
        raise InputError("alpha is (0, 0); expected at least one weight above zero")
    weights = np.float32(a1 / (a1 + a2)), np.float32(a2 / (a1 + a2))
    if isinstance(specular, SarImage) and isinstance(edge, SarImage):
        metadata = with_step(specular.metadata, "combine", alpha=[a1, a2], edge=dict(edge.metadata))
        for name in "xyz":
            if not np.array_equal(getattr(specular.grid, name), getattr(edge.grid, name)):
                raise InputError(f"the two images' grids differ along {name}; image both on one grid")
        values = weights[0] * specular.values + weights[1] * edge.values
        return SarImage(grid=specular.grid, values=values, metadata=metadata)
    if isinstance(specular, Capture) and isinstance(edge, Capture):
        metadata = with_step(specular.metadata, "combine", alpha=[a1, a2], edge=dict(edge.metadata))
        if not _same_setup(specular, edge):
            raise InputError("the two captures' radars or positions differ; simulate both with the same ones")
        frames = weights[0] * specular.frames_of(slice(None)) + weights[1] * edge.frames_of(slice(None))
        metadata["lit_fraction"] = max(c.metadata.get("lit_fraction", 0.0) for c in (specular, edge))
        return Capture(radar=specular.radar, trajectory=specular.trajectory, frames=frames, metadata=metadata)
    raise InputError(
        f"combine got {type(specular).__name__} and {type(edge).__name__}; expected two images or two captures"
    )


def _same_setup(a: Capture, b: Capture) -> bool:
    return (
        np.array_equal(a.radar.waveform.frequencies, b.radar.waveform.frequencies)
        and a.radar.path_offset == b.radar.path_offset
        and np.array_equal(a.tx_positions, b.tx_positions)
        and np.array_equal(a.rx_positions, b.rx_positions)
    )
