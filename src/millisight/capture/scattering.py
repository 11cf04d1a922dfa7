"""Which vertices answer: the paper's specular, edge and diffuse models, and the rays that decide (primer 10 to 12)."""

import numpy as np

from millisight.capture.visibility import Visibility
from millisight.errors import InputError, UnknownNameError
from millisight.records import checked_number, record
from millisight.scene.mesh import TriangleMesh

MODELS = ("specular", "edge", "diffuse")


@record
class ScatteringModel:
    """What makes a visible vertex answer.

    Attributes
    ----------
    name : "specular" (paper Eq. 6), "edge" (Eq. 7) or "diffuse" (Eq. 4: every visible vertex)
    tau_deg : specular: largest angle between the normal and the bisector of the directions to TX and RX [degrees]
    edge_deg : edge: an edge whose faces' normals are further apart is sharp [degrees]
    two_sided : specular: the opposite normal counts too, for meshes with flipped faces
    """

    name: str = "specular"
    tau_deg: float = 5.0
    edge_deg: float = 20.0
    two_sided: bool = False

    def __post_init__(self) -> None:
        if self.name not in MODELS:
            raise UnknownNameError("scattering model", self.name, MODELS)
        for name in ("tau_deg", "edge_deg"):
            value = checked_number(getattr(self, name), name=name, unit="degrees", above=0)
            if value > 180:
                raise InputError(f"{name} is {value:g} degrees; expected at most 180")


class Scatterers:
    """The vertices of a mesh that can answer under a model, ready to be asked from many antennas.

    Attributes
    ----------
    mesh : TriangleMesh, whose faces also occlude
    model : ScatteringModel
    indices : (V,) the vertices that can answer from somewhere, as numbers in `mesh.vertices`
    """

    def __init__(self, mesh: TriangleMesh, model: ScatteringModel):
        candidates = np.zeros(len(mesh.vertices), dtype=bool)
        candidates[mesh.faces] = True
        if model.name == "edge":
            candidates &= mesh.sharp_vertices(model.edge_deg)
        self.mesh = mesh
        self.model = model
        self.indices = np.flatnonzero(candidates)
        self._normals = mesh.vertex_normals[self.indices]
        self._visibility = Visibility(mesh)

    @property
    def points(self) -> np.ndarray:
        """(V, 3) positions of `indices` [m]."""
        return self.mesh.vertices[self.indices]

    def lit(self, tx_positions: np.ndarray, rx_positions: np.ndarray) -> np.ndarray:
        """(P, T, R, V) bool: which of `indices` answer to each pair of antennas.

        Parameters
        ----------
        tx_positions : (P, T, 3) [m]
        rx_positions : (P, R, 3) [m]
        """
        poses, transmitters = tx_positions.shape[:2]
        receivers = rx_positions.shape[1]
        lit = np.ones((poses, transmitters, receivers, len(self.indices)), dtype=bool)
        if self.model.name == "specular":
            from millisight.capture import _kernels

            pairs = (poses, transmitters, receivers, 3)
            _kernels.specular(
                np.broadcast_to(tx_positions[:, :, None], pairs).reshape(-1, 3),
                np.broadcast_to(rx_positions[:, None], pairs).reshape(-1, 3),
                np.ascontiguousarray(self.points.T),
                np.ascontiguousarray(self._normals.T),
                np.cos(np.radians(self.model.tau_deg)),
                self.model.two_sided,
                lit.reshape(-1, len(self.indices)),
            )
        # A leg is cast only where some pair of antennas still needs it, and once where TX and RX are one antenna.
        if transmitters == receivers == 1 and np.array_equal(tx_positions, rx_positions):
            lit[:, 0, 0] = self._clear(tx_positions[:, 0], lit[:, 0, 0])
            return lit
        for t in range(transmitters):
            lit[:, t] &= self._clear(tx_positions[:, t], np.any(lit[:, t], axis=1))[:, None]
        for r in range(receivers):
            lit[:, :, r] &= self._clear(rx_positions[:, r], np.any(lit[:, :, r], axis=1))[:, None]
        return lit

    def _clear(self, antennas: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """(P, V) bool: whether antenna p (P, 3) sees vertex v; only where `wanted` (P, V), elsewhere False."""
        # Several times as fast as np.nonzero in two dimensions.
        antenna, vertex = np.divmod(np.flatnonzero(wanted), wanted.shape[1])
        # Corners of cells see every vertex, which pays only where many are wanted.
        if len(antenna) > wanted.size / 10:
            return self._visibility.among(antennas, self.indices, wanted, self._visibility.cell_size(antennas))
        clear = np.zeros_like(wanted)
        clear[antenna, vertex] = self._visibility.sees(antennas[antenna], self.indices[vertex])
        return clear

    def neighbours_first(self, antennas: np.ndarray) -> np.ndarray:
        """(P,) an order of antennas (P, 3) in which blocks of them are compact, so that they share cells."""
        cells = np.floor(antennas / (8 * self._visibility.cell_size(antennas))).astype(np.int64)
        return np.lexsort(cells.T)
