"""Which vertices an antenna sees: ray casting (primer 10).

Neighbouring antennas see almost the same. Where an antenna is one of many, rays are cast from the corners of small
cells of space; a vertex that all corners of a cell agree on is settled for every antenna in it, and only what
changes inside the cell is cast one by one. An occluder's shadow is magnified on its way from the vertex to the
antennas, so that few are narrower than a cell: the tests compare with casting every ray.
"""

import numpy as np

from millisight.scene.mesh import TriangleMesh

# A ray that first meets a face this close to its vertex (relative to the distance) has arrived: float32 rays of
# 0.3 m are good to about 1e-7, and a real gap of 1e-5, 3 micrometres, is no gap for a millimetre wave.
_ARRIVED = 1e-5

# Cells per distance to the mesh: 6 mm at 0.2 m.
_CELLS = 32

# Rays in one call of the caster: about 80 bytes each.
_RAYS = 2_000_000


class Visibility:
    """Ray casting against one mesh, its search tree built once.

    A vertex is visible from a point when the segment between them meets no face but those that hold the vertex.
    """

    def __init__(self, mesh: TriangleMesh):
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
        from embreex.rtcore_scene import EmbreeScene

        self._vertices = mesh.vertices.astype(np.float32)
        self._faces = mesh.faces
        self._center = mesh.bounds.mean(axis=0)
        self._scene = EmbreeScene()
        EmbreeMesh(self._scene, np.ascontiguousarray(self._vertices[mesh.faces]))

    def sees(self, origins: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        """(n,) bool: whether vertex number `vertices[i]` (n,) is visible from `origins[i]` (n, 3) [m], ray by ray."""
        clear = np.empty(len(vertices), dtype=bool)
        for start in range(0, len(vertices), _RAYS):
            some = slice(start, start + _RAYS)
            clear[some] = self._cast(np.ascontiguousarray(origins[some], dtype=np.float32), vertices[some])
        return clear

    def _cast(self, origins: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        # Not normalised: the ray parameter is 1 at the vertex.
        rays = self._scene.run(origins, self._vertices[vertices] - origins, output=True)
        face, arrival = rays["primID"], rays["tfar"]
        arrived = (face < 0) | (arrival > 1 - _ARRIVED)
        early = np.flatnonzero(~arrived)
        arrived[early] = (self._faces[face[early]] == np.asarray(vertices)[early, None]).any(axis=1)
        return arrived

    def cell_size(self, antennas: np.ndarray) -> float:
        """Side of the cells in which antennas (A, 3) share their view [m]."""
        return float(np.median(np.linalg.norm(antennas - self._center, axis=1))) / _CELLS

    def among(self, antennas: np.ndarray, vertices: np.ndarray, wanted: np.ndarray, cell: float) -> np.ndarray:
        """(A, V) bool: which of `vertices` (V,) each antenna (A, 3) sees; only where `wanted` (A, V), elsewhere False.

        Rays from the corners of cells of side `cell` [m] settle most of it.
        """
        # A layer of antennas thinner than a cell has its corners in the layer's middle.
        flat = np.ptp(antennas, axis=0) < cell
        anchor = np.where(flat, (antennas.min(axis=0) + antennas.max(axis=0)) / 2, 0.0)
        cells = np.where(flat, 0, np.floor(antennas / cell)).astype(np.int64)
        used, home = np.unique(cells, axis=0, return_inverse=True)
        steps = np.stack(np.meshgrid(*([0] if f else [0, 1] for f in flat), indexing="ij"), axis=-1).reshape(-1, 3)
        corners, corner_of = np.unique((used[:, None] + steps).reshape(-1, 3), axis=0, return_inverse=True)
        corner_of = corner_of.reshape(len(used), len(steps))

        places = np.where(flat, anchor, corners * cell)
        view = self.sees(np.repeat(places, len(vertices), axis=0), np.tile(vertices, len(places)))
        view = view.reshape(len(places), len(vertices))[corner_of]
        agreed = view[:, 0] & view.all(axis=1)
        settled = agreed | ~view.any(axis=1)

        home = home.reshape(-1)
        clear = wanted & agreed[home]
        antenna, vertex = np.divmod(np.flatnonzero(wanted & ~settled[home]), len(vertices))
        clear[antenna, vertex] = self.sees(antennas[antenna], vertices[vertex])
        return clear
