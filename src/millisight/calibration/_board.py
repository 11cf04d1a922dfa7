"""A checkerboard, its corners in a picture, and what they tell of the lens; by OpenCV."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, checked_integer, checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.data import Intrinsics

_WAY_IN = 0.25  # from a square's middle to its corners, where its brightness is looked at


@record
class Board:
    """A checkerboard, by its inner corners: where four squares meet.

    One of `columns` and `rows` is even and the other odd, so that the board upside down looks another way. Its frame
    has the origin at the first corner, x along the columns, y along the rows and z into the board; the first corner
    is the one with a dark square between it and the next row and column.

    Attributes
    ----------
    columns, rows : number of inner corners
    square : side of a square [m]
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        columns = checked_integer(self.columns, name="columns", minimum=3)
        rows = checked_integer(self.rows, name="rows", minimum=3)
        if (columns + rows) % 2 == 0:
            raise InputError(
                f"a board of {columns} x {rows} inner corners looks the same upside down; expected an even and an odd "
                f"number, such as {columns} x {rows - 1}: cover a row of squares with paper"
            )
        put(self, columns=columns, rows=rows, square=checked_number(self.square, name="square", unit="m", above=0))

    @property
    def points(self) -> np.ndarray:
        """(C, 3) its inner corners, row after row, in its frame [m]."""
        row, column = np.indices((self.rows, self.columns)).reshape(2, -1)
        return self.square * np.stack([column, row, np.zeros_like(row)], axis=1)


def find_corners(picture: ArrayLike, board: Board) -> np.ndarray | None:
    """Find the corners of a checkerboard.

    Parameters
    ----------
    picture : (H, W, 3) uint8
    board : Board

    Returns
    -------
    (C, 2) column and row of each corner [pixels], in the order of `board.points`; None: the board was not found.

    Raises
    ------
    ImportError
        OpenCV is not installed: `pip install "millisight[calibrate]"`.
    """
    cv2 = _library()
    checked_record(board, Board, name="board")
    colours = checked_array(picture, name="picture", shape=("H", "W", 3), dtype=np.uint8)
    grey = np.ascontiguousarray(cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY))
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    return _in_order(np.asarray(corners, dtype=float).reshape(board.rows, board.columns, 2), grey)


def estimate_intrinsics(
    corners: ArrayLike, board: Board, size: tuple[int, int]
) -> tuple[Intrinsics, tuple[float, ...]]:
    """Estimate a camera from pictures of a board: Zhang's method, as OpenCV's calibrateCamera has it.

    Parameters
    ----------
    corners : (N, C, 2) as `find_corners` gives them [pixels]
    board : Board
    size : width and height of the pictures [pixels]

    Returns
    -------
    intrinsics : Intrinsics
    distortion : k1, k2 of the lens, the first two of OpenCV's coefficients

    Raises
    ------
    InputError
        The corners do not determine a camera.
    ImportError
        OpenCV is not installed: `pip install "millisight[calibrate]"`.
    """
    cv2 = _library()
    points = checked_record(board, Board, name="board").points.astype(np.float32)
    seen = checked_array(corners, name="corners", shape=("N", len(points), 2), unit="pixels").astype(np.float32)
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    try:
        _, matrix, lens, _, _ = cv2.calibrateCamera([points] * len(seen), list(seen), size, None, None, flags=flags)
    except cv2.error as error:
        raise InputError(f"the pictures do not determine the camera's focal length ({error}); tilt it more") from error
    intrinsics = Intrinsics(
        fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2], width=size[0], height=size[1]
    )
    return intrinsics, tuple(map(float, np.ravel(lens)[:2]))


def undistorted(corners: ArrayLike, intrinsics: Intrinsics, distortion: Sequence[float]) -> np.ndarray:
    """(N, C, 2) corners [pixels] as a lens without distortion would show them.

    Parameters
    ----------
    corners : (N, C, 2) [pixels]
    intrinsics : Intrinsics
    distortion : OpenCV's coefficients k1, k2, p1, p2, k3, or the first two or four of them; none: nothing changes

    Raises
    ------
    InputError
        The coefficients are of another number.
    ImportError
        OpenCV is not installed: `pip install "millisight[calibrate]"`.
    """
    seen = checked_array(corners, name="corners", shape=("N", "C", 2), unit="pixels")
    if len(distortion) not in (0, 2, 4, 5):
        raise InputError(f"distortion has {len(distortion)} numbers; expected k1, k2, p1, p2, k3, or the first 2 or 4")
    if not any(distortion):
        return seen
    matrix = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1]])
    lens = np.zeros(5)
    lens[: len(distortion)] = distortion
    return _library().undistortPoints(seen.reshape(-1, 1, 2), matrix, lens, P=matrix).reshape(seen.shape)


def _in_order(corners: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """(C, 2) corners (rows, columns, 2) in the order of `Board.points`: not mirrored, a dark square at the first."""
    along, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        corners = corners[:, ::-1]
    if _brightness(corners[:2, :2], grey) > _brightness(corners[:2, 1:3], grey):
        corners = corners[::-1, ::-1]
    return corners.reshape(-1, 2)


def _brightness(square: np.ndarray, grey: np.ndarray) -> float:
    """Median within the square of four corners (2, 2, 2)."""
    middle = square.mean(axis=(0, 1))
    places = np.round([middle, *(middle + _WAY_IN * (square.reshape(4, 2) - middle))]).astype(int)
    height, width = grey.shape
    columns, rows = np.clip(places, 0, [width - 1, height - 1]).T
    return float(np.median(grey[rows, columns]))


def _library() -> Any:
    try:
        import cv2
    except ImportError as error:
        raise ImportError('finding a board needs OpenCV: pip install "millisight[calibrate]"') from error
    return cv2
