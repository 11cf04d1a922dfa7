"""All devices of a virtual world behind real sockets and serial lines, and the rig file that leads to them."""

import os
import socket
from pathlib import Path

import numpy as np

from millisight.core import check_known, check_own, make_folder, write_text
from millisight.core.errors import InputError
from millisight.data import Trajectory, Waveform
from millisight.io.mito import BASE_ORIGIN
from millisight.rig.emulators._arm import MovingArm
from millisight.rig.emulators._board import BoardEmulator
from millisight.rig.emulators._clock import RealTime
from millisight.rig.emulators._dca1000 import Dca1000Emulator, PacketFaults
from millisight.rig.emulators._grbl import GrblEmulator
from millisight.rig.emulators._ti_cli import TiCliEmulator
from millisight.rig.emulators._ur import UrController, UrEmulator
from millisight.rig.virtual import Frames, RadarSettings, World, WorldLayout, build_layout, optics_of

_ARM, _RADAR = 1, 3  # keys of the devices' random numbers, as the virtual rig has them
_MARGIN = 0.05  # of the workspace around the aperture [m]
_ADC_START = 6e-6  # [s]
_HOST = "127.0.0.1"
_MARK = "The emulators of a virtual world"
ARMS = ("ur", "grbl")


class EmulatedLab:
    """An arm or a gantry, and a TI radar with a DCA1000, which share a virtual world and real time.

    Clock errors of the world are told by the network: what the radar's clock is ahead by, its packets come late; what
    the arm's is ahead by, its poses. Drifts are left out.

    Parameters
    ----------
    world : World, with the 77 GHz radar alone
    layout : `build_layout(world)`, where it has been built already
    frames : what a perfect radar would measure; None: the optics of the layout
    faults : of the radar's network
    arm : "ur" or "grbl"

    Attributes
    ----------
    robot, card, board : the emulators; of the arm a `UrEmulator` or a `GrblEmulator`

    Raises
    ------
    InputError
        A radar of the world has no emulator.
    UnknownNameError
        There is no such arm.
    """

    def __init__(
        self,
        world: World,
        *,
        layout: WorldLayout | None = None,
        frames: Frames | None = None,
        faults: PacketFaults | None = None,
        arm: str = "ur",
    ):
        check_known("emulated arm", arm, ARMS)
        names = [radar.name for radar in world.radars]
        if names != ["77_ghz"]:
            raise InputError(
                f"the world has the radars {names}; expected 77_ghz alone: the Position2Go's protocol is not public, "
                "so that it has no emulator"
            )
        self._world, (self._settings,) = world, world.radars
        perfect = frames or optics_of(layout or build_layout(world))
        ahead = self._settings.clock_offset - world.arm.clock_offset
        clock = RealTime()
        first = world.scan.rows(BASE_ORIGIN)[0][0].position
        moved = MovingArm(world.arm, clock, world.rng(_ARM), first)
        self.robot: UrEmulator | GrblEmulator
        if arm == "ur":
            self.robot = UrEmulator(UrController(moved, clock, latency=max(0.0, -ahead)))
        else:
            self.robot = GrblEmulator(moved, clock, origin=first, acceleration=world.arm.acceleration)
        # Once before it counts: what has to be compiled would keep the board's first answer back for seconds.
        perfect(self._settings, Trajectory(times=np.zeros(1), positions=(first - BASE_ORIGIN)[None]))
        self._first = first
        self._data_port = _free_port()
        self.card: Dca1000Emulator = Dca1000Emulator(data_port=self._data_port, faults=faults)
        mount = np.array(self._settings.mount)
        self._radar = BoardEmulator(
            self._settings, clock, lambda times: moved.true_positions(times) - BASE_ORIGIN + mount, perfect,
            self.card.samples, world.rng(_RADAR, 77), latency=max(0.0, ahead),
        )  # fmt: skip
        self.board: TiCliEmulator = TiCliEmulator(
            self._radar.start, self._radar.stop, profile=profile_of(self._settings)
        )

    def __enter__(self) -> "EmulatedLab":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, folder: str | os.PathLike[str], name: str = "rig.toml") -> Path:
        """Write the rig file, and the radar's profile beside it; returns the rig file's path.

        Raises
        ------
        FileError
            Also where one of both is there already and was not written by an emulator.
        """
        rig, profile = files_of_lab(Path(folder) / name)
        make_folder(folder)
        write_text(profile, f"% {_MARK}\n{profile_of(self._settings)}")
        write_text(rig, self._rig_file(profile.name))
        return rig

    def close(self) -> None:
        """End all emulators."""
        self._radar.stop()
        for emulator in (self.board, self.card, self.robot):
            emulator.close()

    def _arm_keys(self) -> str:
        robot = self.robot
        if isinstance(robot, GrblEmulator):
            return f'driver = "grbl"\nserial = "{robot.port}"\norigin = {[float(x) for x in self._first]}'
        return (
            f'driver = "ur"\naddress = "{_HOST}"\nrtde_port = {robot.rtde_port}\nscript_port = {robot.script_port}\n'
            f"rate = {self._world.arm.log_rate}"
        )

    def _rig_file(self, profile: str) -> str:
        world, settings = self._world, self._settings
        places = np.stack([pose.position for row in world.scan.rows(BASE_ORIGIN) for pose in row])
        lower, upper = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
        name = world.objects[0].object if world.objects else None
        return f"""\
# {_MARK}: they live as long as the program that wrote this file.
object = "000_{name or "scan"}"
sight = "{world.sight}"
background = "{world.support.kind}"

[scan]
size = {list(world.scan.size)}
corner = {list(world.scan.corner)}
row_spacing = {world.scan.row_spacing}
pattern = "{world.scan.pattern}"

[arm]
{self._arm_keys()}

[arm.limits]
lower = {[round(float(x), 6) for x in lower]}
upper = {[round(float(x), 6) for x in upper]}
speed = {world.arm.speed}
acceleration = {world.arm.acceleration}
settle = {world.arm.settle}

[[radars]]
driver = "dca1000"
name = "{settings.name}"
preset = "{settings.preset}"
rx_axis = "{settings.rx_axis or "x"}"
mount = {[float(x) for x in settings.mount or (0.0, 0.0, 0.0)]}
profile = "{profile}"
serial = "{self.board.port}"
address = "{_HOST}"
command_port = {self.card.port}
host = "{_HOST}"
host_port = 0
data_port = {self._data_port}
"""


