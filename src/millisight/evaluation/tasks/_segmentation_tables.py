"""Tables of segmenters: medians with bootstrap intervals, and paired differences, beside the paper's figures."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from millisight.core.errors import InputError
from millisight.evaluation._metrics import METRICS, medians
from millisight.evaluation._scenes import BOTH, CAMERA, EMPTY, HIGH, INPUTS, LOW, SIGHTS, MaskTrial
from millisight.evaluation._statistics import bootstrap_interval, wilson_interval
from millisight.evaluation._tables import Table, table_of

_PAPER_METRICS = ("precision", "recall", "f1", "iou", "accuracy")
_PAPER = {
    "los": {
        CAMERA: (99.7, 99.5, 99.4, 98.9, 99.9),
        LOW: (57.9, 50.1, 37.3, 22.9, 93.7),
        HIGH: (98.2, 56.4, 71.4, 55.5, 97.9),
        BOTH: (97.1, 62.6, 74.4, 59.3, 98.0),
    },
    "nlos": {
        CAMERA: (3.6, 100.0, 7.0, 3.6, 14.0),
        LOW: (53.0, 38.7, 29.1, 17.0, 92.1),
        HIGH: (95.4, 57.7, 70.2, 54.1, 97.7),
        BOTH: (95.1, 63.1, 70.8, 54.9, 97.6),
    },
}
PAPER_MASKS: dict[str, dict[str, dict[str, float]]] = {
    sight: {given: dict(zip(_PAPER_METRICS, values, strict=True)) for given, values in rows.items()}
    for sight, rows in _PAPER.items()
}
"""The paper's Table 2 by sight, input and metric: medians [%] of real captures, by Segment Anything."""


_SAME_PHOTO = (
    "† No result about the radar. In line of sight the masks of the camera rows and the true one are of the same "
    "photo, moved alike: any mask within the object has a precision of 100 % by construction, however wrong the "
    "transform from camera to radar. The other figures of these rows, too, compare two masks of one photo."
)


class TableRow(NamedTuple):
    """The trials of one row: a segmenter on one kind of input."""

    method: str
    input: str

    def __str__(self) -> str:
        return f"{self.method}, {self.input}"


class PairedDifference(NamedTuple):
    """Of two rows' scores over the same scenes, each scene's the mean over its seeds.

    `mean` and `median` of the differences (first minus second), the mean's 95 % interval, and on how many of `scenes`
    the first has the higher score (`better`), and the lower one (`worse`).
    """

    scenes: int
    mean: float
    low: float
    high: float
    median: float
    better: int
    worse: int


def by_scene(trials: Sequence[MaskTrial], row: TableRow, sight: str, metric: str) -> dict[str, list[float]]:
    """A metric of a row's trials, by scene; of each in the order of the seeds."""
    found: dict[str, list[tuple[int, float]]] = {}
    for one in trials:
        if (one.method, one.input, one.sight) == (*row, sight):
            found.setdefault(one.scene, []).append((one.seed, one.scores[metric]))
    return {scene: [value for _, value in sorted(values)] for scene, values in sorted(found.items())}


def rows_of(trials: Sequence[MaskTrial]) -> list[TableRow]:
    """Segmenters in the order in which they come, each with its inputs in the paper's order."""
    there = {(one.method, one.input) for one in trials}
    methods = dict.fromkeys(one.method for one in trials)
    return [TableRow(method, given) for method in methods for given in INPUTS if (method, given) in there]


def interval_of_median(values: dict[str, list[float]], rng: int = 0) -> tuple[float, float]:
    """The 95 % bootstrap interval of the median over scenes and seeds; scenes are drawn, with all their seeds."""
    counts = {len(one) for one in values.values()}
    if len(counts) != 1:
        raise InputError(f"scenes have {sorted(counts)} seeds; expected equal numbers, and at least one scene")
    return bootstrap_interval(np.array(list(values.values())), np.median, rng=rng)


def difference(
    trials: Sequence[MaskTrial], first: TableRow, second: TableRow, sight: str, metric: str
) -> PairedDifference | None:
    """What `first` is better by than `second`, paired by scene; None where they have no scene in common."""
    one, other = (by_scene(trials, row, sight, metric) for row in (first, second))
    common = [scene for scene in one if scene in other]
    if not common:
        return None
    values = np.array([np.mean(one[scene]) - np.mean(other[scene]) for scene in common])
    low, high = bootstrap_interval(values, np.mean, rng=0)
    return PairedDifference(
        scenes=len(values),
        mean=float(values.mean()),
        low=low,
        high=high,
        median=float(np.median(values)),
        better=int((values > 0).sum()),
        worse=int((values < 0).sum()),
    )


