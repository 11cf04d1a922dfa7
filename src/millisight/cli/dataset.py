"""`millisight dataset`: list, look into, verify, convert and download the published dataset."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import end_with_failures, in_options, length, progress, say
from millisight.cli.options import Objects, Sight, Workers, checked_sight
from millisight.datasets.inventory import Dataset, Experiment, ObjectFolder, Simulation
from millisight.datasets.mito import find
from millisight.errors import InputError
from millisight.io.mito_names import CAMERA_FRAME, CAMERA_MASK, IMAGE, RADAR_MASK, RADARS, RAW

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="The published dataset (MITO), or one of your own in its layout: what is there, what is missing, is it whole, "
    "and into our files.\n\nStart with: millisight dataset download MITO_Dataset --object 004_sugar_box",
)

Root = Annotated[Path, typer.Argument(metavar="DIR", help="The dataset's folder, in which the objects' folders lie.")]


@app.command("list")
def list_(
    root: Root,
    objects: Objects = None,
    sight: Sight = None,
    experiment: Annotated[int | None, typer.Option(min=0, help="Only experiments of this number.")] = None,
    incomplete: Annotated[
        bool, typer.Option("--incomplete", help="Only objects of which something is missing.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything, file by file, as JSON.")] = False,
) -> None:
    """Say what there is of each object and what is missing. No file is opened.

    Example: millisight dataset list MITO_Dataset --incomplete
    """
    sight = checked_sight(sight)
    dataset = find(root).only(objects or [])
    chosen = [_narrowed(one, sight, experiment) for one in dataset.objects]
    if incomplete:
        chosen = [one for one in chosen if _lacks(one)]
    if as_json:
        say(json.dumps(_tree(dataset, chosen), indent=2))
        return
    rows = [_HEADER, *(_row(one) for one in chosen)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    for row in rows:
        say("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    stray = [*dataset.stray, *(f"{one.folder.name}/{path}" for one in chosen for path in one.stray)]
    for path in stray:
        say(f"not of the layout: {path}")
    say(f"{len(chosen)} objects, {sum(len(one.experiments) for one in chosen)} experiments")


@app.command("info")
def info(
    paths: Annotated[
        list[Path], typer.Argument(metavar="FOLDER...", help="An object, or an experiment's folder los or nlos.")
    ],
) -> None:
    """Look into an object or an experiment: every item opened and described, and what is missing.

    Example: millisight dataset info MITO_Dataset/004_sugar_box/robot_collected/0_0_0/exp2/los
    """
    from millisight.cli.dataset_info import describe

    failed = False
    for path in paths:
        for line in describe(path):
            failed |= line.startswith("failed: ")
            say(line)
    if failed:
        raise typer.Exit(1)


@app.command("verify")
def verify(root: Root, objects: Objects = None, workers: Workers = None) -> None:
    """Open every file and say what is damaged, lost or odd; of a converted dataset, compare checksums too.

    The exit code is 1 if there is any problem; what is only odd is a note.

    Example: millisight dataset verify MITO_Dataset
    """
    from millisight.datasets.verify import verify as verify_dataset

    dataset = find(root).only(objects or [])
    with progress("verify", compiles=False) as report:
        results = verify_dataset(dataset, workers=workers, progress=report)
    for one in results:
        for text in one.problems:
            say(f"problem: {one.path}: {text}")
        for text in one.notes:
            say(f"note: {one.path}: {text}")
    bad = sum(not one.ok for one in results)
    say(f"verified {len(results)} items: {bad} with problems")
    if bad:
        raise typer.Exit(1)


@app.command("convert")
def convert(
    root: Root,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Folder to convert into.")],
    objects: Objects = None,
    min_distance: Annotated[
        str | None,
        typer.Option(
            help="Of raw captures, drop frames closer than this to one before, such as 0.5mm. "
            "[default: 3/16 of the wavelength, as published]"
        ),
    ] = None,
    workers: Workers = None,
) -> None:
    """Convert into HDF5, once: images, masks, camera frames, and raw captures with their poses.

    Run it again to go on after an interruption, or after files were added: what is there and right is kept. One bad
    item does not stop the rest; the exit code is 1 if any failed.

    Example: millisight dataset convert MITO_Dataset -o mito
    """
    from millisight.datasets.convert import convert as convert_dataset

    dataset = find(root).only(objects or [])
    distance = None if min_distance is None else length(min_distance, option="--min-distance")
    with progress("convert", compiles=False) as report:
        done = convert_dataset(dataset, output, min_distance=distance, workers=workers, progress=report)
    for path, text in done.notes:
        say(f"note: {path}: {text}")
    say(f"converted {done.made} items into {output}, {done.kept} were there already")
    end_with_failures([f"{path}: {in_options(reason)}" for path, reason in done.failures])


@app.command("download")
def download(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to download into.")],
    objects: Objects = None,
    repo: Annotated[
        str, typer.Option(help="Dataset repository on the Hugging Face Hub.")
    ] = "SignalKinetics/MITO_Dataset",
    revision: Annotated[str, typer.Option(help="Branch, tag or commit.")] = "main",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be fetched, and how large it is.")] = False,
    workers: Annotated[int, typer.Option(min=1, help="Files fetched at a time.")] = 4,
) -> None:
    """Download the published dataset from the Hugging Face Hub: the processed files; it holds no raw ones.

    Run it again to go on after an interruption.

    Example: millisight dataset download MITO_Dataset --object 004_sugar_box --object mug
    """
    from millisight.datasets.download import download as download_dataset

    settings = {"repository": repo, "revision": revision, "dry_run": dry_run, "workers": workers}
    with progress("download", compiles=False) as report:
        try:
            done = download_dataset(output, objects or [], progress=report, **settings)
        except ImportError as error:
            raise InputError(str(error)) from error
    say(f"{done.repository} at {done.commit}: {len(done.files)} files, {done.size / 1e6:.1f} MB; "
        f"{done.there} files were there already")  # fmt: skip
    if dry_run:
        sizes: Counter[str] = Counter()
        for file in done.files:
            sizes[file.path.split("/")[0] if "/" in file.path else "."] += file.size
        for folder, size in sorted(sizes.items()):
            say(f"{folder}: {size / 1e6:.1f} MB")
        return
    say(f"wrote {output}")
    end_with_failures([f"{path}: {in_options(reason)}" for path, reason in done.failures])


_HEADER = ("id", "name", "exp", "angles", "los", "nlos", "radars", "images", "simulated", "masks", "camera", "raw",
           "missing")  # fmt: skip


def _row(one: ObjectFolder) -> tuple[str, ...]:
    """An object's line in the table."""
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
        ", ".join(f"{count} x {text}" if count > 1 else text for text, count in lacks.items()) or "-",
    )


def _lacks(one: ObjectFolder) -> Counter[str]:
    """What is missing of an object, and how often."""
    return Counter([*one.missing, *(text for part in one.parts for text in part.missing)])


def _narrowed(one: ObjectFolder, sight: str | None, number: int | None) -> ObjectFolder:
    """The object with some of its experiments only."""
    if sight is None and number is None:
        return one
    return replace(
        one,
        experiments=tuple(
            part
            for part in one.experiments
            if (sight is None or part.sight == sight) and (number is None or part.number == number)
        ),
        simulations=(),
    )


def _tree(dataset: Dataset, chosen: list[ObjectFolder]) -> dict[str, Any]:
    """Everything, as JSON holds it; paths relative to the dataset."""

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
        what = {"number": of.number, "sight": of.sight} if isinstance(of, Experiment) else {}
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
            }
            for one in chosen
        ],
        "stray": list(dataset.stray),
    }
