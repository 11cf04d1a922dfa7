"""The recorder, with a virtual rig whose echoes are in closed form: what lands on disk, and what it images to."""

import dataclasses
import json
import os
import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from helpers import oracles
from millisight.core.errors import DamagedFileError, DeviceError, FileError, InputError
from millisight.data import Trajectory, VoxelGrid
from millisight.imaging import form_image
from millisight.io import load
from millisight.io.mito import experiment_folder, radar_folder, read_experiment, read_published
from millisight.rig import CAPTURE_NAME, LOG_NAME, ArmPose, PublishedWriter, Recording, ScanWriter, record_scan
from millisight.rig._rows import Spool
from millisight.rig.virtual import (
    ArmSettings,
    RadarSettings,
    ScanSettings,
    VirtualRig,
    World,
    WorldObject,
    experiment_info,
)
from millisight.rig.virtual._radar import REFERENCE

POINTS = np.array([[0.05, 0.06, -0.25], [0.08, 0.04, -0.22]])
SCAN = ScanSettings(size=(0.12, 0.1), row_spacing=0.012)
QUIET = {"path_error": 0.0, "encoder_noise": 0.0}


def points(settings, trajectory):
    """Echoes of unit points."""
    array, waveform = settings.radar.array, settings.radar.waveform
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    amplitude = np.full(len(POINTS), REFERENCE)
    return oracles.point_frames(POINTS, amplitude, tx, rx, waveform.frequencies, settings.radar.path_offset)


def world_of(**settings):
    return World(
        **{
            "objects": (WorldObject(object="golf_ball", at=(0.06, 0.065)),),
            "scan": SCAN,
            "arm": ArmSettings(speed=0.5, acceleration=5.0, settle=0.05, **QUIET),
            "radars": (RadarSettings(frame_period=0.003),),
            **settings,
        }
    )


def recorded(world, folder, sight="los", **settings):
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(folder, "058_golf_ball", (0, 0, 0), 1, sight)
    writer = PublishedWriter(out, info=experiment_info(world), hdf5=settings.pop("hdf5", True))
    record_scan(rig.arm, rig.radars, settings.pop("camera", None), rig.plan, writer, **settings)
    return rig, out


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    """A scan by devices without fault."""
    radar = RadarSettings(frame_period=0.003, snr_db=100, phase_noise_deg=0, leakage_db=None)
    return recorded(world_of(radars=(radar,)), tmp_path_factory.mktemp("quiet"))


@pytest.mark.slow
def test_what_is_read_back_is_what_was_there(quiet):
    rig, out = quiet
    scan = read_experiment(out, "77_ghz")
    capture = scan.to_capture(min_distance=0)
    truth = rig.truth("77_ghz")
    assert len(scan.rows) == len(SCAN.row_places) == 11
    assert len(capture.trajectory) > 0.9 * len(truth)
    at = np.searchsorted(truth.times, capture.trajectory.times - 1e-4)
    assert capture.trajectory.times == pytest.approx(truth.times[at], abs=2e-6)
    assert np.abs(capture.trajectory.positions - truth.positions[at]).max() < 2e-6
    expected = points(rig.radars[0].settings, Trajectory(times=truth.times[at], positions=truth.positions[at]))
    counts = 32767 / REFERENCE / 100
    # To the converter's steps, 1/327 of an echo.
    assert np.abs(capture.frames / counts - expected).max() / REFERENCE < 0.008


@pytest.mark.slow
def test_it_images_to_the_points(quiet):
    _, out = quiet
    capture = read_experiment(out, "77_ghz").to_capture()
    for point in POINTS:
        image = form_image(capture, VoxelGrid.regular(point - 0.01, point + 0.01, (0.001, 0.001, 0.002)))
        assert np.abs(image.peak - point).max() < 0.0011


