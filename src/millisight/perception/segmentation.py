"""Masks, and what makes them: segmenters behind one protocol, the rule that chooses a mask, and `segment`."""

from importlib import import_module
from typing import Any, Protocol

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.imaging.grid import PixelGrid
from millisight.imaging.image import SarImage
from millisight.perception.projection import Picture, project
from millisight.perception.prompts import (
    LOS,
    NLOS,
    RETRY,
    RETRY_COUNT,
    Prompts,
    Thresholds,
    power_prompts,
    seed_or_generator,
)
from millisight.records import checked_array, checked_number, put, record

LARGEST_SHARE = 0.2
"""As published: a mask over more of the picture than this is no object's."""
_PAPER_AREA = 0.55 * 0.60
_BACKGROUND_SHARE = 0.6
_CONDITIONS = {"los": LOS, "nlos": NLOS}
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
    """(A, B) bool, the best mask that covers no more than `largest` of the picture; None where each covers more.

    The paper's rule, for a picture as large as the paper's; `largest_share` has the number for others.
    """
    index = _choice(candidates, largest)
    return None if index is None else candidates.masks[index]


def _choice(candidates: Candidates, largest: float) -> int | None:
    fits = candidates.masks.mean(axis=(1, 2)) <= checked_number(largest, name="largest", above=0)
    return int(np.argmax(fits)) if fits.any() else None


def largest_share(picture: Picture) -> float:
    """How much of a picture a mask may cover: what 20 % of the paper's pictures covers, 0.066 m^2, and at least 20 %.

    An image that shows only the object's surroundings is smaller than the paper's 0.55 by 0.60 m, and the object no
    smaller for it. More than 60 % of a picture is its background at any size. Of a photo 20 %.
    """
    if picture.grid_xy is None or 1 in picture.shape:
        return LARGEST_SHARE
    area = np.prod(
        [
            np.ptp(axis) * n / (n - 1)
            for axis, n in zip((picture.grid_xy.x, picture.grid_xy.y), picture.shape, strict=True)
        ]
    )
    return float(np.clip(LARGEST_SHARE * _PAPER_AREA / area, LARGEST_SHARE, _BACKGROUND_SHARE))


@record
class Segmented:
    """What was found on a picture, and by what.

    Attributes
    ----------
    picture : Picture
    inside : (A, B) bool, the mask
    prompts : those that led to it; None: there were none
    score : the mask's, by the segmenter's own judgement
    """

    picture: Picture
    inside: np.ndarray
    prompts: Prompts | None
    score: float

    def __post_init__(self) -> None:
        put(self, inside=checked_array(self.inside, name="inside", shape=self.picture.shape, dtype=np.bool_))

    @property
    def mask(self) -> Mask:
        """The mask on the image's grid.

        Raises
        ------
        InputError
            The picture is a photo.
        """
        if self.picture.grid_xy is None:
            raise InputError("the picture is a photo, which lies on no grid; take `inside`")
        return Mask(grid_xy=self.picture.grid_xy, inside=self.inside)


def find_mask(
    by: Segmenter,
    picture: Picture,
    *,
    other: Picture | None = None,
    prompts: Prompts | None = None,
    rng: int | np.random.Generator = 0,
    condition: str = "los",
    largest: float | None = None,
) -> Segmented:
    """The object's mask on a picture, by the paper's rules.

    Prompts are drawn from power where the segmenter needs some and none are given. Masks over `largest` of the picture
    are passed over for the next best. If all are, prompts are drawn once more, five of each kind above 0.5 and below
    0.2 of the maximum; prompts that were given are not replaced.

    Parameters
    ----------
    by : Segmenter
    picture : what it looks at
    other : the same scene at the radar's other frequency: positives are drawn where both are bright
    prompts : taken as they are, instead of drawn ones
    rng : a seed, or a generator to draw prompts from
    condition : "los" or "nlos", the thresholds for drawing
    largest : share of the picture; None: `largest_share`

    Raises
    ------
    InputError
        The picture is the same everywhere, no prompts can be drawn (see `power_prompts`), or every mask is too large.
    UnknownNameError
        No such condition.
    """
    if condition not in _CONDITIONS:
        raise UnknownNameError("condition", condition, _CONDITIONS)
    if picture.power is not None and picture.power.min() == picture.power.max() > 0:
        raise InputError("the picture is equally bright everywhere: there is nothing to segment")
    limit = largest_share(picture) if largest is None else largest
    generator = seed_or_generator(rng)

    def draw(thresholds: Thresholds, count: int | None = None) -> Prompts:
        return power_prompts(picture, other=other, thresholds=thresholds, count=count, rng=generator)

    if prompts is not None:
        prompts.check_on(picture)
        attempts = [lambda: prompts]
    else:
        first = (lambda: draw(_CONDITIONS[condition])) if by.needs_prompts else lambda: None
        attempts = [first, lambda: draw(RETRY, RETRY_COUNT)]
    for attempt in attempts:
        points = attempt()
        candidates = by.segment(picture, points)
        best = _choice(candidates, limit)
        if best is not None:
            inside, score = candidates.masks[best], float(candidates.scores[best])
            return Segmented(picture=picture, inside=inside, prompts=points, score=score)
    raise InputError(
        f"every mask covers more than {100 * limit:.0f} % of the picture, too much for an object; choose prompts "
        "of your own, or another method"
    )


def segment(
    image: SarImage,
    *,
    other_band: SarImage | None = None,
    method: str | Segmenter = "wave",
    prompts: Prompts | None = None,
    rng: int | np.random.Generator | None = None,
    condition: str = "los",
) -> Mask:
    """The mask of the object in an image, by the rules of `find_mask` (paper section 6.1).

    Parameters
    ----------
    image : SarImage, best at 77 GHz
    other_band : the same scene at the radar's other frequency, on a grid of its own. Prompts are drawn where both
        bands are bright; "wave" looks at both
    method : name of a segmenter, "wave", "classical" or "sam", or one that `segmenter` made
    prompts : taken as they are; None: drawn from power, where the segmenter needs some
    rng : a seed, or a generator to draw prompts from; None: the seed 0
    condition : "los" or "nlos", the thresholds for drawing

    Returns
    -------
    Mask
        On the image's grid seen along z.

    Raises
    ------
    InputError
        The image is blank, the bands have no place in common or are nowhere bright together, or every mask is too
        large.
    UnknownNameError
        No such method, or condition.
    """
    by = segmenter(method) if isinstance(method, str) else method
    picture = project(image, other_band=other_band)
    other = None if other_band is None else project(other_band)
    seed = 0 if rng is None else rng
    return find_mask(by, picture, other=other, prompts=prompts, rng=seed, condition=condition).mask
