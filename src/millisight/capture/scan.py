"""A scan as recorded, frames by the radar's clock and poses by the robot's, and how it becomes a capture."""

from collections.abc import Callable
from dataclasses import field

import numpy as np

from millisight.capture.capture import Capture
from millisight.capture.clock import ClockCorrection, check_log, inside_log, spans
from millisight.capture.radar import Radar
from millisight.capture.trajectory import Trajectory
from millisight.constants import SPEED_OF_LIGHT
from millisight.errors import InputError
from millisight.records import (
    Metadata,
    as_array,
    checked_array,
    checked_metadata,
    checked_number,
    checked_record,
    put,
    record,
    with_step,
)


@record
class ScanRow:
    """One raw file's worth of frames, such as a row of the scan.

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
                f"times of {self.source} go from {times[i]:.6f} to {times[i + 1]:.6f} s at frame {i + 1}; expected "
                "times that increase"
            )
        if not callable(self.read):
            raise InputError(f"read of {self.source} is of type {type(self.read).__name__}; expected a function")
        put(self, times=times)
        if self.missing is not None:
            name = f"missing of {self.source}"
            put(self, missing=checked_array(self.missing, name=name, shape=(len(times),), dtype=bool))


@record
class RawScan:
    """Frames by the radar's clock, and the robot's log by the robot's.

    Attributes
    ----------
    radar : Radar
    rows : ScanRow, at least one, in the order in which they were taken
    log : poses of the radar frame in the world frame, by the robot's clock, times increasing
    metadata : provenance; what JSON can hold
    """

    radar: Radar
    rows: tuple[ScanRow, ...]
    log: Trajectory
    metadata: Metadata = field(default_factory=dict)

    def __post_init__(self) -> None:
        checked_record(self.radar, Radar, name="radar")
        check_log(self.log)
        rows = tuple(checked_record(row, ScanRow, name="a row") for row in self.rows)
        if not rows:
            raise InputError("rows is empty; expected at least one row of frames")
        put(self, rows=rows, metadata=checked_metadata(self.metadata))

    def __repr__(self) -> str:
        frames = sum(len(row.times) for row in self.rows)
        return f"RawScan({self.radar.name}, {len(self.rows)} rows, {frames} frames, log of {len(self.log)} poses)"

    def to_capture(
        self,
        *,
        clock: ClockCorrection | None = None,
        min_distance: float | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Capture:
        """The frames with the poses that the log gives their times: by cubic spline and spherical interpolation.

        Left out are frames that the recorder lost, frames outside the log (nothing is extrapolated), and repeats: a
        frame closer than `min_distance` to a kept one of its row. The history counts each. What to keep is decided
        before anything is read; then one row is held at a time, besides what is kept.

        Parameters
        ----------
        clock : correction from the radar's clock to the robot's; None: the two agree
        min_distance : [m]; None: 3/16 of the wavelength at the start frequency, as published; 0 keeps repeats
        progress : called with (rows done, rows in all)

        Returns
        -------
        Capture
            Its trajectory's times are the radar clock's.

        Raises
        ------
        InputError
            No frame is left, or a row reads as something else than it should.
        """
        clock = checked_record(clock or ClockCorrection(offset=0.0), ClockCorrection, name="clock")
        if min_distance is None:
            min_distance = 3 / 16 * SPEED_OF_LIGHT / self.radar.waveform.start_frequency
        min_distance = checked_number(min_distance, name="min_distance", unit="m", minimum=0)

        times = np.concatenate([row.times for row in self.rows])
        row_of = np.repeat(np.arange(len(self.rows)), [len(row.times) for row in self.rows])
        lost = np.concatenate([_lost(row) for row in self.rows])
        robot = clock.robot_times(times)
        inside = inside_log(robot, self.log)
        used = np.flatnonzero(inside & ~lost)
        if not len(used):
            raise InputError(f"no frame is left, {int(lost.sum())} of {len(times)} are lost: {spans(robot, self.log)}")
        poses = self.log.at(robot[used])
        fresh = np.concatenate(
            [without_repeats(poses.positions[row_of[used] == r], min_distance) for r in range(len(self.rows))]
        )
        kept = used[fresh]
        return Capture(
            radar=self.radar,
            trajectory=Trajectory(
                times=times[kept],
                positions=poses.positions[fresh],
                orientations=None if poses.orientations is None else poses.orientations[fresh],
            ),
            frames=self._read(kept, row_of, progress),
            metadata=with_step(
                self.metadata,
                "place_frames",
                clock=clock.settings(),
                min_distance=min_distance,
                rows=len(self.rows),
                frames=len(times),
                lost=int(lost.sum()),
                outside_log=int((~inside & ~lost).sum()),
                repeats=len(used) - len(kept),
                kept=len(kept),
                longest_log_gap=float(_gaps(robot[kept], self.log).max()),
            ),
        )

    def _read(self, kept: np.ndarray, row_of: np.ndarray, progress: Callable[[int, int], None] | None) -> np.ndarray:
        """(P, T, R, N) complex64 frames with the numbers `kept`, increasing; rows without one are not read."""
        array = self.radar.array
        shape = (len(array.tx_positions), len(array.rx_positions), self.radar.waveform.samples_per_chirp)
        frames = np.empty((len(kept), *shape), dtype=np.complex64)
        starts = np.searchsorted(row_of, np.arange(len(self.rows) + 1))
        places = np.searchsorted(kept, starts)
        for r, row in enumerate(self.rows):
            wanted = slice(places[r], places[r + 1])
            if wanted.start < wanted.stop:
                read = as_array(
                    row.read(), name=f"frames of {row.source}", shape=(len(row.times), *shape), dtype=np.complex64
                )
                frames[wanted] = read[kept[wanted] - starts[r]]
            if progress is not None:
                progress(r + 1, len(self.rows))
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
