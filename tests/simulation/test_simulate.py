"""The simulator against plain NumPy, and its models against what geometry says must be lit."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.oracles import paths, point_frames, relative
from millisight.core.errors import CoverageError, InputError, UnknownNameError
from millisight.simulation import scattering_model
from millisight.simulation._bodies import Bodies, parts_of
from millisight.simulation._kernels import set_places
from millisight.simulation._scatterers import Scatterers


def mesh_of(solid):
    return ms.TriangleMesh(vertices=solid.vertices, faces=solid.faces)


def scene_of(solid, **settings):
    return ms.Scene.from_mesh(mesh_of(solid), vertices=None, **settings)


SPHERE = scene_of(trimesh.creation.icosphere(5, radius=0.05))
BOX = ms.Scene.from_mesh(mesh_of(trimesh.creation.box((0.1, 0.08, 0.05))), vertices=4000)


def lit_from(scene, positions, model="specular", **parameters):
    """(P, V) bool over all vertices of the scene, one monostatic antenna a position."""
    scatterers = Scatterers(scene.mesh, scattering_model(model, **parameters))
    antennas = np.asarray(positions, dtype=float)[:, None]
    lit = np.zeros((len(antennas), len(scene.mesh.vertices)), dtype=bool)
    lit[:, scatterers.indices] = scatterers.weights(antennas, antennas)[:, 0, 0]
    return lit


@pytest.mark.parametrize("name", ["mito-sim-77ghz", "iwr1443", "position2go"])
@pytest.mark.parametrize("spreading", ["none", "1/d"])
@pytest.mark.parametrize("model", ["specular", "edge", "diffuse"])
def test_frames_are_the_sum_over_lit_vertices(name, spreading, model):
    """With bistatic paths, the path offset, the material's amplitude, and the spreading law."""
    radar = ms.Radar.preset(name)
    rng = np.random.default_rng(2)
    positions = rng.uniform([-0.1, -0.1, 0.15], [0.1, 0.1, 0.25], (5, 3))
    trajectory = ms.Trajectory(times=np.arange(5.0), positions=positions)
    scene = ms.Scene(objects=tuple(
        type(o)(name=o.name, mesh=o.mesh, material=ms.Material(name="m", reflection=0.5 - 0.3j)) for o in BOX.objects
    ))  # fmt: skip
    capture = ms.simulate(scene, radar, trajectory, model=model, spreading=spreading)

    scatterers = Scatterers(scene.mesh, scattering_model(model))
    tx, rx = capture.tx_positions, capture.rx_positions
    lit = scatterers.weights(tx, rx)
    assert lit.any(axis=-1).mean() > 0.3
    weights = lit * (0.5 - 0.3j)
    if spreading == "1/d":
        weights = weights / paths(scatterers.points, tx, rx)
    expected = point_frames(scatterers.points, weights, tx, rx, radar.waveform.frequencies, radar.path_offset)
    assert relative(capture.frames, expected) < 2e-5


def test_from_one_position_a_sphere_shines_in_one_cap():
    """Lit: exactly the vertices whose normal lies within tau of the direction to the antenna."""
    antenna = np.array([0.03, -0.02, 0.25])
    lit = lit_from(SPHERE, [antenna], model="specular", tau_deg=7.0)[0]
    vertices = SPHERE.mesh.vertices
    to = antenna - vertices
    cosines = np.einsum("vi,vi->v", to, SPHERE.mesh.vertex_normals) / np.linalg.norm(to, axis=1)
    assert np.array_equal(lit, cosines > np.cos(np.radians(7.0)))
    assert lit.sum() > 5
    # The specular point of a sphere lies below the antenna, on the line to its centre.
    specular_point = 0.05 * antenna / np.linalg.norm(antenna)
    assert np.linalg.norm(vertices[lit].mean(axis=0) - specular_point) < 0.002


def test_over_a_raster_the_union_of_the_caps_is_lit():
    trajectory = ms.Trajectory.raster(size=(0.2, 0.2), step=0.02)
    capture = ms.simulate(SPHERE, ms.Radar.preset("mito-sim-24ghz"), trajectory, tau_deg=4.0)
    to = trajectory.positions[:, None] - SPHERE.mesh.vertices
    cosines = np.einsum("pvi,vi->pv", to, SPHERE.mesh.vertex_normals) / np.linalg.norm(to, axis=2)
    expected = (cosines > np.cos(np.radians(4.0))).any(axis=0)
    assert 10 < expected.sum() < len(expected) / 2
    assert np.array_equal(lit_from(SPHERE, trajectory.positions, model="specular", tau_deg=4.0).any(axis=0), expected)
    assert capture.metadata["lit_fraction"] == pytest.approx(expected.mean())


