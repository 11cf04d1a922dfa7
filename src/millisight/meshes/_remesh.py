"""Evenly spaced meshes: approximated centroidal Voronoi clustering, on the surface itself.

The steps of `resample`, after Valette & Chassery, "Approximated centroidal Voronoi diagrams for uniform
polygonal mesh coarsening" (2004), and Valette, Chassery & Prost, "Generic remeshing of 3D triangular meshes
with metric-dependent discrete Voronoi diagrams" (2008):

1. split long edges until the mesh has ten vertices or more for each one asked for (`subdivide`);
2. cluster these fine vertices, one cluster for each vertex asked for, along mesh edges only, so that the two
   sides of a thin wall never merge (`_seeds`, `_grow`, `_settle`);
3. join clusters: three that meet in a fine face make a triangle (`_triangles`);
4. place each cluster's vertex where it fits the planes of the cluster's faces best, so that sharp rims stay
   sharp (`_placed`), and give back the little volume that a coarser mesh loses (`polish`).

Everything is deterministic. numba compiles the inner loops: import this module only where it is needed.
"""

import logging
from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from millisight.core import serial
from millisight.core.errors import InputError, MeshError
from millisight.data import TriangleMesh
from millisight.meshes._polish import caps_turned, part_volumes, summed, unit, volume_kept
from millisight.meshes._subdivide import SIDES, rolled, side_codes, split_long_edges

logger = logging.getLogger(__name__)

FINENESS = 10  # fine vertices for each cluster, at least: fewer, and the cells of the clusters turn ragged
FEWEST, MOST = 100, 2_000_000  # vertices that one may ask for
SWEEPS = 100  # over all edges while settling, at most; 30 to 60 are the rule
MEND_ROUNDS = 12  # of splitting clusters that meet each other twice
ATTEMPTS = 3  # at meeting the number of vertices asked for
EXCESS = 4  # times as many, at most: a mesh of slivers never meets it
MERGE_ROUNDS = 3  # of joining clusters whose vertices nearly coincide
SPARE = 200_000  # fine vertices above four times as many as clusters need: of long, thin faces, 2 kB each
CLOSEST = 0.15  # spacing between neighbours below which their clusters are joined
STIFFNESS = 0.003  # pull of a cluster's centre on its vertex, as a share of the pull of its planes