def test_the_folder_is_the_published_layout(quiet):
    rig, out = quiet
    raw = radar_folder(out, "77_ghz", processed=False)
    info = json.loads((out.parent / "experiment_info.json").read_text())
    assert info == {"aperture size": "almost-square", "rx offset": "x", "background": "tripod"}
    files = sorted((raw / "radar_data").iterdir())
    assert len(files) == 11
    frames = rig.plan.frames(0.003)
    assert {file.stat().st_size for file in files} == {frames * 4 * 512 * 4}
    # Nothing else is left behind, hidden or not.
    assert sorted(p.name for p in out.parent.parent.iterdir()) == ["exp1"]
    assert sorted(p.name for p in out.parent.iterdir()) == ["experiment_info.json", "los"]
    own = {CAPTURE_NAME, LOG_NAME}
    assert {p.name for p in raw.iterdir()} == {"radar_data", "antenna.npz", "continuous.pkl"} | own


@pytest.mark.slow
def test_our_own_files_hold_the_same(quiet):
    _, out = quiet
    raw = radar_folder(out, "77_ghz", processed=False)
    scan = read_experiment(out, "77_ghz")
    capture, log = load(raw / CAPTURE_NAME), load(raw / LOG_NAME)
    assert np.array_equal(capture.frames, scan.to_capture().frames)
    assert np.array_equal(log.positions, scan.log.positions)


@pytest.mark.slow
def test_both_radars_and_the_camera_in_one_scan(tmp_path):
    radars = (RadarSettings(frame_period=0.01), RadarSettings(preset="position2go", frame_period=0.02))
    world = world_of(radars=radars, scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.05))
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    done = []
    writer = PublishedWriter(out, info=experiment_info(world), hdf5=False)
    record_scan(rig.arm, rig.radars, rig.camera, rig.plan, writer, progress=lambda *count: done.append(count))
    assert done == [(1, 3), (2, 3), (3, 3)]
    frame = read_published(out / "unprocessed" / "camera" / "continuous.pkl").record
    # The camera looks straight down at the aperture's middle, in the base frame.
    assert frame.pose[:3, 3] == pytest.approx([0.42 + 0.05, -0.23 + 0.05, 0.23 + 0.10], abs=1e-6)
    assert frame.pose[:3, 2] == pytest.approx([0, 0, -1])
    for folder, shift in (("77_ghz", 0.0), ("24_ghz", 0.10)):
        raw = radar_folder(out, folder, processed=False)
        with np.load(raw / "antenna.npz") as tables:
            places = tables[f"tx_{folder[:2]}_locs"]
        assert places.shape[1] == 7
        at_rest = places[-1, :3]
        assert at_rest == pytest.approx([0.42 + 0.10, -0.23 + 0.10 + shift, 0.23], abs=1e-6)
        assert len(list((raw / "radar_data").iterdir())) == 3
        assert len(rig.truth(folder)) == 3 * rig.plan.frames({"77_ghz": 0.01, "24_ghz": 0.02}[folder])


@pytest.mark.slow
def test_one_seed_gives_the_same_bytes(tmp_path):
    world = world_of(
        seed=5, scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.05), arm=ArmSettings(speed=0.5, acceleration=5.0),
        radars=(RadarSettings(lost_packets=0.01),),
    )  # fmt: skip
    contents = []
    for folder in ("a", "b", "c"):
        other = World(**{**{f: getattr(world, f) for f in World.__slots__}, "seed": 6}) if folder == "c" else world
        recorded(other, tmp_path / folder)
        files = sorted(p for p in (tmp_path / folder).rglob("*") if p.is_file())
        contents.append({p.relative_to(tmp_path / folder): p.read_bytes() for p in files})
    assert len(contents[0]) == 8
    assert contents[0] == contents[1]
    differing = [str(name.name) for name in contents[0] if contents[0][name] != contents[2][name]]
    assert len(differing) == 6  # all but info and row list


def test_lost_frames_are_not_used(tmp_path):
    world = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.05), radars=(RadarSettings(lost_packets=0.02),))
    rig, out = recorded(world, tmp_path, hdf5=False)
    scan = read_experiment(out, "77_ghz")
    (step,) = [s for s in scan.to_capture().metadata["history"] if s["step"] == "place_frames"]
    assert 0 < step["lost"] < step["frames"] == len(rig.truth("77_ghz"))