def test_with_transmitter_and_receiver_apart_the_bisector_decides():
    """A flat plate between two antennas: it answers though neither looks along its normal."""
    plate = scene_of(trimesh.creation.box((0.02, 0.02, 0.002)))
    scatterers = Scatterers(plate.mesh, scattering_model(tau_deg=60.0))
    tx, rx = np.array([[[-0.15, 0, 0.2]]]), np.array([[[0.15, 0, 0.2]]])
    top = plate.mesh.vertices[:, 2] > 0
    assert np.array_equal(scatterers.weights(tx, rx)[0, 0, 0], top)
    narrow = Scatterers(plate.mesh, scattering_model(tau_deg=5.0))
    sphere = Scatterers(SPHERE.mesh, scattering_model(tau_deg=5.0))
    lit = sphere.weights(tx, rx)[0, 0, 0]
    assert lit.sum() > 5
    assert np.linalg.norm(SPHERE.mesh.vertices[lit].mean(axis=0) - [0, 0, 0.05]) < 0.002
    assert not narrow.weights(tx, tx).any()


def test_antennas_anywhere_light_what_their_bisector_meets():
    """At unequal distances, too: the bisector is of directions, and not of the ways to the antennas."""
    rng = np.random.default_rng(7)
    tx, rx = rng.uniform([-0.3, -0.3, 0.08], [0.3, 0.3, 0.6], (2, 10, 1, 3))
    lit = Scatterers(SPHERE.mesh, scattering_model(tau_deg=6.0)).weights(tx, rx)[:, 0, 0]
    ways = [antennas - SPHERE.mesh.vertices for antennas in (tx, rx)]  # (10, V, 3)
    bisector = sum(way / np.linalg.norm(way, axis=-1, keepdims=True) for way in ways)
    cosines = np.einsum("pvi,vi->pv", bisector, SPHERE.mesh.vertex_normals) / np.linalg.norm(bisector, axis=-1)
    # Both antennas see the cap: it faces the bisector, and they are less than 80 degrees off it.
    expected = cosines > np.cos(np.radians(6.0))
    assert expected.sum() > 50
    assert np.array_equal(lit, expected)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("tau", [2.0, 30.0, 120.0])
def test_what_a_block_of_antennas_leaves_out_mirrors_to_none_of_them(tau, two_sided):
    """Blocks of any width and nearness, transmitters and receivers together and apart."""
    rng, left_out = np.random.default_rng(11), 0
    model = scattering_model("specular", tau_deg=tau, two_sided=two_sided)
    points, normals = SPHERE.mesh.vertices, SPHERE.mesh.vertex_normals
    for width in (0.0, 0.003, 0.03, 0.1):
        for apart in (0.0, 0.01, 0.3):
            tx = rng.uniform([-0.3, -0.3, 0.06], [0.3, 0.3, 0.6]) + rng.uniform(-width, width, (20, 1, 3))
            rx = tx + rng.uniform(-apart, apart, 3)
            found = model.within_reach(tx, rx, points, normals)
            lit = model.weights(tx, rx, points, normals).any(axis=(0, 1, 2))
            assert not (lit & ~found).any()
            left_out += (~found).sum()
            if width == 0.0:  # and no more than rounding is in doubt
                assert (found & ~lit).sum() <= 1
    assert left_out > 1000 or (tau > 90 and two_sided)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["specular", "edge", "diffuse", "rough"])
def test_frames_are_the_same_where_every_vertex_is_asked(model, monkeypatch):
    """Blocks that ask fewer vertices, and rays for fewer of them, give what all vertices give."""
    scene = ms.Scene.from_mesh("mug", vertices=2000, rotate_deg=(20, 30, 0))
    trajectory = ms.Trajectory.raster(size=(0.2, 0.2), step=0.008)
    for radar in map(ms.Radar.preset, ("mito-sim-24ghz", "position2go")):
        some = ms.simulate(scene, radar, trajectory, model=model)
        with monkeypatch.context() as patch:
            patch.setattr(Scatterers, "_within_reach", lambda scatterers, *_: scatterers)
            every = ms.simulate(scene, radar, trajectory, model=model)
        assert np.abs(every.frames).max() > 0
        assert relative(some.frames, every.frames) < 1e-6
        assert some.metadata["lit_fraction"] == every.metadata["lit_fraction"]


