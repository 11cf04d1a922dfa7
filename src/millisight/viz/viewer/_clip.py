"""Boxes that hide what is outside of them: points, segments and meshes cut by them; a mesh's outline in a plane."""

import numpy as np

from millisight.data import TriangleMesh, VoxelGrid

_WITHIN = 1e-6  # of a limit, which the page's address rounds [m]


def inside(points: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(n,) bool: which of (n, 3) points lie within `limits` (2, 3) [m], their ends included."""
    return np.all((points >= limits[0] - _WITHIN) & (points <= limits[1] + _WITHIN), axis=1)


def kept_voxels(grid: VoxelGrid, limits: np.ndarray) -> tuple[slice, slice, slice]:
    """Which voxels of a grid have their centres within `limits` (2, 3) [m]; empty slices where none has."""
    ends = [
        (np.searchsorted(axis, low - _WITHIN), np.searchsorted(axis, high + _WITHIN))
        for axis, low, high in zip((grid.x, grid.y, grid.z), *limits, strict=True)
    ]
    x, y, z = (slice(int(first), int(max(first, last))) for first, last in ends)
    return x, y, z


def clipped_segments(segments: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """What of (n, 2, 3) segments lies within `limits` (2, 3) [m]: (m, 2, 3), by Liang and Barsky (1984)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    first, last = np.zeros(len(segments)), np.ones(len(segments))
    kept = np.ones(len(segments), dtype=bool)
    for axis in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (limits[:, axis] - start[:, axis, None]) / along[:, axis, None]
        level = along[:, axis] == 0
        within = (start[:, axis] >= limits[0, axis] - _WITHIN) & (start[:, axis] <= limits[1, axis] + _WITHIN)
        kept &= ~level | within
        first = np.where(level, first, np.maximum(first, ends.min(axis=1)))
        last = np.where(level, last, np.minimum(last, ends.max(axis=1)))
    kept &= first <= last
    ends = np.stack([first, last], axis=1)[kept]
    return start[kept, None] + ends[..., None] * along[kept, None]


def cut_outline(mesh: TriangleMesh, axis: int, at: float) -> np.ndarray:
    """(n, 2, 3) segments where a mesh meets the plane across `axis` at `at` [m].

    Every face with corners on both sides gives one segment. A corner in the plane counts as above it, so a face that
    lies in the plane gives none, and a closed mesh a closed outline.
    """
    corners = mesh.vertices[mesh.faces]
    height = corners[..., axis] - at
    above = height >= 0
    crossed = above.any(axis=1) & ~above.all(axis=1)
    corners, height, above = corners[crossed], height[crossed], above[crossed]
    # The corner that is alone on its side comes first; the segment's ends lie on its two edges.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    faces = np.arange(len(corners))
    first, from_plane = corners[faces, alone], height[faces, alone]
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        share = from_plane / (from_plane - height[faces, other])
        ends.append(first + share[:, None] * (corners[faces, other] - first))
    segments = np.stack(ends, axis=1)
    segments[..., axis] = at
    return segments


def cut_mesh(mesh: TriangleMesh, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of what of a mesh lies within `limits` (2, 3) [m]; open where it was cut."""
    vertices, faces = mesh.vertices, mesh.faces
    if inside(vertices, limits).all():
        return vertices, faces
    from trimesh.intersections import slice_faces_plane

    for axis in range(3):
        for limit, side in ((limits[0, axis], 1.0), (limits[1, axis], -1.0)):
            if not np.isfinite(limit) or not len(faces):
                continue
            normal, origin = np.zeros(3), np.zeros(3)
            normal[axis], origin[axis] = side, limit
            vertices, faces, _ = slice_faces_plane(vertices, faces, normal, origin)
    return np.asarray(vertices), np.asarray(faces).reshape(-1, 3)
