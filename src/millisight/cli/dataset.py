"""`millisight dataset`: list, look into, verify, convert and download the published dataset."""

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight import datasets
from millisight.cli.console import (
    SMALL,
    Commands,
    answer,
    answer_json,
    answer_table,
    end_with_failures,
    in_options,
    optional_length,
    progress,
    say,
)
from millisight.cli.dataset_transfer import download, push
from millisight.cli.options import Objects, Sight, Workers, checked_sight
from millisight.core import box, printable
from millisight.core.errors import FileError, MillisightError
from millisight.data import CameraFrame, CameraMask, Capture, Mask, Picture, RawScan, SarImage, Trajectory
from millisight.datasets import (
    CANNOT_LIST,
    Dataset,
    Experiment,
    Item,
    ObjectFolder,
    Simulation,
    find_object,
)
from millisight.io.mito import CAMERA_FRAME, CAMERA_MASK, IMAGE, INFO, RADAR_MASK, RADARS, RAW

app: typer.Typer = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="List, check, convert and download datasets. They are the published one (MITO), or your own in its layout."
    "\n\nStart with: millisight dataset download MITO_Dataset --object 004_sugar_box",
)

Root = Annotated[Path, typer.Argument(metavar="DIR", help="Dataset folder, which holds one folder per object.")]


@app.command("list")
def list_(
    root: Root,
    objects: Objects = None,
    sight: Sight = None,
    experiment: Annotated[int | None, typer.Option(min=0, help="List only experiments with this number.")] = None,
    incomplete: Annotated[bool, typer.Option("--incomplete", help="List only objects with missing files.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write the full list of files as JSON.")] = False,
) -> None:
    """List the objects of a dataset, and what is missing. Tells which images its authors leave out. No file is opened.

    Example: millisight dataset list MITO_Dataset --incomplete
    """
    dataset = datasets.open(root).filter(objects=objects or [], sight=checked_sight(sight), experiment=experiment)
    chosen = list(dataset.objects)
    if incomplete:
        chosen = [one for one in chosen if _lacks(one)]
    if as_json:
        answer_json(_tree(dataset, chosen))
        return
    answer_table([_HEADER, *(_row(one) for one in chosen)])
    stray = [*dataset.stray, *(f"{one.folder.name}/{path}" for one in chosen for path in one.stray)]
    for path in stray:
        say(f"not part of the layout: {path}")
    for path in replace(dataset, objects=tuple(chosen)).unreadable:
        answer(f"problem: {path}: {CANNOT_LIST}")
    say(f"{len(chosen)} objects, {sum(len(one.experiments) for one in chosen)} experiments")


@app.command("info")
def info(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Folder of an object, or los or nlos of an experiment."),
    ],
) -> None:
    """Describe the files of an object or an experiment. Tells what is missing, too.

    Example: millisight dataset info MITO_Dataset/004_sugar_box/robot_collected/0_0_90/exp1/los
    """
    failed = False
    for path in paths:
        for line in describe(path):
            damaged = line.startswith("failed: ")
            failed |= damaged
            (answer if damaged else say)(line)
    if failed:
        raise typer.Exit(1)


@app.command("verify")
def verify(root: Root, objects: Objects = None, workers: Workers = None) -> None:
    """Open every file and report damaged and missing ones. Checksums are compared for a converted dataset.

    The exit code is 1 if there is a problem. Notes do not count.

    Example: millisight dataset verify MITO_Dataset
    """
    dataset = datasets.open(root).only(objects or [])
    with progress("verify", compiles=False) as report:
        results = datasets.verify(dataset, workers=workers, progress=report)
    for one in results:
        for text in one.problems:
            answer(f"problem: {one.path}: {text}")
        for text in one.notes:
            say(f"note: {one.path}: {text}")
    bad = sum(not one.ok for one in results)
    say(f"verified {len(results)} items: {bad} with problems")
    if bad:
        raise typer.Exit(1)


@app.command("convert")
def convert(
    root: Root,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Output folder.")],
    objects: Objects = None,
    min_distance: Annotated[
        str | None,
        typer.Option(
            help="Drop frames of raw captures closer than this to an earlier frame, such as 0.5mm. "
            "[default: 3/16 of the wavelength, as published]"
        ),
    ] = None,
    workers: Workers = None,
) -> None:
    """Convert a dataset to HDF5. Images, masks, camera frames, and raw captures with their poses are converted.

    Run it again to continue after an interruption or to add new files: finished files are kept. A file that fails does
    not stop the rest; the exit code is 1 if any failed.

    Example: millisight dataset convert MITO_Dataset -o mito
    """
    dataset = datasets.open(root).only(objects or [])
    distance = optional_length(min_distance, option="--min-distance", metres=SMALL)
    with progress("convert", compiles=False) as report:
        done = datasets.convert(dataset, output, min_distance=distance, workers=workers, progress=report)
    for path, text in done.notes:
        say(f"note: {path}: {text}")
    say(f"converted {done.made} items into {output}; {done.kept} existed already")
    end_with_failures([f"{path}: {in_options(reason)}" for path, reason in done.failures])


