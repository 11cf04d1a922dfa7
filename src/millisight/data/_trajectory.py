"""Where the radar was, and when."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    SPEED_OF_LIGHT,
    box,
    checked_array,
    checked_number,
    checked_numbers,
    interpolate_poses,
    lengths_of,
    put,
    record,
    rotation_from_quaternion,
)
from millisight.core.errors import InputError
from millisight.data._reach import check_reach

_MOST_POSITIONS = 1e8  # of a raster; their frames would fill hundreds of gigabytes


@record
class Trajectory:
    """The poses of the radar, one per frame.

    Attributes
    ----------
    times : (P,) [s]
    positions : (P, 3) the radar frame's origin in the world frame [m]
    orientations : (P, 4) unit quaternions x, y, z, w, radar to world; None: not turned

    Raises
    ------
    InputError
        A shape does not fit, a value is NaN or infinite, a position is beyond 1e9 m, or a quaternion is not a unit one.
    """

    times: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray | None = None

    def __post_init__(self) -> None:
        positions = checked_array(self.positions, name="positions", shape=("P", 3), unit="m")
        check_reach(positions, "positions")
        times = checked_array(self.times, name="times", shape=(len(positions),), unit="s")
        put(self, times=times, positions=positions)
        if self.orientations is not None:
            quaternions = checked_array(self.orientations, name="orientations", shape=(len(positions), 4))
            lengths = lengths_of(quaternions)
            if abs(lengths - 1).max() > 1e-3:
                raise InputError(
                    f"orientations have lengths {lengths.min():.3g} to {lengths.max():.3g}; "
                    "expected unit quaternions in the order x, y, z, w"
                )
            put(self, orientations=quaternions)

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        lower, upper = self.positions.min(axis=0), self.positions.max(axis=0)
        turned = "" if self.orientations is None else ", oriented"
        return f"Trajectory({len(self)} poses, {box(lower, upper)}{turned})"

    @classmethod
    def raster(
        cls,
        *,
        size: tuple[float, float],
        step: float | tuple[float, float],
        center: tuple[float, float, float] = (0.0, 0.0, 0.2),
        serpentine: bool = False,
        interval: float = 1e-3,
    ) -> "Trajectory":
        """A planar raster parallel to x and y, its rows along y, centred on `center`.

        Parameters
        ----------
        size : extent along x and y [m], rounded down to whole steps
        step : distance between neighbouring positions along x and y [m]
        center : [m]; 0.2 m above the object's centre as published
        serpentine : every second row runs backwards, as an arm would
        interval : time between positions [s]

        Examples
        --------
        >>> len(Trajectory.raster(size=(0.02, 0.01), step=0.001))
        231
        """
        steps = checked_numbers(step, name="step", count=2, repeat=True, unit="m", above=0)
        extents = checked_numbers(size, name="aperture size", count=2, repeat=True, unit="m", minimum=0)
        middle = checked_numbers(center, name="center", count=3, unit="m")
        interval = checked_number(interval, name="interval", unit="s", above=0)
        counts = [float(np.floor(e / s * (1 + 1e-9))) + 1 for e, s in zip(extents, steps, strict=True)]
        if not counts[0] * counts[1] <= _MOST_POSITIONS:
            raise InputError(
                f"the raster would have {counts[0]:.3g} x {counts[1]:.3g} positions; expected {_MOST_POSITIONS:.0e} "
                "at most: choose a larger step or a smaller size"
            )
        return cls._from_counts([int(n) for n in counts], steps, middle, serpentine, interval)

    @classmethod
    def published(cls, start_frequency: float, *, large: bool = False) -> "Trajectory":
        """The aperture of the published simulations: step c / (4 f_0), 230 x floor(0.55 m / step) positions.

        `large` gives 270 rows, as published for large objects; 0.2 m above the object's centre.
        """
        step = SPEED_OF_LIGHT / (4 * checked_number(start_frequency, name="start_frequency", unit="Hz", above=0))
        return cls._from_counts((270 if large else 230, int(0.55 / step)), [step, step], (0.0, 0.0, 0.2), False, 1e-3)

    @classmethod
    def _from_counts(
        cls,
        counts: Sequence[int],
        steps: Sequence[float],
        center: ArrayLike,
        serpentine: bool,
        interval: float,
    ) -> "Trajectory":
        x, y = (s * (np.arange(n) - (n - 1) / 2) for n, s in zip(counts, steps, strict=True))
        rows = np.tile(y, (len(x), 1))
        if serpentine:
            rows[1::2] = rows[1::2, ::-1]
        positions = np.stack([np.repeat(x, len(y)), rows.ravel(), np.zeros(rows.size)], axis=1)
        with np.errstate(over="ignore"):  # which is then refused
            times = interval * np.arange(rows.size)
        return cls(times=times, positions=positions + np.asarray(center, dtype=float))

    def at(self, times: np.ndarray) -> "Trajectory":
        """The poses at other `times` (n,) [s]: positions by cubic spline, orientations by slerp, no extrapolation."""
        positions, turned = interpolate_poses(times, self.times, self.positions, self.orientations)
        return Trajectory(times=times, positions=positions, orientations=turned)

    @property
    def extent(self) -> np.ndarray:
        """(3,) size of the box that holds all positions [m]."""
        return np.ptp(self.positions, axis=0)

    def placed(self, offsets: np.ndarray) -> np.ndarray:
        """(P, A, 3) world positions [m] of points (A, 3) that are fixed in the radar frame."""
        if self.orientations is None:
            return self.positions[:, None] + offsets
        turned = np.einsum("pij,aj->pai", rotation_from_quaternion(self.orientations), offsets)
        return self.positions[:, None] + turned
