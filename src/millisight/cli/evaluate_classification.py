"""`millisight evaluate classification`: the paper's table of classes, on known and on new objects."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from millisight.cli.console import end_with_failures, in_options, progress, say, slices
from millisight.cli.evaluate_scenes import (
    Output,
    Root,
    Transform,
    checked_settings,
    chosen_scenes,
    described,
    physics_of_all,
)
from millisight.cli.options import Crop, Objects, Sight, Workers
from millisight.errors import InputError

if TYPE_CHECKING:
    from millisight.datasets.classified import Heard, Origin
    from millisight.datasets.judging import Settings
    from millisight.datasets.scenes import SceneFiles
    from millisight.evaluation.classes import Answer, Variant
    from millisight.evaluation.leaks import Plan, Training
    from millisight.evaluation.tables import Table
    from millisight.perception.classification import Classifier
    from millisight.perception.segmentation import Segmenter
    from millisight.viz.classification_report import Mistake


_CLOCKED = 8  # scenes, at most
_NAMED = 5  # objects in a message
_SAID = ("classifiers", "object-closed", "object-disjoint", "times")


class _Candidate(NamedTuple):
    """A classifier that is judged: its weights, None for the shipped ones; what it learned from; what it is asked."""

    weights: str | None
    variant: "Variant"
    class_names: tuple[str, ...]
    training: "Training"
    plan: "Plan"


def classification(
    root: Root,
    output: Output,
    weights: Annotated[
        list[Path] | None,
        typer.Option(
            "--weights", metavar="FILE.onnx", help="A trained classifier; repeatable. [default: the shipped one]"
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="Segmenter of the predicted masks: wave or classical.")] = "wave",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the segmenter's prompts, where it takes some.")] = 0,
    objects: Objects = None,
    sight: Sight = None,
    truth: Annotated[
        str, typer.Option(help="True masks: the camera's, or of simulated data the exact ones.")
    ] = "camera",
    transform: Transform = None,
    crop: Crop = "0,0",
    mistakes: Annotated[int, typer.Option(min=0, help="So many mistakes of each classifier are drawn.")] = 12,
    workers: Workers = None,
) -> None:
    """Judge classifiers, in predicted and in true masks, on objects that they know and on new ones.

    What a classifier learned from stands beside its weights: by it each image is object-closed, object-disjoint, or
    left out, and training and test must share no pose, seed or physics. Writes OUT/index.html, and each table as
    Markdown and CSV. Run it again to go on after an interruption: what is done is kept. A scene that cannot be read
    does not stop the rest; the exit code is 1 if any failed.

    Example: millisight evaluate classification classes -o named --weights both/classifier.onnx
    """
    from millisight.datasets.classified import ask, origins
    from millisight.evaluation.classification_tables import time_table

    dataset, scenes = chosen_scenes(root, objects, sight)
    physics, failures = physics_of_all(scenes)
    data, simulated = described(physics, root)
    reading = {
        "truth": truth,
        "transform": transform or ("file" if simulated else "published"),
        "crop": slices(crop, option="--crop"),
    }
    settings = checked_settings([method], seeds=(seed,), reading=reading)
    found = origins(dataset, scenes)
    known = {files.name: files for files in scenes if files.name in physics}
    candidates = _candidates(_paths(weights), list(known.values()), physics, found)
    wanted = {one.weights: [known[scene] for scene in one.plan.placed] for one in candidates}
    if not any(wanted.values()):
        raise InputError(f"{root} holds no image that is a test. {_why_none(candidates, known)}")
    with progress("classify", compiles=False) as report:
        heard = ask(wanted, output / "answers", settings, method=method, workers=workers, progress=report)
    if heard.kept:
        say(f"{heard.kept} results were there already")
    answers = _answers(candidates, known, found, heard)
    if answers:
        names = {scene: files.object for scene, files in known.items()}
        about = _about(candidates, names, settings, method, data, simulated)
        times = _times(
            candidates, [known[scene] for scene in dict.fromkeys(one.scene for one in answers)], settings, method
        )
        drawn = _mistakes(answers, mistakes, known, settings, method)
        for table in _write(output, answers, about, time_table(times, data=data), data, drawn):
            say(table.markdown() + "\n")
        say(f"wrote {output / 'index.html'}")
    lines = [f"{scene}: {in_options(reason)}" for scene, reason in sorted([*failures, *heard.failures])]
    end_with_failures(lines)


def _paths(weights: list[Path] | None) -> list[str | None]:
    return list(dict.fromkeys(str(path.resolve()) for path in weights)) if weights else [None]


def _candidates(
    paths: "Sequence[str | None]",
    scenes: "Sequence[SceneFiles]",
    physics: Mapping[str, str],
    found: "Mapping[str, Origin]",
) -> list[_Candidate]:
    """The classifiers, each with what it is asked; leaks are refused here."""
    from millisight.datasets.classified import classifier
    from millisight.evaluation.leaks import TestImage, classes_of, plan, training_of

    try:
        loaded = [classifier(path) for path in paths]
    except ImportError as error:
        raise InputError(str(error)) from error
    images = [
        TestImage(one.name, one.object, found[one.name].angles, physics[one.name], found[one.name].seeds)
        for one in scenes
    ]
    candidates = []
    for path, by, variant in zip(paths, loaded, _variants(paths, loaded), strict=True):
        training = training_of(variant.name, by.description)
        classes = classes_of(by.description, by.class_names)
        candidates.append(_Candidate(path, variant, by.class_names, training, plan(training, images, classes)))
    return candidates


def _variants(paths: "Sequence[str | None]", loaded: "Sequence[Classifier]") -> "list[Variant]":
    """Each by a name of its own: the description's, and where several share it also what tells them apart."""
    from millisight.evaluation.classes import Variant

    names = [by.name for by in loaded]
    parts, networks, sums = (
        [str(by.description.get(key, "")) for by in loaded] for key in ("parts", "network", "sha256")
    )
    folders = ["shipped" if path is None else Path(path).parent.name for path in paths]
    for more in (parts, networks, folders, [one[:8] for one in sums], range(1, len(names) + 1)):
        alike = [names.count(name) > 1 for name in names]
        names = [f"{name}, {what}" if same else name for name, what, same in zip(names, more, alike, strict=True)]
    return [Variant(*told) for told in zip(names, parts, networks, strict=True)]


