"""A dataset from an object store, whole or some objects of it; every file compared with the manifest's checksum."""

import hashlib
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NamedTuple

from millisight.core import OWN_NAME, atomic_path, attempt, make_folder, printable
from millisight.core.errors import DamagedFileError, FileError
from millisight.datasets._hub_card import CARD_NAME
from millisight.datasets._manifest import (
    LARGEST_MANIFEST,
    MANIFEST_NAME,
    Manifest,
    checksum,
    parsed_manifest,
    read_manifest,
    size_of,
    write_manifest,
)
from millisight.datasets._remote import Download, RemoteFile, check_inside, check_room, chosen, claim_folder
from millisight.datasets._store import Store, in_threads, told_md5
from millisight.io.mito import SPLITS_NAME


class WantedFile(NamedTuple):
    """A file of the store, and its checksum; "" where nobody tells it."""

    path: str
    size: int
    algorithm: str  # "sha256" or "md5"
    digest: str


def download_from_store(
    out: str | os.PathLike[str],
    objects: Sequence[str],
    url: str,
    *,
    dry_run: bool,
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> Download:
    """Download a dataset from an object store; see `download`."""
    store, root = Store(url), Path(out)
    manifest, content = _manifest_of(store)
    _check_same(root, store, manifest)
    wanted = _wanted(store, manifest, objects)
    lacking = [file for file in wanted if not _is_there(root, file)]
    files = tuple(RemoteFile(file.path, file.size) for file in wanted)
    commit, there = hashlib.sha256(content).hexdigest(), len(wanted) - len(lacking)
    if dry_run:
        return Download(repository=store.url, commit=commit, files=files, there=there)
    root = claim_folder(out, [RemoteFile(file.path, file.size) for file in lacking])
    check_room(root, sum(file.size for file in lacking))
    size, failures = sum(file.size for file in files), []
    done = size - sum(file.size for file in lacking)
    with closing(in_threads(partial(attempt, partial(fetch_file, store, root)), lacking, workers)) as outcomes:
        for file, (_, failure) in outcomes:
            done += file.size
            if failure:
                failures.append((file.path, failure))
            if progress is not None:
                progress(done, size)
    _write_manifest(root, manifest, content)
    (root / OWN_NAME).unlink(missing_ok=True)  # the manifest says it
    return Download(repository=store.url, commit=commit, files=files, there=there, failures=tuple(sorted(failures)))


def _manifest_of(store: Store) -> tuple[Manifest, bytes]:
    """The store's manifest, and its bytes."""
    if store.info(MANIFEST_NAME) is None:
        raise FileError(
            f"{store.url} holds {len(store.listing())} files and no {MANIFEST_NAME}; expected a dataset that "
            "`millisight dataset push` put there to the end: check the name, or push again"
        )
    content = store.read(MANIFEST_NAME, LARGEST_MANIFEST)
    manifest = parsed_manifest(f"{store.url}/{MANIFEST_NAME}", content)
    check_inside(store.url, manifest.entries)
    return manifest, content


def _check_same(root: Path, store: Store, manifest: Manifest) -> None:
    """Refuse a folder with another dataset."""
    here = read_manifest(root)
    if here is not None and here.settings != manifest.settings:
        raise FileError(
            f"{printable(root)} holds another dataset: its {MANIFEST_NAME} says {dict(here.settings)}, that of "
            f"{store.url} {dict(manifest.settings)}; choose another folder"
        )
    more = [] if here is None else sorted(here.entries.keys() - manifest.entries.keys())
    if more:
        raise FileError(
            f"{printable(root)} holds {len(more)} files that {store.url} has not, the first {printable(more[0])}; push "
            "them, or choose another folder"
        )


def _wanted(store: Store, manifest: Manifest, objects: Sequence[str]) -> list[WantedFile]:
    """The files of the objects asked for; of all of them also what tells of the whole dataset."""
    listed = [RemoteFile(entry.path, entry.size) for entry in manifest.entries.values()]
    files = [WantedFile(*file, "sha256", manifest.entries[file.path].sha256) for file in chosen(listed, objects)]
    for name in () if objects else (SPLITS_NAME, CARD_NAME):
        info = store.info(name)
        if info is not None and info["size"] is not None:
            files.append(WantedFile(name, info["size"], "md5", told_md5(info)))
    return files


def _is_there(root: Path, file: WantedFile) -> bool:
    """Whether a file that the manifest lists is in the folder, byte for byte."""
    path = root / file.path
    return file.algorithm == "sha256" and size_of(path) == file.size and checksum(path) == file.digest


def fetch_file(store: Store, root: Path, file: WantedFile) -> None:
    """A file of a store to its place under `root`, when it is whole.

    Raises
    ------
    DamagedFileError
        It came with other bytes.
    FileError
    """
    digest, size = hashlib.new(file.algorithm, usedforsecurity=False), 0
    make_folder((root / file.path).parent)
    with atomic_path(root / file.path) as temporary, open(temporary, "wb") as written:
        for chunk in store.chunks(file.path):
            size += len(chunk)
            if size > file.size:
                break
            digest.update(chunk)
            written.write(chunk)
        if size != file.size or (file.digest and digest.hexdigest() != file.digest):
            what = f"{size} bytes" if size < file.size else "more bytes" if size > file.size else "other bytes"
            raise DamagedFileError(
                f"{store.url}/{file.path} came with {what}; expected {file.size} with "
                f"{file.algorithm} {file.digest[:12]}...: try again; if it stays so, send it again"
            )


def _write_manifest(root: Path, manifest: Manifest, content: bytes) -> None:
    """The manifest of what is in the folder now: the store's, or of the objects that were downloaded."""
    entries = {path: entry for path, entry in manifest.entries.items() if size_of(root / path) == entry.size}
    if len(entries) < len(manifest.entries):
        write_manifest(root, Manifest(settings=manifest.settings, entries=entries))
        return
    with atomic_path(root / MANIFEST_NAME) as temporary:
        temporary.write_bytes(content)
