"""One serpentine experiment from raw files to image, with the true path hidden from the processing."""

import numpy as np
import pytest

import oracles
from millisight.capture.capture import Capture
from millisight.capture.clock import retime
from millisight.capture.trajectory import Trajectory
from millisight.imaging.form import form_image
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.synchronise import estimate_clock
from millisight.io.mito_layout import experiment_folder, read_experiment
from millisight.rig.recorder import record_scan
from millisight.rig.virtual.arm import ArmSettings
from millisight.rig.virtual.radar import REFERENCE, RadarSettings
from millisight.rig.virtual.rig import VirtualRig, experiment_info
from millisight.rig.virtual.world import Scan, World

MIDDLE = np.array([0.08, 0.08, -0.25])
POINTS = MIDDLE + np.random.default_rng(0).uniform(-0.02, 0.02, (5, 3)) * [1, 1, 0.3]
ARM = ArmSettings(
    speed=0.5,
    acceleration=4.0,
    settle=0.05,
    path_error=0.3e-3,
    encoder_noise=0.03e-3,
    clock_offset=0.02,
    clock_drift=50e-6,
)
RADAR = RadarSettings(clock_offset=-0.013, clock_drift=-30e-6)


def scattered(settings, trajectory):
    """Echoes of points of all strengths."""
    array = settings.radar.array
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    amplitudes = REFERENCE * np.random.default_rng(1).uniform(0.1, 1, len(POINTS))
    return oracles.point_frames(
        POINTS, amplitudes, tx, rx, settings.radar.waveform.frequencies, settings.radar.path_offset
    )


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """The rig, which knows the truth, and what the processing knows: capture and log."""
    world = World(seed=4, scan=Scan(size=(0.16, 0.16), row_spacing=0.004), arm=ARM, radars=(RADAR,))
    rig = VirtualRig(world, frames=scattered)
    out = experiment_folder(tmp_path_factory.mktemp("experiment"), "000_points", (0, 0, 0), 1, "los")
    record_scan(rig.arm, rig.radars, None, rig.plan, out, info=experiment_info(world), hdf5=False)
    scan = read_experiment(out, "77_ghz")
    return rig, scan.to_capture(), scan.log


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


def test_the_log_and_the_frames_alone_give_the_image_of_the_true_path(experiment):
    rig, capture, log = experiment
    truth, planned = rig.truth("77_ghz"), rig.planned("77_ghz")
    strayed = np.linalg.norm(truth.positions - planned.positions, axis=1)
    assert np.sqrt((strayed**2).mean()) == pytest.approx(0.3e-3, rel=0.2)

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
