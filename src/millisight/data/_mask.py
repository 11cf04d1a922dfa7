"""Masks: which pixels of an image belong to the object."""

from typing import Any

import numpy as np

from millisight.core import checked_array, checked_record, late, put, record
from millisight.data._grid import PixelGrid


@record
class Mask:
    """The pixels of an object in an image seen along z.

    Attributes
    ----------
    grid_xy : PixelGrid
    inside : (X, Y) bool
    """

    grid_xy: PixelGrid
    inside: np.ndarray

    def __post_init__(self) -> None:
        checked_record(self.grid_xy, PixelGrid, name="grid_xy")
        put(self, inside=checked_array(self.inside, name="inside", shape=self.grid_xy.shape, dtype=np.bool_))

    def __repr__(self) -> str:
        return f"Mask({len(self.grid_xy.x)} x {len(self.grid_xy.y)} pixels, {100 * self.inside.mean():.1f} % inside)"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """`inside`, (X, Y) bool, for `numpy.asarray(mask)`; read-only unless copied."""
        return np.array(self.inside, dtype=dtype, copy=copy)

    def plot(self, **settings: Any) -> Any:
        """Plot the mask, seen along z.

        Parameters
        ----------
        settings : of `millisight.viz.plot_mask`: the `image` over which the outline is drawn, `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_mask")(self, **settings)

    def _repr_html_(self) -> str:
        return late("millisight.viz", "html_card")(self)
