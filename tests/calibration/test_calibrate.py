"""Calibration: what was put wrong is put right, and what cannot be told is refused."""

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import point_frames
from millisight.calibration import _calibrate as calibrate
from millisight.core.errors import InputError, UnknownNameError

TARGET = np.array([0.01, -0.02, 0.0])
TRAJECTORY = ms.Trajectory.raster(size=(0.08, 0.06), step=0.01, center=(0, 0, 0.3))
WAVEFORM = ms.Waveform(start_frequency=77.5e9, slope=60e12, sample_rate=1.25e6, samples_per_chirp=64)


def radar(path_offset=0.0, receivers=((-0.01, 0, 0), (0.01, 0, 0))):
    array = ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=receivers)
    return ms.Radar(name="test", waveform=WAVEFORM, array=array, path_offset=path_offset)


def capture_of(points, amplitudes, *, offset=0.0, stated=0.0, noise=0.0, trajectory=TRAJECTORY, gains=1.0):
    """A capture of point reflectors, whose true path offset is `offset`, and which states another."""
    device = radar(stated)
    tx, rx = trajectory.placed(device.array.tx_positions), trajectory.placed(device.array.rx_positions)
    frames = gains * point_frames(np.atleast_2d(points), amplitudes, tx, rx, WAVEFORM.frequencies, offset)
    rng = np.random.default_rng(1)
    frames = frames + noise * (rng.normal(size=frames.shape) + 1j * rng.normal(size=frames.shape))
    return ms.Capture(radar=device, trajectory=trajectory, frames=frames)


def steps(capture):
    return [entry["step"] for entry in capture.metadata["history"]]


@pytest.mark.parametrize("offset", [0.15, -0.0312, 0.4])
def test_a_path_offset_is_found_from_a_target(offset):
    capture = capture_of(TARGET, np.array([2j]), offset=offset)
    found = calibrate.estimate_path_offset(capture, TARGET)
    assert abs(found.value - offset) < 1e-5
    set_right = calibrate.set_path_offset(capture, found.value)
    assert steps(set_right) == ["set_path_offset"]
    grid = ms.VoxelGrid.regular(TARGET, TARGET, 1.0)
    assert abs(ms.form_image(set_right, grid, method="exact").magnitude.max() - 2) < 1e-3
    assert ms.form_image(capture, grid, method="exact").magnitude.max() < 1.9 or abs(offset) < 0.05


def test_its_uncertainty_is_honest():
    """Noise 6 dB over the target in each sample, and clutter: the error is of the size that is stated."""
    errors = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        clutter = rng.uniform((-0.2, -0.2, -0.1), (0.2, 0.2, 0.1), (5, 3))
        points = np.vstack([TARGET, clutter])
        capture = capture_of(points, np.array([1, *(0.2 * np.ones(5))]), offset=0.15)
        frames = capture.frames + np.float32(1.4) * (rng.normal(size=(*capture.frames.shape, 2)) @ [1, 1j])
        noisy = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=frames)
        found = calibrate.estimate_path_offset(noisy, TARGET, search=(0.05, 0.3))
        assert 0 < found.uncertainty < 5e-3
        errors.append((found.value - 0.15) / found.uncertainty)
    assert np.sqrt(np.mean(np.square(errors))) < 3


def test_offsets_that_look_alike_are_refused():
    capture = capture_of(TARGET, np.array([1]))
    span = 299_792_458 / WAVEFORM.frequency_step
    with pytest.raises(InputError, match=f"less than {span:.3g} m apart"):
        calibrate.estimate_path_offset(capture, TARGET, search=(0, 1.01 * span))
    single = calibrate.crop_samples(capture, 3, 4)
    with pytest.raises(InputError, match="single frequency"):
        calibrate.estimate_path_offset(single, TARGET)


@pytest.mark.parametrize("offset", [1.2, 1.5, -0.9])
def test_an_offset_beyond_the_search_is_not_guessed(offset):
    capture = capture_of(TARGET, np.array([1]), offset=offset)
    with pytest.raises(InputError, match=r"no offset from -0\.5 to 1 m stands out"):
        calibrate.estimate_path_offset(capture, TARGET)
    search = (min(-0.5, offset - 0.3), max(1.0, offset + 0.3))
    assert calibrate.estimate_path_offset(capture, TARGET, search=search).value == pytest.approx(offset, abs=1e-5)


def test_gains_are_found_and_undone():
    gains = np.array([[0.7 * np.exp(0.4j), 1.3 * np.exp(-1.1j)]])
    crooked = capture_of(TARGET, np.array([0.5]), gains=gains[:, :, None], offset=0.15, stated=0.15)
    found = calibrate.estimate_gains(crooked, TARGET)
    assert np.abs(found / found[0, 0] - gains / gains[0, 0]).max() < 1e-6
    straight = calibrate.divide_gains(crooked, gains)
    assert steps(straight) == ["divide_gains"]
    assert np.abs(straight.frames - capture_of(TARGET, np.array([0.5]), offset=0.15).frames).max() < 1e-6
    with pytest.raises(InputError, match="holds a zero"):
        calibrate.divide_gains(crooked, [[0, 1]])
    for odd in (1e39, 1e300, 1e-44):  # of which frames became 0, or infinite
        with pytest.raises(InputError, match=r"gains has an amplitude of 1e.*; expected 1e-15 to 1e\+15"):
            calibrate.divide_gains(crooked, [[odd, 1]])
    with pytest.raises(InputError, match=r"reference, raised to its power, has an amplitude of 1e\+60"):
        calibrate.divide_reference(crooked, np.full(crooked.frames.shape[-1], 1e30), power=2)
    with pytest.raises(InputError, match=r"gains has shape \(2, 1\)"):
        calibrate.divide_gains(crooked, gains.T)


