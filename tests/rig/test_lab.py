"""A whole scan through real sockets and a serial line, and what it images to."""

import time
from dataclasses import replace

import numpy as np
import pytest

from helpers import oracles
from millisight.core.errors import DeviceError, FormatError, InputError, UnknownNameError
from millisight.data import ClockCorrection, VoxelGrid
from millisight.imaging import estimate_clock, form_image
from millisight.io.mito import experiment_folder, read_experiment
from millisight.rig import Lab, PublishedWriter, record_scan, scan_info
from millisight.rig.emulators import EmulatedLab, PacketFaults
from millisight.rig.virtual import (
    ArmSettings,
    Carton,
    RadarSettings,
    ScanSettings,
    VirtualRig,
    World,
    WorldObject,
    build_layout,
)

MIDDLE = np.array([0.05, 0.05, -0.25])
POINTS = MIDDLE + np.random.default_rng(0).uniform(-0.015, 0.015, (4, 3)) * [1, 1, 0.3]
REFERENCE = 0.1 / np.sqrt(4 * np.pi) / 0.3**2
GRID = VoxelGrid.regular(MIDDLE - 0.03, MIDDLE + 0.03, (0.002, 0.002, 0.006))


def points(settings, trajectory):
    array, waveform = settings.radar.array, settings.radar.waveform
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    amplitude = REFERENCE * np.array([1.0, 0.6, 0.8, 0.4])
    return oracles.point_frames(POINTS, amplitude, tx, rx, waveform.frequencies, settings.radar.path_offset)


def world_of(rows=7, frame_period=0.006, length=0.1, **settings):
    return World(
        seed=3,
        scan=ScanSettings(size=(0.004 * (rows - 1), length), corner=(0.03, 0.0), row_spacing=0.004),
        arm=ArmSettings(speed=0.2, acceleration=20.0, settle=0.05, path_error=0.2e-3, encoder_noise=0.01e-3),
        radars=(RadarSettings(frame_period=frame_period, snr_db=60.0, phase_noise_deg=0.1, **settings),),
    )


def writer_of(lab, folder, **settings):
    out = experiment_folder(folder, "000_points", (0, 0, 0), 1, "los")
    info = scan_info(lab.radars, "tripod")
    return PublishedWriter(out, info=info, hdf5=False, origin=lab.file.origin, **settings)


def image_of(folder, grid=GRID, clock=None):
    """The image, with the clocks corrected as told or as found, and the correction."""
    scan = read_experiment(folder, "77_ghz")
    clock = clock or estimate_clock(scan.to_capture(), scan.log, grid).clock
    return form_image(scan.to_capture(clock=clock), grid).values, clock


def correlation(a, b):
    return abs(np.vdot(a, b)) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)


@pytest.mark.slow
def test_a_scan_through_sockets_images_to_the_virtual_rig_s(tmp_path):
    """With losses, disorder and a radar that is 20 ms late."""
    faults = PacketFaults(loss=0.001, disorder=0.01, duplicates=0.001, seed=1)
    world = world_of(rows=5, clock_offset=0.02)
    with EmulatedLab(world, frames=points, faults=faults) as emulated:
        lab = Lab.from_toml(emulated.write(tmp_path))
        with lab:
            record_scan(lab.arm, lab.radars, None, lab.plan, writer_of(lab, tmp_path / "real"))
        assert emulated.card.told.count("RECORD_START") == 5
    rig = VirtualRig(world_of(rows=5), frames=points)
    record_scan(rig.arm, rig.radars, None, rig.plan, writer_of(lab, tmp_path / "virtual"))
    real, clock = image_of(experiment_folder(tmp_path / "real", "000_points", (0, 0, 0), 1, "los"))
    virtual, _ = image_of(experiment_folder(tmp_path / "virtual", "000_points", (0, 0, 0), 1, "los"))
    assert -1e3 * clock.offset == pytest.approx(20, abs=3)
    assert correlation(real, virtual) > 0.999


