"""A TI radar with a DCA1000: the driver against the emulator, over real UDP and a pseudo-terminal."""

import socket
import time

import numpy as np
import pytest

from helpers.profiles import PROFILE
from millisight.core.errors import DeviceError, FormatError, InputError
from millisight.io.raw import pack
from millisight.rig import Device, RadarDevice
from millisight.rig.drivers import DRIVERS, Dca1000, Dca1000Settings, studio_script
from millisight.rig.emulators import Dca1000Emulator, PacketFaults, TiCliEmulator

SAMPLES = 128


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        return there.getsockname()[1]


class Bench:
    """A card and a board that sends frames of known random samples."""

    def __init__(self, folder, faults=None, **settings):
        self.data_port = free_port()
        self.card = Dca1000Emulator(data_port=self.data_port, faults=faults)
        self.frames, self.board_runs = None, True
        self.board = TiCliEmulator(self._start, lambda: None)
        self.folder = folder
        (folder / "profile.cfg").write_text(PROFILE)
        self.settings = Dca1000Settings(
            **{
                "profile": "profile.cfg", "serial": self.board.port, "address": "127.0.0.1",
                "command_port": self.card.port, "host": "127.0.0.1", "host_port": 0, "data_port": self.data_port,
                "silence": 0.5, "scratch": str(folder), "folder": str(folder), **settings,
            }
        )  # fmt: skip
        self.radar = Dca1000(self.settings)

    def _start(self, frames):
        rng = np.random.default_rng(frames)
        parts = rng.integers(-2000, 2000, (frames, 1, 4, SAMPLES, 2)).astype(np.float32)
        self.frames = parts.view(np.complex64)[..., 0] if self.board_runs else self.frames
        if self.board_runs:
            self.card.samples(pack(np.conj(self.frames), "two-lane").tobytes(), last=True)

    def close(self):
        self.radar.close()
        self.card.close()
        self.board.close()


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(*args, **settings):
        made.append(Bench(tmp_path, *args, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_a_row_arrives_as_it_was_sent(bench, tmp_path):
    one = bench()
    assert isinstance(one.radar, RadarDevice)
    assert isinstance(one.radar, Device)
    one.radar.open()
    one.radar.open()  # which is nothing new
    for count in (20, 20, 7):
        began = time.time()
        one.radar.start(count)
        recording = one.radar.stop()
        assert np.array_equal(recording.samples, one.frames)
        assert recording.samples.shape == (count, 1, 4, SAMPLES)
        # All came at once, the last frame earliest for its turn.
        assert began - 0.005 * count <= recording.first_time <= time.time()
        assert recording.period == 0.005
        assert not recording.lost.any()
    assert [path.name for path in tmp_path.iterdir()] == ["profile.cfg"]
    # Sent once for each number of frames, with that number.
    assert [line.split()[4] for line in one.board.lines if line.startswith("frameCfg")] == ["20", "7"]
    assert [line for line in one.board.lines if line.startswith("sensorStart")] == [
        "sensorStart", "sensorStart 0", "sensorStart",
    ]  # fmt: skip
    assert one.card.told[:4] == ["SYSTEM_CONNECT", "RESET_FPGA", "CONFIG_FPGA_GEN", "CONFIG_PACKET_DATA"]
    assert one.card.told[4:] == ["RECORD_START", "RECORD_STOP"] * 3


def test_lost_packets_are_lost_frames_and_late_ones_are_not(bench):
    one = bench(PacketFaults(loss=0.02, disorder=0.1, duplicates=0.05, seed=3))
    one.radar.open()
    one.radar.start(100)
    recording = one.radar.stop()
    intact = (recording.samples == one.frames).all(axis=(1, 2, 3))
    assert 2 <= recording.lost.sum() <= 20
    assert np.array_equal(intact, ~recording.lost)
    # Which packets never came is known: frame by frame it is told.
    per_frame = 4 * 4 * SAMPLES
    lost = {place // per_frame for n in one.card._sender.lost for place in (1456 * n, min(1456 * n + 1455, 204799))}
    assert set(np.flatnonzero(recording.lost)) == lost


def test_the_end_of_a_row_may_be_lost(bench):
    one = bench(PacketFaults(silent_after=139))
    one.radar.open()
    one.radar.start(100)  # 140.7 packets
    began = time.monotonic()
    recording = one.radar.stop()
    assert time.monotonic() - began < 10
    assert list(np.flatnonzero(recording.lost)) == [98, 99]
    assert np.array_equal(recording.samples[:98], one.frames[:98])


def watch_for(radar, seconds):
    """Ask again and again, as a scan does."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        radar.watch()
        time.sleep(0.02)


def test_a_radar_that_falls_silent_is_told_of_in_time(bench, tmp_path):
    one = bench(PacketFaults(silent_after=50))
    one.radar.open()
    one.radar.start(100)
    one.card.alarm()
    one.radar.watch()
    with pytest.raises(DeviceError, match=r"the 77_ghz radar has sent nothing for 0.\d s, after 35 of 100 frames \(no"):
        watch_for(one.radar, 10)
    with pytest.raises(DeviceError, match="has sent nothing"):
        one.radar.stop()
    # What was begun is given up, and the next row is a new one.
    assert [path.name for path in tmp_path.iterdir()] == ["profile.cfg"]
    one.card.faults = PacketFaults()
    one.radar.close()
    one.radar.open()
    one.radar.start(10)
    assert not one.radar.stop().lost.any()


def test_a_radar_that_never_sends(bench):
    one = bench()
    one.board_runs = False
    one.radar.open()
    one.radar.start(10)
    with pytest.raises(DeviceError, match="after 0 of 10 frames; check that the radar runs"):
        one.radar.stop()


def test_what_each_device_says_when_asked(bench):
    one = bench()
    one.radar.open()
    lines = one.radar.check()
    assert lines[0] == "FPGA version 2.9"
    assert lines[1] == "Platform : emulator; mmWave SDK Version : 03.06.00.00"
    assert lines[2].endswith(" GHz, 4 receivers, path offset 150 mm")
    assert lines[3] == "2048 bytes a frame, one every 5 ms: 3 Mbit/s"
    one.card.alarm(1 << 9 | 1 << 4)
    time.sleep(0.05)
    assert one.radar.check()[-1].startswith("warning: its LVDS buffer is full")


def test_a_card_that_does_not_answer(bench):
    one = bench()
    one.card.silent = True
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"127.0.0.1:\d+ does not answer SYSTEM_CONNECT; check its power"):
        one.radar.open()
    assert time.monotonic() - began < 5
    one.card.silent = False
    one.card.refused = {"CONFIG_FPGA_GEN"}
    with pytest.raises(DeviceError, match=r"refuses CONFIG_FPGA_GEN \(status 1\); switch it off and on"):
        one.radar.open()
    one.card.refused = set()
    one.radar.open()


def test_nobody_at_the_address(bench, tmp_path):
    one = bench()
    one.card.close()
    with pytest.raises(DeviceError, match="does not answer SYSTEM_CONNECT"):
        one.radar.open()
    one.settings = Dca1000Settings(start_file="go", frame_period=0.01, host="203.0.113.7", host_port=0)
    with pytest.raises(
        DeviceError, match=r"cannot use 203.0.113.7:0 .*: Cannot assign requested address; give this co"
    ):
        Dca1000(one.settings).open()


def test_the_data_port_in_use(bench):
    one = bench()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", one.data_port))
        with pytest.raises(DeviceError, match=r"cannot receive at 127.0.0.1:\d+: Address already in use"):
            one.radar.open()


def test_a_board_that_refuses_or_is_silent(bench):
    one = bench()
    one.radar.open()
    one.board.refused = {"profileCfg"}
    with pytest.raises(DeviceError, match=r"refuses 'profileCfg 0 77.*': Error -1; correct profile.cfg for this demo"):
        one.radar.start(3)
    one.board.refused, one.board.silent = set(), True
    with pytest.raises(DeviceError, match="does not answer 'sensorStop' .*press its reset button"):
        one.radar.start(3)


def test_a_serial_line_that_is_not_there(bench):
    one = bench(serial="/dev/ttyNOWHERE")
    with pytest.raises(DeviceError, match="cannot open the serial line /dev/ttyNOWHERE: .* lines that are there: "):
        one.radar.open()


def test_mmwave_studio_is_asked_by_a_file(bench, tmp_path):
    one = bench(serial=None, start_file="go.txt")
    one.radar.open()
    with pytest.raises(DeviceError, match=r"mmWave Studio did not take .*go.txt within 3 s; run the script"):
        one.radar.start(3)
    assert not (tmp_path / "go.txt").exists()
    assert one.radar.check()[1].startswith("started by mmWave Studio through ")


def test_a_file_of_somebody_else_s_is_no_question_for_mmwave_studio(bench, tmp_path):
    """It was overwritten, and `rig check` removed it."""
    (tmp_path / "go.txt").write_text("my thesis")
    one = bench(serial=None, start_file="go.txt")
    one.radar.open()
    with pytest.raises(DeviceError, match=r"go.txt was not made by millisight and would be overwritten"):
        one.radar.start(3)
    one.radar.check()
    one.radar.close()
    assert (tmp_path / "go.txt").read_text() == "my thesis"


def test_the_script_for_mmwave_studio_has_the_profile_s_numbers(tmp_path):
    path = tmp_path / "profile.cfg"
    path.write_text(PROFILE)
    script = studio_script(path, frames=2000, start_file="Z:\\scan\\go.txt")
    assert 'local start_file = "Z:/scan/go.txt"' in script
    assert "ar1.ChanNAdcConfig(1, 0, 0, 1, 1, 1, 1, 2, 1, 0)" in script
    assert "ar1.ProfileConfig(0, 77, 7, 6, 63, 0, 0, 0, 0, 0, 0, 58.6116, 1, 128, 10000, 0, 0, 30)" in script
    assert "ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, 1, 0, 0)" in script
    assert "ar1.FrameConfig(0, 0, 2000, 1, 5, 0, 0, 1)" in script
    ramp = next(line for line in PROFILE.splitlines() if line.startswith("profileCfg"))
    path.write_text(PROFILE.replace(ramp, ramp.rsplit(" ", 1)[0] + ' os.execute("reboot")'))
    with pytest.raises(FormatError, match=r"profile.cfg: 'os.execute\(.*' stands where a number is expected"):
        studio_script(path, frames=2000, start_file="go")
    path.write_text(PROFILE.replace(ramp, f"{ramp}\n{ramp.replace('profileCfg 0', 'profileCfg 1')}"))
    with pytest.raises(DeviceError, match="has 2 profiles; expected 1"):
        studio_script(path, frames=2000, start_file="go")
    path.write_text(PROFILE.replace("frameCfg 0 0", "chirpCfg 1 1 0 0 0 0 0 1\nframeCfg 0 1"))
    with pytest.raises(DeviceError, match="has 2 chirps in a loop; expected 1"):
        studio_script(path, frames=2000, start_file="go")


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({}, InputError, "expected either serial = the board's command line, or start_file"),
        ({"serial": "a", "start_file": "b"}, InputError, "expected either serial"),
        ({"serial": "a"}, InputError, "profile is missing"),
        ({"start_file": "a"}, InputError, "expected profile = a .cfg file, or frame_period"),
        ({"start_file": "a", "frame_period": 0.1, "phase_sign": 2}, InputError, "phase_sign is 2; expected 1 or -1"),
        ({"start_file": "a", "frame_period": 0.1, "silence": 6}, InputError, "expected 5 to 500, and up to 5 s"),
    ],
)
def test_settings_that_cannot_be_right(settings, error, words):
    with pytest.raises(error, match=words):
        Dca1000Settings(**settings)


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("channelCfg 15 1", "channelCfg 7 1", InputError, "1 transmitters and 3 receivers; expected 1 and 4"),
        ("lvdsStreamCfg -1 0 1", "lvdsStreamCfg -1 1 1", InputError, "a stream of samples only"),
        ("frameCfg 0 0 1 100 5", "frameCfg 0 0 1 100 0", InputError, "frame period 0 s; expected more than 0"),
        ("profileCfg", "profilCfg", FormatError, "has no profileCfg"),
    ],
)
def test_profiles_that_cannot_be_recorded(tmp_path, old, new, error, words):
    assert old in PROFILE
    (tmp_path / "profile.cfg").write_text(PROFILE.replace(old, new))
    with pytest.raises(error, match=words):
        Dca1000(Dca1000Settings(serial="x", profile="profile.cfg", folder=str(tmp_path)))


def test_it_is_a_driver():
    assert DRIVERS["dca1000"].kind == "radar"