def test_antennas_are_moved():
    capture = capture_of(TARGET, np.array([1]))
    array = ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0, -0.01, 0], [0, 0.01, 0]])
    moved = calibrate.set_antennas(capture, array)
    np.testing.assert_array_equal(moved.rx_positions, TRAJECTORY.placed(array.rx_positions))
    assert steps(moved) == ["set_antennas"]
    with pytest.raises(InputError):
        calibrate.set_antennas(capture, ms.AntennaArray.monostatic())


def test_phases_over_frequency():
    capture = capture_of(TARGET, np.array([1]))
    known = np.linspace(77e9, 81e9, 9)
    phases = 3e-9 * (known - 77e9)  # linear, so that interpolation is exact
    turned = calibrate.add_phase(capture, known, phases)
    expected = capture.frames * np.exp(3e-9j * (WAVEFORM.frequencies - 77e9))
    assert np.abs(turned.frames - expected).max() < 1e-6
    nearest = calibrate.add_phase(capture, known, phases, between="nearest")
    angles = np.angle(nearest.frames / capture.frames)[0, 0, 0]
    closest = phases[np.abs(known[:, None] - WAVEFORM.frequencies).argmin(axis=0)]
    assert np.abs(np.angle(np.exp(1j * (angles - closest)))).max() < 1e-5
    assert len(np.unique(closest)) > 3
    with pytest.raises(InputError, match="expected them for the"):
        calibrate.add_phase(capture, known[:3], phases[:3])
    with pytest.raises(UnknownNameError):
        calibrate.add_phase(capture, known, phases, between="cubic")


def test_backgrounds_go_and_the_scene_stays():
    scene = capture_of(TARGET, np.array([1]))
    leakage = np.array([0.3j, 5.0])[None, None, :, None] * np.exp(-0.1j * np.arange(64))
    drifting = leakage * np.linspace(1, 1.5, len(TRAJECTORY))[:, None, None, None]

    def with_frames(frames):
        return ms.Capture(radar=scene.radar, trajectory=scene.trajectory, frames=frames)

    everywhere = np.broadcast_to(leakage, scene.frames.shape)
    for frame in ("first", "mean", "same"):
        restored = calibrate.subtract_background(
            with_frames(scene.frames + everywhere), with_frames(everywhere), frame=frame
        )
        assert np.abs(restored.frames - scene.frames).max() < 1e-5
        assert steps(restored) == ["subtract_background"]
    restored = calibrate.subtract_background(with_frames(scene.frames + drifting), with_frames(drifting), frame="same")
    assert np.abs(restored.frames - scene.frames).max() < 1e-5
    with pytest.raises(UnknownNameError):
        calibrate.subtract_background(scene, scene, frame="last")
    with pytest.raises(InputError, match="another radar"):
        calibrate.subtract_background(scene, calibrate.crop_samples(scene, 0, 8))
    shifted = ms.Trajectory(times=TRAJECTORY.times, positions=TRAJECTORY.positions + np.array([0.001, 0, 0]))
    moved = ms.Capture(radar=scene.radar, trajectory=shifted, frames=scene.frames)
    with pytest.raises(InputError, match="differ by 1 mm"):
        calibrate.subtract_background(scene, moved, frame="same")


def test_the_mean_over_poses_goes():
    scene = capture_of(TARGET, np.array([1]))
    lit = ms.Capture(radar=scene.radar, trajectory=scene.trajectory, frames=scene.frames + 7)
    less = calibrate.subtract_mean(lit)
    assert np.abs(less.frames.mean(axis=0)).max() < 1e-5
    assert np.abs(less.frames - (scene.frames - scene.frames.mean(axis=0))).max() < 1e-5
    path = ms.Trajectory(times=TRAJECTORY.times[:1], positions=TRAJECTORY.positions[:1])
    with pytest.raises(InputError, match="one pose, and nothing would be left"):
        calibrate.subtract_mean(ms.Capture(radar=scene.radar, trajectory=path, frames=scene.frames[:1]))


def test_samples_are_cropped_with_their_frequencies():
    capture = capture_of(TARGET, np.array([1]))
    cropped = calibrate.crop_samples(capture, 10, 42)
    np.testing.assert_allclose(cropped.radar.waveform.frequencies, WAVEFORM.frequencies[10:42], rtol=1e-15)
    np.testing.assert_array_equal(cropped.frames, capture.frames[..., 10:42])
    grid = ms.VoxelGrid.regular(TARGET, TARGET, 1.0)
    assert abs(ms.form_image(cropped, grid, method="exact").values.item() - 1) < 1e-4
    for first, stop in ((-1, 4), (4, 4), (0, 65)):
        with pytest.raises(InputError):
            calibrate.crop_samples(capture, first, stop)
