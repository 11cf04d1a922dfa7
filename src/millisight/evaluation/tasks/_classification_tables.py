"""Tables of classifiers: accuracies, objects, mistakes, calibration, pairs; the paper's figures beside.

Every table is of one split: of objects that a classifier was trained on, or of objects that it never met. The last
three, for other programs, hold every answer, every confusion, every bin of the reliability curves.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product

import numpy as np

from millisight.evaluation._answers import (
    CLOSED,
    DISJOINT,
    MASKS,
    NO_MASK,
    PREDICTED,
    PUBLISHED,
    SIGHT_GROUPS,
    SPLITS,
    TRUE,
    Accuracy,
    ClassifierAnswer,
    Variant,
    accuracy,
    brier_score,
    by_object,
    chosen,
    compare_classifiers,
    confusion,
    expected_calibration_error,
    reliability,
)
from millisight.evaluation._leaks import LEFT_OUT, SplitPlan, Training, siblings
from millisight.evaluation._statistics import wilson_interval
from millisight.evaluation._tables import Cell, Table, table_of
from millisight.meshes import PAPER_CLASSES

Rows = list[tuple[Cell, ...]]

PARTS = {"edge": "edge only", "specular": "specular only", "both": "both"}
PAPER_IMAGES = {"los": 18, "nlos": 16, "overall": 34}
PAPER = {
    "edge": {"los": (61.1, 11), "nlos": (75.0, 12), "overall": (67.6, 23)},
    "specular": {"los": (77.7, 14), "nlos": (75.0, 12), "overall": (76.4, 26)},
    "both": {"los": (88.8, 16), "nlos": (81.2, 13), "overall": (85.2, 29)},
}
"""The paper's Table 3: accuracy [%] as printed, and of its PAPER_IMAGES how many that must have been."""

_SAW = {
    PUBLISHED: "the images are the test of the authors' split; their own network was trained on meshes of most of the "
    "objects, and the first table lists what others saw",
    CLOSED: "the classifier was trained on these objects, in other poses; with other physics, unless a note at the "
    "classifiers says that this is unknown",
    DISJOINT: "none of these objects was used in training or validation of the classifier",
}
_INTERVALS = (
    "Round brackets: 95 % Wilson intervals, which treat images as independent. Square brackets: 95 % bootstrap "
    "intervals over objects, resampled with all their images; they have no width where all objects score the same."
)

_PAPER_NOTE = (
    "The paper's rows are as printed, for its own real data; their intervals were computed here from its numbers of "
    "images. The meshes of 24 of its 26 test objects were used in its training."
)


def variants_of(answers: Iterable[ClassifierAnswer]) -> list[Variant]:
    """In the order in which they come."""
    return list(dict.fromkeys(one.variant for one in answers))


def all_tables(answers: Sequence[ClassifierAnswer], *, data: str) -> dict[str, Table]:
    """Every table of answers for people, by the name of its file."""
    tables = {}
    for split in SPLITS:
        mine = chosen(answers, split=split)
        if not mine:
            continue
        for masks in (one for one in MASKS if chosen(mine, masks=one)):
            name = split if masks == PREDICTED else f"{split}-{masks}-masks"
            tables[name] = accuracy_table(mine, split, masks, data=data)
        if len(variants_of(mine)) > 1:
            tables[f"{split}-pairs"] = pair_table(mine, split, data=data)
        tables[f"{split}-shapes"] = shape_table(mine, split, data=data)
        tables[f"{split}-objects"] = object_table(mine, split, data=data)
        tables[f"{split}-mistakes"] = mistake_table(mine, split, data=data)
        tables[f"{split}-calibration"] = calibration_table(mine, split, data=data)
    return tables


def _groups(answers: Sequence[ClassifierAnswer]) -> Iterator[tuple[Variant, str, list[ClassifierAnswer]]]:
    """Every variant and sight, and the answers of both."""
    for variant in variants_of(answers):
        for sight in SIGHT_GROUPS:
            yield variant, sight, chosen(answers, variant=variant, sight=sight)


