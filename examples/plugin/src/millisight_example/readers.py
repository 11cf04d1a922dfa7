"""A raw format: files that begin with "CNT1" and three sizes, then hold I and Q of each sample as int16."""

import os
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.io.raw import RawArray, RawFormat

_MAGIC, _HEAD = b"CNT1", 16


def read_counts(path: Path) -> RawArray:
    """The frames (F, R, N) of a file, as recorded.

    Raises
    ------
    FileError
        It cannot be read, is none of these, or ends too early.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ms.errors.FileError(f"cannot read {path.name}: {error.strerror}") from error
    if not data.startswith(_MAGIC) or len(data) < _HEAD:
        raise ms.errors.FormatError(f"{path.name} starts with {data[:4]!r}; expected {_MAGIC!r} and three sizes")
    shape = tuple(np.frombuffer(data, "<u4", 3, len(_MAGIC)).tolist())
    wanted = _HEAD + 4 * int(np.prod(shape))
    if len(data) != wanted:
        raise ms.errors.DamagedFileError(
            f"{path.name} has {len(data)} bytes; expected {wanted} for frames of shape {shape}"
        )
    counts = np.frombuffer(data, "<i2", offset=_HEAD).astype(np.float32)
    return RawArray(values=counts.view(np.complex64).reshape(shape))


def write_counts(path: str | os.PathLike[str], frames: np.ndarray) -> None:
    """Write frames (F, R, N), rounded to whole numbers."""
    counts = np.ascontiguousarray(frames, dtype=np.complex128).view(np.float64)
    Path(path).write_bytes(_MAGIC + np.array(frames.shape, "<u4").tobytes() + np.round(counts).astype("<i2").tobytes())


counts = RawFormat(suffixes=(".counts",), keys=(), read=read_counts, axes=("pose", "rx", "sample"))
