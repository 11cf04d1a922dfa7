"""Scenes of a dataset named by classifiers, in several processes; what is done is kept, so that a run can go on."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from millisight.datasets.inventory import Dataset
from millisight.datasets.judging import Settings
from millisight.datasets.kept import checksum_of, keep, kept, key_of
from millisight.datasets.manifest import read_manifest
from millisight.datasets.scenes import SceneFiles, read_scene
from millisight.datasets.workers import each
from millisight.errors import FileError, InputError
from millisight.evaluation.classes import PREDICTED, TRUE
from millisight.evaluation.masks import score_mask
from millisight.evaluation.segmentation import HIGH, LOW
from millisight.files import make_folder, read_toml
from millisight.imaging.image import SarImage
from millisight.io.mito_names import TRUTH, angles_of
from millisight.perception import classification
from millisight.perception.classification import Classifier, Prediction
from millisight.perception.segmentation import Mask, segment
from millisight.records import record
from millisight.scene.objects import CATALOGUE

_FORMAT = 1


@record
class Origin:
    """What a dataset tells of a scene beside its images.

    Attributes
    ----------
    angles : of the object about x, y and z [degrees]
    shape : "built" by the catalogue, a real "scan", a "file" of the recipe's own; "unknown" of what was not generated
    seeds : with which it was made; none of what was not generated
    """

    angles: tuple[int, int, int]
    shape: str
    seeds: frozenset[int]


def origins(dataset: Dataset, scenes: Sequence[SceneFiles]) -> dict[str, Origin]:
    """Of each scene, by its name: from its folder's name, and of generated ones from `truth` and the manifest.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    manifest = read_manifest(dataset.root)
    seed = None if manifest is None else manifest.settings.get("seed")
    common = {seed} if isinstance(seed, int) else set()
    found = {}
    for files in scenes:
        folder, turned, rest = files.name.split("/", 2)
        worlds = sorted((dataset.root / TRUTH / folder / "robot_collected" / turned / rest).glob("*/world.toml"))
        told = [read_toml(path, "world") for path in worlds]
        found[files.name] = Origin(
            angles=angles_of(turned) or (0, 0, 0),
            shape=_shape(told[0], files.object) if told else "unknown",
            seeds=frozenset(common | {world["seed"] for world in told if isinstance(world.get("seed"), int)}),
        )
    return found


def _shape(world: Mapping[str, Any], name: str) -> str:
    objects = world.get("objects") or [{}]
    if not (isinstance(objects, list) and isinstance(objects[0], dict)):
        return "unknown"
    if objects[0].get("object"):
        return "built"
    return "scan" if name in CATALOGUE else "file"  # a mesh of what the catalogue would have drawn


@lru_cache(maxsize=16)
def classifier(weights: str | None) -> Classifier:
    """The classifier of a weights file, None: the shipped one; one for all scenes of a process."""
    return classification.Classifier(weights)


class Said(NamedTuple):
    """What a classifier says of a scene in one kind of masks; fields as of `evaluation.classes.Answer`."""

    masks: str
    prediction: Prediction | None
    failure: str
    iou: float


class Heard(NamedTuple):
    """What was said, by (weights, scene); (scene, why) of what could not be judged; how many were there already."""

    said: dict[tuple[str | None, str], list[Said]]
    failures: list[tuple[str, str]]
    kept: int


class _Job(NamedTuple):
    files: SceneFiles
    method: str
    settings: Settings
    weights: tuple[tuple[str | None, str], ...]  # of each classifier, and its checksum


