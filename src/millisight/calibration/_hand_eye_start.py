"""First values for a hand-eye calibration, in closed form, and from few pictures at a time: some may be wrong."""

from itertools import combinations
from math import comb

import numpy as np

from millisight.core import rotation_vector
from millisight.data import Intrinsics

_AT_A_TIME = 4  # pictures
_TRIALS = 100


def board_pose(corners: np.ndarray, points: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """(4, 4) board to camera from the corners (C, 2) [pixels] of the points (C, 3) of a plane z = 0 [m].

    By the homography of the plane: Zhang, "A flexible new technique for camera calibration", 2000, section 3.1.
    """
    seen = (corners - [intrinsics.cx, intrinsics.cy]) / [intrinsics.fx, intrinsics.fy]
    plane = points[:, :2]
    to_plane, to_seen = _evened(plane), _evened(seen)
    (x, y), (u, v) = _moved(plane, to_plane).T, _moved(seen, to_seen).T
    one, none = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, none, none, none, -u * x, -u * y, -u], axis=1),
            np.stack([none, none, none, x, y, one, -v * x, -v * y, -v], axis=1),
        ]
    )
    homography = np.linalg.inv(to_seen) @ np.linalg.svd(rows)[2][-1].reshape(3, 3) @ to_plane
    homography /= np.linalg.norm(homography[:, :2], axis=0).mean() * np.copysign(1.0, homography[2, 2])
    a, b, place = homography.T
    pose = np.eye(4)
    pose[:3, :3] = nearest_rotation(np.stack([a, b, np.cross(a, b)], axis=1))
    pose[:3, 3] = place
    return pose


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """(3, 3) rotation nearest to a matrix (3, 3), in the sum of squares."""
    u, _, v = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def inverse(poses: np.ndarray) -> np.ndarray:
    """The inverse of poses (..., 4, 4)."""
    turned = np.swapaxes(poses[..., :3, :3], -1, -2)
    back = np.zeros_like(poses)
    back[..., :3, :3] = turned
    back[..., :3, 3] = -(turned @ poses[..., :3, 3:])[..., 0]
    back[..., 3, 3] = 1.0
    return back


def closed_form(arm: np.ndarray, boards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera to radar frame and board to base, (4, 4) each, from poses of arm and board (n, 4, 4).

    A X = X B for every two pictures, A the motion of the radar frame, B of the camera: first the turn, by the axes of
    both (Park & Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", 1994), then the shift.
    """
    first, second = np.array(list(combinations(range(len(arm)), 2))).T
    a = inverse(arm[second]) @ arm[first]
    b = boards[second] @ inverse(boards[first])
    camera = np.eye(4)
    camera[:3, :3] = nearest_rotation(rotation_vector(a[:, :3, :3]).T @ rotation_vector(b[:, :3, :3]))
    lever = (a[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    shift = (b[:, :3, 3] @ camera[:3, :3].T - a[:, :3, 3]).reshape(-1)
    camera[:3, 3] = np.linalg.lstsq(lever, shift, rcond=None)[0]
    found = arm @ camera @ boards
    board = np.eye(4)
    board[:3, :3] = nearest_rotation(found[:, :3, :3].sum(axis=0))
    board[:3, 3] = np.median(found[:, :3, 3], axis=0)
    return camera, board


def subsets(count: int) -> list[np.ndarray]:
    """Numbers of pictures to start from: every few of `count`, or a hundred of those where they are many."""
    few = min(_AT_A_TIME, count)
    if comb(count, few) <= _TRIALS:
        return [np.array(chosen) for chosen in combinations(range(count), few)]
    rng = np.random.default_rng(0)  # the same every time
    return [rng.choice(count, few, replace=False) for _ in range(_TRIALS)]


def _evened(points: np.ndarray) -> np.ndarray:
    """(3, 3) that moves points (n, 2) to a mean of 0 and a spread of 1, for the accuracy of the homography."""
    middle, spread = points.mean(axis=0), points.std() or 1.0
    return np.array([[1 / spread, 0, -middle[0] / spread], [0, 1 / spread, -middle[1] / spread], [0, 0, 1]])


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:2, :2].T + matrix[:2, 2]
