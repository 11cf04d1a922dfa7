"""Poses of meshes in oriented points: right in all six, whatever lies beside, and what cannot be."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import millisight as ms
from helpers import posed, solid_mirrors
from millisight.core.errors import CoverageError, InputError, MeshError
from millisight.data import NONE_OF_THEM
from millisight.geometry import _locate, channel_middles
from millisight.meshes import build_object

AT = np.array([0.02, -0.01, posed.DEPTH])
TURNS, CLIMBERS = 400, 25
BOX = posed.block([-0.05, -0.03, -0.02], [0.05, 0.03, 0.02])
"""One for several tests: what is known of a mesh takes as long to find as a pose of it."""


def angle_deg(one, other):
    return np.degrees(Rotation.from_matrix(one.T @ other).magnitude())


def off(pose, mesh, rotation, translation):
    """Mean distance of the vertices from their true places [m]."""
    true = mesh.vertices @ rotation.T + translation
    return np.linalg.norm(mesh.vertices @ pose.rotation.T + pose.translation - true, axis=1).mean()


@pytest.fixture(scope="module", autouse=True)
def few_climbers():
    """Of the rotations fewer than 80 are fitted, which is most of the time of a search."""
    register = _locate.register
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            _locate, "register", lambda *given, climbers=CLIMBERS: register(*given, climbers=min(climbers, CLIMBERS))
        )
        yield


@pytest.fixture(scope="module")
def bracket():
    return posed.bracket()


@pytest.fixture(scope="module")
def cloud(bracket):
    """What is seen of the bracket, turned at random."""
    return posed.points_of(bracket.moved(rotation=posed.turn(11), translation=AT), count=220)


def located(cloud, meshes, **settings):
    """By so few turns, some 28 degrees apart, that the fits have to find the rest of the way."""
    return ms.locate(cloud, meshes, antennas=posed.ANTENNAS, turns=TURNS, **settings)


@pytest.fixture(scope="module")
def found(cloud, bracket):
    return located(cloud, bracket)


@pytest.mark.slow
def test_the_pose_is_found_in_all_six(bracket, cloud, found):
    assert len(cloud) > 120
    (pose,) = found.poses
    assert off(pose, bracket, posed.turn(11), AT) < 0.003
    assert angle_deg(pose.rotation, posed.turn(11)) < 3
    assert pose.distance(posed.turn(11) @ pose.middle + AT, posed.turn(11)) < 4
    assert pose.symmetry == "no symmetry"
    assert len(pose.free_axes) == 0
    # These points are of mirrors alone, and edges are looked for in vain.
    assert pose.explained > 0.7
    assert pose.shown > 0.35
    assert found.best is pose
    assert sum(found.probabilities.values()) == pytest.approx(1)
    np.testing.assert_allclose(pose.T_world_mesh[:3, :3] @ pose.middle + pose.T_world_mesh[:3, 3], pose.place)


@pytest.mark.slow
def test_another_object_beside_does_not_matter(bracket, cloud, found):
    other = posed.points_of(posed.block([-0.12, 0.04, -0.27], [-0.06, 0.10, -0.25]), count=75, rng=1)
    assert len(other) > 50
    pose = located(posed.merged(cloud, other), bracket).poses[0]
    assert off(pose, bracket, posed.turn(11), AT) < 0.004
    assert pose.explained < found.poses[0].explained


@pytest.mark.slow
def test_a_box_is_found_by_its_edges_where_no_face_shines():
    placed = BOX.moved(rotation=posed.turn(9), translation=AT)
    pose = located(posed.edge_points_of(placed), BOX).poses[0]
    alike = _locate._shape_of(BOX).symmetry.nearest(posed.turn(9), pose.rotation)
    assert angle_deg(pose.rotation, alike) < 8
    assert np.linalg.norm(pose.place - AT) < 0.006


@pytest.mark.slow
def test_a_floor_whose_height_is_told_is_left_out_and_stood_upon(bracket, cloud):
    true = bracket.moved(rotation=posed.turn(11), translation=AT)
    lowest = true.bounds[0, 2]
    middle = true.bounds.mean(axis=0)[:2]
    # A plate under it, which shines more than it does.
    plate = posed.block([*(middle - 0.07), lowest - 0.003], [*(middle + 0.07), lowest])
    floor = posed.points_of(plate, count=500, rng=1)
    both = posed.merged(cloud, floor.chosen(floor.normals[:, 2] > 0))
    told = located(both, bracket, support=lowest)
    assert len(told.points) < len(both)
    assert told.points.points[:, 2].min() > lowest
    assert off(told.poses[0], bracket, posed.turn(11), AT) < 0.004
    assert told.poses[0].score > located(both, bracket).poses[0].score + 0.01
    deeper = lowest - 0.02
    for found_upon, height in ((told, lowest), (located(cloud, bracket, support=deeper), deeper)):
        stands = found_upon.poses[0].placed(bracket).bounds[0, 2]
        assert -0.0025 < stands - height < 0.0065
    with pytest.raises(InputError, match=r"support is .*nan"):
        located(cloud, bracket, support=float("nan"))


@pytest.mark.slow
def test_turns_that_show_nothing_are_told_and_left_open():
    can = build_object("tomato_soup_can")
    place = can.moved(rotation=posed.turn(2), translation=AT)
    pose = located(posed.points_of(place), can).poses[0]
    axis = np.array([1.0, 0, 0]) if can.extent.argmax() == 0 else np.eye(3)[can.extent.argmax()]
    assert "any turn" in pose.symmetry
    assert abs(pose.free_axes[0] @ posed.turn(2) @ axis) > np.cos(np.radians(5))
    assert pose.free_axes[0] @ pose.covariance[3:, 3:] @ pose.free_axes[0] == pytest.approx(np.pi**2 / 3, rel=1e-6)
    assert pose.turn_sigma_deg < 40
    np.testing.assert_allclose(pose.place, place.bounds.mean(axis=0), atol=0.008)


@pytest.mark.slow
def test_which_of_several_and_none_of_them(bracket, cloud, found, monkeypatch):
    alone = found.poses[0]
    meshes = {
        "box": BOX,
        "bracket": bracket,
        "needle": posed.block(np.zeros(3), np.array([9.0, 0.02, 0.02])),
    }
    found = located(cloud, meshes)
    assert found.best.name == found.poses[0].name == "bracket"
    assert found.probabilities["bracket"] > 0.9
    assert found.probabilities["needle"] == 0  # far too large: it has no pose
    assert [one.name for one in found.poses] == ["bracket", "box"]
    # The same beside other meshes, and nothing is drawn by chance.
    np.testing.assert_array_equal(found.best.T_world_mesh, alone.T_world_mesh)
    # Of many meshes only the likely ones are searched for fully; their poses are those that are found anyway.
    asked, steps, fits = [], [], _locate._fits
    monkeypatch.setattr(_locate, "_MANY", 1)
    monkeypatch.setattr(_locate, "_KEPT", 1)
    monkeypatch.setattr(_locate, "_ROUGHLY", (0.006, 100, TURNS // 2, 20))
    monkeypatch.setattr(_locate, "_fits", lambda *given: asked.append(given[2:]) or fits(*given))
    many = located(cloud, meshes, progress=lambda *step: steps.append(step))
    assert asked == [(TURNS // 2, 20), (TURNS // 2, 20), (TURNS,)]
    np.testing.assert_array_equal(many.best.T_world_mesh, found.best.T_world_mesh)
    assert [one.name for one in many.poses] == ["bracket", "box"]
    assert many.probabilities["bracket"] > 0.9
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
    random = np.random.default_rng(0)
    normals = random.normal(size=(150, 3))
    noise = ms.PointCloud(
        points=AT + random.uniform(-0.06, 0.06, (150, 3)),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )
    nothing = located(noise, bracket)
    assert nothing.best is None
    assert nothing.probabilities[NONE_OF_THEM] > 0.5


@pytest.mark.slow
def test_images_tell_which_of_several_it_is(bracket):
    """A plate with the bracket's outline has most of the bracket's points, but not its image."""
    lying = bracket.moved(translation=-bracket.bounds.mean(axis=0))
    capture = ms.simulate(
        ms.Scene.from_mesh(lying, vertices=2500, center=False), ms.Radar.preset("mito-sim-77ghz"),
        ms.Trajectory.raster(size=(0.10, 0.10), step=0.004),
    )  # fmt: skip
    grid = ms.VoxelGrid.regular((-0.05, -0.05, -0.03), (0.05, 0.05, 0.03), (0.004, 0.004, 0.006))
    points = ms.surface_points(capture, grid)
    meshes = {"bracket": bracket, "plate": posed.block([-0.05, -0.04, -0.01], [0.05, 0.04, 0.01])}
    found = ms.locate(capture, meshes, points=points, turns=TURNS)
    looks = found.metadata["history"][-1]["agreements"]
    assert looks["bracket"] > looks["plate"] + 0.05
    blind = ms.locate(points, meshes, antennas=channel_middles(capture).reshape(-1, 3), turns=TURNS)
    assert found.probabilities["bracket"] > max(0.9, blind.probabilities["bracket"] - 0.01)
    with pytest.raises(InputError, match="leave grid out"):
        ms.locate(capture, bracket, grid, points=points)
    with pytest.raises(InputError, match="points is of type int"):
        ms.locate(capture, bracket, points=3)


@pytest.mark.slow
def test_a_mesh_handed_over_moved_and_open_lies_where_it_did(bracket, cloud):
    """A scan in a frame of its own, without its underside, wound inside out, is no different."""
    kept = bracket.face_crosses[:, 2] > -1e-9
    scan = ms.TriangleMesh(vertices=bracket.vertices, faces=bracket.faces[kept][:, ::-1])
    assert (scan.edge_faces[2] < 0).any()
    handed = scan.moved(rotation=posed.turn(4), translation=np.array([0.3, 0.1, -0.2]))
    rotation = posed.turn(11) @ posed.turn(4).T
    pose = located(cloud, handed).poses[0]
    assert off(pose, handed, rotation, AT - rotation @ [0.3, 0.1, -0.2]) < 0.004


@pytest.mark.parametrize(
    ("scale", "told"), [(1000, "millimetres"), (100, "centimetres"), (0.001, "told as millimetres")]
)
def test_a_mesh_in_another_unit_is_found_by_its_size(bracket, cloud, scale, told):
    with pytest.raises(MeshError, match=told):
        located(cloud, ms.TriangleMesh(vertices=scale * bracket.vertices, faces=bracket.faces))


def test_what_cannot_be_is_refused(bracket, cloud):
    with pytest.raises(InputError, match="3 oriented points were found; expected at least 12"):
        located(cloud.chosen(np.arange(3)), bracket)
    with pytest.raises(InputError, match="pass antennas"):
        ms.locate(cloud, bracket)
    with pytest.raises(InputError, match="have no normals"):
        located(ms.PointCloud(points=cloud.points), bracket)
    with pytest.raises(InputError, match="at least one, none of them called"):
        located(cloud, {})
    with pytest.raises(InputError, match="leave grid, points, clutter and materials out"):
        located(cloud, bracket, clutter="lid")
    with pytest.raises(InputError, match="mesh 'cup'"):
        located(cloud, {"cup": "cup.stl"})


def test_a_file_that_is_read_again_is_the_same_mesh():
    one, again = posed.bracket(), posed.bracket()
    assert one is not again
    assert _locate._shape_of(one) is _locate._shape_of(again)
    moved = one.moved(translation=np.array([0.1, 0, 0]))
    assert _locate._Content(moved) != _locate._Content(one)


def test_a_pose_stays_where_its_echoes_weights_cannot_be_fitted(bracket, monkeypatch):
    def inside(*_, **__):
        raise CoverageError("an antenna lies in the mesh")

    monkeypatch.setattr(_locate, "appearance", inside)
    capture = solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.06, step=0.003)
    grid = ms.VoxelGrid.regular((-0.02, -0.02, -0.27), (0.02, 0.02, -0.23), 0.004)
    found = ms.locate(capture, bracket, grid, turns=TURNS, materials=True)
    assert found.poses[0].alpha is None
    assert found.metadata["history"][-1]["materials"] == "not fitted: an antenna lies in the mesh"
    with pytest.raises(InputError, match="which the simulator does not know"):
        ms.locate(replace(capture, tx_points=capture.tx_positions), bracket, grid, materials=True)


def test_a_capture_of_one_antenna_or_of_nothing_is_refused(bracket):
    grid = ms.VoxelGrid.regular((-0.02, -0.02, -0.27), (0.02, 0.02, -0.23), 0.004)
    still = solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.0005, step=0.001)
    with pytest.raises(InputError, match="in one place or on one line"):
        ms.locate(still, bracket, grid)
    silent = solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.06, step=0.004)
    empty = ms.Capture(
        radar=silent.radar, trajectory=silent.trajectory,
        frames=(np.random.default_rng(0).normal(size=silent.frames.shape) + 0j).astype(np.complex64),
    )  # fmt: skip
    with pytest.raises(InputError, match="nothing is in view"):
        ms.locate(empty, bracket, grid)
    with pytest.raises(InputError, match="its own antennas"):
        ms.locate(silent, bracket, grid, antennas=posed.ANTENNAS)


@pytest.mark.slow
def test_a_crumpled_mesh_takes_bounded_memory():
    """All places lie within 4 mm of all others: their pairs took 12 GB, for 200 kB of triangles."""
    places = np.random.default_rng(0).normal(0, 0.003, (3000, 3))
    mesh = ms.TriangleMesh(vertices=places, faces=np.arange(3000).reshape(-1, 3))
    tracemalloc.start()
    try:
        samples = _locate.samples_of(mesh, 350, edges=True)
        assert tracemalloc.get_traced_memory()[1] < 300 << 20
    finally:
        tracemalloc.stop()
    assert len(samples.points) > 350


@pytest.mark.parametrize("width", [1e-9, 1e-15, 1e-160])
def test_triangles_as_thin_as_nothing_have_no_more_samples_than_others(width):
    """Every place that was drawn was one, of which the search took minutes."""
    corners = np.array([[0, 0, 0], [0.03, 0, 0], [0.015, width, 0]])
    samples = _locate.samples_of(ms.TriangleMesh(vertices=corners, faces=[[0, 1, 2]]), 350, edges=True)
    assert 100 < len(samples.points) <= 2 * 12 * 350


def test_a_thicket_of_edges_has_no_more_samples_than_others():
    corners = np.random.default_rng(0).normal(0, 0.05, (6000, 3))
    thicket = ms.TriangleMesh(vertices=corners, faces=np.arange(6000).reshape(-1, 3))
    assert len(_locate.samples_of(thicket, 350, edges=True).points) <= 2 * 12 * 350
