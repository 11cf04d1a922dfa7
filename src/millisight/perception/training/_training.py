"""The training protocol, the same for every network: recipe, scenes, lesson, schedule, weights and their description.

A recipe names the scenes that it needs and makes a lesson of them; the lesson makes examples of scenes, and knows the
network and its loss. This module does the rest. Another network to train is one module: a recipe and a lesson.
"""

import dataclasses
import json
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from millisight.core import Registry, checked_integer, default_workers, each, make_folder, on_threads
from millisight.perception import round_weights, write_network
from millisight.perception.training._loop import Lesson, Schedule, fit, one_thread
from millisight.perception.training._published import read_simulation, simulation_digest
from millisight.perception.training._scenes import SceneParts, SceneSettings, cached_scene, scene_digest
from millisight.perception.training._sheets import SheetParts, cached_sheet
from millisight.perception.training._whole import WholeScene, WholeSettings, cached_whole_scene

SIDES = ("training", "validation")
NORMALISATIONS = "group", "batch"
"""Of a network's channels: over each image, or over a batch."""

_VALIDATION_SEED = 1 << 20  # apart from any epoch's

T = TypeVar("T")


class SceneRequest(NamedTuple):
    """A simulated object that a recipe needs, of which `WholeSettings.views` whole scenes are made.

    Attributes
    ----------
    side : "training" or "validation"
    name : of its object in the catalogue, or of `DRAWN_OBJECTS`
    number : among those of its object, from 0 on
    label : index of its class; 0 where there are no classes
    settings : how it is simulated
    source : folder of simulated images that it is read from, see `read_simulation`; None: it is made
    shown : name of the object that is simulated, where `name` is not its own; None: it is
    whole : how its whole scenes are made; None: as the recipe's
    """

    side: str
    name: str
    number: int
    label: int
    settings: SceneSettings
    source: Path | None = None
    shown: str | None = None
    whole: WholeSettings | None = None


class TrainingScene(NamedTuple):
    """A scene to learn from.

    Attributes
    ----------
    name : of its object; of several, the first
    label : index of its class
    angles_deg : (3,) how that object lies
    whole : WholeScene
    """

    name: str
    label: int
    angles_deg: np.ndarray
    whole: WholeScene


TrainingScenes = Mapping[str, Sequence[TrainingScene]]
"""By "training" and "validation"."""


