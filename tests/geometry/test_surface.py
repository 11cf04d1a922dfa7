"""Meshes of oriented points: places, slopes, holes, patches, and depth maps."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.geometry import closed, depth_map

RADIUS = 0.04
MIDDLE = np.array([0, 0, -RADIUS])


def cap(reach=0.02, step=0.002, noise=0.0, tilt=0.0, rng=0):
    """Points on the top of a sphere around (0, 0, -RADIUS), moved along their normals at random."""
    x, y = (axis.ravel() for axis in np.meshgrid(*(np.arange(-reach, reach + step / 2, step),) * 2, indexing="ij"))
    normals = np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2)], axis=1) / RADIUS
    generator = np.random.default_rng(rng)
    places = RADIUS * normals - [0, 0, RADIUS] + noise * generator.normal(size=(len(x), 1)) * normals
    turned = normals + tilt * generator.normal(size=normals.shape)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return ms.PointCloud(
        points=places, normals=turned, place_sigma=np.full(len(x), noise),
        normal_sigma_deg=np.full(len(x), np.degrees(tilt)),
    )  # fmt: skip


def off_sphere(mesh):
    return np.abs(np.linalg.norm(mesh.vertices - MIDDLE, axis=1) - RADIUS)


def test_a_sphere_is_met():
    made = ms.surface(cap())
    assert len(made.mesh.faces) > 500
    assert off_sphere(made.mesh).max() < 3e-4
    truth = (made.mesh.vertices - MIDDLE) / RADIUS
    inner = np.abs(made.mesh.vertices[:, :2]).max(axis=1) < 0.018
    cosines = (made.mesh.vertex_normals * truth).sum(axis=1)[inner]
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 3
    assert made.metadata["patches"] == 1


def test_normals_carry_a_surface_through_noisy_places():
    noisy = cap(noise=1e-3, tilt=0.02)
    raw = np.abs(np.linalg.norm(noisy.points - MIDDLE, axis=1) - RADIUS)
    inner = np.abs((made := ms.surface(noisy)).mesh.vertices[:, :2]).max(axis=1) < 0.018
    assert np.sqrt(np.mean(off_sphere(made.mesh)[inner] ** 2)) < 0.5 * np.sqrt(np.mean(raw**2))


def test_holes_stay_open_and_patches_apart():
    whole = cap()
    ring = np.linalg.norm(whole.points[:, :2], axis=1) > 0.01
    open_one = ms.surface(whole.chosen(ring))
    middles = open_one.mesh.vertices[open_one.mesh.faces].mean(axis=1)
    assert np.linalg.norm(middles[:, :2], axis=1).min() > 0.005
    two = ms.PointCloud(
        points=np.concatenate([whole.points, whole.points - [0, 0, 0.05]]), normals=np.concatenate([whole.normals] * 2)
    )
    assert ms.surface(two).metadata["patches"] == 2


def test_false_alarms_are_left_out():
    whole = cap()
    stray = ms.PointCloud(
        points=np.concatenate([whole.points, [[0, 0, 0.05], [0.03, 0, 0.06]]]),
        normals=np.concatenate([whole.normals, [[0, 0, 1], [0, 0, 1]]]),
    )
    assert ms.surface(stray).mesh.bounds[1, 2] < 0.01


def test_it_does_not_matter_how_the_surface_lies():
    """Heights are over a patch's own plane: a turned one is the same, turned."""
    level = cap()
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    made = ms.surface(ms.PointCloud(points=level.points @ turn.T, normals=level.normals @ turn.T))
    assert off_sphere(ms.TriangleMesh(vertices=made.mesh.vertices @ turn, faces=made.mesh.faces)).max() < 3e-4


def test_a_depth_map_is_the_height_of_the_mesh():
    made = ms.surface(cap(noise=1e-4))
    axis = np.linspace(-0.03, 0.03, 13)
    heights, sigma = depth_map(made, ms.PixelGrid(x=axis, y=axis))
    x, y = np.meshgrid(axis, axis, indexing="ij")
    inside = np.maximum(np.abs(x), np.abs(y)) < 0.019
    assert inside.sum() == 49
    truth = np.sqrt(RADIUS**2 - x[inside] ** 2 - y[inside] ** 2) - RADIUS
    assert np.abs(heights[inside] - truth).max() < 4e-4
    assert (sigma[inside] > 0).all()
    assert np.isnan(heights[0, 0])
    assert np.isnan(sigma[0, 0])


def test_what_makes_no_surface_is_refused():
    whole = cap()
    with pytest.raises(InputError, match="no normals"):
        ms.surface(ms.PointCloud(points=whole.points))
    with pytest.raises(InputError, match="there are 3 points; expected at least 12"):
        ms.surface(whole.chosen(np.arange(3)))
    # Neighbours that face away from each other are of no one surface.
    apart = ms.PointCloud(points=[[0.002 * i, 0, 0] for i in range(20)], normals=[[0, 0, (-1) ** i] for i in range(20)])
    with pytest.raises(InputError, match="hang together"):
        ms.surface(apart)
    with pytest.raises(InputError, match="pass a larger spacing"):
        ms.surface(whole, spacing=1e-6)


