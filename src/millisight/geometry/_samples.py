"""A mesh as evenly spread samples with normals, for comparing it with oriented points."""

from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from millisight.core.errors import MeshError
from millisight.data import TriangleMesh
from millisight.meshes import LIFT, RayCaster

_DRAWN = 20_000  # points from which evenly spread ones are chosen
_FINEST = 1e-4  # spacing of samples over a mesh's radius: of triangles as thin as nothing
_MOST, _COARSER = (4, 8), 1.25  # samples on faces and at edges over those asked for; of more, the spacing grows so
_SEED = 0  # of the points: the same mesh has the same samples
_SMOOTHED = 0.004  # radius over which normals are averaged [m]: a wave sees no finer relief
_ALIKE = 0.5  # least cosine between normals that are averaged on a face
# Edges, chosen on development objects:
_CLOSE, _FEWEST = 0.0012, 4000  # how close the places lie of which those at edges are chosen [m]; the least of them
_NEAR = 200  # but of tiny and crumpled meshes fewer, so that no more lie within `_SMOOTHED` of another on average
_MEET = -0.3  # least cosine between normals that are averaged over an edge; those of a sheet's other side are not
_NEW = float(np.cos(np.radians(9.0)))  # most between a normal at an edge and those of samples near by
_FAN = 0.3  # between the normals of one edge


class MeshSamples(NamedTuple):
    """Evenly spread samples of a mesh.

    Attributes
    ----------
    points, normals : (K, 3) places [m], and outward unit normals; of an open mesh each place is there twice, facing
        either way
    clear : (K,) bool, whether the ray along the normal leaves the mesh for good: if not, no mirror's echo does
    middle : (3,) mean of the surface [m]
    radius : of the ball around `middle` that holds the mesh [m]
    closed : whether no edge is open
    spacing : of neighbouring samples [m]
    corners : (H, 3) of the convex hull, on which the mesh can lie [m]
    on_faces : how many samples lie on faces: the first ones; the others are those of edges
    """

    points: np.ndarray
    normals: np.ndarray
    clear: np.ndarray
    middle: np.ndarray
    radius: float
    closed: bool
    spacing: float
    corners: np.ndarray
    on_faces: int

    def without_edges(self) -> "MeshSamples":
        """Those on faces alone."""
        some = slice(self.on_faces)
        return self._replace(points=self.points[some], normals=self.normals[some], clear=self.clear[some])


def samples_of(mesh: TriangleMesh, count: int, *, edges: bool = False) -> MeshSamples:
    """About `count` samples of the whole surface; with `edges` those of edges and corners besides.

    An edge sends echoes back to all antennas across it, as a thin rod does. Its samples have all the normals that the
    surface turns through when its faces are averaged over 4 mm, and that no other sample near by has.

    Raises
    ------
    MeshError
        The mesh is flat to nothing.
    """
    places, facing = _drawn(mesh, _DRAWN)
    middle = places.mean(axis=0)
    radius = float(np.linalg.norm(mesh.vertices[np.unique(mesh.faces)] - middle, axis=1).max())
    if not radius > 0:
        raise MeshError("the mesh is a single point; expected a surface: check the export's scale and unit")
    spacing = max(float(np.sqrt(mesh.area / count)), _FINEST * radius)
    while len(chosen := _even(places, facing, spacing)) > _MOST[0] * count:
        spacing *= _COARSER
    points, normals = places[chosen], _averaged(places, facing, chosen, min(_SMOOTHED, spacing), _ALIKE)
    apart = float(np.sqrt(mesh.area / len(points)))
    closed = not (mesh.edge_faces[2] < 0).any()
    parts = [(points, normals), *([_edges(mesh, points, normals, spacing, _MOST[1] * count)] if edges else [])]
    if not closed:
        parts = [(np.concatenate([places, places]), np.concatenate([turned, -turned])) for places, turned in parts]
    points, normals = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    lifted = points + max(20 * LIFT, 1e-3 * radius) * normals
    clear = RayCaster.of([mesh]).first(lifted, normals)[0] < 0
    corners = _corners(mesh.vertices[np.unique(mesh.faces)])
    return MeshSamples(points, normals, clear, middle, radius, closed, apart, corners, len(parts[0][0]))


