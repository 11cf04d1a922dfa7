"""What a classifier is trained on: a recipe, the simulated scenes that it asks for, and examples of them."""

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.perception import augmentation, classifier_features, wave_features
from millisight.perception.training import Schedule
from millisight.perception.training_scenes import PARTS as SCENE_PARTS
from millisight.perception.training_scenes import RANDOM, SceneParts, Scenes, scenes_of
from millisight.records import checked_integer, checked_number, checked_numbers, checked_record, put, record
from millisight.scene.objects import CATALOGUE, SHAPE_CLASSES

PARTS = ("both", "edge", "specular")
"""Which of the simulator's answers a network is taught with; `both` is the paper's way."""

_NETWORKS = ("small", "paper")
_RANDOM = {shape: name for name, shape in RANDOM.items()}  # what scenes of a class's random shapes are called
_STRETCH = 0.25
_IN_A_BOX = 0.6  # of the scenes with a sheet have it as bright as a carton's lid
_LID_DB = (-18.0, 0.0)  # that is, relative to the object's maximum
_ONE_BAND = 0.3  # of the examples have no 24 GHz image
_HELD_EVERY = 6  # scene of each object is for validation


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
        the description of the weights then tells the class of an object of your own
    scenes : of each class; its objects share them evenly. Every sixth of an object's is for validation
    drawn : of each class besides, scenes of shapes drawn at random (`scene.random_shapes`), every sixth for validation
    vertices, spacing, widest : of the scenes, see Scenes
    stretch : of the scenes of each class, see Scenes; 0.25 of those that are not named
    parts : "both", "edge" or "specular"
    network : "small", or the "paper"'s
    batch : examples in a batch
    examples : of each class as many and of each of its scenes; an epoch has them all, laid otherwise
    schedule : its seed is that of everything
    """

    name: str = "classifier"
    about: str = ""
    classes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()
    scenes: int = 96
    drawn: int = 0
    vertices: int = 3000
    spacing: tuple[float, float, float] = (0.003, 0.003, 0.015)
    widest: float = 0.32
    stretch: Mapping[str, float] = field(default_factory=dict)
    parts: str = "both"
    network: str = "small"
    batch: int = 32
    examples: int = 6000
    schedule: Schedule = field(default_factory=Schedule)

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        for shape, objects in self.classes.items():
            if isinstance(objects, str) or not isinstance(objects, Sequence):
                raise InputError(f"classes: {shape} is {objects!r}; expected a list of names of the catalogue")
        own = {str(shape): tuple(str(name) for name in objects) for shape, objects in self.classes.items()}
        for kind, value, known in (("parts", self.parts, PARTS), ("network", self.network, _NETWORKS)):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        named = [name for objects in own.values() for name in objects]
        for name in (*self.without, *self.tests, *named):
            if name not in CATALOGUE and not (name in named and name in self.tests):
                raise UnknownNameError("catalogue object", name, CATALOGUE)
        put(
            self,
            classes=own,
            scenes=checked_integer(self.scenes, name="scenes"),
            drawn=checked_integer(self.drawn, name="drawn", minimum=0),
            spacing=checked_numbers(self.spacing, name="spacing", count=3, unit="m", above=0),
            stretch={
                str(shape): checked_number(value, name=f"stretch of {shape}", minimum=0)
                for shape, value in self.stretch.items()
            },
            batch=checked_integer(self.batch, name="batch"),
            examples=checked_integer(self.examples, name="examples", minimum=self.batch),
        )
        _check_classes(self.objects)
        for shape in self.objects if self.drawn else ():
            if shape not in _RANDOM:
                raise InputError(
                    f"drawn is {self.drawn}, and {shape!r} is none of the classes whose shapes can be drawn at random, "
                    f"{', '.join(_RANDOM)}; name these only, or set drawn to 0"
                )
        for shape in self.stretch:
            if shape not in self.objects:
                raise UnknownNameError("class", shape, self.objects)

    @property
    def every_object(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the objects of each class, whether trained with or not."""
        return self.classes or {
            shape: tuple(name for name, entry in CATALOGUE.items() if entry.shape_class == shape)
            for shape in SHAPE_CLASSES[:-1]
        }

    @property
    def objects(self) -> dict[str, tuple[str, ...]]:
        """Names of the objects to train with, by class."""
        left_out = {*self.without, *self.tests}
        return {
            shape: tuple(name for name in names if name not in left_out) for shape, names in self.every_object.items()
        }

    def scenes_of(self, shape: str) -> dict[str, Scenes]:
        """How the scenes of a class are made, by the name of what they show: its objects, and what is drawn."""
        objects = self.objects[shape]
        every = Scenes(
            poses=max(-(-self.scenes // len(objects)), 2), vertices=self.vertices, spacing=self.spacing,
            widest=self.widest, stretch=self.stretch.get(shape, _STRETCH),
        )  # fmt: skip
        made = dict.fromkeys(objects, every)
        if self.drawn:
            made[_RANDOM[shape]] = dataclasses.replace(every, poses=self.drawn, stretch=0.0)
        return made


def _check_classes(objects: Mapping[str, Sequence[str]]) -> None:
    if len(objects) < 2:
        raise InputError(f"classes are {list(objects)}; expected two at least, for there to be something to tell apart")
    for shape, names in objects.items():
        if not names:
            raise InputError(
                f"no object is left for the class {shape!r}; name some in classes, or fewer in without and tests"
            )
    every = [name for names in objects.values() for name in names]
    for name in every:
        if every.count(name) > 1:
            raise InputError(f"{name} is named more than once in classes; expected each object in one class, once")


class Drawn(NamedTuple):
    """A scene to learn from.

    Attributes
    ----------
    name : of its object, or one of `RANDOM`
    label : index of its class
    scene : SceneParts
    """

    name: str
    label: int
    scene: SceneParts


def make_examples(
    recipe: ClassifierRecipe, folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> dict[str, list[Drawn]]:
    """The recipe's scenes, by "training" and "validation"; those that the folder holds already are read.

    Parameters
    ----------
    folder : of the scenes; recipes that differ in parts or network may share it
    progress : called with (scenes made, scenes in all)

    Raises
    ------
    FileError, DamagedFileError
    """
    scenes, done = [recipe.scenes_of(shape) for shape in recipe.objects], 0
    total = sum(how.poses for some in scenes for how in some.values())

    def count() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    made: dict[str, list[Drawn]] = {"training": [], "validation": []}
    for label, some in enumerate(scenes):
        for name, how in some.items():
            parts = scenes_of([name], how, seed=recipe.schedule.seed, folder=folder, progress=count)
            for number, scene in enumerate(parts):
                side = "validation" if number % _HELD_EVERY == 1 else "training"
                made[side].append(Drawn(name, label, scene))
    return made


def example_of(scene: SceneParts, recipe: ClassifierRecipe, rng: np.random.Generator) -> np.ndarray:
    """(C, S, S) a classifier's input from a scene, mixed, masked and disturbed as drawn from `rng`."""
    gains = augmentation.drawn_gains(rng)
    if recipe.parts != "both":
        gains["specular" if recipe.parts == "edge" else "edge"] = 0.0
    hidden = bool(scene.scales["77_ghz"][SCENE_PARTS.index("sheet")] > 0)
    if hidden and rng.random() < _IN_A_BOX:
        gains["sheet"] = augmentation.amplitude(rng, *_LID_DB)
    x, y = wave_features.canvas_axis(scene.x), wave_features.canvas_axis(scene.y)
    along_x, along_y = wave_features.resampling(scene.x, x), wave_features.resampling(scene.y, y)
    images = {"77_ghz": augmentation.mixed(scene, "77_ghz", gains, rng)}
    if rng.random() >= _ONE_BAND:
        images["24_ghz"] = augmentation.mixed(scene, "24_ghz", augmentation.other_gains(gains, rng), rng)
    power = {band: wave_features.resampled_power(image, along_x, along_y) for band, image in images.items()}
    inside = along_x @ scene.inside.astype(np.float32) @ along_y.T
    if rng.random() < 0.9:
        mask = augmentation.erring_mask(
            inside > min(0.5, inside.max() / 2), power["77_ghz"].max(axis=2), rng, hidden=hidden
        )
        inside = mask.astype(np.float32)
    depths = recipe.spacing[2] * np.arange(power["77_ghz"].shape[2])
    channels = classifier_features.masked_channels(power["77_ghz"], depths, inside, power.get("24_ghz"))
    return augmentation.seen_otherwise(channels, rng)
