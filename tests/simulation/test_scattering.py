"""Scattering models: laws that every one obeys, the rough lobe against geometry, and the doors for one's own."""

from typing import ClassVar

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.oracles import point_frames, relative
from millisight.core.errors import InputError, UnknownNameError
from millisight.simulation import SCATTERING_MODELS, RoughModel, ScatteringModel, parameters_of, scattering_model
from millisight.simulation._scatterers import Scatterers

MODELS = tuple(SCATTERING_MODELS)
BOX = ms.Scene.from_mesh(
    ms.TriangleMesh(
        vertices=(box := trimesh.creation.box((0.1, 0.08, 0.05))).vertices,
        faces=box.faces,
    ),
    vertices=1500,
)
BALL = trimesh.creation.icosphere(4, radius=0.05)
BALL = ms.Scene.from_mesh(ms.TriangleMesh(vertices=BALL.vertices, faces=BALL.faces), vertices=None)
RADAR, RASTER = ms.Radar.preset("iwr1443"), ms.Trajectory.raster(size=(0.12, 0.1), step=0.04)


def test_the_paper_s_models_and_a_rough_one_are_there():
    assert set(MODELS) >= {"specular", "edge", "diffuse", "rough"}


@pytest.fixture(params=MODELS)
def model(request):
    return scattering_model(request.param)


class TestLaws:
    """What holds of every scattering model, one of a plug-in too."""

    def antennas(self, receivers=1):
        rng = np.random.default_rng(3)
        return rng.uniform([-0.1, -0.1, 0.15], [0.1, 0.1, 0.3], (2, 15, receivers, 3))

    def test_is_a_model(self, model):
        assert isinstance(model, ScatteringModel)
        assert repr(model).startswith(type(model).__name__)
        assert all(field.metadata["about"] for field in parameters_of(model).values())

    def test_weights_are_amplitudes(self, model):
        tx, rx = self.antennas(2)
        scatterers = Scatterers(BOX.mesh, model)
        weights = scatterers.weights(tx, rx)
        assert weights.shape == (15, 2, 2, len(scatterers.indices))
        assert weights.dtype in (bool, np.float32)
        assert weights.any()
        assert weights.min() >= 0
        assert weights.max() <= 1

    def test_antennas_may_be_swapped(self, model):
        tx, rx = self.antennas()
        scatterers = Scatterers(BOX.mesh, model)
        weights = scatterers.weights(tx, rx)
        assert weights.any()
        assert weights == pytest.approx(scatterers.weights(rx, tx), abs=1e-6)

    def test_what_is_hidden_is_dark(self, model):
        wall = BALL.moved((0.0, 0.0, 0.0)) + BOX.moved((0.0, 0.0, 0.12))
        scatterers = Scatterers(wall.mesh, model)
        above = np.array([[[0.0, 0.0, 0.3]]])
        ball = scatterers.indices < len(BALL.mesh.vertices)
        weights = scatterers.weights(above, above)[0, 0, 0]
        assert weights[~ball].any()
        assert not weights[ball & (np.hypot(*scatterers.points[:, :2].T) < 0.02)].any()

    def test_moving_everything_changes_nothing(self, model):
        tx, rx = self.antennas()
        shift = np.array([0.3, -0.2, 0.1])
        here = Scatterers(BOX.mesh, model).weights(tx, rx)
        there = Scatterers(BOX.moved(shift).mesh, model).weights(tx + shift, rx + shift)
        assert here.any()
        assert (np.abs(here - there.astype(float)) < 1e-5).mean() > 0.995

    def test_frames_are_the_weighted_sum(self, model):
        capture = ms.simulate(BOX, RADAR, RASTER, model=model)
        scatterers = Scatterers(BOX.mesh, model)
        weights = scatterers.weights(capture.tx_positions, capture.rx_positions)
        expected = point_frames(
            scatterers.points, weights.astype(float), capture.tx_positions, capture.rx_positions,
            RADAR.waveform.frequencies, RADAR.path_offset,
        )  # fmt: skip
        assert relative(capture.frames, expected) < 2e-5

    def test_the_capture_tells_its_model(self, model):
        (step,) = ms.simulate(BOX, RADAR, RASTER, model=model).metadata["history"]
        assert step["model"] == model.name
        assert {name: step[name] for name in parameters_of(model)} == {
            name: getattr(model, name) for name in parameters_of(model)
        }

    def test_every_parameter_changes_the_result(self, model):
        plain = ms.simulate(BALL + BOX.moved((0.1, 0, 0)), RADAR, RASTER, model=model.name)
        for name, field in parameters_of(model).items():
            if name == "two_sided":  # test_simulate: needs flipped faces
                continue
            other = ms.simulate(
                BALL + BOX.moved((0.1, 0, 0)), RADAR, RASTER, model=model.name, **{name: min(180, 5 * field.default)}
            )
            assert not np.array_equal(plain.frames, other.frames)


