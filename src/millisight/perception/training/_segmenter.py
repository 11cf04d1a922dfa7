"""Training of the segmenter "wave": its recipe, and examples from scenes.

An example is cut out of a whole scene, turned, disturbed, prompted; some lack a band.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from millisight.core import check_known, checked_integer, checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.meshes import PUBLISHED_CLASSES
from millisight.perception import FLOOR_DB, SPACING, power_levels
from millisight.perception.segmentation import WAVE_CHANNELS, WAVE_SIDE, WAVE_SLICES, presence, wave_input
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._loop import Schedule, run
from millisight.perception.training._scenes import RANDOM_OBJECTS, SceneSettings
from millisight.perception.training._sources import simulations_in
from millisight.perception.training._training import (
    NORMALISATIONS,
    RECIPES,
    SIDES,
    SceneRequest,
    TrainingScene,
    TrainingScenes,
    held_back,
)
from millisight.perception.training._whole import WholeScene, WholeSettings

if TYPE_CHECKING:
    from torch import Tensor, nn

CUTS = tuple(round(0.1 + 0.05 * i, 2) for i in range(15))
"""Probabilities at which a mask might begin; the best by mean F2 on the validation scenes is taken."""
_RECALL = 2  # beta of F2: a part of the object that is missed counts more than a rim that is not the object's
_MISSED = 0.01  # of the objects may be taken for nothing
_VIEWS = 1  # examples of each validation scene
_HELD_EVERY = 6  # random shape of each class is for validation
_AT_ONCE = 16  # examples that are judged together
_ONE_BAND, _OTHER_ALONE = 0.35, 0.12  # shares of examples: 77 GHz without 24, 24 without 77
_PROMPTED = 0.35
_POINT_SHARE = 0.0125  # of pixels, prompts by power: as published of pixels two and a half times as many
_CLOSEST = 2  # pixels beside an object, in examples that show little around it
_OTHER = WAVE_CHANNELS.index("other")


@RECIPES.add("segmenter")
@record
class SegmenterRecipe:
    """How the segmenter "wave" is trained: scenes, network, schedule.

    Attributes
    ----------
    name : of the weights
    about : for the weights' description
    scenes, whole, schedule : see there; the schedule's seed is that of everything
    drawn : of each class of `PUBLISHED_CLASSES`, simulated shapes drawn at random, every sixth for validation
    odd : simulated odd shapes drawn at random besides, every sixth for validation
    widths : of the network's four sizes, in channels
    normalisation : of the network, "group" or "batch"; see `WaveNetwork`
    batch : examples in a batch
    views : examples of each whole scene in an epoch
    close : share of the examples that show little around the objects, as simulated images do
    """

    stem = "wave"

    name: str = "wave"
    about: str = ""
    scenes: SceneSettings = field(default_factory=SceneSettings)
    whole: WholeSettings = field(default_factory=WholeSettings)
    schedule: Schedule = field(default_factory=Schedule)
    drawn: int = 0
    odd: int = 0
    widths: tuple[int, ...] = (16, 32, 64, 96)
    normalisation: str = "group"
    batch: int = 16
    views: int = 1
    close: float = 0.0

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        check_known("normalisation", self.normalisation, NORMALISATIONS)
        widths = tuple(checked_integer(width, name="widths", minimum=8) for width in self.widths)
        if len(widths) != 4 or any(width % 8 for width in widths):
            raise InputError(f"widths are {list(widths)}; expected four multiples of 8")
        close = checked_number(self.close, name="close", minimum=0)
        if close > 1:
            raise InputError(f"close is {close:g}; expected a share, from 0 to 1")
        for side, names in self.scenes.objects.items():
            if not names:
                raise InputError(f"no object is left for {side}; list some, but not all, in scenes.validation")
        put(
            self,
            widths=widths,
            drawn=checked_integer(self.drawn, name="drawn", minimum=0),
            odd=checked_integer(self.odd, name="odd", minimum=0),
            batch=checked_integer(self.batch, name="batch"),
            views=checked_integer(self.views, name="views"),
            close=close,
        )

    def scene_requests(self) -> list[SceneRequest]:
        """All scenes of the objects to train with, then those of the objects to validate with."""
        drawn, made = dataclasses.replace(self.scenes, stretch=0.0), self.scenes.made
        read = simulations_in(self.scenes.published)
        return [
            SceneRequest(side, name, number, 0, self.scenes, source)
            for side in SIDES
            for name in self.scenes.objects[side]
            for number, source in enumerate(
                (*((None,) * self.scenes.poses if name in made else ()), *read.get(name, ()))
            )
        ] + [
            SceneRequest(SIDES[number % _HELD_EVERY == 1], name, number, 0, drawn)
            for name, shape in RANDOM_OBJECTS.items()
            for number in range(self.drawn if shape in PUBLISHED_CLASSES else self.odd)
        ]

    def lesson(self, scenes: TrainingScenes) -> "SegmenterLesson":
        """Masks of the objects of these scenes."""
        return SegmenterLesson(self, scenes)

    def summary(self, description: Mapping[str, Any]) -> str:
        """F1 on the validation scenes."""
        return f"F1 on the validation scenes {max(description['validation']['mean F1 by cut'].values()):.3f}"


class SegmenterLesson:
    """Masks from channels; see `Lesson`."""

    input_shape = len(WAVE_CHANNELS), WAVE_SIDE, WAVE_SIDE
    free_axes, free_output_axes = {2: "a", 3: "b"}, {1: "a", 2: "b"}

    def __init__(self, recipe: SegmenterRecipe, scenes: TrainingScenes):
        self.recipe, self.scenes, self.seed = recipe, scenes, recipe.schedule.seed
        self.held = held_back(scenes, self._example_of, views=_VIEWS, seed=self.seed)

    def network(self) -> "nn.Module":
        """With the recipe's widths and normalisation."""
        import torch

        from millisight.perception.training.networks import WaveNetwork

        # A pixel's channels beside each other in memory: its convolutions are a quarter faster on a CPU.
        network = WaveNetwork(self.recipe.widths, self.recipe.normalisation)
        return network.to(memory_format=torch.channels_last)  # ty: ignore[no-matching-overload]

    def batches(self, epoch: int) -> "Iterator[tuple[Tensor, ...]]":
        """Channels, share of each pixel inside, weights; of each scene the recipe's number of views."""
        import torch

        rng, scenes = np.random.default_rng([self.seed, epoch]), self.scenes["training"]
        order = np.concatenate([rng.permutation(len(scenes)) for _ in range(self.recipe.views)])
        for start in range(0, len(order), self.recipe.batch):
            examples = [self._example_of(scenes[i], rng) for i in order[start : start + self.recipe.batch]]
            yield tuple(torch.from_numpy(np.stack(values)) for values in zip(*examples, strict=True))

    def _example_of(self, scene: TrainingScene, rng: np.random.Generator) -> "SegmenterExample":
        return example_of(scene.whole, rng, close=self.recipe.close)

    def loss(self, network: "nn.Module", batch: "tuple[Tensor, ...]") -> "Tensor":
        """Cross-entropy a pixel plus 1 less the soft Dice coefficient of each example."""
        from torch.nn import functional

        channels, inside, weight = batch
        logits = network(channels)
        entropy = functional.binary_cross_entropy_with_logits(logits, inside, reduction="none")
        found = logits.sigmoid() * weight
        shared = 2 * (found * inside).sum(dim=(1, 2)) + 1
        dice = shared / (found.sum(dim=(1, 2)) + inside.sum(dim=(1, 2)) + 1)
        return (entropy * weight).sum() / weight.sum() + (1 - dice).mean()

    def score(self, network: "nn.Module") -> float:
        """Mean F1 at the best cut."""
        return max(self._f_by_cut(network, 1).values())

    def describe(self, network: "nn.Module") -> dict[str, Any]:
        """The cut, and the scores that chose it."""
        by_cut = {f"mean F{beta} by cut": self._f_by_cut(network, beta) for beta in (1, _RECALL)}
        last = by_cut[f"mean F{_RECALL} by cut"]
        cut = max(last, key=lambda cut: (last[cut], -cut))
        least, refused = self._refused(network, cut)
        return {
            "channels": list(WAVE_CHANNELS),
            "spacing": SPACING,
            "floor_db": FLOOR_DB,
            "cut": cut,
            "least": least,
            "validation": {name: {f"{c:g}": round(f, 4) for c, f in values.items()} for name, values in by_cut.items()}
            | refused,
            "objects": {side: list(names) for side, names in self.recipe.scenes.objects.items()},
            "scenes": {side: len(some) for side, some in self.scenes.items()},
        }

    def _f_by_cut(self, network: "nn.Module", beta: int) -> dict[float, float]:
        """Mean F-score of the masks that begin at each of `CUTS`, of the scenes that are not empty; see `_RECALL`."""
        scores = []
        for example, logit in self._judged(network):
            truth, valid = example.inside > 0.5, example.weight > 0
            if truth.any():
                scores.append([_f_score((logit > np.log(cut / (1 - cut))) & valid, truth, beta) for cut in CUTS])
        return dict(zip(CUTS, np.mean(scores, axis=0).tolist(), strict=True))

    def _refused(self, network: "nn.Module", cut: float) -> tuple[float, dict[str, float]]:
        """The `presence` below which nothing is found, and in how many scenes that is so."""
        from scipy.special import expit

        found: dict[bool, list[float]] = {True: [], False: []}
        for example, logit in self._judged(network):
            inner = logit[example.weight > 0]
            found[bool((example.inside > 0.5).any())].append(presence(expit(inner)))
        empty, full = np.array(found[False]), np.array(found[True])
        least = round(max(cut, float(np.quantile(full, _MISSED))), 4) if len(empty) else cut
        refused = round(float((empty < least).mean()), 4) if len(empty) else 0.0
        return least, {
            "empty scenes": len(empty),
            "empty scenes refused": refused,
            "other scenes refused": round(float((full < least).mean()), 4),
        }

    def _judged(self, network: "nn.Module") -> "Iterator[tuple[SegmenterExample, np.ndarray]]":
        """The examples of validation with their logits."""
        for start in range(0, len(self.held), _AT_ONCE):
            some = self.held[start : start + _AT_ONCE]
            logits = run(network, np.stack([example.channels for example in some])).cpu().numpy()
            yield from zip(some, logits, strict=True)


