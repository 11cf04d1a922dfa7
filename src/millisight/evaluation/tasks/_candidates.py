"""Classifiers to be evaluated: their names, what they learned from, and which scenes test them."""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from millisight.core import check_known
from millisight.core.errors import InputError
from millisight.evaluation._answers import Variant
from millisight.evaluation._leaks import (
    NO_CLASS,
    SplitPlan,
    TestImage,
    Training,
    classes_of,
    plan_splits,
    published_plan,
    training_of,
)
from millisight.evaluation._scenes import checksum_of
from millisight.evaluation._sources import Origin, SceneSource, TestSplit
from millisight.perception import weights_version
from millisight.perception.classification import Classifier, classifier

RELEASED = "released"  # network of the paper's own weights
_NAMED = 5  # objects in a message


class Candidate(NamedTuple):
    """A classifier that is evaluated."""

    weights: str | None  # file; None: the shipped one
    checksum: str  # of the weights
    variant: Variant
    class_names: tuple[str, ...]  # classes that it knows
    training: Training  # what it learned from
    splits: SplitPlan  # where each scene stands

    def part(self, scene: str) -> str:
        """Name of the result about a scene; copies of the same weights share it."""
        return f"{self.checksum[:12]}.{scene.replace('/', '.')}"


def load_classifier(weights: str | None) -> Classifier:
    """The classifier of a weights file, None: the shipped one; one for all scenes of a process."""
    return _loaded(weights, weights_version(weights))


@lru_cache(maxsize=16)
def _loaded(weights: str | None, version: tuple[int, ...]) -> Classifier:
    """A classifier, kept as long as its files are of that `version`."""
    return classifier() if weights is None else classifier(weights=weights)


def candidates_of(
    weights: Sequence[str | None],
    scenes: Iterable[SceneSource],
    physics: Mapping[str, str],
    origins: Mapping[str, Origin],
    split: TestSplit | None = None,
    classes: Sequence[str] = (),
) -> list[Candidate]:
    """The classifiers, each with the scenes that test it; an error if training and test share what they must not.

    With a `split` the scenes that it tests, whatever a classifier saw; with `classes` those of objects of these.
    """
    scenes = tuple(scenes)
    try:
        loaded = [load_classifier(path) for path in weights]
    except ImportError as error:
        raise InputError(str(error)) from error
    images = [TestImage(one.name, one.object, one.angles, physics[one.name], origins[one.name].seeds) for one in scenes]
    stated = {one.object: shape for one in scenes if (shape := one.shape_class())}
    candidates = []
    for path, by, variant in zip(weights, loaded, _variants(weights, loaded), strict=True):
        for name in classes:
            check_known(f"class of {variant.name}", name, by.class_names)
        known = tuple(classes) or by.class_names
        released = variant.network == RELEASED
        if split is not None:
            splits, training = published_plan(split, [one for one in scenes if not physics[one.name]], known)
            training = training if released else training_of(variant.name, by.description)
        elif released:
            raise InputError(
                f"{variant.name} is the released network, trained on the authors' split: add --split published"
            )
        else:
            training = training_of(variant.name, by.description)
            splits = plan_splits(training, images, classes_of(by.description, known, stated))
        candidates.append(Candidate(path, checksum_of(by), variant, known, training, splits))
    return candidates


def _variants(paths: Sequence[str | None], loaded: Sequence[Classifier]) -> list[Variant]:
    """Each by a name of its own: the description's, and where several share it also what tells them apart."""
    names = [by.name for by in loaded]
    parts, networks, sums = (
        [str(by.description.get(key, "")) for by in loaded] for key in ("parts", "network", "sha256")
    )
    folders = ["shipped" if path is None else Path(path).parent.name for path in paths]
    for more in (parts, networks, folders, [one[:8] for one in sums], range(1, len(names) + 1)):
        alike = [names.count(name) > 1 for name in names]
        names = [f"{name}, {what}" if same else name for name, what, same in zip(names, more, alike, strict=True)]
    return [Variant(*told) for told in zip(names, parts, networks, strict=True)]


def why_none(candidates: Sequence[Candidate], scenes: Mapping[str, SceneSource]) -> str:
    """How many images, and of what, do not test each classifier; and what helps."""
    told = []
    for one in candidates:
        left_out = (
            f"{len(some)} {reason} ({_few({scenes[name].object for name in some})})"
            for reason, some in sorted(one.splits.left_out.items())
        )
        told.append(f"{one.training.name}, which knows {', '.join(one.class_names)}: {', '.join(left_out)}")
    if any(NO_CLASS in one.splits.left_out for one in candidates):
        told[-1] += (
            "; state the class of an object of your own in the recipe of the dataset, `class` of [[files]], or in "
            "`classes` and `tests` of the training recipe"
        )
    return f"Left out of {'; of '.join(told)}"


def _few(names: set[str]) -> str:
    some = sorted(names)
    return ", ".join(some[:_NAMED]) + (f" and {len(some) - _NAMED} more" if len(some) > _NAMED else "")
