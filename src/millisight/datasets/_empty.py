"""The empty scene taken off published 24 GHz images, as the published evaluation does."""

import numpy as np

from millisight.core import with_step
from millisight.data import SarImage, VoxelGrid

_SAME = 1e-6  # coordinates nearer than this are the same [m]


def subtract_published_empty(image: SarImage, empty: SarImage) -> SarImage:
    """|image| - |empty| where both are, as published: real, and negative where the empty scene is brighter.

    Both are trimmed to the coordinates that they share. Where they share none along an axis, as over two supports, they
    are trimmed to one number of voxels, as published: the first ones go along z, the last ones along x and y.
    """
    cuts = [_common(getattr(image.grid, name), getattr(empty.grid, name), name) for name in "xyz"]
    of_image, of_empty = (np.ix_(*(pair[i] for pair in cuts)) for i in (0, 1))
    axes = {name: getattr(image.grid, name)[pair[0]] for name, pair in zip("xyz", cuts, strict=True)}
    difference = image.magnitude[of_image] - empty.magnitude[of_empty]
    return SarImage(
        grid=VoxelGrid(**axes),
        values=difference.astype(image.values.dtype),
        metadata=with_step(image.metadata, "subtract_published_empty", empty=dict(empty.metadata)),
    )


def _common(one: np.ndarray, other: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices along one axis of two images, (n,) each: of the coordinates that they share."""
    nearest = np.abs(one[:, None] - other).argmin(axis=1)
    shared = np.flatnonzero(np.abs(one - other[nearest]) < _SAME)
    if len(shared):
        return shared, nearest[shared]
    count = min(len(one), len(other))
    kept = slice(-count, None) if name == "z" else slice(count)
    return np.arange(len(one))[kept], np.arange(len(other))[kept]
