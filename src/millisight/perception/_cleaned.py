"""Images without their sheets: what segmenters and classifiers look at."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from millisight.data import SarImage
from millisight.imaging import SheetRemoval, remove_sheets, sheets_told

Condition = Literal["los", "nlos"]
"""Whether something is known to cover the scene ("nlos"), as a lid or a cloth does."""

HIGH_BAND, LOW_BAND = 79e9, 24.125e9
"""Middles of the bands that an image is taken for whose metadata do not state its own [Hz]."""


@lru_cache(maxsize=4)
def sheets_in(image: SarImage, *, frequency: float = HIGH_BAND, covered: bool = False) -> SheetRemoval[SarImage]:
    """The lids, cloths and walls in an image, as by `remove_sheets`; the last four are kept. See `without_sheets`."""
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


def lids_taken_before(image: SarImage) -> SheetRemoval[SarImage]:
    """The known lids that were taken off an image, or off its frames, before, as its history tells.

    What was found in frames is known where the poses are. Where it reaches their border it goes on: it counts as
    everywhere.
    """
    step = next(iter(_taken_before(image)), {})
    lids = sheets_told(image.metadata, clutter="lid")
    if "taken_db" not in step:  # off the frames
        x, y = image.grid.x, image.grid.y
        ends = {"lower": (float(x[0]), float(y[0])), "upper": (float(x[-1]), float(y[-1]))}
        lids = tuple(replace(lid, **ends, corners=()) if lid.border > 0 else lid for lid in lids)
    return SheetRemoval(result=image, sheets=lids, left=(), reason="")
