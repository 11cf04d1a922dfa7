"""What tells whether a mesh is closed, wound to one side, and how much it encloses."""

import numpy as np

from millisight.data import TriangleMesh


def edge_owners(mesh: TriangleMesh) -> np.ndarray:
    """How many faces each edge has: 2 where the mesh is closed."""
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def wound_alike(mesh: TriangleMesh) -> bool:
    """Whether no two faces go along an edge in the same direction."""
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return len(np.unique(sides, axis=0)) == len(sides)


def volume(mesh: TriangleMesh) -> float:
    """Enclosed volume [m³]: positive where the faces are wound outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
