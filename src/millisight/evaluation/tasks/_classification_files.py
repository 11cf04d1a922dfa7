"""Tables of classifiers for other programs: every answer, every confusion, every bin of the reliability curves."""

from collections.abc import Sequence

from millisight.evaluation._answers import (
    MASKS,
    PREDICTED,
    SIGHT_GROUPS,
    SPLITS,
    ClassifierAnswer,
    chosen,
    confusion,
    reliability,
)
from millisight.evaluation._statistics import wilson_interval
from millisight.evaluation._tables import Cell, Table
from millisight.evaluation.tasks._classification_tables import variants_of


def bin_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """The reliability curves, for other programs: shares from 0 to 1."""
    rows: list[tuple[Cell, ...]] = []
    for split in SPLITS:
        mine = chosen(answers, split=split, masks=PREDICTED)
        for variant in variants_of(mine):
            for one in reliability(chosen(mine, variant=variant)):
                edges = (one.low, one.high, one.images, one.confidence, one.right / one.images)
                rows.append((split, variant.name, *edges, *wilson_interval(one.right, one.images)))
    return Table(
        title=f"Reliability: {data}",
        columns=("split", "classifier", "above", "up to", "images", "mean confidence", "accuracy", "low", "high"),
        rows=tuple(rows),
        place="file",
    )


def confusion_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """Every confusion matrix, one entry a row, for other programs."""
    rows: list[tuple[Cell, ...]] = []
    for split in SPLITS:
        for masks in MASKS:
            for variant in variants_of(answers):
                for sight in SIGHT_GROUPS:
                    found = confusion(chosen(answers, split=split, masks=masks, variant=variant, sight=sight))
                    rows += [
                        (split, masks, variant.name, sight, truth, answer, int(count))
                        for truth, counts in zip(found.truths, found.counts, strict=True)
                        for answer, count in zip(found.answers, counts, strict=True)
                    ]
    return Table(
        title=f"Confusions: {data}",
        columns=("split", "masks", "classifier", "sight", "truth", "answer", "images"),
        rows=tuple(rows),
        place="file",
    )


def answer_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """Every single answer, for other programs."""
    classes = list(dict.fromkeys(name for one in answers if one.prediction for name in one.prediction.class_names))
    rows: list[tuple[Cell, ...]] = []
    for one in answers:
        said = one.prediction
        shares: dict[str, float] = {}
        if said is not None:
            shares = dict(zip(said.class_names, map(float, said.probabilities), strict=True))
        rows.append(
            (one.scene, one.object, one.shape, one.sight, one.split, one.masks, one.variant.name, one.truth, one.label,
             int(one.right), said.confidence if said else None, int(said.sure) if said else None,
             *(shares.get(name) for name in classes), one.iou, one.failure)
        )  # fmt: skip
    return Table(
        title=f"Every answer: {data}",
        columns=("scene", "object", "shape", "sight", "split", "masks", "classifier", "truth", "answer", "right",
                 "confidence", "sure", *(f"p({name})" for name in classes), "iou", "failure"),
        rows=tuple(rows),
        place="file",
    )  # fmt: skip
