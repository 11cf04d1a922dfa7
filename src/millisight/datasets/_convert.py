"""From the published layout to our own files: once, in parallel, and resumable at any point.

Every item becomes one file at the same place, `.h5` for `.pkl`; a folder of raw files becomes a capture and the robot's
log in it. What the files hold follows from the sources and the settings alone, so that equal sources give equal bytes.
"""

import os
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from millisight.core import (
    alone,
    atomic_path,
    checked_number,
    each,
    file_version,
    make_folder,
    move_into,
    printable,
    read_sealed,
    record,
    same_file,
    sha256_of,
    write_sealed,
)
from millisight.core.errors import FileError, InputError
from millisight.datasets import _mito
from millisight.datasets._dataset import CANNOT_LIST, Dataset, Item
from millisight.datasets._manifest import (
    Manifest,
    ManifestEntry,
    ManifestSource,
    checksum,
    is_whole,
    read_manifest,
    write_manifest,
)
from millisight.io import SCHEMA_VERSION, mito, save

_VERSION = 2  # of the conversion: another one, and everything is converted anew
_COPIED = (mito.INFO, mito.CAMERA_PICTURE)  # as they are
_CACHE_NAME = ".millisight.checksums.json"
_PARTIAL_NAME = ".millisight.partial"
_SECONDS = 2.0  # between two writes of the manifest

Checksums = dict[str, tuple[int, int, int, str]]
"""By path relative to the dataset: size [bytes], times of writing and of the last change [ns], SHA-256."""


@record
class Converted:
    """What came of a conversion."""

    manifest: Manifest  # of all that is in the converted dataset now
    made: int  # items
    kept: int  # items that were converted already
    notes: tuple[tuple[str, str], ...]  # (path, what is odd about it), of all items
    failures: tuple[tuple[str, str], ...]  # (path, why it was not converted)


class _Job(NamedTuple):
    """What a process needs to convert an item; it opens nothing else."""

    item: Item
    root: Path
    out: Path
    before: tuple[ManifestEntry, ...]
    ours: tuple[str, ...]  # outputs of it that an earlier conversion wrote
    known: Checksums
    min_distance: float | None


class _Done(NamedTuple):
    entries: tuple[ManifestEntry, ...]
    known: Checksums
    kept: bool


