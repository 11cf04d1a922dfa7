"""Arrays of HDF5 and MATLAB files, read by a process of their own.

The libraries can crash, hang or exhaust the memory on a damaged file. A child process with limits takes that blow: it
follows no link out of the file, hands over the arrays' bytes, and whatever becomes of it is an error here.
"""

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from millisight.io._children import CRASHED, child, failure
from millisight.io.arrays._entry import Entry, array_of_bytes, checked_shape, in_array, plain_dtype

_LONGEST_LINE = 1 << 24
_SMALL = 1 << 23  # bytes of a file that is kept, which unpacks to a hundred times as many at most

_KEPT: ContextVar[dict[tuple[int, ...], dict[str, Entry]] | None] = ContextVar("_KEPT", default=None)


@contextmanager
def small_files_kept() -> Iterator[None]:
    """Within the block a small file is read once, with all its arrays: it takes a process longer to start than to read.

    What is kept is let go at its end.
    """
    token = _KEPT.set({})
    try:
        yield
    finally:
        _KEPT.reset(token)


def child_entries(path: Any, names: Iterable[str] | None, limit: int) -> dict[str, Entry]:
    """The arrays of a file by name: "group/data", or "data.frames" where MATLAB wrote it, in its order of axes.

    Those in `names`, by default all, are read at once, in all at most `limit` bytes: ValueError if it unpacks to more.
    """
    kept, about = _KEPT.get(), os.stat(path)
    if kept is None or about.st_size > _SMALL:
        return _read(path, names, limit)
    key = (about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, limit)
    if key not in kept:
        try:
            kept[key] = _read(path, None, limit)
        except ValueError as error:
            if str(error) == CRASHED:
                raise
            return _read(path, names, limit)  # it may be another array that is damaged, or that is too much
    return kept[key]


def _read(path: Any, names: Iterable[str] | None, limit: int) -> dict[str, Entry]:
    wanted = None if names is None else list(names)
    with child("millisight.io.arrays._child", str(limit), json.dumps(wanted), path=path) as process:
        try:
            return _entries(process.stdout, limit)
        except EOFError as error:  # so the child has ended
            raise ValueError(failure(process)) from error


def _entries(output: Any, limit: int) -> dict[str, Entry]:
    """What the child tells of each array, and the bytes it sends after that."""
    line = output.readline(_LONGEST_LINE)
    if not line.endswith(b"\n"):
        raise EOFError
    entries: dict[str, Entry] = {}
    for told in json.loads(line):
        shape = checked_shape(tuple(told["shape"]))
        entries[told["name"]] = Entry(shape, refusal=told["refusal"])
        if told["sent"]:
            with in_array(told["name"]):
                dtype = plain_dtype(told["dtype"])
            if not 0 <= told["bytes"] <= limit:
                raise ValueError(f"{told['bytes']} bytes are over the limit of {limit}")
            data = output.read(told["bytes"])
            if len(data) < told["bytes"]:
                raise EOFError
            # MATLAB's axes come in reverse: the same bytes, run through down the columns.
            array = array_of_bytes(data, dtype, shape, fortran=told["matlab"])
            entries[told["name"]] = Entry(shape, lambda array=array: array)
    return entries
