"""How well a mask fits the truth: precision, recall, F1, intersection over union, accuracy."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from millisight.errors import InputError
from millisight.perception.segmentation import Mask
from millisight.records import checked_record

_SAME_PLACE = 1e-6  # [m]; pixels of two grids this close are the same pixels


class MaskScores(NamedTuple):
    """Of one mask, or medians of many; each from 0 to 1.

    Attributes
    ----------
    precision : of the predicted pixels, those that are the object's
    recall : of the object's pixels, those that are predicted
    f1 : harmonic mean of precision and recall
    iou : pixels of both masks over pixels of either
    accuracy : of all pixels, those on which the masks agree
    """

    precision: float
    recall: float
    f1: float
    iou: float
    accuracy: float


METRICS = MaskScores._fields


def score_mask(predicted: Mask, truth: Mask) -> MaskScores:
    """How well `predicted` fits `truth`, by pixels.

    With TP, FP, FN and TN pixels: precision TP / (TP + FP), recall TP / (TP + FN), F1 2 TP / (2 TP + FP + FN), IoU
    TP / (TP + FP + FN), accuracy (TP + TN) / all. Where that is 0 / 0, it is 1 if both masks are empty, for nothing was
    to be found and nothing was, and 0 otherwise: an empty mask of something has precision 0, not none.

    Raises
    ------
    InputError
        The masks lie on different grids.
    """
    _check_same_grid(checked_record(predicted, Mask, name="predicted"), checked_record(truth, Mask, name="truth"))
    found, there = predicted.inside, truth.inside
    hits = int((found & there).sum())
    false, missed = int(found.sum()) - hits, int(there.sum()) - hits
    nothing = 1.0 if not (hits or false or missed) else 0.0

    def ratio(part: float, whole: float) -> float:
        return part / whole if whole else nothing

    return MaskScores(
        precision=ratio(hits, hits + false),
        recall=ratio(hits, hits + missed),
        f1=ratio(2 * hits, 2 * hits + false + missed),
        iou=ratio(hits, hits + false + missed),
        accuracy=1 - (false + missed) / found.size,
    )


def medians(scores: Iterable[MaskScores]) -> MaskScores:
    """The median of each metric, over many masks.

    Raises
    ------
    InputError
        There are none.
    """
    table = np.array(list(scores), dtype=float)
    if not table.size:
        raise InputError("medians of no scores; expected one at least")
    return MaskScores(*np.median(table, axis=0).tolist())


def _check_same_grid(a: Mask, b: Mask) -> None:
    for name in "xy":
        one, other = getattr(a.grid_xy, name), getattr(b.grid_xy, name)
        if len(one) != len(other) or np.abs(one - other).max() > _SAME_PLACE:
            raise InputError(
                f"the masks lie on different grids: {len(one)} pixels along {name} from {one[0]:.4g} to {one[-1]:.4g} "
                f"m and {len(other)} from {other[0]:.4g} to {other[-1]:.4g} m; make both on one grid"
            )
