"""A recorded scan becomes a capture: each frame at the pose that the robot's log gives its time."""

from collections.abc import Callable
from typing import Any

import numpy as np

from millisight.core import SPEED_OF_LIGHT, as_array, check_known, checked_number, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, ClockCorrection, RawScan, ScanRow, Trajectory, inside_log, spans

POSES = ("cubic", "linear")
"""How positions between those of a log are found."""
_SHORT = 0.75  # of the rows' median number of frames: a row with fewer may lack some


def place_frames(
    scan: RawScan,
    *,
    clock: ClockCorrection | None = None,
    min_distance: float | None = None,
    poses: str = POSES[0],
    progress: Callable[[int, int], None] | None = None,
) -> Capture:
    """Interpolate the pose of each frame from the log: cubic spline for positions, spherical for orientations.

    Frames that the recorder lost, frames outside the log (poses are not extrapolated), and repeats are left out; a
    repeat is closer than `min_distance` to a kept frame of its row. The history counts them, and names rows with less
    than three quarters of the median row's frames (`short_rows`). The choice is made before frames are read; then one
    row at a time is in memory, besides the kept frames.

    Parameters
    ----------
    scan : RawScan
    clock : correction from the radar's clock to the robot's; None: the two agree
    min_distance : [m]; None: 3/16 of the wavelength at the start frequency, as published; 0 keeps repeats
    poses : "cubic", or "linear" as published, for logs without orientations
    progress : called with (rows done, rows in all)

    Returns
    -------
    Capture
        Its trajectory's times are the radar clock's.

    Raises
    ------
    InputError
        No frame is left, or a row has an unexpected shape.
    """
    clock = checked_record(clock or ClockCorrection(offset=0.0), ClockCorrection, name="clock")
    if min_distance is None:
        min_distance = 3 / 16 * SPEED_OF_LIGHT / scan.radar.waveform.start_frequency
    min_distance = checked_number(min_distance, name="min_distance", unit="m", minimum=0)

    times = np.concatenate([row.times for row in scan.rows])
    row_of = np.repeat(np.arange(len(scan.rows)), [len(row.times) for row in scan.rows])
    lost = np.concatenate([_lost(row) for row in scan.rows])
    robot = clock.robot_times(times)
    inside = inside_log(robot, scan.log)
    used = np.flatnonzero(inside & ~lost)
    if not len(used):
        raise InputError(f"no frame is left, {int(lost.sum())} of {len(times)} are lost: {spans(robot, scan.log)}")
    placed = _at(scan.log, robot[used], poses)
    fresh = np.concatenate(
        [without_repeats(placed.positions[row_of[used] == r], min_distance) for r in range(len(scan.rows))]
    )
    kept = used[fresh]
    return Capture(
        radar=scan.radar,
        trajectory=Trajectory(
            times=times[kept],
            positions=placed.positions[fresh],
            orientations=None if placed.orientations is None else placed.orientations[fresh],
        ),
        frames=_frames(scan, kept, row_of, progress),
        metadata=with_step(
            scan.metadata,
            "place_frames",
            clock=clock.settings(),
            min_distance=min_distance,
            rows=len(scan.rows),
            frames=len(times),
            lost=int(lost.sum()),
            outside_log=int((~inside & ~lost).sum()),
            repeats=len(used) - len(kept),
            kept=len(kept),
            longest_log_gap=float(_gaps(robot[kept], scan.log).max()),
            **({} if poses == POSES[0] else {"poses": poses}),
            **_short_rows(scan),
        ),
    )


def _short_rows(scan: RawScan) -> dict[str, Any]:
    """For the history, rows with far fewer frames than others, such as those of files that were cut short."""
    counts = np.array([len(row.times) for row in scan.rows])
    usual = float(np.median(counts))
    short = [row.source for row, count in zip(scan.rows, counts, strict=True) if count < _SHORT * usual]
    return {"short_rows": short} if short else {}


def _at(log: Trajectory, times: np.ndarray, poses: str) -> Trajectory:
    """The log's poses at times within it."""
    check_known("interpolation of poses", poses, POSES)
    if poses == POSES[0]:
        return log.at(times)
    if log.orientations is not None:
        raise InputError('poses="linear" is for logs without orientations, as the published ones are used')
    positions = np.stack([np.interp(times, log.times, axis) for axis in log.positions.T], axis=1)
    return Trajectory(times=times, positions=positions)


def _frames(
    scan: RawScan, kept: np.ndarray, row_of: np.ndarray, progress: Callable[[int, int], None] | None
) -> np.ndarray:
    """(P, T, R, N) complex64 frames with the numbers `kept`, increasing; rows without one are not read."""
    array = scan.radar.array
    shape = (len(array.tx_positions), len(array.rx_positions), scan.radar.waveform.samples_per_chirp)
    frames = np.empty((len(kept), *shape), dtype=np.complex64)
    starts = np.searchsorted(row_of, np.arange(len(scan.rows) + 1))
    places = np.searchsorted(kept, starts)
    for r, row in enumerate(scan.rows):
        wanted = slice(places[r], places[r + 1])
        if wanted.start < wanted.stop:
            read = as_array(
                row.read(), name=f"frames of {row.source}", shape=(len(row.times), *shape), dtype=np.complex64
            )
            frames[wanted] = read[kept[wanted] - starts[r]]
        if progress is not None:
            progress(r + 1, len(scan.rows))
    frames.flags.writeable = False
    return frames


def without_repeats(positions: np.ndarray, min_distance: float) -> np.ndarray:
    """(n,) bool, which of the positions (n, 3) [m] are kept: each one at `min_distance` or more from all kept before.

    A tree finds what a kept one bars, so that thousands of frames that stand still cost no more than few that move.
    """
    from scipy.spatial import KDTree

    fresh = np.ones(len(positions), dtype=bool)
    if not len(positions) or not min_distance:
        return fresh
    tree = KDTree(positions)
    for i, position in enumerate(positions):
        if fresh[i]:
            near = np.array(tree.query_ball_point(position, min_distance * (1 + 1e-9)))
            near = near[near > i]
            # The rule itself decides: the tree rounds in its own way, and counts the distance itself as near.
            fresh[near[np.linalg.norm(positions[near] - position, axis=1) < min_distance]] = False
    return fresh


def _lost(row: ScanRow) -> np.ndarray:
    return np.zeros(len(row.times), dtype=bool) if row.missing is None else row.missing


def _gaps(robot_times: np.ndarray, log: Trajectory) -> np.ndarray:
    """(n,) the time between the two poses of the log that each time lies between [s]."""
    after = np.clip(np.searchsorted(log.times, robot_times), 1, len(log) - 1)
    return log.times[after] - log.times[after - 1]
