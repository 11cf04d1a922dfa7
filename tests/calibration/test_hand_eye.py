"""Hand-eye calibration on corners whose truth is known; pictures are in test_board.py."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.boards import BOARD, OPTICS, corners_of, setup
from millisight.calibration import Board, hand_eye
from millisight.core.errors import InputError
from millisight.data import Intrinsics


def found_in(told, corners, intrinsics=OPTICS, **settings):
    return hand_eye(corners, BOARD, told.positions, told.orientations, intrinsics, **settings)


def error_of(found, told):
    """(6,) the offset's [m] and the turn's [rad]."""
    turn = Rotation.from_matrix(found.pose[:3, :3] @ told.camera[:3, :3].T).as_rotvec()
    return np.concatenate([found.pose[:3, 3] - told.camera[:3, 3], turn])


@pytest.mark.parametrize("count", [3, 4, 12, 30])
def test_without_noise_the_truth_is_found(count):
    told = setup(np.random.default_rng(count), count)
    found = found_in(told, corners_of(told))
    assert found.pose == pytest.approx(told.camera, abs=1e-9)
    assert found.board == pytest.approx(told.board, abs=1e-9)
    assert found.used.all()
    assert found.errors.shape == (count,)
    assert found.residual < 1e-6
    assert found.offset == pytest.approx([0.012, 0.068, 0.024], abs=1e-9)


@pytest.mark.slow
def test_the_camera_is_found_along():
    told = setup(np.random.default_rng(0))
    rough = Intrinsics(fx=600, fy=640, cx=320, cy=240, width=640, height=480)
    found = found_in(told, corners_of(told), rough, fit_intrinsics=True)
    assert found.pose == pytest.approx(told.camera, abs=1e-9)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found.intrinsics, name) == pytest.approx(getattr(OPTICS, name), abs=1e-6)
    # Taken for true, they would be wrong.
    assert np.abs(error_of(found_in(told, corners_of(told), rough), told)[:3]).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("fit", [False, True])
def test_the_truth_lies_within_what_is_told(fit):
    """The square of the error in units of its covariance has a mean of 6; and the kinds of noise are told apart."""
    squares, sigmas, within = [], [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        told = setup(rng, 12, place_sigma=2e-4, turn_sigma_deg=0.05)
        found = found_in(told, corners_of(told, rng=rng, sigma=0.1), fit_intrinsics=fit)
        error = error_of(found, told)
        squares.append(error @ np.linalg.solve(found.covariance, error))
        within.append((np.abs(error) < 3 * np.sqrt(np.diag(found.covariance))).all())
        sigmas.append([found.corner_sigma, found.place_sigma, np.degrees(found.turn_sigma)])
        assert found.used.all()
        assert found.offset_sigma == pytest.approx(np.sqrt(np.diag(found.covariance)[:3]))
    # The mean of 12 has a standard deviation of 1.0; the covariance itself is known to a tenth or two.
    assert 3.5 < np.mean(squares) < 9.5
    assert np.mean(within) >= 0.9
    assert np.median(sigmas, axis=0) == pytest.approx([0.1, 2e-4, 0.05], rel=0.15)
    assert np.median(sigmas, axis=0)[0] == pytest.approx(0.1, rel=0.02)


@pytest.mark.slow
def test_uncertainties_that_leave_the_arm_out_would_be_wrong():
    """Taking each corner for independent, as plain least squares does, tells less than a third of the error."""
    rng = np.random.default_rng(1)
    told = setup(rng, 12, place_sigma=2e-4, turn_sigma_deg=0.05)
    exact = setup(np.random.default_rng(1), 12)
    noisy = found_in(told, corners_of(told, rng=rng, sigma=0.1))
    plain = found_in(exact, corners_of(exact, rng=rng, sigma=0.1))
    assert (noisy.offset_sigma > 3 * plain.offset_sigma).all()


def test_more_turns_tell_more():
    sigmas = []
    for largest in (8, 30):
        rng = np.random.default_rng(2)
        turns = [Rotation.from_euler("xyz", rng.uniform(-largest, largest, 3), degrees=True) for _ in range(12)]
        told = setup(rng, turns=turns, place_sigma=2e-4, turn_sigma_deg=0.05)
        sigmas.append(found_in(told, corners_of(told, rng=rng, sigma=0.1)).offset_sigma.max())
    assert sigmas[0] > 2 * sigmas[1]


def test_a_wrong_pose_is_left_out_and_told():
    rng = np.random.default_rng(3)
    told = setup(rng, 12, place_sigma=2e-4, turn_sigma_deg=0.05)
    corners = corners_of(told, rng=rng, sigma=0.1)
    positions = told.positions.copy()
    positions[4] += [0.01, 0, 0]
    corners[7] = corners[7, ::-1]  # the board upside down
    found = found_in(told._replace(positions=positions), corners)
    assert np.flatnonzero(~found.used).tolist() == [4, 7]
    assert (found.errors[[4, 7]] > 10).all()
    assert found.residual < 2
    assert (np.abs(error_of(found, told)) < 4 * np.sqrt(np.diag(found.covariance))).all()


def test_pictures_that_do_not_belong_to_the_poses_are_refused():
    rng = np.random.default_rng(4)
    told = setup(rng, 8)
    with pytest.raises(InputError, match=r"do not agree with each other: (b\d by [\d.]+ pixels, )+b\d by .* are off"):
        found_in(
            told._replace(positions=rng.permutation(told.positions)),
            corners_of(told),
            names=[f"b{i}" for i in range(8)],
        )


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_turns_about_one_axis_leave_the_offset_along_it_open(axis):
    rng = np.random.default_rng(5)
    turns = [Rotation.from_rotvec(np.radians(angle) * np.array(axis)) for angle in np.linspace(-25, 25, 8)]
    told = setup(rng, turns=turns)
    words = ", ".join(f"{x:.2f}" for x in axis)
    with pytest.raises(
        InputError, match=rf"turned by 50 degrees about the axis \({words}\).*the camera's offset along"
    ):
        found_in(told, corners_of(told))


def test_an_arm_that_does_not_turn_leaves_the_offset_open():
    rng = np.random.default_rng(6)
    told = setup(rng, turns=[Rotation.from_euler("x", a, degrees=True) for a in rng.uniform(0, 0.2, 8)])
    with pytest.raises(InputError, match="turned by 0.1 degrees at most, which does not determine .* along any axis"):
        found_in(told, corners_of(told))


def test_two_pictures_are_too_few():
    told = setup(np.random.default_rng(7), 2)
    with pytest.raises(InputError, match="2 pictures can be used; expected 3 at least, and better 12"):
        found_in(told, corners_of(told))


def test_boards_that_look_the_same_upside_down_are_refused():
    for columns, rows in ((8, 6), (9, 5), (6, 6)):
        with pytest.raises(InputError, match=rf"{columns} x {rows} inner corners looks the same upside down"):
            Board(columns=columns, rows=rows, square=0.02)
    with pytest.raises(InputError, match="columns is 2"):
        Board(columns=2, rows=5, square=0.02)
    with pytest.raises(InputError, match="square is 0"):
        Board(columns=9, rows=6, square=0)
    assert BOARD.points[[0, 1, 9, -1]].tolist() == [[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0], [0.16, 0.1, 0]]


@pytest.mark.slow
def test_what_does_not_fit_is_refused():
    told = setup(np.random.default_rng(8), 5)
    corners = corners_of(told)
    with pytest.raises(InputError, match=r"corners has shape \(5, 53, 2\)"):
        found_in(told, corners[:, 1:])
    with pytest.raises(InputError, match="positions has shape"):
        found_in(told._replace(positions=told.positions[1:]), corners)
    with pytest.raises(InputError, match=r"orientations\[2\] has the length 2"):
        found_in(told._replace(orientations=told.orientations * np.array([1, 1, 2, 1, 1])[:, None]), corners)
    with pytest.raises(InputError, match="names are 2"):
        found_in(told, corners, names=["a", "b"])
    with pytest.raises(InputError, match="intrinsics is of type"):
        found_in(told, corners, intrinsics=None)
    with pytest.raises(InputError, match="the corners in picture 2 lie on a line"):
        found_in(told, np.where(np.arange(5)[:, None, None] == 1, corners[:, :, :1], corners))
    found = found_in(told, corners)
    with pytest.raises(InputError, match="pose has shape"):
        replace(found, pose=np.eye(3))
