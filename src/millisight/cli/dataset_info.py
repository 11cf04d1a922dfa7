"""Lines of `millisight dataset info`."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from millisight.core import box, printable
from millisight.core.errors import FileError, MillisightError
from millisight.data import CameraFrame, CameraMask, Capture, Mask, RawScan, SarImage
from millisight.datasets import Experiment, Item, Simulation, find_object
from millisight.io.mito import INFO, RAW


def describe(path: Path) -> Iterator[str]:
    """Describe the object at `path`, or the experiments and simulations at or below it; failures start "failed: ".

    Raises
    ------
    FileError
        The folder does not exist, or is not part of the layout.
    """
    if not path.is_dir():
        raise FileError(f"{printable(path)}: no such folder")
    one = find_object(path)
    place = Path(os.path.abspath(path))
    if place == one.folder:
        yield f"object: {one.name}, id {one.id}{'' if one.role == 'object' else f', {one.role} scene'}"
        yield f"meshes: {', '.join(one.meshes) or 'none'}"
        for part in one.parts:
            yield f"{_name(part)}: {_summary(part.items)}"
            yield from _missing(part)
        return
    chosen = [part for part in one.parts if part.folder == place or place in part.folder.parents]
    if not chosen:
        raise FileError(
            f"{printable(path)} holds no experiment and no simulation; pass a folder los or nlos, or one above"
        )
    for part in chosen:
        yield _name(part)
        for item in part.items:
            label = " ".join(filter(None, (item.radar, item.kind, item.ext)))
            try:
                for line in _describe(item):
                    yield f"  {label}: {line}"
            except MillisightError as error:
                yield f"failed: {label}: {printable(error)}"
        yield from _missing(part)


def _name(part: Experiment | Simulation) -> str:
    if isinstance(part, Simulation):
        return f"simulation {'_'.join(map(str, part.angles))} of {part.object}"
    angles = "_".join(map(str, part.angles))
    return f"experiment {part.number} of {part.object} at {angles}, {part.sight}"


def _summary(items: tuple[Item, ...]) -> str:
    return ", ".join(" ".join(filter(None, (item.radar, item.kind, item.ext))) for item in items) or "nothing"


def _missing(part: Experiment | Simulation) -> Iterator[str]:
    if part.missing:
        yield f"  missing: {', '.join(part.missing)}"


def _describe(item: Item) -> Iterator[str]:
    from millisight.io import load, open_capture
    from millisight.io.mito import read_experiment, read_info, read_published

    if item.kind == INFO:
        yield ", ".join(f"{key} {value}" for key, value in read_info(item.path).items())
    elif item.kind == RAW and item.converted:
        with open_capture(item.path) as capture:
            yield from _lines(capture)
    elif item.kind == RAW:
        yield from _lines(read_experiment(item.path, item.radar))
    else:
        yield from _lines(load(item.path) if item.converted else read_published(item.path).record)


def _lines(record: Any) -> Iterator[str]:
    """Facts about a record, a line each."""
    if isinstance(record, SarImage):
        peak = ", ".join(f"{p:.4f}" for p in record.peak)
        yield f"{' x '.join(map(str, record.grid.shape))} voxels, {box(*record.grid.bounds)}, {record.values.dtype}"
        yield f"peak {record.magnitude.max():.4g} at {peak} m"
    elif isinstance(record, Mask):
        yield f"{' x '.join(map(str, record.inside.shape))} pixels, {int(record.inside.sum())} on the object"
    elif isinstance(record, CameraFrame | CameraMask):
        yield repr(record).split("(", 1)[1].removesuffix(")")
    elif isinstance(record, RawScan):
        frames = sum(len(row.times) for row in record.rows)
        yield f"{len(record.rows)} rows, {frames} frames, {len(record.radar.array.rx_positions)} receivers"
        yield f"robot log: {len(record.log)} poses over {record.log.times[-1] - record.log.times[0]:.1f} s, " + box(
            record.log.positions.min(axis=0), record.log.positions.max(axis=0)
        )
    elif isinstance(record, Capture):
        yield repr(record).split("(", 1)[1].removesuffix(")")
    if isinstance(record, RawScan | Capture):
        yield from (f"left out: {text}" for text in record.metadata.get("left_out", ()))
        yield from (f"note: {text}" for text in record.metadata.get("notes", ()))
