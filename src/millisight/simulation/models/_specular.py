"""Specular: a smooth surface answers where it mirrors the transmitter to the receiver."""

from typing import ClassVar

import numpy as np

from millisight.core import record
from millisight.data import TriangleMesh
from millisight.simulation._models import SCATTERING_MODELS, check_angle, of_channels, parameter


@SCATTERING_MODELS.add("specular")
@record
class SpecularModel:
    """Vertices reflect if their normal bisects the angle between transmitter and receiver (paper Eq. 6, primer 11).

    Attributes
    ----------
    tau_deg : largest angle between the normal and the bisector of the directions to TX and RX [degrees]
    two_sided : the opposite normal counts too, for meshes with flipped faces
    """

    name: ClassVar[str] = "specular"
    tau_deg: float = parameter(5.0, "Specular: largest angle from the normal [degrees].")
    two_sided: bool = parameter(False, "Specular: faces reflect on both sides.")

    def __post_init__(self) -> None:
        check_angle(self.tau_deg, "tau_deg")

    @property
    def _tau(self) -> float:
        return float(np.radians(self.tau_deg))

    def candidates(self, mesh: TriangleMesh) -> np.ndarray:
        return np.ones(len(mesh.vertices), dtype=bool)

    def weights(self, tx_positions, rx_positions, points, normals) -> np.ndarray:
        from millisight.simulation import _kernels as _kernels

        shape = (*tx_positions.shape[:2], rx_positions.shape[1])
        lit = np.empty((*shape, len(points)), dtype=bool)
        _kernels.specular(
            *of_channels(tx_positions, rx_positions),
            np.ascontiguousarray(points.T),
            np.ascontiguousarray(normals.T),
            np.cos(self._tau),
            self.two_sided,
            lit.reshape(-1, len(points)),
        )
        return lit

    def within_reach(self, tx_positions, rx_positions, points, normals) -> np.ndarray:
        """(V,) bool: vertices that may answer to any of these antennas."""
        from millisight.simulation import _kernels as _kernels

        middles = [places.reshape(-1, 3).mean(axis=0) for places in (tx_positions, rx_positions)]
        around = [
            np.linalg.norm(places - middle, axis=-1).max()
            for places, middle in zip((tx_positions, rx_positions), middles, strict=True)
        ]
        found = np.empty(len(points), dtype=bool)
        _kernels.may_mirror(
            *middles, np.array(around), points, normals, self._tau, self.two_sided, found
        )  # fmt: skip
        return found
