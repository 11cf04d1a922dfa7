"""Scans and captures as recorded, and what is still to be done with them: calibration, and placing by a robot's log."""

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, cast

import numpy as np

from millisight.core import Metadata, checked_array, checked_items, checked_metadata, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._capture import Capture
from millisight.data._clock import ClockCorrection, check_log
from millisight.data._radar import Radar
from millisight.data._trajectory import Trajectory


@record
class CalibrationStep:
    """One step of a pending calibration.

    Attributes
    ----------
    name : of the step, such as "subtract_mean": one of `millisight.calibration.STEPS`
    settings : its arguments by name: numbers, texts, arrays, captures
    source : where it is written, for messages; "" where nowhere
    """

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("name", "source"):
            checked_record(getattr(self, name), str, name=name)
        put(self, settings=dict(cast(Mapping[str, Any], checked_record(self.settings, Mapping, name="settings"))))

    def __repr__(self) -> str:
        return f"CalibrationStep({self.name}{', ' if self.settings else ''}{', '.join(self.settings)})"


@record
class RawCapture:
    """A capture as recorded, with its pending calibration.

    Attributes
    ----------
    capture : Capture
    calibration : steps, in the order in which they are taken
    """

    capture: Capture
    calibration: tuple[CalibrationStep, ...] = ()

    def __post_init__(self) -> None:
        checked_record(self.capture, Capture, name="capture")
        put(self, calibration=_checked_steps(self.calibration))

    def __repr__(self) -> str:
        steps = ", ".join(step.name for step in self.calibration)
        return f"RawCapture({self.capture!r}, to be calibrated by: {steps or 'nothing'})"

    def to_capture(self) -> Capture:
        """The capture, calibrated: see `millisight.calibration.calibrate`."""
        return late("millisight.calibration", "calibrate")(self.capture, self.calibration)


@record
class ScanRow:
    """The frames of one raw file, such as a row of the scan.

    Attributes
    ----------
    times : (F,) when each frame was taken, on the radar's clock, increasing [s]
    read : called when the frames are needed; returns them, (F, T, R, N) complex, of the phase sign inside millisight
    source : name for messages and provenance, such as the file's
    missing : (F,) bool, frames that the recorder lost, wholly or in part: never used; None: none
    """

    times: np.ndarray
    read: Callable[[], np.ndarray]
    source: str
    missing: np.ndarray | None = None

    def __post_init__(self) -> None:
        checked_record(self.source, str, name="source")
        times = checked_array(self.times, name=f"times of {self.source}", shape=("F",), unit="s")
        wrong = np.flatnonzero(np.diff(times) <= 0)
        if len(wrong):
            i = int(wrong[0])
            raise InputError(
                f"the times of {self.source} go from {times[i]:.6f} to {times[i + 1]:.6f} s at frame {i + 1}; expected "
                "times that increase"
            )
        if not callable(self.read):
            raise InputError(f"read of {self.source} is of type {type(self.read).__name__}; expected a function")
        put(self, times=times)
        if self.missing is not None:
            name = f"missing of {self.source}"
            put(self, missing=checked_array(self.missing, name=name, shape=(len(times),), dtype=bool))

    def __repr__(self) -> str:
        lost = 0 if self.missing is None else int(self.missing.sum())
        frames = f"{len(self.times)} frames{f', {lost} missing' if lost else ''}"
        return f"ScanRow({self.source}, {frames}, {self.times[0]:.6g} to {self.times[-1]:.6g} s)"


@record
class RawScan:
    """Frames on the radar's clock, and a robot log on the robot's clock.

    Attributes
    ----------
    radar : Radar
    rows : ScanRow, at least one, in the order in which they were taken
    log : poses of the radar frame in the world frame, by the robot's clock, times increasing
    metadata : provenance; what JSON can hold
    calibration : steps to be taken once the frames have their places
    """

    radar: Radar
    rows: tuple[ScanRow, ...]
    log: Trajectory
    metadata: Metadata = field(default_factory=dict[str, Any])
    calibration: tuple[CalibrationStep, ...] = ()

    def __post_init__(self) -> None:
        checked_record(self.radar, Radar, name="radar")
        check_log(self.log)
        rows = checked_items(self.rows, ScanRow, name="a row")
        if not rows:
            raise InputError("rows is empty; expected at least one row of frames")
        steps = _checked_steps(self.calibration)
        put(self, rows=rows, metadata=checked_metadata(self.metadata), calibration=steps)

    def __repr__(self) -> str:
        frames = sum(len(row.times) for row in self.rows)
        return f"RawScan({self.radar.name}, {len(self.rows)} rows, {frames} frames, log of {len(self.log)} poses)"

    def to_capture(
        self,
        *,
        clock: ClockCorrection | None = None,
        min_distance: float | None = None,
        poses: str = "cubic",
        progress: Callable[[int, int], None] | None = None,
    ) -> Capture:
        """The frames at the poses of the log (see `millisight.calibration.place_frames`), then calibrated."""
        place_frames = late("millisight.calibration", "place_frames")
        placed = place_frames(self, clock=clock, min_distance=min_distance, poses=poses, progress=progress)
        return late("millisight.calibration", "calibrate")(placed, self.calibration)


def _checked_steps(steps: Any) -> tuple[CalibrationStep, ...]:
    return checked_items(steps, CalibrationStep, name="a step of the calibration")
