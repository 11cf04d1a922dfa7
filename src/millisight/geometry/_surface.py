"""From oriented points to a mesh: heights that agree with the points' places and whose slopes agree with their normals.

Points that hang together are a patch. Over the plane across a patch's mean normal the surface is a height h(u, v) on
square cells, which minimises (primer 24)

    sum over points (h - h_i)² / σ_i²  +  sum over pairs of neighbouring cells (Δh - g d)² / (d τ)²,

with g the slope of the normals around the pair, τ its standard deviation, and d the cells' spacing: the integral of the
normals, held in place by the points. Cells farther from every point than `reach` are not there, and holes stay open.
"""

from typing import Any, NamedTuple

import numpy as np

from millisight.core import checked_integer, checked_number, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import PixelGrid, PointCloud, Surface, TriangleMesh

_LINK = 2.5  # of the points' spacing: farther apart, two are of different patches
_REACH = 1.5  # of the points' spacing: cells so near to a point are part of the surface
_LEAST_SIGMA = 1e-4  # of a place [m]: of what is simulated without noise
_LEAST_SLOPE = 0.02  # standard deviation of a slope: a normal is known to a degree at best
_STEEPEST = 2.0  # slope of a normal against its patch's plane
_MOST_CELLS = 2_000_000
_FEW_CELLS, _MANY_CELLS, _CELLS_OF_A_POINT = 50_000, 500_000, 100  # that are solved for: a gigabyte for the many
_MOST_SIGMA = 1e6
_HEAPED, _NEAREST = 256, 64  # pairs of a point from which on those of so many neighbours alone are looked at
LEAST_POINTS = 12
"""Points that a patch of a surface has at least, where nothing else is asked for."""


def surface(
    points: PointCloud, *, spacing: float | None = None, least: int = LEAST_POINTS, reach: float | None = None
) -> Surface:
    """Make a mesh of oriented points: of what was seen, holes left open (primer 24).

    Points that hang together make a patch, and each patch a height over its own plane: by weighted least squares of the
    points' places and of the slopes that their normals state, each by its standard deviation.

    Parameters
    ----------
    points : with normals, as of `surface_points`
    spacing : of the mesh [m]; None: the points' own, their median distance to the nearest other one
    least : points of a patch; fewer are left out, as false alarms
    reach : how far the mesh goes on around a point [m]; None: 1.5 times the points' spacing

    Returns
    -------
    Surface
        `metadata["patches"]` counts the patches.

    Raises
    ------
    InputError
        The points have no normals, no patch has `least` of them, or the spacing is too fine for the size.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-0.02, 0.02, 21), np.linspace(-0.02, 0.02, 21))
    >>> points = np.stack([x.ravel(), y.ravel(), 0.1 * x.ravel()], axis=1)
    >>> normals = np.tile([-0.1, 0, 1] / np.sqrt(1.01), (len(points), 1))
    >>> made = surface(PointCloud(points=points, normals=normals))
    >>> print(f"{abs(made.mesh.vertices[:, 2] - 0.1 * made.mesh.vertices[:, 0]).max():.6f}")
    0.000000
    """
    cloud = checked_record(points, PointCloud, name="points")
    if cloud.normals is None:
        raise InputError("the points have no normals, of which a surface is made; pass those of surface_points")
    least = checked_integer(least, name="least", minimum=3)
    if len(cloud) < least:
        raise InputError(f"there are {len(cloud)} points; expected at least {least}: nothing of a surface was seen")
    apart = _spacing_of(cloud)
    step = apart if spacing is None else checked_number(spacing, name="spacing", unit="m", above=0)
    near = _REACH * apart if reach is None else checked_number(reach, name="reach", unit="m", above=0)
    patches = [
        made
        for which in _patches_of(cloud, _LINK * apart)
        if len(which) >= least and (made := _patch(cloud.chosen(which), step, near)) is not None
    ]
    if not patches:
        raise InputError(
            f"of {len(cloud)} points no {least} hang together within {1e3 * _LINK * apart:.2g} mm; expected points of "
            "a surface: use finer voxels, or more false alarms"
        )
    starts = np.cumsum([0, *(len(one.vertices) for one in patches)])
    mesh = TriangleMesh(
        vertices=np.concatenate([one.vertices for one in patches]),
        faces=np.concatenate([one.faces + start for one, start in zip(patches, starts, strict=False)]),
    )
    metadata = with_step(cloud.metadata, "surface", spacing=step, reach=near, least=least) | {"patches": len(patches)}
    return Surface(mesh=mesh, sigma=np.concatenate([one.sigma for one in patches]), metadata=metadata)


