"""Training of classifiers: the recipe."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, checked_integer, checked_number, checked_record, printable, put, record
from millisight.core.errors import InputError, UnknownNameError
from millisight.meshes import CATALOGUE, NO_SHAPE_CLASS, ODD, PAPER_CLASSES, PUBLISHED_CLASSES, object_name
from millisight.perception.classification import prior_shares
from millisight.perception.training._beside import read_beside
from millisight.perception.training._classifier_lesson import EMPTY, NETWORK_BANDS, SPARSE, ClassifierLesson
from millisight.perception.training._loop import Schedule
from millisight.perception.training._scenes import (
    DRAWN_OBJECTS,
    HOUSEHOLD_OBJECTS,
    RANDOM_OBJECTS,
    SceneSettings,
)
from millisight.perception.training._sources import check_classes, meshes_in, simulations_in
from millisight.perception.training._training import (
    NORMALISATIONS,
    RECIPES,
    SceneRequest,
    TrainingScenes,
)
from millisight.perception.training._whole import ECHOES, WholeSettings

_RANDOM = {shape: name for name, shape in RANDOM_OBJECTS.items()}  # names of scenes of a class's random shapes
_HOUSEHOLD = {shape: name for name, shape in HOUSEHOLD_OBJECTS.items()}  # and of its household things
_STRETCH = 0.25
_HELD_EVERY = 6  # scene of each object is for validation
_SPARSE = 1500, 1000, 500, 250  # positions over an object: two to five times too few at 77 GHz


@RECIPES.add("classifier")
@record
class ClassifierRecipe:
    """How a classifier is trained.

    Attributes
    ----------
    name : of the weights
    about : for the weights' description
    classes : names of catalogue objects by class; empty: the catalogue's own classes but "other", the paper's four
    without : objects that no scene shows
    tests : objects that no scene shows because they will test; one that `classes` names need not be in the catalogue:
        the description of the weights then holds the class of an object of your own
    scenes : of each class; its objects share them evenly. Every sixth of an object's is for validation. 0: none, only
        those of a dataset
    drawn : of each class besides, scenes of shapes drawn at random (`meshes.random_shape`), every sixth for validation
    household : of each class besides, scenes of household things drawn at random, every sixth for validation
    odd : of the class "other" besides, scenes of odd shapes drawn at random, every sixth for validation
    judged : of each class besides, scenes of shapes drawn at random that are for validation only, and as many of
        household things and of odd shapes: what the thresholds come from
    vertices, positions, widest, meshes, published : of the scenes, see SceneSettings; `classes` may name meshes of the
        folder, and objects of the dataset, of whose simulated images every sixth of a class is for validation
    prior : how often each class occurs where the weights will be used, in any unit; none: each as often. Answers and
        their calibration count with it
    stretch : of the scenes of each class, see SceneSettings; 0.25 of those that are not named
    parts : "both", "edge" or "specular"
    network : "small", or the "paper"'s
    members : networks of their own weights, to which a batch is dealt out; the mean of their logits is the answer
    beside : files `.safetensors` of classifiers that are trained already, of the same network, classes and
        normalisation, with their descriptions `.json`. They stay as they are; the answer is the mean of all logits
    batch : examples in a batch, for each member one at least
    masks : of whom examples have masks, besides true and disturbed ones: "shipped", the shipped segmenter "wave"; a
        file of weights as of `millisight train segmenter`; "": nobody
    examples : in an epoch, of each class as many and of each of its scenes, each turned or mirrored
    renewed : whether every epoch has new ones, of other masks and other disturbances, rather than the same
    normalisation : of the small network, "group" or "batch"; see `SmallNetwork`
    novel : simulations of what no class is: half of scenes with nothing there, half of scans that are too sparse; with
        masks beside the objects they are one class more, whose probability is an answer's novelty. 0: none
    schedule : its seed is that of everything
    whole : whole scenes of each simulated object; they show one
    """

    stem = "classifier"

    name: str = "classifier"
    about: str = ""
    classes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()
    scenes: int = 96
    drawn: int = 0
    household: int = 0
    odd: int = 0
    judged: int = 0
    vertices: int = 3000
    positions: int = 6000
    widest: float = 0.32
    meshes: str = ""
    published: str = ""
    prior: Mapping[str, float] = field(default_factory=dict)
    stretch: Mapping[str, float] = field(default_factory=dict)
    parts: str = "both"
    network: str = "small"
    members: int = 1
    beside: tuple[str, ...] = ()
    masks: str = ""
    novel: int = 0
    batch: int = 32
    examples: int = 6000
    renewed: bool = False
    normalisation: str = "group"
    schedule: Schedule = field(default_factory=Schedule)
    whole: WholeSettings = field(default_factory=lambda: WholeSettings(views=3))

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        for shape, objects in self.classes.items():
            if isinstance(objects, str) or not isinstance(objects, Sequence):
                raise InputError(f"classes: {shape} is {objects!r}; expected a list of names of the catalogue")
        own = {str(shape): tuple(str(name) for name in objects) for shape, objects in self.classes.items()}
        checked_record(self.masks, str, name="masks")
        for kind, value, known in (("parts", self.parts, ECHOES), ("network", self.network, NETWORK_BANDS)):
            check_known(kind, value, known)
        check_known("normalisation", self.normalisation, NORMALISATIONS)
        checked_record(self.renewed, bool, name="renewed")
        named = [name for objects in own.values() for name in objects]
        known = (*CATALOGUE, *meshes_in(self.meshes), *simulations_in(self.published))
        for name in (*self.without, *self.tests, *named):
            if name not in known and object_name(name) not in known and not (name in named and name in self.tests):
                raise UnknownNameError("catalogue object", name, known)
        put(
            self,
            classes=own,
            scenes=checked_integer(self.scenes, name="scenes", minimum=0 if self.published else 1),
            drawn=checked_integer(self.drawn, name="drawn", minimum=0),
            household=checked_integer(self.household, name="household", minimum=0),
            odd=checked_integer(self.odd, name="odd", minimum=0),
            judged=checked_integer(self.judged, name="judged", minimum=0),
            stretch={
                str(shape): checked_number(value, name=f"stretch of {shape}", minimum=0)
                for shape, value in self.stretch.items()
            },
            prior={
                str(shape): checked_number(share, name=f"prior of {shape}", above=0)
                for shape, share in self.prior.items()
            },
            members=checked_integer(self.members, name="members"),
            beside=tuple(checked_record(path, str, name="a file of beside") for path in self.beside),
            batch=checked_integer(self.batch, name="batch", minimum=self.members),
            examples=checked_integer(self.examples, name="examples", minimum=self.batch),
            novel=checked_integer(self.novel, name="novel", minimum=0),
            whole=dataclasses.replace(self.whole, empty=0.0, several=0.0, parts=self.parts),
        )
        check_classes(self.objects, self.drawn or self.household)
        prior_shares(self.prior, self.objects)
        for path in self.beside:
            read_beside(path, list(self.objects), self.network)
        for name, count in (("drawn", self.drawn), ("household", self.household)):
            for shape in self.objects if count else ():
                if shape not in PUBLISHED_CLASSES:
                    raise InputError(
                        f"{name} is {count}, and {shape!r} is none of the classes whose shapes can be drawn at random, "
                        f"{', '.join(PUBLISHED_CLASSES)}; name these only, or set {name} to 0"
                    )
        if self.odd and NO_SHAPE_CLASS not in self.objects:
            raise InputError(
                f"odd is {self.odd}, and odd shapes are of the class {NO_SHAPE_CLASS!r}, which classes lacks; add it"
            )
        for shape in self.stretch:
            check_known("class", shape, self.objects)
        for shape in self.objects:
            if not self.scene_settings(shape) and len(self.simulated(shape)) < 2:
                raise InputError(
                    f"{printable(self.published)} has {len(self.simulated(shape))} simulations of the class {shape!r}; "
                    "expected two at least, one to validate with: name more objects in classes, or set scenes above 0"
                )

    @property
    def every_object(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the objects of each class, whether trained with or not."""
        return self.classes or {
            shape: tuple(name for name, entry in CATALOGUE.items() if entry.shape_class == shape)
            for shape in PAPER_CLASSES
        }

    @property
    def objects(self) -> dict[str, tuple[str, ...]]:
        """Names of the objects to train with, by class."""
        left_out = {object_name(name) for name in (*self.without, *self.tests)}
        return {
            shape: tuple(name for name in names if object_name(name) not in left_out)
            for shape, names in self.every_object.items()
        }

    @property
    def shares(self) -> np.ndarray | None:
        """(C,) how often each class occurs, 1 in all; None: each as often."""
        return prior_shares(self.prior, self.objects) if self.prior else None

    def scene_settings(self, shape: str) -> dict[str, SceneSettings]:
        """How the scenes of a class are made, by the name of what they show: its objects, and random shapes."""
        meshes = {*CATALOGUE, *meshes_in(self.meshes)}
        objects = [name for name in self.objects[shape] if self.scenes and name in meshes]
        every = SceneSettings(
            poses=max(-(-self.scenes // max(len(objects), 1)), 2), vertices=self.vertices,
            positions=self.positions, widest=self.widest, stretch=self.stretch.get(shape, _STRETCH), meshes=self.meshes,
        )  # fmt: skip
        made = dict.fromkeys(objects, every)
        if self.drawn:
            made[_RANDOM[shape]] = dataclasses.replace(every, poses=self.drawn, stretch=0.0)
        if self.household:
            made[_HOUSEHOLD[shape]] = dataclasses.replace(every, poses=self.household, stretch=0.0)
        if self.odd and shape == NO_SHAPE_CLASS:
            made[_RANDOM[ODD]] = dataclasses.replace(every, poses=self.odd, stretch=0.0)
        return made

    def scene_requests(self) -> list[SceneRequest]:
        """Class by class, object by object; of a class first those that are made, then those of the dataset."""
        requests = []
        for label, shape in enumerate(self.objects):
            requests += [
                SceneRequest(side, name, number, label, settings)
                for name, settings in self.scene_settings(shape).items()
                for number, side in enumerate(self._sides(name, settings.poses))
            ]
            settings = SceneSettings(widest=self.widest)
            requests += [
                SceneRequest(_side(number), name, number, label, settings, source)
                for number, (name, source) in enumerate(self.simulated(shape))
            ]
        return requests + [self._novel_request(number) for number in range(self.novel)]

    def _sides(self, name: str, poses: int) -> list[str]:
        """Of so many scenes of an object, and of those that validate only: shapes drawn at random."""
        return [*map(_side, range(poses)), *["validation"] * (self.judged if name in DRAWN_OBJECTS else 0)]

    def _novel_request(self, number: int) -> SceneRequest:
        """Scenes of what is of no class, of random shapes: in turn without the shape, and too sparsely scanned."""
        settings = SceneSettings(vertices=self.vertices, positions=self.positions, widest=self.widest)
        pair, sparse = divmod(number, 2)
        shown = list(RANDOM_OBJECTS)[pair % len(RANDOM_OBJECTS)]
        if sparse:
            few = _SPARSE[pair % len(_SPARSE)]
            settings = dataclasses.replace(settings, positions=min(few, self.positions))
        label, side = len(self.objects), _side(pair)
        return SceneRequest(
            side, SPARSE if sparse else EMPTY, pair, label, settings, shown=shown,
            whole=None if sparse else dataclasses.replace(self.whole, empty=1.0),
        )  # fmt: skip

    def simulated(self, shape: str) -> list[tuple[str, Path]]:
        """Names of a class's objects, and the folders of their simulated images in the dataset."""
        found = simulations_in(self.published)
        return [(name, source) for name in self.objects[shape] for source in found.get(object_name(name), ())]

    def lesson(self, scenes: TrainingScenes) -> ClassifierLesson:
        """The classes of the objects of these scenes."""
        return ClassifierLesson(self, scenes)

    def summary(self, description: Mapping[str, Any]) -> str:
        """Accuracy on the validation scenes."""
        return (
            f"{100 * description['validation']['accuracy']:.1f} % of the validation scenes right, chance is "
            f"{100 / len(description['class_names']):.1f} %"
        )


def _side(number: int) -> str:
    return "validation" if number % _HELD_EVERY == 1 else "training"
