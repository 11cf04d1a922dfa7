"""Prompts drawn at random from a picture's power: on the object where it is bright, beside it where it is dark."""

from typing import NamedTuple

import numpy as np

from millisight.core import checked_integer, checked_number, checked_numbers, checked_record, seed_or_generator
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Picture, Prompts
from millisight.perception._projection import power_on


class Thresholds(NamedTuple):
    """Shares of a picture's maximum: what lies above `positive` is on the object, what lies below `negative` is not."""

    positive: float
    negative: float


LOS = Thresholds(0.4, 0.02)
NLOS = Thresholds(0.4, 0.05)
RETRY = Thresholds(0.5, 0.2)
RETRY_COUNT = 5
"""As published: in line of sight, out of it, and for the one retry, with 5 points of each kind."""
SHARE = 0.005
"""As published: share of the bright pixels, and of the dark ones, that is drawn."""
DEPTH_COUNT = 20
"""Points of each kind that are drawn from a depth; the paper names no number."""


def power_prompts(
    picture: Picture,
    *,
    other: Picture | None = None,
    thresholds: Thresholds = LOS,
    share: float = SHARE,
    count: int | None = None,
    rng: int | np.random.Generator,
) -> Prompts:
    """Draw random prompts from bright and from dark pixels of a picture, as published.

    Parameters
    ----------
    picture : of a radar image
    other : the same scene at the radar's other frequency: positives must be bright in both. Its power is interpolated
        to the picture's grid, and is 0 outside its own area
    thresholds : LOS, NLOS or RETRY, or others: shares of each picture's maximum
    share : share of the bright and of the dark pixels to draw; at least one of each
    count : number of points of each kind, instead of `share`; all pixels if there are fewer
    rng : seed or generator; None is an error

    Returns
    -------
    Prompts
        Positives, then negatives; no negatives where no pixel is dark enough.

    Raises
    ------
    InputError
        The picture is a photo or blank, the two pictures share no pixel, or none is bright enough in both.
    """
    thresholds = _checked_thresholds(thresholds)
    power = _power(picture)
    bright = power > thresholds.positive
    if other is not None:
        bright &= power_on(checked_record(other, Picture, name="other"), picture) > thresholds.positive
        if not bright.any():
            raise InputError(
                f"no pixel is above {thresholds.positive:g} of the maximum in both bands; use lower thresholds, or "
                "leave the other band out"
            )
    share = min(checked_number(share, name="share", above=0), 1.0)
    wanted = None if count is None else checked_integer(count, name="count", minimum=1)
    return _drawn(bright, power < thresholds.negative, share if wanted is None else wanted, rng)


def depth_prompts(
    frame: CameraFrame, *, farthest: float, count: int = DEPTH_COUNT, rng: int | np.random.Generator
) -> Prompts:
    """Prompts drawn at random from what is near in a photo, and from what is not (paper section 5.1).

    What lies nearer than the background is taken for the object. Behind cardboard it is the cardboard, and this
    baseline fails, as it should.

    Parameters
    ----------
    frame : the photo with depth
    farthest : depth up to which it is the object; beyond, it is the background [m]
    count : points of each kind, or as many as there are
    rng : a seed, or a generator to draw from

    Returns
    -------
    Prompts
        Positives, then negatives, [row, column]; pixels without a depth are neither.

    Raises
    ------
    InputError
        Nothing is as near as that.
    """
    checked_record(frame, CameraFrame, name="frame")
    farthest = checked_number(farthest, name="farthest", unit="m", above=0)
    wanted = checked_integer(count, name="count")
    depth = np.nan_to_num(frame.depth * frame.depth_unit)
    near = (depth > 0) & (depth <= farthest)
    if not near.any():
        least = f"{depth[depth > 0].min():.3g} m is the nearest" if depth.any() else "the picture has no depth"
        raise InputError(f"nothing in the picture is nearer than {farthest:.3g} m: {least}; is the object in view?")
    return _drawn(near, depth > farthest, wanted, rng)


def _checked_thresholds(thresholds: Thresholds) -> Thresholds:
    positive, negative = checked_numbers(thresholds, name="thresholds", count=2, minimum=0)
    if not negative <= positive < 1:
        raise InputError(
            f"thresholds are {positive:g} and {negative:g}; expected shares of the maximum under 1, the one for "
            "positives first and not below the other"
        )
    return Thresholds(positive, negative)


def _power(picture: Picture) -> np.ndarray:
    power = checked_record(picture, Picture, name="picture").power
    if power is None:
        raise InputError("picture is a photo, which has no radar power; pass prompts of your own")
    if not power.any():
        raise InputError("picture is blank: its image is 0 everywhere, and there is nothing to segment")
    return power


def _drawn(on: np.ndarray, beside: np.ndarray, wanted: float, rng: int | np.random.Generator) -> Prompts:
    """Positives drawn from `on`, then negatives from `beside`: a share of each, or with an int a number."""
    generator, drawn = seed_or_generator(rng), []
    for candidates in map(np.argwhere, (on, beside)):
        number = wanted if isinstance(wanted, int) else max(1, round(wanted * len(candidates)))
        drawn.append(candidates[generator.permutation(len(candidates))[:number]])
    points = np.concatenate(drawn)
    return Prompts(points=points, positive=np.arange(len(points)) < len(drawn[0]))
