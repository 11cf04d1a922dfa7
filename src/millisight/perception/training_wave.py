"""Training of the `wave` segmenter: recipe, scenes, network, and the weights as the package ships them."""

import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from millisight.errors import InputError
from millisight.files import make_folder
from millisight.perception.networks import write_network
from millisight.perception.training import Schedule, fit, one_thread
from millisight.perception.training_examples import Example, example_of
from millisight.perception.training_scenes import SceneParts, Scenes, scenes_of
from millisight.perception.wave_features import CHANNELS, FLOOR_DB, SPACING
from millisight.records import checked_integer, checked_record, put, record

if TYPE_CHECKING:
    from torch import Tensor, nn

STEM = "wave"
"""Of the files that training writes."""
CUTS = tuple(round(0.2 + 0.05 * i, 2) for i in range(13))
"""Probabilities at which a mask might begin; the best by mean F2 on the validation scenes is taken."""

_RECALL = 2  # beta of F2: a part of the object that is missed counts more than a rim that is not the object's

_VALIDATION_SEED = 1 << 20  # apart from any epoch's
_VIEWS = 2  # examples of each validation scene


@record
class SegmenterRecipe:
    """How a segmenter is trained: scenes, network, schedule.

    Attributes
    ----------
    name : of the weights
    about : for the weights' description
    scenes, schedule : see there; the schedule's seed is that of everything
    widths : of the network's four sizes, in channels
    batch : examples in a batch
    views : examples of each scene in an epoch
    """

    name: str = "wave"
    about: str = ""
    scenes: Scenes = field(default_factory=Scenes)
    schedule: Schedule = field(default_factory=Schedule)
    widths: tuple[int, ...] = (16, 32, 64, 96)
    batch: int = 16
    views: int = 4

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        widths = tuple(checked_integer(width, name="widths", minimum=8) for width in self.widths)
        if len(widths) != 4 or any(width % 8 for width in widths):
            raise InputError(f"widths are {list(widths)}; expected four multiples of 8")
        for side, names in self.scenes.objects.items():
            if not names:
                raise InputError(f"no object is left for {side}; name some in scenes.validation, and not all others")
        put(
            self,
            widths=widths,
            batch=checked_integer(self.batch, name="batch"),
            views=checked_integer(self.views, name="views"),
        )


class Trained(NamedTuple):
    """What `train_segmenter` wrote.

    Attributes
    ----------
    weights : the ONNX file; its description lies beside it as .json, the tensors as .safetensors
    description : what the JSON holds
    """

    weights: Path
    description: dict[str, Any]


def make_scenes(
    recipe: SegmenterRecipe, folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
) -> dict[str, list[SceneParts]]:
    """The recipe's scenes, by "training" and "validation"; those that `folder`/scenes holds already are read.

    Parameters
    ----------
    progress : called with (scenes made, scenes in all)

    Raises
    ------
    FileError, DamagedFileError
    """
    objects = recipe.scenes.objects
    total, done = recipe.scenes.poses * sum(map(len, objects.values())), 0

    def count() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    folder = make_folder(folder) / "scenes"
    return {
        side: scenes_of(names, recipe.scenes, seed=recipe.schedule.seed, folder=folder, progress=count)
        for side, names in objects.items()
    }


