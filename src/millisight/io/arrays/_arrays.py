"""Arrays in the files that NumPy, MATLAB and HDF5 write: `read_arrays`, and `array_shapes`, which reads no values.

`read_array` reads one array of a file of any kind, a text or a pickle too.

Files come from strangers: nothing in them runs, and none can take more memory than it states.
"""

import errno
import os
from collections.abc import Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, check_readable, printable
from millisight.core.errors import DamagedFileError, FileError, FormatError, UnknownNameError
from millisight.io.arrays._entry import DAMAGE, Entry, in_array, unpacked_limit
from millisight.io.arrays._from_child import child_entries
from millisight.io.arrays._npy import NPY, npy_entries, npz_entries
from millisight.io.arrays._pickles import read_pickle
from millisight.io.arrays._text_table import TEXT_SUFFIXES, read_table
from millisight.io.arrays._touchstone import is_touchstone, read_touchstone

_HDF5, _ZIP = b"\x89HDF\r\n\x1a\n", (b"PK\x03\x04", b"PK\x05\x06")
_PICKLES = (".pkl", ".pickle")


def read_arrays(
    path: str | os.PathLike[str],
    *,
    names: Iterable[str] | None = None,
    max_bytes: int | None = None,
    finite: bool = True,
) -> dict[str, np.ndarray]:
    """Read the arrays of a file, by name; the format is found from the content, not the suffix.

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
            check_known(f"array in {printable(path)}:", name, entries)
            if entries[name].refusal:
                raise FormatError(f"array {name!r} is {entries[name].refusal}")
            with in_array(name):
                arrays[name] = entries[name].read()
            if finite:
                _check_finite(arrays[name], name)
        return arrays


def array_shapes(path: str | os.PathLike[str], *, max_bytes: int | None = None) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays of a file, by name, without reading values; entries that are not arrays are left out.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `read_arrays`.
    """
    path = check_readable(path)
    with _naming(path):
        return {name: entry.shape for name, entry in _entries(path, [], max_bytes).items() if not entry.refusal}


@contextmanager
def _naming(path: Any):
    """Errors within the block name the file; whatever a reader stumbles over is a damaged file."""
    name = printable(path)
    try:
        yield
    except (DamagedFileError, FormatError) as error:
        raise error.at(name) from error
    except UnknownNameError:
        raise
    except OSError as error:
        if error.errno == errno.EINVAL:  # a place before the file's start, say
            raise DamagedFileError(f"{name} is damaged: {error}; copy or make it again") from error
        raise FileError(f"cannot read {name}: {error.strerror or error}") from error
    except DAMAGE as error:
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
            "correct them"
        )


def _entries(path: Any, names: list[str] | None, max_bytes: int | None) -> dict[str, Entry]:
    """The arrays of a file, by name; of `names` alone, None for all, values will be asked for."""
    size = os.path.getsize(path)
    limit = unpacked_limit(size, max_bytes)
    with open(path, "rb") as file:
        start = file.read(128)
    if not start:
        raise DamagedFileError("the file is empty")
    if start.startswith(NPY):
        return npy_entries(path, size)
    if start.startswith(_ZIP):
        return npz_entries(path, size, limit)
    if start[124:128] in (b"\0\1IM", b"\1\0MI") or start.startswith((b"MATLAB 7.3", _HDF5)):
        return child_entries(path, names, limit)
    raise FormatError(f"it starts with {start[:8]!r}; expected a .npy, .npz, MATLAB .mat (5 or 7.3) or HDF5 file")


def read_array(path: Path, name: str | None = None, *, skip_rows: int = 0, decimal: str | None = None) -> np.ndarray:
    """The array called `name` in a file, or the only one there: arrays, a pickle, a text of numbers, or Touchstone.

    Parameters
    ----------
    skip_rows, decimal : of a text: see `read_table`

    Raises
    ------
    FileError, UnknownNameError
    """
    suffix = path.suffix.lower()
    if suffix in TEXT_SUFFIXES:
        arrays = {"0": read_table(path, skip_rows=skip_rows, decimal=decimal).values}
    elif is_touchstone(path):
        arrays = read_touchstone(path)
    elif suffix in _PICKLES:
        found = read_pickle(path)
        arrays = found if isinstance(found, dict) else {"0": found}
        arrays = {str(key): value for key, value in arrays.items() if isinstance(value, np.ndarray)}
    else:
        arrays = read_arrays(path, names=None if name is None else [name])
    if name is None and len(arrays) != 1:
        raise FormatError(f"{printable(path)} holds the arrays {', '.join(arrays)}; choose one with the key array")
    if name is not None:
        check_known(f"array in {printable(path)}:", name, arrays)
    return arrays[next(iter(arrays)) if name is None else name]
