"""Opening HDF5 files of ours: sealed ones here, those of before the seal by way of a child process's copy.

A seal shows that a file is as we wrote it, or that somebody went to some length; what it may hold is bounded in either
case: groups and arrays of numbers in one tree, whose bytes lie in the file itself.
"""

import errno
import json
import logging
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from millisight.core import check_readable, limits_of, printable
from millisight.core.errors import DamagedFileError, FileError, FormatError
from millisight.io._children import child, failure
from millisight.io._seal import chunks_of_zeros, seal_holds, seals_checksums

logger = logging.getLogger(__name__)

SCHEMA_VERSION = 2  # 1 had no seal
PLACED_VERSION = 3  # of captures with antennas at their own places, or layers, which an older reader would pass over

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MESHES = (".stl", ".obj", ".ply", ".off", ".glb")
_JSON = "json:"


@contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[Any]:
    """The h5py file at `path`, which was found to be ours, whole, and free of links that lead elsewhere.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `millisight.load`.
    """
    path = check_readable(path)
    with open(path, "rb") as raw:
        start = raw.read(8)
        sealed = seal_holds(raw)
        stated = _stated_size(raw)
    if start != _SIGNATURE:
        raise FormatError(f"{printable(path)} {_instead(path, start)}")
    if sealed is False:
        raise DamagedFileError(f"{printable(path)} is damaged: its checksum differs; make or copy it again")
    if sealed:
        with _checked(path, path) as file:
            _warn_of_zeros(path, file, path)
            yield file
        return
    if stated > (size := path.stat().st_size):
        raise DamagedFileError(
            f"{printable(path)} is cut short: {size} bytes are left of {stated}; make or copy it again"
        )
    with tempfile.TemporaryDirectory(prefix="millisight-") as folder:
        copy = Path(folder) / "copy.h5"
        _copy(path, copy)
        with _checked(copy, path) as file:
            _warn_of_zeros(copy, file, path, older=True)
            yield file


def _warn_of_zeros(path: Path, file: Any, called: Path, *, older: bool = False) -> None:
    """Say which chunks of an older file may have been lost: Fletcher-32 of zeros is 0, and no seal covers it there."""
    try:
        with open(path, "rb") as raw:
            found = chunks_of_zeros(raw, file) if older or not seals_checksums(raw, file) else {}
    except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
        raise _fault(printable(called), "is damaged", error) from error
    for name, rows in found.items():
        logger.warning(
            "%s: %s holds %d chunks of zeros alone, the first from index %d on; a file of this older form does not "
            "tell whether zeros were written or data was lost: compare it with its source, then save it again",
            printable(called), printable(name), len(rows), min(rows),
        )  # fmt: skip


def _copy(path: Path, copy: Path) -> None:
    """Let a child process copy a file without a seal, and seal the copy."""
    with child("millisight.io._unsealed", str(copy), path=path) as process:
        told = process.stdout.read(1 << 16) if process.stdout else b""
        try:
            refusal = json.loads(told)
        except ValueError as error:  # it ended before it could tell
            raise DamagedFileError(
                f"{printable(path)} cannot be opened as HDF5: {failure(process)}; make or copy it again"
            ) from error
    if refusal:
        kind = FormatError if refusal["kind"] == FormatError.__name__ else DamagedFileError
        raise kind(refusal["message"])


@contextmanager
def _checked(path: Path, name: Path) -> Iterator[Any]:
    """The HDF5 file at `path`, called `name` in errors, its version and its tree judged before an array is read."""
    import h5py

    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise _fault(printable(name), "cannot be opened as HDF5", error) from error
    with file:
        judge(file, name, sealed=True)
        yield file


def judge(file: Any, path: Path, *, sealed: bool) -> None:
    """Raise unless an open HDF5 file is ours, of a version that is read here, and one tree without ways out of it.

    Raises
    ------
    FormatError, DamagedFileError
    """
    name = printable(path)
    try:
        ours = str(_root_attribute(file, "format", "")) == "millisight"
        version = int(_root_attribute(file, "schema_version", 0))
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise _fault(name, "is damaged", error) from error
    if not ours:
        raise FormatError(f"{name} is HDF5, but not written by millisight (no format attribute)")
    if not 1 <= version <= PLACED_VERSION:
        raise FormatError(
            f"{name} has schema version {version}; this millisight reads up to {PLACED_VERSION}: upgrade it"
        )
    if not sealed and version > 1:
        raise DamagedFileError(
            f"{name} has no checksum: it is damaged, or another program changed it; make or copy it again"
        )
    try:
        _check_tree(file, name, path.stat().st_size)
    except FileError:
        raise
    except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
        raise _fault(name, "is damaged", error) from error


def _root_attribute(file: Any, name: str, otherwise: Any) -> Any:
    """An attribute of the file, read only where it is one number or text."""
    if name not in file.attrs or not _is_single(file.attrs.get_id(name)):
        return otherwise
    return plain(file.attrs[name])


