"""The radar's clock against the robot's: offset and drift, and a capture's poses with them corrected."""

from millisight.core import checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, ClockCorrection, Trajectory, check_follows_log, check_log, inside_log, spans


def retime(capture: Capture, log: Trajectory, clock: ClockCorrection) -> Capture:
    """Interpolate the poses again from the robot log, at corrected times.

    Frames that fall off the log are dropped, and counted in the history: nothing is extrapolated. Frames on disk stay
    there where none is dropped, and are read into memory otherwise.

    Parameters
    ----------
    capture : its trajectory's times are the radar clock's
    log : poses of the radar frame in the world frame, on the robot's clock, times increasing
    clock : the correction, as `estimate_clock` finds it

    Raises
    ------
    InputError
        No frame lies within the log, or the log alone does not place the antennas.
    """
    checked_record(capture, Capture, name="capture")
    check_follows_log(capture)
    checked_record(clock, ClockCorrection, name="clock")
    check_log(log)
    times = capture.trajectory.times
    robot = clock.robot_times(times)
    inside = inside_log(robot, log)
    if not inside.any():
        raise InputError(f"no frame lies within the robot log: {spans(robot, log)}")
    poses = log.at(robot[inside])
    return Capture(
        radar=capture.radar,
        trajectory=Trajectory(times=times[inside], positions=poses.positions, orientations=poses.orientations),
        frames=capture.frames if inside.all() else capture.frames_of(slice(None))[inside],
        metadata=with_step(
            capture.metadata, "retime", clock=clock.settings(), outside_log=int((~inside).sum()), kept=int(inside.sum())
        ),
    )
