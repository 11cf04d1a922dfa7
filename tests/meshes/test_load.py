"""Loading: every format, every repair, and every refusal by its message."""

import json
import logging
import re
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
import trimesh

from helpers.closed_meshes import edge_owners, volume, wound_alike
from millisight.core.errors import FileError, MeshError, UnknownNameError
from millisight.meshes import FORMATS, load_mesh


def lopsided() -> trimesh.Trimesh:
    """A closed shape without symmetry, off the origin: 0.26 m wide."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    mesh.apply_transform(np.array([[1.3, 0.2, 0, 0.4], [0, 0.8, 0.1, -0.2], [0, 0, 0.5, 0.7], [0, 0, 0, 1]]))
    return mesh


def sorted_corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Each face as nine numbers, its smallest corner first, the faces in order: independent of all numbering."""
    corners = np.round(vertices[faces], 6) + 0.0
    keys = corners @ [1.0, np.pi, np.e**2]
    turn = (keys.argmin(axis=1)[:, None] + np.arange(3)) % 3
    rows = np.take_along_axis(corners, turn[..., None], axis=1).reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize("suffix", [*FORMATS, "STL"])
def test_every_format_gives_the_same_faces(tmp_path, suffix):
    expected = lopsided()
    path = tmp_path / f"shape.{suffix}"
    expected.export(path, file_type=suffix.lower())
    mesh = load_mesh(path)
    assert mesh.faces.shape == (320, 3)
    assert mesh.vertices.shape == (162, 3)
    np.testing.assert_allclose(
        sorted_corners(mesh.vertices, mesh.faces), sorted_corners(expected.vertices, expected.faces), atol=2e-6
    )


