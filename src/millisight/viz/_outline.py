"""What a mesh looks like as a line drawing: its silhouette, its inner lines, and its cross-sections.

Views are those of the figures: along z from above (x to the right, y up), along y from the front (x and z), along
x from the right (y and z).
"""

from functools import lru_cache
from typing import Any

import numpy as np

from millisight.core import check_known, record
from millisight.data import TriangleMesh

PLANE = {"z": (0, 1), "y": (0, 2), "x": (1, 2)}
"""The coordinates to the right and up in a view along each axis."""

TOWARDS_VIEWER = {"z": 1.0, "y": -1.0, "x": 1.0}
"""The viewer stands above, before the front, and to the right."""

LIGHT = np.array([-0.4, 0.5, 0.77]) / np.linalg.norm([-0.4, 0.5, 0.77])
"""Where light comes from in a view: right, up, towards the viewer."""

_PIXELS = 800  # along the longer side of a view
_CREASE_DEG = 35.0
_SHORTEST_CURVE = 12  # pixels
_SHORTEST_LINE = 0.12  # of the view
_TANGLED = 8.0  # length over reach; a circle drawn twice has 4.4


@record
class Outline:
    """A mesh seen along an axis."""

    silhouette: tuple[np.ndarray, ...]  # (n, 2) closed, around what the mesh covers, and around holes [m]
    inner: np.ndarray  # (m, 2, 2) visible segments inside: where a part hides another, and creases [m]


def checked_axis(axis: str) -> str:
    """`axis` if it is "x", "y" or "z"."""
    check_known("axis", axis, PLANE)
    return axis


def outline_of(mesh: TriangleMesh, axis: str) -> Outline:
    """The line drawing of a mesh seen along "x", "y" or "z".

    The silhouette is traced on a raster of 800 pixels along the longer side, whose borders are the mesh's
    bounds: it is closed and clean however rough the mesh, and within a pixel of the truth. Holes smaller than
    1.5 % of the view, and inner lines shorter than 12 % of it, are left out as roughness.
    """
    return _outline(mesh, checked_axis(axis))


@lru_cache(maxsize=3)  # the views of a mesh, which several figures draw one after another
def _outline(mesh: TriangleMesh, axis: str) -> Outline:
    points, counts, pixel, middle = _on_raster(mesh, axis, _PIXELS)
    edges, first, second = mesh.edge_faces
    rims = second < 0
    height = _height_map(points, mesh.faces, edges[rims], counts)
    curves = _traced(np.isfinite(height))
    silhouette = tuple((curve - counts / 2) * pixel + middle for curve in curves)

    facing = mesh.face_normals[:, "xyz".index(axis)] * TOWARDS_VIEWER[axis]
    normals = mesh.face_normals
    cosines = np.einsum("ei,ei->e", normals[first], normals[second])
    occluding = (facing[first] > 0) != (facing[second] > 0)
    drawn = edges[rims | occluding | (cosines < np.cos(np.radians(_CREASE_DEG)))]
    drawn = drawn[_visible_inside(points, drawn, height, pixel.max())]
    longest = float((counts * pixel).max())
    inner = mesh.vertices[:, list(PLANE[axis])][_long_chains(mesh.vertices, drawn, _SHORTEST_LINE * longest)]
    return Outline(silhouette=silhouette, inner=inner)


def cross_section(mesh: TriangleMesh, axis: str, at: float) -> np.ndarray:
    """(n, 2, 2) segments in which the plane `axis` = `at` [m] cuts the mesh, as seen along the axis [m]."""
    from trimesh import Trimesh
    from trimesh.intersections import mesh_plane

    normal = np.eye(3)["xyz".index(checked_axis(axis))]
    solid = Trimesh(mesh.vertices, mesh.faces, process=False)
    lines: Any = mesh_plane(solid, normal, at * normal)
    return lines[..., list(PLANE[axis])]


def relief(mesh: TriangleMesh, axis: str, pixels: int) -> np.ndarray:
    """(U, V) how bright a mesh is lit, seen along an axis: 0 to 1, NaN beside it; `pixels` along the longer side."""
    points, counts, _, _ = _on_raster(mesh, axis, pixels)
    height = _height_map(points, mesh.faces, np.empty((0, 2), dtype=int), counts)
    covered = np.isfinite(height)
    longest = float(np.ptp(mesh.bounds, axis=0).max())
    smooth = np.where(covered, height, height[covered].min() if covered.any() else 0.0) * pixels / longest
    slopes: Any = np.gradient(np.pad(smooth, 1, mode="edge"))
    right, up = (slope[1:-1, 1:-1] for slope in slopes)
    light = np.stack([-right, -up, np.ones_like(up)], axis=-1) @ LIGHT / np.sqrt(right**2 + up**2 + 1)
    return np.where(covered, 0.35 + 0.65 * np.clip(light, 0, 1), np.nan)


