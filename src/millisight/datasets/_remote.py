"""A dataset that is sent elsewhere or comes from there, hub or object store: its files, and what was done with them."""

import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path, PureWindowsPath
from typing import NamedTuple

from millisight.core import OWN_NAME, files_under, make_folder, printable, quoted, record, write_text
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets._hub_card import CARD_NAME
from millisight.datasets._manifest import MANIFEST_NAME, Manifest, checksum, read_manifest, size_of
from millisight.datasets._published import empty_scenes_of
from millisight.io.mito import SPLITS_NAME, TRUTH, object_of

OF_THE_HUB = ".cache/huggingface"  # where its library keeps what it knows of a download


class RemoteFile(NamedTuple):
    """A file elsewhere: its path there, relative to the dataset, and its size [bytes]."""

    path: str
    size: int


class LocalFile(NamedTuple):
    """A file to send: its path in the dataset, its content or where that is, its size [bytes] and SHA-256."""

    path: str
    content: Path | bytes
    size: int
    sha256: str


@record
class Push:
    """What was pushed, or would be."""

    repository: str  # name on the hub, or URL of an object store
    files: int  # of the dataset
    size: int  # of all of them [bytes]
    there: int  # how many of them were there before
    left_out: tuple[str, ...]  # files of the folder that its manifest does not name
    card: str  # README.md as it is there; empty: an object store gets the folder's own
    address: str  # of its page, or its URL; empty: nothing was sent
    sent: tuple[RemoteFile, ...] = ()  # files that were sent, or would be


@record
class Download:
    """What was downloaded, or would be."""

    repository: str  # name on the hub, or URL of an object store
    commit: str  # its revision, by hash; all files are of this one. Of an object store the SHA-256 of its manifest
    files: tuple[RemoteFile, ...]  # those wanted
    there: int  # how many of them were in the folder before, whole
    failures: tuple[tuple[str, str], ...] = ()  # (path, why it was not downloaded)

    @property
    def size(self) -> int:
        """Of all files wanted [bytes]."""
        return sum(file.size for file in self.files)


def checked_manifest(root: Path) -> Manifest:
    """The manifest of a dataset whose files are all there, with the sizes that it states.

    Raises
    ------
    FileError
    """
    manifest = read_manifest(root)
    if manifest is None:
        raise FileError(
            f"{printable(root)} holds no {MANIFEST_NAME}; expected a dataset that `millisight generate` or `millisight "
            "dataset convert` made"
        )
    wrong = [path for path, entry in manifest.entries.items() if size_of(root / path) != entry.size]
    if wrong:
        raise FileError(
            f"{printable(root)}: {len(wrong)} of {len(manifest.entries)} files are missing or not as {MANIFEST_NAME} "
            f"says, the first {printable(wrong[0])}; make the dataset again, or see `millisight dataset verify`"
        )
    return manifest


def files_to_send(root: Path, manifest: Manifest, *last: str) -> list[LocalFile]:
    """The files of a manifest, then those of the names `last` that are there, in the order in which they are sent."""
    files = [LocalFile(path, root / path, entry.size, entry.sha256) for path, entry in sorted(manifest.entries.items())]
    files += [LocalFile(n, root / n, size_of(root / n), checksum(root / n)) for n in last if (root / n).exists()]
    return files


def files_left_out(root: Path, manifest: Manifest) -> tuple[str, ...]:
    """The files of a dataset's folder that neither its manifest names nor millisight wrote; hidden ones aside."""
    known = {*manifest.entries, SPLITS_NAME, MANIFEST_NAME, CARD_NAME}
    found = (path.relative_to(root) for path in files_under(root))
    return tuple(
        path.as_posix()
        for path in found
        if path.as_posix() not in known and not any(part.startswith(".") for part in path.parts)
    )


def check_inside(place: str, paths: Iterable[str]) -> None:
    """Refuse paths of files elsewhere that would lead out of the folder where they go, on any system.

    Raises
    ------
    FileError
    """
    for path in paths:
        odd = not path or "\\" in path or "\0" in path or any(part in ("", ".", "..") for part in path.split("/"))
        if odd or PureWindowsPath(path).drive:
            raise FileError(
                f"{place} lists the file {quoted(path)}, which would lie outside the folder; refused: expected a "
                "relative path with /, without .. and backslashes"
            )


def claim_folder(out: str | os.PathLike[str], lacking: Sequence[RemoteFile]) -> Path:
    """The folder of a download, made, and marked as ours where it is not yet.

    Raises
    ------
    FileError
        Files of the same names are in it, and nothing says that they are of a download.
    """
    root = make_folder(out)
    if not any((root / name).exists() for name in (OWN_NAME, MANIFEST_NAME, OF_THE_HUB)):
        for file in lacking:
            if os.path.lexists(root / file.path):
                raise FileError(
                    f"{printable(root / file.path)} is there already, is another file, and would be overwritten; "
                    "choose another folder"
                )
        write_text(root / OWN_NAME, "Downloaded by millisight, which may download these files again.\n")
    return root


def chosen(files: Sequence[RemoteFile], objects: Sequence[str]) -> tuple[RemoteFile, ...]:
    """The files of the objects asked for, and of their truth; all where none is.

    Raises
    ------
    UnknownNameError
        There is no such object.
    """
    if not objects:
        return tuple(files)
    folders = {folder_of(file.path) for file in files} - {""}
    named = {folder: (*identity, folder) for folder in folders if (identity := object_of(folder)) is not None}
    for name in objects:
        if not any(name in names for names in named.values()):
            raise UnknownNameError("object", name, named)
    wanted = {folder for folder, names in named.items() if set(objects) & set(names)}
    wanted |= {scene for folder in wanted for scene in empty_scenes_of(folder)}
    return tuple(file for file in files if folder_of(file.path) in wanted)


def folder_of(path: str) -> str:
    """The folder of the object that a file of a dataset belongs to; "" where it belongs to none."""
    *folders, _ = path.removeprefix(f"{TRUTH}/").split("/")
    return folders[0] if folders else ""


def check_room(root: Path, needed: int) -> None:
    """Refuse a download of more bytes than there is room for.

    Raises
    ------
    InputError
    """
    room = shutil.disk_usage(root).free
    if room < needed:
        raise InputError(
            f"{needed / 1e9:.1f} GB must be downloaded, but the free space in {printable(root)} is {room / 1e9:.1f} "
            "GB; choose another folder, or fewer objects"
        )
