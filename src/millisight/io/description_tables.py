"""The tables of a description: values by key, each checked, and where a file or an array is named, read from there.

A value is written out, in SI units, or refers to an array: `{array = "f", unit = "GHz"}` in the file of the frames,
`{file = "positions.csv", columns = ["x", "y", "z"], unit = "mm"}` in another one.
"""

import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from millisight.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.files import check_readable, checked_path, printable
from millisight.io.arrays import read_arrays
from millisight.io.pickles import read_pickle
from millisight.io.text_table import read_table
from millisight.records import as_array, checked_integer

TEXT_SUFFIXES = (".txt", ".csv", ".tsv", ".dat")
PICKLE_SUFFIXES = (".pkl", ".pickle")
_LONGEST = 1 << 20  # bytes of a description
_REFERENCE = ("file", "array", "columns", "index", "unit")
_UNITS = {
    "": {},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rad": {"rad": 1.0, "deg": np.pi / 180},
}


def parse(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It is not TOML.
    """
    path = check_readable(path)
    try:
        if os.path.getsize(path) > _LONGEST:
            raise ValueError(f"{os.path.getsize(path)} bytes are no description")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{printable(path)} is not a description in TOML: {error}") from error


class Files:
    """Finds the files that a description names: in the folder `data`, else beside the description."""

    def __init__(self, description: Path, data: Path | None, subject: Path | None = None):
        self._folders = [folder for folder in (data, description.parent) if folder is not None]
        self.subject = subject  # the file of the frames, where they lie in a single one

    def one(self, name: str) -> Path:
        """The file called `name`.

        Raises
        ------
        FileError
        """
        places = [folder / checked_path(name) for folder in self._folders]
        for place in places:
            if os.path.exists(place):
                return check_readable(place)
        raise FileError(
            f"{printable(places[0])}: no such file; say with --data (data= in Python) which folder holds the files "
            "that the description names"
        )

    def many(self, pattern: str) -> list[Path]:
        """The files that a pattern such as "rows/*.bin" means, numbers in their names in order of size.

        Raises
        ------
        FileError
        """
        for folder in self._folders:
            try:
                found = [path for path in folder.glob(pattern) if path.is_file()]
            except (ValueError, NotImplementedError, IndexError) as error:
                raise FileError(f"the pattern {pattern!r} cannot be read: {error}") from error
            if found:
                return sorted(found, key=lambda path: [part.zfill(30) for part in re.split(r"(\d+)", str(path))])
        raise FileError(f"no file in {printable(self._folders[0])} is meant by {pattern!r}")


class Table:
    """One table of a description, such as [frames], its keys among the `known` ones.

    Raises
    ------
    UnknownNameError
        A key is not known.
    FormatError
        It is no table.
    """

    def __init__(self, values: Any, name: str, source: Path, files: Files, known: Sequence[str]):
        self.source, self.name, self.files, self._values = source, name, files, values
        if not isinstance(values, dict):
            raise FormatError(f"{self.place} is {values!r}; expected a table with some of {', '.join(known)}")
        for key in values:
            if key not in known:
                raise UnknownNameError(f"key in {self.place}:", key, known)

    @property
    def place(self) -> str:
        """Where the table stands, for messages."""
        return f"{printable(self.source)}, {self.name}"

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def get(self, key: str) -> Any:
        """The value as it is written; None where it is missing."""
        return self._values.get(key)

    def error(self, key: str, expected: str) -> FormatError:
        """The error for a value that cannot be right, or that is missing."""
        if key not in self:
            return FormatError(f"{self.place} has no {key}; expected {expected}")
        return FormatError(f"{self.place}: {key} is {str(self._values[key])[:200]!r}; expected {expected}")

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Within the block, errors of the records tell where in the description they come from."""
        try:
            yield
        except InputError as error:
            raise FormatError(f"{self.place}: {error}") from error

    def only_one(self, *keys: str) -> str:
        """The one of `keys` that is there.

        Raises
        ------
        FormatError
            None is, or several are.
        """
        there = [key for key in keys if key in self]
        if len(there) != 1:
            raise FormatError(
                f"{self.place} has {' and '.join(there) or 'none of ' + ', '.join(keys)}; expected one of "
                f"{', '.join(keys)}"
            )
        return there[0]

    def text(self, key: str, default: str | None = None, *, among: Sequence[str] = ()) -> str:
        """A text, one of `among` where they are given."""
        value = self._values.get(key, default)
        if not isinstance(value, str):
            raise self.error(key, f"one of {', '.join(map(repr, among))}" if among else "a text")
        if among and value not in among:
            raise UnknownNameError(f"{key} in {self.place}:", value, among)
        return value

    def texts(self, key: str, expected: str = "a text, or a list of texts") -> list[str]:
        """A text, or a list of them, as a list."""
        value = self._values.get(key)
        values = [value] if isinstance(value, str) else value
        if not isinstance(values, list) or not values or not all(isinstance(text, str) for text in values):
            raise self.error(key, expected)
        return values

    def flag(self, key: str) -> bool:
        """true or false; false where it is missing."""
        value = self._values.get(key, False)
        if not isinstance(value, bool):
            raise self.error(key, "true or false")
        return value

    def integer(self, key: str, default: int | None = None, *, minimum: int = 1) -> int:
        """A whole number, of at least `minimum`."""
        value = self._values.get(key, default)
        if isinstance(value, dict):
            value = self.number(key, "")
        with self.errors():
            return checked_integer(value, name=key, minimum=minimum)

    def number(self, key: str, unit: str, default: float | None = None) -> float:
        """A number in the SI unit `unit`."""
        if key not in self and default is not None:
            return default
        values = self.array(key, unit)
        if values.size != 1:
            raise self.error(key, f"one number{f' [{unit}]' if unit else ''}, and not an array of shape {values.shape}")
        return float(values.flat[0])

    def array(self, key: str, unit: str, shape: tuple[int | str, ...] | None = None) -> np.ndarray:
        """Numbers in the SI unit `unit`, as float64; a string in `shape` leaves a dimension free."""
        value, factor = self._values.get(key), 1.0
        if isinstance(value, dict):
            value, factor = self._referred(key, unit)
        elif not isinstance(value, int | float | list) or isinstance(value, bool):
            raise self.error(key, f"numbers{f' [{unit}]' if unit else ''}, or a reference to an array")
        with self.errors(), np.errstate(over="ignore"):
            shape = _shape(value) if shape is None else shape
            values = as_array(value, name=key, shape=shape, unit=unit) * factor
            return as_array(values, name=key, shape=shape, unit=unit)

    def numbers(self, key: str, unit: str, count: int) -> np.ndarray:
        """(count,) numbers in the SI unit `unit`; a single one stands for all."""
        values = self.array(key, unit)
        if values.size not in (1, count):
            raise self.error(key, f"one number or {count}{f' [{unit}]' if unit else ''}")
        return np.broadcast_to(values.reshape(-1), (count,))

    def wholes(self, key: str) -> np.ndarray:
        """Whole numbers, as int64."""
        with self.errors():
            values = self.array(key, "")
            return as_array(values, name=key, shape=values.shape, dtype=np.int64)

    def unit(self, unit: str) -> float:
        """How many of the SI unit `unit` make one of the unit that `unit` names."""
        factors = _UNITS[unit]
        return factors[self.text("unit", among=list(factors))] if "unit" in self else 1.0

    def file(self) -> Path:
        """The file that `file` names, or else the one of the frames."""
        if "file" in self:
            return self.files.one(self.text("file"))
        if self.files.subject is None:
            raise self.error("file", "the name of a file: the frames do not lie in a single one")
        return self.files.subject

    def table(self, key: str, known: Sequence[str], name: str | None = None) -> "Table":
        """A table inside this one, for messages called `name`."""
        return Table(self._values.get(key), name or f"{self.name} {key}", self.source, self.files, known)

    def _referred(self, key: str, unit: str) -> tuple[np.ndarray, float]:
        """The numbers that a reference leads to, and the factor that makes them SI units."""
        reference = self.table(key, _REFERENCE)
        path = reference.file()
        columns = reference._list("columns") if "columns" in reference else None
        if columns is not None and path.suffix.lower() in TEXT_SUFFIXES:
            values = read_table(path).columns(columns)
        else:
            values = array_in(path, reference.text("array") if "array" in reference else None)
            values = values if columns is None else reference._picked(values, -1, "columns", columns)
        if "index" in reference:
            values = reference._picked(values, 0, "index", reference.integer("index", minimum=0))
        return values, reference.unit(unit)

    def _list(self, key: str) -> list[Any]:
        value = self._values[key]
        if not isinstance(value, list) or not all(type(item) in (int, str) for item in value):
            raise self.error(key, "a list of numbers, from 0 on, or of names")
        return value

    def _picked(self, values: np.ndarray, axis: int, key: str, places: Any) -> np.ndarray:
        try:
            return values.take(places, axis)
        except (IndexError, ValueError, TypeError, OverflowError) as error:
            raise self.error(key, f"places in an array of shape {values.shape}") from error


def _shape(value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError as error:  # a list of lists of several lengths
        raise InputError(str(error)) from error


def array_in(path: Path, name: str | None) -> np.ndarray:
    """The array called `name` in a file, or the only one there.

    Raises
    ------
    FileError, UnknownNameError
    """
    if path.suffix.lower() in TEXT_SUFFIXES:
        arrays = {"0": read_table(path).values}
    elif path.suffix.lower() in PICKLE_SUFFIXES:
        found = read_pickle(path)
        arrays = found if isinstance(found, dict) else {"0": found}
        arrays = {str(key): value for key, value in arrays.items() if isinstance(value, np.ndarray)}
    else:
        arrays = read_arrays(path, names=None if name is None else [name])
    if name is None and len(arrays) != 1:
        raise FormatError(f"{printable(path)} holds the arrays {', '.join(arrays)}; say which one with the key array")
    if name is not None and name not in arrays:
        raise UnknownNameError(f"array in {printable(path)}:", name, arrays)
    return arrays[next(iter(arrays)) if name is None else name]