def _f_score(mask: np.ndarray, truth: np.ndarray, beta: int) -> float:
    return float((1 + beta**2) * (mask & truth).sum() / (mask.sum() + beta**2 * truth.sum()))


class SegmenterExample(NamedTuple):
    """One input of the network, and what it should find."""

    channels: np.ndarray  # (C, 64, 64) float32, as `WAVE_CHANNELS`
    inside: np.ndarray  # (64, 64) float32, share of each pixel over which the object lies
    weight: np.ndarray  # (64, 64) float32, 1 where there is an image, else 0


def example_of(scene: WholeScene, rng: np.random.Generator, *, close: float = 0.0) -> SegmenterExample:
    """An example of a scene, drawn from `rng`; with the probability `close` it shows little around the objects."""
    alone, single = rng.random() < _OTHER_ALONE, "24_ghz" not in scene.levels
    alone = alone and not single
    band = "24_ghz" if alone else "77_ghz"
    other = None if alone or rng.random() < _ONE_BAND or single else scene.power("24_ghz")
    near = close > 0 and rng.random() < close and scene.objects.any()
    window = _close_window(scene.objects > 0, rng) if near else tuple(_window(n, rng) for n in scene.objects.shape)
    way = int(rng.integers(8))

    def seen(values: np.ndarray) -> np.ndarray:
        return augmentation.turned(values[window], way)

    power, inside = seen(scene.power(band)), seen(scene.objects > 0)
    power = power[:, :, _depths(power.shape[2], rng)]
    before = power_levels(seen(scene.raw_power(band)))
    channels = wave_input(
        power, None if other is None else seen(other), _prompts(power, inside, rng), before=before,
        taken_db=scene.taken_db[band],
    )  # fmt: skip
    channels[: 1 + WAVE_SLICES] = augmentation.distorted(channels[: 1 + WAVE_SLICES], rng)
    if other is not None:
        channels[_OTHER] = augmentation.distorted(channels[_OTHER][None], rng)[0]
    return _placed(channels, inside.astype(np.float32), rng)


