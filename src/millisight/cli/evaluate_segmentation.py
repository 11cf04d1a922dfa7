"""`millisight evaluate segmentation`: the paper's table of masks, for every segmenter asked for."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from millisight.cli.console import end_with_failures, in_options, length, progress, say, slices
from millisight.cli.evaluate_scenes import (
    Output,
    Root,
    Transform,
    checked_settings,
    chosen_scenes,
    described,
    physics_of_all,
)
from millisight.cli.options import Crop, Objects, SamDevice, Sight, Workers

if TYPE_CHECKING:
    from millisight.datasets.judging import Settings
    from millisight.datasets.scenes import SceneFiles
    from millisight.evaluation.segmentation import Trial
    from millisight.evaluation.tables import Table
    from millisight.viz.segmentation_report import Failure


def segmentation(
    root: Root,
    output: Output,
    method: Annotated[
        list[str] | None,
        typer.Option("--method", help="Segmenter: wave, classical or sam; repeatable. [default: wave, classical]"),
    ] = None,
    sam_model: Annotated[
        str, typer.Option(help="Of sam: vit-b, vit-l, vit-h, sam2-tiny, sam2-large, or a folder with weights.")
    ] = "vit-b",
    device: SamDevice = "cpu",
    objects: Objects = None,
    sight: Sight = None,
    seeds: Annotated[int, typer.Option(min=1, help="So many seeds of the prompts: 0, 1, 2 and so on.")] = 3,
    truth: Annotated[
        str,
        typer.Option(help="What masks are compared with: the camera's mask, or of simulated data the exact one."),
    ] = "camera",
    transform: Transform = None,
    support: Annotated[
        str | None,
        typer.Option(help="Height of the support's face in the radar frame, such as -30cm. [default: by background]"),
    ] = None,
    crop: Crop = "0,0",
    failures: Annotated[int, typer.Option(min=0, help="Worst masks of each segmenter to show.")] = 6,
    workers: Workers = None,
) -> None:
    """Judge segmenters by the paper's metrics: on photos, at 24 GHz, at 77 GHz, and with both.

    Writes OUT/index.html, and each table as Markdown and CSV. Run it again to go on after an interruption: what is done
    is kept. A scene that cannot be read does not stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate segmentation bench24 -o masks --method wave --method classical
    """
    from millisight.datasets.judging import judge

    methods = list(dict.fromkeys(method or ("wave", "classical")))
    _, scenes = chosen_scenes(root, objects, sight)
    physics, _ = physics_of_all(scenes)  # scenes that do not tell fail when they are judged
    data, simulated = described(physics, root)
    transform = transform or ("file" if simulated else "published")
    height = None if support is None else length(support, option="--support")
    reading = {"truth": truth, "transform": transform, "support": height, "crop": slices(crop, option="--crop")}
    options = {"sam": {"model": sam_model, "device": device}}
    settings = checked_settings(methods, seeds=range(seeds), reading=reading, options=options)
    with progress("judge", compiles=False) as report:
        judged = judge(scenes, methods, output / "trials", settings, workers=workers, progress=report)
    if judged.kept:
        say(f"{judged.kept} results were there already")
    if judged.trials:
        notes = _notes(judged.trials, methods, settings, truth, simulated)
        tables = _tables(judged.trials, data, notes)
        _write(output, judged.trials, tables, data, _failures(judged.trials, failures, scenes, settings))
        for table in tables.values():
            say(table.markdown())
        say(f"wrote {output / 'index.html'}")
    end_with_failures([f"{scene}, {name}: {in_options(reason)}" for scene, name, reason in judged.failures])


def _notes(
    trials: "Sequence[Trial]", methods: list[str], settings: "Settings", truth: str, simulated: bool
) -> list[str]:
    """What is said below the tables: the truth, and what networks saw of the tested objects."""
    compared = (
        "the camera's mask of the object in line of sight, moved to the image's grid"
        if truth == "camera"
        else "the exact pixels over which the object lies"
    )
    notes = [f"Compared with {compared}."]
    if simulated:
        notes.append(
            "Everything was simulated by the virtual rig. Accuracy, and the camera's precision out of sight, depend on "
            "how much of the surroundings an image shows; where images are cut, as in small benchmarks, they cannot be "
            "compared with the paper's."
        )
    tested = {one.object for one in trials}
    return notes + [_seen(settings.segmenter(name), tested) for name in methods]


def _seen(by: Any, tested: set[str]) -> str:
    """What the segmenter's network saw in training of the tested objects."""
    if by.name == "classical":
        return "classical: no network; its levels were chosen on the scenes of examples/recipes/bench24.toml."
    told = getattr(by, "description", {})
    sides = told.get("objects")
    if sides is None:
        return f"{by.name}: which objects its network saw in training is not known."
    seen = {name for names in sides.values() for name in names}
    both = sorted(tested & seen)
    name = f"{by.name} (weights {told['sha256'][:8]})"
    if both:
        return f"{name}: NOT a fair test, its network saw {len(both)} of the tested objects: {', '.join(both)}."
    return f"{name}: its network saw {len(seen)} objects in training and validation, none of the {len(tested)} tested."


def _tables(trials: "Sequence[Trial]", data: str, notes: list[str]) -> "dict[str, Table]":
    from millisight.evaluation.segmentation_tables import SIGHTS, difference_table, median_table

    there = {one.sight for one in trials}
    tables = {sight: median_table(trials, sight, data=data, notes=notes) for sight in SIGHTS if sight in there}
    return {**tables, "differences": difference_table(trials, data=data)}


def _write(
    output: Path,
    trials: "Sequence[Trial]",
    tables: "dict[str, Table]",
    data: str,
    failures: "list[Failure]",
) -> None:
    from millisight.evaluation.segmentation_tables import trial_table
    from millisight.files import write_text
    from millisight.viz.segmentation_report import write_report

    write_text(output / "segmentation.md", "\n\n".join(table.markdown() for table in tables.values()) + "\n")
    for name, table in (*tables.items(), ("trials", trial_table(trials, data=data))):
        write_text(output / f"{name}.csv", table.csv())
    introduction = (
        f"Segmenters on {data}. A mask is compared with the truth pixel by pixel; the tables tell the medians, and the "
        "pictures below show each segmenter's worst masks."
    )
    write_report(
        output,
        title="Segmentation",
        introduction=introduction,
        data=data,
        trials=trials,
        tables=list(tables.values()),
        failures=failures,
    )


def _failures(
    trials: "Sequence[Trial]", count: int, scenes: "Sequence[SceneFiles]", settings: "Settings"
) -> "list[Failure]":
    """The worst masks made once more: the same seed gives the same mask."""
    from millisight.datasets.scenes import read_scene
    from millisight.evaluation.segmentation import Judge
    from millisight.evaluation.segmentation_tables import worst
    from millisight.viz.segmentation_report import Failure

    by_name = {files.name: files for files in scenes}
    found = []
    for one in worst(trials, count):
        judge = Judge(settings.segmenter(one.method), read_scene(by_name[one.scene], **settings.reading))
        attempt = judge.attempt(one.input, one.seed)
        found.append(Failure(one, judge.pictures[one.input], attempt, judge.truth(one.input)))
    return found
