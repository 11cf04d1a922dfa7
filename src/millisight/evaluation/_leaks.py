"""What training and test must not share: objects, poses, seeds, physics; and in which table an image may stand.

Of an object that a classifier was trained on, the answer is object-closed; of one that it never met, neither in
training nor in validation, object-disjoint. Objects are the same by name: a real scan of what was trained on as a drawn
shape is no new object.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, rotation_from_euler_deg
from millisight.core.errors import InputError
from millisight.evaluation._answers import CLOSED, DISJOINT, PUBLISHED, SPLITS
from millisight.evaluation._physics import KINDS, UNKNOWN, Physics, physics_of
from millisight.evaluation._sources import SceneSource, TestSplit
from millisight.meshes import CATALOGUE, NO_SHAPE_CLASS, object_name

WITHIN_DEG = 1.0
"""Poses nearer than this are the same pose."""
VALIDATION, SAME_POSE, NO_CLASS = "seen in validation only", "in a pose of training", "of no class that it knows"
NO_TEST = "not tested by the split"
LEFT_OUT = (VALIDATION, SAME_POSE, NO_CLASS)
"""Why an image stands in no table."""


class Training(NamedTuple):
    """Training data of a classifier, from the description beside its weights.

    Attributes
    ----------
    name : of the classifier, for messages
    training, validation : names of objects
    rotations : of each object the poses (n, 3, 3) of training and validation images
    seed : of its random numbers
    physics : what made its images
    """

    name: str
    training: frozenset[str]
    validation: frozenset[str]
    rotations: Mapping[str, np.ndarray]
    seed: int
    physics: Physics


def training_of(name: str, description: Mapping[str, Any]) -> Training:
    """Read the training data of a classifier from the description of its weights.

    Raises
    ------
    InputError
        It does not say, or what it says cannot be right: then nobody can tell whether a test is one.
    """
    try:
        sides = {side: [str(one) for one in description["objects"][side]] for side in ("training", "validation")}
        poses = {str(one): list(turned) for one, turned in description["poses"].items()}
        seed, physics = int(description["seed"]), physics_of(description["physics"])
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(
            f"the description of {name} does not state the objects, poses, seed and physics of its training "
            f"({error!r}), so test images may not be new to it; train it again"
        ) from error
    if not physics.told:
        raise InputError(f"the description of {name} does not state the physics of its images; train it again")
    unknown = sorted({*sides["training"], *sides["validation"]} - set(poses))
    if unknown:
        raise InputError(f"the description of {name} states no poses of {', '.join(unknown)}; train it again")
    return Training(
        name=name,
        training=frozenset(map(object_name, sides["training"])),
        validation=frozenset(map(object_name, sides["validation"])),
        rotations={object_name(one): _rotations(f"poses of {one} of {name}", turned) for one, turned in poses.items()},
        seed=seed,
        physics=physics,
    )


def _rotations(name: str, angles_deg: list) -> np.ndarray:
    """(n, 3, 3) from (n, 3) [degrees]."""
    if not angles_deg:
        return np.zeros((0, 3, 3))
    return np.stack([rotation_from_euler_deg(one) for one in checked_array(angles_deg, name=name, shape=("n", 3))])


def nearest_pose_deg(training: Training, name: str, angles_deg: ArrayLike) -> float:
    """The angle of the smallest rotation from a pose of that object in training to this one [degrees]; inf: none.

    Of the rotation Aᵀ B the angle is arccos((trace - 1) / 2), whatever the axis.
    """
    turned = training.rotations.get(object_name(name), np.zeros((0, 3, 3)))
    if not len(turned):
        return np.inf
    traces = np.einsum("nij,ij->n", turned, rotation_from_euler_deg(angles_deg))
    return float(np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1))).min())


class TestImage(NamedTuple):
    """Facts about a test image.

    Attributes
    ----------
    scene, object : see ClassifierAnswer
    angles : how the object was turned about the fixed axes x, y and z, (3,) [degrees]
    physics : what made the image; "" of a real one
    seeds : of its random numbers
    """

    __test__ = False  # pytest takes it for tests

    scene: str
    object: str
    angles: tuple[float, float, float]
    physics: str
    seeds: frozenset[int]


class SplitPlan(NamedTuple):
    """Split of the test images for one classifier.

    Attributes
    ----------
    placed : (split, class) by scene
    left_out : scenes by the reason why they are in no table
    notes : what could not be checked, for the tables
    """

    placed: dict[str, tuple[str, str]]
    left_out: dict[str, list[str]]
    notes: tuple[str, ...] = ()


def plan_splits(training: Training, images: Sequence[TestImage], classes: Mapping[str, str]) -> SplitPlan:
    """Split images into tests on known objects, tests on new objects, and others; check for leaks.

    Parameters
    ----------
    training : of the classifier
    images : TestImage
    classes : of objects, as far as the classifier knows them

    Raises
    ------
    InputError
        Images were made by the physics or with the seed of training.
    """
    notes = check_physics(training, {image.physics for image in images})
    check_seeds(training, {seed for image in images for seed in image.seeds})
    placed: dict[str, tuple[str, str]] = {}
    left_out: dict[str, list[str]] = {}
    for image in images:
        side = side_of(training, image.object, image.angles) if image.object in classes else NO_CLASS
        if side in SPLITS:
            placed[image.scene] = side, classes[image.object]
        else:
            left_out.setdefault(side, []).append(image.scene)
    return SplitPlan(placed, left_out, notes)


def published_plan(
    split: TestSplit, scenes: Iterable[SceneSource], class_names: Sequence[str]
) -> tuple[SplitPlan, Training]:
    """The test images of a published split for a classifier of these classes, and what the authors trained with."""
    placed: dict[str, tuple[str, str]] = {}
    left_out: dict[str, list[str]] = {}
    for scene in scenes:
        shape = split.classes.get(scene.folder) or NO_SHAPE_CLASS
        if (scene.folder, scene.number, scene.sight) not in split.test:
            left_out.setdefault(NO_TEST, []).append(scene.name)
        elif shape not in class_names:
            left_out.setdefault(NO_CLASS, []).append(scene.name)
        else:
            placed[scene.name] = PUBLISHED, shape
    training = Training(
        name=f"the split {split.name}",
        training=split.training,
        validation=split.validation - split.training,
        rotations={},
        seed=0,
        physics=physics_of("published simulator"),
    )
    return SplitPlan(placed, left_out), training


def classes_of(
    description: Mapping[str, Any], class_names: Sequence[str], stated: Mapping[str, str] | None = None
) -> dict[str, str]:
    """The class of every object that is of one that the classifier knows.

    By the catalogue; where the dataset states one, by that; where the classifier has `classes` of its own, by these.

    Parameters
    ----------
    description : of the weights; its `classes`, if any, are names of objects by class
    class_names : that the classifier knows
    stated : classes that the dataset states, by object

    Raises
    ------
    InputError
        `classes` are no lists of names.
    """
    own = description.get("classes", {})
    if not isinstance(own, Mapping) or not all(isinstance(names, list | tuple) for names in own.values()):
        raise InputError(f"the description's classes are {own!r}; expected lists of objects' names by class")
    told = {name: entry.shape_class for name, entry in CATALOGUE.items()}
    told |= {object_name(name): one for name, one in (stated or {}).items()}
    told |= {object_name(str(name)): str(one) for one, names in own.items() for name in names}
    return {name: one for name, one in told.items() if one in class_names}


def side_of(training: Training, name: str, angles_deg: ArrayLike) -> str:
    """CLOSED, DISJOINT, or why an image of that object in that pose [degrees] stands in neither table."""
    known = object_name(name)
    if known in training.training:
        return SAME_POSE if nearest_pose_deg(training, known, angles_deg) <= WITHIN_DEG else CLOSED
    return VALIDATION if known in training.validation else DISJOINT


def check_seeds(training: Training, seeds: Iterable[int]) -> None:
    """No seed of the test images may be that of training."""
    if training.seed in set(seeds):
        raise InputError(
            f"{training.name} was trained with the seed {training.seed}, which the test images were made with, too: "
            "their random numbers may be the same; make test images with another seed"
        )


def check_physics(training: Training, tested: Iterable[str]) -> tuple[str, ...]:
    """Refuse test images made by what made those of training; of which this cannot be told, say so in a note.

    `tested` are in the words of the files; "" of real images, which no simulator made.
    """
    images = [physics_of(told) for told in sorted(set(tested) - {""})]
    same = [one for one in images if one.is_that_of(training.physics)]
    if same:
        raise InputError(
            f"{training.name} was trained on images of the same physics as the test images, {same[0].told!r}: this is "
            "no test on other physics; train on images of the simulator, or test on images of the rig"
        )
    unknown = [one.told for one in images if one.is_that_of(training.physics) is None]
    if not unknown:
        return ()
    known = " and ".join(repr(kind) for kind in KINDS if kind != UNKNOWN)
    return (
        f"{training.name}: whether the physics of the test images is other than that of training is unknown. Training "
        f"states {training.physics.told!r}, the images {', '.join(map(repr, unknown))}; {known} are known here.",
    )


def siblings(training: Training, names: Iterable[str]) -> dict[str, list[str]]:
    """Of tested objects those with siblings in training or validation, such as another cup of a set, and which."""
    seen = training.training | training.validation
    families = {name: _family(name) for name in seen}
    found = {name: sorted(other for other in seen if families[other] == _family(name)) for name in sorted(set(names))}
    return {name: others for name, others in found.items() if others}


def _family(name: str) -> str:
    """The number in the YCB set without its letter; of an object that is not in the catalogue its name."""
    known = object_name(name)
    return CATALOGUE[known].number.partition("-")[0] if known in CATALOGUE else known
