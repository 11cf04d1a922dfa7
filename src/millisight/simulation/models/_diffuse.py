"""Diffuse: every visible vertex answers alike."""

from typing import ClassVar

import numpy as np

from millisight.core import record
from millisight.data import TriangleMesh
from millisight.simulation._models import SCATTERING_MODELS


@SCATTERING_MODELS.add("diffuse")
@record
class DiffuseModel:
    """Every visible vertex reflects (paper Eq. 4, primer 10)."""

    name: ClassVar[str] = "diffuse"

    def candidates(self, mesh: TriangleMesh) -> np.ndarray:
        return np.ones(len(mesh.vertices), dtype=bool)

    def weights(self, tx_positions, rx_positions, points, normals) -> np.ndarray:
        return np.ones((*tx_positions.shape[:2], rx_positions.shape[1], len(points)), dtype=bool)