def depth_map(seen: Surface, grid: PixelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The height of a surface over each pixel of a grid, seen from above along z.

    Returns
    -------
    heights : (X, Y) z of the topmost point [m]; NaN where there is none
    sigma : (X, Y) its standard deviation [m]; NaN likewise
    """
    from millisight.meshes import RayCaster

    checked_record(seen, Surface, name="seen")
    checked_record(grid, PixelGrid, name="grid")
    x, y = (axis.ravel() for axis in np.meshgrid(grid.x, grid.y, indexing="ij"))
    top = float(seen.mesh.bounds[1, 2]) + 0.01
    starts = np.stack([x, y, np.full(len(x), top)], axis=1)
    caster = RayCaster(seen.mesh.vertices[seen.mesh.faces], centered=True)
    face, way = caster.first(starts, np.broadcast_to([0.0, 0.0, -1.0], starts.shape))
    hit = np.isfinite(way)
    sigma = np.where(hit, seen.sigma[seen.mesh.faces[np.where(hit, face, 0)]].mean(axis=1), np.nan)
    return np.where(hit, top - way, np.nan).reshape(grid.shape), sigma.reshape(grid.shape)


class _Patch(NamedTuple):
    vertices: np.ndarray
    faces: np.ndarray
    sigma: np.ndarray


def _spacing_of(cloud: PointCloud) -> float:
    """Median distance of the points to the nearest other one [m]."""
    from scipy.spatial import KDTree

    return float(np.median(KDTree(cloud.points).query(cloud.points, k=2)[0][:, 1])) or 1e-6


def _patches_of(cloud: PointCloud, link: float) -> list[np.ndarray]:
    """Indices of points that hang together: nearer than `link`, normals within a right angle.

    Where points are heaped so that pairs would fill the memory, those of the nearest of each count.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    normals = np.asarray(cloud.normals)
    tree = KDTree(cloud.points)
    if tree.count_neighbors(tree, link) <= _HEAPED * len(cloud):
        one, other = tree.query_pairs(link, output_type="ndarray").T
    else:
        away, near = tree.query(cloud.points, k=min(_NEAREST, len(cloud)), distance_upper_bound=link)
        one, place = np.nonzero(np.isfinite(away))
        other = near[one, place]
    alike = (normals[one] * normals[other]).sum(axis=1) > 0
    graph = coo_array((np.ones(alike.sum()), (one[alike], other[alike])), shape=(len(cloud), len(cloud)))
    labels = connected_components(graph, directed=False)[1]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _patch(cloud: PointCloud, step: float, reach: float) -> _Patch | None:
    """The mesh of points that hang together; None where too few of them face alike."""
    normals = np.asarray(cloud.normals)
    turn = _plane(normals)
    facing = normals @ turn
    steep = np.linalg.norm(facing[:, :2], axis=1) / np.maximum(facing[:, 2], 1e-9)
    kept = (facing[:, 2] > 0) & (steep < _STEEPEST)
    if kept.sum() < 3:
        return None
    local, facing = (cloud.points @ turn)[kept], facing[kept]
    place, slope = _sigmas(cloud)
    cells = _Cells.around(local, step, reach)
    if cells is None:
        return None
    heights, sigma = _solved(cells, local, -facing[:, :2] / facing[:, 2:], place[kept], slope[kept])
    faces, used = cells.faces()
    if not len(faces):
        return None
    flat = cells.lower + step * np.argwhere(cells.there)
    return _Patch(np.column_stack([flat, heights])[used] @ turn.T, faces, sigma[used])


def _sigmas(cloud: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """(N,) standard deviations of places [m] and of slopes, no smaller than what can be known."""
    count = len(cloud)
    place = np.full(count, _LEAST_SIGMA) if cloud.place_sigma is None else cloud.place_sigma
    slope = np.full(count, _LEAST_SLOPE) if cloud.normal_sigma_deg is None else np.radians(cloud.normal_sigma_deg)
    return np.clip(place, _LEAST_SIGMA, _MOST_SIGMA), np.clip(slope, _LEAST_SLOPE, _MOST_SIGMA)


def _plane(normals: np.ndarray) -> np.ndarray:
    """(3, 3) whose columns are two directions across the mean normal, and that."""
    up = normals.mean(axis=0)
    up /= np.linalg.norm(up)
    along = np.zeros(3)
    along[np.argmin(np.abs(up))] = 1.0
    first = np.cross(along, up)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up], axis=1)


