"""Tables of numbers as text: CSV, or columns set apart by blanks, with or without a line of names above them."""

import math
import os
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.errors import DamagedFileError, FormatError, UnknownNameError
from millisight.files import check_readable, printable

_SEPARATORS = re.compile(r"\s*[,;]\s*|\s+")
_LONGEST = 1 << 26  # bytes; some million numbers


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


def read_table(path: str | os.PathLike[str]) -> TextTable:
    """A table of numbers: one row a line, separated by commas, semicolons or blanks; what follows # is left out.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It is not a text.
    DamagedFileError
        It holds no numbers; or a line has another number of them, or what is none, or NaN: the message says which.
    """
    path = check_readable(path)
    source = printable(path)
    if os.path.getsize(path) > _LONGEST:
        raise FormatError(f"{source} has {os.path.getsize(path)} bytes, too many for a text; save it as .npy")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{source} is not a text of numbers: {error}") from error
    names: tuple[str, ...] = ()
    rows: list[list[float]] = []
    width = 0
    for number, line in enumerate(lines, 1):
        words = _SEPARATORS.split(line.split("#")[0].strip())
        if words == [""]:
            continue
        row = [_number(word) for word in words]
        if not width:
            width = len(words)
            if any(value is None for value in row):
                names = tuple(word.strip("\"'") for word in words)
                continue
        if len(row) != width:
            raise DamagedFileError(f"{source}, line {number} has {len(row)} columns; expected {width} as before")
        for word, value in zip(words, row, strict=True):
            if value is None or not math.isfinite(value):
                raise DamagedFileError(f"{source}, line {number} has {word[:40]!r}; expected a finite number")
        rows.append(row)  # type: ignore[arg-type]
    if not rows:
        raise DamagedFileError(f"{source} holds no numbers")
    return TextTable(np.array(rows), names, source)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
