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
from millisight.core.errors import DamagedFileError, FileError, UnknownNameError
from millisight.data import Radar, RawScan, ScanRow, Trajectory, inside_log
from millisight.io.arrays import read_arrays, read_pickle
from millisight.io.mito._names import INFO_NAME, checked_radar, origin, radar_folder
from millisight.io.mito._setup import (
    BASE_ORIGIN,
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
_FARTHEST = 100.0  # that a robot reaches [m]; beyond, the log is not in metres
_CUT = 20  # where times and places differ in number, so many poses fewer than the shorter are taken, as published


def read_experiment(
    folder: str | os.PathLike[str], radar: str, *, progress: Callable[[int, int], None] | None = None
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
    used = experiment_radar(radar, info)
    remarks = _Remarks()
    log = _read_log(raw, radar, remarks)
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
        "image_grid": published_box(radar, info["background"]),
    }
    settings = {"chirp": f"first of {CHIRPS[radar]}", "conjugated": True, "orientations": "not used"}
    return RawScan(radar=used, rows=rows, log=log, metadata=with_step(metadata, "read_experiment", **settings))


class _Remarks:
    """What was found to be wrong and what to be odd, as the files are read."""

    def __init__(self) -> None:
        self.left_out: list[str] = []
        self.notes: list[str] = []


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


def _files(folder: Path, start: str, suffix: str) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.name.startswith(start) and p.suffix == suffix and p.is_file())


def _read_log(raw: Path, radar: str, remarks: _Remarks) -> Trajectory:
    """The robot's log, all files of it one after the other, in the world frame."""
    parts = [(path, _log_part(path, radar, remarks)) for path in _files(raw, "antenna", ".npz")]
    if not sum(len(part) for _, part in parts):
        raise FileError(f"{printable(raw)} holds no robot log; expected antenna*.npz with its poses")
    table = np.concatenate([part for _, part in parts])
    places = [(path, i) for path, part in parts for i in range(len(part))]
    repeated = np.flatnonzero((np.diff(table, axis=0) == 0).all(axis=1)) + 1
    if len(repeated):
        remarks.notes.append(f"robot log: {len(repeated)} poses occur twice, with the same time and position")
    kept = np.setdiff1d(np.arange(len(table)), repeated)
    wrong = np.flatnonzero(np.diff(table[kept, 0]) <= 0)
    if len(wrong):
        before, after = kept[wrong[0]], kept[wrong[0] + 1]
        path, entry = places[after]
        raise DamagedFileError(
            f"{printable(path)}, times_{radar[:2]}[{entry}]: {table[after, 0]:.6f} s follows {table[before, 0]:.6f} s; "
            "expected times that increase"
        )
    if len(kept) < 2:
        raise DamagedFileError(f"{printable(raw)}: the robot log has a single pose; expected two at least")
    return Trajectory(times=table[kept, 0], positions=table[kept, 1:] - BASE_ORIGIN)


def _log_part(path: Path, radar: str, remarks: _Remarks) -> np.ndarray:
    """(n, 4) times [s] and places [m, robot base] of one file of the log."""
    names = f"times_{radar[:2]}", f"tx_{radar[:2]}_locs"
    try:
        times, locations = read_arrays(path, names=names).values()
    except UnknownNameError as error:
        raise DamagedFileError(f"{printable(path)}: {error}") from error
    numbers = all(array.dtype.kind in "iuf" for array in (times, locations))
    if not numbers or times.ndim != 1 or locations.ndim != 2 or locations.shape[1] < 3:
        what = ", ".join(f"{name} is {a.dtype} {a.shape}" for name, a in zip(names, (times, locations), strict=True))
        raise DamagedFileError(f"{printable(path)}: {what}; expected numbers (n,) and (n, 7): x, y, z, quaternion")
    count = len(times)
    if count != len(locations):
        count = max(0, min(count, len(locations)) - _CUT)
        remarks.notes.append(f"{path.name}: {len(times)} times, {len(locations)} places; the first {count} are used")
    part = np.column_stack([times[:count], locations[:count, :3]]).astype(np.float64)
    farthest = np.abs(part[:, 1:]).max(initial=0)
    if farthest > _FARTHEST:
        raise DamagedFileError(f"{printable(path)}: {names[1]} reaches {farthest:.4g}; expected positions in metres")
    return part


def _read_list(raw: Path, remarks: _Remarks) -> list[_Listed]:
    """The rows that the row list names, in the order of their times."""
    found: dict[int, float] = {}
    files = _files(raw, "continuous", ".pkl")
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


def _raw_files(raw: Path, radar: str, remarks: _Remarks) -> dict[int, Path]:
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
    remarks: _Remarks,
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

    def look(self, path: Path, remarks: _Remarks) -> np.ndarray:
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

    def look(self, path: Path, remarks: _Remarks) -> np.ndarray:
        counts = open_counts(path, odd_byte=True)
        frames, over = divmod(path.stat().st_size, self._FRAME_BYTES)
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
    """24 GHz: text."""

    def look(self, path: Path, remarks: _Remarks) -> np.ndarray:
        return self.read(path).lost

    def read(self, path: Path) -> RawFrames:
        return read_position2go(path, samples=256, chirps=CHIRPS["24_ghz"], receivers=2)

    def notes(self) -> list[str]:
        return []


def _some(paths: list[Path]) -> str:
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    return f"{paths[0].name}{more}"
