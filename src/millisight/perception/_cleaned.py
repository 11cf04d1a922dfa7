"""Images without their sheets: what segmenters and classifiers look at."""

from functools import lru_cache

import numpy as np

from millisight.data import SarImage
from millisight.imaging import remove_sheets

HIGH_BAND, LOW_BAND = 79e9, 24.125e9
"""Middles of the bands that an image is taken for whose metadata do not state its own [Hz]."""


@lru_cache(maxsize=4)
def without_sheets(image: SarImage, *, frequency: float = HIGH_BAND) -> SarImage:
    """The image without lids, cloths and walls, as by `remove_sheets`; as it is where that was done before.

    The last four are kept, since segmenting and classifying look at the same image.

    Parameters
    ----------
    image : SarImage
    frequency : middle of its band [Hz]
    """
    if any(step.get("step") == "remove_sheets" for step in image.metadata.get("history", ())):
        return image
    return remove_sheets(image, frequency=frequency).result


def taken_db(cleaned: SarImage, image: SarImage) -> float:
    """The maximum of an image without its sheets over that with them [dB]; 0 where none was taken."""
    return float(20 * np.log10(max(cleaned.magnitude.max() / max(image.magnitude.max(), 1e-30), 1e-9)))
