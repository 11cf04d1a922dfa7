"""The triangle mesh record, and what follows from its geometry alone."""

from typing import Any

import numpy as np

from millisight.core import box, checked_array, late, put, record
from millisight.core.errors import MeshError
from millisight.data._reach import check_reach


@record
class TriangleMesh:
    """A triangle mesh in metres.

    Attributes
    ----------
    vertices : (V, 3) float64 [m]
    faces : (F, 3) int64, indices into `vertices`, counter-clockwise seen from outside

    Raises
    ------
    InputError
        A shape does not fit, or a vertex is NaN or infinite.
    MeshError
        A face names a vertex that is not there, every face has zero area, or the mesh is as large as a planet.
    """

    vertices: np.ndarray
    faces: np.ndarray

    def __post_init__(self) -> None:
        vertices = checked_array(self.vertices, name="vertices", shape=("V", 3), unit="m")
        check_mesh_reach(vertices, "the mesh")
        faces = checked_array(self.faces, name="faces", shape=("F", 3), dtype=np.int64)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise MeshError(
                f"faces refer to vertices {faces.min()} to {faces.max()}; expected 0 to {len(vertices) - 1}: "
                "the mesh is damaged, export it again"
            )
        put(self, vertices=vertices, faces=faces)
        if not self.area > 0:
            raise MeshError("every face has zero area; expected a surface: check the export's scale and unit")

    def __repr__(self) -> str:
        return f"TriangleMesh({len(self.vertices)} vertices, {len(self.faces)} faces, {box(*self.bounds)})"

    def plot(self, **settings: Any) -> Any:
        """Plot the mesh as a shaded solid, seen along z, y and x.

        Parameters
        ----------
        settings : of `millisight.viz.plot_mesh`: `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_mesh")(self, **settings)

    def _repr_html_(self) -> str:
        return late("millisight.viz", "html_card")(self)

    @property
    def face_crosses(self) -> np.ndarray:
        """(F, 3) cross product of two sides of each face: along its outward normal, twice its area long [m²]."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return np.cross(b - a, c - a)

    @property
    def face_normals(self) -> np.ndarray:
        """(F, 3) outward unit normals; zero for a face without area."""
        return _unit(self.face_crosses)

    @property
    def vertex_normals(self) -> np.ndarray:
        """(V, 3) unit normals: the mean of the adjacent faces' normals, weighted by the angle at the vertex."""
        corners = self.vertices[self.faces]
        sides = _unit(np.roll(corners, -1, axis=1) - corners)
        cosines = -np.einsum("fij,fij->fi", sides, np.roll(sides, 1, axis=1))
        weights = np.arccos(np.clip(cosines, -1.0, 1.0))[..., None] * self.face_normals[:, None]
        normals = np.zeros_like(self.vertices)
        np.add.at(normals, self.faces, weights)
        return _unit(normals)

    @property
    def edges(self) -> np.ndarray:
        """(E, 2) vertex indices of every edge once, the smaller index first."""
        return np.unique(self._half_edges, axis=0)

    @property
    def edge_faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Every edge once (E, 2), one of its faces (E,), and the other one: -1 unless it has exactly two."""
        sides, owner = self._half_edges, np.repeat(np.arange(len(self.faces)), 3)
        order = np.lexsort(sides.T)
        sides, owner = sides[order], owner[order]
        starts = np.flatnonzero(np.r_[True, (sides[1:] != sides[:-1]).any(axis=1)])
        count = np.diff(np.r_[starts, len(sides)])
        second = np.where(count == 2, owner[np.minimum(starts + 1, len(owner) - 1)], -1)
        return sides[starts], owner[starts], second

    @property
    def _half_edges(self) -> np.ndarray:
        """(3F, 2) the three sides of each face, in the order (0-1, 1-2, 2-0) face after face, smaller index first."""
        return np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)

    @property
    def edge_lengths(self) -> np.ndarray:
        """(E,) length of every edge [m]."""
        start, stop = self.vertices[self.edges].transpose(1, 0, 2)
        return np.linalg.norm(stop - start, axis=1)

    @property
    def area(self) -> float:
        """Total surface [m²]."""
        return float(np.linalg.norm(self.face_crosses, axis=1).sum() / 2)

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) smallest and largest coordinates of the vertices that a face uses [m]."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def extent(self) -> np.ndarray:
        """(3,) size of the bounding box [m]."""
        lower, upper = self.bounds
        return upper - lower

    def sharp_vertices(self, edge_deg: float) -> np.ndarray:
        """(V,) bool: the set V_e of the paper's Eq. 7, vertices on an edge that turns by more than `edge_deg`.

        An edge turns by the angle between the outward normals of its two faces. The rim of an open surface, an
        edge of one face, or of three and more, counts as sharp: the surface ends or branches there.
        """
        edges, first, second = self.edge_faces
        normals = self.face_normals
        cosines = np.einsum("ei,ei->e", normals[first], normals[second])
        sharp = np.zeros(len(self.vertices), dtype=bool)
        sharp[edges[(second < 0) | (cosines < np.cos(np.radians(edge_deg)))]] = True
        return sharp

    def moved(self, *, rotation: np.ndarray | None = None, translation: np.ndarray | None = None) -> "TriangleMesh":
        """The mesh rotated by a (3, 3) matrix about the origin, then shifted by a (3,) vector [m]."""
        vertices = self.vertices
        if rotation is not None:
            vertices = vertices @ checked_array(rotation, name="rotation", shape=(3, 3)).T
        if translation is not None:
            vertices = vertices + checked_array(translation, name="translation", shape=(3,), unit="m")
        return TriangleMesh(vertices=vertices, faces=self.faces)


def check_mesh_reach(vertices: np.ndarray, name: str) -> None:
    """Refuse vertices beyond the reach of `check_reach`.

    Raises
    ------
    MeshError
    """
    check_reach(vertices, name, advice="it is damaged, export it again", error=MeshError)


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