def files_of_lab(rig: Path) -> tuple[Path, Path]:
    """A rig file that may be written, and the profile that is to lie beside it: NAME.toml and NAME.cfg.

    Raises
    ------
    FileError
        One of both is there already and is somebody else's.
    InputError
        The rig file's name does not end in .toml.
    """
    if rig.suffix != ".toml":
        raise InputError(f"the rig file is {rig.name}; expected a name that ends in .toml")
    files = rig, rig.with_suffix(".cfg")
    for path in files:
        check_own(path, _MARK)
    return files


def profile_of(settings: RadarSettings) -> str:
    """The .cfg file of a world's radar: one transmitter, its waveform, its pace."""
    waveform: Waveform = settings.radar.waveform
    start = (waveform.start_frequency - waveform.slope * _ADC_START) * 1e-9
    end = (_ADC_START + waveform.samples_per_chirp / waveform.sample_rate) * 1e6 + 1
    receivers = (1 << len(settings.radar.array.rx_positions)) - 1
    return f"""\
dfeDataOutputMode 1
channelCfg {receivers} 1 0
adcCfg 2 1
adcbufCfg -1 0 0 0 1
profileCfg 0 {start!r} 7 {_ADC_START * 1e6:g} {end:g} 0 0 {waveform.slope * 1e-12!r} 1 {waveform.samples_per_chirp} \
{waveform.sample_rate * 1e-3:g} 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 {settings.chirps} 1 {1000 * float(settings.frame_period or 0):.9g} 1 0
lvdsStreamCfg -1 0 1 0
"""


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind((_HOST, 0))
        return there.getsockname()[1]
