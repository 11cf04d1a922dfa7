"""`millisight rig`, and `millisight collect` with a rig file: against emulators in this process."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

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


def test_options_of_worlds_are_refused(emulated):
    done = run("collect", "rig.toml", "--rig", "virtual")
    assert isinstance(done.exception, InputError)
    assert "--rig, --truth and --plot are for worlds" in str(done.exception)
    done = run("collect", "rig.toml", "--rig", "ur5e")
    assert isinstance(done.exception, UnknownNameError)
    assert "Known: virtual. Real devices are named in a rig file" in str(done.exception)


def test_emulate_writes_a_rig_file_that_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    WORLD.to_toml(tmp_path / "world.toml")
    done = run("rig", "emulate", "world.toml", "-o", "rig.toml", "--loss", "0.001", "--seconds", "0")
    assert done.exit_code == 0, done.output
    assert "wrote rig.toml; the emulators run until 0 s have passed" in done.output
    assert run("collect", "rig.toml", "--dry-run").exit_code == 0
    assert isinstance(run("rig", "emulate", "world.toml", "--loss", "2").exception, InputError)


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
