"""The manifest of a converted dataset: what each file in it is, what it was made of, and their checksums.

A text file, `manifest.jsonl`. The first line says what it is and with which settings the files were made; each other
line is one file, sorted by path. It holds no time and no name of a machine: equal sources give an equal manifest.
"""

import hashlib
import json
import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from millisight.core import check_readable, checked_metadata, printable, put, quoted, record, write_text
from millisight.core.errors import DamagedFileError, FileError, FormatError

MANIFEST_NAME = "manifest.jsonl"
_FORMAT = "millisight dataset manifest"
_VERSION = 1
LARGEST_MANIFEST = 1 << 30  # bytes; a published dataset has some thousand files of a few hundred bytes each


class ManifestSource(NamedTuple):
    """A file that was converted, or the files of a folder taken together.

    Attributes
    ----------
    path : relative to the dataset, with "/"
    size : [bytes], of all files
    sha256 : of the file; of a folder, that of the text that `sha256sum` prints for its files, sorted by name
    files : how many
    """

    path: str
    size: int
    sha256: str
    files: int = 1


class ManifestEntry(NamedTuple):
    """A file of the converted dataset.

    Attributes
    ----------
    path : relative to the converted dataset, with "/"
    kind : of the item, as in the published layout
    size : [bytes]
    sha256 : of the file
    sources : what it was made of
    notes : what is odd about the sources
    """

    path: str
    kind: str
    size: int
    sha256: str
    sources: tuple[ManifestSource, ...]
    notes: tuple[str, ...] = ()


@record
class Manifest:
    """All files of a converted dataset.

    Attributes
    ----------
    settings : with which they were made
    entries : by path
    """

    settings: Mapping[str, Any]
    entries: Mapping[str, ManifestEntry]

    def __post_init__(self) -> None:
        put(self, settings=checked_metadata(self.settings))

    def updated(self, entries: Iterable[ManifestEntry]) -> "Manifest":
        """With these entries in the place of those of their paths."""
        return Manifest(settings=self.settings, entries={**self.entries, **{entry.path: entry for entry in entries}})


def write_manifest(folder: str | os.PathLike[str], manifest: Manifest) -> None:
    """Write `manifest.jsonl` into `folder`, whole or not at all.

    Raises
    ------
    FileError
    """
    entries = [
        {**entry._asdict(), "sources": [source._asdict() for source in entry.sources]}
        for _, entry in sorted(manifest.entries.items())
    ]
    lines = "".join(json.dumps(line) + "\n" for line in entries)
    head = {
        "format": _FORMAT, "version": _VERSION, "settings": manifest.settings, "files": len(entries),
        "sha256": hashlib.sha256(lines.encode()).hexdigest(),
    }  # fmt: skip
    write_text(Path(folder) / MANIFEST_NAME, f"{json.dumps(head)}\n{lines}")


def read_manifest(folder: str | os.PathLike[str]) -> Manifest | None:
    """The manifest in `folder`; None where there is none.

    Raises
    ------
    FileError
        It cannot be read.
    FormatError
        It is no manifest, or of a newer version.
    DamagedFileError
        A line cannot be right.
    """
    path = Path(folder) / MANIFEST_NAME
    if not path.exists():
        return None
    name = printable(check_readable(path))
    if path.stat().st_size > LARGEST_MANIFEST:
        raise FormatError(f"{name} has {path.stat().st_size} bytes; expected a manifest, of {LARGEST_MANIFEST} at most")
    return parsed_manifest(name, path.read_bytes())


def parsed_manifest(name: str, content: bytes) -> Manifest:
    """The manifest that a file of this content is; `name`: of the file, for messages.

    Raises
    ------
    FormatError
        It is no manifest, or of a newer version.
    DamagedFileError
        A line cannot be right.
    """
    lines = content.splitlines()
    head = _parsed(name, 1, lines[0] if lines else b"")
    if head.get("format") != _FORMAT:
        raise FormatError(f"{name} is not a manifest of millisight: its first line does not identify it")
    if head.get("version") != _VERSION:
        raise FormatError(f"{name} is of version {head.get('version')}; this millisight reads {_VERSION}: upgrade it")
    entries = {}
    for number, line in enumerate(lines[1:], 2):
        entry = manifest_entry(_parsed(name, number, line), f"{name}, line {number}")
        entries[entry.path] = entry
    if head.get("files", len(entries)) != len(entries):  # before there was such a count, none is given
        raise DamagedFileError(
            f"{name} lists {len(entries)} files, {head['files']} by its first line; restore it, or remove it to make "
            "all anew"
        )
    stated = head.get("sha256")
    if stated is not None and stated != hashlib.sha256(content.partition(b"\n")[2]).hexdigest():
        raise DamagedFileError(f"{name} was changed after it was written; restore it, or remove it to make all anew")
    settings = head.get("settings")
    if not isinstance(settings, dict):
        raise DamagedFileError(f"{name}, line 1: settings is {settings!r}; expected a mapping")
    try:
        return Manifest(settings=settings, entries=entries)
    except RecursionError as error:
        raise DamagedFileError(f"{name}, line 1: settings nest too deep") from error


def checksum(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content, as `sha256sum` prints it.

    Raises
    ------
    FileError
        It cannot be read.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):  # a pipe would be waited for, a device read without end
            raise FileError(f"{printable(os.fspath(path))} is no regular file; expected one")
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FileError(f"cannot read {printable(os.fspath(path))}: {error.strerror or error}") from error


def size_of(path: Path) -> int:
    """Bytes of a file; -1 where there is no such file, or it is a pipe or a device."""
    try:
        found = path.stat()
    except OSError:
        return -1
    return found.st_size if stat.S_ISREG(found.st_mode) else -1


def is_whole(entry: ManifestEntry, root: Path) -> bool:
    """Whether the file of an entry is there, byte for byte as it was written."""
    path = root / entry.path
    return size_of(path) == entry.size and checksum(path) == entry.sha256


def _parsed(name: str, number: int, line: bytes) -> dict[str, Any]:
    try:
        value = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{name}, line {number}: not JSON ({error}); convert again") from error
    if not isinstance(value, dict):
        raise DamagedFileError(f"{name}, line {number}: not a mapping; convert again")
    return value


def manifest_entry(value: Any, place: str) -> ManifestEntry:
    """The entry that a mapping of a manifest or a journal holds; `place`: where it stands, for messages.

    Raises
    ------
    DamagedFileError
    """
    try:
        sources = tuple(ManifestSource(**source) for source in value["sources"])
        stated: dict[str, Any] = {**value, "notes": tuple(value.get("notes", ())), "sources": sources}
        entry = ManifestEntry(**stated)
        inside = not PurePosixPath(entry.path).is_absolute() and ".." not in PurePosixPath(entry.path).parts
        inside = inside and b"\0" not in os.fsencode(entry.path) and bool(PurePosixPath(entry.path).parts)
    except (KeyError, TypeError, AttributeError, UnicodeEncodeError) as error:
        raise DamagedFileError(f"{place}: {error}; convert again") from error
    right = all(
        isinstance(one.path, str) and isinstance(one.sha256, str) and isinstance(one.size, int) and one.size >= 0
        for one in (entry, *sources)
    )
    if not right:
        raise DamagedFileError(f"{place}: sizes, checksum or path are invalid; convert again")
    if not inside:
        raise DamagedFileError(f"{place}: the path {quoted(entry.path)} would lie outside the folder; refused")
    return entry
