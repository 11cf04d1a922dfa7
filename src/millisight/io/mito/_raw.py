"""Raw captures of the published layout: a folder of one radar's files, the robot's log, and what ties them together.

A file holds one row of the aperture. Which file is which row, and when it began, the row list says (`continuous*.pkl`);
where the radar was, the robot's log (`antenna*.npz`), in the robot's base frame and on the same clock as the row list.
A row that cannot be used is left out and named; what is only odd is noted.
"""

import os
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from millisight.core import checked_path, printable, with_step
from millisight.core.errors import DamagedFileError, FileError
from millisight.data import Radar, RawScan, ScanRow, Trajectory, inside_log
from millisight.io.arrays import read_pickle
from millisight.io.mito._log import Remarks, files_in, log_of
from millisight.io.mito._names import INFO_NAME, checked_radar, origin, radar_folder
from millisight.io.mito._setup import (
    CHIRPS,
    SUFFIXES,
    experiment_radar,
    frame_period,
    published_box,
    read_info,
)
from millisight.io.raw import (
    UNKNOWN,
    OrderEstimate,
    RawFrames,
    find_gaps,
    frames_touched,
    identify_order,
    open_counts,
    read_dca1000,
    read_position2go,
    swap_for_positive_ranges,
)

# Where in a file's name its number stands: the first of these that is one.
_NUMBERS = {"77_ghz": (slice(8, 18), slice(9, 21)), "24_ghz": (slice(9, 19),)}
_PUBLISHED_ORDER = ("four-lane", False)
_LATEST = 1e11  # seconds since 1970; much later, and a float tells no frames apart


