"""The published dataset from the Hugging Face Hub, whole or some objects of it; resumable.

Object stores are in `_store_download`.
"""

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from millisight.core import OWN_NAME, each
from millisight.core.errors import InputError
from millisight.datasets._hub import explained, hub_library
from millisight.datasets._manifest import size_of
from millisight.datasets._remote import OF_THE_HUB, Download, RemoteFile, check_inside, check_room, chosen, claim_folder
from millisight.datasets._store import is_url
from millisight.datasets._store_download import download_from_store

REPOSITORY = "SignalKinetics/MITO_Dataset"


class _Job(NamedTuple):
    repository: str
    commit: str
    path: str
    out: str
    endpoint: str | None


def download(
    out: str | os.PathLike[str],
    objects: Sequence[str] = (),
    *,
    repository: str = REPOSITORY,
    revision: str = "main",
    dry_run: bool = False,
    workers: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> Download:
    """Download the processed files of the published dataset, or a dataset that was pushed, into the folder `out`.

    Existing files are not downloaded again, so an interrupted download continues where it stopped. Broken connections
    are resumed, from the hub in large files at the same position. A file that cannot be downloaded does not stop the
    others. Files of an object store are compared with the checksums of its manifest.

    Parameters
    ----------
    out : folder, created if missing
    objects : ids, names or folders, such as "004", "sugar_box" or "004_sugar_box"; none: everything. The empty scenes
        that the table of the published dataset names for them come along
    repository : name of a dataset repository on the hub; or the URL of a place in an object store where `push` put a
        dataset, such as s3://bucket/prefix
    revision : a branch, tag or commit, on the hub
    dry_run : list the files, and download nothing
    workers : number of parallel downloads
    progress : called with (bytes done, bytes in all)

    Raises
    ------
    ImportError
        huggingface_hub, or the package for the store, is not installed: `pip install "millisight[hub]"` or
        `"millisight[store]"`.
    FileError
        The hub cannot be reached, has no such repository or revision, or asks for a login or consent first. The store
        cannot be reached, refuses, or has no whole dataset there; the folder holds another dataset.
    UnknownNameError
        There is no such object.
    InputError
        There is not enough disk space; a revision is asked of a store, or its URL's protocol is not known.
    """
    if is_url(repository):
        if revision != "main":
            raise InputError("revision applies to the hub; leave it out for an object store")
        return download_from_store(out, objects, repository, dry_run=dry_run, workers=workers, progress=progress)
    endpoint = os.environ.get("HF_ENDPOINT") or None
    commit, listed = _listing(repository, revision, endpoint)
    files = chosen(listed, objects)
    root = Path(out)
    lacking = [file for file in files if size_of(root / file.path) != file.size]
    wanted = Download(repository=repository, commit=commit, files=files, there=len(files) - len(lacking))
    if dry_run:
        return wanted
    root = claim_folder(out, lacking)
    check_room(root, sum(file.size for file in lacking))
    jobs = [_Job(repository, commit, file.path, os.fspath(root), endpoint) for file in files]
    done, failures = 0, []
    with closing(each(_fetch, jobs, workers=workers)) as outcomes:
        for outcome in outcomes:
            file = files[outcome.number]
            done += file.size
            if outcome.failure:
                failures.append((file.path, outcome.failure))
            if progress is not None:
                progress(done, wanted.size)
    if (root / OF_THE_HUB).exists():  # it says whose folder this is
        (root / OWN_NAME).unlink(missing_ok=True)
    if not failures:  # what killed runs left behind
        for remains in (root / ".cache" / "huggingface" / "download").rglob("*.incomplete"):
            remains.unlink(missing_ok=True)
    return Download(
        repository=repository, commit=commit, files=files, there=wanted.there, failures=tuple(sorted(failures))
    )


def _listing(repository: str, revision: str, endpoint: str | None) -> tuple[str, list[RemoteFile]]:
    """The commit that `revision` is, and all files in it."""
    hub = hub_library()
    with explained(hub, repository, revision):
        api = hub.HfApi(endpoint=endpoint)
        commit = str(api.dataset_info(repository, revision=revision).sha)
        tree = api.list_repo_tree(repository, recursive=True, revision=commit, repo_type="dataset")
        files = [RemoteFile(entry.path, int(entry.size)) for entry in tree if hasattr(entry, "size")]
    check_inside(repository, [file.path for file in files])
    return commit, files


def _fetch(job: _Job) -> None:
    """One file, in a process of its own; what is whole and of this commit is not asked for again."""
    hub = hub_library()
    hub.utils.disable_progress_bars()
    with explained(hub, job.repository, job.commit):
        hub.hf_hub_download(
            job.repository,
            job.path,
            repo_type="dataset",
            revision=job.commit,
            local_dir=job.out,
            endpoint=job.endpoint,
        )
