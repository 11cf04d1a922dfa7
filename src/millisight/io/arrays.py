"""Arrays in the files that NumPy, MATLAB and HDF5 write: `read_arrays`, and `array_shapes`, which reads no values.

Files come from strangers. Nothing in them is ever unpickled; what an array claims to be is held against the bytes
that are there before memory is asked for; what is compressed may unpack to a stated size and no further.
"""

import ast
import errno
import math
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from functools import partial
from typing import IO, Any, NamedTuple

import numpy as np

from millisight.errors import DamagedFileError, FileError, FormatError, UnknownNameError
from millisight.files import check_readable, printable

_PLAIN_DTYPE = re.compile(r"[<>|=]?(?:\?|b1|[iu][1248]|f[248]|c(?:8|16)|[SU][1-9]\d{0,5})")
_MOST_DIMENSIONS = 32
_LARGEST_HEADER = 4096  # of a .npy file, in characters; 32 dimensions fit into a quarter of it
_RATIO, _LEAST_LIMIT = 100, 1 << 26
_DAMAGE = (ValueError, LookupError, TypeError, ArithmeticError, EOFError, zlib.error, zipfile.BadZipFile)
_NPY, _HDF5, _ZIP = b"\x93NUMPY", b"\x89HDF\r\n\x1a\n", (b"PK\x03\x04", b"PK\x05\x06")


class Entry(NamedTuple):
    """One array of a file, not read yet; `refusal` says what it is instead, where it is no array that can be read."""

    shape: tuple[int, ...] = ()
    read: Callable[[], np.ndarray] = lambda: np.empty(0)
    refusal: str = ""


def read_arrays(
    path: str | os.PathLike[str],
    *,
    names: Iterable[str] | None = None,
    max_bytes: int | None = None,
    finite: bool = True,
) -> dict[str, np.ndarray]:
    """The arrays of a file, by name; its content says the format, whatever its suffix.

    - `.npy`: "0", and "1", "2", ... where several arrays follow one another in the file
    - `.npz`: as saved
    - MATLAB `.mat`, version 5 and 7.3: the variables with MATLAB's order of axes; fields of structures as "data.frames"
    - HDF5: the data sets, as "group/data"

    Parameters
    ----------
    path : the file
    names : read these alone; by default every array of numbers or text, leaving out what is no array (cells, objects)
    max_bytes : what a compressed file may unpack to; by default a hundred times its size, at least 64 MiB
    finite : refuse arrays without entries, and NaN and infinite values

    Returns
    -------
    dict of read-only arrays, of the type and byte order of the file.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It is of no known format, holds no arrays, unpacks to more than `max_bytes`, or an array asked for is of a
        kind that is not read.
    DamagedFileError
        It is truncated or damaged, or an array is empty or holds NaN.
    UnknownNameError
        There is no array of that name.
    """
    path = check_readable(path)
    with _naming(path):
        wanted = None if names is None else list(names)
        entries = _entries(path, wanted, max_bytes)
        if wanted is None:
            wanted = [name for name, entry in entries.items() if not entry.refusal]
            if not wanted:
                refused = "; ".join(f"{name!r} is {entry.refusal}" for name, entry in entries.items())
                raise FormatError(f"it holds no arrays of numbers; {refused or 'it is empty'}")
        arrays = {}
        for name in wanted:
            if name not in entries:
                raise UnknownNameError(f"array in {printable(path)}:", name, entries)
            if entries[name].refusal:
                raise FormatError(f"array {name!r} is {entries[name].refusal}")
            with in_array(name):
                arrays[name] = entries[name].read()
            if finite:
                _check_finite(arrays[name], name)
        return arrays


def array_shapes(path: str | os.PathLike[str], *, max_bytes: int | None = None) -> dict[str, tuple[int, ...]]:
    """The shapes of a file's arrays, by name, their values unread; what is no array is left out.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `read_arrays`.
    """
    path = check_readable(path)
    with _naming(path):
        return {name: entry.shape for name, entry in _entries(path, [], max_bytes).items() if not entry.refusal}


