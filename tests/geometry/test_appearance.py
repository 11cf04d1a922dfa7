"""The simulator's image of a mesh beside a measured one: known weights are found, other shapes agree less."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

import millisight as ms
from helpers import posed
from millisight.core import rotation_from_euler_deg
from millisight.core.errors import CoverageError, InputError
from millisight.data import Layers
from millisight.geometry import agreements, appearance

PATH = ms.Trajectory.raster(size=(0.08, 0.08), step=0.003)


@pytest.fixture(scope="module")
def scene():
    return ms.Scene.from_mesh("padlock")


@pytest.fixture(scope="module")
def parts(scene):
    radar = ms.Radar.preset("mito-sim-77ghz")
    return [ms.simulate(scene, radar, PATH, model=model) for model in ("specular", "edge")]


@pytest.fixture(scope="module")
def right(scene, parts):
    return appearance(ms.combine(*parts, (0.5, 0.5)), scene.mesh)


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [(1, 0), (0.5, 0.5), (0.1, 0.9)])
def test_weights_that_are_known_are_found(scene, parts, alpha):
    """By a mesh that is 2 mm off."""
    found = appearance(ms.combine(*parts, alpha), scene.mesh.moved(translation=(0.002, -0.002, 0.001)))
    assert sum(found.alpha) == pytest.approx(1)
    assert abs(found.alpha[0] - alpha[0]) < 0.05
    # What shines of it has edges near: the more there are of their echoes, the better the weights are known.
    assert found.alpha_sigma < {1: 0.7, 0.5: 0.45, 0.1: 0.15}[alpha[0]]
    assert found.agreement > 0.95


@pytest.mark.slow
def test_the_unit_of_the_frames_does_not_matter(scene, parts, right):
    capture = ms.combine(*parts, (0.5, 0.5))
    large = dataclasses.replace(capture, frames=capture.frames * np.float32(1e30))
    again = appearance(large, scene.mesh)
    np.testing.assert_allclose([*again.alpha, again.agreement], [*right.alpha, right.agreement], rtol=1e-3)


@pytest.mark.slow
def test_another_shape_or_pose_agrees_less(scene, parts, right):
    capture = ms.combine(*parts, (0.5, 0.5))
    turned = appearance(capture, scene.mesh.moved(rotation=rotation_from_euler_deg((0, 0, 90)))).agreement
    other = appearance(capture, posed.block([-0.03] * 3, [0.03] * 3)).agreement
    assert right.agreement > 0.98
    assert max(turned, other) < 0.9


@pytest.mark.slow
def test_of_several_meshes_the_right_one_looks_most_like_it(scene, parts):
    """On voxels that all share: a small thing at the brightest place does not explain the rest."""
    capture = ms.combine(*parts, (0.5, 0.5))
    meshes = {
        "padlock": scene.mesh,
        "block": posed.block(*scene.mesh.bounds),
        "in the radar": posed.block([-0.5] * 3, [0.5] * 3),
        "bead": posed.block([-0.005] * 3, [0.005] * 3).moved(translation=scene.mesh.vertices[0]),
    }
    steps = []
    few = agreements(capture, {"padlock": scene.mesh}, scene.mesh.vertices, progress=lambda *step: steps.append(step))
    assert few["padlock"] > 0.95
    assert steps == [(1, 1)]
    found = agreements(capture, {name: meshes[name] for name in ("padlock", "block", "bead")}, scene.mesh.vertices)
    assert found["padlock"] > 0.95
    assert max(found["block"], found["bead"]) < found["padlock"] - 0.05
    # Where no object can be nothing agrees; and where there are too many voxels, nothing is said.
    assert agreements(capture, {"x": meshes["in the radar"]}, scene.mesh.vertices) in ({"x": 0.0}, {})
    assert agreements(capture, {"padlock": scene.mesh}, [*scene.mesh.vertices, (5.0, 5.0, 0.0)]) == {}


@pytest.mark.slow
def test_where_nothing_echoes_there_are_no_weights(scene, parts):
    path = ms.Trajectory(times=PATH.times[:50], positions=PATH.positions[:50])
    silent = dataclasses.replace(parts[0], trajectory=path, frames=np.zeros_like(parts[0].frames[:50]))
    assert appearance(silent, scene.mesh) == (0.0, (0.0, 0.0), 0.0)


@pytest.mark.slow
def test_what_the_simulator_does_not_know_is_refused(scene, parts):
    layers = Layers(thicknesses=[0.01], indices=[1.2], normal=[0, 0, -1], moved=0.0, offset=0.0, error=0.0)
    with pytest.raises(InputError, match="expects a radar carried along a trajectory"):
        appearance(dataclasses.replace(parts[0], layers=layers), scene.mesh)
    with pytest.raises(CoverageError, match="inside"):
        appearance(parts[0], scene.mesh.moved(translation=(0, 0, 0.2)))
    large = ms.TriangleMesh(vertices=100 * scene.mesh.vertices, faces=scene.mesh.faces)
    with pytest.raises(InputError, match=r"7.* m long, .* voxels; expected 1e\+08 at most: check its unit"):
        appearance(parts[0], large)


@pytest.mark.slow
def test_waves_longer_than_the_scene_take_bounded_memory(scene, parts):
    """Blurred by a wavelength of 300 km, an image took 4 GB."""
    low = dataclasses.replace(parts[0].radar, waveform=ms.Waveform.stepped(1e3, 1.0, parts[0].frames.shape[-1]))
    poses = ms.Trajectory(times=PATH.times[:50], positions=PATH.positions[:50])
    capture = ms.Capture(radar=low, trajectory=poses, frames=parts[0].frames[:50])
    tracemalloc.start()
    try:
        assert 0 <= appearance(capture, scene.mesh).agreement <= 1
        assert tracemalloc.get_traced_memory()[1] < 300 << 20
    finally:
        tracemalloc.stop()
