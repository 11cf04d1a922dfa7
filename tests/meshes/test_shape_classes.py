"""Shapes drawn at random: whole, of their class's proportions, each another, the same from the same generator."""

import numpy as np
import pytest
import trimesh

from millisight.core.errors import UnknownNameError
from millisight.meshes import PAPER_CLASSES, PUBLISHED_CLASSES, RANDOM_SHAPES, SHAPE_CLASSES, random_shape

SEEDS = 15


@pytest.mark.slow
@pytest.mark.parametrize("shape_class", RANDOM_SHAPES)
def test_shapes_are_closed_centred_and_of_a_households_size(shape_class):
    extents = []
    for seed in range(SEEDS):
        mesh = random_shape(shape_class, np.random.default_rng(seed))
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.volume > 0
        np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-9)
        extents.append(mesh.extent)
    extents = np.array(extents)
    assert len(np.unique(extents.round(6), axis=0)) == SEEDS
    assert extents.min() > 0.003
    assert extents.max() < 0.4
    slender = extents.max(axis=1) / np.sort(extents, axis=1)[:, 1]  # the longest side over the second
    bounds = {"can": (1, 6), "handle": (1.2, np.inf), "sphere": (1, 1.6), "cup": (1, 3), "clamp": (1, 6)}
    least, most = bounds.get(shape_class, (1, np.inf))
    assert least <= slender.min()
    assert slender.max() < most


@pytest.mark.slow
def test_cups_are_hollow_and_clamps_are_open():
    def filled(shape_class):
        meshes = [random_shape(shape_class, np.random.default_rng(seed)) for seed in range(8)]
        solids = [trimesh.Trimesh(mesh.vertices, mesh.faces, process=False) for mesh in meshes]
        return max(solid.volume / solid.convex_hull.volume for solid in solids)

    assert filled("cup") < 0.5
    assert filled("clamp") < 0.8
    assert filled("can") > 0.9


def test_a_crumb_that_comes_off_a_whole_without_crumbs_is_left_out_too():
    rng = np.random.default_rng([29, 117, *b"household_sphere"])  # a capsule whose whole loses another, simplified
    mesh = random_shape("sphere", rng, household=True)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).body_count == 1


@pytest.mark.slow
@pytest.mark.parametrize("shape_class", PUBLISHED_CLASSES)
def test_household_things_are_closed_centred_and_fit_under_a_lid(shape_class):
    meshes = [random_shape(shape_class, np.random.default_rng(seed), household=True) for seed in range(2 * SEEDS)]
    for mesh in meshes:
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.volume > 0
        np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-9)
        assert mesh.extent.min() > 0.003
        assert mesh.extent.max() < 0.35
        assert mesh.extent[2] < 0.131
    kinds = {len(mesh.faces) for mesh in meshes}
    assert len(kinds) > SEEDS  # others every time
    slender = [mesh.extent.max() / np.sort(mesh.extent)[1] for mesh in meshes]
    bounds = {"can": (1, 6), "handle": (1.2, np.inf), "sphere": (1, 1.6), "cup": (1, 3), "clamp": (1, 6)}
    least, most = bounds.get(shape_class, (1, np.inf))
    assert least <= min(slender)
    assert max(slender) < most


def test_a_shape_follows_from_its_generator():
    for household in (False, True):
        first, second = (random_shape("handle", np.random.default_rng(5), household=household) for _ in range(2))
        np.testing.assert_array_equal(first.vertices, second.vertices)


def test_there_are_shapes_of_the_published_classes_and_no_other():
    assert tuple(RANDOM_SHAPES) == (*PUBLISHED_CLASSES, "odd")
    assert set(SHAPE_CLASSES) == {*PAPER_CLASSES, "other"}
    assert set(PAPER_CLASSES) < set(PUBLISHED_CLASSES)
    with pytest.raises(UnknownNameError, match="fruit"):
        random_shape("fruit", np.random.default_rng(0))
    with pytest.raises(UnknownNameError, match="odd"):
        random_shape("odd", np.random.default_rng(0), household=True)
