"""Metrics of masks: how well a predicted mask fits the true one.

A metric is one function of two masks on one grid. Add it here with `mask_metric`, or in a package of your own by an
entry point of the group `millisight.metrics` whose object is a `Metric`. It then has a column in every table:

    @mask_metric("hausdorff", "Hausdorff", unit="mm")
    def hausdorff(predicted, truth):
        return ...  # [m]
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from millisight.core import Registry, check_known, checked_record, record
from millisight.core.errors import InputError
from millisight.data import Mask, PixelGrid, VolumeMask, VoxelGrid, grid_difference

UNITS = {"%": 100.0, "mm": 1000.0, "": 1.0}
"""What a value is multiplied by where it is printed: shares in percent, lengths [m] in millimetres."""
_SAME_PLACE = 1e-6  # [m]; pixels of two grids this close are the same pixels


@record
class Metric:
    """A metric of masks.

    Attributes
    ----------
    heading : of its column
    compute : function of the predicted and the true mask, both (X, Y) on one grid. Returns a finite number, for empty
        masks too; lengths in metres
    unit : by which it is printed, one of UNITS
    paired : whether segmenters are also compared by it, scene by scene; more is better
    """

    heading: str
    compute: Callable[[Mask, Mask], float]
    unit: str = "%"
    paired: bool = False

    def __post_init__(self) -> None:
        check_known("unit of a metric", self.unit, UNITS)

    @property
    def column(self) -> str:
        """Heading and unit."""
        return f"{self.heading} [{self.unit}]" if self.unit else self.heading

    def show(self, value: float, *, sign: bool = False) -> str:
        """A value as it is printed: in the unit, with one digit after the point."""
        return f"{UNITS[self.unit] * value:{'+' if sign else ''}.1f}"


def _check(name: str, metric: Any) -> None:
    if not isinstance(metric, Metric):
        raise InputError(f"metric {name!r} is a {type(metric).__name__}; expected a millisight.evaluation.Metric")


METRICS: Registry[Metric] = Registry("metric", "millisight.metrics", check=_check)


def mask_metric(name: str, heading: str, **options: Any) -> Callable[[Callable[[Mask, Mask], float]], Any]:
    """Decorator that adds a function of two masks to METRICS.

    Parameters
    ----------
    name : in CSV files and in Python
    heading, options : see `Metric`
    """

    def add(compute: Callable[[Mask, Mask], float]) -> Callable[[Mask, Mask], float]:
        METRICS.add(name, Metric(heading=heading, compute=compute, **options))
        return compute

    return add


def _ratio(part: int, whole: int, predicted: Mask | VolumeMask, truth: Mask | VolumeMask) -> float:
    """part / whole; of nothing, 1 where both masks are empty, and 0 otherwise."""
    return part / whole if whole else float(not predicted.inside.any() and not truth.inside.any())


def _hits(predicted: Mask | VolumeMask, truth: Mask | VolumeMask) -> int:
    return int((predicted.inside & truth.inside).sum())


@mask_metric("precision", "precision")
def precision(predicted: Mask | VolumeMask, truth: Mask | VolumeMask) -> float:
    """TP / (TP + FP): of the predicted pixels, those of the object."""
    return _ratio(_hits(predicted, truth), int(predicted.inside.sum()), predicted, truth)


@mask_metric("recall", "recall", paired=True)
def recall(predicted: Mask | VolumeMask, truth: Mask | VolumeMask) -> float:
    """TP / (TP + FN): of the object's pixels, those that are predicted."""
    return precision(truth, predicted)


@mask_metric("f1", "F1", paired=True)
def f1(predicted: Mask, truth: Mask) -> float:
    """2 TP / (2 TP + FP + FN): harmonic mean of precision and recall."""
    both = int(predicted.inside.sum()) + int(truth.inside.sum())
    return _ratio(2 * _hits(predicted, truth), both, predicted, truth)


@mask_metric("iou", "IoU")
def iou(predicted: Mask | VolumeMask, truth: Mask | VolumeMask) -> float:
    """TP / (TP + FP + FN): pixels of both masks over pixels of either."""
    either = int((predicted.inside | truth.inside).sum())
    return _ratio(_hits(predicted, truth), either, predicted, truth)


@mask_metric("accuracy", "accuracy")
def pixel_accuracy(predicted: Mask, truth: Mask) -> float:
    """(TP + TN) / all: of all pixels, those on which the masks agree."""
    return 1 - int((predicted.inside ^ truth.inside).sum()) / truth.inside.size


class MaskScores(dict[str, float]):
    """Scores of one mask, or medians of many, by the name of the metric: `scores["f1"]`, or `scores.f1`."""

    def __getattr__(self, name: str) -> float:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None


def score_mask(predicted: Mask, truth: Mask) -> MaskScores:
    """Score `predicted` against `truth` with every metric of METRICS.

    With TP, FP, FN and TN pixels. Where a ratio is 0 / 0, it is 1 if both masks are empty, and 0 otherwise: an empty
    mask of an existing object has precision 0.

    Raises
    ------
    InputError
        The masks lie on different grids, or a metric of a plug-in is not finite.
    """
    checked_record(predicted, Mask, name="predicted")
    checked_record(truth, Mask, name="truth")
    check_same_grid(predicted.grid_xy, truth.grid_xy)
    scores = MaskScores({name: float(METRICS[name].compute(predicted, truth)) for name in METRICS})
    for name, value in scores.items():
        if not np.isfinite(value):
            raise InputError(f"metric {name!r} is {value} for these masks; expected a finite number for any two masks")
    return scores


def medians(scores: Iterable[MaskScores]) -> MaskScores:
    """The median of each metric, over many masks.

    Raises
    ------
    InputError
        There are none.
    """
    some = list(scores)
    if not some:
        raise InputError("medians of no scores; expected at least one")
    return MaskScores({name: float(np.median([one[name] for one in some])) for name in some[0]})


def check_same_grid(found: PixelGrid | VoxelGrid, truth: PixelGrid | VoxelGrid, *, of: str = "masks") -> None:
    """Two `of` what is compared must lie on one grid; `InputError` otherwise, which tells the axis that differs."""
    differs = grid_difference(found, truth, within=_SAME_PLACE)
    if differs:
        raise InputError(f"the {of} lie on different grids, along {differs}; make both on one grid")
