"""The task "segmentation": masks of segmenters against true masks, on photos, at 24 GHz, at 77 GHz, and with both."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, field
from typing import Any, ClassVar, NamedTuple

from millisight.core import checked_integer, put, record
from millisight.core.errors import InputError
from millisight.evaluation._metrics import METRICS, MaskScores
from millisight.evaluation._scenes import EMPTY, SIGHTS, MaskTrial, SegmenterEvaluator, checksum_of, named_segmenter
from millisight.evaluation._sources import EvaluationData, SceneSource, survey
from millisight.evaluation._tables import Table
from millisight.evaluation._task import TASKS, EvaluationItem, EvaluationSet, ReportFigure, Task
from millisight.evaluation.tasks._segmentation_tables import (
    difference_table,
    empty_table,
    median_table,
    trial_table,
    worst,
)
from millisight.meshes import CATALOGUE, object_name

_FORMAT, _MOST_SEEDS = 4, 1000
_BLIND = "blind."  # the parts of what does not look begin so


class _SegmenterSource(NamedTuple):
    scene: SceneSource
    method: str
    options: Mapping[str, Any]
    checksum: str
    seeds: Sequence[int]
    reading: Mapping[str, Any]
    blind: Sequence[str]

    def evaluator(self) -> SegmenterEvaluator:
        """The segmenter on the scene, both loaded."""
        by = named_segmenter(self.method, self.options)
        if checksum_of(by) != self.checksum:
            raise InputError(f"the weights of {self.method} have changed since the run began; run it again")
        return SegmenterEvaluator(by, self.scene.read(**self.reading), support=self.reading.get("support"))


@TASKS.add("segmentation")
@record
class SegmentationTask(Task):
    """Compare masks of segmenters with true masks, pixel by pixel.

    Attributes
    ----------
    methods : names of segmenters
    blind : names of those beside them that do not look at the radar
    options : of segmenters, by their names
    seeds : number of random seeds for prompts: 0, 1, 2 and so on
    truth : true masks: "camera", the camera's mask moved to the images' grids; or "exact", those of simulated data
    transform : camera to radar, by the pose in the "file" or the constants of the "published" evaluation; None: "file"
        for simulated scenes
    support : height of what the object stands on [m]: masks, too, leave out what rises no higher; None: unknown to the
        segmenters, and for prompts on photos by the scene's background
    crop : number of the lowest and of the highest slices of 77 GHz images to leave out; None: as published of the
        published dataset, and none of others
    failures : number of worst masks of each segmenter to plot
    """

    name: ClassVar[str] = "segmentation"
    title: ClassVar[str] = "Segmentation"
    cache: ClassVar[str] = "trials"

    methods: Sequence[str] = ("wave", "classical", "threshold")
    blind: Sequence[str] = ("blind ellipse", "blind disc", "blind box", "blind all")
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: int = 3
    truth: str = "camera"
    transform: str | None = None
    support: float | None = None
    crop: tuple[int, int] | None = None
    failures: int = 6

    def __post_init__(self) -> None:
        methods = (self.methods,) if isinstance(self.methods, str) else self.methods
        put(
            self,
            methods=tuple(dict.fromkeys(methods)),
            blind=tuple(name for name in dict.fromkeys(self.blind) if name not in methods),
            options=dict(self.options),
            crop=None if self.crop is None else tuple(self.crop),
        )
        if checked_integer(self.seeds, name="seeds") > _MOST_SEEDS:
            raise InputError(f"seeds is {self.seeds}; expected {_MOST_SEEDS} at most")
        checked_integer(self.failures, name="failures", minimum=0)

    def plan(self, data: EvaluationData) -> EvaluationSet:
        """One item for each segmenter and scene."""
        found = survey(data, transform=self.transform, truth=self.truth, support=self.support, crop=self.crop)
        items: list[EvaluationItem] = []
        common = {"format": _FORMAT, "reading": found.reading, "metrics": METRICS.names()}
        for method in self.methods:
            options = dict(self.options.get(method, {}))
            checksum = checksum_of(named_segmenter(method, options))
            seeds = tuple(range(self.seeds))
            settings = common | {"network": checksum, "method": method, "options": options, "seeds": seeds}
            # What does not look goes with the first of those that do, so that a scene fails once.
            blind = self.blind if method == self.methods[0] else ()
            for scene in (*data.scenes, *data.empties):
                place = scene.name.replace("/", ".")
                parts = {f"{method}.{place}": settings}
                if blind:
                    parts[f"{_BLIND}{place}"] = common | {"methods": blind}
                source = _SegmenterSource(scene, method, options, checksum, seeds, found.reading, blind)
                name = f"{scene.name}, {method}"
                items.append(EvaluationItem(name=name, source=source, parts=parts, paths=scene.paths))
        catalogue = {name: entry.shape_class for name, entry in CATALOGUE.items()}
        classes = {
            scene.name: scene.shape_class() or catalogue.get(scene.object, "")
            for scene in data.scenes
            if scene.name in found.physics
        }
        return EvaluationSet(items=tuple(items), data=found.data, context=(found.simulated, classes))

    @staticmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """All trials of a segmenter on a scene, and those of what does not look."""
        source = item.source
        evaluator = source.evaluator()
        results = {}
        for part in item.parts:  # those that an earlier run has not left
            if part.startswith(_BLIND):
                others = (SegmenterEvaluator(named_segmenter(name, {}), evaluator.scene) for name in source.blind)
                results[part] = [asdict(one) for other in others for one in other.trials((0,))]
            else:
                results[part] = [asdict(one) for one in evaluator.trials(source.seeds)]
        return results

    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> list[MaskTrial]:
        """By segmenter and scene; last those that do not look."""
        rows = [
            MaskTrial(**one | {"scores": MaskScores(one["scores"])}) for trials in results.values() for one in trials
        ]
        return sorted(rows, key=lambda one: one.method in self.blind)

    def describe(self, planned: EvaluationSet, rows: Sequence[MaskTrial]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""
        introduction = (
            f"Segmenters on {planned.data}. A mask is compared with the truth pixel by pixel; the tables list "
            "medians, and the pictures below show the worst masks of each segmenter."
        )
        return planned.data, introduction

    def tables(self, planned: EvaluationSet, rows: Sequence[MaskTrial]) -> dict[str, Table]:
        """Medians of each sight, paired differences, and every mask."""
        simulated, classes = planned.context
        data, notes = planned.data, self._notes(rows, simulated=simulated)
        there = {one.sight for one in rows}
        seen = [sight for sight in SIGHTS if sight in there]
        photo = self.truth == "camera"
        return {
            **{sight: median_table(rows, sight, data=data, notes=notes, from_photo=photo) for sight in seen},
            **({EMPTY: empty_table(rows, data=data)} if EMPTY in there else {}),
            "differences": difference_table(rows, data=data),
            "trials": trial_table(rows, classes, data=data),
        }

    def figures(self, planned: EvaluationSet, rows: Sequence[MaskTrial]) -> Iterator[ReportFigure]:
        """The medians; and the worst masks, made once more: the same seed gives the same mask."""
        yield ReportFigure(
            name="medians",
            heading="Medians",
            caption="Points: medians. Lines: their 95 % bootstrap intervals. Ticks: medians of the paper, on real "
            "data.",
            plot="plot_medians",
            arguments={"trials": rows, "data": planned.data},
        )
        sources = {(item.source.method, item.source.scene.name): item.source for item in planned.items}
        looking = [one for one in rows if one.method not in self.blind]
        for number, one in enumerate(worst(looking, self.failures), 1):
            evaluator = sources[one.method, one.scene].evaluator()
            attempt = evaluator.attempt(one.input, one.seed)
            score, what = describe_scores(one), f"{one.object}, {SIGHTS[one.sight]}: {one.method} on {one.input}"
            yield ReportFigure(
                name=f"worst-{number:02d}",
                heading=what,
                caption=f"{score}.",
                plot="plot_attempt",
                arguments={
                    "attempt": attempt,
                    "picture": evaluator.pictures[one.input],
                    "truth": evaluator.truth(one.input),
                    "title": f"{what}: {score}",
                },
                facts={"scene": one.scene, "seed": one.seed}
                | ({"why there is no mask": attempt.failure} if attempt.failure else {}),
                dpi=90,
            )

    def _notes(self, rows: Sequence[MaskTrial], *, simulated: bool) -> list[str]:
        """Notes of the tables: the truth, and what networks saw of the tested objects."""
        compared = (
            "the camera's mask of the object in line of sight, projected onto the image's grid"
            if self.truth == "camera"
            else "the exact pixels that the object covers"
        )
        notes = [f"Compared with {compared}."]
        if simulated:
            notes.append(
                "Everything was simulated by the virtual rig. Accuracy, and the camera's precision out of sight, "
                "depend on how much of the surroundings an image shows; for cropped images, as in small benchmarks, "
                "they cannot be compared with the paper's."
            )
        if self.blind:
            notes.append("Blind rows do not look at the radar: what they score is due to the cut of the images.")
        tested = {one.object for one in rows if one.sight != EMPTY}
        return notes + [_seen(named_segmenter(name, self.options.get(name, {})), tested) for name in self.methods]


def describe_scores(one: MaskTrial) -> str:
    """The scores of a mask in a line."""
    scores = one.scores
    return f"F1 {100 * scores.f1:.0f} %, precision {100 * scores.precision:.0f} %, recall {100 * scores.recall:.0f} %"


def _seen(by: Any, tested: set[str]) -> str:
    """What the segmenter's network saw in training of the tested objects."""
    if by.name == "threshold":
        return "threshold: no network; its level was chosen on the scenes that validated wave."
    if by.name == "classical":
        return "classical: no network; its levels were chosen on the scenes of examples/recipes/bench24.toml."
    told = getattr(by, "description", {})
    sides = told.get("objects")
    if sides is None:
        return f"{by.name}: the training objects of its network are not known."
    seen = {object_name(str(name)) for names in sides.values() for name in names}
    both = sorted({one for one in tested if object_name(one) in seen})
    name = f"{by.name} (weights {told['sha256'][:8]})"
    if both:
        return f"{name}: NOT a fair test, its network saw {len(both)} of the tested objects: {', '.join(both)}."
    return f"{name}: its network used {len(seen)} objects in training and validation, none of the {len(tested)} tested."
