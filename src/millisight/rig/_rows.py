"""Rows of a scan on disk as they come, until the scan is whole: what writers of scans share."""

import hashlib
import itertools
import json
import os
import secrets
import shutil
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import (
    alone,
    atomic_path,
    checked_numbers,
    checked_path,
    make_folder,
    printable,
    read_json,
    read_sealed,
    write_sealed,
    write_text,
)
from millisight.core.errors import DamagedFileError, FileError, InputError
from millisight.data import CameraFrame, Trajectory
from millisight.io import mito
from millisight.io.arrays import array_shapes, read_arrays
from millisight.rig._protocols import RadarDevice, Recording
from millisight.rig._recorder import ScanPlan

_PLAN, _ROWS = "scan.json", "rows.json"  # of an unfinished scan


class RowWriter(ABC):
    """Keeps the rows of a scan until all are there: what is left of a `ScanWriter` is its end.

    The scan appears under its name when all its files are whole, and not at all when something fails before.

    Parameters
    ----------
    out : what the scan becomes, a folder that is not there yet
    told : what else tells a scan of this plan from another
    origin : (3,) of the frame that images are in, in the arm's base frame [m]
    keep : the plan of the scan. What was recorded stays when the scan fails, in a hidden folder beside `out`, and
        another writer of the same plan goes on with it; None: nothing stays

    Attributes
    ----------
    path : as `out`
    rows_done : rows that are there
    """

    def __init__(
        self,
        out: str | os.PathLike[str],
        *,
        told: Mapping[str, Any],
        origin: tuple[float, float, float],
        keep: ScanPlan | None,
    ):
        self.path: Path = Path(os.path.abspath(checked_path(out)))
        self.rows_done: int = 0
        self._told, self._keep = dict(told), keep
        self._origin = np.array(checked_numbers(origin, name="origin", count=3, unit="m"))
        self._spools: dict[str, Spool] = {}
        self._logs: list[str] = []  # checksums of the rows' logs
        self._radars: Sequence[RadarDevice] = ()

    @property
    def unfinished(self) -> Path:
        """Where a scan that failed is kept, if `keep` was given."""
        return self.path.with_name(f".{self.path.name}.unfinished")

    def recording(self, radars: Sequence[RadarDevice]) -> AbstractContextManager[None]:
        """Keep what is not whole yet in a folder beside `out`, gone in the end.

        Raises
        ------
        InputError
            `out` is there already, or an unfinished scan is of another plan.
        FileError
            Something cannot be written.
        """
        return self._alone(radars)

    @contextmanager
    def _alone(self, radars: Sequence[RadarDevice]) -> Iterator[None]:
        self._radars = radars
        self._check()
        with alone(self.path.parent, printable(self.path.parent)):
            self._check()  # again: the run before may have ended just now
            self._remove_parts()
            yield from self._recording()

    def _recording(self) -> Iterator[None]:
        names = [radar.name for radar in self._radars]
        if self._keep is None:
            self._part = make_folder(self._temporary(secrets.token_hex(4)))
        else:
            self._part = self._claim(self._keep)
        try:
            done, self._logs = _rows_listed(self._part, names)
            self._spools = {name: Spool(make_folder(self._part / "rows" / name)) for name in names}
            kept = sum(itertools.takewhile(bool, (self._holds_log(row) for row in range(len(done)))))
            self.rows_done = _taken_over(self._spools, done[:kept])
            del self._logs[self.rows_done :]
            make_folder(self._part / "log")
            yield
        except FileError:
            raise
        except OSError as error:
            why = error.strerror or error
            left = "the row was not recorded" if self._keep else "nothing was recorded"
            raise FileError(f"cannot write {printable(self.path)}: {why}; {left}") from error
        finally:
            if self._keep is None:
                shutil.rmtree(self._part, ignore_errors=True)

    @abstractmethod
    def add_picture(self, frame: CameraFrame) -> None:
        """The camera's picture, before the first row."""

    @abstractmethod
    def finish(self) -> None:
        """All rows are there. The scan appears under its name."""

    def add_row(self, radar: RadarDevice, recording: Recording) -> None:
        self._spools[radar.name].add(recording)

    def end_row(self, log: Trajectory) -> None:
        if self.rows_done:  # an arm that took part in the earlier scan tells of it again
            later = log.times > _joined([self._log_part(self.rows_done - 1)]).times[-1]
            turned = None if log.orientations is None else log.orientations[later]
            log = Trajectory(times=log.times[later], positions=log.positions[later], orientations=turned)
        with atomic_path(self._log_part(self.rows_done)) as temporary, open(temporary, "wb") as file:
            tables = {"times": log.times, "positions": log.positions}
            if log.orientations is not None:
                tables["orientations"] = log.orientations
            np.savez(file, allow_pickle=False, **tables)
        self._logs.append(_sha256(self._log_part(self.rows_done)))
        self.rows_done += 1
        rows = zip(*(spool.listed for spool in self._spools.values()), strict=True)
        listed = [dict(zip(self._spools, row, strict=True)) for row in rows]
        write_sealed(self._part / _ROWS, {"rows": listed, "logs": self._logs})

    def clear(self) -> None:
        """Remove what a run left that was killed when its scan was there: its lock and its copies.

        Nothing is done while another run is at it.
        """
        with suppress(FileError), alone(self.path.parent, printable(self.path.parent)):
            self._remove_parts()
            shutil.rmtree(self.unfinished, ignore_errors=True)

    def _remove_parts(self) -> None:
        """Of runs that were killed; for who holds the lock."""
        pattern = self._temporary("*")
        for remains in pattern.parent.glob(pattern.name):
            shutil.rmtree(remains, ignore_errors=True)

    def _check(self) -> None:
        """Raise where the scan could not appear."""
        if self.path.exists():
            self.clear()
            raise InputError(f"{printable(self.path)} already exists; remove it, or record under another number")
        make_folder(self.path.parent)

    def _temporary(self, mark: str) -> Path:
        """A folder beside `out` for what is not to stay."""
        return self.path.with_name(f".{self.path.name}.{mark}.part")

    def _whole_log(self) -> Trajectory:
        """The log of all rows, in the arm's base frame."""
        return _joined([self._log_part(row) for row in range(self.rows_done)])

    def _holds_log(self, row: int) -> bool:
        """Whether the log of a row is there, byte for byte as it was written."""
        path = self._log_part(row)
        return path.is_file() and _sha256(path) == self._logs[row]

    def _log_part(self, row: int) -> Path:
        return self._part / "log" / f"{row}.npz"

    def _claim(self, plan: ScanPlan) -> Path:
        """The folder of the unfinished scan, which must be of this plan if there is one."""
        rows = [[list(map(float, pose.position)) for pose in row] for row in plan.rows]
        radars = {
            one.name: {"frame period": one.frame_period, "mount": np.asarray(one.mount), "radar": asdict(one.radar)}
            for one in self._radars
        }
        told = {"info": self._told, "radars": radars, "row time": plan.row_time, "rows": rows}
        of = json.loads(json.dumps(told, default=np.ndarray.tolist))
        folder = self.unfinished
        if (folder / _PLAN).exists() and _kept(folder / _PLAN) != of:
            raise InputError(
                f"{printable(folder)} holds an unfinished scan of another plan; remove it, or record under another "
                "number"
            )
        make_folder(folder)
        write_text(folder / _PLAN, json.dumps(of))
        return folder