class _Cells(NamedTuple):
    """Cells of a height: which of a regular lattice are there, and their numbers, -1 elsewhere."""

    lower: np.ndarray
    step: float
    there: np.ndarray
    number: np.ndarray

    @classmethod
    def around(cls, local: np.ndarray, step: float, reach: float) -> "_Cells | None":
        """Those within `reach` of a point, across the height."""
        from scipy.spatial import KDTree

        lower = local[:, :2].min(axis=0) - reach
        with np.errstate(over="ignore"):
            counts = np.ceil((local[:, :2].max(axis=0) + reach - lower) / step) + 1
            every = float(np.prod(counts))
        if every > _MOST_CELLS:
            raise InputError(
                f"a mesh with a spacing of {1e3 * step:.3g} mm would have {every:.3g} cells; "
                f"expected at most {_MOST_CELLS:.0e}: pass a larger spacing"
            )
        cells: np.ndarray = np.stack(np.meshgrid(*(np.arange(n) for n in counts.astype(int)), indexing="ij"), axis=-1)
        places = lower + step * cells
        there = (KDTree(local[:, :2]).query(places.reshape(-1, 2))[0] <= reach).reshape(cells.shape[:2])
        if there.sum() < 3:
            return None
        if there.sum() > (most := min(max(_FEW_CELLS, _CELLS_OF_A_POINT * len(local)), _MANY_CELLS)):
            raise InputError(
                f"{there.sum()} cells lie within {reach:.3g} m of {len(local)} points; expected at most {most}: pass a "
                "smaller reach, or a larger spacing"
            )
        number = np.full(there.shape, -1)
        number[there] = np.arange(there.sum())
        return cls(lower, step, there, number)

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """(F, 3) corners, numbered among those that a face uses, and which cells these are."""
        a, b, c, d = self.number[:-1, :-1], self.number[1:, :-1], self.number[1:, 1:], self.number[:-1, 1:]
        corners = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
        corners = corners[(corners >= 0).all(axis=1)]
        used, faces = np.unique(corners, return_inverse=True)
        return faces.reshape(-1, 3), used


def _solved(
    cells: _Cells, local: np.ndarray, slopes: np.ndarray, place: np.ndarray, tilt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(C,) heights of the cells [m], and the standard deviation of each."""
    from scipy.sparse import coo_array, vstack
    from scipy.sparse.linalg import splu
    from scipy.spatial import KDTree

    count, around = int(cells.there.sum()), min(4, len(local))
    # A point's height is that between the four cells around it, as far as these are there.
    at = (local[:, :2] - cells.lower) / cells.step
    low = np.minimum(np.floor(at).astype(int), np.array(cells.there.shape) - 2)
    part = at - low
    rows, columns, shares = [], [], []
    for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)):
        rows.append(np.arange(len(local)))
        columns.append(cells.number[low[:, 0] + i, low[:, 1] + j])
        shares.append(np.abs(1 - i - part[:, 0]) * np.abs(1 - j - part[:, 1]))
    row, column, share = map(np.concatenate, (rows, columns, shares))
    known = column >= 0
    total = np.maximum(np.bincount(row[known], share[known], minlength=len(local)), 1e-9)
    shape = len(local), count
    data = coo_array((share[known] / total[row[known]] / place[row[known]], (row[known], column[known])), shape=shape)

    tree, equations, wanted = KDTree(local[:, :2]), [data.tocsr()], [local[:, 2] / place]
    for k in (0, 1):
        one, other = (cells.number[:-1], cells.number[1:]) if k == 0 else (cells.number[:, :-1], cells.number[:, 1:])
        both = (one >= 0) & (other >= 0)
        first, second = one[both], other[both]
        middle = cells.lower + cells.step * (np.argwhere(both) + 0.5 * (np.arange(2) == k))
        _, nearest = tree.query(middle, k=around)
        nearest = nearest.reshape(len(middle), around)
        weights = 1 / tilt[nearest] ** 2
        slope = (weights * slopes[nearest, k]).sum(axis=1) / weights.sum(axis=1)
        error = cells.step * np.sqrt(1 / weights.mean(axis=1))
        number = np.arange(len(first))
        ends = np.r_[-1 / error, 1 / error], (np.r_[number, number], np.r_[first, second])
        equations.append(coo_array(ends, shape=(len(first), count)).tocsr())
        wanted.append(slope * cells.step / error)
    matrix: Any = vstack(equations).tocsc()
    normal = (matrix.T @ matrix).tocsc()
    normal.setdiag(normal.diagonal() * (1 + 1e-9))
    heights = splu(normal).solve(matrix.T @ np.concatenate(wanted))
    cells_at = cells.lower + cells.step * np.argwhere(cells.there)
    away, nearest = tree.query(cells_at, k=around)
    away, nearest = away.reshape(count, around), nearest.reshape(count, around)
    # Beyond the points the height is that of the nearest ones, carried on along their slopes.
    sigma = np.sqrt((place[nearest] ** 2 + (away * tilt[nearest]) ** 2).mean(axis=1))
    return heights, sigma
