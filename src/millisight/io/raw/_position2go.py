"""Raw text of Infineon's Position2Go radar: comma-separated rows, an I row and a Q row for each receiver of a chirp."""

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import atomic_path, check_readable, checked_integer, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError
from millisight.io.raw._format import RAW_FORMATS, RawArray, RawFormat
from millisight.io.raw._raw_frames import RawFrames

_MAX_CELL = 64  # characters, comma included
_ROWS, _MOST = 4096, 2**15  # rows that are written at a time; the largest whole number whose text is kept ready


def read_position2go(
    path: str | os.PathLike[str], *, samples: int = 256, chirps: int = 16, receivers: int = 2
) -> RawFrames:
    """Read the complex frames of a Position2Go text file, as recorded (I + iQ).

    A chirp has 2 R rows of N numbers: I-RX1, Q-RX1, I-RX2, Q-RX2. Numbers may be whole or not, and a row may end
    with a comma.

    Parameters
    ----------
    samples, chirps, receivers : N of a chirp, C of a frame, R

    Returns
    -------
    RawFrames with (F, C, R, N) complex64 samples; as many frames as the file holds

    Raises
    ------
    InputError
        An argument cannot be right.
    FileError
        The file cannot be read.
    FormatError
        A cell is no finite number; with its line and cell.
    DamagedFileError
        The file is empty, a row has another length (with its line), or the rows make no whole frames.

    Examples
    --------
    >>> import tempfile; path = tempfile.mkdtemp() + "/frames.txt"
    >>> write_position2go(path, np.full((3, 16, 2, 4), 0.5 + 1j))
    >>> raw = read_position2go(path, samples=4)
    >>> raw.samples.shape, complex(raw.samples[0, 0, 0, 0])
    ((3, 16, 2, 4), (0.5+1j))
    """
    path = check_readable(path)
    samples = checked_integer(samples, name="samples")
    chirps = checked_integer(chirps, name="chirps")
    receivers = checked_integer(receivers, name="receivers")
    name = printable(path.name)
    per_frame = 2 * receivers * chirps
    frames = []
    with open(path, "rb") as file:
        rows: list[bytes] = []
        for row in _rows(file, name, samples):
            rows.append(row)
            if len(rows) == per_frame:
                frames.append(_numbers(rows, name, len(frames) * per_frame))
                rows = []
    if rows or not frames:
        raise DamagedFileError(
            f"{name} has {len(frames) * per_frame + len(rows)} rows; expected whole frames of {per_frame} rows "
            f"({chirps} chirps x {receivers} receivers x I and Q): {len(frames)} are whole, {len(rows)} rows are left "
            "over"
        )
    parts = np.stack(frames).reshape(len(frames), chirps, receivers, 2, samples)
    return RawFrames(
        samples=parts[..., 0, :] + 1j * parts[..., 1, :],
        lost=np.zeros(len(frames), dtype=bool),
        metadata={"source": name},
    )


def write_position2go(path: str | os.PathLike[str], samples: ArrayLike) -> None:
    """Write (F, C, R, N) complex samples in the radar's text form, with the nine digits that complex64 needs.

    Raises
    ------
    InputError
        They are of another shape, or not finite.
    FileError
    """
    frames = np.asarray(samples)
    if frames.ndim != 4 or frames.dtype.kind not in "iufc" or not frames.size:
        raise InputError(
            f"samples are {frames.dtype} of shape {frames.shape}; expected complex (frames, chirps, receivers, samples)"
        )
    with np.errstate(over="ignore"):
        frames = frames.astype(np.complex64)
    if not np.isfinite(frames).all():
        raise InputError("samples hold NaN, or values too large for float32; correct or leave out their frames")
    rows = np.stack([np.real(frames), np.imag(frames)], axis=-2).reshape(-1, frames.shape[-1])
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        for start in range(0, len(rows), _ROWS):
            file.write(_text(rows[start : start + _ROWS]))


