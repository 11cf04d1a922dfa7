"""The vertices of a mesh that answer to each pair of antennas: a model's weights, and rays for what hides them.

Neighbouring antennas see almost the same (primer 10). Where an antenna is one of many, rays are cast from the corners
of small cells of space; a vertex that all corners of a cell agree on is settled for every antenna in it, and only what
changes inside the cell is cast one by one. An occluder's shadow is magnified on its way from the vertex to the
antennas, so that few are narrower than a cell: the tests compare with casting every ray.
"""

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from millisight.core.errors import InputError
from millisight.data import TriangleMesh
from millisight.meshes import RayCaster
from millisight.simulation._bodies import Bodies
from millisight.simulation._models import ScatteringModel

# A ray that first meets a face this close to its vertex (relative to the distance) has arrived: float32 rays of
# 0.3 m are good to about 1e-7, and a real gap of 1e-5, 3 micrometres, is no gap for a millimetre wave.
_ARRIVED = float(np.float32(1 - 1e-5))

# Vertex-channel pairs looked at together: about 80 bytes each while rays are cast, so a quarter of a gigabyte.
_BLOCK_PAIRS = 3_000_000

# Poses of a block where the model tells which vertices may answer: fewer are nearer together, and leave out more; more
# cost less Python.
_TOGETHER = 512

