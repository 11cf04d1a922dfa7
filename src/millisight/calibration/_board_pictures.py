"""Pictures of a board with the poses that they were taken from: a folder of PNG or JPEG files and a `poses.toml`."""

import dataclasses
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.calibration._board import Board, estimate_intrinsics, find_corners, undistorted
from millisight.calibration._hand_eye import HandEye, hand_eye
from millisight.core import (
    alone,
    atomic_path,
    checked_array,
    checked_numbers,
    checked_path,
    checked_record,
    make_folder,
    printable,
    put,
    read_toml,
    record,
    record_from_table,
    toml_of,
    write_text,
)
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import Intrinsics
from millisight.io import read_photo

POSES_NAME = "poses.toml"
"""The file that says where the pictures of its folder were taken."""


@record
class PosedPicture:
    """A picture, and where the arm held the radar frame for it.

    Attributes
    ----------
    file : its name in the folder
    position : the radar frame in the base frame [m]
    orientation : unit quaternion x, y, z, w, radar to base
    """

    file: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        orientation = checked_numbers(self.orientation, name="orientation", count=4)
        if abs(math.hypot(*orientation) - 1) > 1e-3:
            raise InputError(f"orientation is {list(orientation)}; expected a unit quaternion x, y, z, w")
        put(
            self,
            position=checked_numbers(self.position, name="position", count=3, unit="m"),
            orientation=orientation,
        )


@record
class PosedPictures:
    """Pictures by one camera, as `poses.toml` lists them.

    Attributes
    ----------
    pictures : in the order they were taken
    intrinsics : of the camera; None: not known
    distortion : of its lens, OpenCV's k1, k2, p1, p2, k3, or the first two or four of them; empty: none
    """

    pictures: tuple[PosedPicture, ...] = ()
    intrinsics: Intrinsics | None = None
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        put(self, distortion=tuple(map(float, self.distortion)))
        if self.distortion and (self.intrinsics is None or len(self.distortion) not in (2, 4, 5)):
            raise InputError(
                f"distortion has {len(self.distortion)} numbers; expected k1, k2, p1, p2, k3, or the first 2 or 4, "
                "beside [intrinsics]"
            )


class BoardViews(NamedTuple):
    """What pictures of a board show of it.

    Attributes
    ----------
    board : Board
    names : the pictures that show it
    missed : those in which it was not found
    corners : (N, C, 2) as `find_corners` gives them [pixels]
    positions : (N, 3) of the radar frame in the base frame [m]
    orientations : (N, 4) unit quaternions x, y, z, w, radar to base
    size : width and height of the pictures [pixels]
    intrinsics : of the camera; None: not known
    distortion : of its lens, as in `PosedPictures`
    """

    board: Board
    names: tuple[str, ...]
    missed: tuple[str, ...]
    corners: np.ndarray
    positions: np.ndarray
    orientations: np.ndarray
    size: tuple[int, int]
    intrinsics: Intrinsics | None
    distortion: tuple[float, ...]

    def hand_eye(self) -> HandEye:
        """Where the camera sits on the arm; intrinsics that are not known are found as well.

        Raises
        ------
        InputError
            As `hand_eye`; or fewer than 3 pictures show the board.
        ImportError
            OpenCV is not installed, and the intrinsics are not known, or the lens distorts.
        """
        if len(self.names) < 3:
            raise InputError(
                f"{len(self.names)} pictures show the board; expected 3 at least, and better 12: check the number of "
                "its inner corners, and take pictures that show it whole, sharp, and with a white border"
            )
        intrinsics, distortion = self.intrinsics, self.distortion
        if intrinsics is None:
            intrinsics, distortion = estimate_intrinsics(self.corners, self.board, self.size)
        return hand_eye(
            undistorted(self.corners, intrinsics, distortion),
            self.board,
            self.positions,
            self.orientations,
            intrinsics,
            names=self.names,
            fit_intrinsics=self.intrinsics is None,
        )


def read_poses(folder: str | os.PathLike[str]) -> PosedPictures:
    """The `poses.toml` of a folder.

    Raises
    ------
    FileError, FormatError
        It is missing, or a key or a value cannot be right; the message names the place.
    """
    if not (folder := Path(checked_path(folder))).is_dir():
        raise FileError(f"{printable(folder)}: no such folder; expected one with pictures and a {POSES_NAME}")
    path = folder / POSES_NAME
    found = record_from_table(PosedPictures, read_toml(path, "poses of pictures"), printable(path))
    names = [picture.file for picture in found.pictures]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FormatError(f"{printable(path)} names {twice[0]} twice; remove one")
    if not found.pictures:
        raise FormatError(f"{printable(path)} names no picture; add [[pictures]] with file, position and orientation")
    return found