def convert(
    root: str | os.PathLike[str] | Dataset,
    out: str | os.PathLike[str],
    *,
    min_distance: float | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Converted:
    """Convert a dataset of the published layout into `out`; valid existing files are kept.

    An item is kept when its file, its sources by their checksums, the settings and the schema are those of the
    manifest. An item that cannot be converted does not stop the others. After an interruption, call it again to finish
    the work, with the same bytes as without the interruption.

    Parameters
    ----------
    root : the dataset, or some of its objects: `ms.datasets.open(root).only(["004"])`
    out : a folder, created if missing; its `manifest.jsonl` lists the files and their checksums
    min_distance : of the frames of raw captures, as of `RawScan.to_capture` [m]
    workers : processes; None: one per core, at most eight; a raw item needs some hundred megabytes in each
    progress : called with (items done, items in all)

    Raises
    ------
    FileError, FormatError, DamagedFileError
        There is no dataset, `out` cannot be written to, or its manifest is damaged.
    InputError
        `out` is the dataset itself, or the dataset is already converted.
    """
    dataset = root if isinstance(root, Dataset) else _mito.open(root)
    items = [item for item in dataset.items if not item.converted]
    if all(item.kind in _COPIED for item in items) and not dataset.unreadable:
        raise InputError(f"{printable(dataset.root)} holds no file left to convert: all are converted")
    if min_distance is not None:
        min_distance = checked_number(min_distance, name="min_distance", unit="m", minimum=0)
    out = make_folder(out)
    if same_file(out, dataset.root):
        raise InputError(f"{printable(out)} is the dataset itself; choose another output folder")
    settings = {"conversion": _VERSION, "schema": SCHEMA_VERSION, "min_distance": min_distance}
    kept, notes = 0, []
    failures = [(path, CANNOT_LIST) for path in dataset.unreadable]
    with alone(out, printable(out)), _Ledger(out, settings) as ledger:
        jobs = [ledger.job(item, dataset.root) for item in items]
        with closing(each(_convert, jobs, workers=workers)) as outcomes:
            for count, outcome in enumerate(outcomes, 1):
                path = _relative(items[outcome.number].path, dataset.root)
                if outcome.failure:
                    failures.append((path, dataset.message(outcome.failure, path)))
                else:
                    done: _Done = outcome.result
                    ledger.add(path, done)
                    kept += done.kept
                    notes += [(path, note) for note in done.entries[0].notes]
                if progress is not None:
                    progress(count, len(jobs))
    return Converted(
        manifest=ledger.manifest,
        made=len(items) - kept - (len(failures) - len(dataset.unreadable)),
        kept=kept,
        notes=tuple(sorted(notes)),
        failures=tuple(sorted(failures)),
    )


class _Ledger:
    """The manifest as it grows, and the checksums of sources, kept so that a resumed run need not read them again."""

    def __init__(self, out: Path, settings: dict[str, Any]):
        self._out = out
        before = read_manifest(out)
        if before is not None and "conversion" not in before.settings:
            raise InputError(
                f"{printable(out)} holds another dataset: its manifest says {dict(before.settings)}; choose another "
                "folder"
            )
        entries = before.entries if before is not None and before.settings == settings else {}
        self.manifest = Manifest(settings=settings, entries=entries)
        self._known, self._ours = _read_cache(out / _CACHE_NAME)
        self._ours |= set() if before is None else set(before.entries)
        self._written = 0.0

    def job(self, item: Item, root: Path) -> _Job:
        path = _relative(item.path, root)
        outputs = _outputs(item, root)
        before = tuple(e for name in outputs if (e := self.manifest.entries.get(name)) is not None)
        ours = tuple(name for name in outputs if name in self._ours)
        min_distance = self.manifest.settings["min_distance"]
        return _Job(item, root, self._out, before, ours, self._known.get(path, {}), min_distance)

    def add(self, path: str, done: _Done) -> None:
        self.manifest = self.manifest.updated(done.entries)
        self._known[path] = done.known
        if time.monotonic() - self._written > _SECONDS:
            self._write()

    def _write(self) -> None:
        # An old conversion's files are overwritten one by one: a run after this one must know them, too. They are told
        # here before the old manifest goes.
        ours = sorted(self._ours - self.manifest.entries.keys())
        write_sealed(self._out / _CACHE_NAME, {"known": self._known, "ours": ours})
        write_manifest(self._out, self.manifest)
        self._written = time.monotonic()

    def __enter__(self) -> "_Ledger":
        shutil.rmtree(self._out / _PARTIAL_NAME, ignore_errors=True)
        make_folder(self._out / _PARTIAL_NAME)
        self._write()
        return self

    def __exit__(self, *_: object) -> None:
        self._write()
        shutil.rmtree(self._out / _PARTIAL_NAME, ignore_errors=True)


def _read_cache(path: Path) -> tuple[dict[str, Checksums], set[str]]:
    """The checksums that an earlier run left, and the outputs of conversions before it; none where the file was changed
    or cannot be read: checksums are worked out again."""
    try:
        cache = read_sealed(path)
        known = {
            item: {
                name: (int(size), int(written), int(changed), str(sha256))
                for name, (size, written, changed, sha256) in files.items()
            }
            for item, files in cache["known"].items()
        }
        return known, {str(name) for name in cache["ours"]}
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError):
        return {}, set()


def _convert(job: _Job) -> _Done:
    """Convert one item, or find that it was converted before."""
    known: Checksums = {}
    sources = tuple(_source(path, files, job, known) for path, files in _sources_of(job.item))
    outputs = _outputs(job.item, job.root)
    if [entry.path for entry in job.before] == outputs and all(
        entry.sources == sources and is_whole(entry, job.out) for entry in job.before
    ):
        return _Done(job.before, known, True)
    entries = []
    partial = job.out / _PARTIAL_NAME / f"{os.getpid()}{Path(outputs[0]).suffix}"
    for output, (write, notes) in zip(outputs, _contents(job), strict=True):
        # Written where a killed run's remains are swept up, and moved to its place when it is whole.
        write(partial)
        entry = ManifestEntry(output, job.item.kind, partial.stat().st_size, checksum(partial), sources, tuple(notes))
        move_into(partial, job.out / output, known=output in job.ours)
        entries.append(entry)
    return _Done(tuple(entries), known, False)