def _is_single(attribute: Any) -> bool:
    """Whether an attribute is one number or one text: an array of texts may name one text a thousand times."""
    import h5py

    kind = attribute.dtype
    return attribute.shape == () and (kind.kind in "biufcSU" or h5py.check_string_dtype(kind) is not None)


def _check_tree(file: Any, name: str, size: int) -> None:
    """Raise unless the file holds groups and arrays of numbers alone, each linked once, and all their bytes.

    Nothing is compressed, so arrays and texts that are larger than the file together share bytes.
    """
    import h5py
    from h5py import h5o  # ty: ignore[missing-module-member]: compiled, without stubs

    limits = limits_of(size)
    seen, groups = {h5o.get_info(file.id).addr}, [(file, 0)]
    left = size - _text_bytes(file, f"{name} is damaged at /", size)
    while groups:
        group, depth = groups.pop()
        for key in group:
            place = f"{name} is damaged at {printable(f'{group.name}/{key}'.replace('//', '/'))}"
            link = group.get(key, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise DamagedFileError(f"{place}: a link that may lead elsewhere, which is not followed; make it again")
            item = group[key]
            address = h5o.get_info(item.id).addr
            if address in seen or len(seen) > limits.items or depth > limits.depth:
                raise DamagedFileError(f"{place}: linked twice, too deep, or one of too many; make it again")
            seen.add(address)
            left -= _text_bytes(item, place, left)
            if isinstance(item, h5py.Group):
                groups.append((item, depth + 1))
            elif isinstance(item, h5py.Dataset):
                if problem := _problem(item, h5py.h5z.FILTER_FLETCHER32):
                    raise DamagedFileError(f"{place}: {problem}; make or copy it again")
                left -= math.prod(item.shape) * item.dtype.itemsize
                if left < 0:
                    raise DamagedFileError(f"{place}: its bytes are another array's, too; make it again")
            else:
                raise DamagedFileError(f"{place}: neither a group nor an array; make it again")


def _text_bytes(item: Any, place: str, most: int) -> int:
    """Bytes of all texts in a group's or an array's attributes, which are single numbers and texts.

    Raises
    ------
    DamagedFileError
        They are none, or more than `most`.
    """
    found = 0
    for key in item.attrs:
        attribute = item.attrs.get_id(key)
        if not _is_single(attribute):
            raise DamagedFileError(f"{place}: {printable(key[:80])} is neither a number nor a text; make it again")
        if attribute.dtype.kind == "O":
            held = item.attrs[key]
            found += len(held.encode(errors="replace") if isinstance(held, str) else held)
            if found > most:
                raise DamagedFileError(f"{place}: texts that share their bytes; make it again")
    return found


def _problem(dataset: Any, checksum: int) -> str:
    """Why an array is not read; "" where it is."""
    layout = dataset.id.get_create_plist()
    if dataset.is_virtual or layout.get_external_count():
        return "its bytes lie in another file"
    if dataset.dtype.kind not in "biufc" or dataset.shape is None:
        return f"of the type {str(dataset.dtype)[:80]}; expected numbers"
    if any(layout.get_filter(i)[0] != checksum for i in range(layout.get_nfilters())):
        return "compressed, which millisight's files are not"
    # An array that claims more than the file stores would be read as zeros, or exhaust the memory.
    stored = dataset.id.get_storage_size()
    expected = max(math.prod(dataset.shape), math.prod(dataset.chunks or (0,))) * dataset.dtype.itemsize
    return f"{stored} bytes stored, {expected} expected" if stored < expected else ""


def _stated_size(raw: BinaryIO) -> int:
    """The size that an HDF5 file states in a head like ours (version 0, places of 8 bytes); 0 in another."""
    raw.seek(0)
    head = raw.read(48)
    return int.from_bytes(head[40:48], "little") if head[8:9] == b"\0" and head[13:14] == b"\x08" else 0


def _instead(path: Path, start: bytes) -> str:
    """What a file is that begins with `start`, no HDF5."""
    if not start:
        return "is empty; expected an HDF5 file that millisight wrote: make or copy it again"
    if path.suffix.lower() in _MESHES:
        return "is a mesh; `millisight simulate` makes a capture of it"
    return f"is not an HDF5 file (it starts with {start!r}); expected one that millisight wrote"


def plain(value: Any) -> Any:
    """An HDF5 attribute as plain Python."""
    if isinstance(value, bytes):
        value = value.decode()
    if isinstance(value, str) and value.startswith(_JSON):
        return json.loads(value[len(_JSON) :])
    return value.item() if isinstance(value, np.generic) else value


def _fault(name: str, said: str, error: BaseException) -> FileError:
    """The error of a file of which that is `said`; a limit of this process is not the file's fault."""
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE, errno.ENOMEM):
        return FileError(f"cannot read {name}: {os.strerror(error.errno)}; close other programs, or raise the limit")
    return DamagedFileError(f"{name} {said}: {reason(error)}; make or copy it again")


def reason(error: BaseException) -> str:
    """What an error of HDF5 says, in one line."""
    return " ".join(str(getattr(error, "strerror", None) or error).split())
