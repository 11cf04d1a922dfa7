"""Training of classifiers: recipe, simulated scenes, examples, network, calibration, and the weights as they ship."""

import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.files import make_folder
from millisight.perception import augmentation, classifier_features, wave_features
from millisight.perception.classification import turned_all_ways
from millisight.perception.networks import write_network
from millisight.perception.training import Schedule, fit, one_thread
from millisight.perception.training_scenes import PARTS as SCENE_PARTS
from millisight.perception.training_scenes import RANDOM, SceneParts, Scenes, scenes_of
from millisight.records import checked_integer, checked_number, checked_numbers, checked_record, put, record
from millisight.scene.objects import CATALOGUE, SHAPE_CLASSES

if TYPE_CHECKING:
    from torch import Tensor, nn

STEM = "classifier"
"""Of the files that training writes."""
PARTS = ("both", "edge", "specular")
"""Which of the simulator's answers a network is taught with; `both` is the paper's way."""
PHYSICS = "paper's simulator: specular and edge reflections of vertices"

_NETWORKS = ("small", "paper")
_BANDS = {"small": ("77_ghz", "24_ghz"), "paper": ("77_ghz",)}
_STRETCH = 0.25
_IN_A_BOX = 0.6  # of the scenes with a sheet have it as bright as a carton's lid
_LID_DB = (-18.0, 0.0)  # that is, relative to the object's maximum
_ONE_BAND = 0.3  # of the examples have no 24 GHz image
_HELD_EVERY = 6  # scene of each object is for validation
_HELD_VIEWS = 3  # examples of each of these
_VALIDATION_SEED, _POOL_SEED = 1 << 20, 1 << 21  # apart from any epoch's
_SMOOTHING = 0.05  # of the labels
_SURE = 0.95  # of the answers that are given should be right: on validation


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

    name: str = STEM
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
            if _random(shape) not in RANDOM:
                raise InputError(
                    f"drawn is {self.drawn}, and {shape!r} is none of the classes whose shapes can be drawn at random, "
                    f"{', '.join(RANDOM.values())}; name these only, or set drawn to 0"
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
            made[_random(shape)] = dataclasses.replace(every, poses=self.drawn, stretch=0.0)
        return made


def _random(shape: str) -> str:
    """What scenes of a class's random shapes are called."""
    return f"any_{shape}"


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


class Trained(NamedTuple):
    """What `train_classifier` wrote.

    Attributes
    ----------
    weights : the ONNX file; its description lies beside it as .json, the tensors as .safetensors
    description : what the JSON holds
    """

    weights: Path
    description: dict[str, Any]


@one_thread()
def train_classifier(
    recipe: ClassifierRecipe,
    examples: Mapping[str, Sequence[Drawn]],
    folder: str | os.PathLike[str],
    *,
    device: str = "cpu",
    tensorboard: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Trained:
    """Train the network, calibrate its answers and write its weights into `folder`; go on where a run stopped.

    Parameters
    ----------
    examples : of `make_examples`
    device : "cpu" or "cuda"; on the CPU one thread is used, and two runs give the same weights
    tensorboard : log to `folder`/tensorboard as well
    progress : called with (epochs done, epochs in all)

    Raises
    ------
    InputError
        The folder holds a run of another recipe.
    FileError, DamagedFileError, DeviceError, ImportError
    """
    import torch

    from millisight.perception import classifier_networks

    folder, schedule, names = make_folder(folder), recipe.schedule, list(recipe.objects)
    held = []
    for index, drawn in enumerate(examples["validation"]):
        for view in range(_HELD_VIEWS):
            rng = np.random.default_rng([schedule.seed, _VALIDATION_SEED, index, view])
            held.append((example_of(drawn.scene, recipe, rng), drawn.label))
    labels = np.array([label for _, label in held])

    pool = _pool(recipe, examples["training"])

    def batches(epoch: int) -> "Iterator[tuple[Tensor, ...]]":
        rng = np.random.default_rng([schedule.seed, epoch])
        order = rng.permutation(len(pool))
        for start in range(0, len(order) - recipe.batch + 1, recipe.batch):
            some = [pool[i] for i in order[start : start + recipe.batch]]
            laid = [augmentation.turned(np.moveaxis(one.channels, 0, 2), int(rng.integers(8))) for one in some]
            channels = np.moveaxis(np.stack(laid), 3, 1).astype(np.float32)
            yield torch.from_numpy(np.ascontiguousarray(channels)), torch.tensor([one.label for one in some])

    def score(network: "nn.Module") -> float:
        logits = _logits(network, [channels[None] for channels, _ in held])
        return -float(_surprise(logits, labels).mean())

    network, fitted = fit(
        lambda: classifier_networks.made(recipe.network, len(names)), batches, _loss, score, schedule=schedule,
        folder=folder, made_of=_plain(recipe), device=device, tensorboard=tensorboard, progress=progress,
    )  # fmt: skip
    logits = _logits(network, [turned_all_ways(channels) for channels, _ in held])
    temperature = _temperature(logits, labels)
    sides = {side: sorted({drawn.name for drawn in some} - set(RANDOM)) for side, some in examples.items()}
    description = {
        "name": recipe.name,
        "about": recipe.about,
        "physics": PHYSICS,
        "network": recipe.network,
        "parts": recipe.parts,
        "class_names": names,
        "classes": {shape: list(objects) for shape, objects in recipe.every_object.items()},
        "bands": list(_BANDS[recipe.network]),
        "channels": list(classifier_features.CHANNELS),
        "temperature": temperature,
        "threshold": _threshold(logits / temperature, labels),
        "validation": _judged(logits / temperature, labels),
        "objects": sides,
        "poses": _poses(examples),
        "scenes": {side: len(some) for side, some in examples.items()},
        "drawn": {side: sum(drawn.name in RANDOM for drawn in some) for side, some in examples.items()},
        "seed": schedule.seed,
        "epochs": fitted.epochs,
        "best_epoch": fitted.best_epoch + 1,
        "history": [{key: round(value, 5) for key, value in entry.items()} for entry in fitted.history],
        "recipe": _plain(recipe),
    }
    return Trained(write_network(folder, STEM, network, classifier_networks.example(), description), description)


class _Example(NamedTuple):
    """Channels (C, S, S) as float16, which is fine enough for levels, and the index of the class."""

    channels: np.ndarray
    label: int


def _pool(recipe: ClassifierRecipe, drawn: Sequence[Drawn]) -> list[_Example]:
    """The recipe's examples."""
    rng = np.random.default_rng([recipe.schedule.seed, _POOL_SEED])
    return [
        _Example(example_of(drawn[i].scene, recipe, rng).astype(np.float16), drawn[i].label)
        for i in _balanced(drawn, recipe.examples, rng)
    ]


def _balanced(drawn: Sequence[Drawn], count: int, rng: np.random.Generator) -> list[int]:
    """Indices of scenes, of each class as many, and of a class each scene as often."""
    by_class: dict[int, list[int]] = {}
    for index, one in enumerate(drawn):
        by_class.setdefault(one.label, []).append(index)
    each, order = -(-count // len(by_class)), []
    for scenes in by_class.values():
        # One after another, in a new order each time round.
        order += [int(i) for _ in range(-(-each // len(scenes))) for i in rng.permutation(scenes)][:each]
    return [order[i] for i in rng.permutation(len(order))]


def _loss(network: "nn.Module", batch: "tuple[Tensor, ...]") -> "Tensor":
    from torch.nn import functional

    channels, labels = batch
    return functional.cross_entropy(network(channels), labels, label_smoothing=_SMOOTHING)


def _logits(network: "nn.Module", batches: Sequence[np.ndarray]) -> np.ndarray:
    """(N, classes) float64 logits of N batches, the mean over each."""
    import torch

    device = next(network.parameters()).device
    with torch.no_grad():
        return np.stack(
            [network(torch.from_numpy(one).to(device)).mean(dim=0).double().cpu().numpy() for one in batches]
        )


def _surprise(logits: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(N,) -log of the probability of what is right."""
    shifted = logits - logits.max(axis=1, keepdims=True)
    return np.log(np.exp(shifted).sum(axis=1)) - shifted[np.arange(len(labels)), labels]


def _temperature(logits: np.ndarray, labels: np.ndarray) -> float:
    """By which logits are divided so that the mean surprise is least.

    Guo et al. 2017, "On Calibration of Modern Neural Networks".
    """
    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(
        lambda power: _surprise(logits / 2**power, labels).mean(), bounds=(-3, 5), method="bounded"
    )
    return round(float(2**found.x), 4)


def _threshold(logits: np.ndarray, labels: np.ndarray) -> float:
    """The lowest confidence from which on `_SURE` of the answers are right."""
    right, confidence = _answers(logits, labels)
    order = np.argsort(-confidence, kind="stable")
    share = np.cumsum(right[order]) / np.arange(1, len(order) + 1)
    enough = np.flatnonzero(share >= _SURE)
    return round(float(confidence[order[enough[-1]]] if len(enough) else confidence.max()), 4)


def _answers(logits: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) whether the most probable class is the right one, and its probability."""
    probabilities = np.exp(logits - logits.max(axis=1, keepdims=True))
    probabilities /= probabilities.sum(axis=1, keepdims=True)
    return logits.argmax(axis=1) == labels, probabilities.max(axis=1)


def _judged(logits: np.ndarray, labels: np.ndarray) -> dict[str, float]:
    right, confidence = _answers(logits, labels)
    figures = {
        "accuracy": right.mean(), "mean confidence": confidence.mean(), "surprise": _surprise(logits, labels).mean()
    }  # fmt: skip
    return {"examples": len(labels)} | {name: round(float(value), 4) for name, value in figures.items()}


def _poses(examples: Mapping[str, Sequence[Drawn]]) -> dict[str, list[list[float]]]:
    """How each object lay, scene after scene, in whichever part [degrees]."""
    poses: dict[str, list[list[float]]] = {}
    for some in examples.values():
        for drawn in (one for one in some if one.name not in RANDOM):
            poses.setdefault(drawn.name, []).append([round(float(angle), 2) for angle in drawn.scene.angles_deg])
    return poses


def _plain(recipe: ClassifierRecipe) -> dict[str, Any]:
    return json.loads(json.dumps(dataclasses.asdict(recipe)))