def test_normals_that_are_no_numbers_are_not_needed(tmp_path, caplog):
    """trimesh logged a traceback."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    text = re.sub("facet normal .*", "facet normal 0 x 1", trimesh.exchange.stl.export_stl_ascii(box))
    (tmp_path / "a.stl").write_text(text, encoding="ascii")
    assert len(load_mesh(tmp_path / "a.stl").faces) == 12
    assert not [record for record in caplog.records if record.name == "trimesh"]


def test_text_stl_and_text_ply(tmp_path):
    expected = lopsided()
    (tmp_path / "a.stl").write_text(trimesh.exchange.stl.export_stl_ascii(expected), encoding="ascii")
    (tmp_path / "a.ply").write_bytes(trimesh.exchange.ply.export_ply(expected, encoding="ascii"))
    for name in ("a.stl", "a.ply"):
        mesh = load_mesh(tmp_path / name)
        assert mesh.faces.shape == (320, 3)
        assert mesh.area == pytest.approx(expected.area, rel=1e-5)


def test_path_as_text_and_as_trimesh_agree(tmp_path):
    path = tmp_path / "shape.off"
    lopsided().export(path)
    assert np.allclose(load_mesh(str(path)).bounds, load_mesh(lopsided()).bounds, atol=1e-7)


def test_scene_parts_keep_their_places(tmp_path):
    scene = trimesh.Scene()
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[:3, 3] = (1, 0, 0)
    scene.add_geometry(box, node_name="left")
    scene.add_geometry(box, node_name="right", transform=mirror)
    scene.export(tmp_path / "two.glb")
    for source in (scene, tmp_path / "two.glb"):
        mesh = load_mesh(source)
        assert mesh.faces.shape == (24, 3)
        np.testing.assert_allclose(mesh.bounds, [[-0.05, -0.05, -0.05], [1.05, 0.05, 0.05]], atol=1e-6)
        assert volume(mesh) == pytest.approx(2e-3, rel=1e-5)


# Units ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)])
def test_unit_scales_to_metres(unit, metres):
    assert load_mesh(trimesh.creation.box((1, 2, 3)), unit=unit).extent == pytest.approx(np.array([1, 2, 3]) * metres)


def test_plausible_metres_are_silent(caplog):
    assert load_mesh(trimesh.creation.box((0.1, 0.2, 1.9))).extent == pytest.approx([0.1, 0.2, 1.9])
    assert not caplog.records


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (117, r"is 117 m wide when read in metres; did you mean millimetres \(11.7 cm wide\) or centimetres \(1.17 m"),
        (1500, r"is 1500 m wide .*; did you mean millimetres \(1.5 m wide\)\? Pass unit='mm', or unit='m' to keep it"),
        (4, r"is 4 m wide .*; did you mean centimetres \(4 cm wide\) or inches \(10.2 cm wide\)\? Pass unit='cm' or"),
        (0.001, r"is 1 mm wide .*no usual unit makes it an everyday object of 5 mm to 2 m; pass unit='m'"),
        (1e5, r"is 100000 m wide .*no usual unit"),
    ],
)
def test_unclear_unit_is_asked_for(size, message):
    box = trimesh.creation.box((size, size / 2, size / 3))
    with pytest.raises(MeshError, match=message):
        load_mesh(box)
    assert load_mesh(box, unit="m").extent.max() == pytest.approx(size)


def test_glb_is_metres_by_specification(tmp_path):
    path = tmp_path / "house.glb"
    trimesh.creation.box((10, 10, 10)).export(path)
    assert load_mesh(path).extent.max() == pytest.approx(10)
    assert load_mesh(path, unit="cm").extent.max() == pytest.approx(0.1)


def test_stated_unit_is_taken():
    box = trimesh.creation.box((100, 100, 100))
    box.units = "mm"
    assert load_mesh(box).extent.max() == pytest.approx(0.1)
    assert load_mesh(box, unit="cm").extent.max() == pytest.approx(1)
    box.units = "cubits"
    with pytest.raises(MeshError, match="states the unit 'cubits', which is not known; pass unit"):
        load_mesh(box)


def test_unknown_unit():
    with pytest.raises(UnknownNameError, match=r"unknown unit of length 'inch'.*cm, in, m, mm"):
        load_mesh(lopsided(), unit="inch")


# Refusals ------------------------------------------------------------------------------------------------------


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileError, match=r"mug\.stl does not exist; expected a mesh file \(stl, obj"):
        load_mesh(tmp_path / "mug.stl")
    with pytest.raises(FileError, match="is a folder; expected a mesh file"):
        load_mesh(tmp_path)


def test_a_file_too_large_for_memory_is_not_read(tmp_path):
    with open(tmp_path / "city.stl", "wb") as file:
        file.truncate(5 << 30)  # holes take no room
    with pytest.raises(MeshError, match=r"city\.stl has 5\.4 GB; expected a mesh of at most 1\.1 GB"):
        load_mesh(tmp_path / "city.stl")


def test_unknown_suffix(tmp_path):
    (tmp_path / "mug.plyy").write_text("ply")
    with pytest.raises(UnknownNameError, match=r"unknown mesh format 'plyy'\. Did you mean 'ply'\?"):
        load_mesh(tmp_path / "mug.plyy")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize(
    "content", [b"", b"this is not a mesh\n" * 40, bytes(range(256)) * 8], ids=["empty", "text", "bytes"]
)
def test_garbage_is_named(tmp_path, suffix, content):
    (tmp_path / f"bad.{suffix}").write_bytes(content)
    with pytest.raises(MeshError, match=rf"bad\.{suffix} .*export it again") as caught:
        load_mesh(tmp_path / f"bad.{suffix}")
    assert "\n" not in str(caught.value)
    assert "Module" not in str(caught.value)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("suffix", ["stl", "ply", "off", "glb"])
def test_truncated_is_refused(tmp_path, suffix, share):
    path = tmp_path / f"cut.{suffix}"
    lopsided().export(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(MeshError, match=rf"cut\.{suffix} .*export it again"):
        load_mesh(path)


def test_wrong_source_is_named():
    with pytest.raises(MeshError, match=r"source is a ndarray; expected a path, a trimesh\.Trimesh or"):
        load_mesh(np.zeros((3, 3)))


def test_no_faces():
    with pytest.raises(MeshError, match="has 0 vertices but no faces; expected a surface"):
        load_mesh(trimesh.Trimesh())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_not_finite(value):
    mesh = lopsided()
    vertices = np.array(mesh.vertices)
    vertices[[3, 7], 1] = value
    with pytest.raises(MeshError, match="has 2 vertices that are NaN or infinite"):
        load_mesh(trimesh.Trimesh(vertices, mesh.faces, process=False))


def test_all_faces_without_area():
    flat = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]], [[0, 1, 2], [1, 2, 3]], process=False)
    with pytest.raises(MeshError, match="every face of the Trimesh has zero area"):
        load_mesh(flat)


def test_face_beyond_the_vertices():
    with pytest.raises(MeshError, match="has a face with vertex 9, but 3 vertices"):
        load_mesh(trimesh.Trimesh(np.eye(3) * 0.1, [[0, 1, 9]], process=False))


def test_branching_mesh_is_refused_with_the_count():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    other = box.copy().apply_translation((0.1, 0.1, 0))  # touches the first along one edge: shared by four faces
    with pytest.raises(MeshError, match=r"1 of 35 edges of .* shared by three or more faces; .*Blender or MeshLab"):
        load_mesh(trimesh.util.concatenate([box, other]))


# Repairs -------------------------------------------------------------------------------------------------------


def test_flipped_faces_are_turned(caplog):
    expected = lopsided()
    faces = np.array(expected.faces)
    flipped = np.random.default_rng(0).random(len(faces)) < 0.4
    faces[flipped] = faces[flipped][:, ::-1]
    mesh = load_mesh(trimesh.Trimesh(expected.vertices, faces, process=False))
    np.testing.assert_allclose(
        sorted_corners(mesh.vertices, mesh.faces), sorted_corners(expected.vertices, expected.faces)
    )
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert f"turned {flipped.sum()} faces" in record.getMessage()


def test_each_closed_part_faces_outward_by_itself():
    inside_out = trimesh.creation.box((0.1, 0.1, 0.1))
    inside_out.invert()
    sphere = lopsided()
    mesh = load_mesh(trimesh.util.concatenate([inside_out, sphere]))
    assert len(mesh.faces) == 12 + 320
    assert wound_alike(mesh)
    assert volume(mesh) == pytest.approx(1e-3 + sphere.volume)


def test_open_part_keeps_what_most_faces_say():
    rows, columns = np.mgrid[:6, :6]
    vertices = np.stack([rows.ravel(), columns.ravel(), np.zeros(36)], axis=1) * 0.02
    corner = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    faces = np.concatenate(
        [np.stack(x, axis=1) for x in ((corner, corner + 6, corner + 7), (corner, corner + 7, corner + 1))]
    )
    faces[:20] = faces[:20, ::-1]
    mesh = load_mesh(trimesh.Trimesh(vertices, faces, process=False))
    assert len(mesh.faces) == 50
    np.testing.assert_allclose(mesh.face_normals, np.tile([0, 0, 1.0], (50, 1)))


def test_moebius_strip_is_left_as_it_is(caplog):
    turns = np.arange(24) * 2 * np.pi / 24
    across = np.stack([np.cos(turns / 2) * np.cos(turns), np.cos(turns / 2) * np.sin(turns), np.sin(turns / 2)], axis=1)
    middle = 0.1 * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    vertices = np.concatenate([middle + 0.02 * across, middle - 0.02 * across])
    i = np.arange(24)
    after, other = np.where(i < 23, i + 1, 24), np.where(i < 23, i + 25, 0)
    faces = np.concatenate([np.stack([i, after, other], axis=1), np.stack([i, other, i + 24], axis=1)])
    mesh = load_mesh(trimesh.Trimesh(vertices, faces, process=False))
    assert len(mesh.faces) == 48
    assert "one side only" in caplog.text


def test_degenerate_and_repeated_faces_go(caplog):
    expected = lopsided()
    faces = np.concatenate([expected.faces, expected.faces[:5], expected.faces[7:9, [1, 0, 2]], [[0, 0, 1], [4, 5, 4]]])
    vertices = np.concatenate([expected.vertices, [[np.nan, 9, 9]]])  # no face uses it
    mesh = load_mesh(trimesh.Trimesh(vertices, faces, process=False))
    assert mesh.faces.shape == (320, 3)
    assert mesh.vertices.shape == (162, 3)
    (record,) = caplog.records
    assert "dropped 2 degenerate faces, dropped 7 repeated faces" in record.getMessage()


def test_a_stray_flap_is_removed(caplog):
    sphere = lopsided()
    tip = sphere.vertices[sphere.faces[0]].mean(axis=0) * 1.05
    vertices = np.concatenate([sphere.vertices, [tip]])
    faces = np.concatenate([sphere.faces, [[*sphere.faces[0, :2], len(sphere.vertices)]]])
    mesh = load_mesh(trimesh.Trimesh(vertices, faces, process=False))
    assert mesh.faces.shape == (320, 3)
    assert (edge_owners(mesh) == 2).all()
    assert volume(mesh) == pytest.approx(sphere.volume)
    assert "removed 1 face from edges shared by three or more" in caplog.text


def test_a_clean_mesh_is_not_touched(caplog):
    expected = lopsided()
    mesh = load_mesh(expected)
    assert not caplog.records
    np.testing.assert_allclose(
        sorted_corners(mesh.vertices, mesh.faces), sorted_corners(expected.vertices, expected.faces)
    )


def test_importing_the_loader_imports_no_trimesh():
    code = "import sys, millisight.meshes._load; sys.exit('trimesh' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def triangle_glb(tmp_path, **changes):
    """A GLB file of one triangle, its description changed."""
    data = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], "<f4").tobytes() + np.arange(3, dtype="<u4").tobytes()
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}],
        "buffers": [{"byteLength": 48}],
        **changes,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(data)) + b"BIN\0" + data
    (tmp_path / "t.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return tmp_path / "t.glb"


CHAIN = [{"children": [i + 1]} for i in range(5000)] + [{"mesh": 0}]


def unstored(count):
    """Vertices that no buffer holds: zeros by the specification."""
    vertices = {"componentType": 5126, "count": count, "type": "VEC3"}
    return [vertices, {"componentType": 5125, "count": 3, "type": "SCALAR"}]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"accessors": unstored(10**9)}, "its meshes take 12000000012 bytes"),
        ({"nodes": [{"mesh": 0}] * 2000, "accessors": unstored(1000)}, "its meshes take 24024000 bytes"),
        ({"nodes": CHAIN}, "its nodes hang more than 100 deep"),
        ({"nodes": [{"children": [1]}, {"children": [0], "mesh": 0}]}, "in a circle"),
        ({"nodes": [{"children": [1, 1]}, {"mesh": 0}]}, "below two others"),
        ({"accessors": 5}, "its description cannot be followed"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 7}}]}]}, "its description cannot be followed"),
    ],
    ids=["unstored", "instances", "chain", "circle", "twice", "no list", "no accessor"],
)
def test_a_glb_that_asks_for_more_than_it_holds_is_refused(tmp_path, changes, message):
    """616 bytes asked for 13 GiB."""
    assert len(load_mesh(triangle_glb(tmp_path)).faces) == 1
    began = time.perf_counter()
    with pytest.raises(MeshError, match=rf"t\.glb cannot be read as GLB .*{message}"):
        load_mesh(triangle_glb(tmp_path, **changes))
    assert time.perf_counter() - began < 10


def test_vertices_without_three_places_are_refused(tmp_path):
    """Three damaged meshes ended in a traceback."""
    (tmp_path / "flat.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(
        MeshError, match=r"flat\.obj has vertices \(3, 2\); expected x, y and z of each: export it again"
    ):
        load_mesh(tmp_path / "flat.obj", unit="m")


TRIANGLES = "".join(f"usemtl m{i}\nf {i + 1} {i + 2} {i + 3}\n" for i in range(300))


@pytest.mark.parametrize(
    "faces",
    [
        TRIANGLES,
        TRIANGLES.replace("usemtl", "g usemtl"),
        TRIANGLES.replace("usemtl", "use\\\nmtl").replace("\n", "\r\n"),
        TRIANGLES.replace("usemtl", "use\\\\\n\nmtl"),
        TRIANGLES.replace("usemtl", "use\\\r\r\nmtl"),
        TRIANGLES.replace("usemtl", "usemtl x\n\\\\usemtl"),
    ],
    ids=["lines", "groups", "joined", "joined twice", "returns", "behind"],
)
def test_the_materials_of_an_obj_file_make_no_meshes(tmp_path, monkeypatch, faces):
    """A file of 8 000 materials took 7 s, one of 908 kB 94 s."""
    points = "".join(f"v {0.001 * i} {0.1 * (i % 2)} 0\n" for i in range(302))
    (tmp_path / "strip.obj").write_bytes(f"mtllib a.mtl\n{points}{faces}".encode())
    scenes, read = [], trimesh.load_scene
    monkeypatch.setattr(trimesh, "load_scene", lambda *a, **k: scenes.append(read(*a, **k)) or scenes[-1])
    assert load_mesh(tmp_path / "strip.obj", unit="m").faces.shape == (300, 3)
    (scene,) = scenes
    assert len(scene.geometry) == 1


def test_an_obj_file_of_two_materials_gives_the_faces_of_both(tmp_path):
    cube = trimesh.creation.box((0.1, 0.2, 0.3))
    text = cube.export(file_type="obj")
    (tmp_path / "plain.obj").write_text(text)
    lines = [line for line in text.splitlines() if line.startswith("v ")]
    faces = [line for line in text.splitlines() if line.startswith("f ")]
    assert (len(lines), len(faces)) == (8, 12)
    made = ["mtllib a.mtl", *lines, "usemtl red", *faces[:5], "usemtl", "usemtl blue # usemtl red", *faces[5:]]
    (tmp_path / "two.obj").write_text("\n".join(made))
    one, two = load_mesh(tmp_path / "plain.obj"), load_mesh(tmp_path / "two.obj")
    assert np.array_equal(sorted_corners(one.vertices, one.faces), sorted_corners(two.vertices, two.faces))


def test_a_mesh_of_which_no_face_is_left_is_refused(tmp_path):
    """Pages that share a back branch at one edge in hundreds, and all of them end in the open."""
    points = "v 0 0 0\nv 1 0 0\n" + "".join(f"v 0 1 {i}\n" for i in range(100))
    (tmp_path / "book.obj").write_text(points + "".join(f"f 1 2 {3 + i}\n" for i in range(100)))
    with pytest.raises(MeshError, match=r"no face of .*book\.obj is left .* repair the mesh"):
        load_mesh(tmp_path / "book.obj", unit="m")
