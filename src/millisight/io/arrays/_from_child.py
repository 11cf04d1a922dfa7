"""Arrays of HDF5 and MATLAB files, read by a process of their own.

The libraries can crash, hang or exhaust the memory on a damaged file. A child process with limits takes that blow: it
follows no link out of the file, hands over the arrays' bytes, and whatever becomes of it is an error here.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from threading import Timer
from typing import Any

from millisight.io.arrays._entry import Entry, array_of_bytes, checked_shape, in_array, plain_dtype

_SECONDS, _BYTES_PER_SECOND = 60, 20e6  # a child is given a minute, and what a slow disk needs on top
_LONGEST_LINE = 1 << 24


def child_entries(path: Any, names: Iterable[str] | None, limit: int) -> dict[str, Entry]:
    """The arrays of a file by name: "group/data", or "data.frames" where MATLAB wrote it, in its order of axes.

    Those in `names`, by default all, are read at once, in all at most `limit` bytes: ValueError if it unpacks to more.
    """
    wanted = None if names is None else list(names)
    command = [sys.executable, "-m", "millisight.io.arrays._child"]
    command += [os.path.abspath(path), str(limit), json.dumps(wanted)]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        timer = Timer(_SECONDS + os.path.getsize(path) / _BYTES_PER_SECOND, child.kill)
        timer.start()
        try:
            return _entries(child.stdout, limit)
        except EOFError as error:  # so the child has ended
            said = child.stderr.read(4096).decode("utf-8", "replace").strip() if child.stderr else ""
            raise ValueError(said if child.wait() == 1 and said else "the library that reads it fails") from error
        finally:
            timer.cancel()
            child.kill()


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