_Told = tuple[int, float, str]
"""Number, time and checksum of a row."""


def _rows_listed(folder: Path, names: Sequence[str]) -> tuple[list[dict[str, _Told]], list[str]]:
    """Every row that is whole, by radar; and the checksums of their logs."""
    path = folder / _ROWS
    if not path.exists():
        return [], []
    try:
        told = _kept(path, read_sealed)
        listed = [{name: row[name] for name in names} for row in told["rows"]]
        rows = [
            {name: (int(number), float(time), str(sha256)) for name, (number, time, sha256) in row.items()}
            for row in listed
        ]
        logs = [str(sha256) for sha256 in told["logs"]]
        if len(logs) != len(rows):
            raise ValueError(f"{len(logs)} logs of {len(rows)} rows")
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise DamagedFileError(f"{printable(path)} is no list of rows: {error}; remove the folder") from error
    return rows, logs


def _taken_over(spools: "dict[str, Spool]", rows: list[dict[str, _Told]]) -> int:
    """How many rows are as they were written, from the first on. Spools take these; the others are scanned anew."""
    for done, row in enumerate(rows):
        if not all(spools[name].holds(done, told[2]) for name, told in row.items()):
            return done
        for name, told in row.items():
            spools[name].listed.append(told)
    return len(rows)


def _kept(path: Path, read: Callable[[Path], Any] = read_json) -> Any:
    """What a file of an unfinished scan holds."""
    try:
        return read(path)
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{printable(path)} is damaged: {error}; remove the folder it is in") from error


def _joined(parts: Sequence[Path]) -> Trajectory:
    """The log of all rows."""
    tables = [read_arrays(part, finite=False) for part in parts]
    try:
        return Trajectory(**{name: np.concatenate([table[name] for table in tables]) for name in tables[0]})
    except (InputError, LookupError, TypeError, ValueError) as error:
        place = printable(parts[0].parent)
        raise DamagedFileError(f"{place} is damaged: {error}; remove the folder it is in") from error


class Spool(Sequence):
    """Rows on disk until they are all there; each is read when it is asked for."""

    def __init__(self, folder: Path, listed: Sequence[tuple[int, float, str]] = ()):
        self._folder = folder
        self.listed: list[tuple[int, float, str]] = list(listed)  # number, time and checksum of each

    def holds(self, index: int, sha256: str) -> bool:
        """Whether the file of a row is there, byte for byte as it was written."""
        path = self._path(index)
        return path.is_file() and _sha256(path) == sha256

    def add(self, recording: Recording) -> None:
        # The number in a published file's name is its time in seconds.
        number = int(recording.first_time)
        if self.listed:
            number = max(number, self.listed[-1][0] + 1)
        samples = recording.samples
        if recording.lost.any():
            # A file has no other mark: a frame of zeros is one that is not there, and half a frame is no measurement.
            samples = np.where(recording.lost[:, None, None, None], np.complex64(0), samples)
        path = self._path(len(self))
        np.save(path, samples)
        self.listed.append((number, recording.first_time, _sha256(path)))

    def __len__(self) -> int:
        return len(self.listed)

    def __getitem__(self, index: Any) -> Any:
        number, created, _ = self.listed[index]
        path = self._path(index % len(self))
        array_shapes(path)  # what NumPy raises of some headers is none of the errors below
        try:
            with warnings.catch_warnings():  # of a header by Python 2, which is none of ours
                warnings.simplefilter("error", UserWarning)
                frames = np.load(path)  # not mapped: a file cut while it is mapped kills the process
        except (OSError, EOFError, ValueError, TypeError, SyntaxError, UserWarning) as error:
            raise DamagedFileError(f"{printable(path)} is damaged: {error}; remove the folder it is in") from error
        return mito.RecordedRow(number=number, created=created, frames=frames)

    def _path(self, index: int) -> Path:
        return self._folder / f"{index}.npy"


def _sha256(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