class Broken:
    """A radar that fails in its second row."""

    def __init__(self, radar):
        self.radar, self.name, self.frame_period, self.mount = radar.radar, radar.name, 0.01, radar.mount
        self._device, self._rows = radar, 0

    def start(self, frames):
        self._rows += 1
        self._device.start(frames)

    def stop(self):
        recording = self._device.stop()
        if self._rows == 2:
            raise FileError("the card went silent")
        return recording


def test_a_scan_that_fails_leaves_nothing(tmp_path):
    world = world_of()
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    with pytest.raises(FileError, match="the card went silent"):
        record_scan(rig.arm, [Broken(rig.radars[0])], None, rig.plan, PublishedWriter(out, info=experiment_info(world)))
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []
    assert not out.exists()
    assert sorted(p.name for p in out.parent.parent.iterdir()) == ["exp1"]


def test_a_scan_that_fails_goes_on_at_its_row(tmp_path):
    world = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.04), radars=(RadarSettings(frame_period=0.01),))
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    info = experiment_info(world)
    stopped = []
    rig.arm.stop = lambda: stopped.append(True)
    radar = Broken(rig.radars[0])
    with pytest.raises(FileError, match="the card went silent"):
        record_scan(rig.arm, [radar], None, rig.plan, PublishedWriter(out, info=info, keep=rig.plan))
    assert stopped == [True]
    assert not out.exists()
    other = dataclasses.replace(rig.plan, row_time=2 * rig.plan.row_time)
    writer = PublishedWriter(out, info=info, keep=other)
    with pytest.raises(InputError, match="unfinished scan of another plan; remove it"):
        record_scan(rig.arm, [radar], None, other, writer)
    waveform = dataclasses.replace(radar.radar.waveform, start_frequency=78e9)
    tuned = Broken(rig.radars[0])
    tuned.radar = dataclasses.replace(radar.radar, waveform=waveform)
    with pytest.raises(InputError, match="unfinished scan of another plan; remove it"):
        record_scan(rig.arm, [tuned], None, rig.plan, PublishedWriter(out, info=info, keep=rig.plan))
    rows = writer.unfinished / "rows.json"
    whole = rows.read_text()
    for text, words in (("{", "is damaged"), ('["row"]', "is no list of rows")):
        rows.write_text(text)
        with pytest.raises(DamagedFileError, match=words):
            record_scan(rig.arm, [radar], None, rig.plan, PublishedWriter(out, info=info, keep=rig.plan))
    rows.write_text(re.sub(r"\[(\d+), \d", r"[\1, 7", whole, count=1))  # a row's time
    with pytest.raises(DamagedFileError, match="its checksum is of another text; remove the folder"):
        record_scan(rig.arm, [radar], None, rig.plan, PublishedWriter(out, info=info, keep=rig.plan))
    rows.write_text(whole)
    first = writer.unfinished / "rows" / "77_ghz" / "0.npy"
    frames = first.read_bytes()
    first.write_bytes(frames[:-1] + bytes([frames[-1] ^ 1]))
    again = PublishedWriter(out, info=info, keep=rig.plan)
    with again.recording(rig.radars):  # what was changed is scanned anew
        assert again.rows_done == 0
    first.write_bytes(frames)
    log = writer.unfinished / "log" / "0.npz"
    content = log.read_bytes()
    log.write_bytes(content[:-1] + b"x")
    again = PublishedWriter(out, info=info, keep=rig.plan)
    with again.recording(rig.radars):
        assert again.rows_done == 0
    log.write_bytes(content)
    done = []
    writer = PublishedWriter(out, info=info, keep=rig.plan)
    record_scan(rig.arm, [radar], None, rig.plan, writer, progress=lambda *count: done.append(count))
    assert done == [(2, 3), (3, 3)]
    assert not writer.unfinished.exists()
    scan = read_experiment(out, "77_ghz")
    capture, truth = scan.to_capture(min_distance=0), rig.truth("77_ghz")
    assert len(scan.rows) == 3
    at = np.searchsorted(truth.times, capture.trajectory.times - 1e-4)
    assert len(set(at // rig.plan.frames(0.01))) == 3
    assert np.abs(capture.trajectory.positions - truth.positions[at]).max() < 2e-6


def test_an_arm_that_cannot_be_stopped_is_told_of(tmp_path):
    world = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.05))
    rig = VirtualRig(world, frames=points)

    def stop():
        raise DeviceError("no answer")

    rig.arm.stop = stop
    with pytest.raises(DeviceError, match="the card went silent; and the arm could not be stopped, press its stop b"):
        record_scan(rig.arm, [Broken(rig.radars[0])], None, rig.plan, Kept())