def _window(size: int, rng: np.random.Generator) -> slice:
    """A part of an axis, at most `WAVE_SIDE` pixels long."""
    low, high = (int(rng.integers(0, 4)) if rng.random() < 0.4 else 0 for _ in range(2))
    length = min(size - low - high, WAVE_SIDE)
    start = low + int(rng.integers(0, size - low - high - length + 1))
    return slice(start, start + length)


def _close_window(inside: np.ndarray, rng: np.random.Generator) -> tuple[slice, ...]:
    """Of both axes of a mask (A, B) the part that shows it and up to 4 cm beside it, at most `WAVE_SIDE` long."""
    parts = []
    for axis, size in enumerate(inside.shape):
        lit = np.flatnonzero(inside.any(axis=1 - axis))
        low, high = rng.integers(_CLOSEST, round(0.04 / SPACING) + 1, 2)
        start, stop = max(int(lit[0] - low), 0), min(int(lit[-1] + high) + 1, size)
        parts.append(slice(start, min(stop, start + WAVE_SIDE)))
    return tuple(parts)


def _depths(count: int, rng: np.random.Generator) -> slice:
    """Of an image's voxels along z, those that are left."""
    low, high = rng.integers(0, 2, 2) if count > 5 else (0, 0)
    return slice(int(low), count - int(high))