app.command("download")(download)
app.command("push")(push)


_HEADER = ("id", "name", "exp", "angles", "los", "nlos", "radars", "images", "simulated", "masks", "camera", "raw",
           "omitted", "missing")  # fmt: skip


def _row(one: ObjectFolder) -> tuple[str, ...]:
    """Table row of an object."""
    items = {item.path: item for part in one.experiments for item in part.items}.values()
    kinds = Counter(item.kind for item in items)
    radars = [radar[:2] for radar in RADARS if any(item.radar == radar for item in items)]
    sights = Counter(part.sight for part in one.experiments)
    numbers = sorted({part.number for part in one.experiments})
    lacks = _lacks(one)
    return (
        one.id,
        one.name,
        ",".join(map(str, numbers)) or "-",
        str(len({part.angles for part in one.experiments})),
        str(sights["los"]),
        str(sights["nlos"]),
        "+".join(radars) or "-",
        str(kinds[IMAGE]),
        str(sum(item.kind == IMAGE for part in one.simulations for item in part.items)),
        str(kinds[RADAR_MASK] + kinds[CAMERA_MASK]),
        str(kinds[CAMERA_FRAME]),
        str(kinds[RAW]),
        ", ".join(f"exp{part.number} {part.sight}" for part in one.experiments if part.left_out) or "-",
        ", ".join(f"{count} x {text}" if count > 1 else text for text, count in lacks.items()) or "-",
    )


def _lacks(one: ObjectFolder) -> Counter[str]:
    """Missing items of an object, with counts."""
    return Counter([*one.missing, *(text for part in one.parts for text in part.missing)])


def _tree(dataset: Dataset, chosen: list[ObjectFolder]) -> dict[str, Any]:
    """Full list for JSON; paths relative to the dataset."""

    def part(of: Experiment | Simulation) -> dict[str, Any]:
        items = [
            {
                "path": item.path.relative_to(dataset.root).as_posix(),
                "kind": item.kind,
                "radar": item.radar,
                "ext": item.ext,
            }
            for item in of.items
        ]
        where = {"folder": of.folder.relative_to(dataset.root).as_posix(), "angles": list(of.angles)}
        what = {"number": of.number, "sight": of.sight, "left_out": of.left_out} if isinstance(of, Experiment) else {}
        return {**where, **what, "items": items, "missing": list(of.missing)}

    return {
        "root": str(dataset.root),
        "objects": [
            {
                "id": one.id,
                "name": one.name,
                "role": one.role,
                "experiments": [part(each) for each in one.experiments],
                "simulations": [part(each) for each in one.simulations],
                "meshes": list(one.meshes),
                "missing": list(one.missing),
                "stray": list(one.stray),
                "unreadable": list(one.unreadable),
            }
            for one in chosen
        ],
        "stray": list(dataset.stray),
    }


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
    hidden = [path for path in map(one.folder.joinpath, one.unreadable) if place in (path, *path.parents)]
    yield from (f"failed: {path.relative_to(one.folder).as_posix()}: {CANNOT_LIST}" for path in hidden)
    if place == one.folder:
        yield f"object: {one.name}, id {one.id}{'' if one.role == 'object' else f', {one.role} scene'}"
        yield f"meshes: {', '.join(one.meshes) or 'none'}"
        for part in one.parts:
            items = ", ".join(" ".join(filter(None, (item.radar, item.kind, item.ext))) for item in part.items)
            yield f"{_name(part)}: {items or 'nothing'}"
            yield from _missing(part)
        return
    chosen = [part for part in one.parts if part.folder == place or place in part.folder.parents]
    if not chosen and not hidden:
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


def _missing(part: Experiment | Simulation) -> Iterator[str]:
    if part.missing:
        yield f"  missing: {', '.join(part.missing)}"


def _describe(item: Item) -> Iterator[str]:
    from millisight.io import open_capture

    if item.kind == INFO:
        yield ", ".join(f"{key} {value}" for key, value in item.read().items())
    elif item.kind == RAW and item.converted:
        with open_capture(item.path) as capture:
            yield from _lines(capture)
    else:
        yield from _lines(item.read())


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
    elif isinstance(record, Capture | Trajectory | Picture):
        yield repr(record).split("(", 1)[1].removesuffix(")")
    if isinstance(record, RawScan | Capture):
        yield from (f"left out: {text}" for text in record.metadata.get("left_out", ()))
        yield from (f"note: {text}" for text in record.metadata.get("notes", ()))
