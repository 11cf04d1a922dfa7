"""A robot's log: when it was where, turned how. Text with a line of names, or arrays; into a `Trajectory`."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from millisight.core import check_readable, checked_record, lengths_of, printable, write_text
from millisight.core.errors import DamagedFileError, FormatError, InputError, UnknownNameError
from millisight.data import Trajectory, check_log
from millisight.io.arrays import TextTable, read_arrays, read_table

COLUMNS = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
"""The columns of a log as text, in the order in which they stand where no line names them."""

_ARRAYS = (".npy", ".npz", ".mat", ".h5", ".hdf5")
_ALIASES = {"t": "time", "times": "time", "timestamp": "time", "seconds": "time", "time_s": "time"}
_TIMES = ("times", "time", "t", "timestamps", "timestamp")
_POSITIONS = ("positions", "poses", "locations", "position", "pose")
_ORIENTATIONS = ("orientations", "quaternions", "orientation")


def read_robot_log(
    path: str | os.PathLike[str],
    *,
    times: str | None = None,
    positions: str | None = None,
    orientations: str | None = None,
    scale: float = 1.0,
    columns: Sequence[int | str] | None = None,
    skip_rows: int = 0,
    rows: int | None = None,
    decimal: str | None = None,
) -> Trajectory:
    """Read the poses of a robot log, on its own clock.

    Text (CSV, or columns set apart by blanks) has the columns time, x, y, z and, if it says how the radar was turned,
    qx, qy, qz, qw; a line of names may give them in any order and among others. Arrays (.npz, .npy, .mat, HDF5) are
    times (n,) and positions (n, 3), or (n, 7) with the quaternion behind; or one array (n, 4) or (n, 8) with the time
    before. A line that repeats the one before, time and pose, is passed over: such logs are polled faster than they
    change.

    Parameters
    ----------
    times, positions, orientations : names of arrays where they are not the usual ones
    scale : metres a unit of length of the file
    columns : of a text, the 4 or 8 that are `COLUMNS`, numbers from 0 on or names; None: as the first line names them
    skip_rows, rows, decimal : of a text, as of `read_table`

    Returns
    -------
    Trajectory
        Times increase strictly.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        The file cannot be read, lacks a column, or an entry cannot be right: NaN, a time out of order, one time with
        two poses, a quaternion that is not of length one. The message names the line or the entry.
    UnknownNameError
        There is no array of that name.
    """
    path = check_readable(path)
    name = printable(path)
    if path.suffix.lower() in _ARRAYS:
        if columns is not None or skip_rows or rows is not None or decimal is not None:
            raise InputError(f"{name} is not a text file; leave out columns, skip_rows, rows and decimal")
        values, place = _from_arrays(path, times, positions, orientations), "entry"
    else:
        values, place = (
            _from_text(read_table(path, skip_rows=skip_rows, rows=rows, decimal=decimal), columns),
            "row of numbers",
        )
    values = _without_repeats(values)
    steps = np.diff(values[:, 0])
    if (steps <= 0).any():
        i = int(np.argmax(steps <= 0)) + 1
        what = "the same time with another pose" if steps[i - 1] == 0 else "an earlier time"
        raise DamagedFileError(
            f"{name}, {place} {i + 1}: {values[i, 0]:.6f} s follows {values[i - 1, 0]:.6f} s, {what}; expected times "
            "that increase"
        )
    turned = None
    if values.shape[1] == 8:
        turned = values[:, 4:]
        lengths = lengths_of(turned)
        if (abs(lengths - 1) > 1e-3).any():
            i = int(np.argmax(abs(lengths - 1) > 1e-3))
            raise DamagedFileError(
                f"{name}, {place} {i + 1}: the quaternion has length {lengths[i]:.3g}; expected 1, in the order "
                "x, y, z, w"
            )
    try:
        log = Trajectory(times=values[:, 0], positions=scale * values[:, 1:4], orientations=turned)
        check_log(log)
    except InputError as error:
        raise DamagedFileError(f"{name}: {error}") from error
    return log


def write_robot_log(path: str | os.PathLike[str], log: Trajectory) -> None:
    """Write a log as text with exact numbers, so that `read_robot_log` returns the same bits.

    Raises
    ------
    InputError, FileError
    """
    checked_record(log, Trajectory, name="log")
    columns = COLUMNS[: 4 if log.orientations is None else 8]
    parts = [log.times[:, None], log.positions, *([] if log.orientations is None else [log.orientations])]
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in np.hstack(parts).tolist())]
    write_text(path, "\n".join(lines) + "\n")


def _from_text(table: TextTable, columns: Sequence[int | str] | None) -> np.ndarray:
    """(n, 4) or (n, 8): time, position, quaternion."""
    if np.iscomplexobj(table.values):
        raise FormatError(f"{table.source} holds complex numbers; expected times and positions")
    if columns is not None:
        chosen = table.columns(columns)
        if chosen.shape[1] not in (4, 8):
            raise InputError(f"columns is {columns}; expected 4 or 8, those of {', '.join(COLUMNS)}")
        return chosen
    width = table.values.shape[1]
    if not table.names:
        if width not in (4, 8):
            raise FormatError(
                f"{table.source} has {width} columns without names; expected 4 or 8 ({', '.join(COLUMNS)}), a first "
                "line that names them, or columns that says which these are"
            )
        return table.values
    known = [_ALIASES.get(column.lower(), column.lower()) for column in table.names]
    missing = [column for column in COLUMNS[:4] if column not in known]
    if missing:
        raise FormatError(
            f"{table.source} has the columns {', '.join(table.names)}; expected {', '.join(COLUMNS[:4])} among "
            "them, or columns that says which these are"
        )
    turned = [column for column in COLUMNS[4:] if column in known]
    if len(turned) not in (0, 4):
        raise FormatError(f"{table.source} has {', '.join(turned)} alone; expected all of qx, qy, qz, qw, or none")
    return table.values[:, [known.index(column) for column in (*COLUMNS[:4], *turned)]]


def _from_arrays(path: Path, times: str | None, positions: str | None, orientations: str | None) -> np.ndarray:
    arrays = read_arrays(path)
    usual = (*_POSITIONS, *(arrays if len(arrays) == 1 else ()))
    parts = [_found(arrays, (positions,) if positions else usual, path, "positions")]
    if times or parts[0].ndim != 2 or parts[0].shape[1] not in (4, 8):
        stamps = _found(arrays, (times,) if times else _TIMES, path, "times")
        parts.insert(0, stamps.reshape(-1, 1))
    if orientations or any(name in arrays for name in _ORIENTATIONS):
        parts.append(_found(arrays, (orientations,) if orientations else _ORIENTATIONS, path, "orientations"))
    shapes = ", ".join(str(part.shape) for part in parts)
    if any(part.dtype.kind not in "iuf" for part in parts):
        raise FormatError(f"{printable(path)}: times and poses are not real numbers")
    if any(part.ndim != 2 for part in parts) or len({len(part) for part in parts}) != 1:
        raise FormatError(
            f"{printable(path)}: times and poses have shapes {shapes}; expected (n,) and (n, 3) or (n, 7)"
        )
    values = np.hstack(parts).astype(float)
    if values.shape[1] not in (4, 8):
        raise FormatError(
            f"{printable(path)}: times and poses have shapes {shapes}; expected (n,) and (n, 3) or (n, 7)"
        )
    return values


def _found(arrays: dict[str, np.ndarray], names: Iterable[str], path: Path, what: str) -> np.ndarray:
    """The first of the named arrays that is there."""
    names = tuple(names)
    for name in names:
        if name in arrays:
            return arrays[name]
    raise UnknownNameError(f"array of {what} in {printable(path)}:", "/".join(names), arrays)


def _without_repeats(values: np.ndarray) -> np.ndarray:
    """The rows that do not repeat the one before."""
    return values[np.concatenate([[True], (np.diff(values, axis=0) != 0).any(axis=1)])] if len(values) else values
