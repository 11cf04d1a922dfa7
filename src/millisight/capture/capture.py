"""A capture: what a radar measured along a trajectory."""

from dataclasses import field
from typing import Any

import numpy as np

from millisight.capture.radar import Radar
from millisight.capture.trajectory import Trajectory
from millisight.errors import InputError
from millisight.records import Metadata, check_shape, checked_array, checked_metadata, put, record

PHASE_SIGN = -1
"""Sign of i 2 pi f d / c in every frame inside millisight (primer 3); files state it, readers conjugate at the door."""


@record
class Capture:
    """Frames of a radar along a trajectory.

    Attributes
    ----------
    radar : Radar
    trajectory : Trajectory of P poses
    frames : (P, T, R, N) complex64, pose x transmitter x receiver x sample; an array, or an HDF5 dataset on disk
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        The frames do not fit the radar and the trajectory, or hold NaN (on disk: found when they are read).
    """

    radar: Radar
    trajectory: Trajectory
    frames: Any
    metadata: Metadata = field(default_factory=dict)

    def __post_init__(self) -> None:
        array, waveform = self.radar.array, self.radar.waveform
        shape = (
            len(self.trajectory),
            len(array.tx_positions),
            len(array.rx_positions),
            waveform.samples_per_chirp,
        )
        if self.in_memory:
            put(self, frames=checked_array(self.frames, name="frames", shape=shape, dtype=np.complex64))
        else:
            check_shape(tuple(self.frames.shape), name="frames", shape=shape)
            if self.frames.dtype != np.complex64:
                raise InputError(f"frames on disk are {self.frames.dtype}; expected complex64")
        put(self, metadata=checked_metadata(self.metadata))

    @property
    def in_memory(self) -> bool:
        """Whether the frames are a NumPy array (or what becomes one), rather than a dataset on disk."""
        return not (hasattr(self.frames, "id") and hasattr(self.frames, "chunks"))

    @property
    def tx_positions(self) -> np.ndarray:
        """(P, T, 3) transmitters in the world frame [m]."""
        return self.trajectory.placed(self.radar.array.tx_positions)

    @property
    def rx_positions(self) -> np.ndarray:
        """(P, R, 3) receivers in the world frame [m]."""
        return self.trajectory.placed(self.radar.array.rx_positions)

    @property
    def channels(self) -> int:
        """K = P T R, the number of frames in the published sense."""
        return int(np.prod(self.frames.shape[:3]))

    def frames_of(self, poses: slice) -> np.ndarray:
        """The frames of some poses as a complex64 array, read from disk where they lie there.

        Raises
        ------
        InputError
            They hold NaN or infinite values.
        """
        if self.in_memory:
            return self.frames[poses]
        frames = self.frames[poses]
        return checked_array(
            frames, name=f"frames of poses {poses.start} to {poses.stop - 1}", shape=frames.shape, dtype=np.complex64
        )
