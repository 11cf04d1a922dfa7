"""Images while the arm moves: rows are imaged as they come, beside whoever writes them down."""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from millisight.core import record
from millisight.core.errors import InputError, MillisightError
from millisight.data import CameraFrame, RawScan, SarImage, ScanRow, Trajectory, VoxelGrid
from millisight.imaging import GrowingImage
from millisight.rig._captures import mounted
from millisight.rig._protocols import RadarDevice, Recording, ScanWriter
from millisight.rig._published import PublishedWriter


@record
class LiveStatus:
    """How far the image of one radar is.

    Attributes
    ----------
    radar : its name
    image : SarImage of the rows so far
    rows : that are in the image
    poses : that are in the image
    lag : from the end of the last of these rows until the image was there [s]
    change : of the image by the last rows, relative to its norm
    """

    radar: str
    image: SarImage
    rows: int
    poses: int
    lag: float
    change: float

    def __repr__(self) -> str:
        return f"LiveStatus({self.radar}: {self.rows} rows, {self.poses} poses, {self.lag:.1f} s behind)"


class LiveImaging:
    """Forms images of the rows of a scan while it is taken: a `ScanWriter` around another, which writes the scan.

    Imaging has a thread of its own and never holds the scan up: rows that came in the meantime are imaged together. An
    error of it ends the images and not the scan; `trouble` then says why. `lags` tells by the radar's name how far
    behind the arm its image was at most [s].

    Parameters
    ----------
    writer : writes the scan
    grids : by the radar's name, in the frame of the images; radars without a grid are not imaged
    origin : (3,) of that frame in the arm's base frame [m]
    shown : called with a `LiveStatus` for each new image, in the thread of imaging
    window, tolerance : as for `GrowingImage`

    Raises
    ------
    InputError, UnknownNameError
        An argument is invalid.
    """

    def __init__(
        self,
        writer: ScanWriter,
        grids: Mapping[str, VoxelGrid],
        *,
        origin: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        shown: Callable[[LiveStatus], None] | None = None,
        window: str | None = None,
        tolerance: float | None = None,
    ):
        if not grids:
            raise InputError("grids is empty; expected the voxel grid of at least one radar")
        self.path: Path = writer.path
        self.trouble: str | None = None
        self._writer, self._shown = writer, shown or (lambda status: None)
        self._images = {name: GrowingImage(grid, window=window, tolerance=tolerance) for name, grid in grids.items()}
        self._origin = np.asarray(origin, dtype=float)
        # The published layout is read without the arm's orientations.
        self._turned = not isinstance(writer, PublishedWriter)
        self._rows: queue.Queue[_Row | Trajectory | None] = queue.Queue()
        self._counts = dict.fromkeys(grids, 0)
        self.lags: dict[str, float] = {}

    def __repr__(self) -> str:
        return f"LiveImaging({', '.join(f'{name}: {count} rows' for name, count in self._counts.items())})"

    @property
    def rows_done(self) -> int:
        """Rows that an earlier scan of the same plan has left; they are not in the images."""
        return self._writer.rows_done

    @property
    def images(self) -> dict[str, SarImage]:
        """By the radar's name, the images so far."""
        return {name: growing.image for name, growing in self._images.items() if growing.poses}

    @contextmanager
    def recording(self, radars: Sequence[RadarDevice]) -> Iterator[None]:
        thread = threading.Thread(target=self._work, name="live imaging", daemon=True)
        with self._writer.recording(radars):
            thread.start()
            try:
                yield
            finally:
                self._rows.put(None)
                thread.join()

    def add_picture(self, frame: CameraFrame) -> None:
        self._writer.add_picture(frame)

    def add_row(self, radar: RadarDevice, recording: Recording) -> None:
        self._writer.add_row(radar, recording)
        if radar.name in self._images and self.trouble is None:
            self._rows.put(_Row(radar=radar, recording=recording, came=time.monotonic()))

    def end_row(self, log: Trajectory) -> None:
        self._writer.end_row(log)
        self._rows.put(log)

    def finish(self) -> None:
        self._writer.finish()

    def _work(self) -> None:
        """Image what comes, until there is nothing more."""
        waiting: list[_Row] = []
        log: Trajectory | None = None
        more = True
        while more:
            for item in self._all_there():
                if item is None:
                    more = False
                elif isinstance(item, Trajectory):
                    log = item if log is None else _continued(log, item)
                else:
                    waiting.append(item)
            # A row's last frames may lie beyond the log: they wait for its next entries.
            ready = [row for row in waiting if log is not None and row.end <= log.times[-1]] if more else waiting
            waiting = [row for row in waiting if row not in ready]
            for name in self._images if log is not None else ():
                self._add([row for row in ready if row.radar.name == name], log)

    def _all_there(self) -> "Iterator[_Row | Trajectory | None]":
        """What is in the queue, at least one thing."""
        yield self._rows.get()
        while not self._rows.empty():
            yield self._rows.get()

    def _add(self, rows: "Sequence[_Row]", log: Trajectory | None) -> None:
        """Rows of one radar to its image."""
        if not rows or log is None or self.trouble is not None:
            return
        device = rows[0].radar
        growing, before = self._images[device.name], self._counts[device.name]
        self._counts[device.name] += len(rows)
        if all(row.recording.lost.all() for row in rows):
            return
        placed = Trajectory(
            times=log.times,
            positions=log.positions - self._origin,
            orientations=log.orientations if self._turned else None,
        )
        read = tuple(row.as_scanned(before + number) for number, row in enumerate(rows, 1))
        try:
            scan = RawScan(radar=mounted(device), rows=read, log=placed)
            growing.add(scan.to_capture())
            status = LiveStatus(
                radar=device.name, image=growing.image, rows=self._counts[device.name], poses=growing.poses,
                lag=time.monotonic() - rows[-1].came, change=growing.change,
            )  # fmt: skip
            self.lags[device.name] = max(status.lag, self.lags.get(device.name, 0.0))
            self._shown(status)
        except (MillisightError, MemoryError, OSError) as error:
            self.trouble = str(error) or type(error).__name__


def _continued(log: Trajectory, later: Trajectory) -> Trajectory:
    """A log and what follows."""
    turns = [log.orientations, later.orientations]
    return Trajectory(
        times=np.concatenate([log.times, later.times]),
        positions=np.concatenate([log.positions, later.positions]),
        orientations=None if turns[0] is None or turns[1] is None else np.concatenate([turns[0], turns[1]]),
    )


@record
class _Row:
    """A row of one radar, and when it came."""

    radar: RadarDevice
    recording: Recording
    came: float

    @property
    def end(self) -> float:
        """When its last frame was taken [s]."""
        return float(self.recording.times[-1])

    def as_scanned(self, number: int) -> ScanRow:
        """Of each frame the first chirp, as when the scan is read."""
        samples = self.recording.samples[:, :1]
        return ScanRow(
            times=self.recording.times, read=lambda: samples, source=f"row {number}", missing=self.recording.lost
        )
