"""The vertices of a mesh that answer to each pair of antennas: a model's weights, and rays for what hides them.

Neighbouring antennas see almost the same (primer 10). Where an antenna is one of many, rays are cast from the corners
of small cells of space; a vertex that all corners of a cell agree on is settled for every antenna in it, and only what
changes inside the cell is cast one by one. An occluder's shadow is magnified on its way from the vertex to the
antennas, so that few are narrower than a cell: the tests compare with casting every ray.
"""

from collections.abc import Callable

import numpy as np

from millisight.core.errors import InputError
from millisight.data import TriangleMesh
from millisight.meshes import RayCaster
from millisight.simulation._models import ScatteringModel

# A ray that first meets a face this close to its vertex (relative to the distance) has arrived: float32 rays of
# 0.3 m are good to about 1e-7, and a real gap of 1e-5, 3 micrometres, is no gap for a millimetre wave.
_ARRIVED = float(np.float32(1 - 1e-5))

_TOLD_BY = 16  # one of so many antennas tells how many vertices are wanted

# Cells per distance to the mesh: 6 mm at 0.2 m.
_CELLS = 32


class Scatterers:
    """The vertices of a mesh that can answer under a model, ready to be asked from many antennas.

    `indices` are their numbers, `points` (V, 3) their positions [m].

    `each` is called again and again while rays are cast.
    """

    def __init__(self, mesh: TriangleMesh, model: ScatteringModel, *, each: Callable[[], object] = lambda: None):
        candidates = np.zeros(len(mesh.vertices), dtype=bool)
        candidates[mesh.faces] = True
        candidates &= model.candidates(mesh)
        self.mesh = mesh
        self.model = model
        self.indices = np.flatnonzero(candidates)
        self.points = mesh.vertices[self.indices]
        self._normals = mesh.vertex_normals[self.indices]
        self._vertices = mesh.vertices.astype(np.float32)
        self._center = mesh.bounds.mean(axis=0)
        self._caster = RayCaster(self._vertices[mesh.faces], each=each)

    def weights(self, tx_positions: np.ndarray, rx_positions: np.ndarray) -> np.ndarray:
        """(P, T, R, V) how strongly `indices` answer to antennas (P, T, 3), (P, R, 3) [m]; hidden: 0."""
        poses, transmitters = tx_positions.shape[:2]
        receivers = rx_positions.shape[1]
        weights = self.model.weights(tx_positions, rx_positions, self.points, self._normals)
        shape = (poses, transmitters, receivers, len(self.indices))
        if not isinstance(weights, np.ndarray) or weights.shape != shape or weights.dtype not in (bool, np.float32):
            got = f"{weights.dtype} {weights.shape}" if isinstance(weights, np.ndarray) else type(weights).__name__
            raise InputError(
                f"the weights of the scattering model {self.model.name!r} are {got}; expected bool or float32 {shape}"
            )
        # A leg is cast only where some pair of antennas still needs it, and once where TX and RX are one antenna.
        if transmitters == receivers == 1 and np.array_equal(tx_positions, rx_positions):
            # No pass over all pairs that a model of bool does not need.
            wanted = weights[:, 0, 0] if weights.dtype == bool else weights[:, 0, 0] != 0
            clear = self._clear(tx_positions[:, 0], wanted)
            if weights.dtype == bool:
                return clear[:, None, None]
            weights[:, 0, 0] *= clear
            return weights
        for t in range(transmitters):
            weights[:, t] *= self._clear(tx_positions[:, t], np.any(weights[:, t], axis=1))[:, None]
        for r in range(receivers):
            weights[:, :, r] *= self._clear(rx_positions[:, r], np.any(weights[:, :, r], axis=1))[:, None]
        return weights

    def neighbours_first(self, antennas: np.ndarray) -> np.ndarray:
        """(P,) an order of antennas (P, 3) in which blocks of them are compact, so that they share cells."""
        cells = np.floor(antennas / (8 * self._cell_size(antennas))).astype(np.int64)
        return np.lexsort(cells.T)

    def sees(self, origins: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        """(n,) bool: whether vertex number `vertices[i]` (n,) is visible from `origins[i]` (n, 3) [m], ray by ray.

        It is where the segment between them meets no face but those that hold the vertex.
        """
        origins, vertices = np.asarray(origins, dtype=np.float32), np.asarray(vertices)
        # Not normalised: the ray parameter is 1 at the vertex.
        face, arrival = self._caster.first(origins, self._vertices[vertices] - origins)
        arrived = arrival > _ARRIVED
        early = np.flatnonzero(~arrived)
        arrived[early] = (self.mesh.faces[face[early]] == vertices[early, None]).any(axis=1)
        return arrived

    def _clear(self, antennas: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """(P, V) bool: whether antenna p (P, 3) sees vertex v; only where `wanted` (P, V), which may be overwritten."""
        # Corners of cells see every vertex, which pays only where many are wanted: some antennas tell.
        some = wanted[::_TOLD_BY]
        if np.count_nonzero(some) > some.size / 10:
            return self._shared_view(antennas, wanted)
        return self._each_ray(antennas, wanted, wanted)

    def _each_ray(self, antennas: np.ndarray, wanted: np.ndarray, clear: np.ndarray) -> np.ndarray:
        """`clear` (P, V), perhaps `wanted` itself, in which a ray each has settled what is wanted."""
        from millisight.simulation._kernels import set_places  # Numba: not for --help

        antenna, vertex = set_places(wanted)
        clear[antenna, vertex] = self.sees(antennas[antenna], self.indices[vertex])
        return clear

    def _cell_size(self, antennas: np.ndarray) -> float:
        """Side of the cells in which antennas (A, 3) share their view [m]."""
        return float(np.median(np.linalg.norm(antennas - self._center, axis=1))) / _CELLS

    def _shared_view(self, antennas: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """As `_clear`, with rays from the corners of cells, which settle most of it."""
        cell, vertices = self._cell_size(antennas), self.indices
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
        return self._each_ray(antennas, wanted & ~settled[home], wanted & agreed[home])