def plain_dtype(text: Any) -> np.dtype:
    """The type that NumPy's short name, such as "<f8", stands for: numbers, booleans and text, never objects.

    Raises
    ------
    ValueError
        It is another one.
    """
    if not isinstance(text, str) or not _PLAIN_DTYPE.fullmatch(text):
        objects = " (Python objects, which are never read)" if isinstance(text, str) and "O" in text else ""
        raise ValueError(f"its type is {str(text)[:80]!r}{objects}; expected numbers, booleans or text")
    return np.dtype(text)


def checked_shape(shape: Any) -> tuple[int, ...]:
    """`shape`, which must be a tuple of at most 32 whole numbers that are not negative.

    Raises
    ------
    ValueError
    """
    if not isinstance(shape, tuple) or not all(type(n) is int and 0 <= n < 1 << 62 for n in shape):
        raise ValueError(f"its shape is {str(shape)[:80]}; expected whole numbers that are not negative")
    if len(shape) > _MOST_DIMENSIONS:
        raise ValueError(f"it has {len(shape)} dimensions; expected at most {_MOST_DIMENSIONS}")
    return shape


def array_of_bytes(data: Any, dtype: np.dtype, shape: tuple[int, ...], *, fortran: bool = False) -> np.ndarray:
    """A read-only array on `data`, which must hold as many bytes as the type and shape say.

    Raises
    ------
    ValueError
        It holds more or fewer, or bytes that stand for no value of the type.
    """
    expected = math.prod(shape) * dtype.itemsize
    if len(data) != expected:
        raise ValueError(f"an array {dtype} {shape} has {expected} bytes, and {len(data)} are there")
    flat = np.frombuffer(data, dtype)
    if dtype.kind == "b":
        flat = flat.view(np.uint8) != 0  # any other byte than 0 and 1 would be a third truth value
    elif dtype.kind == "U" and flat.size and flat.view(dtype.byteorder + "u4").max() > 0x10FFFF:
        raise ValueError("its text holds what is no character")
    array = flat.reshape(shape, order="F" if fortran else "C")
    array.flags.writeable = False
    return array


def unpacked_limit(size: int, max_bytes: int | None) -> int:
    """How many bytes a compressed file of `size` bytes may unpack to."""
    return max(_RATIO * size, _LEAST_LIMIT) if max_bytes is None else max_bytes


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
    except _DAMAGE as error:
        raise ValueError(f"array {name!r}{place}: {error}") from error