def _known_checksum(file: Path, before: tuple[int, int, int, str] | None) -> tuple[int, int, int, str]:
    """Size, times and SHA-256 of a file, which is read unless size and times are those of before."""
    try:
        status = file.stat()
    except OSError as error:
        raise FileError(f"cannot read {printable(file)}: {error.strerror}") from error
    if not stat.S_ISREG(status.st_mode):
        raise FileError(f"{printable(file)} is a device or a pipe; expected a file")
    told = file_version(status)
    return *told, before[3] if before is not None and before[:3] == told else checksum(file)


def _contents(job: _Job) -> Iterator[tuple[Callable[[Path], None], list[str]]]:
    """What writes each output of an item, and what is odd about the item."""
    item = job.item
    if item.kind in _COPIED:
        item.read()
        yield lambda path: _copy(item.path, path), []
    elif item.kind == mito.RAW:
        scan = mito.read_experiment(item.path, item.radar)
        notes = [str(note) for name in ("left_out", "notes") for note in scan.metadata[name]]
        yield lambda path: save(path, scan.to_capture(min_distance=job.min_distance), reproducible=True), notes
        log = mito.read_log(item.path, item.radar)
        yield lambda path: save(path, log.record, extras=log.extras, reproducible=True), notes
    else:
        record, extras = item.read_with_extras()
        yield lambda path: save(path, record, extras=extras, reproducible=True), []


def _copy(source: Path, path: Path) -> None:
    with atomic_path(path) as temporary:
        shutil.copyfile(source, temporary)


def _outputs(item: Item, root: Path) -> list[str]:
    """Where in the converted dataset an item goes."""
    place = Path(_relative(item.path, root))
    if item.kind in _COPIED:
        return [place.as_posix()]
    if item.kind == mito.RAW:
        return [(place / name).as_posix() for name in (mito.RAW_CAPTURE, mito.RAW_LOG)]
    if item.kind == mito.LOG:
        return [(place / mito.RAW_LOG).as_posix()]
    return [place.with_suffix(".h5").as_posix()]


def _sources_of(item: Item) -> Iterator[tuple[Path, list[Path]]]:
    """What an item is made of: a file or a folder, and the files of it that matter."""
    if item.kind == mito.RAW:
        files = [*item.path.glob("radar_data/*"), *item.path.glob("antenna*.npz"), *item.path.glob("continuous*.pkl")]
        yield item.path, sorted(file for file in files if file.is_file())
        info = item.path.parents[3] / mito.INFO_NAME
        yield info, [info] if info.is_file() else []
    elif item.kind == mito.LOG:
        yield item.path, sorted(item.path.glob("antenna*.npz"))
    else:
        yield item.path, [item.path]
        if item.kind == mito.RADAR_MASK and (image := mito.image_beside(item.path)).is_file():
            yield image, [image]


def _source(path: Path, files: Iterable[Path], job: _Job, known: Checksums) -> ManifestSource:
    """A source as the manifest names it; `known` takes what was learned of its files."""
    lines = []
    size = 0
    for file in files:
        name = _relative(file, job.root)
        known[name] = found = _known_checksum(file, job.known.get(name))
        size += found[0]
        lines.append((found[-1], file))
    if [file for _, file in lines] == [path]:
        return ManifestSource(_relative(path, job.root), size, lines[0][0])
    listing = "".join(f"{sha256}  {file.relative_to(path).as_posix()}\n" for sha256, file in lines)
    digest = sha256_of(listing)
    return ManifestSource(_relative(path, job.root), size, digest, len(lines))


def _relative(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix()
