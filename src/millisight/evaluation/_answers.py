"""How well objects are classified: accuracy with intervals, confusions, calibration, and variants on the same images.

Images of one object are not independent: beside what counts images stands what counts objects.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import check_known, checked_integer, checked_record, record
from millisight.core.errors import InputError
from millisight.data import Prediction
from millisight.evaluation._scenes import SIGHTS
from millisight.evaluation._statistics import bootstrap_interval, mcnemar, sign_flip, wilson_interval

CLOSED, DISJOINT = "object-closed", "object-disjoint"
PUBLISHED = "published"
SPLITS = (CLOSED, DISJOINT, PUBLISHED)
"""Whether a classifier saw the object in training, otherwise turned and by other physics, or never; or the test images
of the authors' split, whatever it saw."""
PREDICTED, TRUE = "predicted", "true"
MASKS = (PREDICTED, TRUE)
"""What was classified: the image in the mask that a segmenter found, as in the paper, or in the true one."""
SIGHT_GROUPS = {**SIGHTS, "overall": "overall"}
NO_MASK = "no mask"
"""In the place of an answer where no mask was found, and nothing could be classified: it counts as wrong."""


class Variant(NamedTuple):
    """One classifier among those compared.

    Attributes
    ----------
    name : of its own among them
    parts : of the simulated images that it was trained on: "both", "edge" or "specular"
    network : which one it is
    """

    name: str
    parts: str
    network: str


@record
class ClassifierAnswer:
    """Answer of one classifier for one image in one mask.

    Attributes
    ----------
    scene, object : of the image
    sight : "los" or "nlos"
    shape : where the object's shape is from: "built" by the catalogue, a real "scan", a "file", or "unknown"
    truth : its class
    variant : Variant
    split : one of SPLITS, by what this very variant saw in training
    masks : one of MASKS
    prediction : None where there was no mask
    failure : why there was none; "" otherwise
    iou : of the mask with the true one
    """

    scene: str
    object: str
    sight: str
    shape: str
    truth: str
    variant: Variant
    split: str
    masks: str
    prediction: Prediction | None
    failure: str = ""
    iou: float = 1.0

    def __post_init__(self) -> None:
        for kind, value, known in (
            ("kind of sight", self.sight, SIGHTS),
            ("split", self.split, SPLITS),
            ("masks", self.masks, MASKS),
        ):
            check_known(kind, value, known)
        if self.prediction is not None:
            checked_record(self.prediction, Prediction, name="prediction")
            if self.truth not in self.prediction.class_names:
                known = ", ".join(self.prediction.class_names)
                raise InputError(f"{self.scene} shows a {self.truth}, which {self.variant.name} does not know: {known}")

    @property
    def label(self) -> str:
        """The most probable class, however sure; NO_MASK where there is none."""
        return NO_MASK if self.prediction is None else self.prediction.label

    @property
    def right(self) -> bool:
        """Whether the label is the true class."""
        return self.label == self.truth


def chosen(answers: Iterable[ClassifierAnswer], **wanted: Hashable) -> list[ClassifierAnswer]:
    """Those whose fields have these values; `sight="overall"` takes both.

    Examples
    --------
    >>> chosen([], split=CLOSED, masks=TRUE, sight="los")
    []
    """
    if wanted.get("sight") == "overall":
        del wanted["sight"]
    return [one for one in answers if all(getattr(one, name) == value for name, value in wanted.items())]


class Accuracy(NamedTuple):
    """Number of images classified correctly, with intervals.

    Attributes
    ----------
    right : number of images classified correctly
    images : number of images
    objects : number of objects that they show
    wilson : 95 % interval, with images taken as independent
    by_object : 95 % bootstrap interval, objects drawn with all their images; None for a single object
    """

    right: int
    images: int
    objects: int
    wilson: tuple[float, float]
    by_object: tuple[float, float] | None

    @property
    def share(self) -> float:
        """Of the images, those named rightly, 0 to 1."""
        return self.right / self.images


def accuracy(answers: Sequence[ClassifierAnswer]) -> Accuracy | None:
    """Of these answers; None where there are none."""
    if not answers:
        return None
    counts = np.array([(sum(one.right for one in some), len(some)) for some in by_object(answers).values()])
    right, images = int(counts[:, 0].sum()), len(answers)
    drawn = bootstrap_interval(counts, _share, rng=0) if len(counts) > 1 else None
    return Accuracy(right, images, len(counts), wilson_interval(right, images), drawn)


def _share(counts: np.ndarray) -> float:
    """Of (n, 2) right and all; the reduction itself, for this is what the drawing of objects takes its time for."""
    right, images = np.add.reduce(counts)
    return right / images


def by_object(answers: Iterable[ClassifierAnswer]) -> dict[str, list[ClassifierAnswer]]:
    """Answers by the object that they are about, sorted by its name."""
    found = defaultdict(list)
    for one in answers:
        found[one.object].append(one)
    return dict(sorted(found.items()))


