"""Surfaces cut into patches so small that a wave's phase is linear on each, and patches gathered into clusters.

A flat triangle with a linear phase has its integral in closed form, so that patches may be nearly half a wave wide
rather than a tenth of one. Clusters are what kernels work on: patches of one surface that lie together and look the
same way, whose common distance is taken in double precision and the rest in single.
"""

from collections.abc import Sequence

import numpy as np

from millisight.core import record

# How far a patch reaches from its centroid at most, over the wavelength. The phase then differs from that of the
# centroid by 4.3 rad at grazing angles, where the kernels' series is good to 1e-3; at 45 degrees it is to 1e-5.
REACH = 0.345

# Clusters are padded to whole vectors of so many patches, with patches of no area.
LANES = 16

_SLANTED = 0.5  # sine of the angle between shortest and longest side, below which a triangle is a blunt sliver


@record
class Patches:
    """N triangles in G clusters, padding included."""

    corners: np.ndarray  # (N, 3, 3) [m], counter-clockwise seen from outside; padding is a point
    surface: np.ndarray  # (G,) number of the surface that a cluster belongs to
    starts: np.ndarray  # (G + 1,) where clusters begin; multiples of LANES

    @property
    def centroids(self) -> np.ndarray:
        """(N, 3) [m]"""
        return self.corners.mean(axis=1)

    @property
    def crosses(self) -> np.ndarray:
        """(N, 3) along the outward normals, as long as the area [m²]."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return np.cross(b - a, c - a) / 2

    @property
    def areas(self) -> np.ndarray:
        """(N,) [m²]; 0 for padding."""
        return np.linalg.norm(self.crosses, axis=1)

    @property
    def normals(self) -> np.ndarray:
        """(N, 3) outward unit normals; 0 for padding."""
        areas = self.areas
        return self.crosses / np.where(areas > 0, areas, 1.0)[:, None]

    @property
    def cluster(self) -> np.ndarray:
        """(N,) number of each patch's cluster."""
        return np.repeat(np.arange(len(self.surface)), np.diff(self.starts))

    @property
    def centers(self) -> np.ndarray:
        """(G, 3) middle of each cluster's bounding box [m]."""
        starts = self.starts[:-1]
        points = self.centroids
        return (np.minimum.reduceat(points, starts) + np.maximum.reduceat(points, starts)) / 2

    @property
    def cones(self) -> np.ndarray:
        """(G, 4) mean normal of a cluster, and the sine of the largest angle to it (1 beyond a right angle)."""
        summed = np.add.reduceat(self.crosses, self.starts[:-1])
        axis = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-30)
        cosines = np.einsum("ni,ni->n", self.normals, axis[self.cluster])
        least = np.minimum.reduceat(np.where(self.areas > 0, cosines, 1.0), self.starts[:-1])
        return np.column_stack([axis, np.where(least > 0, np.sqrt(np.maximum(1 - least**2, 0)), 1.0)])


def cut(triangles: np.ndarray, reach: float) -> np.ndarray:
    """(M, 3, 3) triangles that tile `triangles` (F, 3, 3), all corners within `reach` [m] of their centroid.

    What is too large is sliced parallel to its shortest side, and each slice is cut across, so that thin triangles
    give few pieces. Triangles without area are left out.
    """
    triangles = triangles[doubled_area(triangles) > 0]
    too_large = np.linalg.norm(triangles - triangles.mean(axis=1, keepdims=True), axis=2).max(axis=1) > reach
    # Half a square, the worst of the pieces, reaches sqrt(5) / 3 of its side.
    return np.concatenate([triangles[~too_large], _sliced(_upright(triangles[too_large]), 3 / np.sqrt(5) * reach)])


