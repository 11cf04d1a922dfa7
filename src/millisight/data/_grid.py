"""Where an image is wanted: voxel grids and pixel grids."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from millisight.core import box, checked_array, checked_numbers, put, record
from millisight.core.errors import InputError
from millisight.data._reach import check_reach

_MOST_VOXELS, _MOST_ALONG = 1e11, 1e7  # 800 GB of complex64; 80 MB of an axis


def _coordinates(value: np.ndarray, name: str) -> np.ndarray:
    coordinates = checked_array(value, name=name, shape=(name.upper(),), unit="m")
    check_reach(coordinates, f"grid coordinates {name}")
    if not (np.diff(coordinates) > 0).all():
        raise InputError(f"grid coordinates {name} must increase strictly; sort them and remove repeats")
    return coordinates


def grid_difference(one: "PixelGrid | VoxelGrid", other: "PixelGrid | VoxelGrid", *, within: float = 1e-6) -> str:
    """In a line, how the first axis that differs between two grids differs; "" where they are the same.

    Parameters
    ----------
    one, other : their axes z are compared where both have one
    within : coordinates nearer than this are the same [m]

    Examples
    --------
    >>> import numpy as np
    >>> a, b = (PixelGrid(x=np.arange(3.0), y=np.arange(n) / 400) for n in (240, 241))
    >>> grid_difference(a, b)
    'y: 240 from 0 to 0.5975 m by 0.0025, and 241 from 0 to 0.6 m by 0.0025'
    """
    for name in "xyz" if isinstance(one, VoxelGrid) and isinstance(other, VoxelGrid) else "xy":
        axes = getattr(one, name), getattr(other, name)
        if len(axes[0]) != len(axes[1]) or np.abs(axes[0] - axes[1]).max() > within:
            told = [_told(axis) for axis in axes]
            apart = f", {abs(axes[0] - axes[1]).max():.2g} m apart" if told[0] == told[1] else ""
            return f"{name}: {told[0]}, and {told[1]}{apart}"
    return ""


def _told(axis: np.ndarray) -> str:
    """How many coordinates, from where to where, by which step."""
    step = f" by {(axis[-1] - axis[0]) / (len(axis) - 1):.4g}" if len(axis) > 1 else ""
    return f"{len(axis)} from {axis[0] + 0.0:.4g} to {axis[-1] + 0.0:.4g} m{step}"


@record
class PixelGrid:
    """Positions of the pixels of a picture.

    Attributes
    ----------
    x, y : (X,) and (Y,) coordinates of their centres, increasing [m]
    """

    x: np.ndarray
    y: np.ndarray

    def __post_init__(self) -> None:
        put(self, x=_coordinates(self.x, "x"), y=_coordinates(self.y, "y"))

    def __repr__(self) -> str:
        return f"PixelGrid({len(self.x)} x {len(self.y)} pixels, {box(*self.bounds)})"

    @property
    def shape(self) -> tuple[int, int]:
        """(X, Y) pixels along each axis."""
        return len(self.x), len(self.y)

    @property
    def bounds(self) -> np.ndarray:
        """(2, 2) first and last pixel centre along each axis [m]."""
        return np.array([[a[0], a[-1]] for a in (self.x, self.y)]).T


@record
class VoxelGrid:
    """Positions of the voxels of an image.

    Attributes
    ----------
    x, y, z : (X,), (Y,) and (Z,) coordinates of their centres in the world frame, increasing [m]
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray

    def __post_init__(self) -> None:
        put(self, x=_coordinates(self.x, "x"), y=_coordinates(self.y, "y"), z=_coordinates(self.z, "z"))

    def __repr__(self) -> str:
        return f"VoxelGrid({' x '.join(map(str, self.shape))} voxels, {box(*self.bounds)})"

    @classmethod
    def regular(
        cls,
        lower: Sequence[float] | np.ndarray,
        upper: Sequence[float] | np.ndarray,
        spacing: float | Sequence[float] | np.ndarray,
    ) -> "VoxelGrid":
        """Regular voxels from `lower` to at most `upper`, `spacing` apart [m].

        Raises
        ------
        InputError
            A spacing is not positive, `upper` lies below `lower`, or the voxels are too many for any memory.

        Examples
        --------
        >>> VoxelGrid.regular((0, 0, 0), (0.1, 0.05, 0), 0.01).shape
        (11, 6, 1)
        """
        starts = checked_numbers(lower, name="lower", count=3, unit="m")
        stops = checked_numbers(upper, name="upper", count=3, unit="m")
        steps = checked_numbers(spacing, name="spacing", count=3, repeat=True, unit="m", above=0)
        for name, start, stop in zip("xyz", starts, stops, strict=True):
            if stop < start:
                raise InputError(f"grid along {name} runs from {start:g} to {stop:g} m; expected upper >= lower")
        with np.errstate(over="ignore"):  # infinitely many are refused like too many
            counts = np.floor((np.array(stops) - starts) / steps * (1 + 1e-9)) + 1
            number = counts.prod()
        if not (number <= _MOST_VOXELS and counts.max() <= _MOST_ALONG):
            raise InputError(
                f"the grid would have {' x '.join(f'{n:.3g}' for n in counts)} = {number:.3g} voxels; expected "
                f"{_MOST_VOXELS:.0e} at most, and {_MOST_ALONG:.0e} along an axis: choose a coarser spacing or a "
                "smaller box"
            )
        axes = [start + step * np.arange(int(n)) for start, step, n in zip(starts, steps, counts, strict=True)]
        return cls(x=axes[0], y=axes[1], z=axes[2])

    @property
    def shape(self) -> tuple[int, int, int]:
        """(X, Y, Z) voxels along each axis."""
        return len(self.x), len(self.y), len(self.z)

    @property
    def size(self) -> int:
        """Number of voxels."""
        return len(self.x) * len(self.y) * len(self.z)

    @property
    def points(self) -> np.ndarray:
        """(X Y Z, 3) voxel centres [m], z running fastest."""
        return np.stack(np.meshgrid(self.x, self.y, self.z, indexing="ij"), axis=-1).reshape(-1, 3)

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) first and last voxel centre along each axis [m]."""
        return np.array([[a[0], a[-1]] for a in (self.x, self.y, self.z)]).T

    @property
    def xy(self) -> PixelGrid:
        """The grid seen along z."""
        return PixelGrid(x=self.x, y=self.y)

    def side_of(self, box: np.ndarray) -> Literal["above", "below", "beside"] | None:
        """On which side of the grid a box lies: along z, or beside it; None: about it.

        What counts is the place in the box that is nearest to the middle of the grid.

        Parameters
        ----------
        box : (2, 3) lower and upper corner [m]

        Raises
        ------
        InputError
            It is no array of two corners.
        """
        middle, corners = self.bounds.mean(axis=0), checked_array(box, name="box", shape=(2, 3), unit="m")
        away = np.clip(middle, *corners) - middle
        aside, half = float(np.hypot(*away[:2])), float(np.hypot(*np.ptp(self.bounds, axis=0)[:2])) / 2
        if abs(away[2]) >= aside:
            return None if away[2] == 0 else "above" if away[2] > 0 else "below"
        return "beside" if aside > half else None