def rough_weights(normals, tx, rx, lobe_deg):
    """(V,) by vectors: the mirrored wave, and the angle from it to the receiver."""
    to_tx, to_rx = tx / np.linalg.norm(tx), rx / np.linalg.norm(rx)
    mirrored = np.array([2 * n * (n @ to_tx) - to_tx for n in normals])
    psi = np.arccos(np.clip(mirrored @ to_rx, -1, 1))
    alpha = np.log(0.5) / np.log((1 + np.cos(np.radians(lobe_deg))) / 2)
    return ((1 + np.cos(psi)) / 2) ** (alpha / 2)


@pytest.mark.parametrize("lobe_deg", [10.0, 40.0, 120.0])
def test_a_lobe_stands_about_the_mirrored_wave(lobe_deg):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tx, rx = np.array([0.3, -0.1, 0.4]), np.array([-0.2, 0.2, 0.5])
    points = np.zeros((200, 3))
    weights = RoughModel(lobe_deg=lobe_deg).weights(tx[None, None], rx[None, None], points, normals)
    expected = rough_weights(normals, tx, rx, lobe_deg)
    assert weights[0, 0, 0] == pytest.approx(np.where(expected < 1e-4, 0, expected), abs=1e-6)
    assert 0 < weights.max() <= 1


def test_half_the_power_is_left_at_the_stated_angle():
    """With both antennas in one place, half of it off the normal, as the mirrored wave turns twice as far."""
    antenna = np.array([[[0.0, 0.0, 1.0]]])
    for lobe_deg in (5.0, 47.0, 90.0, 150.0):
        half = np.radians(lobe_deg) / 2
        normal = np.array([[np.sin(half), 0.0, np.cos(half)]])
        (weight,) = RoughModel(lobe_deg=lobe_deg).weights(antenna, antenna, np.zeros((1, 3)), normal).ravel()
        assert weight**2 == pytest.approx(0.5, rel=1e-5)
    assert RoughModel(lobe_deg=90).exponent == pytest.approx(1.0)
    assert RoughModel(lobe_deg=47.0).exponent == pytest.approx(4.0, abs=0.01)


@pytest.mark.slow
def test_a_wide_lobe_is_diffuse_and_a_narrow_one_specular():
    diffuse = ms.simulate(BOX, RADAR, RASTER, model="diffuse")
    assert relative(ms.simulate(BOX, RADAR, RASTER, model="rough", lobe_deg=180).frames, diffuse.frames) < 1e-6
    antenna = np.array([[[0.02, -0.01, 0.3]]])
    rough = Scatterers(BALL.mesh, scattering_model("rough", lobe_deg=16)).weights(antenna, antenna)[0, 0, 0]
    specular = Scatterers(BALL.mesh, scattering_model("specular", tau_deg=8)).weights(antenna, antenna)[0, 0, 0]
    # What is brighter than at half the power is what a specular surface of half the angle keeps.
    assert specular.sum() > 5
    assert np.array_equal(rough > np.sqrt(0.5), specular)
    assert rough[~specular].max() < np.sqrt(0.5)
    energy = [float((ms.simulate(BALL, RADAR, RASTER, model="rough", lobe_deg=w).frames.real ** 2).sum())
              for w in (5, 20, 80)]  # fmt: skip
    assert energy == sorted(energy)


