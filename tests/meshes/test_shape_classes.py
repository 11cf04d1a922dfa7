"""Shapes drawn at random: whole, of their class's proportions, each another, the same from the same generator."""

import numpy as np
import pytest
import trimesh

from millisight.core.errors import UnknownNameError
from millisight.meshes import RANDOM_SHAPES, SHAPE_CLASSES, random_shape


@pytest.mark.parametrize("shape_class", RANDOM_SHAPES)
def test_shapes_are_closed_centred_and_of_a_households_size(shape_class):
    extents = []
    for seed in range(40):
        mesh = random_shape(shape_class, np.random.default_rng(seed))
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.volume > 0
        np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-9)
        extents.append(mesh.extent)
    extents = np.array(extents)
    assert len(np.unique(extents.round(6), axis=0)) == 40
    assert extents.min() > 0.003
    assert extents.max() < 0.4
    slender = extents.max(axis=1) / np.sort(extents, axis=1)[:, 1]  # the longest side over the second
    assert {"can": slender.max() < 6, "handle": slender.min() > 1.2, "box": True, "sphere": slender.max() < 1.6}[
        shape_class
    ]


def test_a_shape_follows_from_its_generator():
    first, second = (random_shape("handle", np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_there_are_shapes_of_the_papers_classes_and_no_other():
    assert set(RANDOM_SHAPES) == set(SHAPE_CLASSES) - {"other"}
    with pytest.raises(UnknownNameError, match="other"):
        random_shape("other", np.random.default_rng(0))
