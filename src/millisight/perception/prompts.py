"""Prompts: points that tell a segmenter what belongs to the object and what does not, drawn from the radar's power."""

from typing import NamedTuple

import numpy as np

from millisight.errors import InputError
from millisight.perception.projection import Picture
from millisight.records import checked_array, checked_integer, checked_number, checked_record, put, record


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
        put(
            self,
            points=points,
            positive=checked_array(self.positive, name="positive", shape=(len(points),), dtype=np.bool_),
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
    """Prompts from power, as published."""
    raise NotImplementedError
