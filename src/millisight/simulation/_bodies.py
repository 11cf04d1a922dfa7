"""Closed bodies: a vertex whose faces all look away from an antenna lies behind its own body, and needs no ray."""

import numpy as np

from millisight.data import TriangleMesh

_GRAZING = 1e-5  # an antenna this little behind a face's plane may see it by rounding [m]


class Bodies:
    """The bodies that the faces of a mesh enclose, for what antennas cannot see of these."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self._faces, self._count = mesh.faces, len(mesh.vertices)
        self._normals = mesh.face_normals
        self._heights = np.einsum("fi,fi->f", self._normals, mesh.vertices[mesh.faces[:, 0]])
        self._part, self._closed = parts_of(mesh)

    def turned_away(self, antennas: np.ndarray) -> np.ndarray:
        """(V,) bool: vertices of closed bodies, all of whose faces look away from all antennas (..., 3) [m].

        Next to such a vertex, the way to an antenna runs inside the body, and so meets a face on its way out. Where a
        body crosses itself, parts of it may be inside out, of which this is not true: see `distrust`.
        """
        places = antennas.reshape(-1, 3)
        middle = places.mean(axis=0)
        around = np.linalg.norm(places - middle, axis=1).max()
        shown = ~self._closed[self._part] | (self._normals @ middle - self._heights >= -around - _GRAZING)
        away = np.ones(self._count, dtype=bool)
        away[self._faces[shown]] = False
        return away

    def distrust(self, vertices: np.ndarray) -> None:
        """Let no vertex of the bodies that these vertices (n,) belong to be turned away: they were, and were seen."""
        seen = np.zeros(self._count, dtype=bool)
        seen[vertices] = True
        self._closed[self._part[seen[self._faces].any(axis=1)]] = False


def parts_of(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """(F,) which part of the mesh a face belongs to, and (parts,) bool, which of them enclose a volume, facing outward.

    Each side of such a part's faces is run through once each way, and its volume is positive.
    """
    from scipy.sparse import coo_array  # not for --help
    from scipy.sparse.csgraph import connected_components

    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there, back = sides @ [len(mesh.vertices), 1], sides @ [1, len(mesh.vertices)]
    known, first, number, count = np.unique(there, return_index=True, return_inverse=True, return_counts=True)
    reverse = np.minimum(np.searchsorted(known, back), len(known) - 1)
    paired = (known[reverse] == back) & (count[number] == 1) & (count[reverse] == 1)

    owner = np.arange(len(sides)) // 3
    links = coo_array((np.ones(len(sides), dtype=np.int8), (owner, owner[first[reverse]])), shape=(owner[-1] + 1,) * 2)
    part = connected_components(links, directed=False)[1]
    unpaired = np.bincount(part, ~paired.reshape(-1, 3).all(axis=1))
    volumes = np.bincount(part, np.linalg.det(mesh.vertices[mesh.faces] - mesh.bounds.mean(axis=0)))
    return part, (unpaired == 0) & (volumes > 0)