def ask(
    wanted: Mapping[str | None, Sequence[SceneFiles]],
    folder: Path,
    settings: Settings,
    *,
    method: str = "wave",
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Heard:
    """Every classifier about its scenes, in predicted and in true masks; results go to `folder`, a file each.

    A scene that cannot be read is a failure of its own, and stops no other. A result is used again while the scene's
    files, the classifier's and the segmenter's weights and the settings are the same.

    Parameters
    ----------
    wanted : scenes by the weights of the classifier that is asked, None for the shipped one's
    settings : of the segmenter its options, of which the first seed draws prompts; and for `read_scene`
    method : name of the segmenter
    workers : processes; None: one a core
    progress : called with (done, in all)

    Raises
    ------
    FileError
        The folder cannot be written to.
    """
    folder = make_folder(folder)
    segmenter = checksum_of(settings.segmenter(method))
    sums = {weights: checksum_of(classifier(weights)) for weights in wanted}
    said: dict[tuple[str | None, str], list[Said]] = {}
    jobs: dict[str, _Job] = {}
    for weights, scenes in wanted.items():
        for files in scenes:
            key = _key(_Job(files, method, settings, ((weights, sums[weights]),)), segmenter)
            there = kept(_place(folder, sums[weights], files), key, _heard)
            if there is not None:
                said[weights, files.name] = there
            else:
                before = jobs[files.name].weights if files.name in jobs else ()
                jobs[files.name] = _Job(files, method, settings, (*before, (weights, sums[weights])))
    kept_count, failures = len(said), []
    left = list(jobs.values())
    with closing(each(_asked, left, workers=workers)) as outcomes:
        for count, (number, result, failure) in enumerate(outcomes, 1):
            job = left[number]
            if failure:
                failures.append((job.files.name, failure))
            else:
                for weights, found in zip(job.weights, result, strict=True):
                    said[weights[0], job.files.name] = found
                    key = _key(job._replace(weights=(weights,)), segmenter)
                    keep(_place(folder, weights[1], job.files), key, said=_plain(found))
            if progress is not None:
                progress(count, len(left))
    return Heard(said, sorted(failures), kept_count)


def masked(files: SceneFiles, settings: Settings, method: str) -> tuple[SarImage, Mask | None, Mask]:
    """The 77 GHz image of a scene, the mask that the segmenter finds, None where it finds none, and the true one.

    Raises
    ------
    FileError, FormatError, DamagedFileError, InputError
        As `read_scene`; or there is no 77 GHz image.
    """
    image, other, truth = _read(files, settings)
    return image, _predicted(files, image, other, settings, method)[0], truth


def clocked(
    weights: Sequence[str | None], scenes: Sequence[SceneFiles], settings: Settings, method: str
) -> dict[str | None, list[tuple[float, float]]]:
    """How long each classifier takes for these scenes, and the segmenter before it [s], one after another.

    The first scene is done once more before the clock runs. Scenes without a mask are passed over.

    Raises
    ------
    FileError, FormatError, DamagedFileError, InputError
        As `masked`.
    """
    found: dict[str | None, list[tuple[float, float]]] = {one: [] for one in weights}
    for number, files in enumerate([*scenes[:1], *scenes]):
        image, other, _ = _read(files, settings)
        begun = perf_counter()
        mask, _ = _predicted(files, image, other, settings, method)
        segmenting = perf_counter() - begun
        if mask is None:
            continue
        for one in weights:
            begun = perf_counter()
            classifier(one).classify(image, mask, other_band=other)
            seconds = perf_counter() - begun
            if number:
                found[one].append((seconds, segmenting))
    return found


def _read(files: SceneFiles, settings: Settings) -> tuple[SarImage, SarImage | None, Mask]:
    if HIGH not in files.images:
        raise FileError(f"{files.name} has no image at {HIGH}; expected processed_image.pkl of that radar")
    # What the camera sees of this very scene is nothing to a classifier.
    scene = read_scene(dataclasses.replace(files, frame=None), **settings.reading)
    return scene.images[HIGH], scene.images.get(LOW), scene.truth[HIGH]


def _predicted(
    files: SceneFiles, image: SarImage, other: SarImage | None, settings: Settings, method: str
) -> tuple[Mask | None, str]:
    """The mask, and why there is none."""
    try:
        mask = segment(
            image,
            other_band=other,
            method=settings.segmenter(method),
            rng=settings.seeds[0],
            condition=files.sight,
        )
    except InputError as error:
        return None, " ".join(str(error).split())
    return (mask, "") if mask.inside.any() else (None, "the mask is empty")


def _asked(job: _Job) -> list[list[Said]]:
    """Of each classifier what it says of the scene in the predicted and in the true mask."""
    image, other, truth = _read(job.files, job.settings)
    mask, failure = _predicted(job.files, image, other, job.settings, job.method)
    iou = 0.0 if mask is None else score_mask(mask, truth).iou
    found = []
    for weights, checksum in job.weights:
        by = classifier(weights)
        if checksum_of(by) != checksum:
            raise InputError(f"the weights of {by.name} have changed since the run began; run it again")
        one = None if mask is None else by.classify(image, mask, other_band=other)
        best = by.classify(image, truth, other_band=other)
        found.append([Said(PREDICTED, one, failure, iou), Said(TRUE, best, "", 1.0)])
    return found


def _place(folder: Path, checksum: str, files: SceneFiles) -> Path:
    return folder / f"{checksum[:12]}.{files.name.replace('/', '.')}.json"


def _key(job: _Job, segmenter: str) -> str:
    return key_of(
        dataclasses.replace(job.files, frame=None).paths,
        format=_FORMAT,
        segmenter=segmenter,
        classifiers=[checksum for _, checksum in job.weights],
        **job.settings.plain(job.method),
    )


def _plain(said: Sequence[Said]) -> list[dict[str, Any]]:
    """As JSON holds it."""
    return [
        one._asdict()
        | {
            "prediction": None
            if one.prediction is None
            else {
                "probabilities": one.prediction.probabilities.tolist(),
                "class_names": one.prediction.class_names,
                "threshold": one.prediction.threshold,
            }
        }
        for one in said
    ]


def _heard(content: Mapping[str, Any]) -> list[Said]:
    """What an earlier run heard and kept."""
    return [
        Said(**{**one, "prediction": None if one["prediction"] is None else Prediction(**one["prediction"])})
        for one in content["said"]
    ]
