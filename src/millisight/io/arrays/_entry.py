"""One array of a file, and the checks that every reader of arrays shares.

What an array claims to be is held against the bytes that are there before memory is asked for; what is compressed may
unpack to a stated size and no further.
"""

import math
import re
import zipfile
import zlib
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from millisight.core import limits_of
from millisight.core.errors import FormatError

DAMAGE = (ValueError, LookupError, TypeError, ArithmeticError, EOFError, zlib.error, zipfile.BadZipFile)
_PLAIN_DTYPE = re.compile(r"[<>|=]?(?:\?|b1|[iu][1248]|f[248]|c(?:8|16)|[SU][1-9]\d{0,5})")
_MOST_DIMENSIONS = 32


class Entry(NamedTuple):
    """One array of a file, not read yet; `refusal` says what it is instead, where it is no array that can be read."""

    shape: tuple[int, ...] = ()
    read: Callable[[], np.ndarray] = lambda: np.empty(0)
    refusal: str = ""


def plain_dtype(text: Any) -> np.dtype:
    """The type of NumPy's short name, such as "<f8": numbers, booleans and text; ValueError for objects."""
    if not isinstance(text, str) or not _PLAIN_DTYPE.fullmatch(text):
        objects = " (Python objects, which are never read)" if isinstance(text, str) and "O" in text else ""
        raise ValueError(f"its type is {_shown(text)!r}{objects}; expected numbers, booleans or text")
    return np.dtype(text)


def checked_shape(shape: Any) -> tuple[int, ...]:
    """`shape` if it is a tuple of at most 32 whole numbers that are not negative; else a ValueError."""
    if not isinstance(shape, tuple) or not all(type(n) is int and 0 <= n < 1 << 62 for n in shape):
        raise ValueError(f"its shape is {_shown(shape)}; expected whole numbers that are not negative")
    if len(shape) > _MOST_DIMENSIONS:
        raise ValueError(f"it has {len(shape)} dimensions; expected at most {_MOST_DIMENSIONS}")
    return shape


def _shown(value: Any) -> str:
    """A value for a message; of containers that are nested a thousand deep Python makes no text."""
    try:
        return str(value)[:80]
    except RecursionError:
        return f"a {type(value).__name__} nested too deep"


def array_of_bytes(data: Any, dtype: np.dtype, shape: tuple[int, ...], *, fortran: bool = False) -> np.ndarray:
    """A read-only array on `data`; ValueError if it holds more or fewer bytes than it should, or invalid ones."""
    expected = math.prod(shape) * dtype.itemsize
    if len(data) != expected:
        raise ValueError(f"an array {dtype} {shape} has {expected} bytes, and {len(data)} are there")
    flat = np.frombuffer(data, dtype)
    if dtype.kind == "b":
        flat = flat.view(np.uint8) != 0  # any other byte than 0 and 1 would be a third truth value
    elif dtype.kind == "U" and flat.size and flat.view(dtype.byteorder + "u4").max() > 0x10FFFF:
        raise ValueError("its text holds invalid characters")
    array = flat.reshape(shape, order="F" if fortran else "C")
    array.flags.writeable = False
    return array


def unpacked_limit(size: int, max_bytes: int | None) -> int:
    """How many bytes a compressed file of `size` bytes may unpack to."""
    return limits_of(size).unpacked if max_bytes is None else max_bytes


def too_large(size: int, limit: int) -> FormatError:
    """The error for what would unpack to more than `unpacked_limit`."""
    return FormatError(
        f"it would unpack to {size} bytes or more, over the limit of {limit}; if the file can be trusted, pass a "
        "larger max_bytes, or save it uncompressed"
    )


@contextmanager
def in_array(name: str, place: str = ""):
    """Whatever is wrong within the block is wrong in the array `name`, found at `place`."""
    try:
        yield
    except DAMAGE as error:
        raise ValueError(f"array {name!r}{place}: {error}") from error
