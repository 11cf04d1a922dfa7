"""The segmenter protocol, segmenters by name, the rule that chooses a mask, and `segment`."""

from dataclasses import replace
from typing import Any, Literal, Protocol, overload, runtime_checkable

import numpy as np

from millisight.core import (
    Registry,
    check_known,
    checked_array,
    checked_number,
    checked_record,
    put,
    record,
    seed_or_generator,
)
from millisight.core.errors import InputError
from millisight.data import Mask, Picture, Prompts, SarImage, VolumeMask
from millisight.perception import (
    HIGH_BAND,
    LOS,
    NLOS,
    RETRY,
    RETRY_COUNT,
    Condition,
    Thresholds,
    power_prompts,
    project,
    without_sheets,
)
from millisight.perception.segmentation._heights import between, without_support
from millisight.perception.segmentation._volume import extend_mask

Method = Literal["wave", "classical", "sam"]

LARGEST_SHARE = 0.2
"""As published: a mask over more of the picture than this is no object's."""
_PAPER_AREA = 0.55 * 0.60
_BACKGROUND_SHARE, _MOST_SHARE = 0.6, 0.85  # of a picture, of a mask that reaches its rim, and of one that does not
_APART = 1.5  # bands are at least so far apart, as a ratio
_CONDITIONS = {"los": LOS, "nlos": NLOS}


