"""Readers' child processes as forks of the fuzzer: the same module on the same file, without a start of Python.

A start takes a quarter of a second, so that few files would be read; a fork takes some milliseconds.
"""

import contextlib
import os
import runpy
import signal
import subprocess
import sys
from types import SimpleNamespace
from typing import Any
from unittest import mock

from millisight.io import _children


class Forked:
    """What `millisight.io._children.child` asks of `subprocess.Popen`."""

    def __init__(self, command: list[str], **_: Any):
        module, words = command[command.index("-m") + 1], command[command.index("-m") + 2 :]
        pipes = [os.pipe() for _ in range(2)]
        self.pid, self.returncode = os.fork(), None
        if not self.pid:
            _work(module, words, [ends[1] for ends in pipes])
        for _, end in pipes:
            os.close(end)
        self.stdout, self.stderr = (os.fdopen(ends[0], "rb") for ends in pipes)

    def wait(self) -> int:
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode

    def kill(self) -> None:
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)

    def __enter__(self) -> "Forked":
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.stderr.close()
        self.wait()


def _work(module: str, words: list[str], ends: list[int]) -> None:
    """Run a module as the program of this process, and end it."""
    code = 70
    try:
        for kind in (signal.SIGPROF, signal.SIGALRM):
            signal.signal(kind, signal.SIG_DFL)
        os.dup2(ends[0], 1)
        os.dup2(ends[1], 2)
        # Whatever the fuzzer or pytest put in their place stays behind.
        with (
            open(1, "w", closefd=False) as out,
            open(2, "w", closefd=False) as error,
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(error),
            mock.patch("sys.argv", [module, *words]),
        ):
            code = _code_of(module)
    finally:
        os._exit(code)


def _code_of(module: str) -> int:
    """Run a module as a program; what it ends with, as Python would end."""
    try:
        runpy.run_module(module, run_name="__main__")
    except SystemExit as end:
        if isinstance(end.code, str):
            sys.stderr.write(end.code)
        return int(isinstance(end.code, str)) or int(end.code or 0)
    return 0


def forked() -> Any:
    """Within the block, readers fork."""
    named = SimpleNamespace(Popen=Forked, DEVNULL=subprocess.DEVNULL, PIPE=subprocess.PIPE)
    return mock.patch.object(_children, "subprocess", named)
