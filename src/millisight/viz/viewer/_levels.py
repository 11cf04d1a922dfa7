"""An image as it is looked at: levels in dB on a grid, the strongest voxels, slices and slabs of them."""

from typing import Any, NamedTuple

import numpy as np

from millisight.core import check_shape, checked_array, checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.data import SarImage, VoxelGrid
from millisight.imaging import combine
from millisight.viz import borders
from millisight.viz.viewer._clip import kept_voxels

FLOOR_DB = -60.0
"""Nothing weaker is shown, under an image's own maximum [dB]."""

MOST_VOXELS = 32_000_000
"""Kept of an image; larger ones are looked at in blocks of voxels, each as its strongest."""

_SLAB_VOXELS = 4_000_000  # read at a time
_MOST_PIXELS = 512  # of a slice, along each side
_MOST_SLAB_PIXELS = 256


class Cloud(NamedTuple):
    """Voxels above a threshold, the strongest first."""

    points: np.ndarray  # (n, 3) float32 centres [m]
    db: np.ndarray  # (n,) float32, under the image's own maximum
    above: int  # how many voxels are above the threshold, of which n are here


@record
class Levels:
    """|I| in dB under its maximum."""

    grid: VoxelGrid
    db: np.ndarray  # (X, Y, Z) float32, from `FLOOR_DB` to 0
    peak: float  # the maximum of |I|, 0 for an empty image
    block: tuple[int, int, int] = (1, 1, 1)  # voxels of the image along x, y, z of which a level is the strongest

    def __post_init__(self) -> None:
        checked_record(self.grid, VoxelGrid, name="grid")
        put(
            self,
            db=checked_array(self.db, name="db", shape=self.grid.shape, dtype=np.float32, unit="dB"),
            peak=checked_number(self.peak, name="peak", minimum=0),
        )

    def strongest(self, threshold_db: float, most: int, limits: np.ndarray | None = None) -> Cloud:
        """At most `most` voxels of at least `threshold_db` under the maximum, within `limits` (2, 3) [m]."""
        kept = np.s_[:, :, :] if limits is None else kept_voxels(self.grid, limits)
        flat = self.db[kept].reshape(-1)
        chosen = np.flatnonzero(flat >= threshold_db)
        above = len(chosen) if self.peak > 0 else 0
        chosen = chosen[:above]
        if above > most:
            weakest = np.partition(flat[chosen], above - most)[above - most]
            stronger = chosen[flat[chosen] > weakest]
            equal = chosen[flat[chosen] == weakest]
            chosen = np.concatenate([stronger, equal[: most - len(stronger)]])
        chosen = chosen[np.argsort(-flat[chosen], kind="stable")]
        axes = [axis[part] for axis, part in zip((self.grid.x, self.grid.y, self.grid.z), kept, strict=True)]
        index = np.unravel_index(chosen, [len(axis) for axis in axes])
        points = np.stack([axis[i] for axis, i in zip(axes, index, strict=True)], axis=-1)
        return Cloud(points.astype(np.float32), flat[chosen], above)

    def slice(self, axis: int, at: float) -> tuple[np.ndarray, float]:
        """The plane across `axis` nearest to `at` [m], as `_picture` makes it, and where it is [m]."""
        coordinates = (self.grid.x, self.grid.y, self.grid.z)[axis]
        nearest = int(np.abs(coordinates - at).argmin())
        return self._picture(self.db.take(nearest, axis=axis), axis, _MOST_PIXELS), float(coordinates[nearest])

    def slabs(self, axis: int, most: int, limits: np.ndarray | None = None) -> list[tuple[np.ndarray, float]]:
        """The image in at most `most` slabs across `axis`: the strongest in each, as a picture, and its middle [m].

        Of `limits` (2, 3) [m] those along `axis` leave slices out.
        """
        kept = slice(None) if limits is None else kept_voxels(self.grid, limits)[axis]
        coordinates = (self.grid.x, self.grid.y, self.grid.z)[axis][kept]
        thick = max(1, -(-len(coordinates) // most))
        parts = [slice(start, start + thick) for start in range(0, len(coordinates), thick)]
        views = np.moveaxis(self.db, axis, 0)[kept]
        return [
            (self._picture(views[part].max(axis=0), axis, _MOST_SLAB_PIXELS), float(coordinates[part].mean()))
            for part in parts
        ]

    def _picture(self, plane: np.ndarray, axis: int, most: int) -> np.ndarray:
        """A plane (U, V) across `axis` as (rows, columns): rows along v, columns along u, pixels of one size.

        Where the grid's spacings differ, a pixel shows the voxel in which its centre lies; of more than `most` voxels
        the strongest of each few.
        """
        for side, i in enumerate(j for j in range(3) if j != axis):
            coordinates = (self.grid.x, self.grid.y, self.grid.z)[i]
            few = -(-len(coordinates) // most)
            starts = np.arange(0, len(coordinates), few)
            pixels = np.maximum.reduceat(plane, starts, axis=side) if few > 1 else plane
            plane = pixels.take(_even_pixels(coordinates[starts]), side)
        return plane.T


def _even_pixels(coordinates: np.ndarray) -> np.ndarray:
    """Of as many evenly spaced places as there are coordinates, in which of their cells each lies."""
    edges = borders(coordinates, 1e-3)
    places = edges[0] + (np.arange(len(coordinates)) + 0.5) * (edges[-1] - edges[0]) / len(coordinates)
    return np.clip(np.searchsorted(edges, places) - 1, 0, len(coordinates) - 1)


def levels_of(
    grid: VoxelGrid,
    values: Any,
    *,
    most: int = MOST_VOXELS,
) -> Levels:
    """The levels of complex `values` (X, Y, Z), an array or a dataset on disk, which is read in slabs along x.

    Where there are more voxels than `most`, the strongest of each block of voxels stands for it.
    """
    check_shape(tuple(values.shape), name="values", shape=grid.shape)
    block = _block(grid.shape, most)
    strongest = np.empty([-(-n // b) for n, b in zip(grid.shape, block, strict=True)], dtype=np.float32)
    rows = block[0] * max(1, _SLAB_VOXELS // (block[0] * grid.shape[1] * grid.shape[2]))
    for start in range(0, grid.shape[0], rows):
        slab = np.abs(values[start : start + rows])
        for axis, b in enumerate(block):
            if b > 1:
                slab = np.maximum.reduceat(slab, np.arange(0, slab.shape[axis], b), axis=axis)
        strongest[start // block[0] : start // block[0] + len(slab)] = slab
    peak = float(strongest.max())
    if not np.isfinite(peak):
        raise InputError("values hold NaN or infinite numbers; remove or mend them")
    axes = [
        np.add.reduceat(a, np.arange(0, len(a), b)) / np.diff(np.r_[np.arange(0, len(a), b), len(a)])
        for a, b in zip((grid.x, grid.y, grid.z), block, strict=True)
    ]
    shown = grid if block == (1, 1, 1) else VoxelGrid(x=axes[0], y=axes[1], z=axes[2])
    return Levels(grid=shown, db=_in_db(strongest, peak), peak=peak, block=block)


def _in_db(magnitude: np.ndarray, peak: float) -> np.ndarray:
    """The magnitudes turned into dB under the peak, in their own memory."""
    if peak > 0:
        magnitude /= np.float32(peak)
    np.maximum(magnitude, np.float32(10 ** (FLOOR_DB / 20)), out=magnitude)
    np.log10(magnitude, out=magnitude)
    magnitude *= 20
    np.maximum(magnitude, FLOOR_DB, out=magnitude)
    magnitude.flags.writeable = False  # so that the record takes it as it is
    return magnitude


def _block(shape: tuple[int, int, int], most: int) -> tuple[int, int, int]:
    """Voxels along each axis of a block, so that at most `most` blocks fill `shape`: the longest side is cut first."""
    block = [1, 1, 1]
    while np.prod([-(-n // b) for n, b in zip(shape, block, strict=True)]) > most:
        block[int(np.argmax([n / b for n, b in zip(shape, block, strict=True)]))] += 1
    return block[0], block[1], block[2]


def mixed_levels(specular: SarImage, edge: SarImage, share: float) -> Levels:
    """The levels of both images together, (1 - share) specular + share edge (paper Eq. 8)."""
    both = combine(specular, edge, (1 - share, share))
    return levels_of(both.grid, both.values)