def median_table(
    trials: Sequence[MaskTrial], sight: str, *, data: str, notes: Sequence[str] = (), from_photo: bool = False
) -> Table:
    """The paper's table for one sight: medians of every metric, in brackets their 95 % intervals; the paper's below.

    Parameters
    ----------
    trials : of any sights; those of `sight` are taken
    sight : "los" or "nlos"
    data : what the data are, for the title
    notes : texts below it
    from_photo : the truth is the camera's mask of the object in line of sight; there the camera's precision is marked,
        since both masks are of one photo
    """
    rows: list[tuple[str | float | None, ...]] = []
    same_photo = False
    for row in rows_of([one for one in trials if one.sight == sight]):
        mine = [one for one in trials if (one.method, one.input, one.sight) == (*row, sight)]
        values, cells = medians(one.scores for one in mine), []
        for name in METRICS:
            low, high = interval_of_median(by_scene(trials, row, sight, name))
            show = METRICS[name].show
            marked = from_photo and (row.input, sight, name) == (CAMERA, "los", "precision")
            same_photo |= marked
            cells.append(f"{show(values[name])} ({show(low)} to {show(high)}){' †' if marked else ''}")
        scenes = len({one.scene for one in mine})
        rows.append((row.method, row.input, *cells, scenes, sum(bool(one.failure) for one in mine)))
    for given in INPUTS:
        paper = {name: f"{value:.1f}" for name, value in PAPER_MASKS[sight][given].items()}
        rows.append(("paper: SAM, real data", given, *(paper.get(name) for name in METRICS), None, None))
    seeds = sorted({one.seed for one in trials})
    prompts = f" and prompts of the seeds {', '.join(map(str, seeds))}" if len(seeds) > 1 else ""
    return table_of(
        f"Segmentation, {SIGHTS[sight]}: {data}",
        ("segmenter", "input", *(METRICS[name].column for name in METRICS), "scenes", "no mask"),
        rows,
        f"Medians over scenes{prompts}; in brackets 95 % bootstrap "
        "intervals, over scenes resampled with all their seeds. Where no mask was found, an empty mask is scored.",
        *((_SAME_PHOTO,) if same_photo else ()),
        *notes,
        place="summary",
    )


def difference_table(trials: Sequence[MaskTrial], *, data: str) -> Table:
    """Multi-spectral minus 77 GHz alone for each segmenter, and each segmenter minus those after it."""
    pairs = list(_pairs(rows_of(trials)))
    rows: list[tuple[str | float | None, ...]] = []
    for name in sorted((name for name in METRICS if METRICS[name].paired), key=lambda name: name != "f1"):
        metric = METRICS[name]
        heading = metric.heading if metric.unit == "%" else metric.column
        for sight, words in SIGHTS.items():
            for first, second in pairs:
                found = difference(trials, first, second, sight, name)
                if found is not None:
                    mean, low, high, median = (metric.show(value, sign=True) for value in found[1:5])
                    counts = (found.better, found.worse, found.scenes)
                    rows.append((heading, words, str(first), str(second), f"{mean} ({low} to {high})", median, *counts))
    return table_of(
        f"Paired differences: {data}",
        "metric|sight|first|second|mean difference [points]|median [points]|better|worse|scenes",
        rows,
        "First minus second, in percentage points, averaged over the seeds of each scene; in brackets the 95 % "
        "bootstrap interval of the mean, over scenes.",
        place="summary",
    )


def _pairs(rows: Sequence[TableRow]):
    methods = list(dict.fromkeys(row.method for row in rows))
    for method in methods:
        if TableRow(method, BOTH) in rows and TableRow(method, HIGH) in rows:
            yield TableRow(method, BOTH), TableRow(method, HIGH)
    for number, method in enumerate(methods):
        for other in methods[number + 1 :]:
            for given in INPUTS:
                if TableRow(method, given) in rows and TableRow(other, given) in rows:
                    yield TableRow(method, given), TableRow(other, given)


def empty_table(trials: Sequence[MaskTrial], *, data: str) -> Table:
    """In how many scenes with no object nothing is found, with Wilson's 95 % intervals."""
    mine = [one for one in trials if one.sight == EMPTY]
    rows: list[tuple[str | float | None, ...]] = []
    for row in rows_of(mine):
        found = by_scene(mine, row, EMPTY, "f1")
        right, scenes = sum(min(scores) == 1 for scores in found.values()), len(found)
        low, high = wilson_interval(right, scenes)
        share = f"{100 * right / scenes:.0f} ({100 * low:.0f} to {100 * high:.0f})"
        rows.append((row.method, row.input, right, scenes, share))
    return table_of(
        f"Scenes with no object: {data}",
        "segmenter|input|nothing found|scenes|share [%]",
        rows,
        "Nothing is found where the mask is empty, or none could be made, for all seeds. In brackets 95 % intervals.",
        place="summary",
    )


def trial_table(trials: Sequence[MaskTrial], classes: Mapping[str, str], *, data: str) -> Table:
    """Every single mask, for other programs: shares from 0 to 1, lengths in metres. `classes` are by scene."""
    columns = ("scene", "object", "class", "sight", "segmenter", "input", "seed", *METRICS, "failure")
    rows = (
        (one.scene, one.object, classes.get(one.scene, ""), one.sight, one.method, one.input, one.seed,
         *(one.scores[name] for name in METRICS), one.failure)
        for one in trials
    )  # fmt: skip
    return table_of(f"Every mask: {data}", columns, rows, place="file")


def worst(trials: Sequence[MaskTrial], count: int) -> list[MaskTrial]:
    """Of each segmenter the `count` worst masks of radar images, of each scene one at most."""
    found = []
    for method in dict.fromkeys(one.method for one in trials):
        mine = [one for one in trials if one.method == method and one.input in (HIGH, BOTH) and one.sight != EMPTY]
        mine.sort(key=lambda one: one.scores["f1"])
        taken: dict[str, MaskTrial] = {}
        for one in mine:
            taken.setdefault(one.scene, one)
        found += list(taken.values())[:count]
    return found
