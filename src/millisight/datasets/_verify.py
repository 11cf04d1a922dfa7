"""Is a dataset what it should be? Every file is opened and looked through, and told what is wrong with it."""

import os
import stat
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from millisight.core import each, record
from millisight.datasets import _mito
from millisight.datasets._dataset import CANNOT_LIST, Dataset, Item
from millisight.datasets._manifest import MANIFEST_NAME, ManifestEntry, checksum, read_manifest
from millisight.io import open_capture
from millisight.io.mito import RAW, TRUTH


@record
class Checked:
    """What was found of one item."""

    path: str  # relative to the dataset
    kind: str  # of the item; "listed" of a file that only the manifest names, "folder" of one that cannot be listed
    problems: tuple[str, ...] = ()  # what is lost, damaged or missing of it
    notes: tuple[str, ...] = ()  # what is odd, and nothing is lost

    @property
    def ok(self) -> bool:
        """Whether there is no problem."""
        return not self.problems


class _Job(NamedTuple):
    item: Item
    entry: ManifestEntry | None


def verify(
    root: str | os.PathLike[str] | Dataset,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Checked, ...]:
    """Open and check every file of a dataset, published or converted; one result per item, sorted by path.

    A folder that cannot be listed is a result, too, and a problem.

    For a published dataset, pickles are read, shapes and values of arrays are checked, and for raw captures the times
    of the log, the length, order, gaps and numbers of each file, and missing rows. For a converted one, each file is
    read and compared with its checksum in the manifest.

    Parameters
    ----------
    root : the dataset, or some of its objects: `ms.datasets.open(root).only(["004"])`
    workers : processes; None: one per core, at most eight
    progress : called with (items done, items in all)

    Raises
    ------
    FileError, FormatError, DamagedFileError
        There is no dataset, or its manifest is damaged.
    """
    dataset = root if isinstance(root, Dataset) else _mito.open(root)
    items = {item.path.relative_to(dataset.root).as_posix(): item for item in dataset.items}
    manifest = read_manifest(dataset.root)
    entries = manifest.entries if manifest is not None else {}
    paths = list(items)
    jobs = [_Job(item, entries.get(path)) for path, item in items.items()]
    found = [Checked(path=path, kind="folder", problems=(CANNOT_LIST,)) for path in dataset.unreadable]
    with closing(each(_check, jobs, workers=workers)) as outcomes:
        for count, outcome in enumerate(outcomes, 1):
            path = paths[outcome.number]
            if outcome.failure:
                problems, notes = [dataset.message(outcome.failure, path)], []
            else:
                problems, notes = outcome.result
            if manifest is not None and path not in entries:
                notes.append(f"not in {MANIFEST_NAME}")
            found.append(Checked(path=path, kind=items[path].kind, problems=tuple(problems), notes=tuple(notes)))
            if progress is not None:
                progress(count, len(jobs))
    folders = {one.folder.name for one in dataset.objects}
    whole = dataset is not root or folders == {one.folder.name for one in _mito.open(dataset.root).objects}
    found += [  # files that the manifest names, and that are no items: missing, or what comes along with one
        Checked(path=path, kind="listed", problems=tuple(_differences(dataset.root / path, entry)))
        for path, entry in entries.items()
        if path not in items and (whole or path.removeprefix(f"{TRUTH}/").split("/")[0] in folders)
    ]
    return tuple(sorted(found, key=lambda one: one.path))


def _check(job: _Job) -> tuple[list[str], list[str]]:
    """(problems, notes) of an item that can be read at all."""
    item = job.item
    problems = [] if job.entry is None else _differences(item.path, job.entry)
    notes: list[str] = []
    if item.kind == RAW and item.converted:
        with open_capture(item.path) as capture:
            for start in range(0, len(capture.trajectory), 1000):
                capture.frames_of(slice(start, start + 1000))
    elif item.kind == RAW:
        scan = item.read()
        problems += [str(text) for text in scan.metadata["left_out"]]
        notes += [str(text) for text in scan.metadata["notes"]]
    else:
        item.read()
    return problems, notes


def _differences(path: Path, entry: ManifestEntry) -> list[str]:
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            return ["it is no regular file"]
        size = found.st_size
        if size != entry.size:
            return [f"it has {size} bytes, by {MANIFEST_NAME} {entry.size}"]
        return [] if checksum(path) == entry.sha256 else [f"its checksum differs from that in {MANIFEST_NAME}"]
    except OSError:
        return [f"it is listed in {MANIFEST_NAME}, but missing"]
