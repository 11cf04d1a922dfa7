"""The radar's clock against the robot's: offset and drift."""

import numpy as np

from millisight.core import checked_array, checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.data._trajectory import Trajectory


@record
class ClockCorrection:
    """Conversion from the radar's clock to the robot's: robot time = t + offset + drift (t - reference_time).

    Attributes
    ----------
    offset : how far the robot's clock is ahead at `reference_time` [s]
    drift : drift of the robot's clock [s/s]; 50e-6 is 50 ppm
    reference_time : time of the offset, on the radar's clock [s]

    Examples
    --------
    >>> ClockCorrection(offset=0.02, drift=50e-6, reference_time=100.0).robot_times([100.0, 200.0])
    array([100.02 , 200.025])
    """

    offset: float
    drift: float = 0.0
    reference_time: float = 0.0

    def __post_init__(self) -> None:
        put(
            self,
            offset=checked_number(self.offset, name="offset", unit="s"),
            drift=checked_number(self.drift, name="drift", unit="s/s", above=-1),
            reference_time=checked_number(self.reference_time, name="reference_time", unit="s"),
        )

    def robot_times(self, radar_times: np.ndarray) -> np.ndarray:
        """(n,) times of the robot's clock [s] for times (n,) of the radar's [s]."""
        times = checked_array(radar_times, name="radar_times", shape=("n",), unit="s")
        return times + self.offset + self.drift * (times - self.reference_time)

    def settings(self) -> dict[str, float]:
        """The correction as a step of a record's history holds it."""
        return {"offset": self.offset, "drift": self.drift, "reference_time": self.reference_time}


def check_log(log: Trajectory) -> None:
    """Raise `InputError` unless `log` can be interpolated: two poses at least, at times that increase."""
    checked_record(log, Trajectory, name="log")
    if len(log) < 2:
        raise InputError("the robot log has a single pose; expected at least two")
    wrong = np.flatnonzero(np.diff(log.times) <= 0)
    if len(wrong):
        i = int(wrong[0])
        raise InputError(
            f"the times of the robot log go from {log.times[i]:.6f} to {log.times[i + 1]:.6f} s at pose {i + 1}; "
            "expected times that increase: sort them and remove repeats"
        )


def inside_log(robot_times: np.ndarray, log: Trajectory) -> np.ndarray:
    """(n,) bool, which of the times (n,) [s, the robot's clock] the log covers."""
    return (robot_times >= log.times[0]) & (robot_times <= log.times[-1])


def spans(robot_times: np.ndarray, log: Trajectory) -> str:
    """The spans of time of frames and log, in words, and what to look at where they do not meet."""
    return (
        f"the frames run from {robot_times.min():.6g} to {robot_times.max():.6g} s on the robot's clock, the log from "
        f"{log.times[0]:.6g} to {log.times[-1]:.6g} s; check that both are of one recording and in seconds"
    )
