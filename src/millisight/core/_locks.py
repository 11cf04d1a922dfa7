"""Locks that go with the process that holds them, so that none is ever left behind."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from millisight.core.errors import FileError

LOCK_NAME = ".lock"


@contextmanager
def alone(folder: Path, name: str) -> Iterator[None]:
    """Hold the folder for a `with` block: any other run that asks for it is refused, and told whose it is.

    The lock is a file that names the process. It counts only while that process lives, and goes at the end; where the
    file system has no locks, nobody is refused.

    Parameters
    ----------
    folder : that exists
    name : of it, for the message

    Raises
    ------
    FileError
        Another run holds it, or no file can be written there.
    """
    path = folder / LOCK_NAME
    while True:
        try:
            file = open(path, "a+", encoding="utf-8")  # noqa: SIM115, held for the block
        except OSError as error:
            raise FileError(f"cannot write to {name}: {error.strerror}; make it writable, or choose another") from error
        try:
            if not held(file):
                file.seek(0)
                owner = file.read(20).strip()
                whose = f" (process {owner})" if owner.isdecimal() else ""
                raise FileError(f"another run{whose} is using {name}; wait for it, or stop it")
            if _is_at(file, path):
                file.truncate(0)
                file.write(f"{os.getpid()}\n")
                file.flush()
                try:
                    yield
                finally:
                    path.unlink(missing_ok=True)
                return
        finally:
            file.close()  # and with it the lock


def held(file: IO) -> bool:
    """Whether an open file could be locked for this process, until it is closed; True where there are no locks."""
    try:
        import fcntl
    except ImportError:  # Windows
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # this file system has none
        pass
    return True


def _is_at(file: IO, path: Path) -> bool:
    """Whether the open file is the one at `path` still: the run before may have removed it as it ended."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
