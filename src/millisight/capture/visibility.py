"""Which vertices an antenna sees: ray casting (primer 10)."""

import numpy as np

from millisight.scene.mesh import TriangleMesh

# A ray that first meets a face this close to its vertex (relative to the distance) has arrived: float32 rays of
# 0.3 m are good to about 1e-7, and a real gap of 1e-5, 3 micrometres, is no gap for a millimetre wave.
_ARRIVED = 1e-5


class Visibility:
    """Ray casting against one mesh, its search tree built once.

    A vertex is visible from a point when the segment between them meets no face but those that hold the vertex.
    """

    def __init__(self, mesh: TriangleMesh):
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
        from embreex.rtcore_scene import EmbreeScene

        self._vertices = mesh.vertices.astype(np.float32)
        self._faces = mesh.faces
        self._scene = EmbreeScene()
        EmbreeMesh(self._scene, np.ascontiguousarray(self._vertices[mesh.faces]))

    def sees(self, origins: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        """(n,) bool: whether vertex number `vertices[i]` (n,) is visible from `origins[i]` (n, 3) [m]."""
        origins = np.ascontiguousarray(origins, dtype=np.float32)
        # Not normalised: the ray parameter is 1 at the vertex.
        rays = self._scene.run(origins, self._vertices[vertices] - origins, output=True)
        face, arrival = rays["primID"], rays["tfar"]
        own = (self._faces[np.maximum(face, 0)] == np.asarray(vertices)[:, None]).any(axis=1)
        return (face < 0) | own | (arrival > 1 - _ARRIVED)
