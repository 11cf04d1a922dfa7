"""Segmenters to compare with: masks that do not look at the radar, and one level for all images."""

import numpy as np

from millisight.core import check_known, checked_number
from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.perception import HIGH_BAND, project, without_sheets
from millisight.perception.segmentation._segmentation import SEGMENTERS, Candidates

BLIND_SHAPES = ("ellipse", "disc", "box", "all")
"""The largest ellipse in the picture; a disc of 10 cm in its middle; the middle half of its width and height; all."""

_DISC = 0.10  # diameter [m]


class BlindSegmenter:
    """A mask that does not look at the picture: what it scores, everybody scores.

    Parameters
    ----------
    shape : one of `BLIND_SHAPES`

    Raises
    ------
    UnknownNameError
    """

    needs_prompts = False
    blind = True

    def __init__(self, shape: str = "ellipse"):
        check_known("blind shape", shape, BLIND_SHAPES)
        self._shape = shape
        self.name: str = f"blind {shape}"

    def segment(self, picture: Picture, prompts: Prompts | None = None) -> Candidates:
        """One mask.

        Raises
        ------
        InputError
            The picture is a photo.
        """
        grid = picture.grid_xy
        if grid is None:
            raise InputError(f"{self.name} needs a radar image, and this picture is a photo; use another method")
        # From -1 to 1 over the picture, or over the disc.
        halves = [max(np.ptp(axis) / 2, 1e-9) for axis in (grid.x, grid.y)]
        if self._shape == "disc":
            halves = [_DISC / 2] * 2
        x, y = ((axis - (axis[0] + axis[-1]) / 2) / half for axis, half in zip((grid.x, grid.y), halves, strict=True))
        if self._shape in ("ellipse", "disc"):
            mask = x[:, None] ** 2 + y**2 <= 1
        else:
            reach = 0.5 if self._shape == "box" else np.inf
            mask = (abs(x) <= reach)[:, None] & (abs(y) <= reach)
        return Candidates(masks=mask[None], scores=np.ones(1))


class ThresholdSegmenter:
    """What is brighter than one level in the projected image, sheets taken off.

    Parameters
    ----------
    level : share of the maximum of the mean of |I| along z, the same for all images. The default is best on the scenes
        that `wave` was validated on, by median F1
    """

    name = "threshold"
    needs_prompts = False

    def __init__(self, level: float = 0.2):
        self._level = checked_number(level, name="level", above=0)

    def segment(self, picture: Picture, prompts: Prompts | None = None) -> Candidates:
        """One mask.

        Raises
        ------
        InputError
            The picture is a photo.
        """
        if picture.image is None:
            raise InputError(f"{self.name} needs a radar image, and this picture is a photo; use another method")
        power = project(without_sheets(picture.image, frequency=HIGH_BAND, covered=picture.covered)).power
        mask = np.zeros(picture.shape, bool) if power is None else power > self._level
        return Candidates(masks=mask[None], scores=np.ones(1))


for _shape in BLIND_SHAPES:
    SEGMENTERS.add(f"blind {_shape}", lambda shape=_shape: BlindSegmenter(shape))
SEGMENTERS.add("threshold", ThresholdSegmenter)
