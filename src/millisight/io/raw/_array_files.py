"""Raw frames in files of arrays, texts of numbers and Touchstone files, whose axes the description names."""

from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import checked_integer, printable
from millisight.core.errors import InputError
from millisight.io.arrays import TEXT_SUFFIXES, read_array, read_table, read_touchstone
from millisight.io.raw._format import RAW_FORMATS, RawArray, RawFormat


def _read_arrays(path: Path, *, array: str | list[str] | None = None) -> RawArray:
    """The array of a file, or several of one shape along a new first axis."""
    names = array if isinstance(array, list) else [array]
    if not names:
        raise InputError("array is []; expected the name of an array, or several")
    arrays = [read_array(path, name) for name in names]
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise InputError(f"array is {names}; expected arrays of one shape; {printable(path)} has {sorted(shapes)}")
    values = arrays[0] if len(arrays) == 1 else np.stack(arrays)
    if values.dtype.kind not in "biufc":
        raise InputError(f"array is not an array of numbers; that in {printable(path)} is {values.dtype}")
    return RawArray(values=values)


def _read_text(
    path: Path, *, columns: Any = None, skip_rows: int = 0, rows: int | None = None, decimal: str | None = None
) -> RawArray:
    """The columns of a text, (rows, columns)."""
    skip_rows = checked_integer(skip_rows, name="skip_rows", minimum=0)
    rows = None if rows is None else checked_integer(rows, name="rows")
    table = read_table(path, skip_rows=skip_rows, rows=rows, decimal=decimal)
    return RawArray(values=table.values if columns is None else table.columns(columns))


def _read_touchstone(path: Path, *, parameter: str = "S21") -> RawArray:
    """One scattering parameter over frequency: a pose of one transmitter and one receiver."""
    arrays = read_touchstone(path)
    frequencies = arrays.pop("f")
    if parameter not in arrays:
        raise InputError(f"parameter is {parameter!r}; {printable(path)} has {', '.join(arrays)}")
    return RawArray(values=arrays[parameter][None], frequencies=frequencies)


RAW_FORMATS.add("arrays", RawFormat(suffixes=(), keys=("array",), read=_read_arrays, axes=None))
RAW_FORMATS.add(
    "text",
    RawFormat(suffixes=TEXT_SUFFIXES, keys=("columns", "skip_rows", "rows", "decimal"), read=_read_text, axes=None),
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