def enclosing(mesh):
    """(F,) bool: faces of closed parts."""
    part, closed = parts_of(mesh)
    return closed[part]


def test_what_is_turned_away_from_a_block_is_seen_from_nowhere_in_it():
    """A hollow mug, from blocks all around it; an open or inverted mesh has no side that is turned away."""
    mesh = ms.Scene.from_mesh("mug", vertices=2000, rotate_deg=(20, 30, 0)).mesh
    assert enclosing(mesh).all()
    bodies, scatterers = Bodies(mesh), Scatterers(mesh, scattering_model("diffuse"))
    rng, shares = np.random.default_rng(5), []
    for width in (0.0, 0.01, 0.08):
        middle = rng.normal(size=3)
        antennas = 0.3 * middle / np.linalg.norm(middle) + rng.uniform(-width, width, (30, 3))
        away = bodies.turned_away(antennas)
        antenna, vertex = np.nonzero(np.broadcast_to(away, (30, len(away))))
        assert not scatterers.sees(antennas[antenna], vertex).any()
        shares.append(away.mean())
    assert shares[0] > shares[1] > shares[2] > 0.05
    for faces in (mesh.faces[1:], mesh.faces[:, ::-1]):
        other = ms.TriangleMesh(vertices=mesh.vertices, faces=faces)
        assert not enclosing(other).any()
        assert not Bodies(other).turned_away(antennas)[faces].any()


def test_of_a_body_that_crosses_itself_what_is_inside_out_is_seen():
    """A cube whose top is pushed down through its bottom: the tube that comes out below is inside out."""
    cube = trimesh.creation.box((0.03, 0.03, 0.03)).subdivide_to_size(0.003)
    vertices = cube.vertices.copy()
    pushed = (vertices[:, 2] > 0.0149) & (np.hypot(vertices[:, 0], vertices[:, 1]) < 0.008)
    vertices[pushed, 2] -= 0.045
    mesh = ms.TriangleMesh(vertices=vertices, faces=cube.faces)
    assert enclosing(mesh).all()
    below = np.array([[[0.03, 0.02, -0.2]], [[-0.05, 0.01, -0.18]]])
    bodies = Bodies(mesh)
    scatterers = Scatterers(mesh, scattering_model("diffuse"))
    vertex = np.arange(len(vertices))
    hidden = bodies.turned_away(below[0, 0])
    seen = scatterers.sees(np.tile(below[0, 0], (len(vertex), 1)), vertex)
    assert (hidden & seen).sum() > 10
    bodies.distrust(np.flatnonzero(hidden & seen)[:1])
    assert not bodies.turned_away(below[0, 0]).any()
    block, some = next(scatterers.blocks(below, below))
    assert len(block) == 2
    lit = np.zeros(len(vertex), bool)
    lit[some.indices] = some.weights(below[block], below[block])[block == 0].any(axis=(0, 1, 2))
    np.testing.assert_array_equal(lit, seen)


def test_each_part_of_a_mesh_is_closed_or_open_by_itself():
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    shifted = box.vertices + np.array([0.2, 0, 0])
    both = ms.TriangleMesh(
        vertices=np.concatenate([box.vertices, shifted]), faces=np.concatenate([box.faces, box.faces[1:] + 8])
    )
    assert enclosing(both).tolist() == [True] * 12 + [False] * 11
    doubled = ms.TriangleMesh(vertices=box.vertices, faces=np.concatenate([box.faces, box.faces[:1]]))
    assert not enclosing(doubled).any()


@pytest.mark.slow
def test_swapping_transmitter_and_receiver_changes_nothing():
    rng = np.random.default_rng(3)
    tx, rx = rng.uniform([-0.2, -0.2, 0.1], [0.2, 0.2, 0.3], (2, 20, 1, 3))
    for name in ("specular", "edge", "diffuse"):
        scatterers = Scatterers(BOX.mesh, scattering_model(name, tau_deg=20.0))
        lit = scatterers.weights(tx, rx)
        assert lit.any()
        assert np.array_equal(lit, scatterers.weights(rx, tx))


