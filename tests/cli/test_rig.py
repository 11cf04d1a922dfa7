"""`millisight rig`, and `millisight collect` with a rig file: against emulators in this process."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import millisight as ms
from helpers import oracles
from helpers.profiles import PROFILE
from millisight.cli.app import app
from millisight.core.errors import DeviceError, FileError, InputError, UnknownNameError
from millisight.io.mito import read_experiment
from millisight.rig.emulators import EmulatedLab
from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, World

WORLD = World(
    scan=ScanSettings(size=(0.004, 0.02), row_spacing=0.004),
    arm=ArmSettings(speed=0.2, acceleration=20.0, settle=0.02, path_error=0.0, encoder_noise=0.0),
    radars=(RadarSettings(frame_period=0.01),),
)


def one_point(settings, trajectory):
    array, waveform = settings.radar.array, settings.radar.waveform
    places = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    return oracles.point_frames(
        np.array([[0.0, 0.01, -0.25]]), np.ones(1), *places, waveform.frequencies, settings.radar.path_offset
    )


@pytest.fixture
def emulated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with EmulatedLab(WORLD, frames=one_point) as lab:
        lab.write(tmp_path)
        yield lab


def run(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_check_tells_how_each_device_is(emulated):
    done = run("rig", "check", "rig.toml")
    assert done.exit_code == 0, done.output
    assert "scan: 2 rows of 2 cm, 4 mm apart, at 0.2 m/s, about 1 s" in done.output
    assert "arm (ur): ready\n  controller 5.11.0.0, normal" in done.output
    assert "77_ghz (dca1000): ready\n  FPGA version 2.9" in done.output
    emulated.card.silent = True
    emulated.robot.controller.robot_mode = 3
    done = run("rig", "check", "rig.toml")
    assert done.exit_code == 1
    assert "warning: arm (ur): the arm is not ready to move; switch it on" in done.output
    assert "77_ghz (dca1000): not ready" in done.output
    assert re.search(r"failed: 1\n  77_ghz \(dca1000\): the DCA1000 at .* does not answer SYSTEM_CONNECT", done.output)


def test_the_arm_moves_without_radar(emulated):
    done = run("rig", "move", "rig.toml")
    assert done.exit_code == 0, done.output
    assert emulated.robot.controller.arm.place == pytest.approx([0.424, -0.23, 0.23], abs=1e-3)
    assert emulated.card.told == []
    emulated.robot.controller.halt()
    done = run("rig", "move", "rig.toml")
    assert isinstance(done.exception, DeviceError)


@pytest.mark.slow
def test_collect_scans_with_real_devices_and_goes_on(emulated, tmp_path):
    done = run("collect", "rig.toml", "-o", "data", "--dry-run")
    assert done.exit_code == 0, done.output
    assert "77_ghz: " in done.output
    assert not (tmp_path / "data").exists()
    start = emulated._radar.start
    rows = []

    def start_one(frames):
        rows.append(frames)
        if len(rows) == 2:
            emulated.board.silent = True
        start(frames)

    emulated.board._start = start_one
    done = run("collect", "rig.toml", "-o", "data", "--no-hdf5")
    assert isinstance(done.exception, DeviceError)
    assert "1 of 2 rows are kept; run the same command again to go on after them" in done.output
    emulated.board.silent = False
    done = run("collect", "rig.toml", "-o", "data", "--no-hdf5", "--live", "--no-browser")
    assert done.exit_code == 0, done.output
    assert "live image at http://127.0.0.1:" in done.output
    assert re.search(r"77_ghz: images [\d.]+ s behind the arm at most", done.output)
    folder = tmp_path / "data/000_scan/robot_collected/0_0_0/exp1/los"
    assert "wrote data/000_scan/robot_collected/0_0_0/exp1/los" in done.output
    assert len(read_experiment(folder, "77_ghz").rows) == 2
    assert isinstance(run("collect", "rig.toml", "-o", "data").exception, FileError)


OWN = """
layout = "captures"
image = { lower = [-0.02, -0.02, -0.28], upper = [0.02, 0.04, -0.22], spacing = [0.004, 0.004, 0.004] }
"""


@pytest.mark.slow
def test_a_radar_of_any_name_is_written_as_captures(emulated, tmp_path):
    """A board that the published layout has not: its name, its antennas, the voxels of its images."""
    path = tmp_path / "rig.toml"
    told = path.read_text().replace('name = "77_ghz"', 'name = "60_ghz"')
    receivers = [[float(x), 0.0, 0.0] for x in RadarSettings().radar.array.rx_positions[:, 0]]
    told = re.sub(r'rx_axis = "x"', f"receivers = {receivers}\npath_offset = 0.15", told)
    path.write_text(OWN + told)
    done = run("rig", "check", "rig.toml")
    assert "60_ghz (dca1000): ready" in done.output
    assert "77.50 to 80.50 GHz, 4 receivers, path offset 150 mm" in done.output
    emulated.card.silent = True
    assert isinstance(run("collect", "rig.toml", "-o", "data").exception, DeviceError)
    emulated.card.silent = False
    done = run("collect", "rig.toml", "-o", "data", "--live", "--no-browser")
    assert done.exit_code == 0, done.output
    assert "60_ghz: images" in done.output
    assert "wrote data/000_scan.exp1" in done.output
    folder = tmp_path / "data/000_scan.exp1"
    assert sorted(file.name for file in folder.iterdir()) == ["60_ghz.capture.h5", "60_ghz.log.h5"]
    assert not list((tmp_path / "data").glob(".*"))
    capture = ms.load(folder / "60_ghz.capture.h5")
    assert capture.radar.name == "60_ghz"
    assert capture.metadata["object"] == "000_scan"
    done = run("image", "data", "--clock", "report")
    assert done.exit_code == 0, done.output
    assert "clock: " in done.output
    image = ms.load(folder / "000_scan.exp1.60_ghz.image.h5")
    assert image.grid.shape == (11, 16, 16)
    assert np.abs(image.peak - (0.0, 0.01, -0.25)).max() < 0.009
    assert isinstance(run("collect", "rig.toml", "-o", "data").exception, FileError)

    path.write_text(re.sub(r"^image = .*$", "", OWN, flags=re.MULTILINE) + told)
    error = run("collect", "rig.toml", "-o", "more", "--live", "--no-browser").exception
    assert isinstance(error, InputError)
    assert "--live needs the voxels to image; add a table [image]" in str(error)
    path.write_text(told)
    assert isinstance(run("rig", "check", "rig.toml").exception, UnknownNameError)

    for wrong in (told.replace('"60_ghz"', '"../60_ghz"'), told.replace('"000_scan"', '"../000_scan"')):
        path.write_text(OWN + wrong)
        assert isinstance(run("collect", "rig.toml", "-o", "more").exception, InputError)
        assert not (tmp_path / "more").exists() or not [*(tmp_path / "more").rglob("*.*")]
    path.write_text(OWN + told)
    profile = tmp_path / "rig.cfg"
    profile.write_text(re.sub(r"profileCfg 0 77\.", "profileCfg 0 60.", profile.read_text()))
    error = run("collect", "rig.toml", "-o", "more").exception
    assert isinstance(error, DeviceError)
    assert "refuses 'profileCfg 0 60." in str(error)


def test_options_of_worlds_are_refused(emulated):
    done = run("collect", "rig.toml", "--rig", "virtual")
    assert isinstance(done.exception, InputError)
    assert "--rig, --truth and --plot are for worlds" in str(done.exception)
    done = run("collect", "rig.toml", "--rig", "ur5e")
    assert isinstance(done.exception, UnknownNameError)
    assert "Known: virtual. Real devices are named in a rig file" in str(done.exception)


@pytest.fixture
def world(tmp_path, monkeypatch):
    """`world.toml` in the folder where commands are typed."""
    monkeypatch.chdir(tmp_path)
    WORLD.to_toml(tmp_path / "world.toml")


@pytest.mark.usefixtures("world")
def test_emulate_writes_a_rig_file_that_works():
    done = run("rig", "emulate", "world.toml", "-o", "rig.toml", "--loss", "0.001", "--seconds", "0")
    assert done.exit_code == 0, done.output
    assert "wrote rig.toml and rig.cfg; the emulators run until 0 s have passed" in done.output
    assert run("collect", "rig.toml", "--dry-run").exit_code == 0
    assert isinstance(run("rig", "emulate", "world.toml", "--loss", "2").exception, InputError)
    assert isinstance(run("rig", "emulate", "world.toml", "--live").exception, InputError)
    assert isinstance(run("rig", "emulate", "world.toml", "--collect", "d", "--seconds", "1").exception, InputError)


@pytest.mark.slow
@pytest.mark.usefixtures("world")
def test_emulate_keeps_files_of_others(tmp_path):
    for name, own in (("rig.cfg", "rig.toml"), ("mine.toml", "mine.toml")):
        (tmp_path / name).write_text("% my profile")
        refusal = run("rig", "emulate", "world.toml", "-o", own, "--seconds", "0").exception
        assert isinstance(refusal, FileError)
        assert f"{name} was not made by millisight and would be overwritten; choose another name" in str(refusal)
        assert (tmp_path / name).read_text() == "% my profile"
    wrong = run("rig", "emulate", "world.toml", "-o", "both.cfg", "--seconds", "0").exception
    assert isinstance(wrong, InputError)
    assert "both.cfg; expected a name that ends in .toml" in str(wrong)
    for _ in range(2):  # its own are replaced
        assert run("rig", "emulate", "world.toml", "-o", "ours.toml", "--seconds", "0").exit_code == 0


@pytest.mark.slow
@pytest.mark.usefixtures("world")
def test_one_command_emulates_and_scans(tmp_path):
    done = run("rig", "emulate", "world.toml", "--loss", "0.001", "--disorder", "0.01", "--collect", "data")
    assert done.exit_code == 0, done.output
    assert "wrote rig.toml and rig.cfg; the emulators run until the scan has ended" in done.output
    folder = tmp_path / "data/000_scan/robot_collected/0_0_0/exp1/los"
    assert len(read_experiment(folder, "77_ghz").rows) == 2
    assert run("rig", "emulate", "world.toml", "--collect", "data").exit_code == 1  # it is there already


def test_the_script_for_mmwave_studio(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "profile.cfg").write_text(PROFILE)
    (tmp_path / "rig.toml").write_text(
        """
        [scan]
        size = [0.02, 0.1]
        row_spacing = 0.01
        [arm]
        driver = "ur"
        address = "x"
        limits = { lower = [0.4, -0.3, 0.2], upper = [0.5, 0.0, 0.3] }
        [[radars]]
        driver = "dca1000"
        start_file = "go"
        profile = "profile.cfg"
        """
    )
    done = run("rig", "script", "rig.toml", "-o", "radar.lua", "--start-file", "Z:/go")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "radar.lua").read_text()
    assert 'local start_file = "Z:/go"' in text
    # 0.5 s to start, twice 0.2 s to settle, 0.1 m at 0.1 m/s and 0.2 s of ramps, a frame every 5 ms.
    assert "ar1.FrameConfig(0, 0, 421, 1, 5, 0, 0, 1)" in text
