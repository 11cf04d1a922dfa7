"""The one recorder: it runs a scan with any rig's devices and writes it down in the published layout and in HDF5."""

import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from millisight.capture.trajectory import Trajectory
from millisight.errors import FileError, InputError
from millisight.files import checked_path, make_folder, printable
from millisight.io.hdf5 import save
from millisight.io.mito_files import write_published
from millisight.io.mito_layout import radar_folder, read_experiment, read_info, write_raw_experiment
from millisight.io.mito_names import INFO_NAME, place_of
from millisight.io.mito_record import RecordedRow
from millisight.io.mito_setup import BASE_ORIGIN
from millisight.rig.plan import ScanPlan
from millisight.rig.protocols import Arm, Camera, RadarDevice, Recording

CAPTURE_NAME, LOG_NAME = "recorded.capture.h5", "recorded.log.h5"
"""Our own files beside a radar's raw ones: frames at the logged poses, clocks taken to agree; and the arm's log."""

Progress = Callable[[int, int], None]


def record_scan(
    arm: Arm,
    radars: Sequence[RadarDevice],
    camera: Camera | None,
    plan: ScanPlan,
    out: str | os.PathLike[str],
    *,
    info: Mapping[str, Any],
    hdf5: bool = True,
    progress: Progress | None = None,
) -> Path:
    """Take the picture, sweep every row with all radars recording, and write it all down.

    Rows go to disk as they come. The experiment appears under its name when its raw files are whole, and not at all
    when something fails before.

    Parameters
    ----------
    arm, radars, camera : the devices; None: no picture
    plan : ScanPlan
    out : an experiment's folder in the published layout, `<id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/los` or
        `nlos` (`experiment_folder` makes the name); it must not be there yet
    info : for `experiment_info.json`: "aperture size", "rx offset", "background", and whatever else
    hdf5 : write captures of our own besides
    progress : called with (rows done, rows in all)

    Returns
    -------
    The experiment's folder.

    Raises
    ------
    InputError
        Two radars have one folder, or the experiment is there already.
    FileError
        It cannot be written.
    """
    folders = [radar.folder for radar in radars]
    if not radars or len(set(folders)) < len(folders):
        raise InputError(f"the radars' folders are {folders}; expected one radar, or one of each band")
    out = _checked_out(out, info)
    with _staging(out) as stage:
        if camera is not None and plan.photo is not None:
            arm.sweep(plan.photo, plan.photo)
            arm.wait()
            write_published(make_folder(stage / out.name / "unprocessed" / "camera") / "continuous.pkl", camera.shoot())
        spools = [_Spool(make_folder(stage / "rows" / radar.folder)) for radar in radars]
        for count, (start, end) in enumerate(plan.rows, 1):
            arm.sweep(start, start)
            arm.wait()
            for radar in radars:
                radar.start(plan.frames(radar.frame_period))
            arm.sweep(start, end)
            arm.wait()
            for radar, spool in zip(radars, spools, strict=True):
                spool.add(radar.stop())
            if progress is not None:
                progress(count, len(plan.rows))
        log = arm.log()
        for radar, spool in zip(radars, spools, strict=True):
            mounted = Trajectory(times=log.times, positions=_world(log.positions, radar), orientations=log.orientations)
            write_raw_experiment(stage / out.name, radar.folder, spool, mounted, info=info)
        _publish(stage, out)
    if hdf5:
        for folder in folders:
            _write_hdf5(out, folder)
    return out


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
        return RecordedRow(number=number, created=created, frames=frames)

    def _path(self, index: int) -> Path:
        return self._folder / f"{index}.npy"


def _world(positions: np.ndarray, radar: RadarDevice) -> np.ndarray:
    """(n, 3) places of the radar's transmitter in the radar frame, from the arm's in the base frame [m]."""
    return positions - BASE_ORIGIN + radar.mount


def _checked_out(out: str | os.PathLike[str], info: Mapping[str, Any]) -> Path:
    """The experiment's folder, refused before the scan where it could not be written after it."""
    out = Path(os.path.abspath(checked_path(out)))
    place_of(out)
    if out.exists():
        raise InputError(f"{printable(out)} is there already; remove it, or record under another experiment's number")
    other = out.parent / INFO_NAME
    if other.exists() and read_info(other) != dict(info):
        raise InputError(
            f"{printable(other)} says {read_info(other)}; expected {dict(info)}: line of sight and not of one "
            "experiment are set up alike, record under another number"
        )
    make_folder(out.parent)
    return out


@contextmanager
def _staging(out: Path) -> Iterator[Path]:
    """A folder beside the experiment's for what is not whole yet, gone in the end."""
    stage = make_folder(out.parent.with_name(f".{out.parent.name}.{secrets.token_hex(4)}.part"))
    try:
        yield stage
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"cannot write {printable(out)}: {error.strerror or error}; nothing was recorded") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _publish(stage: Path, out: Path) -> None:
    """What is whole, to its place."""
    os.replace(stage / INFO_NAME, out.parent / INFO_NAME)
    os.replace(stage / out.name, out)


def _write_hdf5(out: Path, folder: str) -> None:
    raw = radar_folder(out, folder, processed=False)
    scan = read_experiment(out, folder)
    save(raw / CAPTURE_NAME, scan.to_capture(), reproducible=True)
    save(raw / LOG_NAME, scan.log, reproducible=True)
