"""Rough: a lobe of a stated width about the mirror's direction, between specular and diffuse."""

from typing import ClassVar

import numpy as np

from millisight.core import record
from millisight.data import TriangleMesh
from millisight.simulation._models import SCATTERING_MODELS, check_angle, parameter

# Amplitudes under this count as none, which spares their rays: -80 dB of power.
_LEAST = 1e-4


@SCATTERING_MODELS.add("rough")
@record
class RoughModel:
    """Vertices scatter into a lobe around the specular direction (primer 17).

    The power goes as ((1 + cos ψ) / 2)^α, with ψ the angle between the directions to the receiver and of the mirrored
    wave: the directive model of V. Degli-Esposti, F. Fuschini, E. M. Vitucci and G. Falciasecca, "Measurement and
    modelling of scattering from buildings", IEEE Trans. Antennas Propag. 55(1), 143-153 (2007). Here α comes from the
    lobe's width, and the peak is 1, as amplitudes of the simulator are relative. At 180 degrees α is 0: every visible
    vertex answers alike, as in "diffuse". With both antennas in one place ψ is twice the angle off the normal: half
    the power is left at `lobe_deg` / 2, and the lobe shrinks to what "specular" keeps as both angles do.

    Attributes
    ----------
    lobe_deg : angle off the mirrored wave at which half the power is left [degrees]; 90 is α = 1, 47.0 is α = 4

    A flipped normal changes nothing: the mirror's direction is the same.
    """

    name: ClassVar[str] = "rough"
    lobe_deg: float = parameter(
        40.0, "Rough: angle from the specular direction at which the power has halved [degrees]."
    )

    def __post_init__(self) -> None:
        check_angle(self.lobe_deg, "lobe_deg")

    @property
    def exponent(self) -> float:
        """α of the power: ln 2 / -ln((1 + cos `lobe_deg`) / 2)."""
        if self.lobe_deg >= 180:
            return 0.0
        return float(np.log(2) / (-2 * np.log(np.cos(np.radians(self.lobe_deg) / 2))))

    def candidates(self, mesh: TriangleMesh) -> np.ndarray:
        return np.ones(len(mesh.vertices), dtype=bool)

    def weights(self, tx_positions, rx_positions, points, normals) -> np.ndarray:
        poses, receivers = len(tx_positions), rx_positions.shape[1]
        weights = np.empty((poses, tx_positions.shape[1], receivers, len(points)), dtype=np.float32)
        exponent = self.exponent / 2
        for p in range(poses):
            to_tx, to_rx = _directions(tx_positions[p], points), _directions(rx_positions[p], points)
            along_tx, along_rx = (_along(way, normals) for way in (to_tx, to_rx))
            # The mirrored wave leaves along 2 (n u_t) n - u_t.
            cosine = 2 * along_tx[:, None] * along_rx - _along(to_tx[:, None], to_rx)
            weights[p] = np.clip((1 + cosine) / 2, 0, 1) ** exponent
        weights[weights < _LEAST] = 0
        return weights


def _directions(antennas: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(A, V, 3) unit vectors from points (V, 3) to antennas (A, 3)."""
    ways = antennas[:, None] - points
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


def _along(ways: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(...) scalar products of vectors (..., 3)."""
    return np.einsum("...i,...i->...", ways, others)
