"""Where a camera sits on an arm, from pictures of a board that stays where it is: hand-eye calibration."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.calibration._board import Board
from millisight.calibration._hand_eye_start import board_pose, closed_form, subsets
from millisight.calibration._weights import Grams, Weights, estimate_weights
from millisight.core import (
    checked_array,
    checked_record,
    put,
    record,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
)
from millisight.core.errors import InputError
from millisight.data import Intrinsics

LEAST_TURN_DEG = 5.0
"""What the arm must turn by, about each of two axes, for the camera's offset to be found [degrees]."""

_LEAST = 3  # pictures
_OUTLIER = 5.0  # times the median error
_NEGLIGIBLE = 2.0  # an error that is no outlier's [pixels]
_HOPELESS = 0.03  # an error that says that nothing is right, in widths of the picture
_ROUNDS = 20
_STEPS = 30
_SINGULAR = 1e-12


@record
class HandEye:
    """Where a camera sits on an arm.

    Attributes
    ----------
    pose : (4, 4) camera frame to radar frame [m]
    covariance : (6, 6) of the pose's error: the offset's [m], and a turn about the axes of the radar frame [rad]
    board : (4, 4) board frame to base frame [m]
    errors : (N,) rms distance between the corners seen and expected, by picture [pixels]
    used : (N,) bool, the pictures that agree with each other; the others were left out
    corner_sigma : standard deviation of a corner's column or row [pixels]
    place_sigma : standard deviation of the arm's position along an axis [m]
    turn_sigma : standard deviation of the arm's turn about an axis [rad]
    intrinsics : those given, or as they were found with the pose
    """

    pose: np.ndarray
    covariance: np.ndarray
    board: np.ndarray
    errors: np.ndarray
    used: np.ndarray
    corner_sigma: float
    place_sigma: float
    turn_sigma: float
    intrinsics: Intrinsics

    def __post_init__(self) -> None:
        errors = checked_array(self.errors, name="errors", shape=("N",), unit="pixels")
        put(
            self,
            pose=checked_array(self.pose, name="pose", shape=(4, 4)),
            covariance=checked_array(self.covariance, name="covariance", shape=(6, 6)),
            board=checked_array(self.board, name="board", shape=(4, 4)),
            errors=errors,
            used=checked_array(self.used, name="used", shape=errors.shape, dtype=np.bool_),
        )

    @property
    def offset(self) -> np.ndarray:
        """(3,) the camera in the radar frame [m]."""
        return self.pose[:3, 3]

    @property
    def offset_sigma(self) -> np.ndarray:
        """(3,) standard deviation of `offset` [m]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def residual(self) -> float:
        """Rms distance between the corners seen and expected, over the pictures used [pixels]."""
        return float(np.sqrt((self.errors[self.used] ** 2).mean()))


class _State(NamedTuple):
    """What is looked for, or a first value of it."""

    camera: np.ndarray
    board: np.ndarray
    optics: np.ndarray  # fx, fy, cx, cy

    def moved(self, step: np.ndarray) -> "_State":
        """Changed by a step (12,) or (16,): shift and turn of the camera, of the board, and the optics."""
        optics = self.optics + step[12:] if len(step) > 12 else self.optics
        return _State(_shifted(self.camera, step[:6]), _shifted(self.board, step[6:12]), optics)


def hand_eye(
    corners: ArrayLike,
    board: Board,
    positions: ArrayLike,
    orientations: ArrayLike,
    intrinsics: Intrinsics,
    *,
    names: Sequence[str] | None = None,
    fit_intrinsics: bool = False,
) -> HandEye:
    """Find where a camera sits on an arm, from pictures of a board that stays where it is.

    The camera X in the radar frame and the board Z in the base frame are those for which the corners b of the board are
    seen where they are, in all pictures at once, pi the pinhole of `Intrinsics` and A_i the radar frame in the base
    frame:

        corner_i = pi(X^-1 A_i^-1 Z b)

    This is the hand-eye problem of Tsai & Lenz, "A new technique for fully autonomous and efficient 3D robotics
    hand/eye calibration", 1989, as generalised least squares: an error of the arm moves all corners of its picture
    together. The standard deviations of corners, of the arm's positions and of its turns are estimated from the
    residuals, by restricted maximum likelihood; of fewer than ten pictures they are rough. A picture that disagrees
    with the others is left out: its corners are off by more than 2 pixels and 5 times the median.

    Parameters
    ----------
    corners : (N, C, 2) column and row of the board's inner corners, in the order of `board.points`, free of distortion
        [pixels]
    board : Board
    positions : (N, 3) the radar frame in the base frame, for each picture [m]
    orientations : (N, 4) unit quaternions x, y, z, w, radar to base
    intrinsics : of the camera
    names : (N,) of the pictures, for messages
    fit_intrinsics : take `intrinsics` for a first value, and find focal lengths and centre together with the pose; its
        uncertainty then includes theirs

    Returns
    -------
    HandEye

    Raises
    ------
    InputError
        The pictures are fewer than 3, or most disagree, or the arm turned too little between them, or about one axis
        alone: the message says which part of the offset is left open, and what to do.
    """
    checked_record(board, Board, name="board")
    checked_record(intrinsics, Intrinsics, name="intrinsics")
    points = board.points
    seen = checked_array(corners, name="corners", shape=("N", len(points), 2), unit="pixels")
    arm = _arm_poses(positions, orientations, len(seen))
    names = [f"picture {i + 1}" for i in range(len(seen))] if names is None else list(names)
    if len(names) != len(seen):
        raise InputError(f"names are {len(names)}; expected one for each of the {len(seen)} pictures")
    for name, one in zip(names, seen, strict=True):
        if np.linalg.svd(one - one.mean(axis=0), compute_uv=False)[1] < 1:
            raise InputError(f"the corners in {name} lie on a line; expected those of a board: find them again")
    _check_turns(arm)
    state = _first(seen, points, arm, intrinsics)
    state, used = _agreeing(state, seen, points, arm, intrinsics.width, names)
    _check_turns(arm[used])
    count = 16 if fit_intrinsics else 12
    state, grams, weights = _fitted(state, seen[used], points, arm[used], count)
    sigma = np.sqrt(weights.variance(grams))
    fx, fy, cx, cy = map(float, state.optics)
    return HandEye(
        pose=state.camera,
        covariance=sigma**2 * _inverted(weights.normal(grams))[:6, :6],
        board=state.board,
        errors=_errors(state, seen, points, arm),
        used=used,
        corner_sigma=float(sigma),
        place_sigma=float(sigma * weights.place),
        turn_sigma=float(sigma * weights.turn),
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, width=intrinsics.width, height=intrinsics.height),
    )


def _arm_poses(positions: ArrayLike, orientations: ArrayLike, count: int) -> np.ndarray:
    """(N, 4, 4) radar frame to base."""
    turns = checked_array(orientations, name="orientations", shape=(count, 4))
    lengths = np.linalg.norm(turns, axis=1)
    if np.abs(lengths - 1).max() > 1e-3:
        wrong = int(np.abs(lengths - 1).argmax())
        raise InputError(
            f"orientations[{wrong}] has the length {lengths[wrong]:.3g}; expected unit quaternions x, y, z, w"
        )
    arm = np.tile(np.eye(4), (count, 1, 1))
    arm[:, :3, :3] = rotation_from_quaternion(turns / lengths[:, None])
    arm[:, :3, 3] = checked_array(positions, name="positions", shape=(count, 3), unit="m")
    return arm


def _check_turns(arm: np.ndarray) -> None:
    """Raise where the turns of the arm (N, 4, 4) leave the camera's offset open."""
    if len(arm) < _LEAST:
        raise InputError(
            f"{len(arm)} pictures can be used; expected {_LEAST} at least, and better 12: take more, the arm turned "
            "about two axes in between"
        )
    turns = rotation_vector(np.swapaxes(arm[0, :3, :3], 0, 1) @ arm[:, :3, :3])  # axes of the radar frame of the first
    _, _, axes = np.linalg.svd(turns - turns.mean(axis=0))
    reach = np.degrees(np.ptp(turns @ axes.T, axis=0))
    if reach[0] < LEAST_TURN_DEG:
        raise InputError(
            f"the arm turned by {reach[0]:.1f} degrees at most, which does not determine the camera's offset along any "
            f"axis; expected {LEAST_TURN_DEG:g} at least: turn it by 20 to 40 degrees about two axes between pictures"
        )
    if reach[1] < LEAST_TURN_DEG:
        axis = axes[0] * np.sign(axes[0][np.abs(axes[0]).argmax()])
        told = ", ".join(f"{x + 0.0:.2f}" for x in np.round(axis, 2))
        raise InputError(
            f"the arm turned by {reach[0]:.0f} degrees about the axis ({told}) of the radar frame, and by "
            f"{reach[1]:.1f} about others, which does not determine the camera's offset along that axis; turn it by 20 "
            "to 40 degrees about a second axis as well"
        )


