"""Last touches to a mesh that `remesh` made: no triangles without height, and the volume that it had.

Lengths are in spacings, the mean length of an edge.
"""

import numpy as np

from millisight.meshes._subdivide import SIDES, edge_codes, rolled, side_codes

FLATTEST = 0.15  # height of a triangle below which its longest side is turned
MOST_TURNED = 0.95  # cosine between normals: a side is turned within one face only, never across a sharp edge
MAX_SHIFT = 0.05  # of the volume correction


def summed(owner: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """(count, n) the sum of the (k, n) `rows` of each owner."""
    return np.stack([np.bincount(owner, column, minlength=count) for column in rows.T], axis=1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _heights(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The height of each triangle over its longest side, and which side that is."""
    corners = points[triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return doubled / np.maximum(sides.max(axis=1), 1e-300), sides.argmax(axis=1)


def _normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return unit(np.cross(b - a, c - a))


def caps_turned(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Turn the longest side of flat triangles, such as three vertices in a row on a sharp edge make.

    Their normals point anywhere: they would be sharp edges where there are none.
    """
    triangles = triangles.copy()
    for _ in range(3):
        height, longest = _heights(points, triangles)
        codes = side_codes(triangles[:, SIDES].reshape(-1, 2))
        order = np.argsort(codes, kind="stable")
        codes = codes[order]
        touched, added = set(), set()
        for face in np.flatnonzero(height < FLATTEST):
            if face in touched:
                continue
            a, b, tip = rolled(triangles[face : face + 1], longest[face : face + 1])[0]
            twins = order[slice(*np.searchsorted(codes, edge_codes(min(a, b), max(a, b)) + np.arange(2)))] // 3
            other = int(twins[0] if twins[-1] == face else twins[-1])
            far = next((v for v in triangles[other] if v not in (a, b)), tip)
            new = edge_codes(min(tip, far), max(tip, far))
            taken = new in added or new in codes[np.searchsorted(codes, new) :][:1]
            if len(twins) != 2 or other in touched or height[other] < FLATTEST or far == tip or taken:
                continue
            pair = np.array([[a, far, tip], [far, b, tip]])
            if (_normals(points, pair) @ _normals(points, triangles[[other]])[0]).min() > MOST_TURNED:
                triangles[[face, other]] = pair
                touched |= {face, other}
                added.add(new)
        if not touched:
            break
    return triangles


def volume_kept(points: np.ndarray, triangles: np.ndarray, part: np.ndarray, volumes: np.ndarray) -> np.ndarray:
    """Points moved along their normals, all of a part alike, until each part has its volume in `volumes` again.

    Cutting across the rounding of a thin wall costs volume; a shift of far less than a spacing gives it back. A part
    whose volume is NaN, being open, stays as it is, and so does one that would need more.
    """
    lost = volumes - part_volumes(points, triangles, part, len(volumes))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    pushes = summed(triangles.ravel(), np.repeat(np.cross(b - a, c - a) / 6, 3, axis=0), len(points))
    # The volume that a shift by one gains.
    gain = np.bincount(part, np.linalg.norm(pushes, axis=1), minlength=len(volumes))
    shift = lost / np.maximum(gain, 1e-300)
    shift = np.where(np.abs(shift) <= MAX_SHIFT, shift, 0)
    return points + shift[part, None] * unit(pushes)


def part_volumes(points: np.ndarray, faces: np.ndarray, part: np.ndarray, parts: int) -> np.ndarray:
    """(parts,) the volume that each part's faces enclose, `part` being the part of each point."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.bincount(part[faces[:, 0]], np.einsum("fi,fi->f", a, np.cross(b, c)) / 6, minlength=parts)
