"""Recipes that take mesh files: a folder of scans, and a table of classes that names them."""

import numpy as np
import pytest
import trimesh

from helpers.whole_scenes import PLAIN
from millisight.core.errors import FileError, UnknownNameError
from millisight.meshes import find_meshes
from millisight.perception import SPACING
from millisight.perception.training import (
    ClassifierRecipe,
    SceneSettings,
    SegmenterRecipe,
    make_scene,
    make_scenes,
)

COARSE = {"vertices": 300, "positions": 400}
PLAINLY = {**COARSE, "whole": PLAIN}


@pytest.fixture
def folder(tmp_path):
    """A long bar as a file, a ball in a folder as the published dataset has it, and a text."""
    trimesh.creation.box((0.16, 0.02, 0.02)).subdivide().export(tmp_path / "bar.ply")
    (tmp_path / "900_globe").mkdir()
    trimesh.creation.icosphere(radius=0.04).export(tmp_path / "900_globe" / "nontextured.stl")
    (tmp_path / "notes.txt").write_text("none\n")
    (tmp_path / "empty").mkdir()
    return tmp_path


def test_meshes_of_a_folder_go_by_the_names_of_files_and_folders(folder):
    assert {name: path.name for name, path in find_meshes(folder).items()} == {
        "bar": "bar.ply", "900_globe": "nontextured.stl",
    }  # fmt: skip
    with pytest.raises(FileError, match="holds no mesh"):
        find_meshes(folder / "empty")
    with pytest.raises(FileError, match="cannot read the folder of meshes"):
        find_meshes(folder / "none")


@pytest.mark.slow
def test_a_scene_shows_the_mesh_of_the_file(folder):
    settings = SceneSettings(**COARSE, meshes=str(folder), widest=0.4)
    for name, longest in (("bar", 0.16), ("900_globe", 0.08)):
        scene = make_scene(name, settings, rng=np.random.default_rng(3))
        places = np.argwhere(scene.inside) * SPACING
        assert len(places) > 10
        seen = np.linalg.svd(places - places.mean(axis=0), compute_uv=False) / len(places) ** 0.5
        # Of a bar the spread along it is its length over the root of 12; of a disc half its radius.
        expected = longest / 12**0.5 if name == "bar" else longest / 4
        assert seen[0] == pytest.approx(expected, rel=0.15)


@pytest.mark.slow
def test_a_classifier_learns_classes_of_own_meshes_beside_the_catalogues(folder, tmp_path):
    classes = {"long": ("bar", "fork"), "round": ("900_globe", "golf_ball")}
    recipe = ClassifierRecipe(classes=classes, meshes=str(folder), scenes=4, stretch={"long": 0.0}, **PLAINLY)
    requests = recipe.scene_requests()
    assert {(one.name, one.label) for one in requests} == {
        ("bar", 0), ("fork", 0), ("900_globe", 1), ("golf_ball", 1),
    }  # fmt: skip
    some = ClassifierRecipe(
        classes={"long": ("bar",), "round": ("900_globe",)}, meshes=str(folder), scenes=2, **PLAINLY
    )
    first = make_scenes(some, tmp_path / "scenes")
    again = make_scenes(some, tmp_path / "scenes")
    assert {one.name for one in first["training"]} == {"bar", "900_globe"}
    assert len(list((tmp_path / "scenes").glob("[!sw]*"))) == 4
    assert np.array_equal(first["training"][0].whole.objects, again["training"][0].whole.objects)
    trimesh.creation.box((0.10, 0.05, 0.02)).subdivide().export(folder / "bar.ply")
    make_scenes(some, tmp_path / "scenes")
    assert len(list((tmp_path / "scenes").glob("[!sw]*"))) == 6  # another mesh, other scenes
    with pytest.raises(UnknownNameError, match="unknown catalogue object 'rod'"):
        ClassifierRecipe(classes={"long": ("rod",), "round": ("golf_ball",)}, meshes=str(folder))


def test_a_segmenter_trains_on_own_meshes_too(folder):
    settings = SceneSettings(meshes=str(folder), validation=("900_globe",), poses=1)
    recipe = SegmenterRecipe(scenes=settings)
    sides = {one.name: one.side for one in recipe.scene_requests() if one.name in ("bar", "900_globe", "mug")}
    assert sides == {"bar": "training", "900_globe": "validation", "mug": "training"}
