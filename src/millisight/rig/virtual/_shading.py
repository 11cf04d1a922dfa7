"""Surfaces as a camera sees them: which one a ray meets first, and how it lies there, shaded round."""

from collections.abc import Sequence

import numpy as np

from millisight.data import TriangleMesh
from millisight.meshes import RayCaster

# Where a face and its corner's normal are further apart than this, the edge is sharp and not shaded round.
_SHARP = np.cos(np.radians(40.0))


class ShadedMeshes:
    """Meshes to look at; `caster` holds all their faces."""

    def __init__(self, meshes: Sequence[TriangleMesh]):
        self.caster: RayCaster = RayCaster.of(meshes)
        self._corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
        self._owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
        self._face_normals = np.concatenate([mesh.face_normals for mesh in meshes])
        self._corner_normals = np.concatenate([mesh.vertex_normals[mesh.faces] for mesh in meshes])

    def first(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mesh, face (of all) and distance [m], (n,) each, that rays from `origins` [m] meet first; or -1, -1, inf."""
        face, distance = self.caster.first(origins, directions)
        return np.where(face < 0, -1, self._owner[face]), face, distance

    def normals(self, face: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(n, 3) unit normals at `points` (n, 3) of faces (n,), shaded round over edges that are not sharp."""
        corners, flat = self._corners[face], self._face_normals[face]
        at_corners = self._corner_normals[face]
        normals = np.zeros_like(flat)
        for i in range(3):
            # The area that the point makes with the side across from the corner weighs it: barycentric coordinates.
            a, b = corners[:, i - 2], corners[:, i - 1]
            area = np.einsum("fi,fi->f", flat, np.cross(b - a, points - a))
            sharp = np.einsum("fi,fi->f", at_corners[:, i], flat) < _SHARP
            normals += np.clip(area, 1e-15, None)[:, None] * np.where(sharp[:, None], flat, at_corners[:, i])
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
