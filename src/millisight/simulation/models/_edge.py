"""Edge: sharp rims answer in all directions."""

from typing import ClassVar

import numpy as np

from millisight.core import record
from millisight.data import TriangleMesh
from millisight.simulation._models import SCATTERING_MODELS, check_angle, parameter


@SCATTERING_MODELS.add("edge")
@record
class EdgeModel:
    """Vertices on sharp edges reflect (paper Eq. 7, primer 12).

    Attributes
    ----------
    edge_deg : an edge whose faces' normals are further apart is sharp [degrees]
    """

    name: ClassVar[str] = "edge"
    edge_deg: float = parameter(
        20.0, "Edge: two faces form an edge if the angle between their normals is larger [degrees]."
    )

    def __post_init__(self) -> None:
        check_angle(self.edge_deg, "edge_deg")

    def candidates(self, mesh: TriangleMesh) -> np.ndarray:
        return mesh.sharp_vertices(self.edge_deg)

    def weights(self, tx_positions, rx_positions, points, normals) -> np.ndarray:
        return np.ones((*tx_positions.shape[:2], rx_positions.shape[1], len(points)), dtype=bool)
