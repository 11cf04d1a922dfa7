"""The catalogue of everyday objects, and the drawing tools it is made with."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

from helpers import oracles
from helpers.closed_meshes import volume
from millisight.core.errors import FileError, InputError, MeshError, UnknownNameError
from millisight.data import MATERIALS, Scene, TriangleMesh
from millisight.meshes import CATALOGUE, ObjectPart, build_object, build_parts, find_scans, load_mesh, object_name
from millisight.meshes import _shapes as shapes
from millisight.meshes._catalogue import CatalogueObject

NAMES = tuple(CATALOGUE)
SCANNED = [name for name, entry in CATALOGUE.items() if entry.source == "scan"]
SEVERAL_PARTS = [name for name, entry in CATALOGUE.items() if len(entry.parts) > 1]

# Holes right through the object: handles, eyes, bows, links. The wrench has an eye, and its screw halves a window;
# every link of the chain is one.
HOLES = {
    "mug": 1,
    "pitcher_base": 1,
    "padlock": 1,
    "skillet": 1,
    "spatula": 1,
    "medium_clamp": 1,
    "large_clamp": 1,
    "extra_large_clamp": 1,
    "scissors": 2,
    "adjustable_wrench": 3,
    "chain": 47,
}
HEAPS = {"a_marbles", "a_colored_wood_blocks"}  # with as many holes as there are gaps

# What stands, open side or studs up, and may be taller than it is wide or deep.
STANDING = {name for name in NAMES if name.endswith(("_cups", "_lego_duplo"))} | {"a_colored_wood_blocks"}


class Built(dict[str, TriangleMesh]):
    """Objects, each built as it is first asked for: a worker process needs few of them."""

    def __missing__(self, name: str) -> TriangleMesh:
        return self.setdefault(name, build_object(name))


@pytest.fixture(scope="module")
def meshes() -> Built:
    return Built()


def spellings(name):
    """How folders and files spell an object: ours, the YCB set's, the published dataset's."""
    entry = CATALOGUE[name]
    number, rest = entry.ycb_id.split("_", 1)
    number, letter = number.partition("-")[::2]
    yield from (name, entry.ycb_id, entry.published or entry.ycb_id, f"{number}{letter}_{rest}")
    if letter:
        yield from (f"{number}{letter}_{rest}_{letter}", f"{number}-{letter}_{rest}", f"{rest}_{letter}")


@pytest.mark.parametrize("name", NAMES)
def test_an_object_has_one_name_however_it_is_spelled(name):
    found = dict.fromkeys(spellings(name))
    assert len(found) >= 2
    for one in found:
        words = one.replace("_", " ")
        for other in (one, one.replace("_", "-"), one.upper(), words, words.title().replace(" ", ""), one.lstrip("0")):
            assert object_name(other) == name, other
        for path in (f"{one}.ply", f"/data/scans/{one}.STL", f"{one}/google_16k/nontextured.stl"):
            assert object_name(path) == name, path
    assert object_name(f"{CATALOGUE[name].ycb_id}/robot_collected/0_0_0/exp1/los") == name


@pytest.mark.parametrize(
    ("spelled", "name"),
    [
        ("My Gear.stl", "my_gear"),
        ("000_my-gear", "my_gear"),
        ("mug/gear.ply", "gear"),  # a folder without a number is not the object's
        ("gear/nontextured.stl", "gear"),
        ("072-b_toy_airplane", "toy_airplane"),  # a loose part, which is not the airplane
        ("065-k_cups", "cups"),
        ("025_mug+058-golf_ball", "mug+golf_ball"),
        ("чашка", "чашка"),
        ("077", "077"),
        ("", ""),
    ],
)
def test_what_the_catalogue_does_not_know_keeps_its_name_and_gets_no_other_ones(spelled, name):
    assert object_name(spelled) == name


def oriented_extent(vertices: np.ndarray, *, ball: bool) -> np.ndarray:
    """Sizes of the smallest box around the points, in any direction, smallest first [m].

    Of balls, whose hull has thousands of faces, each of which would be tried, around points on a coarse lattice: 3 %.
    """
    import trimesh

    if ball:
        step = np.ptp(vertices, axis=0).max() / 40
        vertices = step * np.unique(np.round(vertices / step), axis=0)
    return np.sort(trimesh.bounds.oriented_bounds(vertices)[1])


def assert_closed_and_outward(mesh: TriangleMesh) -> None:
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    code = sides[:, 0] * len(mesh.vertices) + sides[:, 1]
    back = sides[:, 1] * len(mesh.vertices) + sides[:, 0]
    assert len(np.unique(code)) == len(code), "an edge runs twice in one direction"
    assert np.array_equal(np.sort(code), np.sort(back)), "an edge has no partner in the other direction"
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)
    assert volume(mesh) > 0


def test_catalogue_is_the_papers_76_and_read_only():
    assert len(NAMES) == 76
    assert {entry.shape_class for entry in CATALOGUE.values()} == {"can", "handle", "box", "sphere", "other"}
    assert {entry.category for entry in CATALOGUE.values()} == {"food", "kitchen", "tool", "shape", "task"}
    with pytest.raises(TypeError):
        CATALOGUE["mug"] = CATALOGUE["bowl"]  # type: ignore[index]


def test_names_follow_the_ycb_numbers():
    ids = [entry.ycb_id for entry in CATALOGUE.values()]
    assert ids == sorted(set(ids))
    assert (CATALOGUE["mug"].ycb_id, CATALOGUE["mug"].number) == ("025_mug", "025")
    assert (CATALOGUE["d_cups"].ycb_id, CATALOGUE["d_cups"].number) == ("065-d_cups", "065-d")
    assert all(entry.ycb_id.endswith(name) for name, entry in CATALOGUE.items())


def test_every_scan_is_in_the_catalogue_under_its_own_name():
    scans = {path.stem for path in oracles.shared("ycb").glob("*.ply")}
    assert len(scans) == 38
    assert scans == {CATALOGUE[name].ycb_id for name in SCANNED}


def test_entries_copy_and_pickle():
    mug = CATALOGUE["mug"]
    for twin in (copy.deepcopy(mug), pickle.loads(pickle.dumps(mug))):  # noqa: S301
        assert all(getattr(twin, field) == getattr(mug, field) for field in mug.__dataclass_fields__)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_mesh_is_one_closed_piece_of_its_declared_size_with_the_right_holes(meshes, name):
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mesh = meshes[name]
    assert 12 <= len(mesh.faces) <= 60_000
    assert_closed_and_outward(mesh)
    np.testing.assert_allclose(mesh.extent, CATALOGUE[name].dimensions, rtol=1e-3)
    np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0, atol=1e-9)
    edges = mesh.edges
    size = len(mesh.vertices)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    assert connected_components(graph)[0] == 1
    genus = 1 - (size - len(edges) + len(mesh.faces)) // 2
    assert genus == HOLES.get(name, 0) or (name in HEAPS and genus > 30)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANNED)
def test_size_agrees_with_the_scan(meshes, name):
    import trimesh

    scan = trimesh.load(oracles.shared("ycb", f"{CATALOGUE[name].ycb_id}.ply"), process=False)
    ball = CATALOGUE[name].shape_class == "sphere"
    wanted = oriented_extent(scan.vertices, ball=ball)
    np.testing.assert_allclose(oriented_extent(meshes[name].vertices, ball=ball), wanted, rtol=0.10)


@pytest.mark.parametrize(
    "name",
    [name for name, entry in CATALOGUE.items() if entry.shape_class not in ("sphere", "box") and name not in STANDING],
)
def test_long_objects_lie_along_x_and_flat(name):
    x, y, z = CATALOGUE[name].dimensions
    # The drill lies with its barrel along x, and is as high up the page as it is long.
    assert x >= 0.98 * y
    assert z <= y * 1.001


def test_boxes_lie_on_their_largest_face():
    boxes = [e.dimensions for name, e in CATALOGUE.items() if e.shape_class == "box" and name not in STANDING]
    assert len(boxes) > 8
    for x, y, z in boxes:
        assert x >= y >= z


# ---- parts -------------------------------------------------------------------------------------------------


def test_objects_of_several_materials():
    assert len(SEVERAL_PARTS) >= 15
    assert dict(CATALOGUE["hammer"].parts) == {"head": "steel", "handle": "wood"}
    assert CATALOGUE["hammer"].material == "steel"
    assert {"skillet", "skillet_lid", "knife", "power_drill", "medium_clamp"} <= set(SEVERAL_PARTS)


@pytest.mark.parametrize("name", SEVERAL_PARTS)
def test_parts_are_closed_do_not_overlap_and_make_the_whole(meshes, name):
    parts = build_parts(name)
    assert [(part.name, part.material.name) for part in parts] == list(CATALOGUE[name].parts)
    for part in parts:
        assert_closed_and_outward(part.mesh)
        assert part.material is MATERIALS[part.material.name]
    # All within the whole and as large together, so they neither overlap nor leave a gap.
    bounds = np.stack([part.mesh.bounds for part in parts])
    np.testing.assert_allclose(
        [bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)], meshes[name].bounds, rtol=0, atol=2e-6
    )
    assert sum(volume(part.mesh) for part in parts) == pytest.approx(volume(meshes[name]), rel=1e-6)


def test_the_screwdrivers_shaft_is_where_it_belongs():
    shaft, handle = build_parts("phillips_screwdriver")
    assert shaft.mesh.bounds[1, 0] == pytest.approx(0.1081, abs=1e-4)
    assert handle.mesh.bounds[1, 0] < 0.01
    assert shaft.mesh.extent[1] == pytest.approx(0.006, rel=0.05)


def test_an_object_of_one_material_is_one_part(meshes):
    (part,) = build_parts("mug")
    assert (part.name, part.material.name) == ("whole", "steel")
    np.testing.assert_array_equal(part.mesh.vertices, meshes["mug"].vertices)


def test_a_part_refuses_what_cannot_be(meshes):
    with pytest.raises(InputError, match="material is of type str"):
        ObjectPart(name="a", mesh=meshes["dice"], material="steel")  # type: ignore[arg-type]


# ---- real scans --------------------------------------------------------------------------------------------


def test_scans_are_found_by_their_ycb_names(tmp_path):
    for name in (
        "025_mug.ply", "025_mug/google_16k/nontextured.stl", "035_power_drill/tsdf/nontextured.stl",
        "035_power_drill/google_16k/nontextured.ply", "027-skillet/textured.obj", "065-d_cups/uniform.stl",
        "048_hammer/notes.txt", "999_thing.ply", "mug.stl",
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = {name: path.relative_to(tmp_path).as_posix() for name, path in find_scans(tmp_path).items()}
    assert found == {
        "mug": "025_mug.ply",
        "skillet": "027-skillet/textured.obj",
        "power_drill": "035_power_drill/google_16k/nontextured.ply",
        "d_cups": "065-d_cups/uniform.stl",
    }
    assert list(found) == ["mug", "skillet", "power_drill", "d_cups"]


def test_the_shared_scans_are_all_found_and_load():
    scans = find_scans(oracles.shared("ycb"))
    assert list(scans) == SCANNED
    assert load_mesh(scans["golf_ball"]).extent.max() < 0.05


def test_a_folder_without_scans_is_refused(tmp_path):
    (tmp_path / "cup.ply").touch()
    with pytest.raises(FileError, match=r"holds no scan of a catalogue object; expected files like 025_mug\.ply"):
        find_scans(tmp_path)
    for wrong in (tmp_path / "nowhere", tmp_path / "cup.ply"):
        with pytest.raises(FileError, match="cannot read the folder of scans"):
            find_scans(wrong)


# ---- what they look like -----------------------------------------------------------------------------------


def test_balls_have_no_sharp_edge_and_boxes_only_those_of_a_box(meshes):
    assert not meshes["softball"].sharp_vertices(20.0).any()
    assert not meshes["golf_ball"].sharp_vertices(20.0).any()
    assert meshes["cracker_box"].sharp_vertices(89.0).all()


@pytest.mark.parametrize(("name", "full"), [("mug", 0.25), ("bowl", 0.10), ("d_cups", 0.25), ("plate", 0.20)])
def test_vessels_are_hollow(meshes, name, full):
    assert volume(meshes[name]) < full * np.prod(CATALOGUE[name].dimensions)


def test_vessels_are_open_upwards(meshes):
    # A ray down the middle meets the floor first, far below the rim.
    for name, depth in (("mug", 0.07), ("bowl", 0.045), ("d_cups", 0.05), ("skillet", 0.04)):
        mesh = meshes[name]
        if name == "skillet":  # its middle is that of the pan, not of the bounding box
            mesh = mesh.moved(translation=np.array([mesh.extent[0] / 2 - mesh.extent[1] / 2, 0, 0]))
        near = np.hypot(mesh.vertices[:, 0] + (0.012 if name == "mug" else 0), mesh.vertices[:, 1]) < 0.02
        assert near.any(), name
        assert mesh.bounds[1, 2] - mesh.vertices[near, 2].max() > depth, name


def test_can_has_a_lip(meshes):
    mesh = meshes["tomato_soup_can"]
    x, radius = mesh.vertices[:, 0], np.hypot(mesh.vertices[:, 1], mesh.vertices[:, 2])
    assert radius[np.abs(x) < 0.0480].max() == pytest.approx(0.0338 - 0.0015, abs=1e-4)
    assert radius.max() == pytest.approx(0.0338, abs=1e-4)


def test_unknown_name_suggests_the_close_one():
    with pytest.raises(UnknownNameError, match=r"unknown catalogue object 'muug'\. Did you mean 'mug'\?"):
        build_object("muug")


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        ("parts", (("whole", "mithril"),), UnknownNameError),
        ("parts", (), InputError),
        ("source", "hearsay", UnknownNameError),
        ("shape_class", "cylinder", UnknownNameError),
        ("category", "toys", UnknownNameError),
        ("dimensions", (0.1, 0.0, 0.1), InputError),
        ("alpha", (0, 0), InputError),
        ("alpha", (1, -1), InputError),
        ("alpha", 0.5, InputError),
    ],
)
def test_entry_refuses_what_cannot_be(field, value, error):
    mug = CATALOGUE["mug"]
    fields = {key: getattr(mug, key) for key in mug.__dataclass_fields__}
    with pytest.raises(error):
        CatalogueObject(**{**fields, field: value})


def test_fitted_weights_are_those_of_the_scene_unless_a_material_is_named():
    fitted = {name: entry for name, entry in CATALOGUE.items() if entry.alpha is not None}
    assert len(fitted) > 10
    for entry in fitted.values():
        assert entry.alpha is not None
        assert sum(entry.alpha) == pytest.approx(1, abs=1e-3)
    name, entry = next((n, e) for n, e in fitted.items() if e.alpha != MATERIALS[e.material].alpha)
    scene = Scene.from_mesh(name, vertices=None)
    assert scene.alpha == entry.alpha
    assert scene.objects[0].material.reflection == MATERIALS[entry.material].reflection
    assert Scene.from_mesh(name, vertices=None, material=entry.material).alpha == MATERIALS[entry.material].alpha
    assert CATALOGUE["bowl"].alpha is None
    assert Scene.from_mesh("bowl", vertices=None).alpha == MATERIALS[CATALOGUE["bowl"].material].alpha


def test_what_has_an_objects_name_does_not_hide_the_object(tmp_path, monkeypatch):
    (tmp_path / "dice").mkdir()
    (tmp_path / "mug").write_text("no mesh")
    monkeypatch.chdir(tmp_path)
    assert [Scene.from_mesh(name).objects[0].name for name in ("dice", "mug")] == ["dice", "mug"]


@pytest.mark.parametrize("name", ["thing", "ply"])
def test_a_file_without_a_suffix_is_named_in_the_error(tmp_path, name):
    (tmp_path / name).write_text("no mesh")
    with pytest.raises(UnknownNameError, match=f"unknown mesh format '{name}'"):
        load_mesh(tmp_path / name)


def test_import_stays_cheap():
    code = "import sys, millisight.meshes._catalogue; print('manifold3d' in sys.modules, 'trimesh' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.split() == ["False", "False"]


# ---- drawing tools -----------------------------------------------------------------------------------------


def test_curve_passes_its_points_and_keeps_a_straight_line():
    points = np.array([(0.0, 0, 0), (4, 3, 0), (9, 3, 1), (12, 0, 2)])
    drawn = shapes.curve(points, step=0.5)
    for point in points:
        assert np.abs(drawn - point).sum(axis=1).min() < 1e-12
    assert np.linalg.norm(np.diff(drawn, axis=0), axis=1).max() < 0.75
    line = shapes.curve([(0, 0, 0, 1), (1, 0, 0, 2), (10, 0, 0, 11)], step=0.1)
    np.testing.assert_allclose(line[:, 3], line[:, 0] + 1)


def test_closed_curve_through_a_circle_is_round():
    angle = np.arange(12) * np.pi / 6
    drawn = shapes.curve(10 * np.column_stack([np.cos(angle), np.sin(angle)]), closed=True, along=2)
    np.testing.assert_allclose(np.hypot(*drawn.T), 10, rtol=2e-3)


def test_torus_has_the_volume_of_pappus():
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    path = 30 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    torus = shapes.tube(path, 5.0, normal=(0, 0, 1), closed=True)
    assert torus.genus() == 1
    assert torus.volume() == pytest.approx(2 * np.pi**2 * 30 * 5**2, rel=6e-3)


def test_body_is_an_elliptic_cylinder_and_its_rounded_end_a_dome():
    straight = shapes.body([(0, 0, 0, 10, 6), (50, 0, 0, 10, 6)])
    assert straight.volume() == pytest.approx(np.pi * 10 * 6 * 50, rel=5e-3)
    domed = shapes.body([(0, 0, 0, 10, 10), (50, 0, 0, 10, 10)], rounding=(10, 10))
    assert domed.volume() == pytest.approx(np.pi * 10**2 * 30 + 4 / 3 * np.pi * 10**3, rel=1e-2)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_cylinder_lies_along_its_axis(axis):
    solid = shapes.cylinder(10, 70, axis=axis)
    size = np.diff(np.reshape(solid.bounding_box(), (2, 3)), axis=0)[0]
    assert size["xyz".index(axis)] == pytest.approx(70)
    assert sorted(size) == pytest.approx([20, 20, 70])
    with pytest.raises(InputError, match="expected 'x', 'y' or 'z'"):
        shapes.cylinder(10, 70, axis="w")


def test_revolve_points_its_axis_the_right_way():
    for axis, place in (("x", 0), ("y", 1), ("z", 2)):
        bounds = np.reshape(shapes.revolve([(0, 3), (2, 3), (0, 9)], axis=axis).bounding_box(), (2, 3))
        assert bounds[:, place] == pytest.approx([3, 9])


def test_sphere_sides_are_short():
    mesh = shapes.mesh_of(shapes.sphere(48))
    assert mesh.edge_lengths.max() < 2.5e-3
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.048**3, rel=2e-3)


def test_bent_plate_follows_the_lift():
    sheet = shapes.bent(shapes.plate(shapes.outline([(0, 0), (40, 0), (40, 10), (0, 10)]), 2), lambda x, _y: x**2 / 80)
    upper = np.asarray(sheet.to_mesh64().vert_properties)
    top = upper[np.isclose(upper[:, 2] - upper[:, 0] ** 2 / 80, 1, atol=1e-4)]
    assert len(top) > 80
    assert sheet.volume() == pytest.approx(800, rel=1e-3)


def test_stretched_mends_percents_and_refuses_more():
    solid = shapes.stretched(shapes.block((10, 20, 30)), (10.5, 19, 30))
    assert np.reshape(solid.bounding_box(), (2, 3))[1] == pytest.approx([5.25, 9.5, 15])
    with pytest.raises(InputError, match=r"drawn 10\.0 x 20\.0 x 30\.0 mm large; expected 10\.0 x 20\.0 x 40\.0"):
        shapes.stretched(shapes.block((10, 20, 30)), (10, 20, 40))


def test_mesh_of_refuses_two_pieces_and_none():
    apart = shapes.union(shapes.block((1, 1, 1)), shapes.block((1, 1, 1), at=(5, 0, 0)))
    with pytest.raises(MeshError, match="2 pieces"):
        shapes.mesh_of(apart)
    with pytest.raises(MeshError, match="0 pieces"):
        shapes.mesh_of(shapes.block((1, 1, 1)) - shapes.block((2, 2, 2)))
