"""`millisight evaluate`: the options of `ms.evaluate`, task by task."""

from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import (
    SMALL,
    Commands,
    answer,
    answer_json,
    end_with_failures,
    in_options,
    json_only,
    length,
    optional_length,
    progress,
    say,
    slices,
)
from millisight.cli.options import (
    Crop,
    ExperimentNumber,
    FalseAlarms,
    Objects,
    SamDevice,
    Sight,
    SupportHeight,
    Workers,
    check_sam_device,
    checked_sight,
)
from millisight.core.errors import InputError

app: typer.Typer = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Evaluate on a dataset, and compare with the paper's results.",
)

Root = Annotated[Path, typer.Argument(metavar="DIR", help="Dataset in the published layout.")]
Output = Annotated[
    Path, typer.Option("-o", "--output", metavar="OUT", help="Folder for the report: page, tables and figures.")
]
Transform = Annotated[
    str | None,
    typer.Option(
        help="Camera to radar: by the pose in the file (file), or the constants of the published evaluation "
        "(published). [default: file for simulated scenes, else published]"
    ),
]
Spacing = Annotated[str, typer.Option(help="Spacing of the voxels along x and y, twice that along z.")]
HiddenClutter = Annotated[
    str, typer.Option(help="Taken off captures out of sight: auto, lid or none. Others are left as they are.")
]
Failures = Annotated[int, typer.Option(min=0, help="Number of worst scenes to plot.")]
AsJson = Annotated[
    bool,
    typer.Option(
        "--json",
        help='Print one JSON document: {"task", "page", "tables": [{"title", "columns", "rows", "notes"}], "notes", '
        '"failures": [{"name", "reason"}]}.',
    ),
]


