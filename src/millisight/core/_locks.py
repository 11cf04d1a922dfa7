"""Locks that go with the process that holds them, so that none is ever left behind."""

import hashlib
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from millisight.core.errors import FileError

LOCK_NAME = ".millisight.lock"
_PAUSE = 0.05  # between looks at a lock that another process holds [s]


def private_folder(name: str) -> Path:
    """A temporary folder that stays from process to process, and into which nobody else can put files.

    Raises
    ------
    OSError
        There is none, or somebody else's is in its place.
    """
    user = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(tempfile.gettempdir(), name if user is None else f"{name}-{user}")
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    private = user is None or (found.st_uid == user and not found.st_mode & 0o077)
    if not stat.S_ISDIR(found.st_mode) or not private:
        raise PermissionError(f"{folder} is not a folder of this user alone")
    return folder


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
    with _locked(folder / LOCK_NAME, name):
        yield


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Hold the name of a file for a `with` block: another run of this user that asks for it is refused.

    The lock lies in a temporary folder: beside the file, a run that was killed would leave it behind. Where nothing can
    be written there, and of what is no regular file, nobody is refused.

    Raises
    ------
    FileError
        Another run holds it.
    """
    lock = None
    with suppress(OSError):
        if path.is_file() or not path.exists():
            lock = _lock_of(path.resolve())
    if lock is None:
        yield
        return
    with _locked(lock, path.name):
        yield


def _lock_of(name: str | Path) -> Path:
    """The lock of a name, of this user; OSError where nothing can be written."""
    lock = private_folder("millisight-locks") / hashlib.sha256(os.fsencode(name)).hexdigest()[:32]
    open(lock, "a", encoding="utf-8").close()
    return lock


@contextmanager
def one_at_a_time(name: str, *, seconds: float) -> Iterator[None]:
    """Wait until no other process of this user is in a `with` block of this name, but no longer than that.

    Where nothing can be locked, nobody waits.
    """
    end = time.monotonic() + seconds
    try:
        lock = _lock_of(name)
        file = open(lock, "a", encoding="utf-8", opener=_no_link)  # noqa: SIM115
        while not (free := held(file) and _is_at(file, lock)) and time.monotonic() < end:
            file.close()
            time.sleep(_PAUSE)
            file = open(lock, "a", encoding="utf-8", opener=_no_link)  # noqa: SIM115
    except OSError:
        yield
        return
    try:
        yield
    finally:
        if free:
            lock.unlink(missing_ok=True)
        file.close()  # and with it the lock


@contextmanager
def _locked(path: Path, name: str) -> Iterator[None]:
    """Hold the lock at `path`, of what is called `name`, for a `with` block."""
    while True:
        try:
            # held for the block; a link would lead to another's file, which is truncated below
            file = open(path, "a+", encoding="utf-8", opener=_no_link)  # noqa: SIM115
        except OSError as error:
            why = error.strerror or error
            raise FileError(f"cannot write to {name}: {why}; make it writable, or choose another") from error
        try:
            if not held(file):
                file.seek(0)
                owner = file.read(20).strip()
                whose = f" (process {owner})" if owner.isdecimal() else ""
                raise FileError(f"another run{whose} is using {name}; wait for it, or stop it")
            if _is_at(file, path):
                with suppress(OSError):  # on a full disk the lock holds as well, without a name
                    file.truncate(0)
                    os.write(file.fileno(), f"{os.getpid()}\n".encode())
                try:
                    yield
                finally:
                    path.unlink(missing_ok=True)
                return
        finally:
            file.close()  # and with it the lock


def _no_link(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


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