def _on_raster(mesh: TriangleMesh, axis: str, pixels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A raster around a mesh: vertices (V, 3) in pixels and towards the viewer, counts, pixel and middle (2,) [m]."""
    plane = list(PLANE[checked_axis(axis)])
    lower, upper = mesh.bounds[:, plane]
    extent = upper - lower
    counts = np.maximum(np.round(extent / extent.max() * pixels), 1).astype(int)
    pixel = np.where(extent > 0, extent, extent.max() / pixels) / counts
    middle = (lower + upper) / 2
    flat = (mesh.vertices[:, plane] - middle) / pixel + counts / 2  # pixel i spans i .. i + 1
    towards = TOWARDS_VIEWER[axis] * mesh.vertices[:, "xyz".index(axis)]
    return np.column_stack([flat, towards]), counts, pixel, middle


def _height_map(points: np.ndarray, faces: np.ndarray, rims: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Height towards the viewer of the foremost surface at every pixel; -inf where there is none."""
    from millisight.viz._raster_kernels import raise_to

    height = np.full(tuple(counts), -np.inf)
    raise_to(height, np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(faces, dtype=np.int64))
    # A surface seen edge-on covers no pixel's centre: its rim does.
    if len(rims):
        steps = int(np.clip(np.ceil(np.abs(np.diff(points[rims][..., :2], axis=1)).max()), 1, _PIXELS)) + 1
        share = np.linspace(0, 1, steps)[:, None, None]
        along = ((1 - share) * points[rims[:, 0]] + share * points[rims[:, 1]]).reshape(-1, 3)
        i, j = np.clip(along[:, :2].astype(int), 0, counts - 1).T
        np.maximum.at(height, (i, j), along[:, 2])
    return height


def _traced(covered: np.ndarray) -> list[np.ndarray]:
    """Closed curves (n, 2) around the pixels that are covered, in pixels, staircases smoothed."""
    from contourpy import contour_generator  # Matplotlib's own contour tracer, installed with it
    from matplotlib import rc_context
    from matplotlib.path import Path
    from scipy.ndimage import gaussian_filter

    pad = 4
    # Blurred less where the view is only a few pixels thin, lest it vanish.
    sigma = min(1.0, min(covered.shape) / 6)
    soft = gaussian_filter(np.pad(covered, pad).astype(float), sigma, mode="constant")
    curves = [np.asarray(curve) for curve in contour_generator(z=soft.T).lines(0.5)]
    with rc_context({"path.simplify": True, "path.simplify_threshold": 0.1}):
        simple = [
            Path(curve).cleaned(simplify=True) for curve in curves if np.ptp(curve, axis=0).max() > _SHORTEST_CURVE
        ]
    return [np.asarray(path.vertices)[path.codes != Path.STOP] - pad + 0.5 for path in simple]


def _visible_inside(points: np.ndarray, edges: np.ndarray, height: np.ndarray, pixel: float) -> np.ndarray:
    """(E,) bool: whether an edge's middle is seen by the viewer, and lies inside the silhouette."""
    from scipy.ndimage import binary_erosion, minimum_filter

    if not len(edges):
        return np.zeros(0, dtype=bool)
    middles = points[edges].mean(axis=1)
    i, j = np.clip(middles[:, :2].astype(int), 0, np.array(height.shape) - 1).T
    inside = binary_erosion(np.isfinite(height), iterations=4)[i, j]
    return inside & (middles[:, 2] >= minimum_filter(height, size=3)[i, j] - 2 * pixel)


def _long_chains(vertices: np.ndarray, edges: np.ndarray, shortest: float) -> np.ndarray:
    """Those edges (e, 2) that belong to a connected line that reaches over `shortest` [m] or more.

    Small tangles, such as a scan makes of print and rust, are left out; large ones, such as a mug's rim, are not.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(edges):
        return edges
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(vertices), len(vertices)))
    chain = connected_components(graph, directed=False)[1][edges[:, 0]]
    low, high = (np.full((chain.max() + 1, 3), sign * np.inf) for sign in (1, -1))
    for end in edges.T:
        np.minimum.at(low, chain, vertices[end])
        np.maximum.at(high, chain, vertices[end])
    reach = np.linalg.norm(high - low, axis=1)
    lengths = np.bincount(chain, weights=np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1))
    tangled = (lengths > _TANGLED * reach) & (reach < 4 * shortest)
    return edges[((reach >= shortest) & ~tangled)[chain]]
