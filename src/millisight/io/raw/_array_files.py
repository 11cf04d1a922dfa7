"""Raw frames in files of arrays, texts of numbers and Touchstone files, whose axes the description names."""

from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import checked_integer, printable
from millisight.core.errors import InputError
from millisight.io.arrays import TEXT_SUFFIXES, read_array, read_table, read_touchstone
from millisight.io.raw._format import RAW_FORMATS, RawArray, RawFormat


def _read_arrays(path: Path, *, array: str | list[str] | None = None, shape: Any = None) -> RawArray:
    """The array of a file, or several of one shape along a new first axis."""
    names = array if isinstance(array, list) else [array]
    arrays = [read_array(path, name) for name in names]
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise InputError(f"array is {names}; expected arrays of one shape; {printable(path)} has {sorted(shapes)}")
    values = arrays[0] if len(arrays) == 1 else np.stack(arrays)
    if values.dtype.kind not in "biufc":
        raise InputError(f"array is not an array of numbers; that in {printable(path)} is {values.dtype}")
    return RawArray(values=_shaped(values, shape, path))


def _read_text(
    path: Path, *, columns: Any = None, skip_rows: int = 0, decimal: str | None = None, shape: Any = None
) -> RawArray:
    """The columns of a text, (rows, columns)."""
    table = read_table(path, skip_rows=checked_integer(skip_rows, name="skip_rows", minimum=0), decimal=decimal)
    if columns is None:
        return RawArray(values=_shaped(table.values, shape, path))
    columns = columns if isinstance(columns, list) else [columns]
    if not columns or not all(type(column) in (int, str) for column in columns):
        raise InputError(f"columns is {columns!r}; expected a list of numbers, from 0 on, or of names")
    return RawArray(values=_shaped(table.columns(columns), shape, path))


def _read_touchstone(path: Path, *, parameter: str = "S21") -> RawArray:
    """One scattering parameter over frequency: a pose of one transmitter and one receiver."""
    arrays = read_touchstone(path)
    frequencies = arrays.pop("f")
    if parameter not in arrays:
        raise InputError(f"parameter is {parameter!r}; {printable(path)} has {', '.join(arrays)}")
    return RawArray(values=arrays[parameter][None], frequencies=frequencies)


def _shaped(values: np.ndarray, shape: Any, path: Path) -> np.ndarray:
    if shape is None:
        return values
    try:
        return values.reshape(np.asarray(shape, dtype=np.int64))
    except (ValueError, OverflowError, TypeError) as error:
        raise InputError(
            f"shape is {shape}; expected one for the {values.size} numbers in {printable(path)}"
        ) from error


RAW_FORMATS.add("arrays", RawFormat(suffixes=(), keys=("array", "shape"), read=_read_arrays, axes=None))
RAW_FORMATS.add(
    "text",
    RawFormat(suffixes=TEXT_SUFFIXES, keys=("columns", "skip_rows", "decimal", "shape"), read=_read_text, axes=None),
)
RAW_FORMATS.add(
    "touchstone",
    RawFormat(
        suffixes=tuple(f".s{ports}p" for ports in range(1, 10)),
        keys=("parameter",),
        read=_read_touchstone,
        axes=("pose", "sample"),
        phase_sign=-1,
    ),
)