def classifier_table(
    evaluated: Iterable[tuple[Variant, Training, SplitPlan]],
    objects: Mapping[str, str],
    *,
    data: str,
    notes: Sequence[str] = (),
) -> Table:
    """What each classifier learned from, and how many of the images test it on what; `objects` are by scene."""
    rows: Rows = []
    near = []
    evaluated = tuple(evaluated)
    found = {where for _, _, placed in evaluated for where, _ in placed.placed.values()}
    splits = [split for split in SPLITS if split in found or split != PUBLISHED]
    for variant, training, placed in evaluated:
        tests = {split: [scene for scene, (where, _) in placed.placed.items() if where == split] for split in splits}
        counts = [len(some) for some in (*tests.values(), *(placed.left_out.get(why, []) for why in LEFT_OUT))]
        seen = (len(training.training), len(training.validation))
        kinds = (variant.network, PARTS.get(variant.parts, variant.parts))
        near += placed.notes
        rows.append((variant.name, *kinds, str(training.physics), str(training.seed), *seen, *counts))
        for name, others in siblings(training, {objects[scene] for scene in tests[DISJOINT]}).items():
            near.append(f"{variant.name} was trained on siblings of {name}: {', '.join(others)}.")
    columns = "classifier|network|trained on|physics of training|seed|objects in training|in validation|" + "|".join(
        [*(f"{split} images" for split in splits), *(f"left out: {why}" for why in LEFT_OUT)]
    )
    return table_of(f"The classifiers: {data}", columns, rows, *notes, *near, place="summary")


def accuracy_table(answers: Sequence[ClassifierAnswer], split: str, masks: str, *, data: str) -> Table:
    """Accuracy in sight, out of it, and overall, of each variant; below, of the paper's classes, the paper's rows."""
    mine = chosen(answers, split=split, masks=masks)
    rows: Rows = []
    for variant in variants_of(mine):
        cells: list[Cell] = []
        for sight in SIGHT_GROUPS:
            found = accuracy(chosen(mine, variant=variant, sight=sight))
            cells += [_percent(found), found.images if found else 0]
        objects = len({one.object for one in chosen(mine, variant=variant)})
        rows.append((variant.name, variant.network, PARTS.get(variant.parts, variant.parts), *cells, objects))
    beside_paper = masks == PREDICTED and of_papers_classes(mine)
    if beside_paper:
        rows += [_paper_row(parts) for parts in PAPER]
    headings = "|".join(f"{_short(sight)} [%]|{_short(sight)} images" for sight in SIGHT_GROUPS)
    notes = [f"Here {_SAW[split]}. {_INTERVALS}", *([_PAPER_NOTE] if beside_paper else [])]
    title, columns = f"Accuracy, {split}, {masks} masks: {data}", f"classifier|network|trained on|{headings}|objects"
    return table_of(title, columns, rows, *notes, place="summary" if masks == PREDICTED else "page")


def of_papers_classes(answers: Sequence[ClassifierAnswer]) -> bool:
    """Whether the classes are the paper's four: with others there is nothing of the paper's to set beside."""
    return {one.truth for one in answers} <= set(PAPER_CLASSES)


def _paper_row(parts: str) -> tuple[Cell, ...]:
    cells: list[Cell] = []
    for sight, images in PAPER_IMAGES.items():
        printed, right = PAPER[parts][sight]
        cells += [f"{printed:.1f} {_span(wilson_interval(right, images))}", images]
    return ("paper: its real data", "the paper's", PARTS[parts], *cells, None)


def _short(sight: str) -> str:
    return sight if sight == "overall" else sight.upper()


def _percent(found: Accuracy | None) -> str | None:
    if found is None:
        return None
    drawn = f" {_span(found.by_object, '[]')}" if found.by_object else ""
    return f"{100 * found.share:.1f} {_span(found.wilson)}{drawn}"


def _span(interval: tuple[float, float], brackets: str = "()") -> str:
    return f"{brackets[0]}{100 * interval[0]:.1f} to {100 * interval[1]:.1f}{brackets[1]}"