def test_a_box_shows_its_face_in_specular_and_its_rim_in_edge():
    trajectory = ms.Trajectory.raster(size=(0.16, 0.14), step=0.01)
    vertices = BOX.mesh.vertices
    top = vertices[:, 2] > 0.025 - 1e-4
    to_rim = np.minimum(0.05 - np.abs(vertices[:, 0]), 0.04 - np.abs(vertices[:, 1]))

    specular = lit_from(BOX, trajectory.positions, model="specular").any(axis=0)
    inside = top & (to_rim > 0.004)
    assert inside.sum() > 200
    assert specular[inside].all()
    assert not specular[vertices[:, 2] < 0.02].any()

    edge = lit_from(BOX, trajectory.positions, model="edge").any(axis=0)
    assert edge[top & (to_rim < 1e-4)].all()
    assert not edge[inside].any()


def test_a_vertex_behind_a_wall_is_invisible():
    ball = scene_of(trimesh.creation.icosphere(3, radius=0.02))
    wall = scene_of(trimesh.creation.box((0.2, 0.2, 0.002))).moved((0.0, 0.0, 0.1))
    both = ball + wall
    antenna = [[0.0, 0.0, 0.3]]
    count = len(ball.mesh.vertices)
    assert lit_from(ball, antenna, model="diffuse")[0].sum() > 100
    lit = lit_from(both, antenna, model="diffuse")[0]
    assert not lit[:count].any()
    assert lit[count:].any()
    # From beside the wall the ball is seen again.
    assert lit_from(both, [[0.3, 0.0, 0.0]], model="diffuse")[0, :count].any()


def test_diffuse_lights_the_facing_half_of_a_sphere():
    antenna = np.array([0.0, 0.0, 0.3])
    lit = lit_from(SPHERE, [antenna], model="diffuse")[0]
    horizon = 0.05**2 / 0.3  # z of the circle where the line of sight touches
    z = SPHERE.mesh.vertices[:, 2]
    assert lit[z > horizon + 0.002].all()
    assert not lit[z < horizon - 0.002].any()


@pytest.mark.slow
def test_sharing_views_agrees_with_casting_every_ray():
    """A mug: hollow, with a handle, so that shadows abound."""
    scene = ms.Scene.from_mesh("mug", vertices=3000, rotate_deg=(20, 30, 0))
    scatterers = Scatterers(scene.mesh, scattering_model("diffuse"))
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.002)
    rng = np.random.default_rng(4)
    for jitter in (0.0, 0.0005, 0.01):
        antennas = trajectory.positions + rng.normal(0, 1, trajectory.positions.shape) * jitter
        block = antennas[scatterers.neighbours_first(antennas)][:150]
        shared_view = scatterers.weights(block[:, None], block[:, None])[:, 0, 0]
        pose, vertex = np.indices(shared_view.shape).reshape(2, -1)
        every_ray = scatterers.sees(block[pose], scatterers.indices[vertex]).reshape(shared_view.shape)
        assert 0.1 < every_ray.mean() < 0.9
        assert (shared_view == every_ray).mean() > 0.999


@pytest.mark.slow
@pytest.mark.parametrize("model", ["edge", "diffuse"])
def test_images_from_shared_views_agree_with_those_from_every_ray(model, monkeypatch):
    """The images within 2 % of those from exhaustive casting."""
    scene = ms.Scene.from_mesh("mug", vertices=1500, rotate_deg=(20, 30, 0))
    radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.06, 0.06), step=0.0019)
    grid = ms.VoxelGrid.regular((-0.06, -0.06, -0.05), (0.06, 0.06, 0.05), 0.004)
    shared_view = ms.form_image(ms.simulate(scene, radar, trajectory, model=model), grid)

    def every_ray(self, antennas, wanted):
        clear = np.zeros_like(wanted)
        antenna, vertex = np.nonzero(wanted)
        clear[antenna, vertex] = self.sees(antennas[antenna], self.indices[vertex])
        return clear

    monkeypatch.setattr(Scatterers, "_shared_view", every_ray)
    exhaustive = ms.form_image(ms.simulate(scene, radar, trajectory, model=model), grid)
    assert exhaustive.magnitude.max() > 0
    assert relative(shared_view.values, exhaustive.values) < 0.02