def test_half_a_frame_is_no_measurement(tmp_path):
    """The end of a row that got lost, shorter than a packet, is no run of zeros that a reader would know."""
    samples = np.tile(np.rint(900 * np.exp(-0.3j * np.arange(512))), (3, 1, 4, 1)).astype(np.complex64)
    samples[2, :, :, 500:] = 0

    class Short(Broken):
        def stop(self):
            self._device.stop()
            return Recording(samples=samples, first_time=5.0, period=0.01, lost=np.array([False, False, True]))

    world = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.1))
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    record_scan(
        rig.arm, [Short(rig.radars[0])], None, rig.plan, PublishedWriter(out, info=experiment_info(world), hdf5=False)
    )
    rows = read_experiment(out, "77_ghz").rows
    assert len(rows) == 2
    assert all(list(row.missing) == [False, False, True] for row in rows)


def test_what_is_there_is_not_overwritten(tmp_path):
    world = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.1))
    recorded(world, tmp_path, hdf5=False)
    with pytest.raises(InputError, match="already exists"):
        recorded(world, tmp_path)
    # Line of sight and not share the experiment's information, and must agree on it.
    recorded(world, tmp_path, "nlos", hdf5=False)
    other = world_of(scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.1), radars=(RadarSettings(rx_axis="y"),))
    second = World(**{f: getattr(other, f) for f in World.__slots__})
    rig = VirtualRig(second, frames=points)
    out = experiment_folder(tmp_path, "058_golf_ball", (0, 0, 0), 1, "los")
    for path in sorted(out.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    out.rmdir()
    with pytest.raises(InputError, match="need the same set-up"):
        record_scan(rig.arm, rig.radars, None, rig.plan, PublishedWriter(out, info=experiment_info(second)))


def test_the_plan_is_a_serpentine_or_goes_back(tmp_path):
    rows = VirtualRig(world_of(), frames=points).plan.rows
    assert all(isinstance(pose, ArmPose) for row in rows for pose in row)
    along = np.array([[pose.position[1] for pose in row] for row in rows])
    assert (np.diff(along, axis=1)[::2] > 0).all()
    assert (np.diff(along, axis=1)[1::2] < 0).all()
    one_way = VirtualRig(
        world_of(scan=ScanSettings(size=(0.12, 0.1), row_spacing=0.006, pattern="one-way")), frames=points
    )
    assert (np.diff([[pose.position[1] for pose in row] for row in one_way.plan.rows], axis=1) > 0).all()


class Kept:
    """A writer that keeps what it is given, and knows no dataset."""

    path = Path("nowhere")
    rows_done = 0

    def __init__(self):
        self.calls = []

    @contextmanager
    def recording(self, radars):
        self.calls.append(("recording", [radar.name for radar in radars]))
        yield

    def add_picture(self, frame):
        self.calls.append(("picture", frame))

    def add_row(self, radar, recording):
        self.calls.append((radar.name, recording))

    def end_row(self, log):
        self.calls.append(("log", log))

    def finish(self):
        self.calls.append(("finish", None))


def test_a_writer_of_one_s_own_is_given_all_there_is():
    radars = (RadarSettings(frame_period=0.01), RadarSettings(preset="position2go", frame_period=0.02))
    rig = VirtualRig(world_of(radars=radars, scan=ScanSettings(size=(0.1, 0.1), row_spacing=0.1)), frames=points)
    writer = Kept()
    assert isinstance(writer, ScanWriter)
    assert record_scan(rig.arm, rig.radars, None, rig.plan, writer) == Path("nowhere")
    assert [name for name, _ in writer.calls] == ["recording", *["77_ghz", "24_ghz", "log"] * 2, "finish"]
    rows = [given for name, given in writer.calls if name == "77_ghz"]
    assert np.concatenate([row.times for row in rows]) == pytest.approx(rig.truth("77_ghz").times)
    # The log is the arm's own, in the base frame.
    first, log = (given for name, given in writer.calls if name == "log")
    assert 0 < log.times[0] - first.times[-1] < 0.01
    assert log.positions[-1] == pytest.approx(rig.plan.rows[-1][1].position, abs=1e-6)
    with pytest.raises(InputError, match="the radars are called"):
        record_scan(rig.arm, rig.radars[:1] * 2, None, rig.plan, writer)


SMALL = {"radars": (RadarSettings(frame_period=0.02),), "scan": ScanSettings(size=(0.1, 0.1), row_spacing=0.1)}


def small_scan(folder, **settings):
    world = world_of(**SMALL)
    rig = VirtualRig(world, frames=points)
    out = experiment_folder(folder, "058_golf_ball", (0, 0, 0), 1, "los")
    writer = PublishedWriter(out, info=experiment_info(world), **settings)
    return writer, lambda: record_scan(rig.arm, rig.radars, None, rig.plan, writer)


def test_an_experiment_appears_when_all_of_it_is_there(tmp_path):
    """And another run begins anew where one was killed before; what that left goes."""

    def fail():
        assert not writer.path.exists()
        assert [path.name for path in tmp_path.rglob(CAPTURE_NAME)] == [CAPTURE_NAME]
        raise KeyError

    writer, scan = small_scan(tmp_path, last=fail)
    with pytest.raises(KeyError):
        scan()
    assert not writer.path.exists()
    remains = writer.path.parent.with_name(".exp1.0123abcd.part")
    (remains / "rows").mkdir(parents=True)
    writer, scan = small_scan(tmp_path)
    scan()
    raw = radar_folder(writer.path, "77_ghz", processed=False)
    assert load(raw / CAPTURE_NAME).metadata["source"].startswith("058_golf_ball/robot_collected/0_0_0/exp1/los/")
    assert not remains.exists()
    assert sorted(p.name for p in writer.path.parent.iterdir()) == ["experiment_info.json", "los"]


def test_what_a_run_leaves_that_is_killed_at_its_very_end_goes(tmp_path):
    """The experiment is there and is not recorded again: nothing else would ever remove its copies."""
    writer, scan = small_scan(tmp_path)
    scan()
    experiment = writer.path.parent
    left = [experiment.with_name(".exp1.0123abcd.part"), writer.unfinished]
    for folder in left:
        (folder / "rows").mkdir(parents=True)
    (experiment / ".millisight.lock").write_text("1\n")
    with pytest.raises(InputError, match="already exists; remove it, or record under another number"):
        small_scan(tmp_path)[1]()
    assert not any(folder.exists() for folder in left)
    assert sorted(p.name for p in experiment.iterdir()) == ["experiment_info.json", "los"]


def test_two_runs_of_one_experiment_are_refused(tmp_path):
    def again():
        with pytest.raises(FileError, match=r"another run \(process \d+\) is using .*exp1; wait for it, or stop it"):
            small_scan(tmp_path)[1]()

    writer, scan = small_scan(tmp_path, hdf5=False, last=again)
    scan()
    assert writer.path.exists()


CUT = """
import os, sys
from pathlib import Path
from millisight.rig._rows import Spool
frames = Spool(Path(sys.argv[1]), [(1, 1.0, "")])[0].frames
os.truncate(sys.argv[1] + "/0.npy", 0)
print(frames.all())
"""


def test_a_row_cut_short_after_it_was_read_kills_no_process(tmp_path):
    """Mapped, its frames are no more: the process ends by a signal."""
    np.save(tmp_path / "0.npy", np.ones((64, 1, 4, 64), np.complex64))
    done = subprocess.run([sys.executable, "-c", CUT, str(tmp_path)], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr
    np.save(tmp_path / "0.npy", np.ones((64, 1, 4, 64), np.complex64))
    os.truncate(tmp_path / "0.npy", 1000)
    with pytest.raises(DamagedFileError, match=r"0\.npy"):
        Spool(tmp_path, [(1, 1.0, "")])[0]
