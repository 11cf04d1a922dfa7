"""`millisight surface` as a user meets it: a capture, an image, and what cannot be."""

import json
import re

import numpy as np
import pytest
import trimesh
from PIL import Image

import millisight as ms
from helpers import posed, solid_mirrors
from helpers.commands import run_here
from millisight.cli.surface import _patches
from millisight.meshes import load_mesh

VOXELS = "-4cm:4cm:2mm,-4cm:4cm:2mm,-27.5cm:-23cm:3.75mm"


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A capture of a ball of 5 cm radius, 25 cm under the aperture."""
    path = tmp_path_factory.mktemp("ball") / "ball.capture.h5"
    ms.save(path, solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.15, step=0.003, noise=0.6))
    return path


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: run_here("surface", *arguments)


@pytest.mark.slow
def test_a_capture_gives_a_mesh_points_a_depth_map_and_a_picture(ball, tmp_path, here):
    asked = (str(ball), "--grid", VOXELS, "-o", "ball.ply", "--points", "points.ply", "--depth", "depth.npz", "--json")
    code, out, err, _ = here(*asked)
    assert code == 0, err
    told = json.loads(out)
    mesh, points = load_mesh(tmp_path / "ball.ply"), ms.read_point_cloud(tmp_path / "points.ply")
    assert told["points"] == len(points) > 50
    assert told["faces"] == len(mesh.faces) > 50
    away = np.linalg.norm(mesh.vertices - np.array([0, 0, -0.30]), axis=1) - 0.05
    assert np.median(np.abs(away)) < 2e-3
    assert ms.read_point_cloud(tmp_path / "ball.ply").place_sigma is not None
    with np.load(tmp_path / "depth.npz") as depth:
        assert depth["z"].shape == (len(depth["x"]), len(depth["y"]))
        assert np.nanmax(depth["z"]) == pytest.approx(-0.25, abs=2e-3)
    assert (tmp_path / "ball.surface.png").read_bytes().startswith(b"\x89PNG")
    assert "oriented points" in err


@pytest.mark.slow
def test_a_depth_picture_states_its_levels(ball, tmp_path, here):
    code, out, err, _ = here(str(ball), "--grid", VOXELS, "-o", "b.ply", "--depth", "depth.png", "--no-picture")
    assert code == 0, err
    lowest = float(out.split("above z = ")[1].split(" m")[0])
    with Image.open(tmp_path / "depth.png") as picture:
        levels = np.asarray(picture)
    assert levels.dtype == np.uint16
    assert lowest + 1e-5 * levels.max() == pytest.approx(-0.25, abs=2e-3)
    assert not (tmp_path / "b.surface.png").exists()


@pytest.mark.slow
def test_a_depth_picture_has_levels_for_all_heights(ball, tmp_path, here, monkeypatch):
    """Of 0.01 mm each they reach 65 cm: what lay higher was told as lower, without a word."""
    low, high = (posed.block([x, -0.02, z - 0.01], [x + 0.04, 0.02, z]) for x, z in ((-0.05, -0.4), (0.01, 0.4)))
    metadata = {"history": [{"step": "surface", "spacing": 0.002}], "patches": 2}
    made = ms.Surface(mesh=posed.together(low, high), sigma=np.full(16, 1e-3), metadata=metadata)
    monkeypatch.setattr("millisight.geometry.surface", lambda *_, **__: made)
    code, out, err, _ = here(str(ball), "--grid", VOXELS, "-o", "b.ply", "--depth", "two.png", "--no-picture")
    assert code == 0, err
    unit, lowest = (float(found) for found in re.search(r": (\S+) mm a level above z = (\S+) m", out).groups())
    with Image.open(tmp_path / "two.png") as picture:
        levels = np.asarray(picture)
    assert lowest + 1e-3 * unit * levels.max() == pytest.approx(0.4, abs=1e-4)
    assert lowest + 1e-3 * unit * levels[levels > 0].min() == pytest.approx(-0.4, abs=1e-4)


@pytest.mark.slow
def test_a_watertight_mesh_tells_what_was_not_seen(ball, tmp_path, here):
    code, _, err, _ = here(str(ball), "--grid", VOXELS, "-o", "b.ply", "--watertight", "--base=-32cm", "--no-picture")
    assert code == 0, err
    solid = trimesh.load_mesh(tmp_path / "b.ply", process=False)
    assert solid.is_watertight
    floor = np.isclose(solid.vertices[:, 2], -0.32)
    assert 0 < floor.sum() == len(floor) / 2
    assert (solid.visual.vertex_colors[floor, :3] == 128).all()


@pytest.mark.slow
def test_what_is_guessed_of_a_ball_is_told_from_what_was_seen(ball, tmp_path, here):
    code, out, err, _ = here(str(ball), "--grid", VOXELS, "-o", "b.ply", "--complete", "--no-picture", "--json")
    assert code == 0, err
    (told,) = json.loads(out)["guessed"]
    assert told["shape"] == "ball"
    assert told["radius"] == pytest.approx(0.05, rel=0.15)
    mesh = trimesh.load_mesh(tmp_path / "b.ply", process=False)
    seen = mesh.metadata["_ply_raw"]["vertex"]["data"]["seen"].astype(bool)
    assert 100 < (~seen).sum() == told["vertices"] == len(load_mesh(tmp_path / "b.guessed.ply").vertices)
    assert (mesh.visual.vertex_colors[~seen, :3] == 128).all()
    # Seen is the top, guessed what lies around it, as far down as an antenna sees.
    assert mesh.vertices[~seen, 2].max() < mesh.vertices[seen, 2].max()
    assert mesh.vertices[~seen, 2].min() < -0.28
    away = np.linalg.norm(mesh.vertices[~seen] - np.array([0, 0, -0.30]), axis=1) - 0.05
    assert np.abs(away).max() < 8e-3
    assert "guessed: a ball" in err
    code, _, _, refused = here(str(ball), "--grid", VOXELS, "-o", "c.ply", "--complete", "--watertight")
    assert code != 0
    assert "guess in two ways" in refused


@pytest.mark.parametrize(("count", "told"), [(0, "0 patches"), (1, "1 patch"), (2, "2 patches")])
def test_patches_are_counted(count, told):
    assert _patches(count) == told


@pytest.mark.slow
def test_an_image_will_do(ball, tmp_path, here):
    grid = ms.VoxelGrid.regular((-0.04, -0.04, -0.32), (0.04, 0.04, -0.23), (0.002, 0.002, 0.005))
    ms.save(tmp_path / "ball.image.h5", ms.form_image(ms.load(ball), grid, window="taylor"))
    code, out, err, _ = here("ball.image.h5")
    assert code == 0, err
    assert "wrote ball.surface.ply" in out
    code, _, _, told = here("ball.image.h5", "--grid", "2mm")
    assert code == 1
    assert "--grid is of captures" in told


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--clutter", "roof"), "--clutter"),
        (("--window", "hamming"), "Known: hann, none, taylor."),
        (("-o", "ball.stl"), "mesh format"),
        (("--depth", "depth.tif"), "depth map format"),
        ((), "pass --grid"),
        (("--grid", "20cm:24cm:2mm,20cm:24cm:2mm,-30cm:-24cm:4mm"), "expected at least 12"),
    ],
)
def test_what_cannot_be_is_told(ball, here, options, told):
    code, _, _, error = here(str(ball), *options)
    assert code == 1
    assert told in error
