"""What the robot's log and the frames' times say of a scan: its way, its rows, the parts of its aperture."""

from typing import NamedTuple

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Capture, ClockCorrection, Trajectory, spans
from millisight.imaging._row_turns import Row, rows_of

_LEAST_FRAMES = 300  # thirty for each of the ten sets whose answers are compared
_LEAST_AGAINST = 0.1  # of the way
_LEAST_ROWS = 3
_SIDE = 16  # wavelengths: of the parts of the aperture whose powers are added


class Unobservable(Exception):
    """The scan does not tell the clock; says why."""


class Scan(NamedTuple):
    """What the search knows of a scan.

    Attributes
    ----------
    log : what of the robot's log the frames can need
    poses : (n,) frames that lie within the log whatever the clock, in the order of their times
    middle, half : of the frames' times [s]
    direction : (3,) in which most of the way runs
    rows : runs along it
    against : part of the way, while frames were taken, that runs against it
    """

    log: Trajectory
    poses: np.ndarray
    middle: float
    half: float
    direction: np.ndarray
    rows: list[Row]
    against: float

    @property
    def speed(self) -> float:
        """[m/s]"""
        return max(row.speed for row in self.rows)

    def clock(self, offset: float, late: float) -> ClockCorrection:
        """The correction by `offset` [s] in the middle and by `late` [s] more at the end: two numbers of one kind."""
        return ClockCorrection(offset=offset, drift=late / self.half, reference_time=self.middle)


def survey(capture: Capture, log: Trajectory, max_offset: float, max_drift: float) -> Scan:
    """What the log and the frames' times say of the scan.

    Raises
    ------
    InputError
        Frames and log do not meet in time.
    """
    times = capture.trajectory.times
    middle, half = (times.min() + times.max()) / 2, np.ptp(times) / 2
    reach = max_offset + max_drift * half
    # Where the arm went before and after is nothing to the search.
    cut = (log.times >= times.min() - 2 * reach) & (log.times <= times.max() + 2 * reach)
    if cut.sum() < 2:
        raise InputError(f"frames and log do not overlap in time: {spans(times, log)}")
    log = Trajectory(
        times=log.times[cut],
        positions=log.positions[cut],
        orientations=None if log.orientations is None else log.orientations[cut],
    )
    inside = np.flatnonzero((times >= log.times[0] + reach) & (times <= log.times[-1] - reach))
    poses = inside[np.argsort(times[inside], kind="stable")]
    steps = np.diff(log.positions, axis=0)
    lengths = np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12)
    direction = np.linalg.eigh(steps.T @ (steps / lengths))[1][:, -1]
    rows = rows_of(log, direction)
    return Scan(log, poses, middle, half, direction, rows, _against(times[poses], log, direction, rows))


def _against(times: np.ndarray, log: Trajectory, direction: np.ndarray, rows: list[Row]) -> float:
    """Part of the way along the rows that runs the less common way, counted from frame to frame, gaps left out."""
    if len(times) < 2:
        return 0.0
    gaps = np.diff(times)
    steps = np.diff(log.at(times).positions @ direction) * (gaps < 3 * np.median(gaps))
    ways = {1.0: 0.0, -1.0: 0.0}
    for row in rows:
        during = slice(*np.searchsorted(times[:-1], row.times[[0, -1]]))
        ways[row.sign] += max(0.0, row.sign * steps[during].sum())
    return min(ways.values()) / (sum(ways.values()) or 1.0)


def check_way(scan: Scan, wavelength: float) -> None:
    """Raise where the way alone says that the clock cannot be observed."""
    if len(scan.poses) < _LEAST_FRAMES:
        raise Unobservable(
            f"{len(scan.poses)} frames lie within the log for every clock that is searched; expected {_LEAST_FRAMES} "
            "at least: a longer log, or a smaller max_offset"
        )
    if np.ptp(scan.log.positions @ scan.direction) < wavelength:
        raise Unobservable("the radar moves by less than a wavelength")
    if len(scan.rows) < _LEAST_ROWS:
        raise Unobservable(f"the scan has {len(scan.rows)} rows; expected {_LEAST_ROWS} at least, to and fro")
    if scan.against < _LEAST_AGAINST:
        raise Unobservable(
            f"all rows run in one direction ({100 * scan.against:.0f} % of the path against it), so that an offset "
            "only shifts the image"
        )


def parts_of(scan: Scan, robot: np.ndarray, along: np.ndarray, wavelength: float) -> np.ndarray:
    """(n,) which part of the aperture each frame is of: some neighbouring rows, some wavelengths long."""
    starts = np.array([row.times[0] for row in scan.rows])
    row = np.clip(np.searchsorted(starts, robot, side="right") - 1, 0, len(starts) - 1)
    across = scan.log.positions - np.outer(scan.log.positions @ scan.direction, scan.direction)
    pitch = np.linalg.norm(np.ptp(across, axis=0)) / max(len(starts) - 1, 1)
    side = _SIDE * wavelength
    size = int(np.clip(round(side / max(pitch, 1e-9)), 4, max(len(starts), 4)))
    group = row * max(1, len(starts) // size) // len(starts)
    segments = max(1, round(np.ptp(along) / side))
    segment = np.clip(((along - along.min()) / np.ptp(along) * segments).astype(int), 0, segments - 1)
    return group * segments + segment