def test_flipped_faces_scatter_alike():
    mesh = BALL.mesh
    flipped = ms.TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])
    antenna = np.array([[[0.0, 0.0, 0.3]]])
    weights = [Scatterers(m, RoughModel()).weights(antenna, antenna) for m in (mesh, flipped)]
    assert weights[0].any()
    assert weights[0] == pytest.approx(weights[1], abs=1e-6)


class Top:
    """A model of one's own: whatever lies above a height, half as bright."""

    name: ClassVar[str] = "top"

    def candidates(self, mesh):
        return mesh.vertices[:, 2] > 0.02

    def weights(self, tx_positions, rx_positions, points, normals):
        return np.full((*tx_positions.shape[:2], rx_positions.shape[1], len(points)), 0.5, dtype=np.float32)


def test_a_model_of_one_s_own():
    capture = ms.simulate(BOX, RADAR, RASTER, model=Top())
    assert capture.metadata["history"][-1]["model"] == "top"
    scatterers = Scatterers(BOX.mesh, scattering_model("diffuse"))
    top = scatterers.points[:, 2] > 0.02
    weights = scatterers.weights(capture.tx_positions, capture.rx_positions)[..., top] * 0.5
    expected = point_frames(
        scatterers.points[top], weights, capture.tx_positions, capture.rx_positions, RADAR.waveform.frequencies, 0.15
    )
    assert relative(capture.frames, expected) < 2e-5


class Ordered(Top):
    def weights(self, tx_positions, rx_positions, points, normals):
        return np.asfortranarray(super().weights(tx_positions, rx_positions, points, normals))


class Frozen(Top):
    def weights(self, tx_positions, rx_positions, points, normals):
        weights = super().weights(tx_positions, rx_positions, points, normals)
        weights.flags.writeable = False
        return weights


def test_weights_may_lie_in_any_order():
    frames = [ms.simulate(BOX, RADAR, RASTER, model=model).frames for model in (Top(), Ordered())]
    np.testing.assert_array_equal(*frames)
    np.testing.assert_array_equal(frames[0], ms.simulate(BOX, RADAR, RASTER, model=Frozen()).frames)


class Beside(Top):
    """Only to antennas on its own side in x, which it tells of a whole block."""

    def weights(self, tx_positions, rx_positions, points, normals):
        beside = (tx_positions[..., :1] > 0) == (points[:, 0] > 0)
        return super().weights(tx_positions, rx_positions, points, normals) * beside[:, :, None]


class Telling(Beside):
    asked: ClassVar[list[int]] = []

    def weights(self, tx_positions, rx_positions, points, normals):
        self.asked.append(len(points))
        return super().weights(tx_positions, rx_positions, points, normals)

    def within_reach(self, tx_positions, rx_positions, points, normals):
        right = tx_positions[..., 0] > 0
        return np.where(points[:, 0] > 0, right.any(), ~right.all())


def test_a_model_may_tell_what_a_block_need_not_ask():
    """A scan beside the box: half of its vertices are asked, and the frames are the same."""
    beside = ms.Trajectory.raster(size=(0.05, 0.05), step=0.01, center=(0.1, 0, 0.2))
    frames = [ms.simulate(BOX, RADAR, beside, model=model).frames for model in (Beside(), Telling())]
    assert np.abs(frames[0]).max() > 0
    np.testing.assert_allclose(frames[1], frames[0], atol=1e-6 * np.abs(frames[0]).max())
    assert 0 < max(Telling.asked) < 0.7 * np.count_nonzero(Top().candidates(BOX.mesh))


class Wrong(Top):
    def weights(self, tx_positions, rx_positions, points, normals):
        return np.ones(len(points))


class Negative(Top):
    def weights(self, tx_positions, rx_positions, points, normals):
        return -super().weights(tx_positions, rx_positions, points, normals)


class NotANumber(Top):
    def weights(self, tx_positions, rx_positions, points, normals):
        return np.nan * super().weights(tx_positions, rx_positions, points, normals)


class WrongCandidates(Top):
    def candidates(self, mesh):
        return np.flatnonzero(super().candidates(mesh))


