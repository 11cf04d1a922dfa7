"""Examples that classifiers learn from: a scene under a mask, and what is of no class under one."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from millisight.perception import power_levels
from millisight.perception.classification import masked_channels, sheet_was_brightest
from millisight.perception.segmentation import WaveSegmenter
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._bands import BANDS, DEPTH
from millisight.perception.training._training import TrainingScene
from millisight.perception.training._whole import WholeScene

SHIPPED = "shipped"
"""The segmenter of this package, as the one whose masks are learned from."""

_ONE_BAND = 0.3  # of the examples have no 24 GHz image
_FOUND, _ERRING = 0.6, 0.9  # of the examples have a mask of the segmenter; further ones up to 0.9 an erring one
_TOUCHED = 0.2  # least intersection over union of a found mask with the object
_BRIGHT = 10**-1.5  # of the maximum, over which a mask is drawn where nothing lies
_ASIDE = 0.05  # of a mask set aside may lie over an object
_TRIES = 20


class ClassifierExample(NamedTuple):
    """Channels (C, S, S) as float16, which is fine enough for levels, and the index of the class."""

    channels: np.ndarray
    label: int


class HeldExample(NamedTuple):
    """An example of validation.

    Attributes
    ----------
    channels : (C, S, S) as float16, of which thousands fit into memory
    label : index of the class
    shown : name of what is shown
    covered : whether the brightest of the image was a sheet's
    number : of the simulated object, which several examples show
    """

    channels: np.ndarray
    label: int
    shown: str
    covered: bool
    number: int


class FoundMasks:
    """The masks that the segmenter "wave" finds in training scenes; each is found once, and its scene is kept.

    Parameters
    ----------
    weights : of the segmenter, a file; `SHIPPED`: this package's
    """

    def __init__(self, weights: str):
        self._by = WaveSegmenter(None if weights == SHIPPED else weights)
        self.sha256: str = self._by.description["sha256"]
        self._found: dict[tuple[int, bool], tuple[WholeScene, np.ndarray]] = {}

    def of(self, scene: WholeScene, *, both: bool) -> np.ndarray:
        """(A, B) bool, whatever it is of; found in the image of 77 GHz alone, or with the other."""
        key = id(scene), both
        if key not in self._found:
            band, low = BANDS
            mask = self._by.canvas_mask(
                scene.power(band),
                scene.power(low) if both else None,
                before=power_levels(scene.raw_power(band)),
                taken_db=scene.taken_db[band],
            )
            self._found[key] = scene, mask
        return self._found[key][1]

    def __call__(self, scene: WholeScene, *, both: bool) -> np.ndarray | None:
        """(A, B) bool; None where it hardly touches the object."""
        mask, truth = self.of(scene, both=both), scene.objects > 0
        return mask if (mask & truth).sum() > _TOUCHED * (mask | truth).sum() else None


def example_of(scene: WholeScene, rng: np.random.Generator, by: FoundMasks | None = None) -> np.ndarray:
    """(C, S, S) a classifier's input from a scene, masked and disturbed as drawn from `rng`.

    The mask is that of `by`, an erring one, or the true one. Where there is no object it is what `by` finds,
    or else what is bright.
    """
    power = scene.power(BANDS[0])
    both = rng.random() >= _ONE_BAND and BANDS[1] in scene.levels
    inside = scene.objects > 0
    if not inside.any():
        found = None if by is None else by.of(scene, both=both)
        bright = power.max(axis=2)
        inside = bright > _BRIGHT * bright.max() if found is None or not found.any() else found
        return _channels(scene, augmentation.erring_mask(inside, bright, rng), rng, both=both)
    drawn = rng.random()
    found = by(scene, both=both) if by is not None and drawn < _FOUND else None
    if found is not None:
        inside = found
    elif drawn < _ERRING:
        inside = augmentation.erring_mask(inside, power.max(axis=2), rng)
    return _channels(scene, inside, rng, both=both)


def example_aside(scene: WholeScene, rng: np.random.Generator) -> np.ndarray:
    """(C, S, S) a classifier's input whose mask lies beside the object: over a floor, a lid's rest, or noise."""
    objects, mask = scene.objects > 0, scene.objects > 0
    for _ in range(_TRIES):
        corner = int(rng.integers(objects.shape[0])), int(rng.integers(objects.shape[1]))
        turned = np.rot90(objects, 2) if rng.random() < 0.5 else objects
        mask = np.roll(turned, corner, axis=(0, 1))
        if (mask & objects).sum() <= _ASIDE * mask.sum():
            break
    mask &= ~objects
    if not mask.any():  # the object fills the scene
        mask = ~objects if not objects.all() else objects
    both = rng.random() >= _ONE_BAND and BANDS[1] in scene.levels
    return _channels(scene, mask, rng, both=both)


def example_found(scene: WholeScene, by: FoundMasks, *, both: bool) -> np.ndarray | None:
    """(C, S, S) a classifier's input in the mask that `by` finds, undisturbed; None: it finds none, or lacks a band."""
    if both and BANDS[1] not in scene.levels:
        return None
    mask = by.of(scene, both=both)
    return _masked(scene, mask, both=both) if mask.any() else None


def examples_in_use(scenes: Sequence[TrainingScene], by: FoundMasks, *, views: int) -> Iterator[HeldExample]:
    """Examples as a classifier meets them in use: in whatever masks `by` finds, by one band and by both.

    Every `views` scenes show one object.
    """
    for index, one in enumerate(scenes):
        for both in (False, True):
            channels = example_found(one.whole, by, both=both)
            if channels is not None:
                yield held_example(one, channels, index // views)


def held_example(scene: TrainingScene, channels: np.ndarray, number: int) -> HeldExample:
    """An example of a scene of validation."""
    covered = sheet_was_brightest(scene.whole.taken_db[BANDS[0]])
    return HeldExample(channels.astype(np.float16), scene.label, scene.name, covered, number)


def _channels(scene: WholeScene, inside: np.ndarray, rng: np.random.Generator, *, both: bool) -> np.ndarray:
    return augmentation.seen_otherwise(_masked(scene, inside, both=both), rng)


def _masked(scene: WholeScene, inside: np.ndarray, *, both: bool) -> np.ndarray:
    power = scene.power(BANDS[0])
    other, depths = scene.power(BANDS[1]) if both else None, DEPTH * np.arange(power.shape[2])
    return masked_channels(power, depths, inside.astype(np.float32), other)


def balanced(scenes: Sequence[TrainingScene], count: int, rng: np.random.Generator) -> list[int]:
    """Indices of scenes: each class as often, and of a class each scene as often."""
    by_class: dict[int, list[int]] = {}
    for index, one in enumerate(scenes):
        by_class.setdefault(one.label, []).append(index)
    each, order = -(-count // len(by_class)), []
    for some in by_class.values():
        # One after another, in a new order each time round.
        order += [int(i) for _ in range(-(-each // len(some))) for i in rng.permutation(some)][:each]
    return [order[i] for i in rng.permutation(len(order))]
