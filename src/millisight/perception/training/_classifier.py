"""Training of classifiers: the recipe, and the lesson."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.core import check_known, checked_integer, checked_number, checked_record, printable, put, record
from millisight.core.errors import InputError, UnknownNameError
from millisight.meshes import CATALOGUE, NO_SHAPE_CLASS, ODD, PAPER_CLASSES, PUBLISHED_CLASSES, object_name
from millisight.perception.classification import (
    CLASSIFIER_CHANNELS,
    CLASSIFIER_SIDE,
    novelty_of,
    square_symmetries,
)
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._calibration import (
    answer_scores,
    best_temperature,
    best_threshold,
    calibration_of,
    cross_entropy,
    logits_of,
    novelty_scores,
)
from millisight.perception.training._classifier_examples import (
    ClassifierExample,
    FoundMasks,
    HeldExample,
    balanced,
    example_aside,
    example_of,
    examples_in_use,
    held_example,
)
from millisight.perception.training._loop import Schedule
from millisight.perception.training._scenes import RANDOM_OBJECTS, SceneSettings
from millisight.perception.training._sources import check_classes, meshes_in, simulations_in
from millisight.perception.training._training import (
    NORMALISATIONS,
    RECIPES,
    SceneRequest,
    TrainingScene,
    TrainingScenes,
    held_back,
    poses_of,
)
from millisight.perception.training._whole import ECHOES, WholeSettings

if TYPE_CHECKING:
    from torch import Tensor, nn

PHYSICS = "paper's simulator: specular and edge reflections of vertices"

_BANDS = {"small": ("77_ghz", "24_ghz"), "paper": ("77_ghz",)}  # by network
_RANDOM = {shape: name for name, shape in RANDOM_OBJECTS.items()}  # names of scenes of a class's random shapes
_STRETCH = 0.25
_HELD_EVERY = 6  # scene of each object is for validation
_HELD_VIEWS = 3  # examples of each scene of validation
_POOL_SEED = 1 << 21  # apart from any epoch's, and from validation's
_SMOOTHING = 0.05  # of the labels
_ASIDE = 1 / 3  # of what is of no class are masks beside the object of another scene
_SPARSE = 1500, 1000, 500, 250  # positions over an object: two to five times too few at 77 GHz
EMPTY, SPARSE, ASIDE = "nothing there", "sparse scan", "mask beside the object"
"""What is of no class; the first two are names of scenes."""
_NO_OBJECTS = {*RANDOM_OBJECTS, EMPTY, SPARSE}


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
    odd : of the class "other" besides, scenes of odd shapes drawn at random, every sixth for validation
    judged : of each class besides, scenes of shapes drawn at random that are for validation only, and of odd shapes as
        many: what the thresholds come from
    vertices, positions, widest, meshes, published : of the scenes, see SceneSettings; `classes` may name meshes of the
        folder, and objects of the dataset, of whose simulated images every sixth of a class is for validation
    stretch : of the scenes of each class, see SceneSettings; 0.25 of those that are not named
    parts : "both", "edge" or "specular"
    network : "small", or the "paper"'s
    batch : examples in a batch
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
    odd: int = 0
    judged: int = 0
    vertices: int = 3000
    positions: int = 6000
    widest: float = 0.32
    meshes: str = ""
    published: str = ""
    stretch: Mapping[str, float] = field(default_factory=dict)
    parts: str = "both"
    network: str = "small"
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
        for kind, value, known in (("parts", self.parts, ECHOES), ("network", self.network, _BANDS)):
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
            odd=checked_integer(self.odd, name="odd", minimum=0),
            judged=checked_integer(self.judged, name="judged", minimum=0),
            stretch={
                str(shape): checked_number(value, name=f"stretch of {shape}", minimum=0)
                for shape, value in self.stretch.items()
            },
            batch=checked_integer(self.batch, name="batch"),
            examples=checked_integer(self.examples, name="examples", minimum=self.batch),
            novel=checked_integer(self.novel, name="novel", minimum=0),
            whole=dataclasses.replace(self.whole, empty=0.0, several=0.0, parts=self.parts),
        )
        check_classes(self.objects, self.drawn)
        for shape in self.objects if self.drawn else ():
            if shape not in PUBLISHED_CLASSES:
                raise InputError(
                    f"drawn is {self.drawn}, and {shape!r} is none of the classes whose shapes can be drawn at random, "
                    f"{', '.join(PUBLISHED_CLASSES)}; name these only, or set drawn to 0"
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
        return [*map(_side, range(poses)), *["validation"] * (self.judged if name in RANDOM_OBJECTS else 0)]

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

    def lesson(self, scenes: TrainingScenes) -> "ClassifierLesson":
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


class ClassifierLesson:
    """Classes from channels; see `Lesson`."""

    input_shape = len(CLASSIFIER_CHANNELS), CLASSIFIER_SIDE, CLASSIFIER_SIDE
    free_axes, free_output_axes = {}, {}

    def __init__(self, recipe: ClassifierRecipe, scenes: TrainingScenes):
        self.recipe, self.scenes, self.seed = recipe, scenes, recipe.schedule.seed
        by = FoundMasks(recipe.masks) if recipe.masks else None
        self.masks_of: str | None = None if by is None else by.sha256
        self.classes: int = len(recipe.objects)
        views, held = recipe.whole.views, scenes["validation"]
        number = {id(one): index // views for index, one in enumerate(held)}  # of the object; a scene is one view
        self.held: list[HeldExample] = held_back(
            scenes,
            lambda one, rng: held_example(one, example_of(one.whole, rng, by), number[id(one)]),
            views=_HELD_VIEWS,
            seed=self.seed,
        )
        if recipe.novel:
            self.held += held_back(
                {"validation": [one for one in held if one.label < self.classes]},
                lambda one, rng: HeldExample(
                    example_aside(one.whole, rng), self.classes, ASIDE, False, number[id(one)]
                ),
                views=1,
                seed=self.seed,
            )
        self.used: list[HeldExample] = self.held if by is None else list(examples_in_use(held, by, views=views))
        self._by: FoundMasks | None = by
        self._pool: list[ClassifierExample] | None = None

    def pool(self, epoch: int) -> list[ClassifierExample]:
        """The examples of an epoch, before they are turned."""
        if self._pool is None or self.recipe.renewed:
            seed = [self.seed, _POOL_SEED, epoch] if self.recipe.renewed else [self.seed, _POOL_SEED]
            rng, some = np.random.default_rng(seed), self.scenes["training"]
            self._pool = [
                ClassifierExample(self._example(some[i], some, rng, self._by).astype(np.float16), some[i].label)
                for i in balanced(some, self.recipe.examples, rng)
            ]
        return self._pool

    def _example(
        self, one: TrainingScene, others: Sequence[TrainingScene], rng: np.random.Generator, by: FoundMasks | None
    ) -> np.ndarray:
        """Of a scene; in place of some of those of no class, a mask beside the object of another scene."""
        if one.label < self.classes or rng.random() >= _ASIDE:
            return example_of(one.whole, rng, by)
        while one.label == self.classes:
            one = others[int(rng.integers(len(others)))]
        return example_aside(one.whole, rng)

    def network(self) -> "nn.Module":
        """The recipe's."""
        from millisight.perception.training.networks import classifier_network

        return classifier_network(
            self.recipe.network, self.classes + (self.recipe.novel > 0), self.recipe.normalisation
        )

    def batches(self, epoch: int) -> "Iterator[tuple[Tensor, ...]]":
        """Channels and labels: every example of the epoch once, turned or mirrored; whole batches only."""
        import torch

        rng, size = np.random.default_rng([self.seed, epoch]), self.recipe.batch
        pool = self.pool(epoch)
        order = rng.permutation(len(pool))
        for start in range(0, len(order) - size + 1, size):
            some = [pool[i] for i in order[start : start + size]]
            turned = [augmentation.turned(np.moveaxis(one.channels, 0, 2), int(rng.integers(8))) for one in some]
            channels = np.moveaxis(np.stack(turned), 3, 1).astype(np.float32)
            yield torch.from_numpy(np.ascontiguousarray(channels)), torch.tensor([one.label for one in some])

    def loss(self, network: "nn.Module", batch: "tuple[Tensor, ...]") -> "Tensor":
        """Cross-entropy with smoothed labels."""
        from torch.nn import functional

        channels, labels = batch
        return functional.cross_entropy(network(channels), labels, label_smoothing=_SMOOTHING)

    def score(self, network: "nn.Module") -> float:
        """Less the mean cross-entropy."""
        logits = logits_of(network, [one.channels[None] for one in self.held])
        return -float(cross_entropy(logits, np.array([one.label for one in self.held])).mean())

    def describe(self, network: "nn.Module") -> dict[str, Any]:
        """Classes, calibration, and what `evaluation` needs to know of the scenes to find leaks."""
        recipe, scenes = self.recipe, self.scenes
        every = logits_of(network, [square_symmetries(one.channels) for one in self.used])
        labels, covered, numbers = (
            np.array([getattr(one, name) for one in self.used]) for name in ("label", "covered", "number")
        )
        known = labels < self.classes
        novelty = novelty_scores(novelty_of(every), [one.shown for one in self.used], known) if recipe.novel else None
        logits, labels, covered, numbers = every[known, : self.classes], labels[known], covered[known], numbers[known]
        temperature = best_temperature(logits, labels)
        return {
            "physics": PHYSICS,
            "network": recipe.network,
            "parts": recipe.parts,
            "class_names": list(recipe.objects),
            "classes": {shape: list(objects) for shape, objects in recipe.every_object.items()},
            "never_sure": [shape for shape, objects in recipe.objects.items() if not objects],
            "bands": list(_BANDS[recipe.network]),
            "masks": self.masks_of,
            "channels": list(CLASSIFIER_CHANNELS),
            "temperature": temperature,
            "threshold": best_threshold(logits / temperature, labels, numbers),
            "calibration": calibration_of(logits, labels, covered, numbers),
            "validation": answer_scores(logits / temperature, labels),
            **({} if novelty is None else {"novelty": novelty}),
            "objects": {side: sorted({one.name for one in some} - _NO_OBJECTS) for side, some in scenes.items()},
            "poses": poses_of(scenes, but=_NO_OBJECTS),
            "scenes": {side: len(some) for side, some in scenes.items()},
            "drawn": {side: sum(one.name in RANDOM_OBJECTS for one in some) for side, some in scenes.items()},
            "novel": {side: sum(one.label == self.classes for one in some) for side, some in scenes.items()},
            "seed": self.seed,
        }