def _answers(
    candidates: Sequence[_Candidate],
    scenes: "Mapping[str, SceneFiles]",
    found: "Mapping[str, Origin]",
    heard: "Heard",
) -> "list[Answer]":
    from millisight.evaluation.classes import Answer

    return [
        Answer(
            scene=scene,
            object=scenes[scene].object,
            sight=scenes[scene].sight,
            shape=found[scene].shape,
            truth=truth,
            variant=one.variant,
            split=split,
            **said._asdict(),
        )
        for one in candidates
        for scene, (split, truth) in one.plan.placed.items()
        for said in heard.said.get((one.weights, scene), ())
    ]


def _about(
    candidates: Sequence[_Candidate],
    objects: Mapping[str, str],
    settings: "Settings",
    method: str,
    data: str,
    simulated: bool,
) -> "Table":
    """What each network learned from; below it what the images and masks are."""
    from millisight.evaluation.classification_tables import classifier_table

    notes = []
    if simulated:
        notes.append("All images are the virtual rig's. Nothing was measured: these are no results on real data.")
    tested = {objects[scene] for one in candidates for scene in one.plan.placed}
    exact = settings.reading["truth"] == "exact"
    true = "the pixels over the object" if exact else "the camera's in line of sight, moved to the image"
    notes.append(f"Predicted masks are by {_segmenter(settings.segmenter(method), tested)}. True masks are {true}.")
    judged = [(one.variant, one.training, one.plan) for one in candidates]
    return classifier_table(judged, objects, data=data, notes=notes)


