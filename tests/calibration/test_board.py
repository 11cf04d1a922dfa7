"""Boards in pictures that are drawn ray by ray, and folders of them."""

import builtins
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from helpers.boards import BOARD, OPTICS, corners_of, pictures_of, setup
from millisight.calibration import (
    Board,
    add_picture,
    estimate_intrinsics,
    find_corners,
    read_board_views,
    read_poses,
    undistorted,
)
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import Intrinsics

SMALL = Intrinsics(fx=310, fy=310, cx=160, cy=120, width=320, height=240)


@pytest.fixture(scope="module")
def shown():
    """Pictures and where their corners are."""
    told = setup(np.random.default_rng(0), 3)
    return list(pictures_of(told, np.random.default_rng(1))), corners_of(told)


@pytest.mark.slow
@pytest.mark.parametrize("turns", range(4))
def test_corners_are_found_in_the_order_of_the_board(shown, turns):
    """However the camera is turned: a picture turned by quarters shows the same corners in the same order."""
    for picture, corners in zip(*shown, strict=True):
        there, (height, width) = corners, picture.shape[:2]
        for _ in range(turns):  # as np.rot90 moves pixels
            there, (height, width) = np.stack([there[:, 1], width - 1 - there[:, 0]], axis=1), (width, height)
        found = find_corners(np.rot90(picture, turns), BOARD)
        assert found.shape == (54, 2)
        assert np.sqrt(((found - there) ** 2).sum(axis=1).mean()) < 0.1


def test_a_board_that_is_not_there_is_not_found(shown):
    picture = shown[0][0]
    assert find_corners(np.full((240, 320, 3), 128, np.uint8), BOARD) is None
    assert find_corners(picture, Board(columns=12, rows=7, square=0.02)) is None
    with pytest.raises(InputError, match="picture has shape"):
        find_corners(picture[..., 0], BOARD)


def test_the_camera_and_its_lens_are_found():
    told = setup(np.random.default_rng(2), 12)
    straight = corners_of(told)
    # The lens bends: k1, k2 of OpenCV's model.
    x = (straight - [OPTICS.cx, OPTICS.cy]) / [OPTICS.fx, OPTICS.fy]
    square = (x**2).sum(axis=2, keepdims=True)
    bent = x * (1 - 0.2 * square + 0.05 * square**2) * [OPTICS.fx, OPTICS.fy] + [OPTICS.cx, OPTICS.cy]
    intrinsics, lens = estimate_intrinsics(bent, BOARD, (640, 480))
    assert (intrinsics.fx, intrinsics.cy) == pytest.approx((OPTICS.fx, OPTICS.cy), abs=0.5)
    assert lens[0] == pytest.approx(-0.2, abs=0.01)
    assert np.abs(bent - straight).max() > 2
    assert undistorted(bent, OPTICS, (-0.2, 0.05)) == pytest.approx(straight, abs=1e-3)
    assert undistorted(bent, OPTICS, (-0.2, 0.05, 0, 0)) == pytest.approx(straight, abs=1e-3)
    assert np.array_equal(undistorted(bent, OPTICS, ()), bent)
    with pytest.raises(InputError, match="distortion has 3 numbers"):
        undistorted(bent, OPTICS, (0.1, 0.2, 0.3))


def test_without_opencv_it_says_what_to_install(shown, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **settings):
        if name == "cv2":
            raise ImportError("no module named cv2")
        return real(name, *rest, **settings)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r'needs OpenCV: pip install "millisight\[calibrate\]"'):
        find_corners(shown[0][0], BOARD)
    assert undistorted(shown[1], OPTICS, ()).shape == shown[1].shape  # nothing to correct: needs none


def blank(value=0):
    return np.full((240, 320, 3), value, np.uint8)