def _first(seen: np.ndarray, points: np.ndarray, arm: np.ndarray, intrinsics: Intrinsics) -> _State:
    """The start from a few pictures that expects the corners of all others best, by the median."""
    boards = np.stack([board_pose(one, points, intrinsics) for one in seen])
    optics = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
    starts = [_State(*closed_form(arm[few], boards[few]), optics) for few in subsets(len(seen))]
    return min(starts, key=lambda start: float(np.median(_errors(start, seen, points, arm))))


def _agreeing(
    state: _State, seen: np.ndarray, points: np.ndarray, arm: np.ndarray, width: int, names: Sequence[str]
) -> tuple[_State, np.ndarray]:
    """The state fitted to the pictures that agree, and which (N,) do; refused where they are few."""
    used, errors = np.zeros(len(seen), dtype=bool), _errors(state, seen, points, arm)
    for _ in range(_ROUNDS):
        before, used = used, errors <= max(_OUTLIER * np.median(errors), _NEGLIGIBLE)
        if np.array_equal(used, before) or used.sum() < _LEAST:
            break
        state = _stepped(state, seen[used], points, arm[used], Weights(0.0, 0.0), 12)
        errors = _errors(state, seen, points, arm)
    agree = used & (errors <= _HOPELESS * width)
    if agree.sum() < max(_LEAST, 2 * len(seen) / 3):
        told = ", ".join(
            f"{name} by {error:.1f} pixels" for name, error, good in zip(names, errors, agree, strict=True) if not good
        )
        raise InputError(
            f"the pictures do not agree with each other: {told} are off; check that board and camera did not move, the "
            "size of the squares, the poses, and that each belongs to its picture"
        )
    return state, used


