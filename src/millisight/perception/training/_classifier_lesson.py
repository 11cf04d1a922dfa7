"""What a classifier learns from its scenes: the lesson of `ClassifierRecipe`."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.perception.classification import (
    CLASSIFIER_CHANNELS,
    CLASSIFIER_SIDE,
    novelty_of,
    views_of,
)
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._beside import Beside, read_beside, united
from millisight.perception.training._calibration import (
    answer_scores,
    best_temperature,
    best_threshold,
    calibration_of,
    cross_entropy,
    logits_of,
    novelty_scores,
    scaled,
    weights_of,
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
from millisight.perception.training._scenes import DRAWN_OBJECTS
from millisight.perception.training._training import TrainingScene, TrainingScenes, held_back, poses_of

if TYPE_CHECKING:
    from torch import Tensor, nn

PHYSICS = "paper's simulator: specular and edge reflections of vertices"
NETWORK_BANDS = {"small": ("77_ghz", "24_ghz"), "paper": ("77_ghz",)}
"""By the name of a network, what it looks at."""
EMPTY, SPARSE, ASIDE = "nothing there", "sparse scan", "mask beside the object"
"""What is of no class; the first two are names of scenes."""

_HELD_VIEWS = 3  # examples of each scene of validation
_POOL_SEED = 1 << 21  # apart from any epoch's, and from validation's
_SMOOTHING = 0.05  # of the labels
_ASIDE = 1 / 3  # of what is of no class are masks beside the object of another scene
_NO_OBJECTS = {*DRAWN_OBJECTS, EMPTY, SPARSE}


class ClassifierLesson:
    """Classes from channels, of a `ClassifierRecipe`; see `Lesson`."""

    input_shape = len(CLASSIFIER_CHANNELS), CLASSIFIER_SIDE, CLASSIFIER_SIDE
    free_axes, free_output_axes = {}, {}

    def __init__(self, recipe: Any, scenes: TrainingScenes):
        self.recipe: Any = recipe
        self.scenes, self.seed = scenes, recipe.schedule.seed
        by = FoundMasks(recipe.masks) if recipe.masks else None
        self.masks_of: str | None = None if by is None else by.sha256
        self.classes: int = len(recipe.objects)
        self.beside: list[Beside] = [read_beside(path, list(recipe.objects), recipe.network) for path in recipe.beside]
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
                    example_aside(one.whole, rng).astype(np.float16), self.classes, ASIDE, False, number[id(one)]
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

        recipe = self.recipe
        return classifier_network(
            recipe.network, self.classes + (recipe.novel > 0), recipe.normalisation, recipe.members, self.beside
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
        logits = logits_of(network, (one.channels[None] for one in self.held))
        return -float(cross_entropy(logits, np.array([one.label for one in self.held])).mean())

    def describe(self, network: "nn.Module") -> dict[str, Any]:
        """Classes, calibration, and what `evaluation` needs to know of the scenes to find leaks."""
        recipe, scenes = self.recipe, self.scenes
        every = logits_of(network, (views_of(one.channels) for one in self.used))
        labels, covered, numbers = (
            np.array([getattr(one, name) for one in self.used]) for name in ("label", "covered", "number")
        )
        known = labels < self.classes
        novelty = novelty_scores(novelty_of(every), [one.shown for one in self.used], known) if recipe.novel else None
        logits, labels, covered, numbers = every[known, : self.classes], labels[known], covered[known], numbers[known]
        prior = recipe.shares
        temperature, weights = best_temperature(logits, labels, prior), weights_of(labels, prior)
        answers = scaled(logits, temperature, prior)
        return {
            "physics": PHYSICS,
            "network": recipe.network,
            "members": recipe.members,
            "beside": [one.description["sha256"] for one in self.beside],
            "parts": recipe.parts,
            "class_names": list(recipe.objects),
            "classes": {shape: list(objects) for shape, objects in recipe.every_object.items()},
            "never_sure": [shape for shape, objects in recipe.objects.items() if not objects],
            "bands": list(NETWORK_BANDS[recipe.network]),
            "masks": self.masks_of,
            "channels": list(CLASSIFIER_CHANNELS),
            "temperature": temperature,
            "threshold": best_threshold(answers, labels, numbers, weights),
            "calibration": calibration_of(logits, labels, covered, numbers, prior),
            "validation": answer_scores(answers, labels, weights),
            **({} if prior is None else {"prior": dict(zip(recipe.objects, prior.round(6).tolist(), strict=True))}),
            **({} if novelty is None else {"novelty": novelty}),
            "objects": united(
                {side: sorted({one.name for one in some} - _NO_OBJECTS) for side, some in scenes.items()},
                [one.description["objects"] for one in self.beside],
            ),
            "poses": united(poses_of(scenes, but=_NO_OBJECTS), [one.description["poses"] for one in self.beside]),
            "scenes": {side: len(some) for side, some in scenes.items()},
            "drawn": {side: sum(one.name in DRAWN_OBJECTS for one in some) for side, some in scenes.items()},
            "novel": {side: sum(one.label == self.classes for one in some) for side, some in scenes.items()},
            "seed": self.seed,
        }
