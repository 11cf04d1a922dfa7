"""The robot's log of the published layout, `antenna*.npz`: poses in the robot's base frame, by the robot's clock."""

import os
from pathlib import Path

import numpy as np

from millisight.core import checked_path, printable
from millisight.core.errors import DamagedFileError, FileError, UnknownNameError
from millisight.data import Trajectory
from millisight.io.arrays import array_shapes, read_arrays
from millisight.io.mito._files import Published
from millisight.io.mito._names import checked_radar, radar_folder
from millisight.io.mito._setup import BASE_ORIGIN

_FARTHEST = 100.0  # that a robot reaches [m]; beyond, the log is not in metres
# Where times and places differ in number, so many poses are dropped for each table of the file, as published.
_CUT = 20


class Remarks:
    """What was found to be wrong and what to be odd, as the files are read."""

    def __init__(self) -> None:
        self.left_out: list[str] = []
        self.notes: list[str] = []


def read_log(folder: str | os.PathLike[str], radar: str) -> Published:
    """The robot's log of one radar, `antenna*.npz`, in the world frame; with its `orientations`, (P, 4), as extras.

    A published capture does without orientations; they tell how the tool was held.

    Parameters
    ----------
    folder : `.../exp<N>/los` or `nlos`, or the radar's `unprocessed/radars/<radar>` in it
    radar : "77_ghz" or "24_ghz"

    Raises
    ------
    FileError, FormatError, DamagedFileError
        It is missing or damaged.
    UnknownNameError
    """
    absolute = Path(os.path.abspath(checked_path(folder)))
    given = absolute.name == checked_radar(radar) and absolute.parent.name == "radars"
    return log_of(absolute if given else radar_folder(absolute, radar, processed=False), radar, Remarks())


def files_in(folder: Path, start: str, suffix: str) -> list[Path]:
    """Files of a folder by how their names begin and end, sorted."""
    return sorted(p for p in folder.iterdir() if p.name.startswith(start) and p.suffix == suffix and p.is_file())


def log_of(raw: Path, radar: str, remarks: Remarks) -> Published:
    """The robot's log, all files of it one after the other, in the world frame; and its orientations."""
    if not raw.is_dir():
        raise FileError(f"{printable(raw)}: no such folder; expected one with the robot's log, antenna*.npz")
    parts = [(path, _log_part(path, radar, remarks)) for path in files_in(raw, "antenna", ".npz")]
    if not sum(len(part) for _, part in parts):
        raise FileError(f"{printable(raw)} holds no robot log; expected antenna*.npz with its poses")
    width = min(part.shape[1] for _, part in parts)
    table = np.concatenate([part[:, :width] for _, part in parts])
    places = [(path, i) for path, part in parts for i in range(len(part))]
    repeated = np.flatnonzero((np.diff(table[:, :4], axis=0) == 0).all(axis=1)) + 1
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
    extras = {"orientations": table[kept, 4:]} if table.shape[1] == 8 else {}
    return Published(Trajectory(times=table[kept, 0], positions=table[kept, 1:4] - BASE_ORIGIN), extras)


def _log_part(path: Path, radar: str, remarks: Remarks) -> np.ndarray:
    """(n, 8) times [s], places [m, robot base] and quaternions of one file of the log; (n, 4) where it has none."""
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
        count = max(0, min(count, len(locations)) - _CUT * len(array_shapes(path)))
        remarks.notes.append(f"{path.name}: {len(times)} times, {len(locations)} places; the first {count} are used")
    width = 7 if locations.shape[1] == 7 else 3
    part = np.column_stack([times[:count], locations[:count, :width]]).astype(np.float64)
    farthest = np.abs(part[:, 1:4]).max(initial=0)
    if farthest > _FARTHEST:
        raise DamagedFileError(f"{printable(path)}: {names[1]} reaches {farthest:.4g}; expected positions in metres")
    return part
