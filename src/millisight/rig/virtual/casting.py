"""Rays against the meshes of a virtual world: what a ray meets first, where, and how the surface lies there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.scene.mesh import TriangleMesh

# Where a face and its corner's normal are further apart than this, the edge is sharp and not shaded round.
_SHARP = np.cos(np.radians(40.0))
# Rays in one call of the caster: about 100 bytes each.
_RAYS = 1_000_000


class Hits(NamedTuple):
    """What rays met: (n,) number of the mesh, -1 for none; (n,) distance [m], inf for none; (n,) face."""

    mesh: np.ndarray
    distance: np.ndarray
    face: np.ndarray


class Caster:
    """The meshes, with a search tree over all of them."""

    def __init__(self, meshes: Sequence[TriangleMesh]):
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
        from embreex.rtcore_scene import EmbreeScene

        self._corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
        self._owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
        self._face_normals = np.concatenate([mesh.face_normals for mesh in meshes])
        self._corner_normals = np.concatenate([mesh.vertex_normals[mesh.faces] for mesh in meshes])
        self._scene = EmbreeScene()
        EmbreeMesh(self._scene, np.ascontiguousarray(self._corners, dtype=np.float32))

    def first(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """What rays from `origins` (n, 3) or (3,) [m] along unit `directions` (n, 3) meet first."""
        origins = np.broadcast_to(origins, directions.shape)
        face, distance = np.empty(len(directions), dtype=np.int64), np.empty(len(directions))
        for start in range(0, len(directions), _RAYS):
            some = slice(start, start + _RAYS)
            rays = self._scene.run(
                np.ascontiguousarray(origins[some], dtype=np.float32),
                np.ascontiguousarray(directions[some], dtype=np.float32),
                output=True,
            )
            face[some], distance[some] = rays["primID"], rays["tfar"]
        none = face < 0
        return Hits(np.where(none, -1, self._owner[face]), np.where(none, np.inf, distance), face)

    def crosses(self, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """(n,) bool, whether the segments from (n, 3) to (n, 3) [m] meet a face."""
        ways = stops - starts
        lengths = np.linalg.norm(ways, axis=1)
        hits = self.first(starts, ways / np.maximum(lengths, 1e-12)[:, None])
        return hits.distance < lengths

    def leaves(self, hits: Hits, directions: np.ndarray) -> np.ndarray:
        """(n,) bool, whether rays along `directions` (n, 3) met a face from its inner side."""
        along = np.einsum("ni,ni->n", self._face_normals[hits.face], directions)
        return (hits.mesh >= 0) & (along > 0)

    def normals(self, hits: Hits, points: np.ndarray) -> np.ndarray:
        """(n, 3) unit normals at `points` (n, 3) that were hit, shaded round over edges that are not sharp."""
        corners, flat = self._corners[hits.face], self._face_normals[hits.face]
        at_corners = self._corner_normals[hits.face]
        normals = np.zeros_like(flat)
        for i in range(3):
            # The area that the point makes with the side across from the corner weighs it: barycentric coordinates.
            a, b = corners[:, i - 2], corners[:, i - 1]
            area = np.einsum("fi,fi->f", flat, np.cross(b - a, points - a))
            sharp = np.einsum("fi,fi->f", at_corners[:, i], flat) < _SHARP
            normals += np.clip(area, 1e-15, None)[:, None] * np.where(sharp[:, None], flat, at_corners[:, i])
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