@contextmanager
def _naming(path: Any):
    """Errors within the block name the file; whatever a reader stumbles over is a damaged file."""
    name = printable(path)
    try:
        yield
    except (DamagedFileError, FormatError) as error:
        raise type(error)(f"{name}: {error}") from error
    except UnknownNameError:
        raise
    except OSError as error:
        if error.errno == errno.EINVAL:  # a place before the file's start, say
            raise DamagedFileError(f"{name} is damaged: {error}; copy or make it again") from error
        raise FileError(f"cannot read {name}: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise DamagedFileError(f"{name} is damaged: {error}; copy or make it again") from error
    except RuntimeError as error:  # zipfile's for an encrypted archive, or one of an unknown kind
        raise FormatError(f"{name}: {error}") from error


def _check_finite(array: np.ndarray, name: str) -> None:
    if not array.size:
        raise DamagedFileError(f"array {name!r} is empty, of shape {array.shape}")
    if array.dtype.kind in "fc" and not np.isfinite(array).all():
        bad = ~np.isfinite(array)
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise DamagedFileError(
            f"array {name!r} has {int(bad.sum())} values that are NaN or infinite, the first at {first}; remove or "
            "mend them"
        )


def _entries(path: Any, names: list[str] | None, max_bytes: int | None) -> dict[str, Entry]:
    """The arrays of a file, by name; of `names` alone, None for all, values will be asked for."""
    size = os.path.getsize(path)
    limit = unpacked_limit(size, max_bytes)
    with open(path, "rb") as file:
        start = file.read(128)
    if not start:
        raise DamagedFileError("the file is empty")
    if start.startswith(_NPY):
        return _npy_entries(path, size)
    if start.startswith(_ZIP):
        return _npz_entries(path, limit)
    if start[124:128] in (b"\0\1IM", b"\1\0MI"):
        from millisight.io.matlab import matlab_entries

        return matlab_entries(path, limit)
    if start.startswith((b"MATLAB 7.3", _HDF5)):
        from millisight.io.hdf5_arrays import hdf5_entries

        return hdf5_entries(path, names, limit)
    raise FormatError(f"it starts with {start[:8]!r}; expected a .npy, .npz, MATLAB .mat (5 or 7.3) or HDF5 file")


class _Header(NamedTuple):
    """What a .npy header says of the bytes that follow it; `refusal` where they are not read."""

    shape: tuple[int, ...]
    dtype: np.dtype = np.dtype("V")
    fortran: bool = False
    refusal: str = ""

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    def array(self, file: IO[bytes]) -> np.ndarray:
        return array_of_bytes(file.read(self.nbytes), self.dtype, self.shape, fortran=self.fortran)


def _npy_header(file: IO[bytes], size: int) -> _Header:
    """The header of the array that starts where `file` stands, in `size` bytes in all.

    Raises
    ------
    ValueError
        It is no header, or its array would reach beyond `size`.
    """
    magic = file.read(8)
    if len(magic) < 8 or not magic.startswith(_NPY) or magic[6] not in (1, 2, 3):
        raise ValueError(f"it starts with {magic!r}; expected {_NPY!r} and a version from 1 to 3")
    length = int.from_bytes(file.read(2 if magic[6] == 1 else 4), "little")
    if length > _LARGEST_HEADER:
        raise ValueError(f"its header claims {length} bytes; expected at most {_LARGEST_HEADER}")
    text = file.read(length)
    try:
        header = ast.literal_eval(text.decode("utf-8" if magic[6] == 3 else "latin-1").strip())
        if set(header) != {"descr", "fortran_order", "shape"}:
            raise ValueError("expected descr, fortran_order and shape")
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
        raise ValueError(f"its header {text[:60]!r} cannot be read: {error}") from error
    shape = checked_shape(header["shape"])
    try:
        found = _Header(shape, plain_dtype(header["descr"]), bool(header["fortran_order"]))
    except ValueError as error:
        return _Header(shape, refusal=f"not read: {error}")
    there = size - file.tell()
    if found.nbytes > there:
        raise ValueError(f"its {found.dtype} {shape} take {found.nbytes} bytes, and {there} are left: truncated")
    return found


def _npy_entries(path: Any, size: int) -> dict[str, Entry]:
    """The arrays that follow one another in a .npy file, as several `numpy.save` to one open file leave them."""
    entries: dict[str, Entry] = {}
    with open(path, "rb") as file:
        while file.tell() < size:
            name = str(len(entries))
            with in_array(name, f" from byte {file.tell()} on"):
                header = _npy_header(file, size)
            entries[name] = Entry(header.shape, partial(_npy_array, path, file.tell(), header), header.refusal)
            if header.refusal:
                break  # where the next one starts is not known
            file.seek(header.nbytes, os.SEEK_CUR)
    return entries


def _npy_array(path: Any, start: int, header: _Header) -> np.ndarray:
    with open(path, "rb") as file:
        file.seek(start)
        return header.array(file)


def _npz_entries(path: Any, limit: int) -> dict[str, Entry]:
    """The arrays of an archive that `numpy.savez` or `savez_compressed` wrote."""
    entries: dict[str, Entry] = {}
    with zipfile.ZipFile(path) as archive:
        members = [info for info in archive.infolist() if not info.is_dir()]
        total = sum(info.file_size for info in members)
        if any(info.compress_type != zipfile.ZIP_STORED for info in members) and total > limit:
            raise too_large(total, limit)
        for info in members:
            name = info.filename.removesuffix(".npy")
            if name in entries:
                raise ValueError(f"it holds two arrays of the name {name!r}")
            if name == info.filename:
                entries[name] = Entry(refusal="no array, but another file in the archive")
            elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                entries[name] = Entry(refusal="compressed in a way that NumPy does not write")
            else:
                with in_array(name), archive.open(info) as file:
                    header = _npy_header(file, info.file_size)
                entries[name] = Entry(header.shape, partial(_npz_array, path, info), header.refusal)
    return entries


def _npz_array(path: Any, info: zipfile.ZipInfo) -> np.ndarray:
    with zipfile.ZipFile(path) as archive, archive.open(info) as file:
        return _npy_header(file, info.file_size).array(file)
