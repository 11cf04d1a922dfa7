"""Processes of ours that read for us what a library may crash, hang, or exhaust the memory on."""

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer
from typing import Any

from millisight.core import limits_of

CRASHED = "the library that reads it fails"
_OVERHEAD = 2 << 30  # of the libraries' own address space [bytes]
_PROCESSOR = 5.0, 5e7  # time of a small file [s], and bytes a second beyond: a library that hangs computes in vain


@contextmanager
def child(module: str, *arguments: str, path: str | os.PathLike[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that runs a module of millisight on the file `path`, killed when its time is up or the block ends.

    Its time is that of `limits_of`: a minute, and as long again as a slow disk needs to read the file.
    """
    # -P: else a file of the present folder with the name of a module, numpy.py say, would be run.
    command = [sys.executable, "-P", "-m", module, os.path.abspath(path), *arguments]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        timer = Timer(limits_of(os.path.getsize(path)).seconds, process.kill)
        timer.start()
        try:
            yield process
        finally:
            timer.cancel()
            process.kill()


def failure(process: Any) -> str:
    """Why a child ended that did not do its work, in its own words where it has any."""
    said = process.stderr.read(4096).decode("utf-8", "replace").strip()
    return said if process.wait() == 1 and said else CRASHED


def limit_process(most: int) -> None:
    """Let this process, a child that makes `most` bytes, take three times as many, and some seconds of processor time.

    It leaves no core behind.
    """
    try:
        import resource
    except ImportError:  # not on Windows
        return
    memory = _OVERHEAD + 3 * most
    processor = math.ceil(_PROCESSOR[0] + most / _PROCESSOR[1])
    for kind, limit in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, processor), (resource.RLIMIT_CORE, 0)):
        resource.setrlimit(kind, (limit, limit))