class Confusion(NamedTuple):
    """Confusion matrix.

    Attributes
    ----------
    truths : (T,) true classes, in the classifier's order
    answers : (A,) classes that the classifier knows, and NO_MASK where that occurred
    counts : (T, A) numbers of images
    """

    truths: tuple[str, ...]
    answers: tuple[str, ...]
    counts: np.ndarray


def confusion(answers: Sequence[ClassifierAnswer]) -> Confusion:
    """Of the answers of one classifier.

    Raises
    ------
    InputError
        They are of several that know other classes.
    """
    orders = {one.prediction.class_names for one in answers if one.prediction is not None}
    if len(orders) > 1:
        raise InputError(
            f"the answers come from classifiers with different classes, {sorted(orders)}; pass one at a time"
        )
    known = orders.pop() if orders else tuple(sorted({one.truth for one in answers}))
    names = (*known, *([NO_MASK] if any(one.prediction is None for one in answers) else []))
    truths = tuple(name for name in known if any(one.truth == name for one in answers))
    counts = np.zeros((len(truths), len(names)), int)
    for one in answers:
        counts[truths.index(one.truth), names.index(one.label)] += 1
    return Confusion(truths, names, counts)


class Bin(NamedTuple):
    """Answers with confidences above `low` and up to `high`.

    Attributes
    ----------
    low : lower bound of the confidence, not included
    high : upper bound, included
    images : number of images
    right : number of images classified correctly
    confidence : mean confidence
    """

    low: float
    high: float
    images: int
    right: int
    confidence: float


def reliability(answers: Iterable[ClassifierAnswer], *, bins: int = 10) -> list[Bin]:
    """Accuracy over confidence, in bins of equal width that are not empty."""
    count = checked_integer(bins, name="bins")
    pairs = [(one.prediction.confidence, one.right) for one in answers if one.prediction is not None]
    if not pairs:
        return []
    confidences, right = np.array(pairs).T
    numbers = np.clip(np.ceil(confidences * count - 1e-9).astype(int) - 1, 0, count - 1)
    return [
        Bin(n / count, (n + 1) / count, int(mine.sum()), int(right[mine].sum()), float(confidences[mine].mean()))
        for n in range(count)
        if (mine := numbers == n).any()
    ]


def expected_calibration_error(bins: Sequence[Bin]) -> float | None:
    """Σ n_b / n · |right share - mean confidence| over bins (Naeini, Cooper and Hauskrecht 2015); None without any."""
    images = sum(one.images for one in bins)
    if not images:
        return None
    return sum(abs(one.right - one.images * one.confidence) for one in bins) / images


def brier_score(answers: Iterable[ClassifierAnswer]) -> float | None:
    """Mean over images of Σ_c (p_c - [c is the truth])², from 0 to 2 (Brier 1950); None without any prediction."""
    errors = [
        ((one.prediction.probabilities - (np.array(one.prediction.class_names) == one.truth)) ** 2).sum()
        for one in answers
        if one.prediction is not None
    ]
    return float(np.mean(errors)) if errors else None


class PairedComparison(NamedTuple):
    """Two variants on the same images.

    Attributes
    ----------
    first : one variant
    second : the other
    images : number of images that both classified
    objects : number of objects that they show
    only_first : number of images that only `first` classified correctly (b)
    only_second : number of images that only `second` classified correctly (c)
    p : p-value of McNemar's exact test, with images taken as independent
    p_by_object : p-value of the sign-flip test, with objects taken as independent
    """

    first: Variant
    second: Variant
    images: int
    objects: int
    only_first: int
    only_second: int
    p: float
    p_by_object: float


def compare_classifiers(
    first: Iterable[ClassifierAnswer], second: Iterable[ClassifierAnswer]
) -> PairedComparison | None:
    """The answers of two variants, paired by scene, each asked about once; None where they have no image in common."""
    one, other = (_by_scene(answers) for answers in (first, second))
    common = [scene for scene in one if scene in other]
    if not common:
        return None
    better: dict[str, list[int]] = defaultdict(list)
    for scene in common:
        better[one[scene].object].append(int(one[scene].right) - int(other[scene].right))
    apart = [value for values in better.values() for value in values]
    b, c = apart.count(1), apart.count(-1)
    return PairedComparison(
        first=one[common[0]].variant,
        second=other[common[0]].variant,
        images=len(common),
        objects=len(better),
        only_first=b,
        only_second=c,
        p=mcnemar(b, c),
        p_by_object=sign_flip([sum(values) for values in better.values()]),
    )


def _by_scene(answers: Iterable[ClassifierAnswer]) -> dict[str, ClassifierAnswer]:
    found: dict[str, ClassifierAnswer] = {}
    for one in answers:
        if one.scene in found:
            raise InputError(f"{one.scene} occurs twice; expected the answers of one variant in one kind of masks")
        found[one.scene] = one
    return found