def resample(
    mesh: TriangleMesh, vertices: int = 10_000, *, progress: Callable[[int, int], None] | None = None
) -> TriangleMesh:
    """An evenly spaced mesh of about `vertices` vertices over the same surface.

    The standard deviation of the edge lengths is 0.15 to 0.3 of their mean, whatever the faces of `mesh` look like.
    Rims and corners stay sharp, and a closed mesh stays closed. What is smaller than the new spacing is lost.

    Parameters
    ----------
    mesh : closed or open, wound consistently (`load_mesh` sees to it)
    vertices : how many to aim at, 100 to 2 million; met within 2 % unless most of the surface is slivers
    progress : called with (steps done, steps in all)

    Raises
    ------
    InputError
        `vertices` is no whole number, below 100, or above 2 million.
    MeshError
        The mesh falls apart into pieces smaller than the new spacing, or has faces too long and thin to be split.
    """
    if isinstance(vertices, bool) or not isinstance(vertices, int | np.integer) or vertices < FEWEST:
        raise InputError(
            f"vertices is {vertices!r}; expected a whole number of at least {FEWEST}: fewer cannot carry the shape "
            "of an everyday object. 10000 is the usual choice"
        )
    if vertices > MOST:
        raise InputError(f"vertices is {vertices!r}; expected at most {MOST}; 10000 is the usual choice")
    count = int(vertices)
    tell = progress or (lambda done, total: None)

    # Mending and lost parts change the count a little: where it is off by more than 1.5 %, ask again.
    ask = count
    for attempt in range(ATTEMPTS):
        result = _resampled(mesh, ask, lambda done, start=5 * attempt: tell(start + done, 5 * ATTEMPTS))
        ask = min(EXCESS * count, max(FEWEST // 2, round(ask * count / len(result.vertices))))
        if abs(len(result.vertices) - count) <= 0.015 * count:
            break
    tell(5 * ATTEMPTS, 5 * ATTEMPTS)
    return result


def _resampled(mesh: TriangleMesh, count: int, tell: Callable[[int], None]) -> TriangleMesh:
    # In units of the new spacing about the middle of the object, so that every tolerance below is a pure number.
    spacing = np.sqrt(mesh.area / count * 2 / np.sqrt(3))
    middle = mesh.bounds.mean(axis=0)
    surface = _Surface(*_refined((mesh.vertices - middle) / spacing, mesh.faces, count))
    tell(1)

    labels = _seeds(surface, count)
    _grow(surface.start, surface.neighbours, labels)
    tell(2)

    _settle_connected(surface, labels)
    tell(3)

    triangles, points = _mended(surface, labels), _placed(surface, labels)
    for _ in range(MERGE_ROUNDS):
        if not _merge_close(labels, points, triangles):
            break
        triangles, points = _mended(surface, labels), _placed(surface, labels)
    tell(4)

    triangles = caps_turned(points, triangles)
    part = np.zeros(len(points), dtype=np.int64)
    part[labels[labels >= 0]] = surface.part[labels >= 0]
    points = volume_kept(points, triangles, part, surface.volumes)
    used, triangles = np.unique(triangles, return_inverse=True)
    if not len(used):
        raise MeshError(f"the mesh falls apart into pieces that are all too small for {count} vertices; ask for more")
    lost = surface.part.max() + 1 - len(np.unique(part[used]))
    if lost:
        logger.warning("%d separate parts of the mesh are smaller than its new spacing and are left out", lost)
    tell(5)
    return TriangleMesh(vertices=points[used] * spacing + middle, faces=triangles.reshape(-1, 3))


class _Surface:
    """The fine mesh, and what the clustering asks of it again and again."""

    def __init__(self, points: np.ndarray, faces: np.ndarray):
        self.points, self.faces = points, faces
        a, b, c = (points[faces[:, k]] for k in range(3))
        self.crosses = np.cross(b - a, c - a)
        self.areas = np.linalg.norm(self.crosses, axis=1) / 2
        weights = np.bincount(faces.ravel(), np.repeat(self.areas / 3, 3), minlength=len(points))
        # A vertex among slivers must not be weightless: a cluster of such vertices would have no centre.
        self.weights = np.maximum(weights, 1e-6 * weights.mean())
        sides = faces[:, SIDES].reshape(-1, 2)
        _, side, owners = np.unique(side_codes(sides), return_index=True, return_counts=True)
        self.edges = np.sort(sides[side], axis=1)
        self.rim, self.rim_faces = self.edges[owners == 1], side[owners == 1] // 3
        graph = _graph(self.edges, len(points))
        self.part = connected_components(graph, directed=False)[1]
        self.volumes = part_volumes(points, faces, self.part, self.part.max() + 1)
        self.volumes[self.part[self.rim]] = np.nan  # an open part has none
        both_ways = (graph + graph.T).tocsr()
        self.start, self.neighbours = both_ways.indptr.astype(np.int64), both_ways.indices.astype(np.int64)


def _graph(edges: np.ndarray, count: int) -> coo_array:
    return coo_array((np.ones(len(edges), dtype=np.int8), edges.T), shape=(count, count))


def _refined(points: np.ndarray, faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The same surface with edges of half a spacing or less, and at least `FINENESS * count` vertices."""
    used, faces = np.unique(faces, return_inverse=True)
    points, faces = points[used], faces.reshape(-1, 3)
    longest = 0.5
    _check_size(points, faces, longest, count)
    while True:
        points, faces = split_long_edges(points, faces, longest)
        if len(points) >= FINENESS * count:
            return points, faces
        longest *= 0.8


def _check_size(points: np.ndarray, faces: np.ndarray, longest: float, count: int) -> None:
    """Raise where long, thin faces would be split into far more vertices than clusters need, as beside a stray vertex.

    A face is halved until its shortest side is short enough; its long sides are then cut into pieces as they are.
    """
    a, b, c = (points[faces[:, k]] for k in range(3))
    sides = np.sort(np.linalg.norm([b - a, c - b, a - c], axis=2), axis=0) / longest
    pieces = 2.0 ** np.ceil(np.log2(np.maximum(sides[0], 1))) * (sides[1] + sides[2]) / 2
    expected, most = pieces.sum() + len(points), 4 * FINENESS * count + SPARE + 4 * len(points)
    if not expected <= most:
        slender = sides[2, worst := int(pieces.argmax())] / max(sides[0, worst], 1e-9)
        raise MeshError(
            f"resampling would take {expected:.3g} points, {most:.3g} at most: faces like {worst} are {slender:.3g} "
            "times as long as wide; remove stray vertices, ask for fewer, or take the mesh as it is (vertices=None)"
        )


# 2. The clusters -----------------------------------------------------------------------------------------------


def _seeds(surface: _Surface, count: int) -> np.ndarray:
    """(V,) labels, -1 but for one vertex of each cluster: equal shares of the area along a Morton curve."""
    lower = surface.points.min(axis=0)
    cells = ((surface.points - lower) / np.ptp(surface.points, axis=0).max() * (2**20 - 1)).astype(np.int64)
    code = np.zeros(len(cells), dtype=np.int64)
    for bit in range(20):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    # Part after part, so that each part has its share whatever else is near.
    order = np.lexsort((code, surface.part))
    total = np.cumsum(surface.weights[order])
    number = np.arange(count)
    at = np.searchsorted(total, (number + 0.5) / count * total[-1])
    # Two seeds on one heavy vertex: move on to the next ones.
    at = np.minimum(np.maximum.accumulate(at - number), len(order) - count) + number
    labels = np.full(len(order), -1)
    labels[order[at]] = number
    return labels


@serial()
def _grow(start, neighbours, labels):
    """Give every vertex without a label (-1) that of a nearest labelled one, counted in edges."""
    queue = np.empty(len(labels), dtype=np.int64)
    head = tail = 0
    for v in range(len(labels)):
        if labels[v] >= 0:
            queue[tail] = v
            tail += 1
    while head < tail:
        v = queue[head]
        head += 1
        for k in range(start[v], start[v + 1]):
            u = neighbours[k]
            if labels[u] < 0:
                labels[u] = labels[v]
                queue[tail] = u
                tail += 1


def _settle_connected(surface: _Surface, labels: np.ndarray) -> None:
    """Settle the clusters, and leave every one of them connected."""
    for _ in range(4):
        _settle(surface.edges, surface.points, surface.weights, labels, SWEEPS)
        if not _reattach_loose(surface, labels):
            return


@serial()
def _merit(mass, moment, weight, point):
    """|sum w x|² / sum w of a cluster with `weight` at `point` added: its inertia falls as this grows."""
    square = 0.0
    for d in range(3):
        square += (moment[d] + weight * point[d]) ** 2
    return square / (mass + weight)


@serial()
def _settle(edges, points, weights, labels, sweeps):
    """Lower the clusters' moment of inertia: hand single vertices over their borders until none gains.

    This is Lloyd's relaxation done vertex by vertex: for each edge between clusters, either end may change sides.
    """
    count = labels.max() + 1
    mass, moment, size = np.zeros(count), np.zeros((count, 3)), np.zeros(count, dtype=np.int64)
    for v in range(len(labels)):
        if labels[v] >= 0:
            mass[labels[v]] += weights[v]
            moment[labels[v]] += weights[v] * points[v]
            size[labels[v]] += 1
    changed = np.zeros(count, dtype=np.int64)  # the sweep that last changed each cluster
    for sweep in range(1, sweeps + 1):
        still = True
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            i, j = labels[a], labels[b]
            if i == j or (changed[i] < sweep - 1 and changed[j] < sweep - 1):
                continue
            now = _merit(mass[i], moment[i], 0.0, points[a]) + _merit(mass[j], moment[j], 0.0, points[b])
            best, v, source, target = now * (1 + 1e-12), -1, i, j
            if size[i] > 1:
                without = _merit(mass[i], moment[i], -weights[a], points[a])
                merit = without + _merit(mass[j], moment[j], weights[a], points[a])
                if merit > best:
                    best, v = merit, a
            if size[j] > 1:
                without = _merit(mass[j], moment[j], -weights[b], points[b])
                merit = without + _merit(mass[i], moment[i], weights[b], points[b])
                if merit > best:
                    v, source, target = b, j, i
            if v < 0:
                continue
            labels[v] = target
            for cluster, sign in ((source, -1), (target, 1)):
                mass[cluster] += sign * weights[v]
                size[cluster] += sign
                for d in range(3):
                    moment[cluster, d] += sign * weights[v] * points[v, d]
                changed[cluster] = sweep
            still = False
        if still:
            return


def _reattach_loose(surface: _Surface, labels: np.ndarray) -> bool:
    """Keep the heaviest piece of each cluster, hand the others to their neighbours; True if there were any."""
    same = surface.edges[labels[surface.edges[:, 0]] == labels[surface.edges[:, 1]]]
    pieces, piece = connected_components(_graph(same, len(labels)), directed=False)
    owner = np.empty(pieces, dtype=np.int64)
    owner[piece] = labels
    order = np.lexsort((np.bincount(piece, surface.weights), owner))
    heaviest = np.zeros(pieces, dtype=bool)
    heaviest[order[np.r_[owner[order][1:] != owner[order][:-1], True]]] = True
    loose = ~heaviest[piece] & (labels >= 0)
    labels[loose] = -1
    _grow(surface.start, surface.neighbours, labels)
    return bool(loose.any())


# 3. The triangles ----------------------------------------------------------------------------------------------


def _triangles(surface: _Surface, labels: np.ndarray) -> np.ndarray:
    """(T, 3) clusters that meet three and three, once each, wound as the fine faces are."""
    corners = labels[surface.faces]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a) & (corners.min(axis=1) >= 0)]
    corners = rolled(corners, corners.argmin(axis=1))
    turned = np.where(corners[:, 1] < corners[:, 2], 1, -1)
    corners, which = np.unique(np.sort(corners, axis=1), axis=0, return_inverse=True)
    # Three clusters that meet twice, once each way round, enclose a pocket of which nothing else is left.
    net = np.bincount(which.ravel(), turned)
    return np.where(net[:, None] > 0, corners, corners[:, [0, 2, 1]])[net != 0]


def _mended(surface: _Surface, labels: np.ndarray) -> np.ndarray:
    """The triangles, after splitting clusters (in `labels`) until no two meet along more than one border.

    Two clusters that do, as where two half rings make up a thin rod, would be an edge of four triangles.
    """
    triangles = _triangles(surface, labels)
    for _ in range(MEND_ROUNDS):
        sides = np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1)
        pairs, owners = np.unique(sides, axis=0, return_counts=True)
        tangled = np.unique(pairs[owners > 2])
        if not len(tangled):
            break
        _halve(surface, labels, tangled)
        _reattach_loose(surface, labels)
        triangles = _triangles(surface, labels)
    return triangles


def _halve(surface: _Surface, labels: np.ndarray, clusters: np.ndarray) -> None:
    """Cut each of `clusters` in two across its longest direction; the far halves get new labels."""
    order = np.argsort(labels, kind="stable")
    first, last = np.searchsorted(labels[order], [clusters, clusters + 1])
    new = labels.max() + 1
    for members in (order[i:j] for i, j in zip(first, last, strict=True)):
        points, weights = surface.points[members], surface.weights[members]
        offsets = points - np.average(points, axis=0, weights=weights)
        far = offsets @ np.linalg.svd(offsets, full_matrices=False)[2][0] > 0
        if far.any():
            labels[members[far]] = new
            new += 1


# 4. The vertices -----------------------------------------------------------------------------------------------


def _placed(surface: _Surface, labels: np.ndarray) -> np.ndarray:
    """(clusters, 3) the point of each cluster with the least squared distance to the planes of its faces.

    The centre of the cluster pulls weakly, which settles what the planes leave open: where on a flat face, where
    along a sharp edge. A wall stands around the rim of an open surface, so that its outline keeps its place.
    """
    points, faces, rim = surface.points, surface.faces, surface.rim
    count = labels.max() + 1
    normals = unit(surface.crosses)
    walls = unit(np.cross(points[rim[:, 1]] - points[rim[:, 0]], normals[surface.rim_faces]))
    lengths = np.linalg.norm(points[rim[:, 1]] - points[rim[:, 0]], axis=1)

    owner = labels[np.concatenate([faces.T.ravel(), rim.T.ravel()])]
    normal = np.concatenate([np.tile(normals, (3, 1)), np.tile(walls, (2, 1))])
    foot = np.concatenate([np.tile(points[faces[:, 0]], (3, 1)), np.tile(points[rim[:, 0]], (2, 1))])
    pull = np.concatenate([np.tile(surface.areas, 3), np.tile(lengths, 2)])
    owner, normal, foot, pull = (rows[owner >= 0] for rows in (owner, normal, foot, pull))

    members = np.flatnonzero(labels >= 0)
    weights = surface.weights[members]
    centre = summed(labels[members], weights[:, None] * points[members], count)
    centre /= np.bincount(labels[members], weights, minlength=count)[:, None]
    distance = np.einsum("ki,ki->k", normal, foot - centre[owner])
    target = summed(owner, (pull * distance)[:, None] * normal, count)
    matrix = np.stack([summed(owner, (pull * normal[:, i])[:, None] * normal, count) for i in range(3)], axis=1)
    matrix += (1e-12 + STIFFNESS * np.trace(matrix, axis1=1, axis2=2))[:, None, None] * np.eye(3)
    step = np.linalg.solve(matrix, target[..., None])[..., 0]

    # Planes that are nearly parallel meet far away; the vertex stays within reach of its cluster.
    reach = np.zeros(count)
    np.maximum.at(reach, labels[members], np.linalg.norm(points[members] - centre[labels[members]], axis=1))
    length = np.linalg.norm(step, axis=1)
    return centre + step * np.minimum(1, reach / np.maximum(length, 1e-300))[:, None]


def _merge_close(labels: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> bool:
    """Join clusters (in `labels`) whose vertices nearly coincide, two and two; True if there were any."""
    pairs: np.ndarray = np.unique(np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1), axis=0)
    lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    order = np.argsort(lengths, kind="stable")[: len(points) // 300]
    close = pairs[order[lengths[order] < CLOSEST]]
    new = np.arange(len(points))
    free = np.ones(len(points), dtype=bool)
    for kept, gone in close:
        if free[kept] and free[gone]:
            new[gone] = kept
            free[[kept, gone]] = False
    known = labels >= 0
    labels[known] = np.unique(new[labels[known]], return_inverse=True)[1]
    return len(close) > 0
