# Callers without types are checked, too.
# pyright: reportUnnecessaryIsInstance=false
"""Prompts: points on a picture, on the object or beside it."""

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from millisight.core import checked_array, put, record
from millisight.core.errors import InputError
from millisight.data._picture import Picture


@record
class Prompts:
    """Points on a picture, for a segmenter.

    Attributes
    ----------
    points : (n, 2) int64, indices [i, j] into the picture's first two axes: of a radar image x and y, of a photo row
        and column
    positive : (n,) bool, whether a point lies on the object (else beside it)
    """

    points: np.ndarray
    positive: np.ndarray

    def __post_init__(self) -> None:
        points = checked_array(self.points, name="points", shape=("n", 2), dtype=np.int64)
        if points.min() < 0:
            raise InputError(f"points have the index {points.min()}; expected pixel indices from 0")
        positive = checked_array(self.positive, name="positive", shape=(len(points),), dtype=np.bool_)
        inside, outside = ({(int(i), int(j)) for i, j in points[which]} for which in (positive, ~positive))
        both = inside & outside
        if both:
            raise InputError(
                f"the point {list(min(both))} is both positive and negative; expected each to lie on the object or "
                "beside it: remove one of the two"
            )
        put(self, points=points, positive=positive)

    def __repr__(self) -> str:
        return f"Prompts({int(self.positive.sum())} positive, {int((~self.positive).sum())} negative)"

    @classmethod
    def from_plain(cls, value: Mapping[str, Any]) -> "Prompts":
        """Prompts of plain lists, as JSON holds them: {"points": [[i, j], ...], "positive": [true, ...]}.

        Raises
        ------
        InputError
        """
        if not isinstance(value, Mapping) or set(value) != {"points", "positive"}:
            keys = ", ".join(map(str, value)) if isinstance(value, Mapping) else type(value).__name__
            raise InputError(f"prompts hold {keys}; expected the keys points, pairs of indices, and positive, booleans")
        positive: Any = value["positive"]
        if not isinstance(positive, list) or not all(isinstance(one, bool) for one in cast(list[Any], positive)):
            raise InputError("prompts' positive must be a list of true and false, one for each point")
        return cls(points=value["points"], positive=np.array(positive, dtype=bool))

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
