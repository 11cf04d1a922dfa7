"""Tables of numbers as text: CSV, or columns set apart by blanks, with or without a line of names above them."""

import math
import os
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError, UnknownNameError

TEXT_SUFFIXES = (".txt", ".csv", ".tsv", ".dat")
_LONGEST = 1 << 26  # bytes; some million numbers
_WHOLE = re.compile(r"[+-]?\d+")
_TWO_NUMBERS = re.compile(r"[\d.ij)]\s+[-+]?[.\d(]")
_LIKE_A_NUMBER = re.compile(r"[-+]?[\d.,]*\d[\d.,]*([eE][-+]?\d+)?")


class TextTable(NamedTuple):
    """Numbers, (rows, columns), and the columns' names, none where the file has no line of names."""

    values: np.ndarray
    names: tuple[str, ...]
    source: str

    def columns(self, wanted: Sequence[int | str]) -> np.ndarray:
        """(rows, n) the columns with these numbers, from 0 on, or names.

        Raises
        ------
        UnknownNameError
        """
        known = [*self.names, *map(str, range(self.values.shape[1]))]
        for name in wanted:
            if str(name) not in known:
                raise UnknownNameError(f"column in {self.source}:", name, known)
        places = [self.names.index(n) if n in self.names else int(n) for n in wanted]  # type: ignore[arg-type]
        return self.values[:, places]


def read_table(path: str | os.PathLike[str], *, skip_rows: int = 0, decimal: str | None = None) -> TextTable:
    """A table of numbers: one row a line, separated by commas, semicolons, tabs or blanks; # starts a comment.

    Numbers may be complex: 1.5-2i, 1.5-2j, (1.5-2j).

    Parameters
    ----------
    skip_rows : lines of the file's head to pass over; a line of names may follow
    decimal : "." or ",", the decimal sign. None: a point; but where commas between whole numbers may be decimal
        commas, the file is refused, since nobody can tell

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It is not a text; or its commas may be decimal commas.
    DamagedFileError
        It holds no numbers; or a line has another number of them, or what is none, or NaN: the message says which.
    """
    path = check_readable(path)
    source = printable(path)
    if decimal not in (None, ".", ","):
        raise InputError(f"decimal is {decimal!r}; expected '.' or ','")
    if os.path.getsize(path) > _LONGEST:
        raise FormatError(f"{source} has {os.path.getsize(path)} bytes, too many for a text; save it as .npy")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{source} is not a text of numbers: {error}") from error
    if skip_rows >= max(1, len(lines)):
        raise FormatError(f"{source} has {len(lines)} lines; skip_rows = {skip_rows} leaves none of them")
    kept = [(number, line.split("#")[0].strip()) for number, line in enumerate(lines, 1) if number > skip_rows]
    kept = [(number, line) for number, line in kept if line]
    if not kept:
        raise DamagedFileError(f"{source} holds no numbers")
    separator = _separator(kept[-1][1], decimal)
    names: tuple[str, ...] = ()
    rows: list[list[complex]] = []
    width = 0
    doubtful = separator == "," and decimal is None  # while all cells are whole numbers
    for number, line in kept:
        words = _words(line, separator)
        row = [_number(word, decimal) for word in words]
        if not width:
            width = len(words)
            if None in row and not any(
                v is None and _LIKE_A_NUMBER.fullmatch(w) for v, w in zip(row, words, strict=True)
            ):
                names = tuple(word.strip("\"'") for word in words)
                doubtful = False  # as many names as numbers: the commas stand between numbers
                continue
        if len(row) != width:
            hint = ""
            if names and separator == "," and decimal is None and len(row) == 2 * width:
                hint = ': twice as many; if its commas are decimal commas, set decimal = ","'
            raise DamagedFileError(f"{source}, line {number} has {len(row)} columns; expected {width} as before{hint}")
        for word, value in zip(words, row, strict=True):
            if value is None or not math.isfinite(abs(value)):
                raise DamagedFileError(
                    f"{source}, line {number} has {word[:40]!r}; expected a finite number{_hint(word, decimal)}"
                )
        doubtful = doubtful and all(_WHOLE.fullmatch(word) for word in words)
        rows.append(row)  # type: ignore[arg-type]
    if not rows:
        raise DamagedFileError(f"{source} holds no numbers")
    if doubtful and width % 2 == 0 and ", " not in kept[-1][1]:
        raise FormatError(
            f"{source}, line {kept[-1][0]}: {kept[-1][1][:40]!r} may be {width // 2} numbers with a decimal comma, or "
            f'{width} whole ones; set decimal = "," or decimal = "."'
        )
    values = np.array(rows, dtype=complex)
    return TextTable(values if np.any(np.imag(values)) else np.real(values).copy(), names, source)


def _separator(line: str, decimal: str | None) -> str:
    """What stands between the numbers of a line: ";", a tab, ",", or "" for blanks."""
    for sign in (";", "\t"):
        if sign in line and not any(map(_TWO_NUMBERS.search, line.split(sign))):
            return sign
    # Commas within numbers that blanks set apart stay there, and are found when the numbers are read.
    cells = line.split(",") if decimal != "," else [line]
    return "," if len(cells) > 1 and not any(map(_TWO_NUMBERS.search, cells)) else ""


def _words(line: str, separator: str) -> list[str]:
    return [word.strip() for word in line.split(separator)] if separator else line.split()


def _number(word: str, decimal: str | None) -> complex | None:
    if decimal == ",":
        if "." in word:
            return None
        word = word.replace(",", ".")
    try:
        return float(word)
    except ValueError:
        pass
    if word[-1:] in ("i", "j", ")"):
        try:
            return complex(word.replace("i", "j").replace(" ", ""))
        except ValueError:
            pass
    return None


def _hint(word: str, decimal: str | None) -> str:
    if decimal != "," and re.search(r"\d,\d", word):
        return '; if its comma is a decimal comma, set decimal = ","'
    if decimal == "," and "." in word:
        return ': with decimal = "," a number cannot contain a point'
    return ""
