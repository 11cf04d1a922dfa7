"""Writing files so that a reader never meets half of one.

Whoever writes a file writes it to a temporary name beside its place and renames it when it is whole: a full
disk, a read-only folder, or Ctrl-C in the middle leaves what was there before, and nothing else. What a killed process
leaves, the next to write the same file removes.
"""

import json
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from millisight.core._limits import limits_of
from millisight.core._locks import held
from millisight.core.errors import FileError, FormatError, check_known

FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
"""What figures are written as; here, so that the command line can refuse others before it loads Matplotlib."""

RECORD_SUFFIXES = (".h5", ".hdf5")
"""What records are written as."""

_LARGEST_TOML = 1 << 20  # bytes
_LARGEST_JSON = 1 << 26  # bytes, some hundred thousand entries: parsed, they take ten times as many
_STALE = 60  # seconds that nobody has written to a temporary file
_DEEPEST = limits_of(_LARGEST_TOML).depth

# A dotted key of more parts: tomllib's memory grows with the square of their number. Each part is run through once.
# A key never begins behind a backslash; what begins there would be run through again from every escaped quote.
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]++|\\.)*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![\w\\-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_DEEPEST}}}")

# Controls but tab and line feed, and the marks that reorder text.
_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any failure.

    The temporary name keeps the suffix, since libraries choose the format by it. A symbolic link is followed, and
    the permissions of an older file are kept.

    Raises
    ------
    FileError
        The folder is missing or cannot be written to, or the disk is full.
    """
    path = checked_path(path)
    temporary, target = _claim(path)
    try:
        with _in_work(temporary):
            _sweep(target)
            yield temporary
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, target)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"cannot write {printable(path)}: {error.strerror or error}; nothing was changed") from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise before long work what `atomic_path` would raise after it.

    Raises
    ------
    FileError
        The folder is missing or cannot be written to.
    """
    _claim(checked_path(path))[0].unlink()


def check_record_suffix(path: str | os.PathLike[str]) -> None:
    """Refuse a name for a file of a record that has the suffix of another format; one without suffix is taken.

    Raises
    ------
    UnknownNameError
    FileError
        It is no path.
    """
    suffix = checked_path(path).suffix
    if suffix and suffix.lower() not in RECORD_SUFFIXES:
        check_known(f"format of {printable(path)}, records are HDF5:", suffix, RECORD_SUFFIXES)


def checked_path(path: object) -> Path:
    """`path` as a Path, where it can be one.

    Raises
    ------
    FileError
        It is no text and no Path, is empty, or holds a NUL.
    """
    if not isinstance(path, str | Path | os.PathLike) or not isinstance(text := os.fspath(path), str):
        raise FileError(f"path is of type {type(path).__name__}; expected a str or a Path")
    if not text or "\0" in text:
        raise FileError(f"path is {text!r}; expected the name of a file, not empty and without NUL characters")
    try:
        os.fsencode(text)
    except UnicodeEncodeError as error:
        raise FileError(f"path is {printable(text)}, which no file can be called; expected another name") from error
    return Path(text)


def check_readable(path: object) -> Path:
    """`path` as the Path of a file that can be opened.

    Raises
    ------
    FileError
        There is no such file, it is a folder, or may not be read.
    """
    path = checked_path(path)
    if os.path.isdir(path):
        raise FileError(f"{printable(path)} is a folder; expected a file")
    if os.path.exists(path) and not os.path.isfile(path):
        raise FileError(f"{printable(path)} is a device or a pipe; expected a file")
    try:
        open(path, "rb").close()
    except FileNotFoundError as error:
        raise FileError(f"{printable(path)}: no such file") from error
    except OSError as error:
        raise FileError(f"cannot read {printable(path)}: {error.strerror}; check its name and permissions") from error
    return path


def file_version(status: os.stat_result) -> tuple[int, int, int]:
    """What changes when a file is written or replaced: its size [bytes], and the times of writing and of its last
    change [ns]. Copies and unpacked archives may keep the former, but not the latter."""
    return status.st_size, status.st_mtime_ns, status.st_ctime_ns


def files_under(folder: str | os.PathLike[str]) -> list[Path]:
    """Every file at or below a folder, sorted; folders whose names begin with a dot are not looked into.

    Raises
    ------
    FileError
        It, or a folder in it, cannot be listed: what lies there would be passed over in silence.
    """

    def refuse(error: OSError) -> NoReturn:
        place = printable(error.filename or folder)
        raise FileError(f"cannot list the folder {place}: {error.strerror}; change its permissions") from error

    found = []
    for place, folders, files in os.walk(checked_path(folder), onerror=refuse):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(place, name) for name in files]
    return sorted(found)


def same_file(a: Path, b: Path) -> bool:
    """Whether two paths lead to one place, by links or by name."""
    try:
        return os.path.samefile(a, b)
    except OSError:  # one of them is not there yet
        return os.path.realpath(a) == os.path.realpath(b)


def was_cut(file: Any) -> bool:
    """Whether an h5py file, open for reading, is shorter than when it was opened: HDF5 reads zeros beyond its end."""
    return (
        file.mode == "r"
        and file.driver == "sec2"
        and os.fstat(file.id.get_vfd_handle()).st_size < file.id.get_filesize()
    )


