"""Scans written in the published layout and in HDF5."""

import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import alone, atomic_path, checked_numbers, checked_path, make_folder, printable, write_text
from millisight.core.errors import DamagedFileError, FileError, InputError
from millisight.data import CameraFrame, Trajectory
from millisight.io import mito, save
from millisight.rig._protocols import RadarDevice, Recording
from millisight.rig._recorder import ScanPlan

CAPTURE_NAME, LOG_NAME = "recorded.capture.h5", "recorded.log.h5"
"""Our own files beside a radar's raw ones: frames at the logged poses, clocks taken to agree; and the arm's log."""

_PLAN, _ROWS = "scan.json", "rows.json"  # of an unfinished scan


def scan_info(radars: Iterable[Any], background: str) -> dict[str, Any]:
    """What `experiment_info.json` says of a scan by these radars.

    "aperture size" stands for the published pace of the frames and, at 24 GHz, for both receivers; "frame period" [s]
    says what the pace is where it is neither.

    Parameters
    ----------
    radars : of the published layout: what has a `name`, a `frame_period` and a `radar`, as a `RadarDevice`
    background : what the object stands on, such as "tripod"

    Raises
    ------
    UnknownNameError
        A radar is none of the layout's.
    """
    used = {mito.checked_radar(radar.name): radar for radar in radars}
    periods = {name: radar.frame_period for name, radar in used.items()}
    normal = all(period == mito.FRAME_PERIODS[name, "normal"] for name, period in periods.items())
    size = "normal" if normal and "77_ghz" in periods else "almost-square"
    axis = "x"
    if "77_ghz" in used:
        spread = np.ptp(used["77_ghz"].radar.array.rx_positions, axis=0)
        axis = "y" if spread[1] > spread[0] else "x"
    info = {"aperture size": size, "rx offset": axis, "background": background}
    other = {name: period for name, period in periods.items() if period != mito.FRAME_PERIODS[name, size]}
    return info | ({"frame period": other} if other else {})


class PublishedWriter:
    """Writes a scan as an experiment of the published layout: a `ScanWriter`.

    Rows go to disk as they come. The experiment appears under its name when all its files are whole, and not at all
    when something fails before. One run at a time writes an experiment.

    Parameters
    ----------
    out : the experiment's folder `<id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/los` or `nlos`
        (`experiment_folder` makes the name); it must not be there yet
    info : for `experiment_info.json`: "aperture size", "rx offset", "background", and whatever else
    hdf5 : write captures of our own besides
    fill : see `write_raw_experiment`
    origin : (3,) of the frame that images are in, in the arm's base frame [m]
    keep : the plan of the scan. What was recorded stays when the scan fails, in a hidden folder beside the
        experiment's, and another writer of the same plan goes on with it; None: nothing stays
    last : called when all is written and before the experiment appears: for what has to be there, too

    The radars' names must be those of the layout, "77_ghz" and "24_ghz".
    """

    def __init__(
        self,
        out: str | os.PathLike[str],
        *,
        info: Mapping[str, Any],
        hdf5: bool = True,
        fill: bool = True,
        origin: tuple[float, float, float] = mito.BASE_ORIGIN,
        keep: ScanPlan | None = None,
        last: Callable[[], object] | None = None,
    ):
        self.path: Path = Path(os.path.abspath(checked_path(out)))
        self.rows_done: int = 0
        self._info, self._hdf5, self._fill, self._keep, self._last = info, hdf5, fill, keep, last
        self._origin = np.array(checked_numbers(origin, name="origin", count=3, unit="m"))
        self._spools: dict[str, _Spool] = {}
        self._radars: Sequence[RadarDevice] = ()

    @property
    def unfinished(self) -> Path:
        """Where a scan that failed is kept, if `keep` was given."""
        experiment = self.path.parent
        return experiment.with_name(f".{experiment.name}.{self.path.name}.unfinished")

    @contextmanager
    def recording(self, radars: Sequence[RadarDevice]) -> Iterator[None]:
        """Keep what is not whole yet in a folder beside the experiment's, gone in the end.

        Raises
        ------
        UnknownNameError
            A radar is none of the layout's.
        InputError
            The experiment is there already, or another of its number is set up differently.
        FileError
            The folder's name is none of the layout's, or something cannot be written.
        """
        self._radars = [radar for radar in radars if mito.checked_radar(radar.name)]
        self._check()
        out = self.path
        with alone(out.parent, printable(out.parent)):
            self._check()  # again: the run before may have ended just now
            for remains in out.parent.parent.glob(f".{out.parent.name}.*.part"):  # of a run that was killed
                shutil.rmtree(remains, ignore_errors=True)
            yield from self._recording(radars, out)

    def _recording(self, radars: Sequence[RadarDevice], out: Path) -> Iterator[None]:
        names = [radar.name for radar in radars]
        if self._keep is None:
            self._part = make_folder(out.parent.with_name(f".{out.parent.name}.{secrets.token_hex(4)}.part"))
        else:
            self._part = self._claim(self._keep, {radar.name: radar.frame_period for radar in radars})
        # The names above it, too: provenance tells them.
        self._stage = self._part.joinpath(*out.parts[-5:])
        try:
            done = _rows_listed(self._part)
            self.rows_done = len(done)
            self._spools = {
                name: _Spool(make_folder(self._part / "rows" / name), [row[name] for row in done]) for name in names
            }
            make_folder(self._part / "log")
            yield
        except FileError:
            raise
        except OSError as error:
            why = error.strerror or error
            left = "the row was not recorded" if self._keep else "nothing was recorded"
            raise FileError(f"cannot write {printable(out)}: {why}; {left}") from error
        finally:
            if self._keep is None:
                shutil.rmtree(self._part, ignore_errors=True)

    def add_picture(self, frame: CameraFrame) -> None:
        folder = make_folder(self._stage / "unprocessed" / "camera")
        pose = np.array(frame.pose)
        pose[:3, 3] += mito.BASE_ORIGIN - self._origin  # to the layout's base frame
        mito.write_published(folder / "continuous.pkl", replace(frame, pose=pose))

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
        self.rows_done += 1
        rows = zip(*(spool.rows for spool in self._spools.values()), strict=True)
        listed = [dict(zip(self._spools, row, strict=True)) for row in rows]
        write_text(self._part / _ROWS, json.dumps(listed))

    def finish(self) -> None:
        log = _joined([self._log_part(row) for row in range(self.rows_done)])
        for radar in self._radars:
            # From the arm's base frame to the radar's transmitter in the radar frame.
            positions = log.positions - self._origin + radar.mount
            mounted = Trajectory(times=log.times, positions=positions, orientations=log.orientations)
            mito.write_raw_experiment(
                self._stage,
                radar.name,
                self._spools[radar.name],
                mounted,
                info=self._info,
                fill=self._fill,
            )
        for radar in self._radars if self._hdf5 else ():
            raw = mito.radar_folder(self._stage, radar.name, processed=False)
            scan = mito.read_experiment(self._stage, radar.name)
            save(raw / CAPTURE_NAME, scan.to_capture(), reproducible=True)
            save(raw / LOG_NAME, scan.log, reproducible=True)
        if self._last is not None:
            self._last()
        # All of it is there: whoever is killed from here on leaves nothing to be done again.
        os.replace(self._stage.parent / mito.INFO_NAME, self.path.parent / mito.INFO_NAME)
        os.replace(self._stage, self.path)
        shutil.rmtree(self._part, ignore_errors=True)

    def _log_part(self, row: int) -> Path:
        return self._part / "log" / f"{row}.npz"

    def _claim(self, plan: ScanPlan, periods: dict[str, float]) -> Path:
        """The folder of the unfinished scan, which must be of this plan if there is one."""
        rows = [[list(map(float, pose.position)) for pose in row] for row in plan.rows]
        of = {"info": dict(self._info), "frame period": periods, "row time": plan.row_time, "rows": rows}
        folder = self.unfinished
        if (folder / _PLAN).exists() and _kept(folder / _PLAN) != of:
            raise InputError(
                f"{printable(folder)} holds an unfinished scan of another plan; remove it, or record under another "
                "number"
            )
        make_folder(folder)
        write_text(folder / _PLAN, json.dumps(of))
        return folder

    def _check(self) -> None:
        out = self.path
        mito.place_of(out)
        if out.exists():
            raise InputError(f"{printable(out)} already exists; remove it, or record under another number")
        other = out.parent / mito.INFO_NAME
        if other.exists() and mito.read_info(other) != dict(self._info):
            raise InputError(
                f"{printable(other)} says {mito.read_info(other)}; expected {dict(self._info)}: los and nlos of an "
                "experiment need the same set-up, record under another number"
            )
        make_folder(out.parent)


