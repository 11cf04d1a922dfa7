"""The published dataset from the Hugging Face Hub, whole or some objects of it; resumable."""

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from millisight.core import make_folder, printable, record
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets._hub import explained, hub_library
from millisight.datasets._manifest import size_of
from millisight.datasets._published import empty_scenes_of
from millisight.datasets._workers import each
from millisight.io.mito import object_of

REPOSITORY = "SignalKinetics/MITO_Dataset"


class RemoteFile(NamedTuple):
    """A file of the repository: its path there, and its size [bytes]."""

    path: str
    size: int


@record
class Download:
    """What was downloaded, or would be."""

    repository: str  # name on the hub
    commit: str  # its revision, by hash; all files are of this one
    files: tuple[RemoteFile, ...]  # those wanted
    there: int  # how many of them were in the folder before, whole
    failures: tuple[tuple[str, str], ...] = ()  # (path, why it was not downloaded)

    @property
    def size(self) -> int:
        """Of all files wanted [bytes]."""
        return sum(file.size for file in self.files)


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
    """Download the processed files of the published dataset into the folder `out`.

    Existing files are not downloaded again, so an interrupted download continues where it stopped. Broken connections
    are resumed, in large files at the same position. A file that cannot be downloaded does not stop the others.

    Parameters
    ----------
    out : folder, created if missing
    objects : ids, names or folders, such as "004", "sugar_box" or "004_sugar_box"; none: everything. The empty scenes
        that the table of the published dataset names for them come along
    repository : name of a dataset repository on the hub
    revision : a branch, tag or commit of it
    dry_run : list the files, and download nothing
    workers : number of parallel downloads
    progress : called with (bytes done, bytes in all)

    Raises
    ------
    ImportError
        huggingface_hub is not installed: `pip install "millisight[hub]"`.
    FileError
        The hub cannot be reached, has no such repository or revision, or asks for a login or consent first.
    UnknownNameError
        There is no such object.
    InputError
        There is not enough disk space.
    """
    endpoint = os.environ.get("HF_ENDPOINT") or None
    commit, listed = _listing(repository, revision, endpoint)
    files = _chosen(listed, objects)
    root = Path(out)
    lacking = [file for file in files if size_of(root / file.path) != file.size]
    wanted = Download(repository=repository, commit=commit, files=files, there=len(files) - len(lacking))
    if dry_run:
        return wanted
    root = make_folder(out)
    _check_room(root, sum(file.size for file in lacking))
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
    for file in files:
        if PurePosixPath(file.path).is_absolute() or ".." in PurePosixPath(file.path).parts:
            raise FileError(f"{repository} lists the file {file.path!r}, which would lie outside the folder; refused")
    return commit, files


def _chosen(files: list[RemoteFile], objects: Sequence[str]) -> tuple[RemoteFile, ...]:
    """The files of the objects asked for; all where none is."""
    if not objects:
        return tuple(files)
    folders = {file.path.split("/")[0] for file in files if "/" in file.path}
    named = {folder: (*identity, folder) for folder in folders if (identity := object_of(folder)) is not None}
    for name in objects:
        if not any(name in names for names in named.values()):
            raise UnknownNameError("object", name, named)
    chosen = {folder for folder, names in named.items() if set(objects) & set(names)}
    chosen |= {scene for folder in chosen for scene in empty_scenes_of(folder)}
    return tuple(file for file in files if file.path.split("/")[0] in chosen)


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


def _check_room(root: Path, needed: int) -> None:
    import shutil

    room = shutil.disk_usage(root).free
    if room < needed:
        raise InputError(
            f"{needed / 1e9:.1f} GB must be downloaded, but the free space in {printable(root)} is {room / 1e9:.1f} "
            "GB; choose another folder, or fewer objects"
        )
