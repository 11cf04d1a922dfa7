"""Rotations that leave meshes as they are: of blocks, a cylinder, a ball, and of none."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers import posed
from millisight.core.errors import InputError
from millisight.geometry import symmetries
from millisight.meshes import build_object


@cache
def of_object(name):
    return symmetries(build_object(name))


@cache
def block_of(size):
    """A block in some pose, and its symmetries."""
    mesh = posed.block(np.zeros(3), np.array(size)).moved(
        rotation=posed.turn(3), translation=np.array([0.1, -0.2, 0.3])
    )
    return mesh, symmetries(mesh)


def angle_deg(one, other):
    return np.degrees(Rotation.from_matrix(one.T @ other).magnitude())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "count"), [((0.10, 0.06, 0.04), 4), ((0.06, 0.06, 0.10), 8), ((0.06, 0.06, 0.06), 24)]
)
def test_blocks_have_the_turns_of_their_group(size, count):
    mesh, found = block_of(size)
    assert found.rotations.shape == (count, 3, 3)
    assert len(found.axes) == 0
    np.testing.assert_allclose(found.middle, mesh.bounds.mean(axis=0), atol=2e-3)
    np.testing.assert_array_equal(found.rotations[0], np.eye(3))
    corners = mesh.vertices[np.unique(mesh.faces)] - found.middle
    for one in found.rotations:
        apart = np.linalg.norm((corners @ one.T)[:, None] - corners[None], axis=2).min(axis=1)
        assert apart.max() < 3 * found.tolerance


@pytest.mark.slow
def test_a_cylinder_turns_about_its_axis_and_a_ball_about_any():
    found = symmetries(build_object("tomato_soup_can").moved(rotation=posed.turn(5)))
    can = of_object("tomato_soup_can")
    assert len(found.axes) == len(can.axes) == 1
    assert abs(found.axes[0] @ posed.turn(5) @ can.axes[0]) > np.cos(np.radians(2))
    assert "any turn about" in found.about
    ball = of_object("baseball")
    assert len(ball.axes) == 3
    assert ball.about == "the same after any turn"


@pytest.mark.slow
def test_a_bracket_has_none_and_a_tolerance_decides():
    assert symmetries(posed.bracket()).about == "no symmetry"
    nearly = posed.block(np.zeros(3), np.array([0.06, 0.057, 0.10]))
    assert len(symmetries(nearly, tolerance=0.0035).rotations) == 8
    assert len(symmetries(nearly, tolerance=0.0012).rotations) == 4
    with pytest.raises(InputError, match="tolerance"):
        symmetries(nearly, tolerance=0)
    with pytest.raises(InputError, match="expected under half the mesh's size"):
        symmetries(nearly, tolerance=1)


def test_the_nearest_of_the_turns_that_look_alike():
    cube = block_of((0.06, 0.06, 0.06))[1]
    true = posed.turn(1)
    for number in (5, 11, 17):
        found = true @ cube.rotations[number] @ Rotation.from_rotvec([0.02, 0.01, 0]).as_matrix()
        assert angle_deg(cube.nearest(true, found), found) < 3
    can = of_object("tomato_soup_can")
    spun = true @ Rotation.from_rotvec(1.234 * can.axes[0]).as_matrix()
    assert angle_deg(can.nearest(true, spun), spun) < 0.1
    assert angle_deg(of_object("baseball").nearest(true, posed.turn(2)), posed.turn(2)) == 0
