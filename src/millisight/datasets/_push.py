"""A dataset made here, to the Hugging Face Hub: what is there is not sent again, so a push that broke is continued."""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from millisight.core import files_under, printable, record
from millisight.core.errors import FileError
from millisight.datasets._hub import explained, hub_library
from millisight.datasets._hub_card import CARD_NAME, hub_card
from millisight.datasets._manifest import MANIFEST_NAME, checksum, read_manifest, size_of
from millisight.io.mito import SPLITS_NAME

_BATCH_FILES = 200
_BATCH_SIZE = 2 * 10**9  # bytes


class _File(NamedTuple):
    """A file to push: its path in the repository, its content or where that is, its size [bytes] and SHA-256."""

    path: str
    content: Path | bytes
    size: int
    sha256: str


@record
class Push:
    """What was pushed, or would be."""

    repository: str  # name on the hub
    files: int  # of the dataset
    size: int  # of all of them [bytes]
    there: int  # how many of them the hub had before
    left_out: tuple[str, ...]  # files of the folder that its manifest does not name
    card: str  # README.md as it is on the hub
    address: str  # of its page; empty: nothing was sent


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
    """Push a dataset that millisight generated or converted to the Hugging Face Hub, with a card.

    The files of its manifest are sent in commits of up to 2 GB, the manifest and the card last. Files that the hub has
    already, by their checksums, are not sent again, so an interrupted push continues where it stopped. The user must
    be logged in (`hf auth login`). The card says what is simulated, with which physics, and by what it was made.

    Parameters
    ----------
    folder : the dataset's, with a `manifest.jsonl`
    repository : owner/name on the hub; it is made if missing
    licence : for the card, by its name on the hub, such as "cc-by-4.0"; None: "unknown"
    public : make a new repository public; by default only its owner sees it
    revision : branch
    dry_run : make the card, and send nothing
    progress : called with (bytes done, bytes in all)

    Raises
    ------
    ImportError
        huggingface_hub is not installed: `pip install "millisight[hub]"`.
    FileError
        The folder holds no such dataset, or not all of it; the hub cannot be reached, or refuses.
    """
    root = Path(folder)
    files, left_out, card = _files_of(root, repository, licence)
    told = Push(
        repository=repository, files=len(files), size=sum(file.size for file in files), there=0, left_out=left_out,
        card=card, address="",
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
    return Push(
        repository=repository, files=told.files, size=told.size, there=len(files) - len(lacking), left_out=left_out,
        card=card, address=str(address),
    )  # fmt: skip


def _files_of(root: Path, repository: str, licence: str | None) -> tuple[list[_File], tuple[str, ...], str]:
    """The files in the order in which they are sent, those of the folder that are not, and the card."""
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
    card = hub_card(root, manifest, repository, licence)
    files = [_File(path, root / path, entry.size, entry.sha256) for path, entry in sorted(manifest.entries.items())]
    for name in (SPLITS_NAME, MANIFEST_NAME):
        if (root / name).exists():
            files.append(_File(name, root / name, size_of(root / name), checksum(root / name)))
    content = card.encode()
    files.append(_File(CARD_NAME, content, len(content), hashlib.sha256(content).hexdigest()))
    known = {file.path for file in files}
    found = (path.relative_to(root) for path in files_under(root))
    left_out = tuple(
        path.as_posix()
        for path in found
        if path.as_posix() not in known and not any(part.startswith(".") for part in path.parts)
    )
    return files, left_out, card


def _same(entry: Any, file: _File) -> bool:
    """Whether the hub has that file: large ones by their SHA-256, small ones as git names them."""
    if entry is None or entry.size != file.size:
        return False
    if entry.lfs is not None:
        return entry.lfs.sha256 == file.sha256
    content = file.content if isinstance(file.content, bytes) else file.content.read_bytes()
    return entry.blob_id == hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _batches(files: Sequence[_File]) -> Iterator[list[_File]]:
    """Files that go into one commit."""
    batch: list[_File] = []
    for file in files:
        if batch and (len(batch) == _BATCH_FILES or sum(one.size for one in batch) + file.size > _BATCH_SIZE):
            yield batch
            batch = []
        batch.append(file)
    if batch:
        yield batch