@record
class Candidates:
    """Masks that a segmenter offers, the best first.

    Attributes
    ----------
    masks : (K, A, B) bool, on the picture's pixels
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

    def __repr__(self) -> str:
        count, across, along = self.masks.shape
        return (
            f"Candidates({count} masks of {across} x {along} pixels, scores {self.scores[0]:g} to {self.scores[-1]:g})"
        )


@runtime_checkable
class Segmenter(Protocol):
    """What finds masks on a picture, from prompts or without.

    A class of your own needs these two attributes and this method, and nothing else of millisight but `Candidates`. To
    give it a name, add it to `SEGMENTERS`, or to the entry points "millisight.segmenters" of your package.

    Attributes
    ----------
    name : of the segmenter
    needs_prompts : whether `segment` refuses None for prompts
    """

    name: str
    needs_prompts: bool

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """Masks of the object, (K, A, B) bool as the picture's first two axes: x and y, of a photo row and column.

        Parameters
        ----------
        picture : (A, B); its `image` (X, Y, Z) and `other_band` are there for what looks at more than a picture
        prompts : points (n, 2) on the picture; None: there are none

        Raises
        ------
        InputError
            The picture or the prompts are not what it can work with.
        """
        ...


SEGMENTERS: Registry[Any] = Registry("segmenter", "millisight.segmenters", package="millisight.perception.segmentation")
"""What makes a `Segmenter`, by name: a class, or a function with the options as its arguments."""


def segmenter(name: Method | str, **options: Any) -> Segmenter:
    """The segmenter of that name: "wave", "classical", "sam", or a plug-in's.

    Parameters
    ----------
    name : in `SEGMENTERS`
    options : of the segmenter, such as `weights` of "wave", `model` and `device` of "sam"

    Raises
    ------
    UnknownNameError
        There is no such segmenter.
    InputError
        A plug-in's is no `Segmenter`.
    """
    return checked_segmenter(SEGMENTERS[name](**options))


def checked_segmenter(by: Any) -> Segmenter:
    """`by`, if it is a segmenter; else an InputError."""
    if isinstance(by, type) or not isinstance(by, Segmenter):
        raise InputError(
            f"method is of type {type(by).__name__}; expected a segmenter's name, or an object with name, "
            "needs_prompts and segment(picture, prompts)"
        )
    return by


def chosen(candidates: Candidates, *, largest: float = LARGEST_SHARE, inner: float | None = None) -> np.ndarray | None:
    """(A, B) bool, the best mask that covers no more than `largest` of the picture; None where each covers more.

    The paper's rule, for a picture as large as the paper's; `largest_share` has the number for others. A mask that
    leaves the picture's rim free may cover `inner`, where that is given.
    """
    index = _choice(candidates, largest, largest if inner is None else inner)
    return None if index is None else candidates.masks[index]


def _choice(candidates: Candidates, largest: float, inner: float) -> int | None:
    masks, shares = candidates.masks, candidates.masks.mean(axis=(1, 2))
    at_rim = masks[:, [0, -1]].any(axis=(1, 2)) | masks[:, :, [0, -1]].any(axis=(1, 2))
    fits = shares <= np.where(at_rim, checked_number(largest, name="largest", above=0), max(largest, inner))
    return int(np.argmax(fits)) if fits.any() else None


def largest_share(picture: Picture, *, inner: bool = False) -> float:
    """How much of a picture a mask may cover: what 20 % of the paper's pictures covers, 0.066 m^2, and at least 20 %.

    An image that shows only the object's surroundings is smaller than the paper's 0.55 by 0.60 m, and the object no
    smaller for it. More than 60 % of a picture is its background at any size; an `inner` mask, which leaves the
    picture's rim free, may cover 85 %. Of a photo 20 %.
    """
    grid = picture.grid_xy
    if grid is None or 1 in picture.shape:
        return LARGEST_SHARE
    area = np.prod([np.ptp(axis) * n / (n - 1) for axis, n in zip((grid.x, grid.y), picture.shape, strict=True)])
    return float(
        np.clip(LARGEST_SHARE * _PAPER_AREA / area, LARGEST_SHARE, _MOST_SHARE if inner else _BACKGROUND_SHARE)
    )


@record
class Segmented:
    """A mask found on a picture, and the prompts that led to it.

    Attributes
    ----------
    picture : Picture
    inside : (A, B) bool, the mask
    prompts : None: there were none
    score : the mask's, by the segmenter's own judgement
    """

    picture: Picture
    inside: np.ndarray
    prompts: Prompts | None
    score: float

    def __post_init__(self) -> None:
        put(self, inside=checked_array(self.inside, name="inside", shape=self.picture.shape, dtype=np.bool_))

    def __repr__(self) -> str:
        return (
            f"Segmented({self.picture!r}, {100 * self.inside.mean():.1f} % inside, {self.prompts!r}, "
            f"score {self.score:g})"
        )

    @property
    def mask(self) -> Mask:
        """The mask on the image's grid.

        Raises
        ------
        InputError
            The picture is a photo.
        """
        if self.picture.grid_xy is None:
            raise InputError("the picture is a photo, which has no grid; use `inside`")
        return Mask(grid_xy=self.picture.grid_xy, inside=self.inside)


def _check_support(picture: Picture) -> None:
    """Raise InputError where everything lies below the support: a sign or a unit was forgotten."""
    image, support = picture.image, picture.support
    if image is None or support is None or image.seen_from == "below":
        return
    if support >= image.grid.z[-1]:
        low, high = image.grid.z[[0, -1]]
        raise InputError(
            f"support is {support:.4g} m, above the whole image, whose z is {low:.4g} to {high:.4g} m; expected the "
            "height of what the object stands on"
        )


def _check_bands(image: SarImage | None, other_band: SarImage | None) -> None:
    """Refuse another band that is the same or the higher one, as far as the images tell theirs."""
    here, there = (None if one is None else one.frequency for one in (image, other_band))
    if here is not None and there is not None and there > here / _APART:
        raise InputError(
            f"the image is of {here / 1e9:.3g} GHz and other_band of {there / 1e9:.3g} GHz; expected the higher band "
            "as the image and the lower one as other_band"
        )


def find_mask(
    by: Segmenter,
    picture: Picture,
    *,
    other: Picture | None = None,
    prompts: Prompts | None = None,
    rng: int | np.random.Generator | None = None,
    condition: Condition | str = "los",
    largest: float | None = None,
    support: float | None = None,
) -> Segmented:
    """Find the object's mask on a picture, by the paper's rules.

    Prompts are drawn from power if the segmenter needs some and none are given. Masks over `largest` of the picture are
    skipped for the next best. If all are too large, prompts are drawn once more, five of each kind above 0.5 and below
    0.2 of the maximum; given prompts are not replaced.

    Parameters
    ----------
    by : Segmenter
    picture : its input
    other : the same scene at the radar's other frequency: positives are drawn where both are bright
    prompts : used as they are, instead of random ones
    rng : seed or generator for random prompts; None: draw none
    condition : "nlos" where something is known to cover the scene, else "los": "wave" then also takes off a lid that
        ends within it, and thresholds for drawing are the paper's of that condition
    largest : share of the picture; None: `largest_share`
    support : height of what the object stands on [m]: parts of the mask whose echo comes from no higher are left out,
        so that an empty stand is not taken for an object; in sight a flat one is taken off the image first, as a table
        is; None: unknown

    Raises
    ------
    InputError
        The picture is the same everywhere; prompts are needed, and there are neither prompts nor `rng`; none can be
        drawn (see `power_prompts`); every mask is too large; the other band is not the lower one; or the support lies
        above the whole image.
    UnknownNameError
        No such condition.
    """
    check_known("condition", condition, _CONDITIONS)
    _check_bands(picture.image, picture.other_band)
    if condition == "nlos":
        picture = replace(picture, covered=True)
    if support is not None:
        picture = replace(picture, support=checked_number(support, name="support", unit="m"))
        _check_support(picture)
        if picture.image is not None and not picture.covered:
            bare = without_support(picture.image, support)
            if bare is not picture.image:
                shown = project(bare)
                picture = replace(picture, image=bare, rgb=shown.rgb, power=shown.power)
    if picture.power is not None and picture.power.min() == picture.power.max() > 0:
        raise InputError("the picture is equally bright everywhere: there is nothing to segment")
    limit = largest_share(picture) if largest is None else largest
    inner = largest_share(picture, inner=True) if largest is None else largest
    generator = None if rng is None else seed_or_generator(rng)

    def draw(thresholds: Thresholds, count: int | None = None) -> Prompts:
        if generator is None:
            raise InputError(f"{by.name} needs prompts, which are drawn at random: pass rng=0, for example, or prompts")
        return power_prompts(picture, other=other, thresholds=thresholds, count=count, rng=generator)

    if prompts is not None:
        checked_record(prompts, Prompts, name="prompts")
        prompts.check_on(picture)
        attempts = [lambda: prompts]
    else:
        attempts = [(lambda: draw(_CONDITIONS[condition])) if by.needs_prompts else lambda: None]
        if generator is not None:
            attempts.append(lambda: draw(RETRY, RETRY_COUNT))
    for attempt in attempts:
        points = attempt()
        candidates = by.segment(picture, points)
        best = _choice(candidates, limit, inner)
        if best is not None:
            inside, score = candidates.masks[best], float(candidates.scores[best])
            if support is not None and picture.image is not None:
                image = without_sheets(picture.image, frequency=HIGH_BAND, covered=picture.covered)
                inside = between(inside, image, support=picture.support)
            return Segmented(picture=picture, inside=inside, prompts=points, score=score)
    advice = "pass rng=0, for example, to try prompts drawn at random" if prompts is None and generator is None else (
        "choose prompts of your own"
    )  # fmt: skip
    raise InputError(
        f"every mask covers more than {100 * limit:.0f} % of the picture, too much for an object; {advice}, or use "
        "another method"
    )


@overload
def segment(
    image: SarImage,
    *,
    other_band: SarImage | None = ...,
    method: Method | str | Segmenter = ...,
    prompts: Prompts | None = ...,
    rng: int | np.random.Generator | None = ...,
    condition: Condition | str = ...,
    support: float | None = ...,
    volume: Literal[False] = ...,
) -> Mask: ...


@overload
def segment(
    image: SarImage,
    *,
    other_band: SarImage | None = ...,
    method: Method | str | Segmenter = ...,
    prompts: Prompts | None = ...,
    rng: int | np.random.Generator | None = ...,
    condition: Condition | str = ...,
    support: float | None = ...,
    volume: Literal[True],
) -> VolumeMask: ...


def segment(
    image: SarImage,
    *,
    other_band: SarImage | None = None,
    method: Method | str | Segmenter = "wave",
    prompts: Prompts | None = None,
    rng: int | np.random.Generator | None = None,
    condition: Condition | str = "los",
    support: float | None = None,
    volume: bool = False,
) -> Mask | VolumeMask:
    """Segment the object in an image, by the rules of `find_mask` (paper section 6.1).

    Parameters
    ----------
    image : SarImage, best at 77 GHz
    other_band : the same scene at the radar's other frequency, on its own grid. Prompts are drawn where both bands are
        bright; "wave" uses both
    method : name of a segmenter, such as "wave", "classical" or "sam", or a segmenter
    prompts : used as they are; None: drawn from power, if the segmenter needs them
    rng : seed or generator for random prompts; required where prompts are drawn
    condition : "nlos" where something is known to cover the scene, else "los": "wave" then also takes off a lid that
        ends within it, and thresholds for drawing are the paper's of that condition
    support : height of what the object stands on [m]: parts of the mask whose echo comes from no higher are left out;
        None: unknown
    volume : also find the depths of the object, by `extend_mask`

    Returns
    -------
    Mask
        On the image's grid seen along z; with `volume` a VolumeMask on the image's grid.

    Raises
    ------
    InputError
        The image is blank, the bands do not overlap or no pixel is bright in both, prompts must be drawn and
        `rng` is missing, or every mask is too large.
    UnknownNameError
        Unknown method or condition.
    """
    by = segmenter(method) if isinstance(method, str) else checked_segmenter(method)
    picture = project(image, other_band=other_band)
    other = None if other_band is None else project(other_band)
    mask = find_mask(by, picture, other=other, prompts=prompts, rng=rng, condition=condition, support=support).mask
    if not volume:
        return mask
    return extend_mask(mask, without_sheets(image, frequency=HIGH_BAND, covered=condition == "nlos"))
