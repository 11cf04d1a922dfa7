"""Serpentine experiments from raw files to image, with the true path hidden from the processing."""

import dataclasses

import numpy as np
import pytest

from helpers import oracles
from millisight.calibration import retime, subtract_background
from millisight.data import Capture, Trajectory, VoxelGrid
from millisight.imaging import estimate_clock, form_image
from millisight.io.mito import experiment_folder, radar_folder, read_experiment
from millisight.io.raw import read_position2go
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, VirtualRig, World, experiment_info
from millisight.rig.virtual._radar import REFERENCE

MIDDLE = np.array([0.08, 0.08, -0.25])
POINTS = MIDDLE + np.random.default_rng(0).uniform(-0.02, 0.02, (5, 3)) * [1, 1, 0.3]
DRIFTING = {"clock_offset": -0.013, "clock_drift": -30e-6}

AT_77 = World(
    seed=4,
    scan=ScanSettings(size=(0.16, 0.12), row_spacing=0.004),
    arm=ArmSettings(
        speed=0.5, acceleration=4.0, settle=0.05, path_error=0.3e-3, encoder_noise=0.03e-3,
        clock_offset=0.02, clock_drift=50e-6,
    ),
    radars=(RadarSettings(frame_period=0.006, **DRIFTING),),
)  # fmt: skip
AT_24 = World(  # a wave three times as long: an arm that strays by 1.5 mm does the same harm
    seed=4,
    scan=ScanSettings(size=(0.14, 0.14), row_spacing=0.007),
    arm=ArmSettings(
        speed=0.1, acceleration=1.0, path_error=1.5e-3, encoder_noise=0.1e-3, clock_offset=0.07, clock_drift=50e-6
    ),
    radars=(RadarSettings(preset="position2go", mount=(0, 0, 0), **DRIFTING),),
)


def scattered(settings, trajectory):
    """Echoes of points of all strengths."""
    array = settings.radar.array
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    amplitudes = REFERENCE * np.random.default_rng(1).uniform(0.1, 1, len(POINTS))
    return oracles.point_frames(
        POINTS, amplitudes, tx, rx, settings.radar.waveform.frequencies, settings.radar.path_offset
    )


def nothing(settings, trajectory):
    array = settings.radar.array
    return np.zeros((len(trajectory), 1, len(array.rx_positions), settings.radar.waveform.samples_per_chirp), complex)


def recorded(world, folder, frames, name):
    rig = VirtualRig(world, frames=frames)
    out = experiment_folder(folder, name, (0, 0, 0), 1, "los")
    record_scan(rig.arm, rig.radars, None, rig.plan, PublishedWriter(out, info=experiment_info(world), hdf5=False))
    return rig, out


@pytest.fixture(scope="module")
def at_77(tmp_path_factory):
    """The rig, which knows the truth, and what the processing knows: capture and log."""
    rig, out = recorded(AT_77, tmp_path_factory.mktemp("at_77"), scattered, "000_points")
    scan = read_experiment(out, "77_ghz")
    return rig, scan.to_capture(), scan.log


@pytest.fixture(scope="module")
def raw_24(tmp_path_factory):
    """The rig, the scan, its folder, and the scan of the empty scene as others find it later."""
    folder = tmp_path_factory.mktemp("at_24")
    empty = dataclasses.replace(AT_24, seed=5, scan=ScanSettings(size=(0.01, 0.14), row_spacing=0.01))
    rig, out = recorded(AT_24, folder, scattered, "000_points")
    found = recorded(empty, folder, nothing, "000_background")[1]
    return rig, read_experiment(out, "24_ghz"), out, read_experiment(found, "24_ghz")


@pytest.fixture(scope="module")
def at_24(raw_24):
    rig, scan, _, empty = raw_24
    return rig, subtract_background(scan.to_capture(), empty.to_capture(), frame="first"), scan.log


def at(capture, positions):
    trajectory = Trajectory(times=capture.trajectory.times, positions=positions)
    return Capture(radar=capture.radar, trajectory=trajectory, frames=capture.frames)


def image(capture):
    half = np.array([0.03, 0.03, 0.01])
    return form_image(capture, VoxelGrid.regular(MIDDLE - half, MIDDLE + half, (0.002, 0.002, 0.005))).values


def sharpness_and_match(values, truth):
    """Sum of |I|^4 over that of the truth, and the complex normalised correlation with it."""
    sharpness = (np.abs(values) ** 4).sum() / (np.abs(truth) ** 4).sum()
    match = abs(np.vdot(truth, values)) / np.linalg.norm(truth) / np.linalg.norm(values)
    return sharpness, match


@pytest.mark.slow
@pytest.mark.parametrize(("band", "strayed_by"), [("77_ghz", 0.3e-3), ("24_ghz", 1.5e-3)])
def test_the_log_and_the_frames_alone_give_the_image_of_the_true_path(band, strayed_by, request):
    rig, capture, log = request.getfixturevalue(f"at_{band[:2]}")
    truth, planned = rig.truth(band), rig.planned(band)
    strayed = np.linalg.norm(truth.positions - planned.positions, axis=1)
    assert np.sqrt((strayed**2).mean()) == pytest.approx(strayed_by, rel=0.2)

    estimate = estimate_clock(capture, log)
    assert estimate.observable, estimate.reason
    corrected = retime(capture, log, estimate.clock)
    frames = {}
    for name, one in (("corrected", corrected), ("as logged", capture)):
        index = np.searchsorted(truth.times, one.trajectory.times - 1e-4)
        assert one.trajectory.times == pytest.approx(truth.times[index], abs=2e-6)
        frames[name] = index
    true = image(at(corrected, truth.positions[frames["corrected"]]))
    images = {
        "corrected": image(corrected),
        "planned": image(at(corrected, planned.positions[frames["corrected"]])),
        "as logged": image(capture),
    }
    figures = {name: sharpness_and_match(values, true) for name, values in images.items()}
    assert min(figures["corrected"]) >= 0.95
    assert figures["planned"][0] < 0.95
    assert figures["planned"][1] < 0.95
    assert figures["as logged"][0] < 0.95
    assert figures["as logged"][1] < 0.95


def test_at_24_ghz_every_chirp_of_a_frame_has_noise_of_its_own(raw_24):
    rig, scan, out, _ = raw_24
    files = sorted((radar_folder(out, "24_ghz", processed=False) / "radar_data").iterdir())
    assert len(files) == len(rig.plan.rows) == 21
    samples = read_position2go(files[0]).samples
    assert samples.shape == (110, 16, 2, 256)  # filled for the published code
    samples = samples[: rig.plan.frames(0.1)]
    sigma = 10 ** (-AT_24.radars[0].snr_db / 20) / 10 ** (AT_24.radars[0].full_scale_db / 20) * 32767
    # Thermal noise, and the converter's steps; all else of a frame's chirps is the same.
    spread = (abs(samples - samples.mean(axis=1, keepdims=True)) ** 2).mean() * 16 / 15
    assert spread == pytest.approx(sigma**2 + 2 / 12, rel=0.02)
    # The first is what is used.
    assert np.array_equal(scan.rows[0].read()[:, 0], np.conj(samples[:, 0]))
