"""A dataset made here, to an object store: the manifest last, so that whoever finds it finds all that it lists."""

import hashlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from millisight.core import OWN_NAME, printable, write_text
from millisight.core.errors import DamagedFileError, FileError
from millisight.datasets._hub_card import CARD_NAME
from millisight.datasets._manifest import LARGEST_MANIFEST, MANIFEST_NAME, Manifest, checksum, parsed_manifest
from millisight.datasets._remote import LocalFile, Push, RemoteFile, checked_manifest, files_left_out, files_to_send
from millisight.datasets._store import Store, in_threads, told_md5
from millisight.io.mito import SPLITS_NAME

_THREADS = 4  # files sent at a time; each is in memory, up to 100 MB


def push_to_store(
    root: Path, url: str, *, dry_run: bool = False, progress: Callable[[int, int], None] | None = None
) -> Push:
    """Push a dataset to an object store; see `push`."""
    manifest = checked_manifest(root)
    files = files_to_send(root, manifest, SPLITS_NAME, CARD_NAME, MANIFEST_NAME)
    store = Store(url)
    listed = store.listing(writes=True)
    _check_same(store, listed, manifest)
    lacking = [file for file in files if not _is_there(store, root, listed.get(file.path), file)]
    taken = [file.path for file in lacking if file.path in listed]
    if taken and not {MANIFEST_NAME, OWN_NAME} & listed.keys():
        raise FileError(
            f"{store.url} holds {printable(taken[0])}, which is another file and would be overwritten, and no "
            f"{MANIFEST_NAME}; choose another place, or remove it"
        )
    sizes = [file.size for file in files]
    told = Push(
        repository=store.url, files=len(files), size=sum(sizes), there=len(files) - len(lacking),
        left_out=files_left_out(root, manifest), card="", address="" if dry_run else store.url,
        sent=tuple(RemoteFile(file.path, file.size) for file in lacking),
    )  # fmt: skip
    if dry_run:
        return told
    done = told.size - sum(file.size for file in lacking)
    (last,) = [file for file in files if file.path == MANIFEST_NAME]
    if not {MANIFEST_NAME, OWN_NAME} & listed.keys():
        with tempfile.TemporaryDirectory() as folder:
            write_text(Path(folder, OWN_NAME), "Files of a push by millisight that has not ended.\n")
            store.send(OWN_NAME, Path(folder, OWN_NAME))
    before = [file for file in lacking if file is not last]
    with closing(in_threads(partial(_send, store, root), before, _THREADS)) as outcomes:
        for file, _ in outcomes:
            done += file.size
            if progress is not None:
                progress(done, told.size)
    _check_arrived(store, [file for file in files if file is not last])
    if last in lacking:
        _send(store, root, last)
    if store.info(OWN_NAME) is not None:
        store.remove(OWN_NAME)
    if progress is not None:
        progress(told.size, told.size)
    return told


def _check_same(store: Store, listed: Mapping[str, Any], manifest: Manifest) -> None:
    """Refuse a place where another dataset is."""
    if MANIFEST_NAME not in listed:
        return
    try:
        there = parsed_manifest(f"{store.url}/{MANIFEST_NAME}", store.read(MANIFEST_NAME, LARGEST_MANIFEST))
    except DamagedFileError:  # it is sent again
        return
    if there.settings != manifest.settings:
        raise FileError(
            f"{store.url} holds another dataset: its {MANIFEST_NAME} says {dict(there.settings)}, this one "
            f"{dict(manifest.settings)}; choose another place"
        )
    more = sorted(there.entries.keys() - manifest.entries.keys())
    if more:
        raise FileError(
            f"{store.url} holds {len(more)} files of a dataset that this one has not, the first {printable(more[0])}; "
            "download it and add to it, or choose another place"
        )


def _is_there(store: Store, root: Path, info: Mapping[str, Any] | None, file: LocalFile) -> bool:
    """Whether the store has that file, by the checksum that it tells; a file of which it tells none is read back."""
    if info is None or info["size"] != file.size:
        return False
    if md5 := told_md5(info):
        with open(root / file.path, "rb") as content:
            return hashlib.file_digest(content, lambda: hashlib.md5(usedforsecurity=False)).hexdigest() == md5
    digest = hashlib.sha256()
    for chunk in store.chunks(file.path):
        digest.update(chunk)
    return digest.hexdigest() == file.sha256


def _send(store: Store, root: Path, file: LocalFile) -> None:
    path = root / file.path
    if checksum(path) != file.sha256:
        raise DamagedFileError(
            f"{printable(path)} has another SHA-256 than {MANIFEST_NAME} says, and was not sent; make the dataset "
            "again, or see `millisight dataset verify`"
        )
    store.send(file.path, path)


def _check_arrived(store: Store, files: Sequence[LocalFile]) -> None:
    """All but the manifest must be there before it is sent."""
    listed = store.listing(writes=True)
    wrong = [file.path for file in files if file.path not in listed or listed[file.path]["size"] != file.size]
    if wrong:
        raise FileError(
            f"{store.url}: {len(wrong)} of {len(files)} files did not arrive whole, the first {printable(wrong[0])}; "
            "push again: what arrived is kept"
        )
