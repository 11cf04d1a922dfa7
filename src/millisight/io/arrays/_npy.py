"""Arrays of NumPy's own files, .npy and .npz; nothing in them is unpickled."""

import ast
import math
import os
import zipfile
from functools import partial
from typing import IO, Any, NamedTuple

import numpy as np

from millisight.io.arrays._entry import Entry, array_of_bytes, checked_shape, in_array, plain_dtype, too_large

_LARGEST_HEADER = 4096  # of a .npy file, in characters; 32 dimensions fit into a quarter of it
NPY = b"\x93NUMPY"


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
    """The header of the array that starts where `file` stands; ValueError if it is none, or reaches beyond `size`."""
    magic = file.read(8)
    if len(magic) < 8 or not magic.startswith(NPY) or magic[6] not in (1, 2, 3):
        raise ValueError(f"it starts with {magic!r}; expected {NPY!r} and a version from 1 to 3")
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


def npy_entries(path: Any, size: int) -> dict[str, Entry]:
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


def npz_entries(path: Any, size: int, limit: int) -> dict[str, Entry]:
    """The arrays of an archive that `numpy.savez` or `savez_compressed` wrote."""
    entries: dict[str, Entry] = {}
    # Open for as long as an entry is there: to open it anew for each takes time that grows with their square.
    archive = zipfile.ZipFile(path)
    members = [info for info in archive.infolist() if not info.is_dir()]
    total = sum(info.file_size for info in members)
    if sum(info.compress_size for info in members) > size:
        raise ValueError("its members overlap: it claims more than it holds")
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
            entries[name] = Entry(header.shape, partial(_npz_array, archive, info), header.refusal)
    return entries


def _npz_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(info) as file:
        return _npy_header(file, info.file_size).array(file)