@pytest.mark.parametrize("hole", [False, True])
def test_a_closed_surface_is_watertight_and_tells_what_was_seen(hole):
    import trimesh

    whole = cap()
    points = whole.chosen(np.linalg.norm(whole.points[:, :2], axis=1) > 0.008) if hole else whole
    seen = ms.surface(points)
    made = closed(seen, base=-0.05)
    solid = trimesh.Trimesh(made.mesh.vertices, made.mesh.faces, process=False)
    assert not trimesh.Trimesh(seen.mesh.vertices, seen.mesh.faces, process=False).is_watertight
    assert solid.is_watertight
    assert solid.is_winding_consistent
    count = made.metadata["seen_vertices"]
    assert np.abs(np.linalg.norm(made.mesh.vertices[:count] - MIDDLE, axis=1) - RADIUS).max() < 5e-4
    assert made.mesh.vertices[count:, 2] == pytest.approx(-0.05)
    assert made.sigma[count:].min() > 0.03 > made.sigma[:count].max()
    # A prism under the cap: its volume is that of the columns under the faces seen.
    corners = seen.mesh.vertices[seen.mesh.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert solid.volume == pytest.approx((area * (corners[..., 2].mean(axis=1) + 0.05)).sum(), rel=0.02)


def test_faces_that_touch_in_a_corner_are_left_out_of_a_closed_surface():
    import trimesh

    x, y = np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (1, 1)]).T
    mesh = ms.TriangleMesh(vertices=np.stack([x, y, 0 * x], axis=1), faces=[[0, 1, 2], [0, 3, 4], [1, 5, 2]])
    made = closed(ms.Surface(mesh=mesh, sigma=np.zeros(6)))
    assert made.metadata["seen_vertices"] == 3
    assert trimesh.Trimesh(made.mesh.vertices, made.mesh.faces, process=False).is_watertight
    alone = ms.TriangleMesh(vertices=mesh.vertices[:5], faces=mesh.faces[:2])
    with pytest.raises(InputError, match="single corners"):
        closed(ms.Surface(mesh=alone, sigma=np.zeros(5)))


def test_a_floor_lies_below_what_was_seen():
    with pytest.raises(InputError, match="expected a floor below it"):
        closed(ms.surface(cap()), base=0.1)


@pytest.mark.slow
def test_heaps_of_points_and_odd_lengths_take_little_time_and_are_told():
    """Half of the points in a micrometre: pairs of them would fill ten gigabytes."""
    rng = np.random.default_rng(0)
    line = np.linspace(0, 0.04, 21)
    flat = np.stack([*np.meshgrid(line, line), np.zeros((21, 21))], axis=-1).reshape(-1, 3)

    def cloud(places, **sigmas):
        return ms.PointCloud(points=places, normals=np.tile([0.0, 0, 1], (len(places), 1)), **sigmas)

    heaped = np.concatenate([flat, [0.02, 0.02, 0] + 1e-6 * rng.random((400, 3))])
    assert ms.surface(cloud(heaped)).mesh.extent[:2] == pytest.approx([0.043, 0.043], abs=0.004)
    plain = cloud(flat)
    for settings, told in [
        ({"reach": 1.0}, "cells lie within 1 m of 441 points; expected at most 50000"),
        ({"reach": 1e-300}, "no 12 hang together"),
        ({"spacing": 1e-300}, "would have inf cells"),
    ]:
        with pytest.raises(InputError, match=told):
            ms.surface(plain, **settings)
    assert (
        ms.surface(cloud(flat, place_sigma=np.full(441, 1e300), normal_sigma_deg=np.full(441, 1e300))).sigma.max() > 1
    )
    for grid in (None, 3, ms.VoxelGrid.regular((0, 0, 0), (1, 1, 1), 0.5)):
        with pytest.raises(InputError, match="expected PixelGrid"):
            depth_map(ms.surface(plain), grid)


def test_a_depth_map_does_not_depend_on_where_the_world_begins():
    """Rays are of single precision."""
    made = ms.surface(cap())
    far = np.array([1e5, 0, 1e5])
    moved = ms.Surface(mesh=made.mesh.moved(translation=far), sigma=made.sigma, metadata={})
    line = np.linspace(-0.01, 0.01, 5)
    near, _ = depth_map(made, ms.PixelGrid(x=line, y=line))
    there, _ = depth_map(moved, ms.PixelGrid(x=line + far[0], y=line))
    assert there - far[2] == pytest.approx(near, abs=1e-6)
