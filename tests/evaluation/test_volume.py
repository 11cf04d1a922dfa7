"""Scores of voxels by hand, and true voxels of shapes with a closed form."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError
from millisight.evaluation import score_volume, volume_truth

GRID = ms.VoxelGrid(x=0.001 + 0.002 * np.arange(-20, 20), y=0.001 + 0.002 * np.arange(-20, 20),
                    z=0.0025 + 0.005 * np.arange(-10, 10))  # fmt: skip


def box(size, middle):
    """A box with sides along the axes, of 12 triangles."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[a, b, c] for q in sides for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    return ms.TriangleMesh(vertices=corners * size + middle, faces=faces)


def ball(radius):
    import trimesh

    shape = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return ms.TriangleMesh(vertices=shape.vertices, faces=shape.faces)


def volume(*spans):
    inside = np.zeros(GRID.shape, bool)
    for x, z in spans:
        inside[x, :, z] = True
    return ms.VolumeMask(grid=GRID, inside=inside)


def test_shares_by_hand():
    one, other = volume((slice(0, 10), slice(0, 4))), volume((slice(5, 10), slice(2, 8)))
    shared, of_one, of_other = 5 * 2, 10 * 4, 5 * 6
    expected = (shared / (of_one + of_other - shared), shared / of_one, shared / of_other)
    assert score_volume(one, other) == pytest.approx(expected)
    assert score_volume(one, one) == (1, 1, 1)
    none = volume()
    assert score_volume(none, none) == (1, 1, 1)
    assert score_volume(none, one) == score_volume(one, none) == (0, 0, 0)


def test_other_grids_are_refused():
    moved = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=GRID.z + 0.001)
    with pytest.raises(InputError, match="different grids, along z"):
        score_volume(volume(), ms.VolumeMask(grid=moved, inside=volume().inside))


def test_a_box_has_a_face_and_an_inside():
    shape, low, top = box((0.04, 0.032, 0.02), (0, 0, 0)), -0.01, 0.01
    seen = (abs(GRID.x)[:, None] < 0.02) & (abs(GRID.y) < 0.016)
    face = volume_truth(shape, GRID, within=0.0026)
    np.testing.assert_array_equal(face.inside, seen[..., None] & (abs(GRID.z - top) <= 0.0026))
    assert face.inside.sum() == 2 * seen.sum()  # the face lies between two voxels
    solid = volume_truth(shape, GRID, of="solid", within=0.0)
    np.testing.assert_array_equal(solid.inside, seen[..., None] & (GRID.z > low) & (GRID.z < top))
    thick = volume_truth(shape, GRID, within=0.01)
    np.testing.assert_array_equal(thick.inside, seen[..., None] & (abs(GRID.z - top) < 0.01))


def test_a_ball_is_as_its_equation_and_half_a_voxel_the_default():
    x, y = np.meshgrid(GRID.x, GRID.y, indexing="ij")
    squared = 0.025**2 - x**2 - y**2
    top = np.sqrt(np.maximum(squared, 0))
    clear = abs(squared) > 1e-4  # away from the rim, where a mesh is off most
    found = volume_truth(ball(0.025), GRID).inside
    expected = (abs(GRID.z - top[..., None]) <= 0.0025) & (squared > 0)[..., None]
    assert (found != expected)[clear].mean() < 0.01
    assert found[clear].any()
    solid = volume_truth(ball(0.025), GRID, of="solid", within=0.0).inside.sum() * 0.002**2 * 0.005
    assert solid == pytest.approx(4 / 3 * np.pi * 0.025**3, rel=0.03)


def test_of_several_parts_the_topmost_is_seen():
    parts = [box((0.04, 0.04, 0.01), (0, 0, z)) for z in (-0.0375, 0.0325)]
    both = volume_truth(parts, GRID)
    np.testing.assert_array_equal(both.inside, volume_truth(parts[1], GRID).inside)
    assert both.inside.any()
    solid = volume_truth(parts, GRID, of="solid", within=0.0)  # from -0.0425 to 0.0375
    assert solid.inside[20, 20].sum() == np.sum((GRID.z > -0.0425 - 1e-6) & (GRID.z < 0.0375 + 1e-6))


def test_what_cannot_be_is_refused():
    flat = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=[0.0])
    with pytest.raises(InputError, match="pass within, in metres"):
        volume_truth(ball(0.02), flat)
    assert volume_truth(ball(0.02), flat, of="solid", within=0.0).inside.any()
    with pytest.raises(UnknownNameError, match="truth"):
        volume_truth(ball(0.02), GRID, of="hull")
    for none, message in (([], "at least one"), (3.0, "mesh"), ([3.0], "mesh")):
        with pytest.raises(InputError, match=message):
            volume_truth(none, GRID)  # pyright: ignore[reportArgumentType]
