"""The tables of a description: values by key, each checked, and where a file or an array is named, read from there.

A value is written out, in SI units, or refers to an array: `{array = "f", unit = "GHz"}` in the file of the frames,
`{file = "positions.csv", columns = ["x", "y", "z"], unit = "mm"}` in another one.
"""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import as_array, check_readable, checked_integer, checked_path, parsed_toml, printable
from millisight.core.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.io.arrays import TEXT_SUFFIXES, read_array, read_table

_LONGEST = 1 << 20  # bytes of a description
_MOST_PARTS = 32  # of a pattern
REFERENCE = ("file", "array", "columns", "index", "slice", "unit", "skip_rows", "rows", "decimal")
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
            raise ValueError(f"{os.path.getsize(path)} bytes are too many for a description")
        return parsed_toml(path.read_text(encoding="utf-8"))
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
            f"{printable(places[0])}: no such file; pass the folder of the files named in the description with --data "
            "(data= in Python)"
        )

    def many(self, pattern: str) -> list[Path]:
        """The files that a pattern such as "rows/*.bin" means, numbers in their names in order of size.

        Raises
        ------
        FileError
        """
        _check_pattern(pattern)
        for folder in self._folders:
            try:
                found = [path for path in folder.glob(pattern) if path.is_file()]
            except (ValueError, NotImplementedError, IndexError) as error:
                raise FileError(f"the pattern {pattern!r} cannot be read: {error}") from error
            if found:
                return sorted(found, key=lambda path: [part.zfill(30) for part in re.split(r"(\d+)", str(path))])
        raise FileError(f"no file in {printable(self._folders[0])} matches {pattern!r}")


def _check_pattern(pattern: str) -> None:
    """Refuse a pattern that could run through the same folders again and again."""
    parts = Path(pattern).parts
    choosing = parts[next((i for i, part in enumerate(parts) if set(part) & set("*?[")), len(parts)) :]
    if choosing.count("**") > 1 or ".." in choosing or len(parts) > _MOST_PARTS:
        raise FileError(
            f"the pattern {pattern[:80]!r} could run through folders again and again; expected at most {_MOST_PARTS} "
            "names, one ** among them, and no .. behind a wildcard"
        )


class TomlTable:
    """One table of a description, such as [frames], its keys among the `known` ones; "" is the whole description.

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
        return f"{printable(self.source)}{', ' if self.name else ''}{self.name}"

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

    def array(
        self, key: str, unit: str, shape: tuple[int | str, ...] | None = None, *, dtype: type = float
    ) -> np.ndarray:
        """Numbers in the SI unit `unit`, as float64 or `dtype`; a string in `shape` leaves a dimension free."""
        value, factor = self._values.get(key), 1.0
        if isinstance(value, dict):
            value, factor = self._referred(key, unit, whole=dtype is np.int64)
        elif not isinstance(value, int | float | list) or isinstance(value, bool):
            raise self.error(key, f"numbers{f' [{unit}]' if unit else ''}, or a reference to an array")
        with self.errors(), np.errstate(over="ignore"):
            shape = _shape(value) if shape is None else shape
            values = as_array(value, name=key, shape=shape, dtype=dtype, unit=unit) * factor
            return as_array(values, name=key, shape=shape, dtype=dtype, unit=unit)

    def setting(self, key: str) -> Any:
        """The value as it is written, or the array that a reference leads to."""
        return self.array(key, "") if isinstance(self._values.get(key), dict) else self._values.get(key)

    def numbers(self, key: str, unit: str, count: int) -> np.ndarray:
        """(count,) numbers in the SI unit `unit`; a single one stands for all."""
        values = self.array(key, unit)
        if values.size not in (1, count):
            raise self.error(key, f"one number or {count}{f' [{unit}]' if unit else ''}")
        return np.broadcast_to(values.reshape(-1), (count,))

    def wholes(self, key: str) -> np.ndarray:
        """Whole numbers, as int64."""
        return self.array(key, "", dtype=np.int64)

    def unit(self, unit: str) -> float:
        """How many of the SI unit `unit` make one of the unit that `unit` names."""
        factors = _UNITS[unit]
        if "unit" in self and not factors:
            raise self.error("unit", "no unit: these are plain numbers")
        return factors[self.text("unit", among=list(factors))] if "unit" in self else 1.0

    def file(self) -> Path:
        """The file that `file` names, or else the one of the frames."""
        if "file" in self:
            return self.files.one(self.text("file"))
        if self.files.subject is None:
            raise self.error("file", "the name of a file, since the frames are in several files")
        return self.files.subject

    def table(self, key: str, known: Sequence[str], name: str | None = None) -> "TomlTable":
        """A table inside this one, for messages called `name`."""
        return self.inner(self._values.get(key), name or f"{self.name} {key}", known)

    def inner(self, values: Any, name: str, known: Sequence[str]) -> "TomlTable":
        """A table of `values` inside this one."""
        return TomlTable(values, name, self.source, self.files, known)

    def _referred(self, key: str, unit: str, *, whole: bool) -> tuple[np.ndarray, float]:
        """The numbers that a reference leads to, and the factor that makes them SI units."""
        reference = self.table(key, REFERENCE)
        return reference.values(whole=whole), reference.unit(unit)

    def values(self, *, whole: bool = False) -> np.ndarray:
        """The numbers that this table, a reference, leads to, in their own unit; `whole`: no decimals are meant."""
        path = self.file()
        columns = self.get("columns")
        with self.errors():
            if path.suffix.lower() in TEXT_SUFFIXES:
                table = read_table(path, **self.text_settings(path, "." if whole else None))
                values = table.values if columns is None else table.columns(columns)
            else:
                self.text_settings(path)
                values = read_array(path, self.text("array") if "array" in self else None)
                values = values if columns is None else self._picked(values, -1, "columns", columns)
        if "slice" in self:
            values = self._sliced(values)
        if "index" in self:
            values = self._picked(values, 0, "index", self.integer("index", minimum=0))
        return values

    def text_settings(self, path: Path, decimal: str | None = None) -> dict[str, Any]:
        """How a text is read, with this decimal sign unless another one is said.

        Raises
        ------
        FormatError
            The file is no text, and something is said all the same.
        """
        settings: dict[str, Any] = {"decimal": decimal}
        for key in ("skip_rows", "rows", "decimal"):
            if key in self and path.suffix.lower() not in TEXT_SUFFIXES:
                raise self.error(key, f"this key only for text files, and not for {printable(path)}")
        if "skip_rows" in self:
            settings["skip_rows"] = self.integer("skip_rows", minimum=0)
        if "rows" in self:
            settings["rows"] = self.integer("rows")
        if "decimal" in self:
            settings["decimal"] = self.text("decimal", among=(".", ","))
        return settings

    def _sliced(self, values: np.ndarray) -> np.ndarray:
        """The entries along the first axis from a start on, before a stop, by a step."""
        places = self._values["slice"]
        whole = isinstance(places, list) and all(type(place) is int for place in places)
        if not whole or len(places) not in (2, 3) or min(places) < 0 or (len(places) == 3 and places[2] < 1):
            raise self.error("slice", "[start, stop] or [start, stop, step], whole numbers from 0")
        count = len(values) if values.ndim else 0
        if not places[0] < places[1] <= count:
            raise self.error("slice", f"start below stop, and stop at most {count}, the number of entries")
        return values[slice(*places)]

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
