"""Virtual worlds: their files, how they are built, and the impossible ones."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from millisight.core import rotation_from_euler_deg
from millisight.core.errors import CoverageError, FileError, FormatError, InputError, MillisightError, UnknownNameError
from millisight.rig.virtual import (
    ArmSettings,
    Carton,
    Cloth,
    RadarSettings,
    ScanSettings,
    Support,
    Wall,
    World,
    WorldObject,
    build_layout,
)
from millisight.rig.virtual._rig import plan_of

CUBE = WorldObject(object="rubiks_cube")
SCAN = ScanSettings(size=(0.3, 0.3), row_spacing=0.01)
EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "worlds").glob("*.toml"))


def world_of(*objects, **others):
    return World(**{"objects": objects or (CUBE,), "scan": SCAN, **others})


def boxes(layout):
    return np.array([thing.bounds for thing in layout.objects])


def test_two_numbers_stand_an_object_on_its_support():
    for kind, top in (("tripod", -0.30), ("styrofoam", -0.48)):
        standing = WorldObject(object="rubiks_cube", at=(0.12, 0.16), rotate_deg=(0, 0, 45))
        ((lower, upper),) = boxes(build_layout(world_of(standing, support=Support(kind=kind))))
        assert lower[2] == pytest.approx(top, abs=1e-9)
        assert (lower + upper)[:2] / 2 == pytest.approx([0.12, 0.16])
        assert upper[0] - lower[0] == pytest.approx((0.0588 + 0.0581) / np.sqrt(2), rel=0.01)


def test_three_numbers_hang_it_there_and_none_put_it_under_the_aperture():
    hung, default = boxes(build_layout(world_of(WorldObject(object="golf_ball", at=(0.05, 0.06, -0.2)), CUBE)))
    assert hung.mean(axis=0) == pytest.approx([0.05, 0.06, -0.2])
    assert default.mean(axis=0)[:2] == pytest.approx(SCAN.middle)


def test_parts_keep_their_materials_unless_the_world_says_otherwise():
    thing = WorldObject(object="phillips_screwdriver")
    assert [p.material.name for p in build_layout(world_of(thing)).objects[0].parts] == ["steel", "plastic"]
    thing = WorldObject(object="phillips_screwdriver", material="wood")
    assert [p.material.name for p in build_layout(world_of(thing)).objects[0].parts] == ["wood", "wood"]


def test_mesh_files_lie_beside_the_world(tmp_path):
    trimesh.creation.box((60, 40, 20)).export(tmp_path / "part.stl")
    (tmp_path / "world.toml").write_text('[[objects]]\nmesh = "part.stl"\nunit = "mm"\nmaterial = "ceramic"\n')
    (thing,) = build_layout(World.from_toml(tmp_path / "world.toml")).objects
    assert thing.name == "part"
    assert np.ptp(thing.bounds, axis=0) == pytest.approx([0.06, 0.04, 0.02])
    assert thing.parts[0].material.name == "ceramic"
    (tmp_path / "part.step").touch()
    (tmp_path / "world.toml").write_text('[[objects]]\nmesh = "part.step"\n')
    with pytest.raises(UnknownNameError, match=r"^objects\[0\].*: unknown mesh format 'step'"):
        build_layout(World.from_toml(tmp_path / "world.toml"))


def test_a_carton_goes_around_and_cloth_above():
    layout = build_layout(world_of(carton=Carton(clearance=0.03), cloth=Cloth(layers=4, gap=0.002, overhang=0.05)))
    ((lower, upper),) = boxes(layout)
    assert [panel.stack for panel in layout.panels] == ["carton"] * 5 + ["cloth"] * 4
    walls = np.array([panel.mesh.bounds for panel in layout.panels])
    assert walls[:5, 0].min(axis=0) == pytest.approx([*(lower[:2] - 0.03), -0.30])
    assert walls[:5, 1].max(axis=0) == pytest.approx(upper + 0.03)
    lid = walls[4]
    assert np.ptp(lid, axis=0)[2] == 0
    assert walls[5:, 0, 2] == pytest.approx(lid[0, 2] + 0.002 * np.arange(1, 5))
    assert walls[5, 0] == pytest.approx([*(lower[:2] - 0.08), lid[0, 2] + 0.002])
    assert walls[5, 1] == pytest.approx([*(upper[:2] + 0.08), lid[0, 2] + 0.002])
    # Outward normals: every panel is seen from outside with its front.
    for panel in layout.panels[:5]:
        outward = panel.mesh.bounds.mean(axis=0) - (lower + upper) / 2
        assert panel.mesh.face_normals[0] @ outward > 0
    assert not layout.uncovered().panels
    assert len(build_layout(world_of(carton=Carton(lid=False))).panels) == 4


def test_a_carton_has_a_place_a_thickness_and_a_lid_that_tilts():
    carton = Carton(clearance=0.03, thickness=0.004, at=(0.13, 0.16), tilt_deg=(2.0, -1.0))
    layout = build_layout(world_of(carton=carton))
    ((_, upper),) = boxes(layout)
    panels = np.array([panel.mesh.bounds for panel in layout.panels])
    middle = (panels[:4, 0].min(axis=0) + panels[:4, 1].max(axis=0)) / 2
    assert middle[:2] == pytest.approx([0.13, 0.16])
    for panel in layout.panels:
        assert sum(layer.thickness for layer in panel.layers) == pytest.approx(0.004)
    lid = layout.panels[4]
    rise = lid.u[2] / np.hypot(*lid.u[:2]), lid.v[2] / np.hypot(*lid.v[:2])
    assert np.degrees(np.arctan(rise)) == pytest.approx([2.0, -1.0], abs=0.01)
    assert lid.u @ lid.v == pytest.approx(0, abs=1e-12)
    assert panels[4, 0, 2] > upper[2] + 0.03 - 1e-4  # its lowest corner


@pytest.mark.parametrize("at", [None, (0.145, 0.157)])
def test_a_carton_may_be_turned_about_z_and_fits_as_the_object_turned_back_would(at):
    """A board 2 x 8 cm that lies at 30 degrees is as tightly packed by a carton at 30 degrees as it is without both."""
    made = []
    for turn_deg in (0.0, 30.0):
        board = WorldObject(object="wood_block", rotate_deg=(0, 0, turn_deg))
        carton = Carton(turn_deg=turn_deg, tilt_deg=(2.0, -1.0), at=at)
        made.append(build_layout(World(objects=(board,), scan=SCAN, carton=carton)))
    straight, turned = (np.array([[panel.u, panel.v] for panel in layout.panels]) for layout in made)
    turn = rotation_from_euler_deg((0, 0, 30))
    np.testing.assert_allclose(turned, straight @ turn.T, atol=1e-9)
    middles = [np.mean([panel.mesh.vertices.mean(axis=0) for panel in layout.panels[:4]], axis=0) for layout in made]
    np.testing.assert_allclose(*middles, atol=1e-9)
    vertices = made[1].objects[0].parts[0].mesh.vertices
    for wall in made[1].panels[:4]:
        outward = np.cross(wall.u, wall.v) / np.linalg.norm(np.cross(wall.u, wall.v))
        gap = -((vertices - wall.corner) @ outward).max()
        assert gap == pytest.approx(carton.clearance, abs=1e-9) if at is None else gap > 0


def test_a_carton_may_be_empty_where_its_size_is_known():
    layout = build_layout(World(scan=SCAN, carton=Carton(size=(0.1, 0.12, 0.08), clearance=0.0)))
    assert len(layout.panels) == 5
    bounds = np.array([panel.mesh.bounds for panel in layout.panels])
    assert np.ptp([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)], axis=0) == pytest.approx([0.1, 0.12, 0.08])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"thickness": 0.0003}, "thickness is 0.0003 m; expected more than 0.00044 m"),
        ({"thickness": 0.5}, r"thickness is 0.5 m; expected 0.05 m at most"),
        ({"tilt_deg": (0, 30)}, r"tilt_deg is \[0.0, 30.0\]; expected 20 degrees at most"),
    ],
)
def test_cartons_that_cannot_be(wrong, said):
    with pytest.raises(InputError, match=said):
        Carton(**wrong)


def test_surfaces_face_outward():
    for support in ("tripod", "styrofoam"):
        parts = build_layout(world_of(support=Support(kind=support))).background
        assert len(parts) == (2 if support == "tripod" else 1)
        for part in parts:
            assert trimesh.Trimesh(part.mesh.vertices, part.mesh.faces).volume > 0


def test_an_empty_scene_is_a_world():
    layout = build_layout(World(scan=SCAN))
    assert not layout.objects
    assert len(layout.parts) == 2


BOX = WorldObject(object="cracker_box")
IMPOSSIBLE = [
    ({"objects": (WorldObject(object="mug", at=(0.15, 0.15, -0.29)),)}, InputError,
     r"objects\[0\] \(mug\) reaches .* mm through the tripod's upper face at z = -0.3 m"),
    ({"objects": (WorldObject(object="mug", at=(0.15, 0.15, -0.05)),)}, InputError,
     r"objects\[0\] \(mug\) reaches up to z = -0.00.*the radars move at z = 0"),
    ({"objects": (CUBE, BOX), "scan": ScanSettings(size=(0.2, 0.3), row_spacing=0.01)}, CoverageError,
     r"objects\[1\] \(cracker_box\) is 21.4 cm wide along x, the aperture only 20.0 cm"),
    ({"objects": (WorldObject(object="mug", at=(0.29, 0.15)),)}, CoverageError,
     r"objects\[0\] \(mug\) lies at x .* the aperture at x 0.000 to 0.300"),
    ({"objects": (WorldObject(object="cracker_box", rotate_deg=(0, 90, 0), at=(0.15, 0.15)),)}, InputError,
     r"objects\[0\] \(cracker_box\) fills .* the published image grid of 77_ghz"),
    ({"objects": (CUBE, WorldObject(object="cracker_box"))}, InputError,
     r"objects\[0\] \(rubiks_cube\) and objects\[1\] \(cracker_box\) intersect"),
    ({"objects": (CUBE,), "walls": (Wall(lower=(0.1, 0.14, -0.3), upper=(0.2, 0.15, -0.1)),)}, InputError,
     r"objects\[0\] \(rubiks_cube\) and walls\[0\] intersect"),
    ({"objects": (BOX,), "carton": Carton(size=(0.2, 0.2, 0.1))}, InputError,
     r"the carton cuts through objects\[0\] \(cracker_box\)"),
    ({"objects": (BOX,), "carton": Carton(clearance=0.25)}, InputError, r"the carton over the objects reaches up to"),
    ({"walls": (Wall(lower=(0, 0, -0.3), upper=(1, 1, 0.5)),)}, InputError, "support or wall reaches up to z = 0.500"),
    ({"objects": (), "carton": Carton()}, InputError, "carton: there is no object to put it around"),
    ({"objects": (WorldObject(mesh="nowhere.stl"),)}, FileError, "objects.0. .nowhere.: nowhere.stl does not exist"),
]  # fmt: skip


@pytest.mark.parametrize(("others", "error", "words"), IMPOSSIBLE)
def test_impossible_worlds_are_refused_by_name(others, error, words):
    world = World(**{"scan": SCAN, **others})
    with pytest.raises(error, match=words):
        build_layout(world)


def test_what_only_touches_is_possible():
    # Two cubes side by side, and one on top of another.
    side = 0.0588
    build_layout(world_of(*(WorldObject(object="rubiks_cube", at=(0.1 + i * side, 0.15)) for i in range(2))))
    heights = [-0.30 + 0.0579 * (i + 0.5) for i in range(2)]
    build_layout(world_of(*(WorldObject(object="rubiks_cube", at=(0.15, 0.15, z)) for z in heights)))


def test_one_thing_inside_another_is_found():
    inner = WorldObject(object="golf_ball", at=(0.15, 0.15, -0.27))
    outer = WorldObject(object="wood_block", at=(0.15, 0.15))
    for objects in ((inner, outer), (outer, inner)):
        with pytest.raises(InputError, match="intersect"):
            build_layout(world_of(*objects))


def test_a_world_survives_its_file(tmp_path):
    world = World.from_toml(_full(tmp_path))
    assert world.sight == "nlos"
    assert [r.preset for r in world.radars] == ["iwr1443", "position2go"]
    world.to_toml(tmp_path / "again.toml")
    (tmp_path / "more").mkdir()
    World.from_toml(tmp_path / "again.toml").to_toml(tmp_path / "more" / "third.toml")
    text = (tmp_path / "again.toml").read_text()
    assert text == (tmp_path / "more" / "third.toml").read_text()
    assert 'mesh = "a \\"b\\" \\\\ c.stl"' in text
    assert world.arm.clock_drift == World.from_toml(tmp_path / "again.toml").arm.clock_drift == 50e-6


def test_a_world_moves_with_its_mesh_files(tmp_path):
    trimesh.creation.box((0.06, 0.04, 0.02)).export(tmp_path / "part.stl")
    (tmp_path / "more").mkdir()
    world = World(objects=(WorldObject(mesh="part.stl"), CUBE), folder=str(tmp_path))
    world.seen_from(tmp_path / "more").to_toml(tmp_path / "more" / "world.toml")
    there = World.from_toml(tmp_path / "more" / "world.toml")
    assert [thing.mesh for thing in there.objects] == ["../part.stl", None]
    assert len(build_layout(World(objects=there.objects[:1], folder=there.folder)).objects) == 1


def _full(folder):
    path = folder / "world.toml"
    path.write_text(
        "seed = 3\n"
        '[[objects]]\nobject = "mug"\nat = [0.1, 0.2]\nrotate_deg = [0, 0, 30]\n'
        '[[objects]]\nmesh = \'a "b" \\ c.stl\'\nunit = "mm"\n'
        '[support]\nkind = "styrofoam"\ntop = -0.45\n'
        "[carton]\nclearance = 0.01\nlid = true\n[cloth]\nlayers = 4\n"
        "[[walls]]\nlower = [0, 0, -1]\nupper = [1, 1, -0.9]\n"
        "[scan]\nsize = [0.3, 0.4]\n[arm]\nclock_drift = 50e-6\n"
        '[[radars]]\npreset = "iwr1443"\nrx_axis = "y"\n[[radars]]\npreset = "position2go"\nleakage_db = 3\n'
        "[camera]\nholes = false\n[optics]\nbounces = 1\n"
    )
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[objects]]\nobject = 'mugg'", r"objects\[0\]: unknown catalogue object 'mugg'. Did you mean 'mug'"),
        ("[[objects]]\nobject = 'mug'\nmaterial = 'metl'", r"objects\[0\]: unknown material 'metl'"),
        ("[[objects]]\nobject = 'mug'\n[[objects]]", r"objects\[1\]: expected either object = .* or mesh"),
        ("[[objects]]\nobject = 'mug'\nat = [1]", r"objects\[0\]: at has 1 numbers; expected 2"),
        ("[[objects]]\nobject = 'mug'\nat = ['a', 2]", r"objects\[0\].at\[0\]: expected a number, got 'a'"),
        ("objects = 3", r"objects: expected \[\[objects\]\] tables, got 3"),
        ("arm = 3", r"arm: expected a table, got 3"),
        ("[arm]\nspeeed = 0.1", r"arm.speeed: unknown key 'speeed'. Did you mean 'speed'"),
        ("[arm]\nspeed = 'fast'", r"arm.speed: expected a number, got 'fast'"),
        ("[scan]\nsize = [0.3]", r"scan.size: expected 2 entries, got \[0.3\]"),
        ("[scan]\nrow_spacing = 1e-9", r"scan: row_spacing is 1e-09 m"),
        ("[support]\nkind = 'table'", r"support: unknown support 'table'"),
        ("[carton]\nstack = 'steel'", r"carton: unknown stack of layers 'steel'"),
        ("[[radars]]\npreset = 'iwr1443'\n[[radars]]", r"bad.toml: the radars' files go to \['77_ghz', '77_ghz'\]"),
        ("[[radars]]\nlost_packets = 2", r"radars\[0\]: lost_packets is 2"),
        ("seed = -1", r"bad.toml: seed is -1"),
        ("folder = '/'", r"folder: unknown key"),
        ("seed = ", r"is not valid TOML"),
        ("[" * 5000, r"is not valid TOML"),
    ],
)
def test_bad_files_name_the_place(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(FormatError, match=words) as caught:
        World.from_toml(path)
    assert "bad.toml" in str(caught.value)


def test_worlds_too_large_for_any_disk_are_refused():
    for huge in ({"arm": ArmSettings(speed=1e-9)}, {"arm": ArmSettings(log_rate=1e12)},
                     {"radars": (RadarSettings(frame_period=1e-12),)},
                     {"radars": (RadarSettings(frame_period=1e-290),)}):  # fmt: skip
        with pytest.raises(InputError, match="frames or poses"):
            plan_of(world_of(**huge))
    with pytest.raises(InputError, match="layers is 1000000; expected 100 at most"):
        Cloth(layers=1_000_000)
    with pytest.raises(InputError, match=r"frame_period is 1e\+38 s; expected 3600 s at most"):
        RadarSettings(frame_period=1e38)
    with pytest.raises(InputError, match="objects has 101 entries"):
        World(objects=(CUBE,) * 101)


RECORDS = (World, WorldObject, Support, Carton, Cloth, Wall, ScanSettings, ArmSettings, RadarSettings)
KEYS = st.sampled_from([field.name for cls in RECORDS for field in dataclasses.fields(cls)])
PLAIN = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.sampled_from(["mug"]))
VALUES = PLAIN | st.lists(PLAIN, max_size=4)
TABLES = st.recursive(
    st.dictionaries(KEYS, VALUES, max_size=3),
    lambda inner: st.dictionaries(KEYS, VALUES | inner | st.lists(inner, max_size=3), max_size=4),
    max_leaves=6,
)


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(TABLES)
def test_whatever_stands_in_a_world_is_a_world_or_an_error_that_names_it(table):
    try:
        made = World.from_table(table)
    except FormatError as error:
        made = str(error)
    assert isinstance(made, World) or made.startswith("world: ")


def test_files_that_are_none(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="is not valid TOML"):
        World.from_toml(tmp_path / "bytes.toml")
    (tmp_path / "huge.toml").write_bytes(b"#" * (1 << 21))
    with pytest.raises(FormatError, match="expected a world of under"):
        World.from_toml(tmp_path / "huge.toml")
    with pytest.raises(MillisightError, match="no such file"):
        World.from_toml(tmp_path / "none.toml")


def test_a_table_within_a_recipe_is_a_world_too():
    world = World.from_table({"objects": [{"object": "mug"}], "scan": {"size": [0.3, 0.3]}}, source="recipe: world")
    assert world.objects[0].name == "mug"
    with pytest.raises(FormatError, match=r"recipe: world: scan.sise: unknown key"):
        World.from_table({"scan": {"sise": 1}}, source="recipe: world")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_the_shipped_examples_are_possible(path):
    assert build_layout(World.from_toml(path)).objects


def test_there_are_examples():
    assert len(EXAMPLES) >= 3
