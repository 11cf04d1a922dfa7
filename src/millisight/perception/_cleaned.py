"""Images without their sheets: what segmenters and classifiers look at."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from millisight.core.errors import InputError
from millisight.data import SarImage
from millisight.imaging import DetectedSheet, SheetRemoval, remove_sheets

Condition = Literal["los", "nlos"]
"""Whether something is known to cover the scene ("nlos"), as a lid or a cloth does."""

HIGH_BAND, LOW_BAND = 79e9, 24.125e9
"""Middles of the bands that an image is taken for whose metadata do not state its own [Hz]."""


@lru_cache(maxsize=4)
def sheets_in(image: SarImage, *, frequency: float = HIGH_BAND, covered: bool = False) -> SheetRemoval[SarImage]:
    """The lids, cloths and walls in an image, as by `remove_sheets`; the last four are kept. See `without_sheets`.

    Where they were taken off before, those that the history tells, and the image as it is.
    """
    if _taken_before(image):
        return SheetRemoval(result=image, sheets=_told(image), left=(), reason="")
    return remove_sheets(image, frequency=image.frequency or frequency, clutter="lid" if covered else "auto")


def without_sheets(image: SarImage, *, frequency: float = HIGH_BAND, covered: bool = False) -> SarImage:
    """The image without lids, cloths and walls, as by `remove_sheets`; as it is where that was done before.

    Parameters
    ----------
    image : SarImage
    frequency : middle of its band [Hz], where its history does not tell
    covered : whether a lid is known to lie over the scene: one that ends within it is then taken off, too
    """
    if _taken_before(image):
        return image
    return sheets_in(image, frequency=frequency, covered=covered).result


def taken_db(cleaned: SarImage) -> float:
    """The maximum of an image without its sheets over that with them [dB]; 0 where none was taken.

    -inf where they were taken from the frames: an image with them was never made.
    """
    return float(sum(step.get("taken_db", -np.inf) for step in _taken_before(cleaned)))


def _taken_before(image: SarImage) -> list[Mapping[str, Any]]:
    """The steps of an image's history in which sheets were taken off it, or off its frames."""
    return [step for step in image.metadata.get("history", ()) if step.get("step") == "remove_sheets"]


def _told(image: SarImage) -> tuple[DetectedSheet, ...]:
    """The sheets of these steps; none where they cannot be read."""
    try:
        return tuple(DetectedSheet(**sheet) for step in _taken_before(image) for sheet in step.get("sheets", ()))
    except (TypeError, InputError):
        return ()
