"""A radar's mount, path offset and gains come out of a scan of one target, each with an uncertainty that holds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import millisight as ms
from helpers.oracles import C
from millisight.calibration import RadarCalibration, ReferenceTarget, calibrate_radar
from millisight.core import record_from_file, toml_of, write_text
from millisight.core.errors import InputError, UnknownNameError

PLACE = np.array([0.01, -0.015, 0.0])
OFFSET = np.array([0.004, -0.003, 0.006])
TURN_DEG = np.array([0.0, -1.2, 1.5])
RADAR = ms.Radar.preset("iwr1443")  # receivers along x: what a turn about x changes is nothing
RADAR = replace(
    RADAR, waveform=replace(RADAR.waveform, samples_per_chirp=64, sample_rate=RADAR.waveform.sample_rate / 8)
)
GAINS = np.array([[1.2, 0.9 * np.exp(0.8j), 1.1 * np.exp(-2j), 0.8 * np.exp(3j)]])


def way(kind, tx, rx, place, radius=0.0):
    """The way over a target, from what it is: a mirror image, or the shortest over a surface."""
    if kind == "point":
        return np.linalg.norm(tx - place) + np.linalg.norm(rx - place)
    if kind == "corner":
        image = tx
        for normal in Rotation.from_euler("xyz", (0.3, 0.5, 0.1)).as_matrix():
            image = image - 2 * ((image - place) @ normal) * normal
        return np.linalg.norm(image - rx)

    def length(angles):
        a, b = angles
        at = place + radius * np.array([np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)])
        return np.linalg.norm(tx - at) + np.linalg.norm(rx - at)

    return minimize(length, (0.0, 0.0), method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14}).fun


def scan(seed=0, *, tilt=5.0, noise=0.0, wander=0.0, offset=OFFSET, gains=GAINS, kind="point", radius=0.0):
    """A scan by a radar that is not where it is told to be; rows tilted at random, positions wandering slowly."""
    rng = np.random.default_rng(seed)
    told = ms.Trajectory.raster(size=(0.15, 0.15), step=(0.01, 0.006), center=(0, 0, 0.3))
    turns = rng.normal(0, tilt, (16, 3))[np.repeat(np.arange(16), 26)]
    told = replace(told, orientations=Rotation.from_euler("xyz", turns, degrees=True).as_quat())
    errors = np.repeat(rng.normal(0, wander, (26, 3)), 16, axis=0)
    true = replace(told, positions=told.positions + errors)
    turn = Rotation.from_rotvec(TURN_DEG, degrees=True).as_matrix()
    tx, rx = (true.placed(p @ turn.T + offset) for p in (RADAR.array.tx_positions, RADAR.array.rx_positions))
    target = ReferenceTarget(position=PLACE, uncertainty=0, kind=kind, radius=radius)
    ways = target.paths(tx, rx).lengths + 0.2
    frames = gains[..., None] * np.exp(-2j * np.pi * ((ways[..., None] * RADAR.waveform.frequencies / C) % 1))
    frames = frames + noise * (rng.normal(size=(*frames.shape, 2)) @ [1, 1j])
    return ms.Capture(radar=RADAR, trajectory=told, frames=frames), target


@pytest.mark.parametrize(("kind", "radius"), [("point", 0.0), ("corner", 0.0), ("sphere", 0.02)])
def test_ways_over_targets_are_those_of_mirrors_and_of_fermat(kind, radius):
    rng = np.random.default_rng(1)
    tx = rng.uniform((-0.1, -0.1, 0.2), (0.1, 0.1, 0.4), (5, 2, 3))
    rx = rng.uniform((-0.1, -0.1, 0.2), (0.1, 0.1, 0.4), (5, 3, 3))
    target = ReferenceTarget(position=PLACE, kind=kind, radius=radius)
    found = target.paths(tx, rx)
    expected = [[[way(kind, tx[p, t], rx[p, r], PLACE, radius) for r in range(3)] for t in range(2)] for p in range(5)]
    # A sphere's way is that by where the normal halves the angle: here, 20 cm apart, 0.1 mm too long at most.
    assert np.abs(found.lengths - expected).max() < (1e-4 if radius else 1e-12)
    step = 1e-6 * rng.normal(size=3)
    changed = target.paths(tx + step, rx).lengths - target.paths(tx - step, rx).lengths
    assert np.abs(changed / 2 - found.by_tx @ step).max() < 2e-3 * np.linalg.norm(step)
    changed = target.paths(tx, rx, PLACE + step).lengths - target.paths(tx, rx, PLACE - step).lengths
    assert np.abs(changed / 2 + (found.by_tx + found.by_rx) @ step).max() < 2e-3 * np.linalg.norm(step)


def test_a_sphere_seen_by_one_radar_has_its_true_way():
    tx = np.array([[[0.05, 0.02, 0.3]]])
    rx = tx + np.array([0.02, 0, 0])
    target = ReferenceTarget(position=PLACE, kind="sphere", radius=0.02)
    assert abs(target.paths(tx, rx).lengths.item() - way("sphere", tx[0, 0], rx[0, 0], PLACE, 0.02)) < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "radius"), [("point", 0.0), ("corner", 0.0), ("sphere", 0.02)])
def test_without_noise_the_mount_is_exact(kind, radius):
    capture, target = scan(kind=kind, radius=radius)
    found = calibrate_radar(capture, target)
    assert np.abs(np.array(found.offset) - OFFSET).max() < 5e-6
    assert np.abs(np.array(found.turn_deg) - TURN_DEG).max() < 0.02
    assert abs(found.path_offset - 0.2) < 1e-5
    assert found.undetermined == ("turn about x",)
    assert found.turn_deg[0] == pytest.approx(0, abs=1e-3)
    assert found.turn_uncertainty_deg[0] == 0
    gains = GAINS / np.abs(GAINS).mean()
    assert np.abs(found.gains / gains - 1).max() < 0.01
    assert found.phase_error < 0.02


@pytest.mark.slow
def test_leakage_that_all_frames_share_changes_nothing():
    """Five times as strong as the target, in the profile 20 cm above it."""
    capture, target = scan(seed=2)
    leakage = 5 * GAINS.conj()[..., None] * np.exp(-2j * np.pi * 0.2 * RADAR.waveform.frequencies / C)
    leaking = replace(capture, frames=(capture.frames + leakage).astype(np.complex64))
    found = calibrate_radar(leaking, target)
    assert np.abs(np.array(found.offset) - OFFSET).max() < 2e-5
    assert abs(found.path_offset - 0.2) < 2e-5
    assert found.phase_error < 0.02


@pytest.mark.slow
def test_uncertainties_hold():
    """Rows that err as a whole, noise of 0 dB in a sample: errors are of the size that is told."""
    scores = []
    for seed in range(12):
        capture, exact = scan(seed, noise=0.7, wander=1e-4)
        rng = np.random.default_rng(100 + seed)
        target = replace(exact, position=PLACE + rng.normal(0, 2e-3, 3), uncertainty=2e-3)
        found = calibrate_radar(capture, target)
        errors = np.array(found.offset) - OFFSET, np.array(found.turn_deg)[1:] - TURN_DEG[1:]
        told = np.array(found.offset_uncertainty), np.array(found.turn_uncertainty_deg)[1:]
        free = np.array([f"turn about {axis}" not in found.undetermined for axis in "yz"])
        scores += [*errors[0] / told[0], *(errors[1] / np.where(free, told[1], np.inf))[free]]
        scores.append((found.path_offset - 0.2) / found.path_offset_uncertainty)
    scores = np.array(scores)
    assert len(scores) > 50
    assert 0.5 < np.sqrt(np.mean(scores**2)) < 1.6
    assert np.abs(scores).max() < 6


@pytest.mark.slow
def test_a_level_radar_knows_its_offset_to_the_targets_uncertainty():
    capture, exact = scan(tilt=0.0)
    found = calibrate_radar(capture, replace(exact, position=PLACE + np.array([1e-3, -2e-3, 1e-3]), uncertainty=2e-3))
    assert np.allclose(found.offset_uncertainty, 2e-3, rtol=0.05)
    assert np.abs(np.array(found.offset) - OFFSET).max() < 5e-3
    found = calibrate_radar(capture, replace(exact, position=PLACE + np.array([0.01, 0, 0]), uncertainty=0.2))
    assert {"offset along x", "offset along y", "offset along z"} <= set(found.undetermined)
    assert found.offset == (0, 0, 0)


@pytest.mark.slow
def test_a_calibrated_capture_has_its_image_where_the_target_is():
    capture, target = scan(seed=4)
    grid = ms.VoxelGrid.regular(PLACE - 0.005, PLACE + 0.005, 0.001)
    before = ms.form_image(capture, grid, method="exact")
    calibrated = calibrate_radar(capture, target).apply(capture)
    after = ms.form_image(calibrated, grid, method="exact")
    assert before.magnitude.max() < 0.6
    assert after.magnitude.max() == pytest.approx(np.abs(GAINS).mean(), rel=0.01)
    assert np.abs(after.peak - PLACE).max() < 0.0006
    steps = [entry["step"] for entry in calibrated.metadata["history"]]
    assert steps == ["set_antennas", "set_path_offset", "divide_gains"]


@pytest.mark.slow
def test_calibrations_are_kept_as_toml(tmp_path):
    capture, target = scan()
    found = calibrate_radar(capture, target)
    path = tmp_path / "mine.calibration.toml"
    write_text(path, toml_of(found))
    kept = record_from_file(RadarCalibration, path, "a calibration")
    assert toml_of(kept) == toml_of(found)
    assert np.array_equal(kept.gains, found.gains)


@pytest.mark.slow
def test_what_cannot_be_calibrated_is_refused():
    capture, target = scan()
    with pytest.raises(InputError, match="no signal where the target should be"):
        calibrate_radar(replace(capture, frames=np.zeros_like(capture.frames)), target)
    noise = np.random.default_rng(0).normal(size=(*capture.frames.shape, 2)) @ [1, 1j]
    with pytest.raises(InputError, match="the phases fit no target there: 10. degrees are left"):
        calibrate_radar(replace(capture, frames=noise), target)
    with pytest.raises(
        InputError, match=r"the best path offset is 0.2 m, more than search = 0.01 m from the radar's 0.15"
    ):
        calibrate_radar(capture, target, search=0.01)
    with pytest.raises(InputError, match="the band repeats"):
        calibrate_radar(capture, target, search=100.0)
    few = replace(capture.trajectory, times=[0.0], positions=[[0, 0, 0.3]], orientations=None)
    with pytest.raises(InputError, match="1 poses and 64 frequencies; expected at least 48 and 4"):
        calibrate_radar(replace(capture, trajectory=few, frames=capture.frames[:1]), target)
    with pytest.raises(InputError, match="there is no mount"):
        calibrate_radar(replace(capture, rx_points=capture.rx_positions), target)
    with pytest.raises(InputError, match="a sphere has the radius 0 m"):
        ReferenceTarget(position=PLACE, kind="sphere")
    with pytest.raises(UnknownNameError, match="unknown kind of target 'cube'"):
        ReferenceTarget(position=PLACE, kind="cube")
    other = replace(calibrate_radar(capture, target), radar="another")
    with pytest.raises(InputError, match="the calibration is of the radar another"):
        other.apply(capture)
    with pytest.raises(InputError, match="a row for each transmitter"):
        replace(other, phases=((0.0,),))