@app.command()
def simulator(
    measured: Annotated[
        Path, typer.Option("--measured", metavar="DIR", help="Dataset with the measured images, the reference.")
    ],
    simulated: Annotated[
        Path, typer.Option("--simulated", metavar="DIR", help="Dataset with the simulated images; may be the same.")
    ],
    output: Output = Path("simulator-evaluation"),
    objects: Objects = None,
    sight: Sight = None,
    experiment: ExperimentNumber = None,
    radar: Annotated[str, typer.Option(help="77_ghz or 24_ghz.")] = "77_ghz",
    flat: Annotated[
        bool | None,
        typer.Option(
            help="Compare images averaged along z. [default: at 24 GHz, where depth is not resolved]",
            show_default=False,
        ),
    ] = None,
    threshold: Annotated[
        float, typer.Option(help="tau_P: voxels above this share of the image's maximum become points.")
    ] = 0.3,
    absolute: Annotated[
        bool, typer.Option("--absolute", help="Take tau_P as an absolute magnitude, not as a share of the maximum.")
    ] = False,
    within: Annotated[str, typer.Option(help="tau_F: points closer than this match.")] = "10mm",
    mode: Annotated[
        str, typer.Option("--align", help="Alignment: translation, or rigid (translation and rotation).")
    ] = "translation",
    crop: Crop = None,
    clutter: Annotated[
        str, typer.Option(help="lid: take lids and cloths off the measured images before they are compared; none.")
    ] = "none",
    fit: Annotated[
        Path | None, typer.Option("--fit", metavar="FILE.toml", help="Write the best weights of each object.")
    ] = None,
    clouds: Annotated[
        str | None, typer.Option(metavar="SUFFIX", help="Also write the compared point clouds, as ply or pcd.")
    ] = None,
    pictures: Annotated[int, typer.Option(min=0, help="Number of best and worst pairs to plot.")] = 3,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Compare simulated with measured images. Tells 3D F-scores, with those of the paper.

    For each measured image, the specular and edge images of the same object and angles are combined with many weights.
    Each combination is turned into a point cloud, aligned and compared; the best one counts. Writes OUT/index.html, and
    each table as Markdown and CSV. Run it again to continue after an interruption. A pair that cannot be read does not
    stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate simulator --measured bench24 --simulated bench24 -o truth
    """
    if fit is not None and fit.suffix.lower() != ".toml":
        raise InputError(f"--fit is {fit}; expected a name that ends in .toml")
    options = {
        "simulated": simulated,
        "radar": radar,
        "flat": flat,
        "threshold": threshold,
        "absolute": absolute,
        "within": length(within, option="--within", metres=SMALL),
        "mode": mode,
        "crop": None if crop is None else slices(crop, option="--crop"),
        "clutter": clutter,
        "fit": fit,
        "clouds": clouds,
        "pictures": pictures,
    }
    _evaluate(
        "simulator", measured, output, objects, sight, experiment, workers, as_json=as_json, label="compare", **options
    )


@app.command()
def segmentation(
    root: Root,
    output: Output = Path("segmentation-evaluation"),
    method: Annotated[
        list[str] | None,
        typer.Option("--method", help="Segmenter: wave, classical or sam; repeatable. [default: wave, classical]"),
    ] = None,
    sam_model: Annotated[
        str, typer.Option(help="Model for sam: vit-b, vit-l, vit-h, sam2-tiny, sam2-large, or a folder with weights.")
    ] = "vit-b",
    device: SamDevice = "cpu",
    objects: Objects = None,
    sight: Sight = None,
    experiment: ExperimentNumber = None,
    seeds: Annotated[int, typer.Option(min=1, help="Number of random seeds for prompts: 0, 1, 2 and so on.")] = 3,
    truth: Annotated[
        str,
        typer.Option(
            help="True masks: from the camera's picture (camera), or the exact ones of simulated data (exact)."
        ),
    ] = "camera",
    transform: Transform = None,
    support: Annotated[
        str | None,
        typer.Option(
            help="Height of the support's upper face in the radar frame, such as -30cm: masks, too, leave out what "
            "rises no higher. [default: unknown to the segmenters; for prompts on photos by background]"
        ),
    ] = None,
    crop: Crop = None,
    failures: Annotated[int, typer.Option(min=0, help="Number of worst masks of each segmenter to plot.")] = 6,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Compare masks of segmenters with true masks. They are of photos, of 24 GHz, of 77 GHz, and of both bands.

    Writes OUT/index.html, and each table as Markdown and CSV. Run it again to continue after an interruption. A scene
    that cannot be read does not stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate segmentation bench24 -o masks --method wave --method classical
    """
    methods = method or ("wave", "classical")
    check_sam_device(device, methods)
    options = {
        "methods": methods,
        "options": {"sam": {"model": sam_model, "device": device}},
        "seeds": seeds,
        "truth": truth,
        "transform": transform,
        "support": optional_length(support, option="--support"),
        "crop": None if crop is None else slices(crop, option="--crop"),
        "failures": failures,
    }
    _evaluate(
        "segmentation", root, output, objects, sight, experiment, workers, as_json=as_json, label="segment", **options
    )


@app.command()
def classification(
    root: Root,
    output: Output = Path("classification-evaluation"),
    weights: Annotated[
        list[Path] | None,
        typer.Option(
            "--weights",
            metavar="FILE",
            help="Weights of a trained classifier: ONNX, or the paper's final_weights.h5; repeatable. [default: the "
            "shipped one]",
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="Segmenter of the predicted masks: wave or classical.")] = "wave",
    seed: Annotated[int, typer.Option(min=0, help="Random seed for prompts, for segmenters that use them.")] = 0,
    objects: Objects = None,
    sight: Sight = None,
    experiment: ExperimentNumber = None,
    truth: Annotated[
        str,
        typer.Option(
            help="True masks: from the camera's picture (camera), or the exact ones of simulated data (exact)."
        ),
    ] = "camera",
    transform: Transform = None,
    crop: Crop = None,
    split: Annotated[
        str,
        typer.Option(
            help="objects: by what each classifier saw in training. published: the test images of the authors' split, "
            "whatever it saw."
        ),
    ] = "objects",
    classes: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME,...",
            help="Compare among these classes alone, and leave out objects of others: can,handle,box,sphere for the "
            "paper's. [default: all that a classifier knows]",
        ),
    ] = None,
    as_published: Annotated[
        bool,
        typer.Option("--as-published", help="Classify in the masks beside the images, as the paper's table does."),
    ] = False,
    mistakes: Annotated[int, typer.Option(min=0, help="Number of mistakes of each classifier to plot.")] = 12,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Compare predicted with true classes. Masks are predicted and true ones, objects known and new ones.

    The description beside a classifier's weights lists its training data. An image of an object from the training data
    is object-closed, one of a new object is object-disjoint; other images are left out. Training and test must not
    share poses, seeds or physics. Writes OUT/index.html, and each table as Markdown and CSV. Run it again to continue
    after an interruption. A scene that cannot be read does not stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate classification unseen -o named --weights both/classifier.onnx
    """
    options = {
        "weights": weights or (),
        "method": method,
        "seed": seed,
        "truth": truth,
        "transform": transform,
        "crop": None if crop is None else slices(crop, option="--crop"),
        "split": split,
        "classes": () if classes is None else [name.strip() for name in classes.split(",")],
        "as_published": as_published,
        "mistakes": mistakes,
    }
    _evaluate(
        "classification",
        root,
        output,
        objects,
        sight,
        experiment,
        workers,
        as_json=as_json,
        label="classify",
        **options,
    )


@app.command("surface")
def surface(
    root: Root,
    output: Output = Path("surface-evaluation"),
    spacing: Spacing = "2mm",
    clutter: HiddenClutter = "lid",
    false_alarms: FalseAlarms = 1e-6,
    objects: Objects = None,
    sight: Sight = None,
    experiment: ExperimentNumber = None,
    support: SupportHeight = None,
    failures: Failures = 4,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Compare oriented points of captures with true surfaces. Of 77 GHz: F-score, precision, recall, normals.

    For scenes of the virtual rig, whose objects' shapes are known, with captures (keep = "captures" or "raw" in the
    recipe). Two baselines on the same captures: voxels above 0.3 of the maximum, and of each column the voxel where the
    image is largest. Writes OUT/index.html, and each table as Markdown and CSV. Run it again to continue after an
    interruption.

    Example: millisight evaluate surface bench24 -o surfaces
    """
    step = length(spacing, option="--spacing", metres=SMALL)
    options = {"spacing": (step, 2 * step), "clutter": clutter, "false_alarms": false_alarms, "failures": failures}
    options["support"] = optional_length(support, option="--support")
    _evaluate(
        "surface", root, output, objects, sight, experiment, workers, as_json=as_json, label="surfaces", **options
    )


