"""A mesh as evenly spread samples with normals, for comparing it with oriented points."""

from typing import NamedTuple

import numpy as np

from millisight.core.errors import MeshError
from millisight.data import TriangleMesh
from millisight.meshes import LIFT, RayCaster

_DRAWN = 20_000  # points from which evenly spread ones are chosen
_SEED = 0  # of the points: the same mesh has the same samples
_SMOOTHED = 0.004  # radius over which normals are averaged [m]: a wave sees no finer relief


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
    """

    points: np.ndarray
    normals: np.ndarray
    clear: np.ndarray
    middle: np.ndarray
    radius: float
    closed: bool
    spacing: float
    corners: np.ndarray


def samples_of(mesh: TriangleMesh, count: int) -> MeshSamples:
    """About `count` samples of the whole surface.

    Raises
    ------
    MeshError
        The mesh is flat to nothing.
    """
    from scipy.spatial import KDTree

    corners = mesh.vertices[mesh.faces]
    crosses = mesh.face_crosses
    areas = np.linalg.norm(crosses, axis=1)
    generator = np.random.default_rng(_SEED)
    face = generator.choice(len(areas), _DRAWN, p=areas / areas.sum())
    u, v = np.sqrt(generator.random(_DRAWN)), generator.random(_DRAWN)
    places = np.einsum("ni,nij->nj", np.stack([1 - u, u * (1 - v), u * v], axis=1), corners[face])
    facing = crosses[face] / areas[face, None]
    middle = places.mean(axis=0)
    radius = float(np.linalg.norm(mesh.vertices[np.unique(mesh.faces)] - middle, axis=1).max())
    if not radius > 0:
        raise MeshError("the mesh is a single point; expected a surface: check the export's scale and unit")
    spacing = np.sqrt(mesh.area / count)
    chosen = _even(places, facing, spacing)
    tree = KDTree(places)
    smooth = np.zeros((len(chosen), 3))
    for n, near in enumerate(tree.query_ball_point(places[chosen], min(_SMOOTHED, spacing))):
        alike = facing[near] @ facing[chosen[n]] > 0.5
        smooth[n] = facing[near][alike].sum(axis=0)
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    points = places[chosen]
    apart = float(np.sqrt(mesh.area / len(points)))
    closed = not (mesh.edge_faces[2] < 0).any()
    if not closed:
        points, smooth = np.concatenate([points, points]), np.concatenate([smooth, -smooth])
    lifted = points + max(20 * LIFT, 1e-3 * radius) * smooth
    clear = RayCaster.of([mesh]).first(lifted, smooth)[0] < 0
    return MeshSamples(
        points, smooth, clear, middle, radius, closed, apart, _corners(mesh.vertices[np.unique(mesh.faces)])
    )


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
