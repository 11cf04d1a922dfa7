"""A capture: what a radar measured along a trajectory."""

from dataclasses import field
from typing import Any, cast

import numpy as np

from millisight.core import (
    Metadata,
    check_shape,
    checked_array,
    checked_metadata,
    checked_record,
    late,
    put,
    record,
    was_cut,
)
from millisight.core.errors import DamagedFileError, InputError
from millisight.data._layers import Layers
from millisight.data._radar import Radar
from millisight.data._reach import check_reach
from millisight.data._trajectory import Trajectory

PHASE_SIGN = -1
"""Sign of i 2 pi f d / c in every frame inside millisight (primer 3); files state it, readers conjugate at the door."""


def check_follows_log(capture: "Capture") -> None:
    """Refuse a capture whose antennas a robot's log does not place.

    Raises
    ------
    InputError
    """
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError("the capture states the antenna positions of each pose; a robot log cannot replace them")
    if capture.layers is not None:
        raise InputError("the capture already has layers; place its frames by the log first, then add the layers")


@record
class Capture:
    """Frames of a radar along a trajectory.

    Attributes
    ----------
    radar : Radar
    trajectory : Trajectory of P poses
    frames : (P, T, R, N) complex64, pose x transmitter x receiver x sample; an array, or an HDF5 dataset on disk
    metadata : provenance; what JSON can hold
    tx_points, rx_points : (P, T, 3), (P, R, 3) antenna positions in the world frame [m] for each pose, for example
        for measured pairs of a fixed array; None: the radar's array at the poses of the trajectory
    layers : plane layers between antennas and scene, or None

    Raises
    ------
    InputError
        The frames do not fit the radar and the trajectory, or hold NaN (on disk: found when they are read), or an
        antenna is beyond 1e9 m.
    """

    radar: Radar
    trajectory: Trajectory
    frames: Any
    metadata: Metadata = field(default_factory=dict[str, Any])
    tx_points: np.ndarray | None = None
    rx_points: np.ndarray | None = None
    layers: Layers | None = None

    def __post_init__(self) -> None:
        checked_record(self.radar, Radar, name="radar")
        checked_record(self.trajectory, Trajectory, name="trajectory")
        shape = self._shape
        if self.in_memory:
            put(self, frames=checked_array(self.frames, name="frames", shape=shape, dtype=np.complex64))
        else:
            check_shape(tuple(self.frames.shape), name="frames", shape=shape)
            if self.frames.dtype != np.complex64:
                raise InputError(f"frames on disk are {self.frames.dtype}; expected complex64")
        put(self, metadata=checked_metadata(self.metadata))
        for name, count in (("tx_points", shape[1]), ("rx_points", shape[2])):
            points = getattr(self, name)
            if points is not None:
                points = checked_array(points, name=name, shape=(shape[0], count, 3), unit="m")
                check_reach(points, name)
                put(self, **{name: points})
        if self.layers is not None:
            checked_record(self.layers, Layers, name="layers")

    def __repr__(self) -> str:
        poses, transmitters, receivers, samples = self._shape
        return (
            f"Capture({self.radar.name}, {poses} poses x {transmitters} TX x {receivers} RX x {samples} samples, "
            f"{'in memory' if self.in_memory else 'on disk'})"
        )

    def plot(self, **settings: Any) -> Any:
        """Plot the positions of the radar and the range profile of every pose.

        Parameters
        ----------
        settings : of `millisight.viz.plot_capture`: `dynamic_range_db` of the profiles, `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_capture")(self, **settings)

    def _repr_html_(self) -> str:
        return late("millisight.viz", "html_card")(self)

    @property
    def _shape(self) -> tuple[int, int, int, int]:
        """(P, T, R, N)"""
        array = self.radar.array
        return (
            len(self.trajectory),
            len(array.tx_positions),
            len(array.rx_positions),
            self.radar.waveform.samples_per_chirp,
        )

    @property
    def in_memory(self) -> bool:
        """Whether the frames are a NumPy array (or what becomes one), rather than a dataset on disk."""
        kind = cast(type[object], type(self.frames))  # asked of the type: a closed dataset answers nothing
        return not (hasattr(kind, "id") and hasattr(kind, "chunks"))

    @property
    def tx_positions(self) -> np.ndarray:
        """(P, T, 3) transmitters in the world frame [m]."""
        return self.trajectory.placed(self.radar.array.tx_positions) if self.tx_points is None else self.tx_points

    @property
    def rx_positions(self) -> np.ndarray:
        """(P, R, 3) receivers in the world frame [m]."""
        return self.trajectory.placed(self.radar.array.rx_positions) if self.rx_points is None else self.rx_points

    @property
    def channels(self) -> int:
        """K = P T R, the number of frames in the published sense."""
        return int(np.prod(self._shape[:3]))

    def frames_of(self, poses: slice) -> np.ndarray:
        """The frames of some poses as a complex64 array, read from disk where they lie there.

        Raises
        ------
        InputError
            They hold NaN or infinite values, or lie in a file that is closed.
        DamagedFileError
            They lie on disk and cannot be read.
        """
        if self.in_memory:
            return self.frames[poses]
        if not self.frames:
            raise InputError(
                "the capture's file was closed; use the capture inside the `with ms.open_capture(...)` block, or read "
                "it into memory with ms.load"
            )
        start, stop, _ = poses.indices(len(self.trajectory))
        try:
            frames = self.frames[poses]
        except OSError as error:
            raise DamagedFileError(f"frames of poses {start} to {stop - 1} cannot be read: {error}") from error
        if was_cut(self.frames.file):
            raise DamagedFileError(
                f"frames of poses {start} to {stop - 1} cannot be trusted: the file was cut short while it was read; "
                "make or copy it again"
            )
        frames.flags.writeable = False
        return checked_array(
            frames, name=f"frames of poses {start} to {stop - 1}", shape=frames.shape, dtype=np.complex64
        )