def test_pictures_are_numbered_and_never_overwritten(tmp_path):
    folder = tmp_path / "board"
    poses = [((0.4, 0, 0.3), (0, 0, 0, 1)), ((0.41, 0, 0.3), (0, 0.6, 0, 0.8)), ((0.42, 0, 0.3), (1, 0, 0, 0))]
    assert add_picture(folder, blank(1), *poses[0], SMALL).file == "001.png"
    (folder / "007.jpg").write_bytes(b"")
    assert add_picture(folder, blank(2), *poses[1], SMALL).file == "008.png"
    (folder / "008.png").unlink()
    assert add_picture(folder, blank(3), *poses[2], SMALL).file == "009.png"
    found = read_poses(folder)
    assert [(one.position, one.orientation) for one in found.pictures] == poses
    assert (found.intrinsics.fx, found.intrinsics.height, found.distortion) == (310, 240, ())
    assert np.asarray(Image.open(folder / "001.png"))[0, 0].tolist() == [1, 1, 1]
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match="holds pictures by another camera"):
        add_picture(folder, np.zeros((480, 640, 3), np.uint8), *poses[0], OPTICS)
    with pytest.raises(InputError, match="rgb has shape"):
        add_picture(folder, np.zeros((480, 640, 3), np.uint8), *poses[0], SMALL)
    with pytest.raises(InputError, match="expected a unit quaternion"):
        add_picture(folder, blank(), (0, 0, 0), (0, 0, 0, 2), SMALL)
    assert sorted(folder.iterdir()) == before


ONE = '[[pictures]]\nfile = "a.png"\nposition = [0, 0, 0]\norientation = [0, 0, 0, 1]\n'


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        (None, FileError, "poses.toml: no such file"),
        ("", FormatError, "names no picture; add [[pictures]] with file, position and orientation"),
        (ONE.replace("file", "name"), FormatError, "pictures[0].name: unknown key 'name'"),
        (ONE.replace("0, 1]", "0, 3]"), FormatError, "expected a unit quaternion x, y, z, w"),
        (ONE.replace("[0, 0, 0]", "[0, 0]"), FormatError, "pictures[0].position: expected 3 entries"),
        ("distortion = [0.1, 0]\n" + ONE, FormatError, "beside [intrinsics]"),
        (ONE + ONE, FormatError, "names a.png twice; remove one"),
        (ONE, FileError, "a.png: no such file"),
    ],
)
def test_poses_by_hand_that_cannot_be_right(tmp_path, text, kind, words):
    if text is not None:
        (tmp_path / "poses.toml").write_text(text)
    with pytest.raises(kind, match=re.escape(words)):
        read_board_views(tmp_path, BOARD)


def test_the_poses_that_the_page_shows_are_read(tmp_path):
    page = (Path(__file__).parents[2] / "docs/how-to/rig.md").read_text(encoding="utf-8")
    (shown,) = [text for text in re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL) if "[[pictures]]" in text]
    (tmp_path / "poses.toml").write_text(shown, encoding="utf-8")
    found = read_poses(tmp_path)
    assert found.pictures[0].file == "001.jpg"
    assert found.distortion == (-0.2, 0.05)
    assert found.intrinsics.width == 640


def test_pictures_of_several_sizes_are_refused(tmp_path):
    (tmp_path / "poses.toml").write_text(ONE + ONE.replace("a.png", "b.png"))
    Image.fromarray(blank()).save(tmp_path / "a.png")
    Image.fromarray(blank()[1:]).save(tmp_path / "b.png")
    with pytest.raises(InputError, match=r"b\.png is 320 x 239 pixels; expected 320 x 240 as the first picture"):
        read_board_views(tmp_path, BOARD)
    Image.fromarray(blank()).save(tmp_path / "b.png")
    seen = []
    views = read_board_views(tmp_path, BOARD, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    assert (views.names, views.missed, views.size) == ((), ("a.png", "b.png"), (320, 240))
    with pytest.raises(InputError, match="0 pictures show the board; expected 3 at least"):
        views.hand_eye()
