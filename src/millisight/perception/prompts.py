"""Prompts: points that tell a segmenter what belongs to the object and what does not, drawn from the radar's power."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from millisight.errors import InputError
from millisight.perception.projection import Picture, power_on
from millisight.records import (
    checked_array,
    checked_integer,
    checked_number,
    checked_numbers,
    checked_record,
    put,
    record,
)


class Thresholds(NamedTuple):
    """Shares of a picture's maximum: what lies above `positive` is on the object, what lies below `negative` is not."""

    positive: float
    negative: float


LOS = Thresholds(0.4, 0.02)
NLOS = Thresholds(0.4, 0.05)
RETRY = Thresholds(0.5, 0.2)
RETRY_COUNT = 5
"""As published: in line of sight, out of it, and for the one retry, with so many points of each kind."""
SHARE = 0.005
"""As published: how many of the pixels that could be are drawn."""


@record
class Prompts:
    """Points on a picture.

    Attributes
    ----------
    points : (n, 2) int64, indices [i, j] into the picture's first two axes: of a radar image x and y, of a photo row
        and column
    positive : (n,) bool, whether a point lies on the object; else it lies beside it
    """

    points: np.ndarray
    positive: np.ndarray

    def __post_init__(self) -> None:
        points = checked_array(self.points, name="points", shape=("n", 2), dtype=np.int64)
        if points.min() < 0:
            raise InputError(f"points go down to {points.min()}; expected indices of pixels, from 0 on")
        positive = checked_array(self.positive, name="positive", shape=(len(points),), dtype=np.bool_)
        both = set(map(tuple, points[positive].tolist())) & set(map(tuple, points[~positive].tolist()))
        if both:
            raise InputError(
                f"the point {list(min(both))} is both positive and negative; expected each to lie on the object or "
                "beside it: drop one of the two"
            )
        put(self, points=points, positive=positive)

    @classmethod
    def from_plain(cls, value: Mapping[str, Any]) -> "Prompts":
        """Prompts of plain lists, as JSON holds them: {"points": [[i, j], ...], "positive": [true, ...]}.

        Raises
        ------
        InputError
        """
        if not isinstance(value, Mapping) or set(value) != {"points", "positive"}:
            told = ", ".join(map(str, value)) if isinstance(value, Mapping) else type(value).__name__
            raise InputError(
                f"prompts hold {told}; expected points, pairs of indices, and positive, true or false each"
            )
        if not isinstance(value["positive"], list) or not all(isinstance(one, bool) for one in value["positive"]):
            raise InputError("prompts' positive must be a list of true and false, one for each point")
        return cls(points=value["points"], positive=np.array(value["positive"], dtype=bool))

    @property
    def plain(self) -> dict[str, Any]:
        """What `from_plain` reads."""
        return {"points": self.points.tolist(), "positive": self.positive.tolist()}

    def check_on(self, picture: Picture) -> None:
        """Refuse points that are not on the picture.

        Raises
        ------
        InputError
        """
        outside = (self.points >= picture.shape).any(axis=1)
        if outside.any():
            raise InputError(
                f"prompts have the point {self.points[outside][0].tolist()}, and the picture has "
                f"{picture.shape[0]} x {picture.shape[1]} pixels; expected indices below these"
            )


def power_prompts(
    picture: Picture,
    *,
    other: Picture | None = None,
    thresholds: Thresholds = LOS,
    share: float = SHARE,
    count: int | None = None,
    rng: int | np.random.Generator,
) -> Prompts:
    """Prompts drawn at random from where a picture is bright and from where it is dark, as published.

    Parameters
    ----------
    picture : of a radar image
    other : the same scene at the radar's other frequency: positives must be bright in both. Its power is interpolated
        to the picture's grid, and is 0 where its own does not reach
    thresholds : LOS, NLOS or RETRY, or others: shares of each picture's maximum
    share : so many of the pixels that could be are drawn, of each kind; at least one
    count : so many points of each kind instead, or all where there are fewer
    rng : a seed, or a generator to draw from

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
    generator = seed_or_generator(rng)
    drawn = [_draw(where, share, count, generator) for where in (bright, power < thresholds.negative)]
    points = np.concatenate(drawn)
    return Prompts(points=points, positive=np.arange(len(points)) < len(drawn[0]))


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


def _draw(where: np.ndarray, share: float, count: int | None, generator: np.random.Generator) -> np.ndarray:
    """(n, 2) of the pixels that are true, without repeats, in the order in which they were drawn."""
    candidates = np.argwhere(where)
    share = checked_number(share, name="share", above=0)
    wanted = (
        max(1, round(share * len(candidates))) if count is None else checked_integer(count, name="count", minimum=1)
    )
    return candidates[generator.permutation(len(candidates))[:wanted]]


def seed_or_generator(rng: int | np.random.Generator) -> np.random.Generator:
    """A generator of the seed `rng`, or `rng` itself.

    Raises
    ------
    InputError
        It is neither.
    """
    if isinstance(rng, np.random.Generator):
        return rng
    if isinstance(rng, bool) or not isinstance(rng, int | np.integer) or rng < 0:
        raise InputError(f"rng is {rng!r}; expected a seed, a whole number from 0 on, or a numpy Generator")
    return np.random.default_rng(int(rng))
