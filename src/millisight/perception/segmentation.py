"""Masks: which pixels belong to the object."""

import numpy as np

from millisight.imaging.grid import PixelGrid
from millisight.records import checked_array, put, record


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
