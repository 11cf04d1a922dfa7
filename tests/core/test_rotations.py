"""Rotations against quarter turns done by hand, and against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from millisight.core import rotation_from_euler_deg, rotation_from_quaternion

X, Y, Z = np.eye(3)


@pytest.mark.parametrize(
    ("angles", "turned"),
    [((90, 0, 0), (X, Z, -Y)), ((0, 90, 0), (-Z, Y, X)), ((0, 0, 90), (Y, -X, Z)), ((90, 0, 90), (Y, Z, X))],
)
def test_quarter_turns(angles, turned):
    """Right-handed, about fixed axes, first x and last z: where the axes go."""
    np.testing.assert_allclose(rotation_from_euler_deg(angles), np.transpose(turned), atol=1e-15)


def test_any_angles_are_scipys_about_fixed_axes():
    for angles in np.random.default_rng(0).uniform(-180, 180, (20, 3)):
        expected = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        assert rotation_from_euler_deg(angles) == pytest.approx(expected, abs=1e-12)


def test_quaternions_are_scipys():
    turns = Rotation.random(50, rng=np.random.default_rng(1))
    assert rotation_from_quaternion(turns.as_quat()) == pytest.approx(turns.as_matrix(), abs=1e-12)
