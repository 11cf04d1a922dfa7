"""The grid around a scene and around a capture."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from millisight.core.errors import InputError

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
SCENE = ms.Scene.from_mesh(ms.TriangleMesh(vertices=BOX.vertices, faces=BOX.faces), vertices=None)
RADAR = ms.Radar.preset("mito-sim-24ghz")


@pytest.fixture(scope="module")
def capture():
    return ms.simulate(SCENE.moved((0.2, 0.0, 0.0)), RADAR, ms.Trajectory.raster(size=0.1, step=0.05), model="edge")


def test_a_scene_s_grid_stands_out_by_the_margin():
    grid = ms.grid_around(SCENE, 0.01)
    assert grid.bounds == pytest.approx(np.array([[-0.07, -0.05, -0.04], [0.07, 0.05, 0.04]]))
    assert np.array_equal(ms.grid_around(SCENE.mesh, 0.01).bounds, grid.bounds)
    tight = ms.grid_around(SCENE, (0.01, 0.02, 0.04), margin=0.0)
    assert tight.shape == (11, 4, 2)
    assert tight.bounds[0] == pytest.approx([-0.05, -0.03, -0.02])


def test_a_capture_s_grid_is_around_its_scene_in_half_waves(capture):
    grid = ms.grid_around(capture)
    half = RADAR.waveform.wavelength / 2
    assert grid.bounds[0] == pytest.approx([0.2 - 0.07, -0.05, -0.04])
    assert [np.diff(axis).mean() for axis in (grid.x, grid.y, grid.z)] == pytest.approx([half, half, 2 * half])
    assert np.diff(ms.grid_around(capture, 0.005).z).mean() == pytest.approx(0.005)
    image = ms.form_image(capture, grid)
    assert image.magnitude.max() > 0


def test_a_described_capture_s_grid_is_the_stated_one(capture):
    stated = {"lower": [0.0, 0.0, -0.3], "upper": [0.1, 0.1, -0.2], "spacing": [0.01, 0.01, 0.02]}
    described = ms.Capture(
        radar=capture.radar, trajectory=capture.trajectory, frames=capture.frames, metadata={"image_grid": stated}
    )
    assert ms.grid_around(described).shape == (11, 11, 6)
    assert ms.grid_around(described, 0.02).shape == (6, 6, 6)


def test_what_cannot_be_is_named(capture):
    bare = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=capture.frames)
    for arguments, message in (
        ((SCENE,), "a scene alone has no wavelength; pass spacing"),
        ((bare,), "does not say where its scene is"),
        ((SCENE, 2.0), "voxels 2 m wide leave at most two along each axis"),
        (("mug", 0.01), "scene is of type str; expected Scene, TriangleMesh or Capture"),
        ((SCENE, 0), "spacing is 0 m"),
    ):
        with pytest.raises(InputError, match=message):
            ms.grid_around(*arguments)
    with pytest.raises(InputError, match="margin is -1 m"):
        ms.grid_around(SCENE, 0.01, margin=-1)
