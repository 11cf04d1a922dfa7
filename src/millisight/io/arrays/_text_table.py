"""Tables of numbers as text: CSV, or columns set apart by blanks, with or without a line of names above them."""

import math
import os
import re
from typing import Any, NamedTuple

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError, UnknownNameError

TEXT_SUFFIXES = (".txt", ".csv", ".tsv", ".dat")
_LONGEST = 1 << 26  # bytes; some million numbers
_WHOLE = re.compile(r"[+-]?\d+")
_TWO_NUMBERS = re.compile(r"[\d.ij)]\s+[-+]?[.\d(]")
_LIKE_A_ROW = re.compile(r"[-+(]?[.,]?\d")
_BLANK_SIGN = re.compile(r"(?<=[\d.])\s+([-+])\s+(?=[\d.,]+([eE][-+]?\d+)?\s?[ij])")  # 1.5 + 2i
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_LIKE_A_NUMBER = re.compile(r"[-+]?[.,]*\d[\d.,]*([eE][-+]?\d+)?")  # in one pass, however long


class TextTable(NamedTuple):
    """Numbers, (rows, columns), and the columns' names, none where the file has no line of names."""

    values: np.ndarray
    names: tuple[str, ...]
    source: str

    def columns(self, wanted: Any) -> np.ndarray:
        """(rows, n) the columns with these numbers, from 0 on, or names; or "1:", all from a number on.

        Raises
        ------
        UnknownNameError
            There is no such column.
        InputError
            This is no such list.
        """
        if isinstance(wanted, str) and wanted.endswith(":") and wanted[:-1].isdecimal():
            wanted = list(range(int(wanted[:-1]), self.values.shape[1]))
        if not isinstance(wanted, list | tuple) or not wanted or not all(type(one) in (int, str) for one in wanted):
            raise InputError(
                f"columns is {wanted!r}; expected a list of numbers, from 0 on, or of names; or '1:', all from 1 on; "
                f"{self.source} has {self.values.shape[1]}"
            )
        known = [*self.names, *map(str, range(self.values.shape[1]))]
        for name in wanted:
            if str(name) not in known:
                raise UnknownNameError(f"column in {self.source}:", name, known)
        places = [self.names.index(n) if n in self.names else int(n) for n in wanted]
        return self.values[:, places]


def read_table(
    path: str | os.PathLike[str], *, skip_rows: int = 0, rows: int | None = None, decimal: str | None = None
) -> TextTable:
    """Read a table of numbers: one row per line, separated by commas, semicolons, tabs or blanks.

    # starts a comment, and so does ! at the start of a line. Numbers may be complex: 1.5-2i, 1.5 - 2j, (1.5-2j). The
    encoding is UTF-8, UTF-16 with its mark, or Latin-1.

    Parameters
    ----------
    skip_rows : lines of the file's head to pass over; a line of names may follow
    rows : of numbers, after which nothing more is read; None: all
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
    lines = _text(path.read_bytes(), source).splitlines()
    if skip_rows >= max(1, len(lines)):
        raise FormatError(f"{source} has {len(lines)} lines; skip_rows = {skip_rows} leaves none of them")
    kept = [(number, line.split("#")[0].strip()) for number, line in enumerate(lines, 1) if number > skip_rows]
    kept = [(number, _BLANK_SIGN.sub(r"\1", line)) for number, line in kept if line and not line.startswith("!")]
    if not kept:
        raise DamagedFileError(f"{source} holds no numbers")
    separator = _separator(next((line for _, line in reversed(kept) if _LIKE_A_ROW.match(line)), kept[-1][1]), decimal)
    names: tuple[str, ...] = ()
    found: list[list[complex]] = []
    width = 0
    doubtful = separator == "," and decimal is None  # while all cells are whole numbers
    for number, line in kept:
        if len(found) == rows:
            break
        words = _words(line, separator)
        row = [_number(word, decimal) for word in words]
        if not width:
            width = len(words)
            odd = [cell for word, value in zip(words, row, strict=True) if value is None for cell in word.split(";")]
            if odd and not any(map(_LIKE_A_NUMBER.fullmatch, odd)):
                names = tuple(word.strip("\"'") for word in words)
                doubtful = False  # as many names as numbers: the commas stand between numbers
                continue
        if len(row) != width:
            hint = ""
            if names and separator == "," and decimal is None and len(row) == 2 * width:
                hint = ': twice as many; if its commas are decimal commas, set decimal = ","'
            elif found and not any(map(_LIKE_A_NUMBER.fullmatch, words)):
                hint = f": {line[:20]!r}; rows = {len(found)} leaves out what follows the numbers"
            raise DamagedFileError(f"{source}, line {number} has {len(row)} columns; expected {width} as before{hint}")
        numbers: list[complex] = []
        for word, value in zip(words, row, strict=True):
            if value is None or not math.isfinite(abs(value)):
                raise DamagedFileError(
                    f"{source}, line {number} has {word[:40]!r}; expected a finite number{_hint(word, decimal)}"
                )
            numbers.append(value)
        doubtful = doubtful and all(_WHOLE.fullmatch(word) for word in words)
        found.append(numbers)
    if len(found) < (rows or 1):
        if rows and found:
            raise DamagedFileError(f"{source} has {len(found)} rows of numbers; expected {rows}")
        raise DamagedFileError(f"{source} holds no numbers")
    if doubtful and width % 2 == 0 and ", " not in kept[-1][1]:
        raise FormatError(
            f"{source}, line {kept[-1][0]}: {kept[-1][1][:40]!r} may be {width // 2} numbers with a decimal comma, or "
            f'{width} whole ones; set decimal = "," or decimal = "."'
        )
    values = np.array(found, dtype=complex)
    return TextTable(values if np.any(np.imag(values)) else np.real(values).copy(), names, source)


def _separator(line: str, decimal: str | None) -> str:
    """What stands between the numbers of a line: ";", a tab, ",", or "" for blanks."""
    for sign in (";", "\t"):
        if sign in line and not any(map(_TWO_NUMBERS.search, line.split(sign))):
            return sign
    # Commas within numbers that blanks set apart stay there, and are found when the numbers are read.
    cells = line.split(",") if decimal != "," else [line]
    return "," if len(cells) > 1 and not any(map(_TWO_NUMBERS.search, cells)) else ""


def _text(data: bytes, source: str) -> str:
    """What a file says, in the encoding that its first bytes tell, or else in UTF-8 or Latin-1."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ("utf-16",)
    elif _BINARY.search(data):
        raise FormatError(f"{source} is not a text of numbers: it holds bytes that no text has")
    else:
        encodings = ("utf-8-sig", "latin-1")
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            pass
    raise FormatError(f"{source} is not a text of numbers: it is not UTF-16")


def _words(line: str, separator: str) -> list[str]:
    """The cells of a line; nothing is after a separator at its end."""
    return [word.strip() for word in line.removesuffix(separator).split(separator)] if separator else line.split()


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
