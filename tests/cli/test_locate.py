"""`millisight locate` as a user meets it: a capture, meshes, what is written, and what cannot be."""

import json
import re
from functools import partial

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers import posed
from helpers.commands import run_here
from millisight.cli.locate import _remarks, _rows
from millisight.data import Located, Pose
from millisight.meshes import load_mesh

VOXELS = "-5cm:5cm:3mm,-5cm:5cm:3mm,-3cm:3cm:5mm"


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """A capture of a bracket turned at random, and its mesh, turned, in millimetres."""
    folder = tmp_path_factory.mktemp("bracket")
    bracket = posed.bracket()
    lying = bracket.moved(translation=-bracket.bounds.mean(axis=0)).moved(rotation=posed.turn(11))
    trajectory = ms.Trajectory.raster(size=(0.12, 0.12), step=0.003)
    capture = ms.simulate(
        ms.Scene.from_mesh(lying, vertices=4000, center=False), ms.Radar.preset("mito-sim-77ghz"), trajectory
    )
    ms.save(folder / "bracket.capture.h5", capture)
    trimesh.Trimesh(1e3 * bracket.vertices, bracket.faces).export(folder / "bracket.stl")
    return folder


@pytest.fixture
def here(stage, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = (str(stage / "bracket.capture.h5"), "--grid", VOXELS, "-o", "found.json")
    return lambda *arguments: run_here("locate", *given, *arguments)


@pytest.mark.slow
def test_poses_are_told_written_and_drawn(stage, here, tmp_path, monkeypatch):
    # A fifth of the rotations: tests/geometry asks whether poses are found.
    monkeypatch.setattr("millisight.geometry.locate", partial(ms.locate, turns=600))
    code, out, err, _ = here(
        "--mesh", str(stage / "bracket.stl"), "--mesh", "golf_ball", "--unit", "mm", "--placed", "there.ply",
        "--plot", "there.png", "--json", "--materials",
    )  # fmt: skip
    assert code == 0, err
    told = json.loads(out)
    assert told == json.loads((tmp_path / "found.json").read_text())
    assert {one["name"] for one in told["poses"]} == {"bracket", "golf_ball"}
    assert set(told["probabilities"]) == {"bracket", "golf_ball", "none of them"}
    pose = told["poses"][0]
    assert pose["name"] == "bracket"
    assert told["probabilities"]["bracket"] > 0.9
    bracket = posed.bracket()
    found = bracket.vertices @ np.array(pose["rotation"]).T + pose["translation"]
    true = (bracket.vertices - bracket.bounds.mean(axis=0)) @ posed.turn(11).T
    # Few of its faces shine at so small an aperture: tests/geometry asks for millimetres.
    assert np.linalg.norm(found - true, axis=1).mean() < 0.025
    np.testing.assert_allclose(
        load_mesh(tmp_path / "there.ply").bounds, [found.min(axis=0), found.max(axis=0)], atol=1e-5
    )
    assert (tmp_path / "there.png").read_bytes().startswith(b"\x89PNG")
    assert "golf_ball: the same after any turn" in err
    assert re.search(
        r"bracket: echoes specular [01]\.\d\d, edge [01]\.\d\d ± \d\.\d\d; the simulated image agrees", err
    )
    assert sum(pose["alpha"]) == pytest.approx(1)
    assert 0 < pose["agreement"] <= 1
    assert told["poses"][1]["alpha"] is None
    assert "oriented points" in err


def pose_of(name, weight):
    return Pose(
        name=name, rotation=np.eye(3), translation=np.zeros(3), middle=np.zeros(3), covariance=1e-6 * np.eye(6),
        free_axes=np.empty((0, 3)), score=0.6, explained=0.6, shown=0.6, weight=weight, symmetry="no symmetry",
    )  # fmt: skip


def located(*poses):
    points = ms.data.PointCloud(points=np.zeros((1, 3)))
    shares = {one.name: 0.9 / len(poses) for one in poses} | {"none of them": 0.1}
    return Located(poses=poses, probabilities=shares, points=points)


def test_of_one_mesh_the_probability_is_not_taken_for_the_poses():
    alone, two = located(pose_of("mug", 0.9)), located(pose_of("mug", 0.9), pose_of("bowl", 0.9))
    assert "probability" not in _rows(alone)[0]
    assert len(_rows(alone)) == 2
    assert "one mesh alone does not tell whether it is this object" in _remarks(alone, support=None)[0]
    assert _rows(two)[0][1] == "probability"
    assert _rows(two)[-1][:2] == ("none of them", "10 %")
    assert {len(row) for row in (*_rows(alone), *_rows(two))} == {10, 11}


def test_a_pose_among_many_as_good_is_said_to_be_unsure():
    assert not any("other poses" in remark for remark in _remarks(located(pose_of("mug", 0.3)), support=None))
    told = " ".join(_remarks(located(pose_of("mug", 0.08)), support=None))
    assert "other poses agree nearly as well, this one has 8 % of them all" in told
    assert "--support" in told
    assert "--support" not in " ".join(_remarks(located(pose_of("mug", 0.08)), support=-0.3))


@pytest.mark.slow
def test_a_wrong_unit_is_an_error_with_advice(stage, here, tmp_path):
    code, _, _, error = here("--mesh", str(stage / "bracket.stl"), "--unit", "in")
    assert code == 1
    assert "bracket is" in error
    assert "Load it with its unit" in error
    assert not (tmp_path / "found.json").exists()


def test_two_meshes_of_one_name_and_other_suffixes_are_refused(stage, here):
    assert "two meshes are called mug" in here("--mesh", "mug", "--mesh", "mug")[3]
    assert "mesh format" in here("--mesh", "mug", "--placed", "there.stl")[3]
