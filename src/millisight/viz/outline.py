"""What a mesh looks like as a line drawing: its silhouette, its inner lines, and its cross-sections.

Views are those of the figures: along z from above (x to the right, y up), along y from the front (x and z), along
x from the right (y and z).
"""

import numpy as np

from millisight.errors import UnknownNameError
from millisight.records import record
from millisight.scene.mesh import TriangleMesh

PLANE = {"z": (0, 1), "y": (0, 2), "x": (1, 2)}
"""The coordinates to the right and up in a view along each axis."""

_TOWARDS_VIEWER = {"z": 1.0, "y": -1.0, "x": 1.0}
_PIXELS = 800  # along the longer side of a view
_CREASE_DEG = 35.0
_SHORTEST_CURVE = 12  # pixels
_SHORTEST_LINE = 0.12  # of the view
_TANGLED = 8.0  # length over reach; a circle drawn twice has 4.4
_BLOCK = 2_000_000  # pixels looked at together


@record
class Outline:
    """A mesh seen along an axis.

    Attributes
    ----------
    silhouette : closed curves (n, 2) around what the mesh covers, and around its holes [m]
    inner : (m, 2, 2) visible segments inside: where a part hides another, and creases [m]
    """

    silhouette: tuple[np.ndarray, ...]
    inner: np.ndarray


def checked_axis(axis: str) -> str:
    """`axis` if it is "x", "y" or "z".

    Raises
    ------
    UnknownNameError
    """
    if axis not in PLANE:
        raise UnknownNameError("axis", axis, PLANE)
    return axis


def outline_of(mesh: TriangleMesh, axis: str) -> Outline:
    """The line drawing of a mesh seen along "x", "y" or "z".

    The silhouette is traced on a raster of 800 pixels along the longer side, whose borders are the mesh's
    bounds: it is closed and clean however rough the mesh, and within a pixel of the truth. Holes smaller than
    1.5 % of the view, and inner lines shorter than 12 % of it, are left out as roughness.
    """
    plane = list(PLANE[checked_axis(axis)])
    lower, upper = mesh.bounds[:, plane]
    extent = upper - lower
    counts = np.maximum(np.round(extent / extent.max() * _PIXELS), 1).astype(int)
    pixel = np.where(extent > 0, extent, extent.max() / _PIXELS) / counts
    flat = (mesh.vertices[:, plane] - (lower + upper) / 2) / pixel + counts / 2  # pixel i spans i .. i + 1
    points = np.column_stack([flat, _TOWARDS_VIEWER[axis] * mesh.vertices[:, "xyz".index(axis)]])

    edges, first, second = _edges(mesh.faces)
    rims = second < 0
    height = _height_map(points, mesh.faces, edges[rims], counts)
    curves = _traced(np.isfinite(height))
    silhouette = tuple((curve - counts / 2) * pixel + (lower + upper) / 2 for curve in curves)

    facing = mesh.face_normals[:, "xyz".index(axis)] * _TOWARDS_VIEWER[axis]
    normals = mesh.face_normals
    cosines = np.einsum("ei,ei->e", normals[first], normals[second])
    occluding = (facing[first] > 0) != (facing[second] > 0)
    drawn = edges[rims | occluding | (cosines < np.cos(np.radians(_CREASE_DEG)))]
    drawn = drawn[_visible_inside(points, drawn, height, pixel.max())]
    inner = mesh.vertices[:, plane][_long_chains(mesh.vertices, drawn, _SHORTEST_LINE * extent.max())]
    return Outline(silhouette=silhouette, inner=inner)


def cross_section(mesh: TriangleMesh, axis: str, at: float) -> np.ndarray:
    """(n, 2, 2) segments in which the plane `axis` = `at` [m] cuts the mesh, as seen along the axis [m]."""
    plane = list(PLANE[checked_axis(axis)])
    corners = mesh.vertices[mesh.faces]
    height = corners[..., "xyz".index(axis)] - at
    above = height >= 0
    cut = above.any(axis=1) & ~above.all(axis=1)  # then two of the three sides cross the plane
    corners, height, above = corners[cut][..., plane], height[cut], above[cut]
    next_corners, next_height = np.roll(corners, -1, axis=1), np.roll(height, -1, axis=1)
    crossing = above != np.roll(above, -1, axis=1)
    share = height[crossing] / (height[crossing] - next_height[crossing])
    points = corners[crossing] + share[:, None] * (next_corners[crossing] - corners[crossing])
    return points.reshape(-1, 2, 2)


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every edge once (E, 2), one of its faces (E,), and the other; -1 unless it has exactly two faces."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort(sides.T)
    sides, owner = sides[order], owner[order]
    starts = np.flatnonzero(np.r_[True, (sides[1:] != sides[:-1]).any(axis=1)])
    count = np.diff(np.r_[starts, len(sides)])
    second = np.where(count == 2, owner[np.minimum(starts + 1, len(owner) - 1)], -1)
    return sides[starts], owner[starts], second


def _height_map(points: np.ndarray, faces: np.ndarray, rims: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Height towards the viewer of the foremost surface at every pixel; -inf where there is none."""
    height = np.full(counts, -np.inf)
    corners = points[faces]
    low = np.clip(np.ceil(corners[..., :2].min(axis=1) - 0.5), 0, counts).astype(int)
    high = np.clip(np.floor(corners[..., :2].max(axis=1) - 0.5) + 1, 0, counts).astype(int)
    spans = np.maximum(high - low, 0)
    sizes = spans.prod(axis=1)
    ends = np.cumsum(sizes)
    start = 0
    while start < len(faces):
        done = ends[start] - sizes[start]
        stop = max(start + 1, int(np.searchsorted(ends, done + _BLOCK)))
        block = np.arange(start, stop)
        face = np.repeat(block, sizes[block])
        number = np.arange(len(face)) - np.repeat(ends[block] - sizes[block] - done, sizes[block])
        i = low[face, 0] + number // np.maximum(spans[face, 1], 1)
        j = low[face, 1] + number % np.maximum(spans[face, 1], 1)
        _raise(height, corners[face], i, j)
        start = stop
    # A surface seen edge-on covers no pixel's centre: its rim does.
    if len(rims):
        steps = int(np.clip(np.ceil(np.abs(np.diff(points[rims][..., :2], axis=1)).max()), 1, _PIXELS)) + 1
        share = np.linspace(0, 1, steps)[:, None, None]
        along = ((1 - share) * points[rims[:, 0]] + share * points[rims[:, 1]]).reshape(-1, 3)
        i, j = np.clip(along[:, :2].astype(int), 0, counts - 1).T
        np.maximum.at(height, (i, j), along[:, 2])
    return height


def _raise(height: np.ndarray, corners: np.ndarray, i: np.ndarray, j: np.ndarray) -> None:
    """Raise `height` at the pixels (i, j) whose centres lie within their triangle (n, 3, 3)."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = np.moveaxis(corners, 0, -1)
    px, py = i + 0.5, j + 0.5
    twice_area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    solid = np.abs(twice_area) > 1e-12
    divisor = np.where(solid, twice_area, 1.0)
    b = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) / divisor
    c = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / divisor
    inside = solid & (b >= -1e-9) & (c >= -1e-9) & (b + c <= 1 + 1e-9)
    depth = az + b * (bz - az) + c * (cz - az)
    np.maximum.at(height, (i[inside], j[inside]), depth[inside])


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
