"""Surfaces of voxels: closed, facing outwards, around every voxel inside and none outside, in the grid's frame."""

from collections import Counter

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.meshes import load_mesh, mask_surface, write_mesh

GRID = ms.VoxelGrid(x=0.1 + 0.002 * np.arange(7), y=-0.3 + 0.003 * np.arange(6), z=-0.2 + 0.01 * np.arange(5))


def volume_of(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def winding(mesh, points):
    """(n,) how often the surface goes around each point: 1 inside of a closed one that faces outwards, 0 outside.

    By the solid angles of the faces (van Oosterom and Strackee 1983, doi:10.1109/TBME.1983.325207).
    """
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    triple = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    dots = [np.einsum("nfi,nfi->nf", one, other) for one, other in ((a, b), (b, c), (c, a))]
    angles = 2 * np.arctan2(triple, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return angles.sum(axis=1) / (4 * np.pi)


def directed_edges(mesh):
    return Counter(map(tuple, mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()))


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.9, 1.0])
def test_it_separates_every_voxel_inside_from_those_outside(share):
    inside = np.random.default_rng(7).random(GRID.shape) < share
    assert inside.any()
    mesh = mask_surface(ms.VolumeMask(grid=GRID, inside=inside))
    np.testing.assert_allclose(winding(mesh, GRID.points), inside.ravel().astype(float), atol=1e-9)
    edges = directed_edges(mesh)
    assert set(edges.values()) == {1}  # closed, without branches, and wound alike:
    assert all(edges[b, a] == 1 for a, b in edges)


def test_a_box_ends_half_a_voxel_beyond_its_voxels():
    inside = np.zeros(GRID.shape, bool)
    inside[2:5, 1:4, 1:3] = True
    mesh = ms.VolumeMask(grid=GRID, inside=inside).surface()
    expected = [[0.103, -0.2985, -0.195], [0.109, -0.2895, -0.175]]
    np.testing.assert_allclose(mesh.bounds, expected, atol=1e-12)
    assert 0.8 < volume_of(mesh) / (0.006 * 0.009 * 0.02) < 1  # the edges are bevelled


def test_a_ball_has_its_volume_and_no_holes():
    axis = 0.001 * np.arange(41)
    grid = ms.VoxelGrid(x=axis, y=axis, z=axis)
    ball = (np.linalg.norm(grid.points - 0.02, axis=1) <= 0.0155).reshape(grid.shape)
    mesh = mask_surface(ms.VolumeMask(grid=grid, inside=ball))
    assert volume_of(mesh) == pytest.approx(4 / 3 * np.pi * 0.0155**3, rel=0.02)
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.faces) == 2  # Euler: a sphere


def test_what_the_grid_cuts_off_is_closed_and_uneven_or_lone_axes_are_kept():
    grid = ms.VoxelGrid(x=[0.0, 0.01, 0.04], y=[0.5], z=[0.0, 0.002])
    mesh = mask_surface(ms.VolumeMask(grid=grid, inside=np.ones(grid.shape, bool)))
    np.testing.assert_allclose(mesh.bounds, [[-0.005, 0.499, -0.001], [0.055, 0.501, 0.003]], atol=1e-12)
    np.testing.assert_allclose(winding(mesh, grid.points), 1, atol=1e-9)
    alone = ms.VoxelGrid(x=[0.0], y=[0.0], z=[0.0])
    lone = mask_surface(ms.VolumeMask(grid=alone, inside=[[[True]]]))
    np.testing.assert_allclose(lone.bounds, [[-0.0005] * 3, [0.0005] * 3])


def test_without_voxels_there_is_no_surface():
    with pytest.raises(InputError, match="no voxels inside"):
        mask_surface(ms.VolumeMask(grid=GRID, inside=np.zeros(GRID.shape, bool)))
    with pytest.raises(InputError, match="volume"):
        mask_surface(np.ones(GRID.shape, bool))  # pyright: ignore[reportArgumentType]


def test_a_mesh_comes_back_from_its_file(tmp_path):
    inside = np.random.default_rng(1).random(GRID.shape) < 0.1
    mesh = mask_surface(ms.VolumeMask(grid=GRID, inside=inside))
    write_mesh(tmp_path / "voxels.ply", mesh)
    assert [path.name for path in tmp_path.iterdir()] == ["voxels.ply"]
    kept = load_mesh(tmp_path / "voxels.ply", unit="m")
    assert kept.faces.shape == mesh.faces.shape
    np.testing.assert_allclose(kept.bounds, mesh.bounds, atol=1e-12)
    assert volume_of(kept) == pytest.approx(volume_of(mesh), rel=1e-9)
    with pytest.raises(UnknownNameError, match=r"unknown mesh format '.stl'"):
        write_mesh(tmp_path / "voxels.stl", mesh)
    with pytest.raises(FileError):
        write_mesh(tmp_path / "none" / "voxels.ply", mesh)
