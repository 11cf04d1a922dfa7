"""Sharp edges of meshes, and what they diffract beyond physical optics.

Physical optics gives an edge the wrong wave, since it ends the current there as if nothing happened. Ufimtsev's theory
adds the difference between the wave of a wedge and that of physical optics on the wedge's faces (P. Ya. Ufimtsev,
"Fundamentals of the Physical Theory of Diffraction", 2nd ed. 2014, chapters 3 and 4). In backscatter, at the angle φ
from the first face of a wedge of exterior angle α = n π, half the sum of both polarisations' coefficients is

    D(φ) = -sin(π/n) / n / (cos(π/n) - cos(2 φ / n)),     physical optics: D_0 = tan(φ) / 2 from a face that is seen,

and from the first face's share tan(α - φ) / 2 from the other's. An element of length dl adds

    (D - D_0) / (2 π) exp(-i k (r_t + r_r)) / (r_t r_r) dl.

What is left out: the two polarisations are not told apart (D is their mean: that of antennas at 45 degrees to the
edge); φ is taken in the plane across the edge, and D as if seen square to it; for a transmitter and a receiver apart
the direction between them counts; corners and waves from edge to edge are missing. Of other matter than metal, the
coefficient is multiplied by minus the reflection at normal incidence, a rule of thumb.
"""

import numpy as np

from millisight.core import record
from millisight.data import TriangleMesh


@record
class Edges:
    """E straight elements of edges."""

    middles: np.ndarray  # (E, 3) [m]
    along: np.ndarray  # (E, 3) unit vectors
    normals: np.ndarray  # (E, 3) outward, of the first face
    into: np.ndarray  # (E, 3) unit vectors from the edge into the first face
    others: np.ndarray  # (E, 3) normal of the second face; of the rim of an open surface, the only one's
    lengths: np.ndarray  # (E,) [m]
    openings: np.ndarray  # (E,) n, the exterior angle over pi; 2 for the rim of an open surface

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def lift(self) -> np.ndarray:
        """(E, 3) unit vectors that leave both faces."""
        return _unit(self.normals + self.others)


def sharp_edges(mesh: TriangleMesh, edge_deg: float, longest: float) -> Edges:
    """The convex edges of a mesh that turn by more than `edge_deg` [degrees], and the rims of an open one.

    They are cut into elements of at most `longest` [m]. An edge of three faces or more is left out.
    """
    # Vertices at one place are one vertex, whatever the file says.
    _, welded = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)
    faces, owner = mesh.faces, np.arange(len(mesh.faces))
    solid = np.linalg.norm(mesh.face_crosses, axis=1) > 0
    faces, owner = faces[solid], owner[solid]
    sides = np.concatenate([faces[:, [i, (i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    owner = np.tile(owner, 3)
    keys = np.sort(welded.reshape(-1)[sides[:, :2]], axis=1)
    order = np.lexsort(keys.T)
    keys, sides, owner = keys[order], sides[order], owner[order]
    first = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]).any(axis=1)])
    count = np.diff(np.r_[first, len(keys)])

    rims, pairs = first[count == 1], first[count == 2]
    normals, vertices = mesh.face_normals, mesh.vertices
    one, other = normals[owner[pairs]], normals[owner[pairs + 1]]
    turn = np.arccos(np.clip(np.einsum("ei,ei->e", one, other), -1, 1))
    beyond = vertices[sides[pairs + 1, 2]] - vertices[sides[pairs, 0]]
    convex = np.einsum("ei,ei->e", beyond, one) < 0
    kept = convex & (turn > np.radians(edge_deg))
    pairs, turn, other = pairs[kept], turn[kept], other[kept]

    chosen = np.r_[rims, pairs]
    start, stop, opposite = vertices[sides[chosen]].transpose(1, 0, 2)
    normal = normals[owner[chosen]]
    along = _unit(stop - start)
    others = np.concatenate([normal[: len(rims)], other])
    openings = np.r_[np.full(len(rims), 2.0), 1 + turn / np.pi]
    # The third corner tells on which side of the edge the face lies.
    into = _unit((opposite - start) - np.einsum("ei,ei->e", opposite - start, along)[:, None] * along)

    lengths = np.linalg.norm(stop - start, axis=1)
    pieces = np.maximum(np.ceil(lengths / longest), 1).astype(int)
    edge = np.repeat(np.arange(len(chosen)), pieces)
    piece = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    middles = start[edge] + ((piece + 0.5) / pieces[edge])[:, None] * (stop - start)[edge]
    return Edges(
        middles=middles, along=along[edge], normals=normal[edge], into=into[edge], others=others[edge],
        lengths=(lengths / pieces)[edge], openings=openings[edge],
    )  # fmt: skip


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
