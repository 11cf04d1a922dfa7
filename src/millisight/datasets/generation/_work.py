"""One job, wherever this is: made beside the dataset and moved to its place, or handed over through an object store."""

import importlib.metadata
import json
import secrets
import shutil
import tempfile
import time
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from millisight.core import make_folder, move_into, printable, write_text
from millisight.core.errors import FileError, InputError
from millisight.datasets import ManifestEntry, checksum
from millisight.datasets._store import Store
from millisight.datasets._store_download import WantedFile, fetch_file
from millisight.datasets.generation._jobs import Job
from millisight.datasets.generation._ledger import JOB_NAME, job_source
from millisight.datasets.generation._rig_job import RigJob
from millisight.io.mito import INFO, INFO_NAME, RAW, TRUTH, kind_of

PARTIAL_NAME = ".millisight.partial"
"""A folder in the dataset's for what is not whole yet."""

Made = tuple[tuple[ManifestEntry, ...], float]
"""What a job made, and the processor time that it took [s]."""


def version() -> str:
    """Of millisight, which must be the same everywhere."""
    return importlib.metadata.version("millisight")


def description_of(job: Job) -> str:
    """The path of a job's description, relative to the dataset."""
    return f"{job.truth}/{JOB_NAME}"


def make_in_place(root: Path, expected: str, item: tuple[Job, str, frozenset[str]]) -> Made:
    """Do one job: its files to their places in the dataset `root`.

    `expected` is the version of millisight that asks for it, `item` the job, its description, and files that earlier
    runs made.
    """
    started = time.process_time()
    _check_version(expected)
    job, text, known = item
    if not (root / PARTIAL_NAME).is_dir():
        raise FileError(
            f"{printable(root)} does not exist on this worker; the workers of a cluster must see the "
            "dataset under the same path, or share an object store with the run (--store)"
        )
    stage = make_folder(root / PARTIAL_NAME / secrets.token_hex(6))
    try:
        entries = _staged(job, text, root, stage)
        place(entries, stage, root, known)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return answered(job, entries), time.process_time() - started


def make_away(url: str, expected: str, item: tuple[Job, str, str, tuple[WantedFile, ...]]) -> Made:
    """Do one job where nobody sees the dataset: what it reads comes from an object store, its files go there.

    `item` is the job, its description, the folder in the store for its files, and the files that it reads.
    """
    started = time.process_time()
    _check_version(expected)
    job, text, folder, inputs = item
    store = Store(url)
    with tempfile.TemporaryDirectory() as workspace:
        root, stage = make_folder(Path(workspace, "dataset")), make_folder(Path(workspace, "stage"))
        for file in inputs:
            fetch_file(store, root, file)
        entries = _staged(job, text, root, stage)
        for entry in entries:
            store.send(f"{folder}/{entry.path}", stage / entry.path)
    return entries, time.process_time() - started


def place(entries: Iterable[ManifestEntry], stage: Path, root: Path, known: Collection[str]) -> None:
    """Move files from `stage` to their places in `root`; of what is there, those `known` may be overwritten.

    Raises
    ------
    FileError
    """
    for entry in entries:
        move_into(stage / entry.path, root / entry.path, known=entry.path in known)


def answered(job: Job, entries: Iterable[ManifestEntry]) -> tuple[ManifestEntry, ...]:
    """The files that are this job's to tell of: of what several scans share, the first one tells."""
    first = isinstance(job, RigJob) and job.first
    return tuple(entry for entry in entries if first or not entry.path.endswith(INFO_NAME))


def entry_of(root: Path, path: str, kind: str, sources: tuple[Any, ...]) -> ManifestEntry:
    """What a file of the dataset is."""
    return ManifestEntry(path, kind, (root / path).stat().st_size, checksum(root / path), sources)


def _check_version(expected: str) -> None:
    if expected != version():
        raise InputError(f"this worker has millisight {version()}, the run {expected}; install the same everywhere")


def _staged(job: Job, text: str, root: Path, stage: Path) -> tuple[ManifestEntry, ...]:
    """All files of a job, made under `stage`."""
    job.make(root, stage, json.loads(text)["made_by"])
    write_text(make_folder(stage / job.truth) / JOB_NAME, text)
    source = job_source(stage / job.truth / JOB_NAME, description_of(job))
    paths = sorted(path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file())
    return tuple(entry_of(stage, path, _kind(path), (source,)) for path in paths)


def _kind(path: str) -> str:
    """What a file is, by its path in the dataset."""
    parts = path.split("/")
    if parts[0] == TRUTH:
        return TRUTH
    if parts[-1] == INFO_NAME:
        return INFO
    if "processed" not in parts and "camera" not in parts:
        return RAW
    known = kind_of("camera" if "camera" in parts else "radars", parts[-1])
    return known[0] if known else RAW