class WrongReach(Top):
    def within_reach(self, tx_positions, rx_positions, points, normals):
        return np.ones(3)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"model": "specular", "lobe_deg": 20}, UnknownNameError, "parameter of the scattering model 'specular' 'lobe"),
        ({"model": "rough", "lobe": 20}, UnknownNameError, "Did you mean 'lobe_deg'"),
        ({"model": "rough", "lobe_deg": 0}, InputError, "lobe_deg is 0 degrees; expected more than 0"),
        ({"model": "edge", "tau_deg": 200}, InputError, "tau_deg is 200 degrees; expected at most 180"),
        ({"model": RoughModel(), "lobe_deg": 20}, InputError, "has its own parameters; leave lobe_deg out"),
        ({"model": RoughModel}, InputError, "expected a name or a ScatteringModel"),
        ({"model": 3}, InputError, "model is 3; expected a name"),
        (
            {"model": Wrong()},
            InputError,
            r"weights of the scattering model 'top' are float64 \(\d+,\); expected bool or",
        ),
        ({"model": Negative()}, InputError, "a weight of the scattering model 'top' is negative, infinite or NaN"),
        ({"model": NotANumber()}, InputError, "a weight of the scattering model 'top' is negative, infinite or NaN"),
        (
            {"model": WrongCandidates()},
            InputError,
            r"the candidates of the scattering model 'top' are int64 \(\d+,\); expected bool \(\d+,\)",
        ),
        (
            {"model": WrongReach()},
            InputError,
            r"within_reach of the scattering model 'top' is float64 \(3,\); expected bool \(\d+,\)",
        ),
    ],
)
def test_what_cannot_be_is_named(settings, error, message):
    with pytest.raises(error, match=message):
        ms.simulate(BOX, RADAR, RASTER, **settings)


def test_settings_of_the_paper_s_models_go_with_every_name():
    for model in MODELS:
        capture = ms.simulate(BOX, RADAR, RASTER, model=model, tau_deg=9.0, edge_deg=30.0, two_sided=True)
        assert capture.metadata["history"][-1]["model"] == model


def test_an_aperture_has_half_a_wavelength_between_its_positions_or_less():
    """A small object from afar: no ghosts ask for less."""
    radar = ms.Radar.preset("mito-sim-24ghz")
    places = ms.aperture_over(ms.Scene.from_mesh("golf_ball", vertices=200), radar, height=0.15).positions
    half = 299_792_458 / radar.waveform.center_frequency / 2
    for axis in (0, 1):
        assert np.diff(np.unique(places[:, axis].round(9))) == pytest.approx(half, abs=1e-6)


def test_one_stray_vertex_makes_no_aperture_of_its_own_size():
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [100, 0, 0]])
    mesh = ms.TriangleMesh(vertices=vertices, faces=[[0, 1, 2], [0, 3, 1]])
    scene = ms.Scene.from_mesh(mesh, vertices=None, center=False)
    with pytest.raises(InputError, match=r"the scene is 100 m x 0\.2 m wide .*: remove stray vertices, check the unit"):
        ms.aperture_over(scene, RADAR, step=0.01)
    assert len(ms.aperture_over(scene, RADAR, size=(100.0, 0.2), step=1.0)) == 101


def test_apertures_over_a_scene():
    scene = BOX.moved((0.1, 0.0, -0.3))
    raster = ms.aperture_over(scene, RADAR, height=0.25)
    lower, upper = raster.positions.min(axis=0), raster.positions.max(axis=0)
    assert (lower + upper) / 2 == pytest.approx([0.1, 0.0, -0.05], abs=2e-3)
    assert upper - lower == pytest.approx([0.2, 0.18, 0.0], abs=RADAR.waveform.wavelength / 2)
    ms.check_coverage(scene, raster)
    with pytest.raises(ms.errors.CoverageError, match=r"the object lies at x 0.450 to 0.550 m, the aperture at x"):
        ms.check_coverage(scene.moved((0.4, 0, 0)), raster)
    with pytest.raises(ms.errors.CoverageError, match="cm wide along x, the aperture only 5"):
        ms.check_coverage(scene, ms.aperture_over(scene, RADAR, size=(0.05, 0.2), step=0.01))
    with pytest.raises(ms.errors.CoverageError, match="hangs at 2.0 cm; raise the aperture"):
        ms.check_coverage(scene, ms.aperture_over(scene, RADAR, height=0.02))
