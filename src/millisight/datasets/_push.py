"""A dataset made here, to the Hugging Face Hub: what is there is not sent again, so a push that broke is continued.

Object stores are in `_store_push`.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from millisight.core.errors import InputError
from millisight.datasets._hub import explained, hub_library
from millisight.datasets._hub_card import CARD_NAME, hub_card
from millisight.datasets._manifest import MANIFEST_NAME
from millisight.datasets._remote import LocalFile, Push, RemoteFile, checked_manifest, files_left_out, files_to_send
from millisight.datasets._store import is_url
from millisight.datasets._store_push import push_to_store
from millisight.io.mito import SPLITS_NAME

_BATCH_FILES = 200
_BATCH_SIZE = 2 * 10**9  # bytes


def push(
    folder: str | os.PathLike[str],
    repository: str,
    *,
    licence: str | None = None,
    public: bool = False,
    revision: str = "main",
    dry_run: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Push:
    """Push a dataset that millisight generated or converted to the Hugging Face Hub or an object store.

    The files of its manifest are sent, to the hub in commits of up to 2 GB, the manifest last. Files that are there
    already, by their checksums, are not sent again, so an interrupted push continues where it stopped. The hub gets a
    card, which says what is simulated, with which physics, and by what it was made; a store gets the dataset's own
    files, byte for byte. Log in to the hub first (`hf auth login`). fsspec finds the credentials for a store where its
    protocol's programs keep them, in ~/.aws for S3.

    Parameters
    ----------
    folder : the dataset's, with a `manifest.jsonl`
    repository : owner/name on the hub, which is made if missing; or the URL of a place in an object store, such as
        s3://bucket/prefix, whose bucket is there
    licence : for the hub's card, by its name on the hub, such as "cc-by-4.0"; None: "unknown"
    public : make a new repository on the hub public; by default only its owner sees it
    revision : branch, on the hub
    dry_run : make the card, see what a store has, and send nothing
    progress : called with (bytes done, bytes in all)

    Raises
    ------
    ImportError
        huggingface_hub, or the package for the store, is not installed: `pip install "millisight[hub]"` or
        `"millisight[store]"`.
    InputError
        An option of the hub is set for a store, or the URL's protocol is not known.
    FileError
        The folder holds no such dataset, or not all of it; hub or store cannot be reached, or refuse; the store holds
        another dataset there.
    """
    root = Path(folder)
    if is_url(repository):
        if licence is not None or public or revision != "main":
            raise InputError("licence, public and revision apply to the hub; leave them out for an object store")
        return push_to_store(root, repository, dry_run=dry_run, progress=progress)
    manifest = checked_manifest(root)
    card = hub_card(root, manifest, repository, licence)
    content = card.encode()
    files = files_to_send(root, manifest, SPLITS_NAME, MANIFEST_NAME)
    files.append(LocalFile(CARD_NAME, content, len(content), hashlib.sha256(content).hexdigest()))
    told = Push(
        repository=repository, files=len(files), size=sum(file.size for file in files), there=0, card=card, address="",
        left_out=files_left_out(root, manifest), sent=_sizes(files),
    )  # fmt: skip
    if dry_run:
        return told
    hub = hub_library()
    endpoint = os.environ.get("HF_ENDPOINT") or None
    with explained(hub, repository, revision, writes=True):
        hub.utils.disable_progress_bars()
        api = hub.HfApi(endpoint=endpoint)
        address = api.create_repo(repository, repo_type="dataset", private=not public, exist_ok=True)
        tree = api.list_repo_tree(repository, recursive=True, revision=revision, repo_type="dataset")
        there = {entry.path: entry for entry in tree if hasattr(entry, "size")}
        lacking = [file for file in files if not _same(there.get(file.path), file)]
        done = told.size - sum(file.size for file in lacking)
        batches = list(_batches(lacking))
        for number, batch in enumerate(batches, 1):
            api.create_commit(
                repository,
                [
                    hub.CommitOperationAdd(
                        path_in_repo=file.path,
                        path_or_fileobj=file.content if isinstance(file.content, bytes) else os.fspath(file.content),
                    )
                    for file in batch
                ],
                commit_message=f"millisight dataset push, {number} of {len(batches)}",
                repo_type="dataset",
                revision=revision,
            )
            done += sum(file.size for file in batch)
            if progress is not None:
                progress(done, told.size)
    return replace(told, there=len(files) - len(lacking), sent=_sizes(lacking), address=str(address))


def _sizes(files: Sequence[LocalFile]) -> tuple[RemoteFile, ...]:
    return tuple(RemoteFile(file.path, file.size) for file in files)


def _same(entry: Any, file: LocalFile) -> bool:
    """Whether the hub has that file: large ones by their SHA-256, small ones as git names them."""
    if entry is None or entry.size != file.size:
        return False
    if entry.lfs is not None:
        return entry.lfs.sha256 == file.sha256
    content = file.content if isinstance(file.content, bytes) else file.content.read_bytes()
    return entry.blob_id == hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _batches(files: Sequence[LocalFile]) -> Iterator[list[LocalFile]]:
    """Files that go into one commit."""
    batch: list[LocalFile] = []
    for file in files:
        if batch and (len(batch) == _BATCH_FILES or sum(one.size for one in batch) + file.size > _BATCH_SIZE):
            yield batch
            batch = []
        batch.append(file)
    if batch:
        yield batch
