"""The image: complex values on a voxel grid."""

from collections.abc import Sequence
from dataclasses import field
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    Metadata,
    check_known,
    check_shape,
    checked_array,
    checked_metadata,
    checked_numbers,
    checked_record,
    late,
    put,
    record,
    with_step,
)
from millisight.core.errors import InputError
from millisight.data._attributes import flat, unflat
from millisight.data._grid import VoxelGrid

_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
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

    @classmethod
    def from_array(
        cls,
        values: ArrayLike,
        spacing: float | Sequence[float] | np.ndarray,
        *,
        center: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        metadata: Metadata | None = None,
    ) -> "SarImage":
        """An image of a plain array, such as one of another imager, with regular voxels.

        Parameters
        ----------
        values : (X, Y, Z), or (X, Y) for an image of one slice; complex, or real such as a magnitude
        spacing : of the voxels along x, y and z, one number or three, or two of one slice [m]
        center : (3,) the middle of the image in the world frame [m]
        metadata : provenance; what JSON can hold

        Raises
        ------
        InputError
            The array has other dimensions or holds NaN, or a spacing is not above 0.

        Examples
        --------
        >>> SarImage.from_array(np.ones((5, 3)), 0.01)
        SarImage(complex64 on VoxelGrid(5 x 3 x 1 voxels, x -0.02 to 0.02 m, y -0.01 to 0.01 m, z 0 to 0 m))
        """
        array = np.asarray(values)
        array = array[..., np.newaxis] if array.ndim == 2 else array
        check_shape(array.shape, name="values", shape=("X", "Y", "Z"))
        if np.ndim(values) == 2 and np.size(spacing) == 2:
            spacing = [*np.ravel(spacing), 1.0]  # of one slice: it has no other beside it
        steps = checked_numbers(spacing, name="spacing", count=3, repeat=True, unit="m", above=0)
        middle = checked_numbers(center, name="center", count=3, unit="m")
        axes: dict[str, np.ndarray] = {
            name: at + step * (np.arange(count) - (count - 1) / 2)
            for name, at, step, count in zip("xyz", middle, steps, array.shape, strict=True)
        }
        return cls(grid=VoxelGrid(**axes), values=array, metadata=metadata or {})

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The values (X, Y, Z), for `numpy.asarray(image)`; read-only unless copied."""
        return np.array(self.values, dtype=dtype, copy=copy)

    def __abs__(self) -> np.ndarray:
        """The `magnitude`, (X, Y, Z)."""
        return self.magnitude

    def plot(self, **settings: Any) -> Any:
        """Plot the mean of |I| along z, y and x.

        Parameters
        ----------
        settings : of `millisight.viz.plot_image`: `scale` ("linear", or "db" down to `dynamic_range_db`), `colormap`,
            a `mesh` whose outline is drawn, `title`

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

    def project(
        self, axis: Literal["x", "y", "z"] | str = "z", *, reduce: Literal["mean", "max"] | str = "mean"
    ) -> np.ndarray:
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

    @property
    def frequency(self) -> float | None:
        """Centre of the band that `form_image` formed it of [Hz]; None where its history does not tell."""
        for step in reversed(self.metadata.get("history", ())):
            if step.get("step") == "form_image" and isinstance(step.get("frequency"), float):
                return step["frequency"]
        return None

    @property
    def steps(self) -> tuple[float, ...]:
        """The widest gaps of the scan between neighbouring phase centres, along its rows and across them [m].

        As `form_image` notes them, and files of the published layout that were written here; () where the history
        does not tell.
        """
        for step in reversed(self.metadata.get("history", ())):
            held = cast(Sequence[Any], step.get("steps", ()))
            if isinstance(held, list | tuple) and held and all(isinstance(one, float) for one in held):
                return tuple(float(one) for one in cast(Sequence[float], held))
        return ()

    @property
    def antennas(self) -> np.ndarray | None:
        """(2, 3) smallest and largest coordinates of the antennas [m], as `form_image` notes them; None: not told."""
        for step in reversed(self.metadata.get("history", ())):
            if "antennas" in step:
                try:
                    held = np.array(step["antennas"], dtype=float)
                except (TypeError, ValueError):  # written by another program
                    continue
                if held.shape == (2, 3) and np.isfinite(held).all():
                    return held
        return None

    @property
    def seen_from(self) -> Literal["above", "below", "beside"] | None:
        """On which side of the image the antennas were, along z or beside it; None where that is not told.

        Sheets, masks, balls, cylinders and flat tops are looked for along z: of an image that was seen from beside,
        turn the frame so that the radar looks along z.
        """
        return None if self.antennas is None else self.grid.side_of(self.antennas)

    @property
    def turned_over(self) -> "SarImage":
        """Mirrored in z, with what it tells of its antennas."""
        grid, metadata = VoxelGrid(x=self.grid.x, y=self.grid.y, z=-self.grid.z[::-1]), dict(self.metadata)
        if self.antennas is not None:
            (x, y, z), (x_end, y_end, z_end) = self.antennas.tolist()
            metadata = with_step(metadata, "turned_over", antennas=[[x, y, -z_end], [x_end, y_end, -z]])
        return SarImage(grid=grid, values=self.values[..., ::-1], metadata=metadata)

    def to_xarray(self, *, parts: bool = False) -> Any:
        """The image for xarray, with coordinates in metres; `from_xarray` reads it back.

        Attributes are flat, as netCDF and Zarr want them: texts and numbers of the metadata are attributes as they
        are, all else, such as `history`, is JSON text. netCDF has no complex numbers: save the two parts there,
        `image.to_xarray(parts=True).to_netcdf("image.nc")`.

        Parameters
        ----------
        parts : give real and imaginary part, instead of complex values

        Returns
        -------
        xarray.DataArray
            (X, Y, Z) complex, by the name "image"; with `parts` an xarray.Dataset of "real" and "imag".

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
        attributes = {name: flat(value) for name, value in self.metadata.items()}
        if not parts:
            return xarray.DataArray(self.values, dims=tuple("xyz"), coords=coords, name="image", attrs=attributes)
        both = {"real": (tuple("xyz"), np.real(self.values)), "imag": (tuple("xyz"), np.imag(self.values))}
        return xarray.Dataset(both, coords=coords, attrs=attributes)

    @classmethod
    def from_xarray(cls, data: Any) -> "SarImage":
        """The image of what `to_xarray` gave, or of what was read from a file of it.

        Parameters
        ----------
        data : xarray.DataArray (X, Y, Z) with coordinates x, y, z, or xarray.Dataset with such "real" and "imag";
            coordinates in metres, or in what their attribute `units` says: m, cm, mm

        Raises
        ------
        InputError
            Coordinates or parts are missing, or cannot be those of an image.

        Examples
        --------
        >>> image = SarImage.from_array(np.ones((5, 3)), 0.01, metadata={"history": [{"step": "made"}]})
        >>> SarImage.from_xarray(image.to_xarray(parts=True)).metadata
        {'history': [{'step': 'made'}]}
        """
        try:
            missing = [name for name in "xyz" if name not in data.coords]  # for which xarray would count instead
            if missing:
                raise ValueError(f"it has no coordinates {' and '.join(missing)}")
            x, y, z = (_metres(data.coords[name]) for name in "xyz")
            if hasattr(data, "data_vars"):
                real, imag = (data[name].transpose(*"xyz").values for name in ("real", "imag"))
                values = real + 1j * imag
            else:
                values = data.transpose(*"xyz").values
        except (AttributeError, KeyError, ValueError) as error:
            raise InputError(
                f"data is no image: {error}; expected an xarray.DataArray along x, y and z, or an xarray.Dataset with "
                "real and imag, as to_xarray gives them"
            ) from error
        metadata = {str(name): unflat(value) for name, value in data.attrs.items()}
        return cls(grid=VoxelGrid(x=x, y=y, z=z), values=values, metadata=metadata)


def _metres(coordinate: Any) -> np.ndarray:
    """The values of a coordinate of xarray's, in metres."""
    unit = str(coordinate.attrs.get("units", "m"))
    if unit not in _METRES:
        raise ValueError(f"its coordinate {coordinate.name} has the units {unit!r}, not {', '.join(_METRES)}")
    return np.asarray(coordinate.values) * _METRES[unit] if _METRES[unit] != 1 else coordinate.values
