"""Masks, and what makes them: segmenters behind one protocol, the rule that chooses a mask, and `segment`."""

from importlib import import_module
from typing import Any, Protocol

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.imaging.grid import PixelGrid
from millisight.imaging.image import SarImage
from millisight.perception.projection import Picture
from millisight.perception.prompts import Prompts
from millisight.records import checked_array, checked_number, put, record

LARGEST_SHARE = 0.2
"""As published: a mask over more of the picture than this is no object's."""
_SEGMENTERS = {
    "classical": ("classical", "ClassicalSegmenter"),
    "sam": ("sam", "SamSegmenter"),
    "wave": ("wave", "WaveSegmenter"),
}


@record
class Mask:
    """Which pixels of an image seen along z belong to the object.

    Attributes
    ----------
    grid_xy : PixelGrid
    inside : (X, Y) bool
    """

    grid_xy: PixelGrid
    inside: np.ndarray

    def __post_init__(self) -> None:
        put(self, inside=checked_array(self.inside, name="inside", shape=self.grid_xy.shape, dtype=np.bool_))


@record
class Candidates:
    """Masks that a segmenter offers, the best first.

    Attributes
    ----------
    masks : (K, A, B) bool
    scores : (K,) float64, highest first; how good the segmenter thinks they are, in a scale of its own
    """

    masks: np.ndarray
    scores: np.ndarray

    def __post_init__(self) -> None:
        masks = checked_array(self.masks, name="masks", shape=("K", "A", "B"), dtype=np.bool_)
        scores = checked_array(self.scores, name="scores", shape=(len(masks),))
        if (np.diff(scores) > 0).any():
            raise InputError(f"scores are {scores.tolist()}; expected the highest first")
        put(self, masks=masks, scores=scores)


class Segmenter(Protocol):
    """Whatever offers masks for a picture and prompts.

    Attributes
    ----------
    name : by which `segmenter` makes it
    needs_prompts : whether `segment` refuses None for prompts
    """

    name: str
    needs_prompts: bool

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """Masks of the object on the picture, (K, A, B) as its first two axes.

        Raises
        ------
        InputError
            The picture or the prompts are not what it can work with.
        """
        ...


def segmenter(name: str, **options: Any) -> Segmenter:
    """The segmenter of that name: "wave", "classical" or "sam"; loaded when it is first asked for.

    Raises
    ------
    UnknownNameError
    """
    if name not in _SEGMENTERS:
        raise UnknownNameError("segmenter", name, _SEGMENTERS)
    module, cls = _SEGMENTERS[name]
    return getattr(import_module(f"millisight.perception.{module}"), cls)(**options)


def chosen(candidates: Candidates, *, largest: float = LARGEST_SHARE) -> np.ndarray | None:
    """(A, B) bool, the best mask that covers no more than `largest` of the picture; None where each covers more."""
    limit = checked_number(largest, name="largest", above=0)
    fits = candidates.masks.mean(axis=(1, 2)) <= limit
    return candidates.masks[int(np.argmax(fits))] if fits.any() else None


def segment(
    image: SarImage,
    *,
    other_band: SarImage | None = None,
    method: str = "wave",
    prompts: Prompts | None = None,
    rng: int | np.random.Generator | None = None,
    condition: str = "los",
) -> Mask:
    """The mask of the object in an image."""
    raise NotImplementedError