def _upright(triangles: np.ndarray) -> np.ndarray:
    """The triangles, blunt slivers halved at the height over their longest side.

    Slices parallel to a sliver's shortest side would be far longer than it is high.
    """
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    longest = sides.max(axis=1)
    sliver = doubled_area(triangles) < _SLANTED * longest * sides.min(axis=1)
    order = (sides[sliver].argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles[sliver], order[..., None], axis=1).transpose(1, 0, 2)
    share = ((c - a) * (b - a)).sum(axis=1, keepdims=True) / longest[sliver, None] ** 2
    foot = a + share * (b - a)
    halves = np.concatenate([np.stack([a, foot, c], axis=1), np.stack([foot, b, c], axis=1)])
    return np.concatenate([triangles[~sliver], halves])


def _sliced(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Pieces of the triangles, each from a parallelogram whose sides are at most `longest` [m]."""
    if not len(triangles):
        return triangles
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    # Corner 0 becomes the one across from the shortest side.
    order = (sides.argmin(axis=1)[:, None] + 2 + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order[..., None], axis=1).transpose(1, 0, 2)
    across = np.linalg.norm(c - b, axis=1)
    along = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))

    face, row, rows = _counted(np.ceil(along / longest))
    near, far = row / rows, (row + 1) / rows
    slice_, piece, pieces = _counted(np.ceil(far * across[face] / longest))
    face, near, far = face[slice_], near[slice_, None], far[slice_, None]
    left, right = (piece / pieces)[:, None], ((piece + 1) / pieces)[:, None]
    a, b, c = a[face], b[face], c[face]
    p, q = (a + near * (b - a + u * (c - b)) for u in (left, right))
    s, r = (a + far * (b - a + u * (c - b)) for u in (left, right))
    straight = (np.linalg.norm(r - p, axis=1) <= np.linalg.norm(s - q, axis=1))[:, None, None]
    halves = (
        np.where(straight, np.stack([p, s, r], axis=1), np.stack([p, s, q], axis=1)),
        np.where(straight, np.stack([p, r, q], axis=1), np.stack([q, s, r], axis=1)),
    )
    pieces = np.concatenate(halves)
    area = doubled_area(pieces)
    # At a tip, the near side of a slice is a point, and so is one of its halves.
    return pieces[area > 1e-9 * area.max()]


def gather(surfaces: Sequence[np.ndarray], cell: float) -> Patches:
    """Patches of several surfaces, each (M, 3, 3) triangles from `cut`, in clusters no wider than `cell` [m]."""
    corners = np.concatenate(list(surfaces))
    owner = np.repeat(np.arange(len(surfaces)), [len(s) for s in surfaces])
    places = np.floor(corners.mean(axis=1) / cell).astype(np.int64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    widest = abs(normals).argmax(axis=1)
    facing = 2 * widest + (np.take_along_axis(normals, widest[:, None], axis=1)[:, 0] < 0)
    keys = np.column_stack([facing, places, owner])
    order = np.lexsort(keys.T)
    keys = keys[order]
    first = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]).any(axis=1)])
    counts = np.diff(np.r_[first, len(keys)])
    padded = -(-counts // LANES) * LANES
    starts = np.r_[0, np.cumsum(padded)]
    # Padding repeats a cluster's last patch, shrunk to its centroid.
    place = np.arange(starts[-1]) - np.repeat(starts[:-1], padded)
    source = order[np.repeat(first, padded) + np.minimum(place, np.repeat(counts - 1, padded))]
    gathered = corners[source]
    spare = place >= np.repeat(counts, padded)
    gathered[spare] = gathered[spare].mean(axis=1, keepdims=True)
    return Patches(corners=gathered, surface=keys[first, -1], starts=starts)


def _counted(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For `counts` [n] of things: each thing's owner, its place among the owner's, and the owner's count."""
    counts = np.maximum(counts, 1).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return owner, place, counts[owner]


def doubled_area(triangles: np.ndarray) -> np.ndarray:
    """(F,) twice the areas of triangles (F, 3, 3) [m²]."""
    a, b, c = triangles.transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)