class TrainingRecipe(Protocol):
    """How a network is trained: a record whose fields are the keys of a TOML file.

    Attributes
    ----------
    stem : of the names of the weights' files
    name, about : for the weights' description
    schedule : its seed is that of everything
    whole : how whole scenes are made
    """

    @property
    def stem(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def about(self) -> str: ...
    @property
    def schedule(self) -> Schedule: ...
    @property
    def whole(self) -> WholeSettings: ...

    def scene_requests(self) -> list[SceneRequest]:
        """The simulated objects that it needs, in their order."""
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
    recipe: TrainingRecipe,
    folder: str | os.PathLike[str],
    *,
    workers: int | None = 1,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, list[TrainingScene]]:
    """The recipe's scenes, by "training" and "validation"; those that the folder holds already are read.

    Simulated images of a dataset that the recipe names are read from there each time.

    Parameters
    ----------
    recipe : SegmenterRecipe, ClassifierRecipe, or another TrainingRecipe
    folder : of the scenes; recipes may share it
    workers : number of processes, which make the same scenes; None: one per core, eight at most
    progress : called with (scenes made, scenes in all)

    Raises
    ------
    InputError
        Images and masks of a dataset do not fit each other; `workers` is no whole number from 1 on.
    FileError, FormatError, DamagedFileError
    """
    folder, requests, views = make_folder(folder), recipe.scene_requests(), recipe.whole.views
    workers = default_workers() if workers is None else checked_integer(workers, name="workers")
    make = partial(_scenes_of, recipe, {side: [one for one in requests if one.side == side] for side in SIDES}, folder)
    if workers > 1:
        make = partial(on_threads, make, max(1, default_workers() // workers))
    found: dict[int, list[TrainingScene]] = {}
    with closing(each(make, requests, workers=workers)) as outcomes:
        for number, made, failure in outcomes:
            # What failed is done again, here, where its error is raised as it is.
            found[number] = make(requests[number]) if failure else made
            if progress is not None:
                progress(views * len(found), views * len(requests))
    scenes: dict[str, list[TrainingScene]] = {side: [] for side in SIDES}
    for number, request in enumerate(requests):
        scenes[request.side] += found[number]
    return scenes


def _scenes_of(
    recipe: TrainingRecipe, by_side: Mapping[str, Sequence[SceneRequest]], folder: Path, request: SceneRequest
) -> list[TrainingScene]:
    """The whole scenes of one request."""
    maker = _Maker(recipe, request, by_side[request.side], folder)
    return [
        TrainingScene(request.name, request.label, maker.angles_deg, maker.scene(view))
        for view in range(recipe.whole.views)
    ]


class _Maker:
    """Makes the whole scenes of one request."""

    def __init__(self, recipe: TrainingRecipe, request: SceneRequest, others: Sequence[SceneRequest], folder: Path):
        self._whole, self._seed, self._folder = request.whole or recipe.whole, recipe.schedule.seed, folder
        self._request, self._others = request, others
        self._own = self._simulated(request)
        self.angles_deg: np.ndarray = self._own.angles_deg

    def scene(self, view: int) -> WholeScene:
        """The scene of that number among the request's."""
        name, number = self._request.name, self._request.number
        key = f"{self._request.side}/{name}/{number}/{view}/{self._digest(self._request)}"
        return cached_whole_scene(
            key, self._whole, self._parts, seed=[self._seed], folder=self._folder, among=self._among
        )

    @cached_property
    def _among(self) -> str:
        """What other objects of a scene are drawn from, where there may be any."""
        others = self._others if self._whole.several else ()
        return ";".join(f"{one.name}/{one.number}/{self._digest(one)}" for one in others)

    def _parts(self, rng: np.random.Generator) -> tuple[list[SceneParts], list[Callable[[], SheetParts]]]:
        """Of the request's side: its object, perhaps one or two others; two sheets and a stand, made when needed."""
        more = int(rng.integers(1, 3)) if rng.random() < self._whole.several else 0
        drawn = [self._others[int(i)] for i in rng.integers(0, len(self._others), more)]
        if not self._whole.sheets:
            return [self._own, *map(self._simulated, drawn)], []
        # Every fourth sheet is for validation.
        wanted = self._request.side == "validation"
        numbers = [i for i in range(self._whole.sheets) if (i % 4 == 3) == wanted] or list(range(self._whole.sheets))
        kept = partial(cached_sheet, seed=self._seed, folder=self._folder)
        sheets: list[Callable[[], SheetParts]] = [
            *(partial(kept, int(i)) for i in rng.choice(numbers, 2)),
            partial(kept, int(rng.choice(numbers)), kind="stand"),
        ]
        return [self._own, *map(self._simulated, drawn)], sheets

    def _digest(self, one: SceneRequest) -> str:
        if one.source is None:
            return scene_digest(one.shown or one.name, one.settings, self._seed)
        return simulation_digest(one.source, widest=one.settings.widest)

    def _simulated(self, one: SceneRequest) -> SceneParts:
        if one.source is not None:
            return read_simulation(one.source, widest=one.settings.widest)
        return cached_scene(one.shown or one.name, one.number, one.settings, seed=self._seed, folder=self._folder)


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
    round_weights(network)
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


def poses_of(scenes: TrainingScenes, *, but: Collection[str]) -> dict[str, list[list[float]]]:
    """How each object lay, scene after scene, in training and validation [degrees]; but for what has these names."""
    poses: dict[str, list[list[float]]] = {}
    for some in scenes.values():
        for scene in (one for one in some if one.name not in but):
            poses.setdefault(scene.name, []).append([round(float(angle), 2) for angle in scene.angles_deg])
    return poses


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