def _fitted(
    state: _State, seen: np.ndarray, points: np.ndarray, arm: np.ndarray, count: int
) -> tuple[_State, Grams, Weights]:
    """The state of greatest likelihood, and the weights that go with it."""
    weights = Weights(0.0, 0.0)
    for _ in range(_ROUNDS):
        state = _stepped(state, seen, points, arm, weights, count)
        grams = _grams(state, seen, points, arm, count)
        before, weights = weights, estimate_weights(grams)
        if np.allclose(before, weights, rtol=1e-3, atol=0):
            break
    return state, grams, weights


def _stepped(
    state: _State, seen: np.ndarray, points: np.ndarray, arm: np.ndarray, weights: Weights, count: int
) -> _State:
    """The state of least weighted squares, by Gauss-Newton steps that are halved until they help."""
    grams = _grams(state, seen, points, arm, count)
    cost = weights.cost(grams)
    for _ in range(_STEPS):
        step = _inverted(weights.normal(grams)) @ weights.gradient(grams)
        for _ in range(_STEPS):
            tried = state.moved(step)
            there = _grams(tried, seen, points, arm, count)
            if (now := weights.cost(there)) < cost:
                break
            step = step / 2
        else:
            return state
        settled = now > (1 - 1e-12) * cost
        state, grams, cost = tried, there, now
        if settled:
            break
    return state


