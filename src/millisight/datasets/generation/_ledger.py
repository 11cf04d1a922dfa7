"""What of a dataset is made already: the manifest, and until that is written anew a journal, a line a job.

A job's files are told in one line, written when they are all in their places. Whatever kills a run, the next one
begins with what is told.
"""

import json
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from millisight.core import alone, make_folder, printable, sealed, unsealed, write_text
from millisight.core.errors import DamagedFileError, FileError, InputError
from millisight.datasets import (
    MANIFEST_NAME,
    Manifest,
    ManifestEntry,
    ManifestSource,
    checksum,
    read_manifest,
    write_manifest,
)
from millisight.datasets._manifest import is_whole, manifest_entry

JOURNAL_NAME = ".millisight.journal.jsonl"


class Ledger:
    """The jobs that are done, by the path of their description `job.json`, in the dataset's folder `out`.

    `settings` are the manifest's: a folder with another dataset's is refused.
    """

    def __init__(self, out: Path, settings: Mapping[str, Any]):
        self._out, self._settings = out, dict(settings)
        self._done: dict[str, tuple[str, tuple[ManifestEntry, ...]]] = {}
        self._below: defaultdict[str, set[str]] = defaultdict(set)  # files that were made, at or below a folder
        before = read_manifest(out)
        if before is None and out.is_dir() and any(not entry.name.startswith(".") for entry in out.iterdir()):
            raise InputError(f"{printable(out)} is not empty, and not a dataset of this recipe; choose another folder")
        if before is not None and dict(before.settings) != self._settings:
            raise InputError(
                f"{printable(out)} holds another dataset: its {MANIFEST_NAME} says {dict(before.settings)}, this one "
                f"would say {self._settings}; choose another folder"
            )
        self.listed: frozenset[str] = frozenset(() if before is None else before.entries)  # in the manifest, at first
        if before is not None:
            self._take(before.entries.values())
        for line in _journal(out):
            self._take(line)

    def kept(self, job: str, sha256: str) -> bool:
        """Whether the job of this description is done, and its files are there still, as they were written."""
        told = self._done.get(job)
        return told is not None and told[0] == sha256 and all(is_whole(entry, self._out) for entry in told[1])

    def known(self, folders: Iterable[str]) -> frozenset[str]:
        """The files in or below some folders that were made here."""
        return frozenset().union(*(self._below.get(folder, ()) for folder in folders))

    def files(self, jobs: Iterable[str]) -> list[ManifestEntry]:
        """The files of some jobs."""
        return [entry for job in jobs if job in self._done for entry in self._done[job][1]]

    def others(self, jobs: Iterable[str]) -> list[str]:
        """Jobs that are done and not among `jobs`: of an earlier recipe."""
        return sorted(self._done.keys() - set(jobs))

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Only in such a block jobs can be added, and only one at a time can have it."""
        make_folder(self._out)
        with alone(self._out, printable(self._out)):
            if (self._out / JOURNAL_NAME).is_symlink():
                raise FileError(f"{printable(self._out / JOURNAL_NAME)} is a link; expected a file of ours: remove it")
            if read_manifest(self._out) is None:
                write_manifest(self._out, Manifest(settings=self._settings, entries={}))
            yield

    def add(self, entries: Iterable[ManifestEntry]) -> None:
        """Tell of a job that is done. What it made before and no more goes, unless somebody has changed it since."""
        entries = tuple(entries)
        paths = {entry.path for entry in entries}
        before = [old for job in _by_job(entries) for old in self._done.get(job, ("", ()))[1]]
        self._take(entries)
        with open(self._out / JOURNAL_NAME, "a", encoding="utf-8") as file:
            file.write(_line(entries))
            file.flush()
            os.fsync(file.fileno())
        for old in before:
            if old.path not in paths and is_whole(old, self._out):
                (self._out / old.path).unlink()

    def close(self, jobs: Iterable[str], others: Iterable[ManifestEntry]) -> Manifest:
        """Write the manifest of these jobs and other files; the journal keeps what jobs made that are none of these."""
        jobs = list(jobs)
        entries = {entry.path: entry for entry in (*self.files(jobs), *others)}
        manifest = Manifest(settings=self._settings, entries=entries)
        write_manifest(self._out, manifest)
        if others_made := self.others(jobs):
            write_text(self._out / JOURNAL_NAME, "".join(_line(self._done[job][1]) for job in others_made))
        else:
            (self._out / JOURNAL_NAME).unlink(missing_ok=True)
        return manifest

    def _take(self, entries: Iterable[ManifestEntry]) -> None:
        for job, told in _by_job(entries).items():
            self._done[job] = told[0].sources[0].sha256, tuple(told)
            for entry in told:
                for folder in PurePosixPath(entry.path).parents:
                    self._below[str(folder)].add(entry.path)


_LONGEST_LINE = 1 << 24  # of the journal, the files of one job [bytes]

JOB_NAME = "job.json"
"""The file that holds a job's description; its checksum stands for all that the job's files follow from."""


def job_source(path: Path, name: str) -> ManifestSource:
    """The description at `path` as the source of a job's files, under its name in the dataset."""
    return ManifestSource(name, path.stat().st_size, checksum(path))


def _line(entries: Iterable[ManifestEntry]) -> str:
    """Of the journal: the files of one job."""
    return sealed(json.dumps([{**e._asdict(), "sources": [s._asdict() for s in e.sources]} for e in entries])) + "\n"


def _by_job(entries: Iterable[ManifestEntry]) -> dict[str, list[ManifestEntry]]:
    """Files by the path of the description that they were made from."""
    found: dict[str, list[ManifestEntry]] = {}
    for entry in entries:
        if entry.sources and entry.sources[0].path.endswith(JOB_NAME):
            found.setdefault(entry.sources[0].path, []).append(entry)
    return found


def _journal(out: Path) -> Iterator[list[ManifestEntry]]:
    """What the journal tells; a line that was cut off or damaged tells nothing."""
    try:
        file = open(out / JOURNAL_NAME, "rb")  # noqa: SIM115
    except OSError:
        return
    with file:
        while line := file.readline(_LONGEST_LINE):  # the parts of a longer one are damaged lines
            try:
                yield [manifest_entry(value, JOURNAL_NAME) for value in unsealed(json.loads(line))]
            except (ValueError, TypeError, RecursionError, DamagedFileError):
                continue
