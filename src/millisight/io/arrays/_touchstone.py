"""Touchstone files of network analysers, .s1p to .s9p: scattering parameters over frequency.

After "Touchstone File Format Specification" 1.1 and 2.0 (IBIS Open Forum): comments start with "!", one option line
"# GHz S RI R 50" says unit, parameter, form and impedance; then the numbers, a frequency and the pairs of a matrix,
row by row but for two ports, whose order is S11 S21 S12 S22. Noise parameters, which may follow, start at a lower
frequency.
"""

import math
import os
import re
from pathlib import Path

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError

_SUFFIX = re.compile(r"\.s([1-9])p", re.IGNORECASE)
_UNITS = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
_FORMS = ("RI", "MA", "DB")
_LONGEST = 1 << 26
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


def is_touchstone(path: Path) -> bool:
    """Whether a file's suffix is that of a Touchstone file."""
    return bool(_SUFFIX.fullmatch(path.suffix))


def read_touchstone(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The arrays of a Touchstone file: "f" (N,) [Hz], and "S11", "S21", ... (N,) complex, of the phase sign -1.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        Its suffix says no number of ports, or its option line asks for what is not read.
    DamagedFileError
        Numbers are missing, are none, or frequencies do not increase; with the line.
    """
    path = check_readable(path)
    source = printable(path)
    ports = _SUFFIX.fullmatch(path.suffix)
    if ports is None:
        raise FormatError(f"{source} ends in {path.suffix!r}; expected .s1p to .s9p, which says the number of ports")
    count = int(ports[1])
    if os.path.getsize(path) > _LONGEST:
        raise FormatError(f"{source} has {os.path.getsize(path)} bytes, too many for a text")
    unit, form, by_rows = 1e9, "MA", False
    numbers: list[float] = []
    for number, line in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        words = line.split("!")[0].split()
        if not words:
            continue
        if words[0].startswith("#"):
            unit, form = _options(f"{source}, line {number}", [word.upper() for word in " ".join(words)[1:].split()])
        elif words[0].startswith("["):
            keyword = " ".join(words).upper()
            if keyword.startswith("[NOISE DATA]"):
                break
            if keyword.startswith("[MATRIX FORMAT]") and not keyword.endswith("FULL"):
                raise FormatError(f"{source}, line {number}: half a matrix is not read; expected [Matrix Format] Full")
            by_rows = by_rows or keyword == "[TWO-PORT DATA ORDER] 12_21"
        else:
            numbers += _numbers(f"{source}, line {number}", words)
    width = 1 + 2 * count * count
    values = np.array(numbers)
    values = values[: _without_noise(values, width)]
    if not len(values) or len(values) % width:
        raise DamagedFileError(
            f"{source} holds {len(values)} numbers; expected {width} for each frequency of {count} ports: it is cut "
            "off, or its suffix is wrong"
        )
    table = values.reshape(-1, width)
    with np.errstate(over="ignore"):
        frequencies = unit * table[:, 0]
        sizes = table[:, 1::2] if form != "DB" else 10 ** (table[:, 1::2] / 20)
    if not np.isfinite(sizes).all():
        raise DamagedFileError(f"{source}: a level in dB is beyond all numbers")
    if not np.isfinite(frequencies).all():
        raise DamagedFileError(f"{source}: a frequency is beyond all numbers, in the unit that the file states")
    if (np.diff(frequencies) <= 0).any():
        place = int(np.argmax(np.diff(frequencies) <= 0)) + 1
        raise DamagedFileError(
            f"{source}: frequency {place + 1} is {frequencies[place]:g} Hz, not above the one before"
        )
    second = table[:, 2::2]
    matrix = sizes + 1j * second if form == "RI" else sizes * np.exp(1j * np.radians(second))
    names = [f"S{row}{column}" for row in range(1, count + 1) for column in range(1, count + 1)]
    if count == 2 and not by_rows:
        names = ["S11", "S21", "S12", "S22"]
    return {"f": frequencies, **{name: matrix[:, i] for i, name in enumerate(names)}}


def _options(place: str, words: list[str]) -> tuple[float, str]:
    unit, form = 1e9, "MA"
    for word, after in zip(words, [*words, ""][1:], strict=True):
        if word in _UNITS:
            unit = _UNITS[word]
        elif word in _FORMS:
            form = word
        elif word in ("Y", "Z", "H", "G"):
            raise FormatError(f"{place}: it holds {word} parameters; expected S parameters")
        elif word not in ("S", "R") and not _is_number(word):
            raise FormatError(f"{place}: {word!r} is not an option line; expected one such as '# GHz S RI R 50'")
        if word == "R" and not _is_number(after):
            raise FormatError(f"{place}: R is followed by {after!r}; expected the impedance in ohms")
    return unit, form


def _without_noise(values: np.ndarray, width: int) -> int:
    """How many of the numbers are scattering parameters: those of noise start again at a lower frequency."""
    if width != 9:
        return len(values)
    for start in range(width, len(values), width):
        if values[start] <= values[start - width] and (len(values) - start) % 5 == 0:
            return start
    return len(values)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(place: str, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
        if all(map(math.isfinite, values)):
            return values
    except ValueError:
        pass
    return [_number(place, word) for word in words]


def _number(place: str, word: str) -> float:
    if _DECIMAL_COMMA.fullmatch(word):  # blanks alone set numbers apart
        word = word.replace(",", ".")
    value = float(word) if _is_number(word) else np.nan
    if not np.isfinite(value):
        raise DamagedFileError(f"{place} has {word[:40]!r}; expected a finite number")
    return value