def read_experiment(
    folder: str | os.PathLike[str],
    radar: str,
    *,
    every_receiver: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> RawScan:
    """Read the raw capture of one radar in an experiment of the published layout.

    The world frame is that of the published images: the radar's frame at the start, the robot's base frame shifted by
    `BASE_ORIGIN`. The log's orientations are not used: receivers lie along the world axis that `experiment_info.json`
    names, as in the published imaging. Of each frame the first chirp is taken, and conjugated at the door.

    Every file is looked at once here, for its frames, gaps and sample order; the frames are read when they are asked
    for. The metadata say which rows are left out and why (`left_out`), what is odd (`notes`), and the grid of the
    published images (`image_grid`).

    Parameters
    ----------
    folder : `.../exp<N>/los` or `nlos`, or the radar's `unprocessed/radars/<radar>` in it
    radar : "77_ghz" or "24_ghz"
    every_receiver : use both receivers at 24 GHz whatever the aperture, as the published code does on a GPU
    progress : called with (files looked at, files in all)

    Raises
    ------
    FileError, FormatError, DamagedFileError
        Raw files, robot log, row list or `experiment_info.json` are missing or damaged, or no row can be used.
    UnknownNameError
        There is no such radar.
    """
    raw = _raw_folder(checked_path(folder), radar)
    info = read_info(raw.parents[3] / INFO_NAME)
    used = experiment_radar(radar, info, every_receiver=every_receiver)
    remarks = Remarks()
    log = log_of(raw, radar, remarks).record
    rows = _read_rows(raw, radar, used, frame_period(info, radar), remarks, progress)
    outside = sum(int((~inside_log(row.times, log)).sum()) for row in rows)
    if outside:
        frames = sum(len(row.times) for row in rows)
        remarks.notes.append(f"{outside} of {frames} frames lie outside the robot's log, where nothing is extrapolated")
    metadata = {
        "source": origin(raw),
        "experiment": info,
        "left_out": remarks.left_out,
        "notes": remarks.notes,
        "image_grid": published_box(radar, info["background"], farthest=_farthest(log, rows)),
    }
    settings = {"chirp": f"first of {CHIRPS[radar]}", "conjugated": True, "orientations": "not used"}
    return RawScan(radar=used, rows=rows, log=log, metadata=with_step(metadata, "read_experiment", **settings))


def _farthest(log: Trajectory, rows: tuple[ScanRow, ...]) -> float:
    """Largest x of the log while frames were taken [m]."""
    times = np.concatenate([row.times for row in rows])
    scanned = (log.times >= times.min()) & (log.times <= times.max())
    return float(log.positions[scanned if scanned.any() else slice(None), 0].max())


class _Listed(NamedTuple):
    """A row that the row list names: the number in its file's name, and when its first frame was taken [s]."""

    number: int
    created: float


def _raw_folder(folder: Path, radar: str) -> Path:
    """The folder of the radar's raw files."""
    absolute = Path(os.path.abspath(folder))
    given = absolute.name == checked_radar(radar) and absolute.parent.name == "radars"
    raw = absolute if given else radar_folder(absolute, radar, processed=False)
    if not (raw / "radar_data").is_dir():
        raise FileError(
            f"{printable(folder)} holds no raw files of the {radar} radar; expected a folder exp<N>/los or nlos with "
            f"unprocessed/radars/{radar}/radar_data in it"
        )
    return raw


def _read_list(raw: Path, remarks: Remarks) -> list[_Listed]:
    """The rows that the row list names, in the order of their times."""
    found: dict[int, float] = {}
    files = files_in(raw, "continuous", ".pkl")
    for path in files:
        content = read_pickle(path)
        numbers, created = (_sequence(path, content, key) for key in ("all_radar_filenames", "all_radar_created_ts"))
        if len(numbers) != len(created):
            raise DamagedFileError(
                f"{printable(path)}: all_radar_filenames has {len(numbers)} entries, all_radar_created_ts "
                f"{len(created)}; expected as many"
            )
        for i, (number, time) in enumerate(zip(numbers, created, strict=True)):
            listed = _listed(number, time)
            if listed is None:
                remarks.left_out.append(
                    f"{path.name}, entry {i}: file {number!r} at {time!r} is not a number and a time"
                )
            elif listed.number in found:
                remarks.left_out.append(f"{path.name}, entry {i}: file {listed.number} is listed twice")
            elif listed.created != -1:  # which says that there is none
                found[listed.number] = listed.created
    if not files:
        raise FileError(f"{printable(raw)} holds no list of rows; expected continuous*.pkl")
    return sorted((_Listed(*item) for item in found.items()), key=lambda listed: listed.created)


def _sequence(path: Path, content: Any, key: str) -> list[Any]:
    value = content.get(key) if isinstance(content, dict) else None
    if isinstance(value, np.ndarray) and value.ndim == 1:
        value = value.tolist()
    if not isinstance(value, list | tuple):
        raise DamagedFileError(f"{printable(path)} has no list {key!r}; expected it in a list of rows")
    return list(value)


def _listed(number: Any, time: Any) -> _Listed | None:
    try:
        listed = _Listed(int(number), float(time))
    except (TypeError, ValueError, OverflowError):
        return None
    return listed if abs(listed.created) < _LATEST else None


def _raw_files(raw: Path, radar: str, remarks: Remarks) -> dict[int, Path]:
    """The raw files by the number in their names."""
    found: dict[int, Path] = {}
    for path in sorted((raw / "radar_data").iterdir()):
        number = _number(path.name, radar)
        if path.suffix != SUFFIXES[radar] or number is None or not path.is_file():
            remarks.notes.append(f"radar_data/{printable(path.name)} is not a raw file of this radar")
        elif number in found:
            remarks.notes.append(f"radar_data/{printable(path.name)} has the number of {found[number].name}")
        else:
            found[number] = path
    return found


def _number(name: str, radar: str) -> int | None:
    for place in _NUMBERS[radar]:
        if name[place].isascii() and name[place].isdigit():
            return int(name[place])
    return None


def _read_rows(
    raw: Path,
    radar: str,
    used: Radar,
    period: float,
    remarks: Remarks,
    progress: Callable[[int, int], None] | None,
) -> tuple[ScanRow, ...]:
    """The rows that are listed and there, each file looked at once."""
    files = _raw_files(raw, radar, remarks)
    listed = _read_list(raw, remarks)
    there = [row for row in listed if row.number in files]
    remarks.left_out += [f"row {row.number} is listed, but its file is missing" for row in listed if row not in there]
    numbers = {row.number for row in listed}
    remarks.notes += [f"{path.name} exists, but is not listed" for n, path in files.items() if n not in numbers]
    recorder = _Dca1000() if radar == "77_ghz" else _Position2Go()
    rows = []
    for count, row in enumerate(there, 1):
        path = files[row.number]
        try:
            lost = recorder.look(path, remarks)
        except FileError as error:
            remarks.left_out.append(str(error) if path.name in str(error) else f"{path.name}: {error}")
        else:
            if lost.any():
                count_lost = int(lost.sum())
                remarks.left_out.append(f"{path.name}: {count_lost} of {len(lost)} frames lost, wholly or in part")
            times = row.created + period * np.arange(len(lost))
            read = partial(_frames, recorder, path, len(used.array.rx_positions))
            rows.append(ScanRow(times=times, read=read, source=path.name, missing=lost))
        if progress is not None:
            progress(count, len(there))
    if not rows:
        why = f", such as: {remarks.left_out[0]}" if remarks.left_out else ""
        raise DamagedFileError(f"{printable(raw)}: no row can be used{why}")
    remarks.notes += recorder.notes()
    return tuple(rows)


def _frames(recorder: "_Recorder", path: Path, receivers: int) -> np.ndarray:
    """(F, 1, R, N) complex64 frames of a file, the phase sign ours."""
    return np.conj(recorder.read(path).samples[:, :1, :receivers])


class _Recorder(Protocol):
    """What knows the files of one radar's recorder."""

    def look(self, path: Path, remarks: Remarks) -> np.ndarray:
        """(F,) bool, the frames that are lost; `FileError` where the file cannot be used."""
        ...

    def read(self, path: Path) -> RawFrames: ...

    def notes(self) -> list[str]:
        """What is odd about the files that were looked at."""
        ...


class _Dca1000:
    """77 GHz: the sample order of every file is found out; the one in use is not always the published one."""

    _SAMPLES, _RECEIVERS = 512, 4
    _FRAME_BYTES = 4 * _SAMPLES * _RECEIVERS

    def __init__(self) -> None:
        self._estimates: dict[Path, OrderEstimate] = {}

    def look(self, path: Path, remarks: Remarks) -> np.ndarray:
        counts = open_counts(path, odd_byte=True)
        frames, over = divmod(counts.nbytes + path.stat().st_size % 2, self._FRAME_BYTES)
        if not frames:
            raise DamagedFileError(f"{over} bytes, less than one frame of {self._FRAME_BYTES}")
        if over:
            remarks.left_out.append(
                f"{path.name}: ends within frame {frames}, after {over} of {self._FRAME_BYTES} bytes"
            )
        self._estimates[path] = identify_order(counts, receivers=self._RECEIVERS, samples=self._SAMPLES)
        return frames_touched(find_gaps(counts), frame_bytes=self._FRAME_BYTES, frames=frames)

    def read(self, path: Path) -> RawFrames:
        order, swap = self._order_of(path)
        return read_dca1000(
            path, samples=self._SAMPLES, receivers=self._RECEIVERS, order=order, sample_swap=swap, truncated="drop"
        )

    def _order_of(self, path: Path) -> tuple[str, bool]:
        """Order and whether Q stands first; of a file that does not tell, as of most that do, or as published."""
        told = {p: (e.order, swap_for_positive_ranges(e)) for p, e in self._estimates.items() if e.order != UNKNOWN}
        usual = Counter(told.values()).most_common(1)
        return told.get(path, usual[0][0] if usual else _PUBLISHED_ORDER)

    def notes(self) -> list[str]:
        notes = []
        unknown = [path for path, estimate in self._estimates.items() if estimate.order == UNKNOWN]
        if unknown:
            order, _ = self._order_of(unknown[0])
            notes.append(f"{_some(unknown)}: the sample order cannot be determined; assumed {order}")
        others: dict[tuple[str, bool], list[Path]] = {}
        for path in self._estimates:
            order = self._order_of(path)
            if order != _PUBLISHED_ORDER and path not in unknown:
                others.setdefault(order, []).append(path)
        for (order, swapped), paths in others.items():
            swap = ", Q before I" if swapped else ""
            notes.append(
                f"{_some(paths)}: the sample order is {order}{swap}; published files are four-lane, I before Q"
            )
        return notes


class _Position2Go:
    """24 GHz: text. Frames of zeros at the end, with which a short file is filled for the published code, are none."""

    def __init__(self) -> None:
        self._filled: dict[Path, int] = {}
        self._looked_at: dict[Path, RawFrames] = {}

    def look(self, path: Path, remarks: Remarks) -> np.ndarray:
        raw = read_position2go(path, samples=256, chirps=CHIRPS["24_ghz"], receivers=2)
        if not raw.samples.any():
            raise DamagedFileError("every frame is 0")
        kept = _without_empty_end(raw)
        if len(kept.samples) < len(raw.samples):
            self._filled[path] = len(raw.samples) - len(kept.samples)
        # Text takes long to read: the chirp that is used is kept until it is asked for.
        self._looked_at[path] = RawFrames(samples=kept.samples[:, :1].copy(), lost=kept.lost, metadata=kept.metadata)
        return kept.lost

    def read(self, path: Path) -> RawFrames:
        if path in self._looked_at:
            return self._looked_at.pop(path)
        return _without_empty_end(read_position2go(path, samples=256, chirps=CHIRPS["24_ghz"], receivers=2))

    def notes(self) -> list[str]:
        if not self._filled:
            return []
        empty = sum(self._filled.values())
        return [f"{_some(list(self._filled))}: filled with empty frames at the end, {empty} in all, which are left out"]


def _without_empty_end(raw: RawFrames) -> RawFrames:
    seen = np.flatnonzero(raw.samples.any(axis=(1, 2, 3)))
    kept = int(seen[-1]) + 1 if len(seen) else 0
    return RawFrames(samples=raw.samples[:kept], lost=raw.lost[:kept], metadata=raw.metadata) if kept else raw


def _some(paths: list[Path]) -> str:
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    return f"{paths[0].name}{more}"
