"""What a rig consists of: an arm, radars and a camera, and who writes a scan down. Drivers and writers implement these.

A scan is made by calls alone: start the radars, sweep the arm, wait, stop the radars. Whether time passes in a
laboratory or on paper in between is the devices' affair; each tells time by its own clock.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from millisight.core import checked_array, checked_number, put, record
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Radar, Trajectory

NOT_TURNED = (0.0, 0.0, 0.0, 1.0)


@record
class ArmPose:
    """Where the arm holds the radars.

    Attributes
    ----------
    position : (3,) the radar frame's origin in the base frame [m]
    orientation : (4,) unit quaternion x, y, z, w, radar to base
    """

    position: np.ndarray
    orientation: np.ndarray = NOT_TURNED  # ty: ignore[invalid-assignment]: an array once it is checked

    def __post_init__(self) -> None:
        orientation = checked_array(self.orientation, name="orientation", shape=(4,))
        length = math.hypot(*orientation)
        if abs(length - 1) > 1e-3:
            raise InputError(f"orientation has the length {length:.3g}; expected a unit quaternion x, y, z, w")
        put(
            self,
            position=checked_array(self.position, name="position", shape=(3,), unit="m"),
            orientation=orientation,
        )

    def __repr__(self) -> str:
        return f"ArmPose({', '.join(f'{x:.4f}' for x in self.position)} m)"


@record
class Recording:
    """What a radar gives back of one start.

    Attributes
    ----------
    samples : (F, C, R, N) complex64, frame x chirp x receiver x sample, in counts of the converter (int16), of the
        phase sign inside millisight: a driver conjugates at its door where its device has the other
    first_time : when the first frame was taken, on the radar's clock [s]
    period : from frame to frame, on the radar's clock [s]
    lost : (F,) bool, frames that arrived damaged or not at all; their samples may be zeros
    """

    samples: np.ndarray
    first_time: float
    period: float
    lost: np.ndarray

    def __post_init__(self) -> None:
        samples = checked_array(self.samples, name="samples", shape=("F", "C", "R", "N"), dtype=np.complex64)
        put(
            self,
            samples=samples,
            first_time=checked_number(self.first_time, name="first_time", unit="s"),
            period=checked_number(self.period, name="period", unit="s", above=0),
            lost=checked_array(self.lost, name="lost", shape=(len(samples),), dtype=np.bool_),
        )

    @property
    def times(self) -> np.ndarray:
        """(F,) when each frame was taken, on the radar's clock [s]."""
        return self.first_time + self.period * np.arange(len(self.samples))


@runtime_checkable
class Arm(Protocol):
    """A robot arm that holds the radars, and logs where it is."""

    def sweep(self, start: ArmPose, end: ArmPose) -> None:
        """Move in a straight line from `start` to `end`, and return at once, while the arm moves.

        An arm that is not at `start` goes there first. `sweep(here, here)` only goes there.
        """
        ...

    def wait(self, watch: Callable[[], None] | None = None) -> None:
        """Return when the arm stands still; `watch` is called a few times a second while it moves, and may raise."""
        ...

    def stop(self) -> None:
        """Stop moving, at once: what was asked for before is given up. An arm that stands still stays."""
        ...

    def log(self, since: float | None = None) -> Trajectory:
        """What was logged so far: poses of the radar frame in the base frame, times of the arm's clock.

        With `since` [s], only poses later than that.
        """
        ...


@runtime_checkable
class RadarDevice(Protocol):
    """A radar and its recorder.

    Attributes
    ----------
    radar : what it measures with
    name : of its own among the rig's radars
    frame_period : from frame to frame, on the radar's clock [s]
    mount : (3,) its transmitter in the radar frame that the arm's poses are of [m]
    """

    radar: Radar
    name: str
    frame_period: float
    mount: np.ndarray

    def start(self, frames: int) -> None:
        """Take `frames` frames from now on, and return at once."""
        ...

    def stop(self) -> Recording:
        """What was recorded since `start`, when its last frame has been taken."""
        ...


@runtime_checkable
class Device(Protocol):
    """What a real device has besides: it must be reached first, and may be asked how it is.

    Every call returns within 5 s, or raises DeviceError with what to do.
    """

    def open(self) -> None:
        """Connect to it and make it ready; a device that is open stays so."""
        ...

    def check(self) -> list[str]:
        """What it says of itself; a line that begins with "warning: " is one. It must be open."""
        ...

    def watch(self) -> None:
        """Return at once; raise DeviceError if it has failed or fallen silent while it was at work."""
        ...

    def close(self) -> None:
        """Leave it at rest; a device that is closed stays so."""
        ...


@runtime_checkable
class Camera(Protocol):
    """A camera with depth, fixed to the arm."""

    def shoot(self) -> CameraFrame:
        """One picture of what is before the camera now; its pose is in the base frame."""
        ...


@runtime_checkable
class ScanWriter(Protocol):
    """Writes a scan down as it comes; `record_scan` is given one.

    Attributes
    ----------
    path : where the scan is found when it is whole
    rows_done : how many rows an earlier scan of the same plan has left, known within `recording`; 0: none
    """

    path: Path

    @property
    def rows_done(self) -> int: ...

    def recording(self, radars: Sequence[RadarDevice]) -> AbstractContextManager[None]:
        """Around the whole scan: refuses before it what could not be written after it.

        Unless `finish` was called, nothing of the scan appears under its name.
        """
        ...

    def add_picture(self, frame: CameraFrame) -> None:
        """The camera's picture, before the first row."""
        ...

    def add_row(self, radar: RadarDevice, recording: Recording) -> None:
        """What one of the radars has recorded of the next row."""
        ...

    def end_row(self, log: Trajectory) -> None:
        """All radars have given the row; `log` is what the arm logged since the row before, in the base frame."""
        ...

    def finish(self) -> None:
        """All rows are there. The scan appears under its name."""
        ...