@pytest.mark.parametrize(("start", "step", "count"), [(70e9, 2e9, 16), (24e9, 1e9, 2), (77e9, 1e9, 5), (77e9, 0, 1)])
def test_few_samples_over_a_wide_band_are_summed_as_they_are(start, step, count):
    radar = ms.Radar(
        name="stepped", waveform=ms.Waveform.stepped(start, step, count), array=ms.AntennaArray.monostatic()
    )
    trajectory = ms.Trajectory.raster(size=(0.3, 0.3), step=0.1, center=(0, 0, 0.35))
    capture = ms.simulate(BOX, radar, trajectory, model="diffuse")
    scatterers = Scatterers(BOX.mesh, scattering_model("diffuse"))
    tx = capture.tx_positions
    lit = scatterers.weights(tx, tx).astype(float)
    expected = point_frames(scatterers.points, lit, tx, tx, radar.waveform.frequencies)
    assert relative(capture.frames, expected) < 1e-5


@pytest.mark.slow
def test_noise_is_added_once_to_a_combined_capture():
    radar, trajectory = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.1, 0.1), step=0.005)
    clean = ms.combine(
        *(ms.simulate(SPHERE, radar, trajectory, model=m) for m in ("specular", "diffuse")), alpha=(1, 1)
    )
    noise = ms.add_noise(clean, snr_db=12.0, rng=3).frames - clean.frames
    measured = 10 * np.log10((np.abs(clean.frames) ** 2).mean() / (np.abs(noise) ** 2).mean())
    assert measured == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("bad", [{"rng": -1}, {"rng": 1.5}, {"rng": "a"}, {"rng": True}, {"rng": 0, "snr_db": 1e5}])
def test_noise_that_cannot_be_is_refused_before_the_work(bad):
    with pytest.raises(InputError, match="rng is|snr_db is"):
        ms.simulate(
            BOX, ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0, 0), step=1), **{"snr_db": 3, **bad}
        )


def test_two_sided_sees_flipped_faces():
    mesh = SPHERE.mesh
    flipped = ms.Scene.from_mesh(ms.TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1]), vertices=None)
    antenna = [[0.0, 0.0, 0.3]]
    expected = lit_from(SPHERE, antenna, model="specular")
    assert expected.any()
    assert not lit_from(flipped, antenna, model="specular").any()
    assert np.array_equal(lit_from(flipped, antenna, model="specular", two_sided=True), expected)


@pytest.mark.slow
def test_noise_has_the_stated_power_and_follows_its_seed():
    radar, trajectory = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.1, 0.1), step=0.005)
    clean = ms.simulate(SPHERE, radar, trajectory)
    noisy = ms.simulate(SPHERE, radar, trajectory, snr_db=7.0, rng=5)
    noise = noisy.frames - clean.frames
    measured = 10 * np.log10((np.abs(clean.frames) ** 2).mean() / (np.abs(noise) ** 2).mean())
    assert measured == pytest.approx(7.0, abs=0.1)
    assert abs(noise.mean()) < 0.02 * np.abs(noise).std()
    assert np.array_equal(noisy.frames, ms.simulate(SPHERE, radar, trajectory, snr_db=7.0, rng=5).frames)
    assert not np.array_equal(noisy.frames, ms.simulate(SPHERE, radar, trajectory, snr_db=7.0, rng=6).frames)
    assert noisy.metadata["history"][-1]["seed"] == 5
    # A generator's seed is drawn from it and written down, so that the capture can be made again.
    drawn = ms.simulate(SPHERE, radar, trajectory, snr_db=7.0, rng=np.random.default_rng(1))
    again = ms.simulate(SPHERE, radar, trajectory, snr_db=7.0, rng=drawn.metadata["history"][-1]["seed"])
    assert np.array_equal(drawn.frames, again.frames)


def test_combining_captures_equals_combining_images():
    radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.16, 0.14), step=0.01)
    specular, edge = (ms.simulate(BOX, radar, trajectory, model=m) for m in ("specular", "edge"))
    grid = ms.VoxelGrid.regular((-0.06, -0.05, 0.02), (0.06, 0.05, 0.03), 0.005)
    whole = ms.form_image(ms.combine(specular, edge, alpha=(0.7, 0.3)), grid)
    parts = ms.combine(ms.form_image(specular, grid), ms.form_image(edge, grid), alpha=(0.7, 0.3))
    assert relative(whole.values, parts.values) < 1e-4