def _prompts(power: np.ndarray, inside: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positive and negative points (n, 2): most often none, else a user's clicks, which are right, or from power."""
    none = np.zeros((0, 2), int)
    if rng.random() > _PROMPTED:
        return none, none
    if rng.random() < 0.5:
        return _drawn(inside, int(rng.integers(0, 5)), rng), _drawn(~inside, int(rng.integers(0, 5)), rng)
    seen = np.sqrt(power).mean(axis=2)
    seen = seen / max(seen.max(), 1e-12)
    bright, dark = seen > 0.4, seen < rng.choice([0.02, 0.05])
    counts = [max(1, round(_POINT_SHARE * where.sum())) for where in (bright, dark)]
    return _drawn(bright, counts[0], rng), _drawn(dark, counts[1], rng)


def _drawn(where: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    candidates = np.argwhere(where)
    return candidates[rng.permutation(len(candidates))[:count]]


def _placed(channels: np.ndarray, inside: np.ndarray, rng: np.random.Generator) -> SegmenterExample:
    """The example on pixels of `WAVE_SIDE`, 0 where it has no image."""
    across, along = inside.shape
    a, b = (
        int(rng.integers(0, (WAVE_SIDE - size) // 8 + 1)) * 8 if rng.random() < 0.3 else 0 for size in (across, along)
    )
    held = np.zeros((len(channels), WAVE_SIDE, WAVE_SIDE), np.float32)
    held[:, a : a + across, b : b + along] = channels[:, :across, :along]
    truth, weight = np.zeros((2, WAVE_SIDE, WAVE_SIDE), np.float32)
    truth[a : a + across, b : b + along] = inside
    weight[a : a + across, b : b + along] = 1
    return SegmenterExample(held, truth, weight)