def _segmenter(by: "Segmenter", tested: set[str]) -> str:
    """Which segmenter, and what its network saw in training of the tested objects."""
    sides = getattr(by, "description", {}).get("objects")
    if sides is None:
        return by.name
    seen = sorted(tested & {name for names in sides.values() for name in names})
    told = f"; of the tested objects its network saw {len(seen)}: {', '.join(seen)}" if seen else ""
    return f"{by.name}{told or ', whose network saw none of the tested objects'}"


def _why_none(candidates: Sequence[_Candidate], scenes: "Mapping[str, SceneFiles]") -> str:
    """How many images, and of what, each classifier was not asked about; and what helps."""
    from millisight.evaluation.leaks import NO_CLASS

    told = []
    for one in candidates:
        left_out = (
            f"{len(some)} {reason} ({_few({scenes[scene].object for scene in some})})"
            for reason, some in sorted(one.plan.left_out.items())
        )
        told.append(f"{one.training.name}, which knows {', '.join(one.class_names)}: {', '.join(left_out)}")
    if any(NO_CLASS in one.plan.left_out for one in candidates):
        told[-1] += "; name an object in `classes` and in `tests` of the recipe of training to tell its class"
    return f"Left out of {'; of '.join(told)}"


def _few(names: set[str]) -> str:
    some = sorted(names)
    return ", ".join(some[:_NAMED]) + (f" and {len(some) - _NAMED} more" if len(some) > _NAMED else "")


def _times(
    candidates: Sequence[_Candidate], scenes: "Sequence[SceneFiles]", settings: "Settings", method: str
) -> "dict[Variant, list[tuple[float, float]]]":
    """How long classification and segmentation take, for a few scenes of all that there are."""
    from millisight.datasets.classified import clocked

    some = scenes[:: -(-len(scenes) // _CLOCKED)]
    found = clocked([one.weights for one in candidates], some, settings, method)
    return {one.variant: found[one.weights] for one in candidates}


def _mistakes(
    answers: "Sequence[Answer]", count: int, scenes: "Mapping[str, SceneFiles]", settings: "Settings", method: str
) -> "list[Mistake]":
    """Each classifier's surest mistakes, their masks made once more: the same seed gives the same mask."""
    from functools import cache

    from millisight.datasets.classified import masked
    from millisight.evaluation.classes import SPLITS
    from millisight.evaluation.classification_tables import variants_of, worst
    from millisight.viz.classification_report import Mistake

    @cache
    def seen(scene: str):
        return masked(scenes[scene], settings, method)

    return [
        Mistake(answer, *seen(answer.scene))
        for split in SPLITS
        for variant in variants_of(answers)
        for answer in worst(answers, split, variant, count)
    ]


def _write(
    output: Path,
    answers: "Sequence[Answer]",
    about: "Table",
    times: "Table",
    data: str,
    mistakes: "Sequence[Mistake]",
) -> "list[Table]":
    """Everything into the folder; the tables that say most."""
    from millisight.evaluation.classification_tables import all_tables, answer_table, bin_table, confusion_table
    from millisight.files import write_text
    from millisight.viz.classification_report import write_report

    tables = {"classifiers": about, **all_tables(answers, data=data), "times": times}
    files = {
        **tables,
        "answers": answer_table(answers, data=data),
        "confusions": confusion_table(answers, data=data),
        "reliability": bin_table(answers, data=data),
    }
    write_text(output / "classification.md", "\n\n".join(table.markdown() for table in tables.values()) + "\n")
    for name, table in files.items():
        write_text(output / f"{name}.csv", table.csv())
    write_report(output, data=data, answers=answers, tables=list(tables.values()), mistakes=mistakes)
    return [table for name, table in tables.items() if name in _SAID or name.endswith("-pairs")]
