"""The task "classification": classifiers in predicted and true masks, on known and new objects (paper Table 3)."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar, NamedTuple

from millisight.core import checked_integer, put, record
from millisight.core.errors import FileError, InputError
from millisight.data import Mask, Prediction, SarImage
from millisight.evaluation._answers import PREDICTED, SPLITS, TRUE, ClassifierAnswer, Variant, chosen
from millisight.evaluation._metrics import score_mask
from millisight.evaluation._scenes import HIGH, LOW, checksum_of, named_segmenter
from millisight.evaluation._sources import EvaluationData, SceneSource, survey
from millisight.evaluation._tables import Table
from millisight.evaluation._task import TASKS, EvaluationItem, EvaluationSet, ReportFigure, Task
from millisight.evaluation.tasks._candidates import Candidate, candidates_of, load_classifier, why_none
from millisight.evaluation.tasks._classification_tables import (
    all_tables,
    answer_table,
    bin_table,
    classifier_table,
    confusion_table,
    of_papers_classes,
    time_table,
    variants_of,
    worst,
)
from millisight.meshes import object_name
from millisight.perception.classification import classify
from millisight.perception.segmentation import segment

_FORMAT = 3
_TIMED = 8  # scenes, at most
OBJECTS = "objects"


class Mistake(NamedTuple):
    """One wrong answer, to be plotted.

    Attributes
    ----------
    answer : ClassifierAnswer
    image : at 77 GHz
    mask : the predicted one; None: there is none
    truth : the true mask
    """

    answer: ClassifierAnswer
    image: SarImage
    mask: Mask | None
    truth: Mask


class _ClassifierSource(NamedTuple):
    """A scene, and by the part of the result the weights and checksum of each classifier that is run on it."""

    scene: SceneSource
    method: str
    checksum: str
    seed: int
    reading: Mapping[str, Any]
    weights: Mapping[str, tuple[str | None, str]]
    as_published: bool = False

    def read(self) -> tuple[SarImage, SarImage | None, Mask]:
        """The 77 GHz image, the 24 GHz image where there is one, and the true mask; as published, the one beside it."""
        if HIGH not in self.scene.bands:
            raise FileError(f"{self.scene.name} has no image at {HIGH}; expected processed_image.pkl of that radar")
        if self.as_published:
            mask = self.scene.published_mask(HIGH)
            if mask is None:
                raise FileError(f"{self.scene.name} has no mask beside its image; expected radar_masks.pkl")
            return self.scene.read_image(HIGH, crop=self.reading["crop"])[0], None, mask
        scene = self.scene.read(view=False, **self.reading)
        return scene.images[HIGH], scene.images.get(LOW), scene.truth[HIGH]

    def predict(self, image: SarImage, other: SarImage | None) -> tuple[Mask | None, str]:
        """The mask that the segmenter finds, or as published the one beside the image; or None, and the reason."""
        if self.as_published:
            return self.scene.published_mask(HIGH), ""
        by = named_segmenter(self.method, {})
        if checksum_of(by) != self.checksum:
            raise InputError(f"the weights of {self.method} have changed since the run began; run it again")
        try:
            mask = segment(image, other_band=other, method=by, rng=self.seed, condition=self.scene.sight)
        except InputError as error:
            return None, " ".join(str(error).split())
        return (mask, "") if mask.inside.any() else (None, "the mask is empty")


@TASKS.add("classification")
@record
class ClassificationTask(Task):
    """Compare predicted with true classes.

    Attributes
    ----------
    weights : files of trained classifiers: ONNX, or the authors' state dicts (.h5); none: the shipped one
    method : segmenter of the predicted masks
    seed : random seed for its prompts
    truth, transform, crop : as of the task "segmentation"
    split : "objects", by what each classifier saw of them; "published", the test images of the authors' newest split,
        or the name of one of their splits
    classes : the answers are among these, and objects of other classes are left out; none: all that a classifier knows
    as_published : classify in the masks that the dataset has beside its images, as the paper's table does; no mask is
        compared with the camera's
    mistakes : number of mistakes of each classifier to plot
    """

    name: ClassVar[str] = "classification"
    title: ClassVar[str] = "Classification"
    cache: ClassVar[str] = "answers"

    weights: Sequence[str | Path] = ()
    method: str = "wave"
    seed: int = 0
    truth: str = "camera"
    transform: str | None = None
    crop: tuple[int, int] | None = None
    split: str = OBJECTS
    classes: Sequence[str] = ()
    as_published: bool = False
    mistakes: int = 12

    def __post_init__(self) -> None:
        weights = (self.weights,) if isinstance(self.weights, str | Path) else self.weights
        put(
            self,
            weights=tuple(dict.fromkeys(str(Path(one).resolve()) for one in weights)),
            crop=None if self.crop is None else tuple(self.crop),
            classes=(self.classes,) if isinstance(self.classes, str) else tuple(self.classes),
        )
        checked_integer(self.seed, name="seed", minimum=0)
        checked_integer(self.mistakes, name="mistakes", minimum=0)

    def plan(self, data: EvaluationData) -> EvaluationSet:
        """One item for each scene that tests a classifier; leaks between training and test are refused."""
        found = survey(data, transform=self.transform, truth=self.truth, crop=self.crop)
        segmenter = checksum_of(named_segmenter(self.method, {}))
        scenes = {scene.name: scene for scene in data.scenes if scene.name in found.physics}
        origins = data.origins()
        weights = [str(one) for one in self.weights] or [None]
        split = None if self.split == OBJECTS else data.split(self.split)
        candidates = candidates_of(weights, scenes.values(), found.physics, origins, split, self.classes)
        shared = {"format": _FORMAT, "segmenter": segmenter, "method": self.method, "seed": self.seed,
                  "reading": found.reading, "as_published": self.as_published}  # fmt: skip
        items = []
        for name in dict.fromkeys(name for one in candidates for name in one.splits.placed):
            by_part = {one.part(name): (one.weights, one.checksum) for one in candidates if name in one.splits.placed}
            items.append(
                EvaluationItem(
                    name=name,
                    source=_ClassifierSource(
                        scenes[name], self.method, segmenter, self.seed, found.reading, by_part, self.as_published
                    ),
                    parts={part: {**shared, "classifier": checksum} for part, (_, checksum) in by_part.items()},
                    paths=scenes[name].paths,
                )
            )
        if not items:
            raise InputError(f"{data.path} holds no image to test on. {why_none(candidates, scenes)}")
        context = (candidates, scenes, origins, found.simulated)
        notes = () if split is None else (f"the split {split.name} tests {len(split.test)} images of all classes",)
        return EvaluationSet(items=tuple(items), data=found.data, failures=found.failures, notes=notes, context=context)

    @staticmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """Of each classifier what it says of the scene in the predicted and in the true mask."""
        source: _ClassifierSource = item.source
        image, other, truth = source.read()
        mask, failure = source.predict(image, other)
        iou = 0.0 if mask is None else score_mask(mask, truth)["iou"]
        found = {}
        for part in item.parts:
            weights, checksum = source.weights[part]
            by = load_classifier(weights)
            if checksum_of(by) != checksum:
                raise InputError(f"the weights of {by.name} have changed since the run began; run it again")
            predicted = (
                None
                if mask is None
                else classify(image, mask, other_band=other, method=by, condition=source.scene.sight)
            )
            found[part] = [{"masks": PREDICTED, "prediction": _plain(predicted), "failure": failure, "iou": iou}]
            if not source.as_published:
                best = classify(image, truth, other_band=other, method=by, condition=source.scene.sight)
                found[part].append({"masks": TRUE, "prediction": _plain(best), "failure": "", "iou": 1.0})
        return found

    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> list[ClassifierAnswer]:
        """By classifier and scene."""
        candidates, scenes, origins, _ = planned.context
        return [
            ClassifierAnswer(
                scene=name,
                object=scenes[name].object,
                sight=scenes[name].sight,
                shape=origins[name].shape,
                truth=truth,
                variant=one.variant,
                split=split,
                masks=said["masks"],
                **self._answer(said),
                iou=said["iou"],
            )
            for one in candidates
            for name, (split, truth) in one.splits.placed.items()
            for said in results.get(one.part(name), ())
        ]

    def _answer(self, said: Mapping[str, Any]) -> dict[str, Any]:
        """The prediction among the task's classes, or why there is none, as of a `ClassifierAnswer`."""
        if said["prediction"] is None:
            return {"prediction": None, "failure": said["failure"]}
        prediction = Prediction(**said["prediction"])
        try:
            return {"prediction": prediction.among(self.classes) if self.classes else prediction}
        except InputError as error:  # it rules all of them out, and is wrong whichever it is
            return {"prediction": None, "failure": str(error)}

    def describe(self, planned: EvaluationSet, rows: Sequence[ClassifierAnswer]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""
        introduction = (
            f"Classifiers on {planned.data}. The first table lists the training data of each. Object-closed: images "
            "of objects that it was trained on, in other poses. Object-disjoint: images of objects that were not in "
            "its training data."
        )
        return planned.data, introduction

    def tables(self, planned: EvaluationSet, rows: Sequence[ClassifierAnswer]) -> dict[str, Table]:
        """What each classifier learned from, all tables of answers, and how long an image takes."""
        data = planned.data
        return {
            "classifiers": self._about(planned),
            **all_tables(rows, data=data),
            "times": time_table(self._times(planned, rows), data=data),
            "answers": answer_table(rows, data=data),
            "confusions": confusion_table(rows, data=data),
            "reliability": bin_table(rows, data=data),
        }

    def figures(self, planned: EvaluationSet, rows: Sequence[ClassifierAnswer]) -> Iterator[ReportFigure]:
        """Of each split: accuracies, calibration, confusions, and the surest mistakes."""
        data = planned.data
        sources = {item.name: item.source for item in planned.items}
        seen: dict[str, tuple[SarImage, Mask | None, Mask]] = {}

        def figure(plot: str, name: str, heading: str, caption: str, **arguments: Any) -> ReportFigure:
            return ReportFigure(
                name=name, heading=heading, caption=caption, plot=plot, arguments=arguments, suffixes=(".png", ".svg")
            )

        for split in SPLITS:
            mine = chosen(rows, split=split)
            if not mine:
                continue
            whole = {"answers": mine, "split": split, "data": data}
            caption = (
                "Bars: in predicted masks. Thick lines: 95 % Wilson intervals; thin ones: bootstrap over objects. "
                "Diamonds: in true masks."
            )
            if of_papers_classes(mine):
                caption += " Red ticks: the paper, on its own real data."
            yield figure("plot_accuracy", f"accuracy-{split}", f"Accuracy, {split}", caption, **whole)
            if any(one.prediction is not None for one in chosen(mine, masks=PREDICTED)):
                caption = "In predicted masks. Bins are a tenth wide; lines are 95 % Wilson intervals."
                yield figure("plot_reliability", f"reliability-{split}", f"Calibration, {split}", caption, **whole)
            for number, variant in enumerate(variants_of(rows), 1):
                if not chosen(mine, variant=variant):
                    continue
                what = f"{variant.name}, {split}"
                caption = (
                    "Rows: the truth. Columns: the most probable class, in predicted masks. Shades: shares of a row."
                )
                name, arguments = f"confusion-{split}-{number}", {**whole, "variant": variant}
                yield figure("plot_confusion", name, f"Confusions: {what}", caption, **arguments)
                wrong = worst(rows, split, variant, self.mistakes)
                if not wrong:
                    continue
                total = sum(not one.right for one in chosen(mine, variant=variant, masks=PREDICTED))
                caption = (
                    f"The {len(wrong)} surest of {total} mistakes. Left: the 77 GHz image, seen along z, with the "
                    "predicted mask (blue) and the true one (dashed). Right: the same image inside the predicted "
                    "mask. Shown is the square root of the magnitude, relative to the maximum of each image."
                )
                for one in wrong:
                    if one.scene not in seen:  # made once more: the same seed gives the same mask
                        image, other, truth = sources[one.scene].read()
                        seen[one.scene] = image, sources[one.scene].predict(image, other)[0], truth
                arguments = {"mistakes": [Mistake(one, *seen[one.scene]) for one in wrong], "title": f"{what}: {data}"}
                name = f"mistakes-{split}-{number}"
                yield figure("plot_mistakes", name, f"Mistakes: {what}", caption, **arguments)

    def _about(self, planned: EvaluationSet) -> Table:
        """What each network learned from; below it what the images and masks are."""
        candidates, scenes, _, simulated = planned.context
        notes = []
        if simulated:
            notes.append(
                "All images were simulated by the virtual rig. Nothing was measured: these are not results "
                "on real data."
            )
        if self.as_published:
            notes.append(
                "As published: each image is classified in the mask that the dataset has beside it, which the authors' "
                "segmenter drew; predicted masks are these, and there are no true ones."
            )
        objects = {name: scene.object for name, scene in scenes.items()}
        tested = {objects[name] for one in candidates for name in one.splits.placed}
        true = (
            "the pixels over the object"
            if self.truth == "exact"
            else "the camera's masks in line of sight, projected into the image"
        )
        if not self.as_published:
            notes.append(f"Predicted masks: {_seen(self.method, tested)}. True masks: {true}.")
        about = [(one.variant, one.training, one.splits) for one in candidates]
        return classifier_table(about, objects, data=planned.data, notes=notes)

    def _times(
        self, planned: EvaluationSet, rows: Sequence[ClassifierAnswer]
    ) -> dict[Variant, list[tuple[float, float]]]:
        """How long classification and segmentation take, for a few scenes of all that there are."""
        done = list(dict.fromkeys(one.scene for one in rows))
        sources = {item.name: item.source for item in planned.items}
        some = [sources[name] for name in done[:: -(-len(done) // _TIMED)]]
        candidates: Sequence[Candidate] = planned.context[0]
        found = time_classifiers([one.weights for one in candidates], some)
        return {one.variant: found[one.weights] for one in candidates}


def _seen(method: str, tested: set[str]) -> str:
    """Which segmenter, and what its network saw in training of the tested objects."""
    by = named_segmenter(method, {})
    sides = getattr(by, "description", {}).get("objects")
    if sides is None:
        return by.name
    learned = {object_name(str(name)) for names in sides.values() for name in names}
    seen = sorted(one for one in tested if object_name(one) in learned)
    told = f"; of the tested objects its network was trained on {len(seen)}: {', '.join(seen)}" if seen else ""
    return f"{by.name}{told or ', whose network was trained on none of the tested objects'}"


def time_classifiers(
    weights: Sequence[str | None], sources: Sequence[_ClassifierSource]
) -> dict[str | None, list[tuple[float, float]]]:
    """How long each classifier takes for these scenes, and the segmenter before it [s], one after another.

    The first scene is done once more before the clock runs. Scenes without a mask are passed over.
    """
    found: dict[str | None, list[tuple[float, float]]] = {one: [] for one in weights}
    for number, source in enumerate([*sources[:1], *sources]):
        image, other, _ = source.read()
        begun = perf_counter()
        mask, _ = source.predict(image, other)
        segmenting = perf_counter() - begun
        if mask is None:
            continue
        for one in weights:
            begun = perf_counter()
            classify(image, mask, other_band=other, method=load_classifier(one), condition=source.scene.sight)
            seconds = perf_counter() - begun
            if number:
                found[one].append((seconds, segmenting))
    return found


def _plain(prediction: Prediction | None) -> dict[str, Any] | None:
    """As JSON holds it."""
    if prediction is None:
        return None
    return {
        "probabilities": prediction.probabilities.tolist(),
        "class_names": list(prediction.class_names),
        "threshold": prediction.threshold,
    }