def _rows_listed(folder: Path) -> list[dict[str, tuple[int, float]]]:
    """Number and time of every row that is whole, by radar."""
    if not (folder / _ROWS).exists():
        return []
    try:
        return [
            {name: (int(number), float(time)) for name, (number, time) in row.items()} for row in _kept(folder / _ROWS)
        ]
    except (AttributeError, TypeError, ValueError) as error:
        raise DamagedFileError(f"{printable(folder / _ROWS)} is no list of rows: {error}; remove the folder") from error


def _kept(path: Path) -> Any:
    """What a file of an unfinished scan holds."""
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{printable(path)} is damaged: {error}; remove the folder it is in") from error


def _joined(parts: Sequence[Path]) -> Trajectory:
    """The log of all rows."""
    tables = []
    for part in parts:
        with np.load(part, allow_pickle=False) as table:
            tables.append({name: table[name] for name in table.files})
    return Trajectory(**{name: np.concatenate([table[name] for table in tables]) for name in tables[0]})


class _Spool(Sequence):
    """Rows on disk until they are all there; what is asked for is mapped, not read."""

    def __init__(self, folder: Path, rows: list[tuple[int, float]]):
        self._folder = folder
        self.rows = rows

    def add(self, recording: Recording) -> None:
        # The number in a published file's name is its time in seconds.
        number = int(recording.first_time)
        if self.rows:
            number = max(number, self.rows[-1][0] + 1)
        samples = recording.samples
        if recording.lost.any():
            # A file has no other mark: a frame of zeros is one that is not there, and half a frame is no measurement.
            samples = np.where(recording.lost[:, None, None, None], np.complex64(0), samples)
        np.save(self._path(len(self.rows)), samples)
        self.rows.append((number, recording.first_time))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        number, created = self.rows[index]
        frames = np.load(self._path(index % len(self)), mmap_mode="r")
        return mito.RecordedRow(number=number, created=created, frames=frames)

    def _path(self, index: int) -> Path:
        return self._folder / f"{index}.npy"