_TRIED = 24  # poses from which closed bodies are tried

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
        self._named = f"the scattering model {model.name!r}"
        answer = model.candidates(mesh)
        _check_answer(answer, f"the candidates of {self._named} are", candidates.shape, bool)
        candidates &= answer
        self.mesh = mesh
        self.model = model
        self.indices = np.flatnonzero(candidates)
        self.points = mesh.vertices[self.indices]
        self._normals = mesh.vertex_normals[self.indices]
        self._vertices = mesh.vertices.astype(np.float32)
        self._center = mesh.bounds.mean(axis=0)
        self._caster = RayCaster(self._vertices[mesh.faces], each=each)

    def blocks(self, tx_positions: np.ndarray, rx_positions: np.ndarray) -> "Iterator[tuple[np.ndarray, Scatterers]]":
        """Blocks of all poses: the numbers of neighbours, and the scatterers that may answer to any of them."""
        order = self.neighbours_first(tx_positions.mean(axis=1))
        channels, done = tx_positions.shape[1] * rx_positions.shape[1], 0
        told = callable(getattr(self.model, "within_reach", None))
        bodies = None if told else self._bodies(tx_positions[order[:: max(1, len(order) // _TRIED)], 0])
        longest = _TOGETHER if told else max(1, _BLOCK_PAIRS // (max(1, len(self.indices)) * channels))
        while done < len(order):
            block = order[done : done + longest]
            some = self._within_reach(tx_positions[block], rx_positions[block], bodies)
            block = block[: max(1, _BLOCK_PAIRS // (max(1, len(some.indices)) * channels))]
            done += len(block)
            yield block, some

    def _bodies(self, antennas: np.ndarray) -> Bodies:
        """The bodies that the mesh encloses, less those of which some antennas (A, 3) see what should be hidden."""
        bodies = Bodies(self.mesh)
        for antenna in antennas:
            hidden = self.indices[bodies.turned_away(antenna)[self.indices]]
            bodies.distrust(hidden[self.sees(np.broadcast_to(antenna, (len(hidden), 3)), hidden)])
        return bodies

    def _within_reach(self, tx_positions: np.ndarray, rx_positions: np.ndarray, bodies: Bodies | None) -> "Scatterers":
        """Those that may answer to any of these antennas, as the model has it, or without it as the bodies have; rays
        meet what they met."""
        if bodies is None:
            model: Any = self.model  # of its protocol this method is no part, since models need not have it
            chosen = model.within_reach(tx_positions, rx_positions, self.points, self._normals)
            _check_answer(chosen, f"within_reach of {self._named} is", (len(self.points),), bool)
        else:
            chosen = ~(bodies.turned_away(tx_positions) | bodies.turned_away(rx_positions))[self.indices]
        numbers, some = np.flatnonzero(chosen), copy.copy(self)
        some.indices, some.points, some._normals = self.indices[numbers], self.points[numbers], self._normals[numbers]
        return some

    def weights(self, tx_positions: np.ndarray, rx_positions: np.ndarray) -> np.ndarray:
        """(P, T, R, V) how strongly `indices` answer to antennas (P, T, 3), (P, R, 3) [m]; hidden: 0."""
        poses, transmitters = tx_positions.shape[:2]
        receivers = rx_positions.shape[1]
        weights = self.model.weights(tx_positions, rx_positions, self.points, self._normals)
        shape = (poses, transmitters, receivers, len(self.indices))
        _check_answer(weights, f"the weights of {self._named} are", shape, bool, np.float32)
        if weights.dtype != bool and not (np.isfinite(weights) & (weights >= 0)).all():
            raise InputError(
                f"a weight of {self._named} is negative, infinite or NaN; expected amplitudes of at least 0"
            )
        if not weights.flags.writeable:
            weights = weights.copy()
        # A leg is cast only where some pair of antennas still needs it, and once where TX and RX are one antenna.
        if transmitters == receivers == 1 and np.array_equal(tx_positions, rx_positions):
            # No pass over all pairs that a model of bool does not need.
            wanted = weights[:, 0, 0] if weights.dtype == bool else weights[:, 0, 0] != 0
            clear = self._shared_view(tx_positions[:, 0], wanted)
            if weights.dtype == bool:
                return clear[:, None, None]
            weights[:, 0, 0] *= clear
            return weights
        for t in range(transmitters):
            weights[:, t] *= self._shared_view(tx_positions[:, t], np.any(weights[:, t], axis=1))[:, None]
        for r in range(receivers):
            weights[:, :, r] *= self._shared_view(rx_positions[:, r], np.any(weights[:, :, r], axis=1))[:, None]
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
        """(P, V) bool: whether antenna p (P, 3) sees vertex v; only where `wanted` (P, V), which may be overwritten.

        Rays from the corners of cells settle most of it, where antennas are near enough together to share them.
        """
        from millisight.simulation._kernels import any_of_groups, set_places  # Numba: not for --help

        cell = self._cell_size(antennas)
        # A layer of antennas thinner than a cell has its corners in the layer's middle.
        flat = np.ptp(antennas, axis=0) < cell
        anchor = np.where(flat, (antennas.min(axis=0) + antennas.max(axis=0)) / 2, 0.0)
        cells = np.where(flat, 0, np.floor(antennas / cell)).astype(np.int64)
        used, home = np.unique(cells, axis=0, return_inverse=True)
        steps = np.stack(np.meshgrid(*([0] if f else [0, 1] for f in flat), indexing="ij"), axis=-1).reshape(-1, 3)
        corners, corner_of = np.unique((used[:, None] + steps).reshape(-1, 3), axis=0, return_inverse=True)
        if len(corners) >= len(antennas):
            return self._each_ray(antennas, wanted, wanted)
        corner_of, home = corner_of.reshape(len(used), len(steps)), home.reshape(-1)
        asked = any_of_groups(wanted, home, len(used))
        asked_from = np.zeros((len(corners), len(self.indices)), dtype=bool)
        for column in corner_of.T:  # no corner twice in one
            asked_from[column] |= asked
        if np.count_nonzero(asked_from) >= np.count_nonzero(wanted):
            return self._each_ray(antennas, wanted, wanted)

        corner, vertex = set_places(asked_from)
        view = np.zeros(asked_from.shape, dtype=bool)
        view[corner, vertex] = self.sees(np.where(flat, anchor, corners * cell)[corner], self.indices[vertex])
        around = view[corner_of]  # (cells, corners of each, V)
        agreed = np.all(around, axis=1)
        settled = agreed | ~np.any(around, axis=1)
        return self._each_ray(antennas, wanted & ~settled[home], wanted & agreed[home])


def _check_answer(answer: Any, said: str, shape: tuple[int, ...], *dtypes: type) -> None:
    """Refuse what a model of one's own answers in another form than its protocol has."""
    if not isinstance(answer, np.ndarray) or answer.shape != shape or answer.dtype not in dtypes:
        got = f"{answer.dtype} {answer.shape}" if isinstance(answer, np.ndarray) else type(answer).__name__
        raise InputError(f"{said} {got}; expected {' or '.join(np.dtype(one).name for one in dtypes)} {shape}")