@pytest.mark.slow
def test_a_ball_in_a_carton_is_seen_through_sockets_as_by_the_virtual_rig(tmp_path):
    """Echoes of the rig's own physics, computed while the emulated arm moves; too few rows to find the clocks by."""
    world = replace(
        world_of(frame_period=0.03, clock_offset=0.02),
        scan=ScanSettings(size=(0.06, 0.1), corner=(0.05, 0.05), row_spacing=0.06),
        objects=(WorldObject(object="golf_ball"),),
        carton=Carton(clearance=0.02),
    )
    world = replace(world, arm=replace(world.arm, speed=0.05, path_error=0.05e-3))
    grid = VoxelGrid.regular((0.04, 0.06, -0.33), (0.12, 0.14, -0.25), (0.002, 0.002, 0.01))
    faults = PacketFaults(loss=0.001, disorder=0.01, seed=1)
    layout = build_layout(world)
    with EmulatedLab(world, layout=layout, faults=faults) as emulated:
        lab = Lab.from_toml(emulated.write(tmp_path))
        with lab:
            record_scan(lab.arm, lab.radars, None, lab.plan, writer_of(lab, tmp_path / "real"))
    rig = VirtualRig(replace(world, radars=world_of(frame_period=0.03).radars), layout=layout)
    record_scan(rig.arm, rig.radars, None, rig.plan, writer_of(lab, tmp_path / "virtual"))
    clocks = {"real": ClockCorrection(offset=-0.02), "virtual": ClockCorrection(offset=0.0)}
    real, virtual = (
        image_of(experiment_folder(tmp_path / name, "000_points", (0, 0, 0), 1, "los"), grid, clock)[0]
        for name, clock in clocks.items()
    )
    late, _ = image_of(experiment_folder(tmp_path / "real", "000_points", (0, 0, 0), 1, "los"), grid, clocks["virtual"])
    assert correlation(real, virtual) > 0.999 > correlation(late, virtual)


def silent_radar(emulated):
    emulated.card.faults = PacketFaults(silent_after=40)


def heal_radar(emulated):
    emulated.card.faults = PacketFaults()


def silent_card(emulated):
    emulated.card.silent = True


def heal_card(emulated):
    emulated.card.silent = False


def silent_board(emulated):
    emulated.board.silent = True


def heal_board(emulated):
    emulated.board.silent = False


def silent_robot(emulated):
    emulated.robot.silent = True


def heal_robot(emulated):
    emulated.robot.silent = False


def stopped_robot(emulated):
    emulated.robot.controller.halt()


def free_robot(emulated):
    emulated.robot.controller.safety_mode = 1


