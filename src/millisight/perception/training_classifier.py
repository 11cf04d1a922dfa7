"""Training of classifiers: network, calibration, and the weights as they ship."""

import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from millisight.files import make_folder
from millisight.perception import augmentation, classifier_features
from millisight.perception.classification import turned_all_ways
from millisight.perception.classifier_recipe import ClassifierRecipe, Drawn, example_of
from millisight.perception.networks import write_network
from millisight.perception.training import fit, one_thread
from millisight.perception.training_scenes import RANDOM

if TYPE_CHECKING:
    from torch import Tensor, nn

STEM = "classifier"
"""Of the files that training writes."""
PHYSICS = "paper's simulator: specular and edge reflections of vertices"

_BANDS = {"small": ("77_ghz", "24_ghz"), "paper": ("77_ghz",)}  # by network
_HELD_VIEWS = 3  # examples of each scene of validation
_VALIDATION_SEED, _POOL_SEED = 1 << 20, 1 << 21  # apart from any epoch's
_SMOOTHING = 0.05  # of the labels
_SURE = 0.95  # of the answers that are given should be right: on validation


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