@one_thread()
def train_segmenter(
    recipe: SegmenterRecipe,
    scenes: Mapping[str, Sequence[SceneParts]],
    folder: str | os.PathLike[str],
    *,
    device: str = "cpu",
    tensorboard: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Trained:
    """Train the network and write its weights into `folder`; go on where an earlier run stopped.

    Parameters
    ----------
    scenes : of `make_scenes`
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

    from millisight.perception.wave_network import WaveNetwork, example

    folder, schedule = make_folder(folder), recipe.schedule
    held = [
        example_of(scene, np.random.default_rng([schedule.seed, _VALIDATION_SEED, i, view]))
        for i, scene in enumerate(scenes["validation"])
        for view in range(_VIEWS)
    ]

    def batches(epoch: int) -> "Iterator[tuple[Tensor, ...]]":
        rng = np.random.default_rng([schedule.seed, epoch])
        order = np.concatenate([rng.permutation(len(scenes["training"])) for _ in range(recipe.views)])
        for start in range(0, len(order), recipe.batch):
            examples = [example_of(scenes["training"][i], rng) for i in order[start : start + recipe.batch]]
            yield tuple(torch.from_numpy(np.stack(values)) for values in zip(*examples, strict=True))

    def score(network: "nn.Module") -> float:
        return max(_f_by_cut(network, held, 1).values())

    network, fitted = fit(
        lambda: WaveNetwork(recipe.widths), batches, _loss, score, schedule=schedule, folder=folder,
        made_of=_plain(recipe), device=device, tensorboard=tensorboard, progress=progress,
    )  # fmt: skip
    by_cut = {f"mean F{beta} by cut": _f_by_cut(network, held, beta) for beta in (1, _RECALL)}
    last = by_cut[f"mean F{_RECALL} by cut"]
    description = {
        "name": recipe.name,
        "about": recipe.about,
        "channels": list(CHANNELS),
        "spacing": SPACING,
        "floor_db": FLOOR_DB,
        "cut": max(last, key=lambda cut: (last[cut], -cut)),
        "validation": {name: {f"{c:g}": round(f, 4) for c, f in values.items()} for name, values in by_cut.items()},
        "objects": {side: list(names) for side, names in recipe.scenes.objects.items()},
        "scenes": {side: len(some) for side, some in scenes.items()},
        "epochs": fitted.epochs,
        "best_epoch": fitted.best_epoch + 1,
        "history": [{key: round(value, 5) for key, value in entry.items()} for entry in fitted.history],
        "recipe": _plain(recipe),
    }
    weights = write_network(
        folder, STEM, network, example(), description, free={2: "a", 3: "b"}, free_out={1: "a", 2: "b"}
    )
    return Trained(weights, description)


def _loss(network: "nn.Module", batch: "tuple[Tensor, ...]") -> "Tensor":
    """Cross-entropy a pixel plus 1 less the soft Dice coefficient of each example."""
    from torch.nn import functional

    channels, inside, weight = batch
    logits = network(channels)
    entropy = functional.binary_cross_entropy_with_logits(logits, inside, reduction="none")
    found = logits.sigmoid() * weight
    shared = 2 * (found * inside).sum(dim=(1, 2)) + 1
    dice = shared / (found.sum(dim=(1, 2)) + inside.sum(dim=(1, 2)) + 1)
    return (entropy * weight).sum() / weight.sum() + (1 - dice).mean()


def _f_by_cut(network: "nn.Module", examples: Sequence[Example], beta: int) -> dict[float, float]:
    """Mean F-score of the masks that begin at each of `CUTS`; recall weighs `beta` times as much as precision."""
    import torch

    device = next(network.parameters()).device
    scores = []
    with torch.no_grad():
        for start in range(0, len(examples), 16):
            some = examples[start : start + 16]
            logits = network(torch.from_numpy(np.stack([e.channels for e in some])).to(device)).cpu().numpy()
            for example, logit in zip(some, logits, strict=True):
                truth, valid = example.inside > 0.5, example.weight > 0
                scores.append([_f_score((logit > np.log(cut / (1 - cut))) & valid, truth, beta) for cut in CUTS])
    return dict(zip(CUTS, np.mean(scores, axis=0).tolist(), strict=True))


def _f_score(mask: np.ndarray, truth: np.ndarray, beta: int) -> float:
    either = mask.sum() + beta**2 * truth.sum()
    return float((1 + beta**2) * (mask & truth).sum() / either) if either else 1.0


def _plain(recipe: SegmenterRecipe) -> dict[str, Any]:
    return json.loads(json.dumps(dataclasses.asdict(recipe)))