def add_picture(
    folder: str | os.PathLike[str], rgb: ArrayLike, position: ArrayLike, orientation: ArrayLike, intrinsics: Intrinsics
) -> PosedPicture:
    """Save a picture with its pose under the next number, in a folder that is made where it is missing.

    Parameters
    ----------
    folder : of the pictures and their `poses.toml`
    rgb : (H, W, 3) uint8
    position : (3,) of the radar frame in the base frame [m]
    orientation : (4,) unit quaternion x, y, z, w, radar to base
    intrinsics : of the camera; the same for all pictures of a folder

    Raises
    ------
    InputError
        The folder holds pictures by another camera.
    FileError, FormatError
        The folder cannot be written to, or its `poses.toml` cannot be read.
    """
    from PIL import Image

    checked_record(intrinsics, Intrinsics, name="intrinsics")
    pixels = checked_array(rgb, name="rgb", shape=(intrinsics.height, intrinsics.width, 3), dtype=np.uint8)
    folder = make_folder(folder)
    with alone(folder, printable(folder)):
        poses = folder / POSES_NAME
        before = read_poses(folder) if poses.exists() else PosedPictures(intrinsics=intrinsics)
        if before.intrinsics is None or dataclasses.astuple(before.intrinsics) != dataclasses.astuple(intrinsics):
            raise InputError(f"{printable(folder)} holds pictures by another camera; choose another folder")
        taken = [Path(name).stem for name in (*os.listdir(folder), *(one.file for one in before.pictures))]
        numbers = [int(stem) for stem in taken if re.fullmatch(r"[0-9]{1,9}", stem)]
        made = PosedPicture(
            file=f"{max(numbers, default=0) + 1:03}.png",
            position=tuple(checked_array(position, name="position", shape=(3,), unit="m").tolist()),
            orientation=tuple(checked_array(orientation, name="orientation", shape=(4,)).tolist()),
        )
        with atomic_path(folder / made.file) as temporary:
            Image.fromarray(pixels).save(temporary, format="PNG")
        try:
            write_text(poses, toml_of(dataclasses.replace(before, pictures=(*before.pictures, made))))
        except BaseException:  # a picture without a pose is of no use
            (folder / made.file).unlink(missing_ok=True)
            raise
    return made


def read_board_views(
    folder: str | os.PathLike[str], board: Board, *, progress: Callable[[int, int], None] | None = None
) -> BoardViews:
    """Find a board in the pictures of a folder.

    Parameters
    ----------
    folder : with pictures, and a `poses.toml` that names each with its pose
    board : Board
    progress : called with (pictures done, pictures in all)

    Raises
    ------
    InputError
        The pictures differ in size, or from that of the intrinsics.
    FileError, FormatError, DamagedFileError
        A file cannot be read.
    ImportError
        OpenCV is not installed: `pip install "millisight[calibrate]"`.
    """
    folder = Path(checked_path(folder))
    posed = read_poses(folder)
    told = posed.intrinsics
    size = None if told is None else (told.width, told.height)
    found: dict[str, tuple[PosedPicture, np.ndarray]] = {}
    for i, picture in enumerate(posed.pictures):
        pixels = read_photo(folder / picture.file)
        size = size or (pixels.shape[1], pixels.shape[0])
        if (pixels.shape[1], pixels.shape[0]) != size:
            raise InputError(
                f"{printable(folder / picture.file)} is {pixels.shape[1]} x {pixels.shape[0]} pixels; expected "
                f"{size[0]} x {size[1]} as {'[intrinsics] has it' if told else 'the first picture'}"
            )
        corners = find_corners(pixels, board)
        if corners is not None:
            found[picture.file] = picture, corners
        if progress is not None:
            progress(i + 1, len(posed.pictures))
    count = len(board.points)
    return BoardViews(
        board=board,
        names=tuple(found),
        missed=tuple(picture.file for picture in posed.pictures if picture.file not in found),
        corners=np.array([corners for _, corners in found.values()]).reshape(-1, count, 2),
        positions=np.array([picture.position for picture, _ in found.values()]).reshape(-1, 3),
        orientations=np.array([picture.orientation for picture, _ in found.values()]).reshape(-1, 4),
        size=size or (0, 0),
        intrinsics=told,
        distortion=posed.distortion,
    )
