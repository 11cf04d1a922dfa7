"""Scans written in the published layout and in HDF5."""

import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import alone, checked_path, make_folder, printable
from millisight.core.errors import FileError, InputError
from millisight.data import CameraFrame, Trajectory
from millisight.io import mito, save
from millisight.rig._protocols import RadarDevice, Recording

CAPTURE_NAME, LOG_NAME = "recorded.capture.h5", "recorded.log.h5"
"""Our own files beside a radar's raw ones: frames at the logged poses, clocks taken to agree; and the arm's log."""


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
        last: Callable[[], object] | None = None,
    ):
        self.path: Path = Path(os.path.abspath(checked_path(out)))
        self._info, self._hdf5, self._fill, self._last = info, hdf5, fill, last
        self._spools: dict[str, _Spool] = {}
        self._radars: Sequence[RadarDevice] = ()

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
        self._part = make_folder(out.parent.with_name(f".{out.parent.name}.{secrets.token_hex(4)}.part"))
        # The names above it, too: provenance tells them.
        self._stage = self._part.joinpath(*out.parts[-5:])
        try:
            self._spools = {radar.name: _Spool(make_folder(self._part / "rows" / radar.name)) for radar in radars}
            yield
        except FileError:
            raise
        except OSError as error:
            why = error.strerror or error
            raise FileError(f"cannot write {printable(out)}: {why}; nothing was recorded") from error
        finally:
            shutil.rmtree(self._part, ignore_errors=True)

    def add_picture(self, frame: CameraFrame) -> None:
        folder = make_folder(self._stage / "unprocessed" / "camera")
        mito.write_published(folder / "continuous.pkl", frame)

    def add_row(self, radar: RadarDevice, recording: Recording) -> None:
        self._spools[radar.name].add(recording)

    def finish(self, log: Trajectory) -> None:
        for radar in self._radars:
            # From the arm's base frame to the radar's transmitter in the radar frame.
            positions = log.positions - mito.BASE_ORIGIN + radar.mount
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


class _Spool(Sequence):
    """Rows on disk until they are all there; what is asked for is mapped, not read."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._rows: list[tuple[int, float]] = []

    def add(self, recording: Recording) -> None:
        # The number in a published file's name is its time in seconds.
        number = int(recording.first_time)
        if self._rows:
            number = max(number, self._rows[-1][0] + 1)
        np.save(self._path(len(self._rows)), recording.samples)
        self._rows.append((number, recording.first_time))

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: Any) -> Any:
        number, created = self._rows[index]
        frames = np.load(self._path(index % len(self)), mmap_mode="r")
        return mito.RecordedRow(number=number, created=created, frames=frames)

    def _path(self, index: int) -> Path:
        return self._folder / f"{index}.npy"