@pytest.mark.slow
def test_images_peak_where_the_surface_answers():
    """A box on its upper face. A ball's echo is that of its top in range but of its centre in curvature (the wave
    comes back as if from the centre): its image peaks in between, on the axis."""
    # Half a wavelength: a coarser step shows grating lobes instead.
    radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.2, 0.2), step=0.0019)
    grid = ms.VoxelGrid.regular((-0.06, -0.06, -0.06), (0.06, 0.06, 0.06), 0.004)
    box = ms.form_image(ms.simulate(BOX, radar, trajectory), grid)
    assert abs(box.peak[2] - 0.025) < 0.008
    ball = ms.form_image(ms.simulate(SPHERE, radar, trajectory), grid)
    assert np.linalg.norm(ball.peak[:2]) < 0.013
    assert 0 < ball.peak[2] < 0.05


def test_an_unlit_scene_gives_an_empty_capture_and_says_so():
    sideways = ms.Trajectory(times=[0.0], positions=[[0.5, 0.5, 0.5]])
    capture = ms.simulate(BOX, ms.Radar.preset("mito-sim-77ghz"), sideways, tau_deg=1.0)
    assert capture.metadata["lit_fraction"] == 0
    assert not capture.frames.any()
    with pytest.raises(InputError, match="no vertex is lit"):
        ms.simulate(BOX, ms.Radar.preset("mito-sim-77ghz"), sideways, tau_deg=1.0, snr_db=10, rng=0)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"model": "specullar"}, UnknownNameError, "Did you mean 'specular'"),
        ({"spreading": "1/d2"}, UnknownNameError, "spreading"),
        ({"tau_deg": 0}, InputError, "tau_deg is 0 degrees; expected more than 0"),
        ({"edge_deg": 200, "model": "edge"}, InputError, "edge_deg is 200 degrees; expected at most 180"),
        ({"snr_db": 10}, InputError, "needs a seed: pass rng=0"),
        ({"device": "gpu"}, UnknownNameError, "device"),
    ],
)
def test_bad_arguments_are_named(settings, error, message):
    with pytest.raises(error, match=message):
        ms.simulate(BOX, ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0, 0), step=1), **settings)


def test_arguments_in_the_wrong_order_are_named():
    radar, trajectory = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0, 0), step=1)
    with pytest.raises(InputError, match="scene is of type Radar; expected Scene"):
        ms.simulate(radar, BOX, trajectory)
    with pytest.raises(InputError, match="radar is of type str"):
        ms.simulate(BOX, "iwr1443", trajectory)
    capture = ms.simulate(BOX, radar, trajectory)
    with pytest.raises(InputError, match="capture is of type VoxelGrid"):
        ms.form_image(ms.VoxelGrid(x=[0.0], y=[0.0], z=[0.0]), capture)


def test_antennas_inside_the_object_are_refused():
    inside = ms.Trajectory(times=[0.0], positions=[[0, 0, 0.01]])
    with pytest.raises(CoverageError, match="inside the object's bounding box"):
        ms.simulate(BOX, ms.Radar.preset("mito-sim-77ghz"), inside)


def test_progress_is_told_while_rays_are_cast(monkeypatch):
    """Of a mesh whose faces overlap by thousands, one block of positions takes minutes."""
    monkeypatch.setattr("millisight.meshes._rays._RAYS", 100)
    told = []
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.05, center=(0, 0, 0.3))
    radar = ms.Radar.preset("mito-sim-24ghz")
    ms.simulate(BOX, radar, trajectory, model="edge", progress=lambda done, total: told.append((done, total)))
    assert told.count((0, 9)) > 5
    assert told[-1] == (9, 9)


@pytest.mark.parametrize("shape", [(1, 1), (3, 64), (5, 130), (40, 1000), (2, 63), (0, 8)])
@pytest.mark.parametrize("share", [0.0, 0.002, 0.5, 1.0])
def test_places_that_are_set_are_found_in_their_order(shape, share):
    rows = np.random.default_rng(7).random(shape) < share
    for found, expected in zip(set_places(rows), np.nonzero(rows), strict=True):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(set_places(rows.T.copy().T), np.nonzero(rows))
