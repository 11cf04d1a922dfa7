"""Rays against triangles: shadows by the million, and first hits."""

import numpy as np

_RAYS = 1_000_000  # in one call of the caster: about 100 bytes each

LIFT = 1e-5
"""Rays start and end so far above a surface [m]: a hundredth of a wave at most, and a hundred times float32's error."""


class Rays:
    """A search tree over triangles (F, 3, 3) [m]; without any, nothing is met."""

    def __init__(self, triangles: np.ndarray):
        self._scene = None
        if len(triangles):
            from embreex.mesh_construction import TriangleMesh as EmbreeMesh
            from embreex.rtcore_scene import EmbreeScene

            corners = triangles.reshape(-1, 3)
            lower, upper = corners.min(axis=0), corners.max(axis=0)
            # About the middle, and no longer than they can meet anything: float32 is finest there.
            self._middle, self._longest = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) + 4 * LIFT
            self._scene = EmbreeScene()
            EmbreeMesh(self._scene, np.ascontiguousarray(triangles - self._middle, dtype=np.float32))

    def blocked(self, starts: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """(n,) bool: whether something lies between each of `starts` (n, 3) and `stop` (3,) [m]."""
        blocked = np.zeros(len(starts), dtype=bool)
        if self._scene is None:
            return blocked
        for first in range(0, len(starts), _RAYS):
            begin = starts[first : first + _RAYS]
            way = stop - begin
            way *= np.minimum(1, self._longest / np.linalg.norm(way, axis=1, keepdims=True))
            # Not normalised: the ray's parameter is 1 at its end.
            hits = self._scene.run(
                (begin - self._middle).astype(np.float32),
                way.astype(np.float32),
                dists=np.ones(len(way), np.float32),
                query="OCCLUDED",
            )
            blocked[first : first + _RAYS] = hits == 0
        return blocked

    def first(self, starts: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which triangle rays from `starts` (n, 3) along `directions` (n, 3) meet first (-1: none), and where [m]."""
        if self._scene is None:
            return np.full(len(starts), -1), starts
        face, reach = np.empty(len(starts), dtype=np.int64), np.empty(len(starts))
        for first in range(0, len(starts), _RAYS):
            some = slice(first, first + _RAYS)
            begin = (starts[some] - self._middle).astype(np.float32)
            hits = self._scene.run(begin, directions[some].astype(np.float32), output=True)
            face[some], reach[some] = hits["primID"], hits["tfar"]
        reach = np.where(face < 0, 0.0, reach)
        return face, starts + reach[:, None] * directions
