"""`millisight evaluate simulator`: the paper's table of 3D F-scores, of any dataset in the published layout."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from millisight.cli.console import end_with_failures, in_options, length, progress, say, slices
from millisight.cli.options import Objects, Sight, Workers, checked_sight
from millisight.errors import FormatError, InputError, UnknownNameError

if TYPE_CHECKING:
    import numpy as np

    from millisight.datasets.inventory import Dataset, Experiment, Item, Simulation
    from millisight.evaluation.simulator import Comparing
    from millisight.evaluation.simulator_tables import Pair
    from millisight.evaluation.tables import Table
    from millisight.imaging.image import SarImage

_SPECULAR, _EDGES = "_specular", "_edges"


class _Job(NamedTuple):
    """One measured image and the simulated ones of the object turned alike."""

    measured: "Item"
    specular: "Item"
    edge: "Item"
    object: str
    pose: str
    number: int
    sight: str
    settings: "Comparing"
    crop: tuple[int, int]


def simulator(
    measured: Annotated[
        Path, typer.Option("--measured", metavar="DIR", help="Dataset whose measured images are the yardstick.")
    ],
    simulated: Annotated[
        Path, typer.Option("--simulated", metavar="DIR", help="Dataset with the simulated images; may be the same.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT", help="Folder for the page, tables and pictures.")
    ] = Path("simulator-evaluation"),
    objects: Objects = None,
    sight: Sight = None,
    radar: Annotated[str, typer.Option(help="77_ghz or 24_ghz.")] = "77_ghz",
    flat: Annotated[
        bool | None,
        typer.Option(
            help="Compare means along z. [default: at 24 GHz, which does not resolve depth]", show_default=False
        ),
    ] = None,
    threshold: Annotated[
        float, typer.Option(help="tau_P: points are the voxels above this share of the image's maximum.")
    ] = 0.3,
    absolute: Annotated[bool, typer.Option("--absolute", help="tau_P is in the unit of the images.")] = False,
    within: Annotated[str, typer.Option(help="tau_F: points nearer than this match.")] = "10mm",
    mode: Annotated[str, typer.Option("--align", help="translation, or rigid: turned, too.")] = "translation",
    crop: Annotated[
        str, typer.Option(metavar="LOW,HIGH", help="Slices of measured images to leave out, lowest and highest.")
    ] = "0,0",
    fit: Annotated[
        Path | None, typer.Option("--fit", metavar="FILE.toml", help="Write the weights that fit each object best.")
    ] = None,
    clouds: Annotated[
        str | None, typer.Option(metavar="SUFFIX", help="Also write the compared clouds, as ply or pcd.")
    ] = None,
    pictures: Annotated[int, typer.Option(min=0, help="So many of the best and of the worst pairs are drawn.")] = 3,
    workers: Workers = None,
) -> None:
    """Tell how true simulated images are: 3D F-scores against measured ones, the paper's row beside.

    Of each measured image, the simulated ones of the same object and angles are combined with many weights, made into
    points, aligned and compared; the best combination counts. Writes OUT/index.html, and each table as Markdown and
    CSV. A pair that cannot be read does not stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate simulator --measured bench24 --simulated bench24 -o truth
    """
    from contextlib import closing

    from millisight.datasets.mito import find
    from millisight.datasets.workers import each
    from millisight.evaluation.point_cloud import CLOUD_SUFFIXES
    from millisight.evaluation.simulator import Comparing
    from millisight.evaluation.simulator_tables import data_of
    from millisight.files import check_writable, make_folder
    from millisight.io.mito_names import checked_radar

    sight = checked_sight(sight)
    if clouds is not None and f".{clouds.lstrip('.')}" not in CLOUD_SUFFIXES:
        raise UnknownNameError("point cloud format", clouds, CLOUD_SUFFIXES)
    settings = Comparing(
        threshold=threshold,
        relative=not absolute,
        within=length(within, option="--within"),
        mode=mode,
        flat=checked_radar(radar) == "24_ghz" if flat is None else flat,
    )
    jobs, alone = _jobs(
        find(measured).only(objects or []), find(simulated), sight, radar, settings, slices(crop, option="--crop")
    )
    if not jobs:
        raise InputError(_nothing(measured, simulated, radar, alone))
    if fit is not None:
        check_writable(fit)
    output = make_folder(output)
    pairs, failures = [], []
    with progress("compare", compiles=False) as report, closing(each(_compared, jobs, workers=workers)) as outcomes:
        for done, (number, pair, failure) in enumerate(outcomes, 1):
            report(done, len(jobs))
            if pair is not None:
                pairs.append(pair)
            else:
                failures.append((_name(jobs[number]), failure))
    pairs.sort(key=lambda pair: (pair.sight, pair.object, pair.pose, pair.number))
    if pairs:
        data = data_of(measured.resolve().name, simulated.resolve().name, pairs)
        tables = _write(output, pairs, jobs, data, settings, radar, pictures, clouds)
        if fit is not None:
            _write_fit(fit, pairs, data)
        for name, table in tables.items():
            if not name.startswith("pairs"):
                say(table.markdown() + "\n")
        say(f"wrote {output / 'index.html'}")
    for name in alone:
        say(f"note: {name}: no simulated images of this object turned alike")
    end_with_failures([f"{name}: {in_options(reason)}" for name, reason in sorted(failures)])


def _nothing(measured: Path, simulated: Path, radar: str, alone: list[str]) -> str:
    """Why there is no pair."""
    if alone:
        return (
            f"no pairs: {simulated} holds no {radar} processed_image_specular and processed_image_edges of the "
            f"{len(alone)} measured images in {measured}, of the same object and angles; the first is {alone[0]}"
        )
    return (
        f"no pairs: {measured} holds no {radar} image of an object there; expected processed_image.pkl of experiments "
        "under robot_collected"
    )


def _jobs(
    measured: "Dataset",
    simulated: "Dataset",
    sight: str | None,
    radar: str,
    settings: "Comparing",
    crop: tuple[int, int],
) -> tuple[list[_Job], list[str]]:
    """What there is to compare, and the experiments without simulated images."""
    there = {(part.object, part.angles): part for one in simulated.objects for part in one.simulations}
    jobs, alone = [], []
    for experiment in measured.experiments:
        image = _image(experiment, radar, "")
        if image is None or sight not in (None, experiment.sight) or _role(measured, experiment.object) != "object":
            continue
        simulation = there.get((experiment.object, experiment.angles))
        parts = [_image(simulation, radar, ext) for ext in (_SPECULAR, _EDGES)] if simulation else [None, None]
        pose = "_".join(map(str, experiment.angles))
        if parts[0] is None or parts[1] is None:
            alone.append(f"{experiment.object}/{pose}/exp{experiment.number}/{experiment.sight}")
            continue
        jobs.append(
            _Job(
                image, parts[0], parts[1], experiment.object, pose, experiment.number, experiment.sight, settings, crop
            )
        )
    return jobs, alone


def _role(dataset: "Dataset", name: str) -> str:
    return next(one.role for one in dataset.objects if one.folder.name == name)


def _image(part: "Experiment | Simulation", radar: str, ext: str) -> "Item | None":
    from millisight.io.mito_names import IMAGE

    found = [item for item in part.items if (item.kind, item.radar, item.ext) == (IMAGE, radar, ext)]
    return found[0] if found else None


def _name(job: _Job) -> str:
    return f"{job.object}/{job.pose}/exp{job.number}/{job.sight}"


def _compared(job: _Job) -> "Pair":
    """One pair, read and compared; in a process of its own."""
    from millisight.evaluation.simulator import combine, compare, sensitivity
    from millisight.evaluation.simulator_tables import DISTANCES, THRESHOLDS, Pair

    (measured, measured_by), (specular, simulated_by), (edge, _) = _measured(job), _read(job.specular), _read(job.edge)
    comparison = compare(measured, specular, edge, job.settings)
    surface = None
    if job.settings.relative:
        best = combine(specular, edge, comparison.best.weights)
        surface = sensitivity(measured, best, job.settings, thresholds=THRESHOLDS, distances=DISTANCES)
    return Pair(
        object=job.object,
        pose=job.pose,
        number=job.number,
        sight=job.sight,
        comparison=comparison,
        sensitivity=surface,
        measured_by=measured_by,
        simulated_by=simulated_by,
    )


def _measured(job: _Job) -> "tuple[SarImage, str]":
    """The measured image without the slices that are to go, and what made it."""
    from millisight.imaging.cleanup import crop_slices

    image, made_by = _read(job.measured)
    return crop_slices(image, low=job.crop[0], high=job.crop[1]), made_by


def _read(item: "Item") -> "tuple[SarImage, str]":
    """An image, and what the file says made it: "" where it does not call itself simulated."""
    from millisight.imaging.image import SarImage
    from millisight.io.hdf5 import load, load_extras
    from millisight.io.mito_layout import read_published

    if item.converted:
        image, told = load(item.path), load_extras(item.path)
    else:
        image, told = read_published(item.path)
    if not isinstance(image, SarImage):
        raise FormatError(f"{item.path} holds a {type(image).__name__}; expected a SarImage")
    return image, str(told.get("physics", "simulated")) if told.get("simulated") else ""


def _write(
    output: Path,
    pairs: "list[Pair]",
    jobs: list[_Job],
    data: str,
    settings: "Comparing",
    radar: str,
    pictures: int,
    clouds: str | None,
) -> "dict[str, Table]":
    """The tables, the page and its pictures."""
    from millisight.evaluation.simulator_tables import all_tables
    from millisight.files import write_text
    from millisight.viz.evaluation import Shown, write_report

    tables = all_tables(pairs, data=data, settings=settings, radar=radar)
    write_text(output / "simulator.md", "\n\n".join(table.markdown() for table in tables.values()) + "\n")
    for name, table in tables.items():
        write_text(output / f"{name}.csv", table.csv())
    by_key = {(job.object, job.pose, job.number, job.sight): job for job in jobs}
    ranked = sorted(pairs, key=lambda pair: -pair.comparison.best.score.f)
    pictures = min(pictures, (len(ranked) + 1) // 2)
    shown = []
    for kind, some in (("best", ranked[:pictures]), ("worst", ranked[::-1][:pictures])):
        shown += [Shown(kind, pair, *_clouds_of(by_key[pair.key], pair)) for pair in some]
    if clouds is not None:
        _export(output, pairs, by_key, clouds.lstrip("."))
    write_report(output, pairs=pairs, shown=shown, tables=list(tables.values()), data=data, settings=settings)
    return tables


def _clouds_of(job: _Job, pair: "Pair") -> "tuple[SarImage, SarImage, np.ndarray, np.ndarray]":
    """Measured and best combined image, and their points, the latter moved; read once more."""
    from millisight.evaluation.simulator import aligned, combine

    measured = _measured(job)[0]
    combined = combine(_read(job.specular)[0], _read(job.edge)[0], pair.comparison.best.weights)
    clouds = [job.settings.cloud(image) for image in (measured, combined)]
    try:
        moved = aligned(clouds[1], clouds[0], job.settings.mode).apply(clouds[1].points)
    except InputError:  # too few points: shown where they are
        moved = clouds[1].points
    return measured, combined, clouds[0].points, moved


def _export(output: Path, pairs: "list[Pair]", jobs: dict[Any, _Job], suffix: str) -> None:
    from millisight.evaluation.point_cloud import PointCloud, write_point_cloud
    from millisight.files import make_folder

    folder = make_folder(output / "clouds")
    for pair in pairs:
        *_, there, moved = _clouds_of(jobs[pair.key], pair)
        stem = "-".join(map(str, pair.key))
        write_point_cloud(folder / f"{stem}-measured.{suffix}", PointCloud(points=there))
        write_point_cloud(folder / f"{stem}-simulated.{suffix}", PointCloud(points=moved))


def _write_fit(path: Path, pairs: "list[Pair]", data: str) -> None:
    from millisight.evaluation.simulator_tables import fitted_toml
    from millisight.files import write_text

    write_text(path, fitted_toml(pairs, data=data))
