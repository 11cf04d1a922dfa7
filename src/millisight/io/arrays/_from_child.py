"""Arrays of HDF5 and MATLAB files, read by a process of their own.

The libraries can crash, hang or exhaust the memory on a damaged file. A child process with limits takes that blow: it
follows no link out of the file, hands over the arrays' bytes, and whatever becomes of it is an error here.
"""

import json
from collections.abc import Iterable
from typing import Any

from millisight.io._children import child, failure
from millisight.io.arrays._entry import Entry, array_of_bytes, checked_shape, in_array, plain_dtype

_LONGEST_LINE = 1 << 24


def child_entries(path: Any, names: Iterable[str] | None, limit: int) -> dict[str, Entry]:
    """The arrays of a file by name: "group/data", or "data.frames" where MATLAB wrote it, in its order of axes.

    Those in `names`, by default all, are read at once, in all at most `limit` bytes: ValueError if it unpacks to more.
    """
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
