"""Poses: their derived values, their region, and what is refused."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import NONE_OF_THEM

EIGHTH = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])


def pose(**other):
    settings = {
        "name": "mug", "rotation": EIGHTH, "translation": [0.1, 0.2, -0.3], "middle": [0.01, 0, 0.02],
        "covariance": np.diag([1e-6, 4e-6, 9e-6, 1e-2, 1e-2, 4e-2]), "free_axes": np.empty((0, 3)), "score": 0.5,
        "explained": 0.4, "shown": 0.6,
    }  # fmt: skip
    return ms.Pose(**settings | other)


def test_places_and_deviations_follow():
    one = pose()
    np.testing.assert_allclose(one.place, [0.106, 0.208, -0.28])
    np.testing.assert_allclose(one.T_world_mesh @ [0.01, 0, 0.02, 1], [*one.place, 1])
    assert one.place_sigma == pytest.approx(np.sqrt(14e-6 / 3))
    assert one.turn_sigma_deg == pytest.approx(np.degrees(np.sqrt(0.06 / 3)))
    assert pose(free_axes=[[0, 0, 1.0]]).turn_sigma_deg == pytest.approx(np.degrees(0.1))
    assert pose(free_axes=np.eye(3)).turn_sigma_deg == 0
    mesh = ms.Scene.from_mesh("rubiks_cube", vertices=200).mesh
    np.testing.assert_allclose(one.placed(mesh).vertices, mesh.vertices @ EIGHTH.T + [0.1, 0.2, -0.3])
    assert "mug at (106.0, 208.0, -280.0) mm" in repr(one)


def test_the_distance_counts_standard_deviations_and_leaves_free_turns_out():
    one = pose()
    assert one.distance(one.place, EIGHTH) == 0
    assert one.distance(one.place + np.array([0.002, 0, 0.003]), EIGHTH) == pytest.approx(np.sqrt(4 + 1))
    turned = np.array([[np.cos(0.4), -np.sin(0.4), 0], [np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]]) @ EIGHTH
    assert one.distance(one.place, turned) == pytest.approx(2)
    assert pose(free_axes=[[0, 0, 1.0]]).distance(one.place, turned) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"rotation": 2 * np.eye(3)}, "determinant is 8"),
        ({"rotation": np.diag([1.0, 1, -1])}, "determinant is -1"),
        ({"covariance": -np.eye(6)}, "negative variance"),
        ({"score": 1.5}, "score is 1.5; expected 0 to 1"),
        ({"translation": [0, 0]}, "translation"),
    ],
)
def test_what_is_no_pose_is_refused(wrong, told):
    with pytest.raises(InputError, match=told):
        pose(**wrong)


def test_probabilities_are_of_the_poses_and_of_none():
    points = ms.PointCloud(points=np.zeros((1, 3)))
    found = ms.Located(poses=(pose(),), probabilities={"mug": 0.8, NONE_OF_THEM: 0.2}, points=points)
    assert found.best is found.poses[0]
    assert found.ranking == [("mug", 0.8), (NONE_OF_THEM, 0.2)]
    assert "mug 80%" in repr(found)
    doubtful = ms.Located(poses=(pose(),), probabilities={"mug": 0.3, NONE_OF_THEM: 0.7}, points=points)
    assert doubtful.best is None
    assert doubtful.to_dict()["poses"][0]["T_world_mesh"][2][3] == -0.3
    for wrong in ({"mug": 1.0}, {"mug": 0.5, NONE_OF_THEM: 0.2}):
        with pytest.raises(InputError, match="probabilities are of mug"):
            ms.Located(poses=(pose(),), probabilities=wrong, points=points)
