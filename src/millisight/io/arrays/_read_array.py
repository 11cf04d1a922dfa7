"""One array of a file of any kind, by its suffix."""

from pathlib import Path

import numpy as np

from millisight.core import check_known, printable
from millisight.core.errors import FormatError
from millisight.io.arrays._arrays import read_arrays
from millisight.io.arrays._pickles import read_pickle
from millisight.io.arrays._text_table import TEXT_SUFFIXES, read_table
from millisight.io.arrays._touchstone import is_touchstone, read_touchstone

_PICKLES = (".pkl", ".pickle")


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