@app.command("pose")
def pose(
    root: Root,
    output: Output = Path("pose-evaluation"),
    spacing: Spacing = "2mm",
    clutter: HiddenClutter = "lid",
    which: Annotated[
        bool, typer.Option("--which", help="Also choose the object among all of the dataset; takes some times as long.")
    ] = False,
    objects: Objects = None,
    sight: Sight = None,
    experiment: ExperimentNumber = None,
    support: SupportHeight = None,
    failures: Failures = 4,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Compare poses found in captures with the true ones. Of 77 GHz: ADD, ADD-S, turn, place, success, coverage.

    For scenes of the virtual rig, whose objects' shapes are known, with captures (keep = "captures" or "raw" in the
    recipe). Meshes are handed over turned at random. A baseline puts each object upright at the brightest place. Writes
    OUT/index.html, and each table as Markdown and CSV. Run it again to continue after an interruption. With --which the
    baseline chooses the object whose size is nearest to that of what was seen.

    Example: millisight evaluate pose bench24 -o poses
    """
    step = length(spacing, option="--spacing", metres=SMALL)
    options = {"spacing": (step, 2 * step), "clutter": clutter, "which": which, "failures": failures}
    options["support"] = optional_length(support, option="--support")
    _evaluate("pose", root, output, objects, sight, experiment, workers, as_json=as_json, label="poses", **options)


def _evaluate(
    task: str,
    dataset: Path,
    output: Path,
    objects: list[str] | None,
    sight: str | None,
    experiment: int | None,
    workers: int | None,
    *,
    as_json: bool,
    label: str,
    **options: Any,
) -> None:
    """Run a task, print its main tables, and end with its failures."""
    from millisight.datasets import evaluate

    sight = checked_sight(sight)
    with progress(label, compiles=False) as report:
        result = evaluate(
            task,
            dataset,
            output=output,
            objects=objects or (),
            sight=sight,
            experiment=experiment,
            workers=workers,
            progress=report,
            **options,
        )
    page = output / "index.html" if result.rows else None
    failures = [(name, in_options(reason)) for name, reason in result.failures]
    if as_json:
        answer_json({
            "task": task,
            "page": page,
            "tables": [table.to_dict() for table in result.summary],
            "notes": list(result.planned.notes),
            "failures": [{"name": name, "reason": reason} for name, reason in failures],
        })  # fmt: skip
    with json_only(as_json):
        if result.cached:
            say(f"{result.cached} results came from an earlier run")
        for table in () if as_json else result.summary:
            for line in (*table.markdown().splitlines(), ""):
                answer(line)
        if page is not None:
            say(f"wrote {page}")
        for note in result.planned.notes:
            say(f"note: {note}")
    end_with_failures([f"{name}: {reason}" for name, reason in failures])
