"""Scenes and materials: what is refused, and how a scene is named."""

import os
import re

import numpy as np
import pytest
import trimesh

import millisight as ms
from millisight.core.errors import InputError, MeshError, UnknownNameError
from millisight.data import material_named
from millisight.meshes import load_mesh


@pytest.fixture(scope="module")
def scene():
    return ms.Scene.from_mesh("cracker_box", vertices=None)


def test_a_scene_is_made_of_objects(scene):
    mesh, material = scene.mesh, scene.objects[0].material
    for make, message in (
        (lambda: ms.Scene(objects=(1, 2)), "a scene's object is of type int; expected SceneObject"),
        (lambda: ms.Scene(objects=3), "3 was given; expected a sequence, each of it a scene's object"),
        (lambda: ms.Scene(objects=()), "without objects"),
        (lambda: scene + 3, "what is added to a scene is of type int; expected Scene"),
        (lambda: ms.SceneObject(name="a", mesh=3, material=material), "mesh is of type int"),
        (lambda: ms.SceneObject(name="a", mesh=mesh, material="metal"), "material is of type str"),
        (lambda: ms.SceneObject(name=3, mesh=mesh, material=material), "name is of type int"),
        (lambda: scene.moved(0.1), "translation has shape"),
        (lambda: mesh.moved(rotation=np.eye(2)), r"rotation has shape \(2, 2\); expected \(3, 3\)"),
    ):
        with pytest.raises(InputError, match=message):
            make()


def test_edges_are_sharp_that_turn_by_more_than_the_angle():
    """A tube of twelve sides, whose faces turn by 30 degrees, of three rings: the outer two are rims, sharp always."""
    around = np.arange(12) * np.pi / 6
    ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    here, beside = np.arange(12), np.roll(np.arange(12), -1)
    band = np.concatenate([np.stack([here, beside, here + 12], 1), np.stack([beside, beside + 12, here + 12], 1)])
    tube = ms.TriangleMesh(
        vertices=np.concatenate([ring + np.array([0, 0, z]) for z in (0, 1, 2)]),
        faces=np.concatenate([band, band + 12]),
    )
    rims = np.repeat([True, False, True], 12)
    for edge_deg, middle in ((1.0, True), (29.0, True), (31.0, False), (59.0, False), (180.0, False)):
        assert np.array_equal(tube.sharp_vertices(edge_deg), rims | middle)


@pytest.mark.parametrize("rotate_deg", [90, (0, 90), "0 0 90", None, (0, 0, np.nan)])
def test_impossible_rotations_are_refused(rotate_deg):
    with pytest.raises(InputError, match="rotate_deg"):
        ms.Scene.from_mesh("cracker_box", vertices=None, rotate_deg=rotate_deg)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reflection": "a"}, "reflection cannot be read"),
        ({"reflection": 0}, "reflection| is 0"),
        ({"reflection": 1.1}, "expected at most 1"),
        ({"reflection": complex(0, np.inf)}, "reflection has 1 values that are NaN or infinite"),
        ({"alpha": 0.5}, "alpha is 0.5; expected 2 numbers"),
        ({"alpha": (1, 1, 1)}, "alpha has 3 numbers"),
        ({"name": 3}, "name is of type int"),
    ],
)
def test_impossible_materials_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        ms.Material(**({"name": "odd"} | changes))


def test_unknown_materials_are_refused():
    for name in ("mithril", 3, ["metal"]):
        with pytest.raises(UnknownNameError, match="unknown material"):
            material_named(name)


def test_absurd_sizes_are_refused_quietly(tmp_path):
    """No warnings, which are errors here, and no number of three hundred digits."""
    path = tmp_path / "far.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1e308 0 0\n0 -1e308 0\n3 0 1 2\n")
    with pytest.raises(MeshError, match=rf"^{re.escape(str(path))} has coordinates of 1e\+308; expected under 1e\+09"):
        load_mesh(path)
    with pytest.raises(MeshError, match=r"far.off has coordinates of 1e\+308"):
        load_mesh(path, unit="mm")
    with pytest.raises(MeshError, match=r"the mesh has coordinates of 1e\+200"):
        ms.TriangleMesh(vertices=np.eye(3) * 1e200, faces=[[0, 1, 2]])
    with pytest.raises(MeshError, match=r"is 1e\+08 m wide"):
        load_mesh(trimesh.creation.box((1e8, 1, 1)))


@pytest.mark.skipif(os.name != "posix", reason="such names exist where names are bytes")
def test_a_file_name_in_another_encoding(tmp_path):
    path = tmp_path / os.fsdecode(b"M\xfchle.stl")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(path)
    scene = ms.Scene.from_mesh(str(path), vertices=None)
    assert scene.objects[0].name == r"M\udcfchle"
    ms.save(tmp_path / "s.h5", scene)
    assert ms.load(tmp_path / "s.h5").objects[0].name == r"M\udcfchle"


def test_repr_is_short(scene):
    assert repr(scene.mesh) == (
        "TriangleMesh(8 vertices, 12 faces, x -0.1069 to 0.1069 m, y -0.0818 to 0.0818 m, z -0.03585 to 0.03585 m)"
    )
