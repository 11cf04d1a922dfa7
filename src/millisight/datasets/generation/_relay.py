"""Between the dataset's folder and workers that do not see it: an object store, where nothing stays after a run."""

import hashlib
import secrets
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Any

from millisight.core import make_folder, write_text
from millisight.core.errors import DeviceError, FileError
from millisight.datasets import ManifestEntry, checksum
from millisight.datasets._remote import check_inside
from millisight.datasets._store import Store, in_threads
from millisight.datasets._store_download import WantedFile, fetch_file
from millisight.datasets.generation._jobs import Job
from millisight.datasets.generation._work import PARTIAL_NAME, answered, make_away, place, version

_THREADS = 4  # files of a job that come at a time
_NOTE = "README.txt"
_SAID = "Files of a run of `millisight generate`, which removes them; remove them yourself where none is running.\n"


class Relay:
    """One run's folder in an object store.

    Parameters
    ----------
    url : of a place in the store that workers can read and write
    root : the dataset's folder, which they do not see

    Raises
    ------
    DeviceError, InputError
        The store's package is not installed, or there is no such protocol.
    FileError
        The store cannot be reached, or takes no files.
    """

    def __init__(self, url: str, root: Path):
        self._url, self._root = f"{url.rstrip('/')}/run-{secrets.token_hex(6)}", root
        self._inputs: dict[str, WantedFile] = {}
        try:
            self._store = Store(self._url)
        except ImportError as error:
            raise DeviceError(str(error)) from error
        with tempfile.TemporaryDirectory() as workspace:  # before the work: whether the store takes files
            write_text(Path(workspace, _NOTE), _SAID)
            self._send(Path(workspace), [_NOTE])

    def work(self, jobs: Sequence[Job], texts: Mapping[str, str]) -> tuple[Callable[[Any], Any], list[Any]]:
        """What workers are to do, and for which items; what the jobs read is sent to the store first.

        Raises
        ------
        FileError
        """
        self._send(self._root, {path for job in jobs for path in job.inputs})
        items = []
        for job in jobs:
            # The note first: a worker that cannot read the store says so before the work.
            inputs = tuple(self._inputs[path] for path in (_NOTE, *job.inputs) if path in self._inputs)
            items.append((job, texts[job.key], _folder_of(job), inputs))
        return partial(make_away, self._url, version()), items

    def take(self, job: Job, known: Collection[str], entries: Sequence[ManifestEntry]) -> tuple[ManifestEntry, ...]:
        """A job's files to their places in the dataset, each compared with its checksum; those that it tells of.

        `known` are files that earlier runs made.

        Raises
        ------
        FileError
            A file is not as the worker sent it.
        """
        check_inside(self._store.url, [entry.path for entry in entries])
        stage = make_folder(self._root / PARTIAL_NAME / secrets.token_hex(6))
        folder = Path(_folder_of(job))
        files = [WantedFile(f"{folder}/{entry.path}", entry.size, "sha256", entry.sha256) for entry in entries]
        try:
            with closing(in_threads(partial(fetch_file, self._store, stage), files, _THREADS)) as outcomes:
                for _ in outcomes:
                    pass
            place(entries, stage / folder, self._root, known)
        finally:
            shutil.rmtree(stage, ignore_errors=True)
        self._store.remove(str(folder))
        return answered(job, entries)

    def close(self) -> None:
        """Remove what is left in the store, where it can be reached."""
        with suppress(FileError):
            self._store.remove()

    def _send(self, root: Path, paths: Iterable[str]) -> None:
        for path in sorted(set(paths) - self._inputs.keys()):
            file = root / path
            if file.exists():  # where an empty scene failed, jobs say so that subtract it
                self._store.send(path, file)
                self._inputs[path] = WantedFile(path, file.stat().st_size, "sha256", checksum(file))


def _folder_of(job: Job) -> str:
    """Of a job's files in the store; the same whoever makes them."""
    return f"jobs/{hashlib.sha256(job.key.encode()).hexdigest()[:16]}"