def _drawn(mesh: TriangleMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 3) places on a mesh, drawn by area, and the normals of their faces."""
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(mesh.face_crosses, axis=1)
    generator = np.random.default_rng(_SEED)
    face = generator.choice(len(areas), count, p=areas / areas.sum())
    u, v = np.sqrt(generator.random(count)), generator.random(count)
    places = np.einsum("ni,nij->nj", np.stack([1 - u, u * (1 - v), u * v], axis=1), corners[face])
    return places, mesh.face_crosses[face] / areas[face, None]


def _averaged(places: np.ndarray, facing: np.ndarray, chosen: np.ndarray, radius: float, least: float) -> np.ndarray:
    """Unit normals of chosen places: the sums of those within a radius whose cosine with their own is above `least`."""
    from scipy.spatial import KDTree

    own, near = _within(KDTree(places), places[chosen], radius)
    alike = np.einsum("ni,ni->n", facing[near], facing[chosen][own]) > least
    own, near = own[alike], near[alike]
    # One column at a time: the pairs are millions.
    sums = np.stack([np.bincount(own, facing[near, k], minlength=len(chosen)) for k in range(3)], axis=1)
    sizes = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(sizes > 1e-6, sums / np.maximum(sizes, 1e-6), facing[chosen])


def _within(tree: Any, places: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of places and of the tree's points in all pairs within a radius."""
    found = tree.query_ball_point(places, radius, return_sorted=False)
    counts = np.array([len(one) for one in found])
    return np.repeat(np.arange(len(places)), counts), np.fromiter(chain.from_iterable(found), np.int64, counts.sum())


def _edges(
    mesh: TriangleMesh, points: np.ndarray, normals: np.ndarray, spacing: float, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Places and normals at edges, that the samples of a surface, `spacing` apart, lack; `most` at most."""
    from scipy.spatial import KDTree

    places, facing = _drawn(mesh, int(np.clip(mesh.area / _CLOSE**2, _FEWEST, _DRAWN)))
    tree = KDTree(places)
    neighbours = tree.count_neighbors(tree, _SMOOTHED) / len(places)
    if neighbours > _NEAR:
        places, facing = _drawn(mesh, int(len(places) * _NEAR / neighbours))
    turned = _averaged(places, facing, np.arange(len(places)), _SMOOTHED, _MEET)
    own, near = _within(KDTree(points), places, spacing)
    alike = np.full(len(places), -1.0)
    np.maximum.at(alike, own, np.einsum("ni,ni->n", turned[own], normals[near]))
    new = alike < _NEW
    places, turned = places[new], turned[new]
    while len(first := _one_of_each(places, turned, spacing)) > most:
        spacing *= _COARSER
    return places[first], turned[first]


def _one_of_each(places: np.ndarray, turned: np.ndarray, spacing: float) -> np.ndarray:
    """Indices of one of the places in each cube with normals in each cube of them."""
    keys = np.column_stack([np.floor(places / spacing), np.round(turned / _FAN)]).astype(np.int64)
    return np.unique(keys, axis=0, return_index=True)[1]


def _corners(places: np.ndarray) -> np.ndarray:
    """Corners of the convex hull of places; of flat ones all places."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return places[ConvexHull(places).vertices]
    except QhullError:
        return places


def _even(places: np.ndarray, facing: np.ndarray, spacing: float) -> np.ndarray:
    """Indices of one place in each cube of side `spacing`, and of each side of a thin sheet."""
    cells = np.floor(places / spacing).astype(np.int64)
    # The two sides of a sheet within one cube face opposite octants.
    axis = np.abs(facing).argmax(axis=1)
    side = 2 * axis + (np.take_along_axis(facing, axis[:, None], axis=1)[:, 0] > 0)
    keys = np.column_stack([cells, side])
    return np.unique(keys, axis=0, return_index=True)[1]
