"""A scattering model: an ideally rough surface."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import millisight as ms


@dataclass(frozen=True)
class LambertModel:
    """Power falls with the cosines of both antennas' angles off the normal (Lambert's cosine law).

    The amplitude of a vertex is sqrt(cos a cos b), with a and b the angles between its normal and the directions to the
    transmitter and to the receiver; 0 behind the surface.
    """

    name: ClassVar[str] = "lambert"

    def candidates(self, mesh: ms.TriangleMesh) -> np.ndarray:
        """(V,) bool: every vertex can answer."""
        return np.ones(len(mesh.vertices), dtype=bool)

    def weights(
        self, tx_positions: np.ndarray, rx_positions: np.ndarray, points: np.ndarray, normals: np.ndarray
    ) -> np.ndarray:
        """(P, T, R, V) float32 amplitudes."""
        tx, rx = (self._cosines(antennas, points, normals) for antennas in (tx_positions, rx_positions))
        return np.sqrt(tx[:, :, None] * rx[:, None]).astype(np.float32)

    @staticmethod
    def _cosines(antennas: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(P, A, V) cosine of the angle between each normal and the direction to each antenna, at least 0."""
        ways = antennas[:, :, None] - points
        return np.clip(np.einsum("pavi,vi->pav", ways, normals) / np.linalg.norm(ways, axis=-1), 0, None)
