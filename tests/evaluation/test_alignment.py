"""Known shifts and turns, found again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.sampled_clouds import rms_off_the_surface, sampled
from millisight.core.errors import InputError, UnknownNameError
from millisight.evaluation import align
from millisight.meshes import CATALOGUE, build_object

POINTS = 8000
NAMES = tuple(CATALOGUE)[::2][:30]


def far_away(rng):
    """A shift of 3 cm and a turn of 10 degrees, any way."""
    shift, axis = rng.normal(size=(2, 3))
    turn = Rotation.from_rotvec(np.radians(10) * axis / np.linalg.norm(axis)).as_matrix()
    return turn, 0.03 * shift / np.linalg.norm(shift)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_resampled_objects_are_found_from_3_cm_and_10_degrees(name):
    rng = np.random.default_rng(NAMES.index(name))
    mesh = build_object(name)
    (moving, _), (fixed, _) = sampled(mesh, POINTS, rng), sampled(mesh, POINTS, rng)
    turn, shift = far_away(rng)
    found = align(moving, fixed @ turn.T + shift, mode="rigid", surfaces=True, most_points=POINTS)
    # Of round objects the points count, not the angle: these must lie on the surface.
    returned = (found.apply(moving[::30]) - shift) @ turn
    assert rms_off_the_surface(returned, mesh, rng) < 0.25e-3


def test_there_are_thirty_objects():
    assert len(NAMES) == len(set(NAMES)) == 30
    assert {CATALOGUE[name].shape_class for name in NAMES} == {"can", "handle", "box", "sphere", "other"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gelatin_box", "banana", "padlock", "adjustable_wrench", "medium_clamp"])
def test_of_what_is_not_round_every_point_returns_to_its_place(name):
    rng = np.random.default_rng(5)
    mesh = build_object(name)
    (moving, _), (fixed, _) = sampled(mesh, POINTS, rng), sampled(mesh, POINTS, rng)
    turn, shift = far_away(rng)
    found = align(moving, fixed @ turn.T + shift, mode="rigid", surfaces=True, most_points=POINTS)
    assert found.converged
    moved = found.apply(moving) - (moving @ turn.T + shift)
    assert np.sqrt((moved**2).sum(axis=1).mean()) < 0.25e-3


@pytest.mark.parametrize("mode", ["translation", "rigid"])
def test_the_same_points_are_found_exactly(mode):
    rng = np.random.default_rng(2)
    points = rng.random((400, 3)) * [0.1, 0.06, 0.04]
    turn, shift = (np.eye(3), np.array([0.02, -0.015, 0.01]))
    if mode == "rigid":
        turn = Rotation.from_euler("z", 9, degrees=True).as_matrix()
    found = align(points, points @ turn.T + shift, mode=mode)
    assert found.converged
    assert found.rms < 1e-9
    np.testing.assert_allclose(found.rotation, turn, atol=1e-9)
    np.testing.assert_allclose(found.translation, shift, atol=1e-9)


def test_a_translation_never_turns_and_the_same_clouds_give_the_same():
    rng = np.random.default_rng(3)
    one, two = rng.random((2, 500, 3)) * 0.1
    first, again = align(one, two), align(one, two)
    np.testing.assert_array_equal(first.rotation, np.eye(3))
    np.testing.assert_array_equal(first.translation, again.translation)


def test_it_says_when_the_iterations_ran_out():
    rng = np.random.default_rng(4)
    one, two = rng.random((2, 500, 3)) * 0.1
    found = align(one, two, mode="rigid", most_iterations=1, tolerance=1e-12)
    assert not found.converged
    assert found.iterations == 1


def test_a_single_point_is_laid_on_another_and_cannot_be_turned():
    found = align([[0.0, 0.0, 0.0]], [[0.1, 0.2, 0.3]])
    assert found.converged
    np.testing.assert_allclose(found.translation, [0.1, 0.2, 0.3])
    with pytest.raises(InputError, match="moving cloud is a single point; a rigid alignment needs at least 3"):
        align([[0.0, 0.0, 0.0]], [[0.1, 0.2, 0.3]], mode="rigid")


def test_empty_clouds_and_unknown_modes_are_refused():
    with pytest.raises(InputError, match="moving cloud is empty"):
        align(np.empty((0, 3)), np.zeros((1, 3)))
    with pytest.raises(InputError, match="fixed cloud is empty"):
        align(np.zeros((1, 3)), np.empty((0, 3)))
    with pytest.raises(UnknownNameError, match="mode of alignment 'affine'"):
        align(np.zeros((1, 3)), np.zeros((1, 3)), mode="affine")
    with pytest.raises(InputError, match=r"fixed cloud reaches 1e\+155 m"):
        align(np.zeros((1, 3)), np.full((1, 3), 1e155))
