"""Finer meshes of the same surface, for `remesh`: long edges halved, thin faces filled without waste."""

import numpy as np

from millisight.core import serial

SIDES = [0, 1, 1, 2, 2, 0]  # of a triangle, as pairs of corners


def split_long_edges(points: np.ndarray, faces: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Halve every edge longer than `longest`, again and again; neighbours keep sharing whole edges.

    A face with one or three long edges becomes two or four. One with two long edges is thin: cutting it across
    would make new long edges, and ever more and thinner faces. It waits until both its long edges are finely
    split and is then filled with a zigzag from one to the other.
    """
    thin: list[np.ndarray] = [np.empty((0, 3), dtype=np.int64)]
    waiting = np.empty((0, 2), dtype=np.int64)  # pieces of the edges of thin faces
    split_codes, split_middles = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    while True:
        codes, edge_of_side = np.unique(
            side_codes(np.concatenate([faces[:, SIDES].reshape(-1, 2), waiting])), return_inverse=True
        )
        edges = _ends(codes)
        ends = points[edges]
        long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > longest
        if not long.any():
            break
        middle = np.where(long, len(points) + np.cumsum(long) - 1, -1)
        points = np.concatenate([points, ends[long].mean(axis=1)])
        split_codes.append(codes[long])
        split_middles.append(middle[long])

        side_middle = middle[edge_of_side]
        face_middle, waiting_middle = side_middle[: 3 * len(faces)].reshape(-1, 3), side_middle[3 * len(faces) :]
        held = (face_middle >= 0).sum(axis=1) == 2
        cut = waiting_middle >= 0
        waiting = np.concatenate(
            [
                waiting[~cut],
                np.stack([waiting[cut, 0], waiting_middle[cut]], axis=1),
                np.stack([waiting_middle[cut], waiting[cut, 1]], axis=1),
                *_halves(faces[held], face_middle[held]),
            ]
        )
        waiting = _ends(np.unique(side_codes(waiting)))
        thin.append(rolled(faces[held], (face_middle[held].argmin(axis=1) + 2) % 3))
        faces = _split_faces(faces[~held], face_middle[~held])
    codes, middles = np.concatenate(split_codes), np.concatenate(split_middles)
    order = np.argsort(codes)
    zigzag = _zigzag(np.concatenate(thin), points, codes[order], middles[order])
    return points, np.concatenate([faces, zigzag])


@serial(inline="always")
def edge_codes(low, high):
    """One number for an edge between two vertices, the smaller index first; it sorts as the pair does."""
    return (low << 32) | high


def side_codes(sides: np.ndarray) -> np.ndarray:
    """`edge_codes` of the rows of (n, 2), in whatever order their vertices stand."""
    return edge_codes(np.minimum(sides[:, 0], sides[:, 1]), np.maximum(sides[:, 0], sides[:, 1]))


def _ends(codes: np.ndarray) -> np.ndarray:
    """(n, 2) the vertices of edges, the smaller index first."""
    return np.stack([codes >> 32, codes & 0xFFFFFFFF], axis=1)


def _halves(faces: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    """The halves of the split sides of `faces`, and their whole sides where there is no middle."""
    pieces = []
    for k in range(3):
        start, stop, between = faces[:, k], faces[:, (k + 1) % 3], middle[:, k]
        cut = between >= 0
        pieces.append(np.stack([start[cut], between[cut]], axis=1))
        pieces.append(np.stack([between[cut], stop[cut]], axis=1))
        pieces.append(np.stack([start[~cut], stop[~cut]], axis=1))
    return pieces


def rolled(rows: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Each row of three rolled so that its entry number `first` leads."""
    return np.take_along_axis(rows, (first[:, None] + np.arange(3)) % 3, axis=1)


def _split_faces(faces: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Faces split at the middles of none (-1), one, or all of their three sides."""
    splits = (middle >= 0).sum(axis=1)
    first = np.where(splits == 1, middle.argmax(axis=1), 0)
    a, b, c = rolled(faces, first).T
    ab, bc, ca = rolled(middle, first).T
    whole, two, four = splits == 0, splits == 1, splits == 3
    pieces = [
        (whole, a, b, c),
        *((two, *corners) for corners in ((a, ab, c), (ab, b, c))),
        *((four, *corners) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))),
    ]
    return np.concatenate([np.stack([x[kept], y[kept], z[kept]], axis=1) for kept, x, y, z in pieces])


@serial()
def _walk(start, stop, codes, middles, chain, stack):
    """Fill `chain` with the vertices of a split edge from `start` to `stop`; return how many."""
    chain[0] = start
    size, depth = 1, 1
    stack[0] = stop
    while depth > 0:
        low, high = min(chain[size - 1], stack[depth - 1]), max(chain[size - 1], stack[depth - 1])
        code = edge_codes(low, high)
        at = np.searchsorted(codes, code)
        if at < len(codes) and codes[at] == code:
            stack[depth] = middles[at]
            depth += 1
        else:
            chain[size] = stack[depth - 1]
            size += 1
            depth -= 1
    return size


@serial(inline="always")
def _square(points, a, b):
    """The square of the distance between two points."""
    square = 0.0
    for d in range(3):
        square += (points[a, d] - points[b, d]) ** 2
    return square


@serial()
def _zigzag(thin, points, codes, middles):
    """Thin faces, tip first, filled from the tip down with the shorter rung each time."""
    left, right = np.empty(len(points), dtype=np.int64), np.empty(len(points), dtype=np.int64)
    stack = np.empty(64, dtype=np.int64)
    filled = np.empty((0, 3), dtype=np.int64)
    total = 0
    for pass_ in range(2):  # the first only counts
        if pass_ == 1:
            filled = np.empty((total, 3), dtype=np.int64)
            total = 0
        for f in range(len(thin)):
            lefts = _walk(thin[f, 0], thin[f, 1], codes, middles, left, stack)
            rights = _walk(thin[f, 0], thin[f, 2], codes, middles, right, stack)
            if pass_ == 0:
                total += lefts + rights - 3
                continue
            i = j = 1
            filled[total, 0], filled[total, 1], filled[total, 2] = left[0], left[1], right[1]
            total += 1
            while i < lefts - 1 or j < rights - 1:
                along_left = j == rights - 1
                if i < lefts - 1 and j < rights - 1:
                    to_left = _square(points, left[i + 1], right[j])
                    along_left = to_left <= _square(points, left[i], right[j + 1])
                if along_left:
                    filled[total, 0], filled[total, 1], filled[total, 2] = left[i], left[i + 1], right[j]
                    i += 1
                else:
                    filled[total, 0], filled[total, 1], filled[total, 2] = left[i], right[j + 1], right[j]
                    j += 1
                total += 1
    return filled