def cut_robot(emulated):
    emulated.robot.cut()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("breaks", "heals", "words"),
    [
        (
            silent_radar,
            heal_radar,
            r"the 77_ghz radar has sent nothing for 2.\d s, after \d+ of \d+ frames; check that",
        ),
        (silent_card, heal_card, r"the DCA1000 at 127.0.0.1:\d+ does not answer RECORD_START; check its power"),
        (silent_board, heal_board, "does not answer 'sensorStop' .*press its reset button"),
        (silent_robot, heal_robot, r"the robot at 127.0.0.1:\d+ has said nothing for 1.\d s"),
        (stopped_robot, free_robot, "the arm has stopped: protective stop"),
        (cut_robot, lambda emulated: None, "the connection to the robot at .* broke"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_device_that_fails_in_mid_scan_ends_it_in_time_and_it_goes_on(tmp_path, breaks, heals, words):
    with EmulatedLab(world_of(rows=3, frame_period=0.01, length=0.02), frames=points) as emulated:
        path = emulated.write(tmp_path)
        broken = []

        def report(done, total):
            if not broken:
                breaks(emulated)
                broken.append(time.monotonic())

        lab = Lab.from_toml(path)
        with pytest.raises(DeviceError, match=words), lab:
            record_scan(lab.arm, lab.radars, None, lab.plan, writer_of(lab, tmp_path, keep=lab.plan), progress=report)
        # Silence is told within 5 s, or somewhat later on a busy machine; a row may have been on its way before it.
        assert time.monotonic() - broken[0] < 15 + lab.plan.row_time
        arm = emulated.robot.controller.arm
        time.sleep(0.1)
        place = arm.place
        time.sleep(0.1)
        assert arm.place == pytest.approx(place, abs=1e-9)  # it stands
        heals(emulated)
        counts = []
        with Lab.from_toml(path) as again:
            writer = writer_of(again, tmp_path, keep=again.plan)
            record_scan(again.arm, again.radars, None, again.plan, writer, progress=lambda *count: counts.append(count))
        assert counts == [(2, 3), (3, 3)]
        scan = read_experiment(writer.path, "77_ghz")
        assert len(scan.rows) == 3
        capture = scan.to_capture()
        rows = np.unique(np.round((capture.trajectory.positions[:, 0] - 0.03) / 0.004))
        assert list(rows) == [0, 1, 2]


def test_the_rig_s_devices_are_checked_one_by_one(tmp_path):
    with EmulatedLab(world_of(rows=2), frames=points) as emulated:
        path = emulated.write(tmp_path)
        reports = Lab.from_toml(path).check()
        assert [(report.name, report.error) for report in reports] == [("arm (ur)", None), ("77_ghz (dca1000)", None)]
        assert reports[0].lines[0] == "controller 5.11.0.0, normal"
        emulated.robot.silent = True
        reports = Lab.from_toml(path).check()
        assert "does not answer; is it a robot's RTDE port" in reports[0].error
        assert reports[1].error is None


RIG = """
[scan]
size = [0.02, 0.1]
row_spacing = 0.01
[arm]
driver = "ur"
address = "x"
[arm.limits]
lower = [0.4, -0.3, 0.2]
upper = [0.5, 0.0, 0.3]
[[radars]]
driver = "dca1000"
start_file = "go"
frame_period = 0.01
"""


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('driver = "ur"', 'driver = "dca1000"', FormatError, "rig.toml: arm: dca1000 is a driver of a radar; expected"),
        ('driver = "ur"', 'driver = "urs"', UnknownNameError, "unknown driver 'urs'. Did you mean 'ur'"),
        ('driver = "ur"', "", FormatError, "rig.toml: arm: driver is missing; add one of "),
        ('address = "x"', 'adress = "x"', FormatError, "rig.toml: arm.adress: unknown key 'adress'"),
        ("frame_period", "frames", FormatError, r"rig.toml: radars\[0\].frames: unknown key"),
        ("0.5, 0.0, 0.3", "0.5, -0.2, 0.3", InputError, r"the end of row 1 has y = -0.1300 m .*to -0.2000 m"),
        ("[[radars]]", "[radars]", FormatError, r"rig.toml: radars: expected a list"),
        ("[arm.limits]", "[arm.limit]", FormatError, "rig.toml: arm.limit: unknown key"),
    ],
)
def test_rig_files_that_cannot_be_right(tmp_path, old, new, error, words):
    assert old in RIG
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    assert len(Lab.from_toml(path).plan.rows) == 3
    path.write_text(RIG.replace(old, new))
    with pytest.raises(error, match=words):
        Lab.from_toml(path)


@pytest.mark.slow
def test_a_gantry_scans_as_well(tmp_path):
    world = world_of(rows=3, frame_period=0.01, length=0.04)
    world = replace(world, arm=replace(world.arm, speed=0.05))
    with EmulatedLab(world, frames=points, arm="grbl") as emulated:
        # A row takes 0.8 s: a spline through ten positions a second overshoots where it stops, more the faster it is.
        rig = emulated.write(tmp_path)
        rig.write_text(rig.read_text().replace('driver = "grbl"', 'driver = "grbl"\nrate = 50'))
        lab = Lab.from_toml(rig)
        assert lab.file.arm["rate"] == 50
        assert [report.error for report in lab.check()] == [None, None]
        with lab:
            writer = writer_of(lab, tmp_path)
            record_scan(lab.arm, lab.radars, None, lab.plan, writer)
    capture = read_experiment(writer.path, "77_ghz").to_capture()
    low, high = capture.trajectory.positions.min(axis=0), capture.trajectory.positions.max(axis=0)
    # Along its rows it overshoots more on a machine that is busy with other things.
    off = abs(np.stack([low, high]) - [[0.03, 0, 0], [0.038, 0.04, 0]])
    assert (off < [2e-3, 8e-3, 2e-3]).all(), off
    assert len(capture.trajectory) > 60


def test_a_world_whose_radars_have_no_emulator():
    with pytest.raises(InputError, match="expected 77_ghz alone: the Position2Go's protocol is not public"):
        EmulatedLab(World(radars=(RadarSettings(preset="position2go"),)))
    with pytest.raises(UnknownNameError, match="unknown emulated arm 'kuka'"):
        EmulatedLab(world_of(), arm="kuka")
