"""The training protocol, the same for every network: recipe, scenes, lesson, schedule, weights and their description.

A recipe names the scenes that it needs and makes a lesson of them; the lesson makes examples of scenes, and knows the
network and its loss. This module does the rest. Another network to train is one module: a recipe and a lesson.
"""

import dataclasses
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from millisight.core import Registry, make_folder
from millisight.perception import write_network
from millisight.perception.training._loop import Lesson, Schedule, fit, one_thread
from millisight.perception.training._published import read_simulation
from millisight.perception.training._scenes import SceneParts, SceneSettings, cached_scene

SIDES = ("training", "validation")

_VALIDATION_SEED = 1 << 20  # apart from any epoch's

T = TypeVar("T")


class SceneRequest(NamedTuple):
    """A scene that a recipe needs.

    Attributes
    ----------
    side : "training" or "validation"
    name : of its object in the catalogue, or of `RANDOM_OBJECTS`
    number : of the scene among those of its object, from 0 on
    label : index of its class; 0 where there are no classes
    settings : how it is made
    source : folder of simulated images that it is read from, see `read_simulation`; None: it is made
    """

    side: str
    name: str
    number: int
    label: int
    settings: SceneSettings
    source: Path | None = None


class TrainingScene(NamedTuple):
    """A scene to learn from.

    Attributes
    ----------
    name : of its object
    label : index of its class
    parts : SceneParts
    """

    name: str
    label: int
    parts: SceneParts


TrainingScenes = Mapping[str, Sequence[TrainingScene]]
"""By "training" and "validation"."""


class TrainingRecipe(Protocol):
    """How a network is trained: a record whose fields are the keys of a TOML file.

    Attributes
    ----------
    stem : of the names of the weights' files
    name, about : for the weights' description
    schedule : its seed is that of everything
    """

    @property
    def stem(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def about(self) -> str: ...
    @property
    def schedule(self) -> Schedule: ...

    def scene_requests(self) -> list[SceneRequest]:
        """The scenes that it needs, in their order."""
        ...

    def lesson(self, scenes: TrainingScenes) -> Lesson:
        """What the network learns from these scenes; under `one_thread`."""
        ...

    def summary(self, description: Mapping[str, Any]) -> str:
        """How well the trained network does, in half a line."""
        ...


RECIPES: Registry[Any] = Registry("recipe", "millisight.recipes", package="millisight.perception.training")
"""Classes of recipes, by the name of what they train; `millisight train NAME` reads one from TOML."""


class Trained(NamedTuple):
    """What `train` wrote.

    Attributes
    ----------
    weights : the ONNX file; its description lies beside it as .json, the tensors as .safetensors
    description : what the JSON holds, but the SHA-256 of the weights
    """

    weights: Path
    description: dict[str, Any]


def make_scenes(
    recipe: TrainingRecipe, folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> dict[str, list[TrainingScene]]:
    """The recipe's scenes, by "training" and "validation"; those that the folder holds already are read.

    Simulated images of a dataset that the recipe names are read from there each time.

    Parameters
    ----------
    recipe : SegmenterRecipe, ClassifierRecipe, or another TrainingRecipe
    folder : of the scenes; recipes may share it
    progress : called with (scenes made, scenes in all)

    Raises
    ------
    InputError
        Images and masks of a dataset do not fit each other.
    FileError, FormatError, DamagedFileError
    """
    folder, requests = make_folder(folder), recipe.scene_requests()
    scenes: dict[str, list[TrainingScene]] = {side: [] for side in SIDES}
    for done, (side, name, number, label, settings, source) in enumerate(requests, 1):
        if source is None:
            parts = cached_scene(name, number, settings, seed=recipe.schedule.seed, folder=folder)
        else:
            parts = read_simulation(source, widest=settings.widest)
        scenes[side].append(TrainingScene(name, label, parts))
        if progress is not None:
            progress(done, len(requests))
    return scenes


@one_thread()
def train(
    recipe: TrainingRecipe,
    scenes: TrainingScenes,
    folder: str | os.PathLike[str],
    *,
    device: str = "cpu",
    tensorboard: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Trained:
    """Train a network and write its weights into `folder`; continue an interrupted run.

    Parameters
    ----------
    recipe : SegmenterRecipe, ClassifierRecipe, or another TrainingRecipe
    scenes : of `make_scenes`
    folder : of the weights and of the checkpoint
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

    folder, lesson, plain = make_folder(folder), recipe.lesson(scenes), _plain(recipe)
    network, fitted = fit(
        lesson, schedule=recipe.schedule, folder=folder, made_of=plain, device=device, tensorboard=tensorboard,
        progress=progress,
    )  # fmt: skip
    with torch.no_grad():
        learned = lesson.describe(network)
    description = {
        "name": recipe.name,
        "about": recipe.about,
        **learned,
        "epochs": fitted.epochs,
        "best_epoch": fitted.best_epoch + 1,
        "history": [{key: round(value, 5) for key, value in entry.items()} for entry in fitted.history],
        "recipe": plain,
    }
    weights = write_network(
        folder, recipe.stem, network, torch.zeros(1, *lesson.input_shape), description,
        free=lesson.free_axes, free_out=lesson.free_output_axes,
    )  # fmt: skip
    return Trained(weights, description)


def held_back(
    scenes: TrainingScenes, example_of: Callable[[TrainingScene, np.random.Generator], T], *, views: int, seed: int
) -> list[T]:
    """Examples of the scenes of validation, `views` of each; the same in every epoch."""
    return [
        example_of(scene, np.random.default_rng([seed, _VALIDATION_SEED, index, view]))
        for index, scene in enumerate(scenes["validation"])
        for view in range(views)
    ]


def _plain(recipe: Any) -> dict[str, Any]:
    return json.loads(json.dumps(dataclasses.asdict(recipe)))