def _inverted(normal: np.ndarray) -> np.ndarray:
    """The inverse of the normal matrix, its unknowns scaled alike first."""
    scale = np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale)) if (scale > 0).all() else (np.zeros(1), scale)
    if not values[0] > _SINGULAR:
        raise InputError(
            "the pictures do not determine where the camera is; take more, the arm turned by 20 to 40 degrees about "
            "two axes between them, and the board filling half of each picture"
        )
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def _errors(state: _State, seen: np.ndarray, points: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(N,) rms distance of the corners of each picture [pixels]; large where one lies behind the camera."""
    place = _in_camera(state, points, arm)
    behind = np.any(place[..., 2] <= 0, axis=1)
    place[behind] = [0, 0, 1]
    off = np.linalg.norm(seen - _projected(place, state.optics), axis=2)
    return np.where(behind, 1e6, np.sqrt((off**2).mean(axis=1)))


def _grams(state: _State, seen: np.ndarray, points: np.ndarray, arm: np.ndarray, count: int) -> Grams:
    """Products of the residuals, of their derivatives by what is looked for, and by errors of the arm.

    With R_i, p_i the arm's turn and place, q = R_X^T (R_i^T (R_Z b + t_Z - p_i) - t_X) is a corner in the camera frame;
    turns are small ones about the axes of the frame that they end in.
    """
    q = _in_camera(state, points, arm)
    turned = state.camera[:3, :3].T  # radar to camera
    back = turned @ np.swapaxes(arm[:, :3, :3], 1, 2)  # base to camera, (N, 3, 3)
    in_radar = q @ turned  # from the camera, axes of the radar frame
    on_board = points @ state.board[:3, :3].T  # from the board's origin, axes of the base
    from_arm = on_board + state.board[:3, 3] - arm[:, None, :3, 3]
    shape = (*q.shape[:2], 3, 3)
    by_board = np.broadcast_to(back[:, None], shape)
    moves = np.concatenate(
        [
            np.broadcast_to(-turned, shape),
            turned @ _cross(in_radar),
            by_board,
            -by_board @ _cross(on_board),
            -by_board,
            by_board @ _cross(from_arm),
        ],
        axis=3,
    )  # (N, C, 3, 18)
    fx, fy = state.optics[:2]
    x, y, z = np.moveaxis(q, 2, 0)
    none, one = np.zeros_like(x), np.ones_like(x)
    lens = np.stack(
        [np.stack([fx / z, none, -fx * x / z**2], axis=2), np.stack([none, fy / z, -fy * y / z**2], axis=2)], axis=2
    )  # (N, C, 2, 3)
    optics = np.stack([np.stack([x / z, none, one, none], axis=2), np.stack([none, y / z, none, one], axis=2)], axis=2)
    slopes = lens @ moves
    unknown = np.concatenate([slopes[..., :12], optics], axis=3)[..., :count].reshape(len(q), -1, count)
    random = slopes[..., 12:].reshape(len(q), -1, 6)
    return Grams.of(unknown, random, (seen - _projected(q, state.optics)).reshape(len(q), -1))


def _in_camera(state: _State, points: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(N, C, 3) the board's points in the camera frame [m]."""
    in_base = points @ state.board[:3, :3].T + state.board[:3, 3]
    in_radar = (in_base - arm[:, None, :3, 3]) @ arm[:, :3, :3]
    return (in_radar - state.camera[:3, 3]) @ state.camera[:3, :3]


def _projected(place: np.ndarray, optics: np.ndarray) -> np.ndarray:
    """(N, C, 2) columns and rows [pixels] of places (N, C, 3) in the camera frame."""
    return place[..., :2] / place[..., 2:] * optics[:2] + optics[2:]


def _cross(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices that multiply crosswise by vectors (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    none = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ([none, -z, y], [z, none, -x], [-y, x, none])], axis=-2)


def _shifted(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """A pose (4, 4) shifted by step[:3] [m], and turned by step[3:] [rad] about the axes of the frame it ends in."""
    moved = pose.copy()
    moved[:3, :3] = rotation_from_vector(step[3:]) @ pose[:3, :3]
    moved[:3, 3] += step[:3]
    return moved
