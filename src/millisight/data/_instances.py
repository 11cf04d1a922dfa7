"""Instances: which pixels of an image belong to which of several objects."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from millisight.core import checked_array, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._grid import PixelGrid
from millisight.data._mask import Mask


@record
class Instances:
    """The objects in an image seen along z, one mask for each; they do not overlap.

    Its length is their number; iteration goes through their masks, and `instances[0]` is the first's.

    Attributes
    ----------
    grid_xy : PixelGrid
    labels : (X, Y) int32, the number of the object from 1 to K, and 0 beside all
    scores : (K,) float64, how clearly each stands out, in a scale of the method's own; highest first
    """

    grid_xy: PixelGrid
    labels: np.ndarray
    scores: np.ndarray

    def __post_init__(self) -> None:
        grid_xy = checked_record(self.grid_xy, PixelGrid, name="grid_xy")
        labels = checked_array(self.labels, name="labels", shape=grid_xy.shape, dtype=np.int32)
        found = np.unique(labels[labels != 0])
        scores = checked_array(self.scores, name="scores", shape=(len(found),))
        if not np.array_equal(found, np.arange(1, len(found) + 1)):
            raise InputError(f"labels are {found.tolist()}; expected 0 and every number from 1 to the last")
        if (np.diff(scores) > 0).any():
            raise InputError(f"scores are {scores.tolist()}; expected the highest first")
        put(self, labels=labels, scores=scores)

    def __repr__(self) -> str:
        x, y = self.grid_xy.shape
        return f"Instances({len(self)} on {x} x {y} pixels, {100 * (self.labels > 0).mean():.1f} % inside)"

    def __len__(self) -> int:
        return len(self.scores)

    def __iter__(self) -> Iterator[Mask]:
        return iter(self.masks)

    def __getitem__(self, index: int) -> Mask:
        return self.masks[index]

    @property
    def masks(self) -> tuple[Mask, ...]:
        """One for each object."""
        return tuple(Mask(grid_xy=self.grid_xy, inside=self.labels == number + 1) for number in range(len(self)))

    @property
    def mask(self) -> Mask:
        """Of all objects together."""
        return Mask(grid_xy=self.grid_xy, inside=self.labels > 0)

    def plot(self, **settings: Any) -> Any:
        """Plot the objects in colours, seen along z.

        Parameters
        ----------
        settings : of `millisight.viz.plot_instances`: the `image` below with its `dynamic_range_db` and `colormap`,
            `forms`, `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_instances")(self, **settings)