def _text(rows: np.ndarray) -> bytes:
    """Rows (n, N) float32 as lines of numbers; of whole ones, as radars record them, by a table: five times as fast."""
    told = np.any(rows != 0, axis=1)
    if not ((np.abs(rows) <= _MOST) & (np.rint(rows) == rows)).all():
        line, empty = (",".join([cell] * rows.shape[1]) + "\n" for cell in ("%.9g", "0"))
        lines = [line % tuple(row.tolist()) if one else empty for row, one in zip(rows, told, strict=True)]
        return "".join(lines).encode("ascii")
    whole = rows.astype(np.int64) + _MOST
    whole[np.signbit(rows) & (rows == 0) & told[:, np.newaxis]] = 2 * _MOST + 1  # -0, but where a row is empty
    cells, ends = _table()
    text = cells[whole]
    text[:, -1] = ends[whole[:, -1]]
    return text.tobytes().translate(None, b"\0")


@lru_cache(1)
def _table() -> tuple[np.ndarray, np.ndarray]:
    """Text of the whole numbers from -_MOST to _MOST and of -0, a comma or the end of a line after each, as eight
    bytes with zero bytes at their end."""
    numbers = [str(n) for n in range(-_MOST, _MOST + 1)] + ["-0"]
    cells, ends = (np.array([n + end for n in numbers], dtype="S8").view(np.int64) for end in (",", "\n"))
    return cells, ends


def _rows(file: BinaryIO, name: str, samples: int) -> Iterator[bytes]:
    """The rows of `samples` cells each; empty lines count only at the end. All rows of zeros are one object."""
    empty = 0
    longest, zeros = samples * _MAX_CELL, _zeros(samples)
    line_of_zeros = zeros + b"\n"
    for i in range(1, 1 << 62):
        line = file.readline(longest + 1)
        if not line:
            return
        if line == line_of_zeros and not empty:
            yield zeros
            continue
        row = line.strip().removeprefix(b"\xef\xbb\xbf").removesuffix(b",")
        if not row:
            empty = empty or i
            continue
        if empty:
            raise DamagedFileError(f"{name} line {empty} is empty; expected a row of {samples} numbers")
        cells = row.count(b",") + 1
        if cells != samples or len(line) > longest:
            found = f"{cells} cells" if cells != samples else f"more than {longest} characters"
            raise DamagedFileError(
                f"{name} line {i} has {found}; expected {samples} numbers and commas between: the line was cut off, "
                "or samples is wrong"
            )
        yield row


@lru_cache(16)
def _zeros(samples: int) -> bytes:
    """A row of zeros, of which files that were filled up have many."""
    return b",".join([b"0"] * samples)


def _numbers(rows: list[bytes], name: str, before: int) -> np.ndarray:
    """(rows, N) float32 of rows that have the right number of cells; `before` rows precede them in the file."""
    samples = rows[0].count(b",") + 1
    filled = np.array([row is not _zeros(samples) for row in rows])
    values = np.zeros((len(rows), samples), np.float32)
    if not filled.any():
        return values
    told = [row for row, one in zip(rows, filled, strict=True) if one]
    try:
        with np.errstate(over="ignore"):
            read = np.loadtxt(told, delimiter=",", dtype=np.float32, comments=None, ndmin=2, encoding="latin-1")
        if read.shape[0] == len(told) and np.isfinite(read).all():
            values[filled] = read
            return values
    except (ValueError, OverflowError):
        pass
    for i, row in enumerate(rows):
        for j, cell in enumerate(row.split(b",")):
            try:
                with np.errstate(over="ignore"):
                    fine = bool(np.isfinite(np.float32(cell.decode("latin-1"))))
            except ValueError:
                fine = False
            if not fine:
                text = cell.strip()[:_MAX_CELL].decode("latin-1")
                raise FormatError(f"{name} line {before + i + 1}, cell {j + 1} is {text!r}; expected a finite number")
    raise FormatError(f"{name} lines {before + 1} to {before + len(rows)} are not rows of numbers")


def _read(path: Path, **sizes: int) -> RawArray:
    raw = read_position2go(path, **sizes)
    return RawArray(values=raw.samples, lost=raw.lost)


RAW_FORMATS.add("position2go", RawFormat(suffixes=(".txt",), keys=("samples", "receivers", "chirps"), read=_read))
