"""Pictures of a checkerboard from a camera on an arm, all of it known; and their corners without pictures."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from millisight.calibration import Board
from millisight.data import Intrinsics

BOARD = Board(columns=9, rows=6, square=0.02)
OPTICS = Intrinsics(fx=618.2, fy=617.8, cx=321.3, cy=241.1, width=640, height=480)
_MARGIN = 1.0  # white around the squares, in squares


class Setup(NamedTuple):
    """What is true, and where the arm says that it was."""

    camera: np.ndarray  # (4, 4) to the radar frame
    board: np.ndarray  # (4, 4) to the base
    arm: np.ndarray  # (N, 4, 4) radar frame to base, true
    positions: np.ndarray  # as told
    orientations: np.ndarray


def pose(turn, place):
    made = np.eye(4)
    made[:3, :3] = turn.as_matrix()
    made[:3, 3] = place
    return made


def setup(rng, count=12, place_sigma=0.0, turn_sigma_deg=0.0, turns=None):
    """A camera that looks down at a board from 0.3 to 0.4 m, turned by up to 25 degrees about each axis."""
    down = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    camera = pose(Rotation.from_euler("xyz", rng.uniform(-6, 6, 3), degrees=True) * down, [0.012, 0.068, 0.024])
    board = pose(down * Rotation.from_euler("xyz", rng.uniform(-5, 5, 3), degrees=True), [0.4, -0.2, 0.05])
    middle = (board @ [*BOARD.points.mean(axis=0), 1])[:3]
    if turns is None:
        turns = [Rotation.from_euler("xyz", rng.uniform(-25, 25, 3), degrees=True) for _ in range(count)]
    arm = []
    for turn in turns:
        # So that the camera looks at the board's middle, or near it.
        away = turn.as_matrix() @ camera[:3, 2]
        eye = middle - rng.uniform(0.34, 0.42) * away + rng.uniform(-0.02, 0.02, 3)
        arm.append(pose(turn, eye - turn.as_matrix() @ camera[:3, 3]))
    arm = np.array(arm)
    errors = Rotation.from_rotvec(np.radians(turn_sigma_deg) * rng.standard_normal((len(arm), 3)))
    return Setup(
        camera=camera,
        board=board,
        arm=arm,
        positions=arm[:, :3, 3] + place_sigma * rng.standard_normal((len(arm), 3)),
        orientations=(errors * Rotation.from_matrix(arm[:, :3, :3])).as_quat(),
    )


def seen_from(told):
    """(N, 4, 4) base to camera."""
    return np.linalg.inv(told.arm @ told.camera)


def corners_of(told, board=BOARD, optics=OPTICS, rng=None, sigma=0.0):
    """(N, C, 2) where the corners are [pixels]."""
    points = np.column_stack([board.points, np.ones(len(board.points))]) @ told.board.T
    place = points @ np.swapaxes(seen_from(told), 1, 2)
    assert (place[..., 2] > 0.1).all()
    x, y = place[..., 0] / place[..., 2], place[..., 1] / place[..., 2]
    exact = np.stack([optics.fx * x + optics.cx, optics.fy * y + optics.cy], axis=2)
    return exact if rng is None else exact + sigma * rng.standard_normal(exact.shape)


def pictures_of(told, rng, board=BOARD, optics=OPTICS, noise=3.0, samples=3):
    """(H, W, 3) uint8 each, by `samples` x `samples` rays a pixel."""
    step = (np.arange(samples) + 0.5) / samples - 0.5
    rows = (np.arange(optics.height)[:, None] + step).ravel()
    columns = (np.arange(optics.width)[:, None] + step).ravel()
    x, y = (columns - optics.cx) / optics.fx, (rows - optics.cy)[:, None] / optics.fy
    for view in seen_from(told):
        to_board = np.linalg.inv(view @ told.board)
        away = [across * x + (down * y + ahead) for across, down, ahead in to_board[:3, :3]]
        # Where each ray meets the board, in squares from the first corner.
        reach = -to_board[2, 3] / away[2]
        u, v = ((to_board[i, 3] + reach * away[i]) / board.square for i in (0, 1))
        light = np.full(u.shape, 60.0)
        low, wide, high = -1 - _MARGIN, board.columns + _MARGIN, board.rows + _MARGIN
        light[(u > low) & (u < wide) & (v > low) & (v < high)] = 220.0
        inside = (u > -1) & (u < board.columns) & (v > -1) & (v < board.rows)
        light[inside & ((np.floor(u) + np.floor(v)) % 2 == 0)] = 30.0
        grey = light.reshape(optics.height, samples, optics.width, samples).mean(axis=(1, 3))
        noisy = grey[..., None] + noise * rng.standard_normal((*grey.shape, 3))
        yield np.clip(np.round(noisy), 0, 255).astype(np.uint8)