def printable(text: object) -> str:
    """A text, such as a file's name in another encoding, as any terminal and any file can hold it.

    Characters that steer a terminal, or turn the direction of its text, are written as escapes.
    """
    plain = str(text).encode("utf-8", "backslashreplace").decode("utf-8")
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), plain)


def _claim(path: Path) -> tuple[Path, Path]:
    """An empty temporary file, and the place it is for: a plain error now rather than a library's own later."""
    name = printable(path)
    target = Path(os.path.realpath(path))
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        mode = None
    except OSError as error:
        raise FileError(f"cannot write {name}: {error.strerror}; choose another name") from error
    if mode is not None and stat.S_ISDIR(mode):
        raise FileError(f"{name} is a folder; expected the name of a file to write")
    if mode is not None and not stat.S_ISREG(mode):
        raise FileError(f"{name} is a device or a pipe; expected the name of a file to write")
    if not os.path.isdir(target.parent):
        missing = printable(target.parent if path.is_symlink() else path.parent)
        raise FileError(f"cannot write {name}: there is no folder {missing}; make it or choose another")
    temporary = target.with_name(f".{target.stem[:40]}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        if mode is not None:
            temporary.chmod(stat.S_IMODE(mode))
    except OSError as error:
        raise FileError(
            f"cannot write {name}: {error.strerror}; choose another folder or make this one writable"
        ) from error
    if not os.access(temporary, os.W_OK):
        temporary.unlink()
        raise FileError(f"cannot write {name}: it is read-only; choose another name, or let it be written")
    return temporary, target


@contextmanager
def _in_work(temporary: Path) -> Iterator[None]:
    """Lock a temporary file while it is written, so that no other writer takes it for one that was left behind."""
    if os.name == "nt":  # where an open file could not be renamed, and there are no such locks
        yield
        return
    with open(temporary, "rb") as file:
        held(file)
        yield


def _sweep(target: Path) -> None:
    """Remove the temporary files of writers of `target` that were killed."""
    name = re.compile(rf"\.{re.escape(target.stem[:40])}\.[0-9a-f]{{8}}\.part{re.escape(target.suffix)}")
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in [entry for entry in entries if name.fullmatch(entry.name)]:
            with suppress(OSError), open(entry.path, "rb") as file:
                # Its age: between its making and its locking it is a writer's, too.
                if time.time() - os.fstat(file.fileno()).st_mtime > _STALE and os.name != "nt" and held(file):
                    os.unlink(entry.path)


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
    path = checked_path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {printable(path)}: {error.strerror}; choose another name") from error
    return path


def check_folder(path: str | os.PathLike[str]) -> None:
    """Raise before long work what `make_folder`, or the first file in it, would raise after it; nothing is left.

    Raises
    ------
    FileError
        The folder cannot be made or written to, or a file is in its place.
    """
    path = checked_path(path)
    there = next(place for place in (path.absolute(), *path.absolute().parents) if os.path.lexists(place))
    trial = there / f".{secrets.token_hex(4)}.part"
    try:
        trial.mkdir()
        trial.rmdir()
    except OSError as error:
        verb = "write to" if there == path.absolute() else "make"
        raise FileError(
            f"cannot {verb} the folder {printable(path)}: {error.strerror}; choose another folder or make this one "
            "writable"
        ) from error


def read_json(path: str | os.PathLike[str]) -> Any:
    """What a JSON file that millisight keeps for itself holds, such as a cache, of 64 MiB at most.

    Raises
    ------
    ValueError, RecursionError
        It is no JSON, or larger.
    OSError
        It cannot be read.
    """
    with open(path, "rb") as file:
        content = file.read(_LARGEST_JSON + 1)
    if len(content) > _LARGEST_JSON:
        raise ValueError(f"it has more than {_LARGEST_JSON >> 20} MiB")
    return json.loads(content)


def read_toml(path: str | os.PathLike[str], what: str) -> dict[str, Any]:
    """The content of a TOML file of under a mebibyte.

    Parameters
    ----------
    path : the file
    what : what it is expected to be, for messages: "a recipe"

    Raises
    ------
    FileError
        It cannot be read.
    FormatError
        It is too large, or no TOML.
    """
    path = check_readable(path)
    if path.stat().st_size > _LARGEST_TOML:
        raise FormatError(
            f"{printable(path)} has {path.stat().st_size} bytes; expected {what} of under {_LARGEST_TOML}"
        )
    try:
        return parsed_toml(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{printable(path)} is not valid TOML: {error}") from error


def parsed_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text, its integers no larger than 64 bits hold: others are in no unit, and fit no array.

    Raises
    ------
    ValueError, RecursionError
        It is no TOML.
    """
    import tomllib

    if found := _DEEP_KEY.search(text):
        raise ValueError(f"a key of more than {_DEEPEST} parts: {found[0][:40]}...")
    content = tomllib.loads(text)
    pending: list[Any] = [content]
    while pending:  # a loop, since tables may be nested as deep as the text is long
        value = pending.pop()
        if isinstance(value, dict):
            pending += value.values()
        elif isinstance(value, list):
            pending += value
        elif isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
            raise ValueError(f"an integer of {value.bit_length()} bits; expected 64 bits at most")
    return content
