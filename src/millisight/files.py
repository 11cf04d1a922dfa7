"""Writing files so that a reader never meets half of one.

Whoever writes a file writes it to a temporary name beside its place and renames it when it is whole: a full
disk, a read-only folder, or Ctrl-C in the middle leaves what was there before, and nothing else.
"""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from millisight.errors import FileError

FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
"""What figures are written as; here, so that the command line can refuse others before it loads Matplotlib."""


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any failure.

    The temporary name keeps the suffix, since libraries choose the format by it.

    Raises
    ------
    FileError
        The folder is missing or cannot be written to, or the disk is full.
    """
    path = Path(path)
    temporary = _claim(path)
    try:
        yield temporary
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror or error}; nothing was changed") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise before long work what `atomic_path` would raise after it.

    Raises
    ------
    FileError
        The folder is missing or cannot be written to.
    """
    _claim(path).unlink()


def _claim(path: str | os.PathLike[str]) -> Path:
    """Create an empty temporary file beside `path`: a plain error now rather than a library's own later."""
    path = Path(path)
    if os.path.isdir(path):
        raise FileError(f"{path} is a folder; expected the name of a file to write")
    if not os.path.isdir(path.parent):
        raise FileError(f"cannot write {path}: there is no folder {path.parent}; make it first, or choose another")
    temporary = path.with_name(f".{path.stem[:100]}.{secrets.token_hex(4)}.part{path.suffix}")
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}; choose another folder or free this one") from error
    return temporary


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` to `path` as UTF-8, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def make_folder(path: str | os.PathLike[str]) -> Path:
    """The folder `path`, made with its parents where it is missing.

    Raises
    ------
    FileError
        It cannot be made, or a file is in its place.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {path}: {error.strerror}; choose another name") from error
    return Path(path)
