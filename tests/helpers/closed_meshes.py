"""What tells whether a mesh is closed, wound to one side, and how much it encloses."""

import numpy as np

from millisight.data import TriangleMesh


def edge_owners(mesh: TriangleMesh) -> np.ndarray:
    """How many faces each edge has: 2 where the mesh is closed."""
    return np.unique(_codes(np.sort(_sides(mesh), axis=1)), return_counts=True)[1]


def wound_alike(mesh: TriangleMesh) -> bool:
    """Whether no two faces go along an edge in the same direction."""
    codes = _codes(_sides(mesh))
    return len(np.unique(codes)) == len(codes)


def _sides(mesh: TriangleMesh) -> np.ndarray:
    return mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _codes(sides: np.ndarray) -> np.ndarray:
    """A number for each row, which NumPy sorts ten times as fast."""
    return sides[:, 0].astype(np.int64) << 32 | sides[:, 1]


def volume(mesh: TriangleMesh) -> float:
    """Enclosed volume [m³]: positive where the faces are wound outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
