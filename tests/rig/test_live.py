"""Images while the arm moves: the last one is that of the recorded scan, and its trouble is not the scan's."""

import threading
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from helpers import oracles
from millisight.core.errors import InputError
from millisight.data import AntennaArray, Radar, Trajectory, VoxelGrid
from millisight.imaging import form_image
from millisight.io import load
from millisight.io.mito import BASE_ORIGIN, experiment_folder, read_experiment
from millisight.rig import CaptureWriter, LiveImaging, PublishedWriter, Recording, record_scan
from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, VirtualRig, World, experiment_info
from millisight.rig.virtual._radar import REFERENCE

POINTS = np.array([[0.05, 0.06, -0.25], [0.08, 0.04, -0.22]])
GRID = VoxelGrid.regular((0.02, 0.01, -0.27), (0.1, 0.09, -0.21), (0.005, 0.005, 0.02))
WORLD = World(
    scan=ScanSettings(size=(0.1, 0.08), row_spacing=0.02),
    arm=ArmSettings(speed=0.5, acceleration=5.0, settle=0.05),
    radars=(
        RadarSettings(frame_period=0.004, lost_packets=0.01),
        RadarSettings(preset="position2go", frame_period=0.02, mount=(0, 0, 0)),
    ),
)
ONE = {"world": replace(WORLD, radars=WORLD.radars[:1]), "grids": {"77_ghz": GRID}}  # the one quicker to write


def echoes(settings, trajectory):
    array, waveform = settings.radar.array, settings.radar.waveform
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    amplitude = np.full(len(POINTS), REFERENCE)
    return oracles.point_frames(POINTS, amplitude, tx, rx, waveform.frequencies, settings.radar.path_offset)


def scan(folder, *, world=WORLD, stop_after=None, **settings):
    rig = VirtualRig(world, frames=echoes)
    out = experiment_folder(folder, "058_golf_ball", (0, 0, 0), 1, "los")
    statuses, rows = [], []
    live = LiveImaging(
        PublishedWriter(out, info=experiment_info(world), hdf5=False),
        settings.pop("grids", {"77_ghz": GRID, "24_ghz": GRID}), origin=BASE_ORIGIN,
        **{"shown": statuses.append, **settings},
    )  # fmt: skip
    enough = None if stop_after is None else lambda: len(rows) >= stop_after
    record_scan(rig.arm, rig.radars, None, rig.plan, live, progress=lambda *done: rows.append(done), enough=enough)
    return rig, out, live, statuses, rows


@pytest.mark.slow
def test_the_last_image_is_that_of_the_recorded_scan(tmp_path):
    rig, out, live, statuses, _ = scan(tmp_path)
    assert {status.radar for status in statuses} == {"77_ghz", "24_ghz"}
    for name, image in live.images.items():
        mine = [status for status in statuses if status.radar == name]
        capture = read_experiment(out, name).to_capture()
        assert mine[-1].rows == len(rig.plan.rows)
        assert mine[-1].poses == len(capture.trajectory) == image.metadata["poses"]
        assert all(a.poses < b.poses for a, b in pairwise(mine))
        whole = form_image(capture, GRID)
        error = np.linalg.norm(image.values - whole.values) / np.linalg.norm(whole.values)
        assert error < 0.005
        brightest = GRID.points[np.argmax(image.magnitude)]
        assert np.abs(brightest - POINTS).max(axis=1).min() < 0.011
    assert live.trouble is None
    assert all(status.lag >= 0 for status in statuses)


@pytest.mark.parametrize("name", ["front", "a b#é?"])
def test_an_arm_that_turns_the_radar_turns_its_antennas(tmp_path, name):
    """As in the capture that is written; the published layout is read without orientations."""
    array = AntennaArray(tx_positions=[(0, 0, 0)], rx_positions=[(0.02 * n, 0, 0) for n in range(4)])
    device = SimpleNamespace(
        name=name, frame_period=0.1, mount=np.array([0.03, 0.01, 0]),
        radar=replace(Radar.preset("mito-sim-24ghz"), array=array),
    )  # fmt: skip
    path = Trajectory(
        times=0.1 * np.arange(20),
        positions=[(0.05, y, 0) for y in np.linspace(0, 0.1, 20)],
        orientations=np.tile([0, 0, np.sqrt(0.5), np.sqrt(0.5)], (20, 1)),
    )
    frames = echoes(SimpleNamespace(radar=replace(device.radar, array=array.moved(translation=device.mount))), path)
    live = LiveImaging(CaptureWriter(tmp_path / "scan", origin=(0, 0, 0)), {name: GRID})
    with live.recording([device]):
        samples = np.asarray(frames, np.complex64).reshape(20, 1, 4, -1)
        live.add_row(device, Recording(samples=samples, first_time=0, period=0.1, lost=np.zeros(20, bool)))
        live.end_row(path)
        live.finish()
    capture = load(tmp_path / "scan" / f"{name}.capture.h5")
    whole = form_image(capture, GRID).values
    assert np.linalg.norm(live.images[name].values - whole) < 1e-3 * np.linalg.norm(whole)
    straight = replace(capture, trajectory=replace(capture.trajectory, orientations=None))
    assert np.linalg.norm(form_image(straight, GRID).values - whole) > 0.3 * np.linalg.norm(whole)


@pytest.mark.slow
def test_a_scan_ends_when_its_image_is_good_enough(tmp_path):
    _, out, live, _, rows = scan(tmp_path, stop_after=4, **ONE)
    assert len(rows) == 4
    held = read_experiment(out, "77_ghz")
    assert len(held.rows) == 4
    assert live.images["77_ghz"].metadata["poses"] == len(held.to_capture().trajectory)


@pytest.mark.slow
def test_trouble_of_the_images_does_not_end_the_scan(tmp_path):
    def full(status):
        raise OSError("no space left on device")

    _, out, live, _, rows = scan(tmp_path, shown=full, **ONE)
    assert live.trouble == "no space left on device"
    assert len(read_experiment(out, "77_ghz").rows) == len(rows) == len(WORLD.scan.row_places)


def test_a_scan_that_fails_leaves_no_thread_behind(tmp_path):
    rig = VirtualRig(WORLD, frames=lambda *_: (_ for _ in ()).throw(InputError("the radar is unplugged")))
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    live = LiveImaging(PublishedWriter(out, info=experiment_info(WORLD), hdf5=False), {"77_ghz": GRID})
    with pytest.raises(InputError, match="unplugged"):
        record_scan(rig.arm, rig.radars, None, rig.plan, live)
    assert "live imaging" not in {thread.name for thread in threading.enumerate()}
    assert live.images == {}


def test_there_must_be_something_to_image(tmp_path):
    with pytest.raises(InputError, match="grids is empty"):
        scan(tmp_path, grids={})