def shape_table(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Table:
    """Real scans and drawn shapes apart, and the four classes, in predicted masks."""
    mine = chosen(answers, split=split, masks=PREDICTED)
    rows: Rows = []
    for kind, field in (("shape", "shape"), ("class", "truth")):
        for value in sorted({getattr(one, field) for one in mine}):
            for variant in variants_of(mine):
                some = chosen(mine, variant=variant, **{field: value})
                if some:
                    cells = [_percent(accuracy(chosen(some, sight=sight))) for sight in SIGHT_GROUPS]
                    rows.append((kind, value, variant.name, *cells, len(some), len(by_object(some))))
    return table_of(
        f"By source of the shape, and by class, {split}: {data}",
        f"by|which|classifier|{'|'.join(f'{_short(sight)} [%]' for sight in SIGHT_GROUPS)}|images|objects",
        rows,
        f"In predicted masks. Shapes are built by the catalogue, or are real scans. {_INTERVALS}",
    )


def object_table(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Table:
    """Of every object how many of its images each variant named rightly, in predicted masks."""
    mine = chosen(answers, split=split, masks=PREDICTED)
    rows: Rows = []
    for name, about in by_object(mine).items():
        for variant in variants_of(about):
            some = chosen(about, variant=variant)
            parts = [chosen(some, sight=sight) for sight in SIGHT_GROUPS]
            counts = [f"{sum(one.right for one in part)} of {len(part)}" if part else None for part in parts]
            wrong = Counter(one.label for one in some if not one.right)
            taken = ", ".join(f"{label} {count}" for label, count in wrong.most_common())
            rows.append((name, some[0].truth, some[0].shape, variant.name, *counts, taken))
    columns = f"object|class|shape|classifier|{'|'.join(map(_short, SIGHT_GROUPS))}|taken for"
    note = "Number of right answers of all, in predicted masks, and the classes of the wrong answers."
    return table_of(f"By object, {split}: {data}", columns, rows, note)


def mistake_table(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Table:
    """Where mistakes are from: no mask, a mask in whose place the true one would have done, or neither."""
    mine = chosen(answers, split=split)
    in_true = {(one.variant, one.scene): one.right for one in chosen(mine, masks=TRUE)}
    rows: Rows = []
    for variant, sight, some in _groups(chosen(mine, masks=PREDICTED)):
        wrong = [one for one in some if not one.right]
        masked = [one for one in wrong if one.prediction is not None]
        cured = sum(in_true.get((variant, one.scene), False) for one in masked)
        overlaps = [_median([one.iou for one in some if one.right is right]) for right in (True, False)]
        if some:
            counts = (len(wrong), len(wrong) - len(masked), cured, len(masked) - cured)
            spoilt = sum(in_true.get((variant, one.scene)) is False for one in some if one.right)
            rows.append((variant.name, SIGHT_GROUPS[sight], len(some), *counts, spoilt, *overlaps))
    return table_of(
        f"Origin of mistakes, {split}: {data}",
        f"classifier|sight|images|wrong|{NO_MASK}|right in the true mask|wrong there too|"
        "right, but wrong in the true mask|median IoU of masks, right answers|wrong answers",
        rows,
        "In predicted masks; the same images were classified in the true masks.",
    )


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 3) if values else None


def calibration_table(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Table:
    """Whether a classifier is right as often as it is sure, and what it holds back."""
    rows: Rows = []
    for variant, sight, mine in _groups(chosen(answers, split=split, masks=PREDICTED)):
        some = [one for one in mine if one.prediction is not None]
        told = [one.prediction for one in some if one.prediction is not None]
        if not told:
            continue
        sure = [one.right for one, said in zip(some, told, strict=True) if said.sure]
        among = f"{100 * np.mean(sure):.1f} {_span(wilson_interval(sum(sure), len(sure)))}" if sure else None
        confidence, share = np.mean([said.confidence for said in told]), np.mean([one.right for one in some])
        errors = expected_calibration_error(reliability(some)), brier_score(some)
        unsure = f"{100 * (1 - len(sure) / len(some)):.1f}"
        rows.append((variant.name, SIGHT_GROUPS[sight], len(some), f"{100 * confidence:.1f}", f"{100 * share:.1f}",
                     *errors, told[0].threshold, unsure, among))  # fmt: skip
    return table_of(
        f"Calibration, {split}: {data}",
        "classifier|sight|images|mean confidence [%]|accuracy [%]|expected calibration error|Brier score|threshold|"
        "not sure [%]|accuracy among the sure [%]",
        rows,
        "Of images with a predicted mask. Below the threshold the answer is 'not sure'; temperature and threshold "
        "were chosen in training, without test images. The calibration error uses 10 bins of equal width; the Brier "
        "score is summed over the classes, from 0 to 2.",
    )


def pair_table(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Table:
    """McNemar's test between every two variants, and the sign-flip test over objects."""
    rows: Rows = []
    for masks, (sight, words) in product(MASKS, SIGHT_GROUPS.items()):
        mine = chosen(answers, split=split, masks=masks, sight=sight)
        for first, second in combinations(variants_of(mine), 2):
            one = compare_classifiers(chosen(mine, variant=first), chosen(mine, variant=second))
            if one is not None:
                apart = f"{100 * (one.only_first - one.only_second) / one.images:+.1f}"
                counts = (one.only_first, one.only_second, one.images, one.objects)
                rows.append((masks, words, first.name, second.name, apart, *counts, one.p, one.p_by_object))
    return table_of(
        f"Pairs of classifiers, {split}: {data}",
        "masks|sight|first|second|difference [points]|only first right|only second right|images|objects|p, McNemar|"
        "p, by object",
        rows,
        "First minus second. McNemar's exact test treats images as independent, although images of one object are "
        "not; the exact sign-flip test treats objects as independent. Both are two-sided and not corrected for "
        "multiple comparisons.",
        place="summary",
    )


def time_table(times: Mapping[Variant, Sequence[tuple[float, float]]], *, data: str) -> Table:
    """Medians of how long a variant takes for an image: the classification, and the segmentation before it [s]."""
    rows: Rows = []
    for variant, some in times.items():
        if some:
            alone, whole = float(np.median([one for one, _ in some])), float(np.median([sum(one) for one in some]))
            rows.append((variant.name, variant.network, f"{1e3 * alone:.1f}", f"{1e3 * whole:.1f}", len(some)))
    columns = "classifier|network|classification [ms]|with segmentation [ms]|images"
    note = "Medians on the CPU, after imaging, one image after another."
    return table_of(f"Time per image: {data}", columns, rows, note, place="summary")


def worst(answers: Sequence[ClassifierAnswer], split: str, variant: Variant, count: int) -> list[ClassifierAnswer]:
    """A variant's mistakes in predicted masks, the surest first; of each scene one, and no mask last."""
    wrong = [one for one in chosen(answers, split=split, variant=variant, masks=PREDICTED) if not one.right]
    return sorted(wrong, key=lambda one: (-one.prediction.confidence if one.prediction else 0.0, one.scene))[:count]


def bin_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """The reliability curves, for other programs: shares from 0 to 1."""
    rows: Rows = []
    for split in SPLITS:
        mine = chosen(answers, split=split, masks=PREDICTED)
        for variant in variants_of(mine):
            for one in reliability(chosen(mine, variant=variant)):
                edges = (one.low, one.high, one.images, one.confidence, one.right / one.images)
                rows.append((split, variant.name, *edges, *wilson_interval(one.right, one.images)))
    columns = "split|classifier|above|up to|images|mean confidence|accuracy|low|high"
    return table_of(f"Reliability: {data}", columns, rows, place="file")


def confusion_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """Every confusion matrix, one entry a row, for other programs."""
    rows: Rows = []
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
    return table_of(f"Confusions: {data}", "split|masks|classifier|sight|truth|answer|images", rows, place="file")


def answer_table(answers: Sequence[ClassifierAnswer], *, data: str) -> Table:
    """Every single answer, for other programs."""
    classes = list(dict.fromkeys(name for one in answers if one.prediction for name in one.prediction.class_names))
    rows: Rows = []
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
    judged = ("right", "confidence", "sure", *(f"p({name})" for name in classes), "iou", "failure")
    columns = (*["scene", "object", "shape", "sight", "split", "masks", "classifier", "truth", "answer"], *judged)
    return table_of(f"Every answer: {data}", columns, rows, place="file")
