"""The closed surface of a mask of voxels, by marching tetrahedra.

Between eight voxel centres lies a cell, cut into six tetrahedra along its diagonal (Kuhn 1960; the cuts of neighbours
fit each other). In each tetrahedron the surface separates the centres inside the mask from those outside, half-way
between them (Doi and Koide 1991, "An efficient method of triangulating equi-valued surfaces by using tetrahedral
cells"). Unlike marching cubes this has no ambiguous case: the surface is closed, and each edge has two faces.
"""

from itertools import permutations, product

import numpy as np

from millisight.core import checked_record
from millisight.core.errors import InputError
from millisight.data import TriangleMesh, VolumeMask

_ALONE = 1e-3  # width of the only voxel along all axes [m]
_QUAD = ((0, 1, 3), (0, 3, 2))


def mask_surface(volume: VolumeMask) -> TriangleMesh:
    """The closed surface of the voxels inside a mask, half-way between centres inside and outside.

    Beyond the grid all is outside: an object that the grid cuts off ends half a voxel beyond its last voxel.

    Parameters
    ----------
    volume : VolumeMask

    Returns
    -------
    TriangleMesh
        In the grid's frame [m]; faces counter-clockwise seen from outside.

    Raises
    ------
    InputError
        There are no voxels inside.
    """
    inside = checked_record(volume, VolumeMask, name="volume").inside
    if not inside.any():
        raise InputError("the mask has no voxels inside, and so no surface; check that the object was found")
    padded = np.pad(inside, 1)
    shifted = [padded[tuple(slice(s, s + n - 1) for s, n in zip(step, padded.shape, strict=True))] for step in _CUBE]
    cells = np.argwhere(np.any(shifted, axis=0) & ~np.all(shifted, axis=0))
    triangles = []
    for steps in _TETRAHEDRA:
        held = np.stack([padded[tuple((cells + step).T)] for step in steps], axis=1)
        codes = held @ (1 << np.arange(4))
        for code in range(1, 15):
            of = cells[codes == code]
            triangles += [2 * of[:, None] + triangle for triangle in _crossed(steps, code)]
    # Integers, twice the index: equal places are one vertex exactly.
    corners = np.concatenate(triangles).reshape(-1, 3)
    places, faces = np.unique(np.ravel_multi_index(corners.T, 2 * np.array(padded.shape)), return_inverse=True)
    halves = np.stack(np.unravel_index(places, 2 * np.array(padded.shape)), axis=1) / 2
    axes = _extended(volume.grid.x, volume.grid.y, volume.grid.z)
    vertices = [np.interp(half, np.arange(len(axis)), axis) for half, axis in zip(halves.T, axes, strict=True)]
    return TriangleMesh(vertices=np.stack(vertices, axis=1), faces=faces.reshape(-1, 3))


def _extended(*axes: np.ndarray) -> list[np.ndarray]:
    """Coordinates with one more at either end, along an axis with a single one as far apart as the closest others."""
    alone = min((float(np.diff(axis).min()) for axis in axes if len(axis) > 1), default=_ALONE)
    found = []
    for axis in axes:
        first, last = (axis[1] - axis[0], axis[-1] - axis[-2]) if len(axis) > 1 else (alone, alone)
        found.append(np.r_[axis[0] - first, axis, axis[-1] + last])
    return found


def _tetrahedron(order: tuple[int, ...]) -> np.ndarray:
    """(4, 3) corners on the way from (0, 0, 0) to (1, 1, 1), one axis after the other."""
    steps = np.zeros((4, 3), int)
    for number, axis in enumerate(order):
        steps[number + 1 :, axis] = 1
    return steps


def _crossed(steps: np.ndarray, code: int) -> list[np.ndarray]:
    """Triangles (3, 3), twice their corners, that part the corners inside (bits of `code`) from those outside."""
    inner, outer = ([steps[i] for i in range(4) if bool(code >> i & 1) is one] for one in (True, False))
    middles = [a + b for a, b in product(inner, outer)]
    outward = np.mean(outer, axis=0) - np.mean(inner, axis=0)
    found = []
    for triangle in ((0, 1, 2),) if len(middles) == 3 else _QUAD:
        a, b, c = (middles[i] for i in triangle)
        found.append(np.stack([a, b, c] if np.cross(b - a, c - a) @ outward > 0 else [a, c, b]))
    return found


_CUBE = tuple(product((0, 1), repeat=3))
_TETRAHEDRA = tuple(_tetrahedron(order) for order in permutations(range(3)))
