"""A TI radar with a DCA1000 card: what it is set up to, and its driver."""

import tempfile
import time
from contextlib import suppress
from dataclasses import field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from millisight.core import checked_integer, checked_number, checked_numbers, printable, put, record
from millisight.core.errors import DamagedFileError, DeviceError, InputError
from millisight.data import AntennaArray, Radar
from millisight.io.raw import DATA_PORT, TiConfig, check_order, frames_touched, read_ti_config, unpack, values_per_chirp
from millisight.rig import Recording
from millisight.rig._dca1000_wire import COMMAND_PORT, Code, fpga_settings, packet_settings, version
from millisight.rig.drivers._dca1000_control import CommandPort
from millisight.rig.drivers._driver import DRIVERS, Driver
from millisight.rig.drivers._packet_file import PacketFile
from millisight.rig.drivers._packet_receiver import PacketReceiver
from millisight.rig.drivers._studio import StartFile
from millisight.rig.drivers._ti_cli import TiCommandLine

_TAIL = 0.5  # how long after its end a recording may stay quiet before what is missing is lost [s]
_SMALL_BUFFER = 4 << 20  # bytes, of the system's buffer for packets
_MOST_LOST = 0.02  # of a recording's end, with which it still counts as whole


@record
class Dca1000Settings:
    """Keys of a radar with `driver = "dca1000"`.

    Attributes
    ----------
    name : of the radar; "77_ghz" in the published layout
    preset : the radar whose antennas and path offset it has; its waveform is the profile's, if there is one
    rx_axis : "x" or "y", along which its receivers lie; None: as the preset
    receivers : in place of the preset's, where each lies from the transmitter [m]
    path_offset : in place of the preset's [m]
    mount : its transmitter in the radar frame [m]
    profile : the .cfg file that the radar is set up with
    serial, baud : the board's command line, to which the profile is sent
    start_file : in place of `serial`, the file by which mmWave Studio is asked for frames
    frame_period, chirps : without a profile [s]
    address, command_port : of the card
    host, host_port, data_port : of this computer, where the card sends answers and data
    order, sample_swap : of the samples, see `read_dca1000`; from the profile where it says them
    phase_sign : of the samples, +1 as TI's radars have it, or -1
    packet_delay_us : between two packets [us], 5 to 500
    silence : how long nothing may come before the radar counts as failed [s]
    scratch : folder for the row that is being recorded; None: the system's for temporary files
    """

    name: str = "77_ghz"
    preset: str = "iwr1443"
    rx_axis: str | None = None
    receivers: tuple[tuple[float, float, float], ...] = ()
    path_offset: float | None = None
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    profile: str | None = None
    serial: str | None = None
    baud: int = 115200
    start_file: str | None = None
    frame_period: float | None = None
    chirps: int = 1
    address: str = "192.168.33.180"
    command_port: int = COMMAND_PORT
    host: str = "192.168.33.30"
    host_port: int = COMMAND_PORT
    data_port: int = DATA_PORT
    order: str = "four-lane"
    sample_swap: bool = False
    phase_sign: int = 1
    packet_delay_us: float = 25.0
    silence: float = 2.0
    scratch: str | None = None
    folder: str = field(default=".", metadata={"key": None})

    def __post_init__(self) -> None:
        _ = self.antennas
        check_order(self.order)
        if (self.serial is None) == (self.start_file is None):
            raise InputError(
                "expected either serial = the board's command line, or start_file = the file that mmWave Studio's "
                "script waits for"
            )
        if self.serial is not None and self.profile is None:
            raise InputError("profile is missing; expected the .cfg file to send to the board at serial")
        if self.profile is None and self.frame_period is None:
            raise InputError("expected profile = a .cfg file, or frame_period in seconds")
        if self.phase_sign not in (1, -1):
            raise InputError(f"phase_sign is {self.phase_sign}; expected 1 or -1")
        delay = checked_number(self.packet_delay_us, name="packet_delay_us", unit="us")
        silence = checked_number(self.silence, name="silence", unit="s", above=0)
        if not 5 <= delay <= 500 or silence > 5:
            raise InputError(f"packet_delay_us is {delay:g}, silence {silence:g} s; expected 5 to 500, and up to 5 s")
        if self.frame_period is not None:
            checked_number(self.frame_period, name="frame_period", unit="s", above=0)
        ports = ("command_port", "host_port", "data_port")
        put(
            self,
            mount=checked_numbers(self.mount, name="mount", count=3, unit="m"),
            chirps=checked_integer(self.chirps, name="chirps"),
            packet_delay_us=delay,
            silence=silence,
            **{name: checked_integer(getattr(self, name), name=name, minimum=0) for name in ports},
        )

    @property
    def antennas(self) -> Radar:
        """The radar, but for the profile's waveform."""
        radar = Radar.preset(self.preset, rx_axis=self.rx_axis)
        if self.receivers:
            if self.rx_axis is not None:
                raise InputError("receivers and rx_axis both say where the receivers lie; leave one of them out")
            array = AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=np.array(self.receivers))
            radar = replace(radar, array=array)
        return radar if self.path_offset is None else replace(radar, path_offset=self.path_offset)

    def path(self, name: str) -> Path:
        """A file of the rig file, as seen from here."""
        return Path(self.folder, name)


class _Starter(Protocol):
    """What makes the radar take frames."""

    def start(self, frames: int) -> None: ...
    def stop(self) -> None: ...
    def version(self) -> str: ...
    def close(self) -> None: ...


class Dca1000:
    """A TI radar whose samples a DCA1000 sends: a `RadarDevice` and a `Device`.

    Every row is one recording of the card, whose counters begin anew. Its packets go to a file as they come.
    """

    def __init__(self, settings: Dca1000Settings):
        self.settings: Dca1000Settings = settings
        self.name: str = settings.name
        self.mount: np.ndarray = np.array(settings.mount)
        preset = settings.antennas
        config = None if settings.profile is None else read_ti_config(settings.path(settings.profile))
        receivers = len(preset.array.rx_positions)
        if config is not None:
            _check_config(config, receivers, str(settings.profile))
        self.radar: Radar = preset if config is None else replace(preset, waveform=config.waveform)
        self.frame_period: float = float(settings.frame_period or 0) if config is None else config.frame_period
        self._order = settings.order if config is None else config.order or settings.order
        self._swap = settings.sample_swap or (config is not None and config.sample_swap)
        self._chirps = settings.chirps if config is None else config.chirps_per_frame
        samples = self.radar.waveform.samples_per_chirp
        self._shape = (self._chirps, receivers, samples)
        self._frame_bytes = 2 * self._chirps * values_per_chirp(self._order, receivers=receivers, samples=samples)
        self._control: CommandPort | None = None
        self._receiver: PacketReceiver | None = None
        self._starter: _Starter | None = None
        self._frames = 0
        self._started = self._until = 0.0

    def open(self) -> None:
        if self._control is not None:
            return
        settings = self.settings
        try:
            self._control = CommandPort(settings.address, settings.command_port, settings.host, settings.host_port)
            self._control.order(Code.SYSTEM_CONNECT)
            self._control.order(Code.RESET_FPGA)
            self._control.order(Code.CONFIG_FPGA_GEN, fpga_settings(lanes=4 if self._order == "four-lane" else 2))
            self._control.order(Code.CONFIG_PACKET_DATA, packet_settings(delay_us=settings.packet_delay_us))
            self._receiver = PacketReceiver(settings.host, settings.data_port)
            self._starter = self._make_starter()
        except BaseException:
            self.close()
            raise

    def check(self) -> list[str]:
        control, receiver, starter = self._opened()
        status = control.command(Code.READ_FPGA_VERSION)
        megabits = 8e-6 * self._frame_bytes / self.frame_period
        first, last = self.radar.waveform.frequencies[[0, -1]] / 1e9
        lines = [
            f"FPGA version {version(status)}",
            starter.version(),
            f"{first:.2f} to {last:.2f} GHz, {len(self.radar.array.rx_positions)} receivers, path offset "
            f"{1e3 * self.radar.path_offset:g} mm",
            f"{self._frame_bytes} bytes a frame, one every {1000 * self.frame_period:g} ms: {megabits:.0f} Mbit/s",
        ]
        if receiver.buffer < _SMALL_BUFFER:
            lines.append(
                f"warning: the system keeps {receiver.buffer >> 10} KiB of packets, and loses them when it is busy; as "
                "root: sysctl -w net.core.rmem_max=33554432"
            )
        return lines + [f"warning: {alarm}" for alarm in control.alarms()]

    def watch(self) -> None:
        if not self._frames or self._receiver is None:
            return
        self._receiver.check()
        self._check_silence()

    def start(self, frames: int) -> None:
        control, receiver, starter = self._opened()
        if self._frames:
            raise InputError(f"the {self.name} radar is recording; stop it before it is started again")
        count = checked_integer(frames, name="frames")
        with tempfile.NamedTemporaryFile(
            prefix="millisight-", suffix=".bin", dir=self.settings.scratch, delete=False
        ) as made:
            self._path = Path(made.name)
        self._file = PacketFile(self._path, size=count * self._frame_bytes)
        try:
            control.alarms()
            receiver.begin(self._file, frame_bytes=self._frame_bytes, period=self.frame_period)
            self._frames = count
            control.order(Code.RECORD_START)
            starter.start(count)
        except BaseException:
            self._end_recording()
            self._abandon()
            raise
        self._started = time.monotonic()
        self._until = self._started + count * self.frame_period

    def stop(self) -> Recording:
        control, receiver, starter = self._opened()
        if not self._frames:
            raise InputError(f"the {self.name} radar is not recording; start it first")
        try:
            while not self._file.complete:
                receiver.check()
                self._check_silence()
                if time.monotonic() > self._until + _TAIL and receiver.quiet > _TAIL and self._nearly_whole:
                    break
                time.sleep(0.005)
            receiver.end()
            control.order(Code.RECORD_STOP)
            starter.stop()
            return self._recording(receiver)
        finally:
            self._abandon()

    def close(self) -> None:
        if self._frames:
            self._abandon()
        self._end_recording()
        starter, control, receiver = self._starter, self._control, self._receiver
        self._starter = self._control = self._receiver = None
        try:
            if starter is not None:
                starter.close()
        finally:
            if receiver is not None:
                receiver.close()
            if control is not None:
                control.close()

    @property
    def _nearly_whole(self) -> bool:
        """Whether no more is missing at the end than gets lost."""
        return self._file.size - self._file.end <= max(self._frame_bytes, _MOST_LOST * self._file.size)

    def _check_silence(self) -> None:
        """Raise if the radar ought to send and does not."""
        control, receiver, _ = self._opened()
        quiet = min(receiver.quiet, time.monotonic() - self._started)
        if self._file.complete or quiet < self.settings.silence:
            return
        if self._nearly_whole and time.monotonic() > self._until:
            return
        got = self._file.end // self._frame_bytes
        told = "; ".join(control.alarms())
        raise DeviceError(
            f"the {self.name} radar has sent nothing for {quiet:.1f} s, after {got} of {self._frames} frames"
            f"{f' ({told})' if told else ''}; check that the radar runs, and the cables from radar to card and from "
            "card to this computer"
        )

    def _recording(self, receiver: PacketReceiver) -> Recording:
        gaps = self._file.close()
        chirps, receivers, samples = self._shape
        frames = np.empty((self._frames, *self._shape), dtype=np.complex64)
        with open(self._path, "rb") as file:  # not mapped: a file cut while it is mapped kills the process
            for i in range(self._frames):
                counts = np.fromfile(file, dtype="<i2", count=self._frame_bytes // 2)
                if len(counts) < self._frame_bytes // 2:
                    raise DamagedFileError(
                        f"{printable(self._path)} was cut short: it ends within frame {i} of {self._frames}; record "
                        "the row again"
                    )
                frames[i] = unpack(
                    counts.reshape(chirps, -1), self._order, receivers=receivers, samples=samples,
                    sample_swap=self._swap,
                )  # fmt: skip
        if self.settings.phase_sign == 1:  # of the device; inside it is the other
            np.conj(frames, out=frames)
        lost = frames_touched(gaps, frame_bytes=self._frame_bytes, frames=self._frames)
        return Recording(samples=frames, first_time=receiver.first_time, period=self.frame_period, lost=lost)

    def _end_recording(self) -> None:
        """Tell the card to record no more, whether it hears or not: one that records would refuse the next start."""
        if self._control is not None:
            with suppress(DeviceError):
                self._control.command(Code.RECORD_STOP, tries=1)

    def _abandon(self) -> None:
        """Leave no recording open."""
        self._frames = 0
        if self._receiver is not None:
            self._receiver.end()
        self._file.close()
        self._path.unlink(missing_ok=True)

    def _make_starter(self) -> _Starter:
        settings = self.settings
        if settings.serial is None:
            return StartFile(settings.path(str(settings.start_file)))
        return TiCommandLine(settings.serial, settings.baud, settings.path(str(settings.profile)))

    def _opened(self) -> tuple[CommandPort, PacketReceiver, _Starter]:
        if self._control is None or self._receiver is None or self._starter is None:
            raise DeviceError(f"the {self.name} radar is not open; call open first")
        return self._control, self._receiver, self._starter


def _check_config(config: TiConfig, receivers: int, name: str) -> None:
    """Raise where a profile gives what cannot be recorded, or another radar than the preset."""
    if not config.complex_samples or not config.plain_stream:
        raise InputError(
            f"{name}: expected complex samples (adcCfg 2 1 or 2 2) and a stream of samples only (lvdsStreamCfg -1 0 1 "
            "0)"
        )
    if config.receivers != receivers or config.transmitters != 1:
        raise InputError(
            f"{name} switches on {config.transmitters} transmitters and {config.receivers} receivers; expected 1 and "
            f"{receivers}, as preset or receivers have"
        )
    if not config.frame_period > 0:
        raise InputError(f"{name} has the frame period {config.frame_period:g} s; expected more than 0")


DRIVERS.add("dca1000", Driver(kind="radar", settings=Dca1000Settings, make=Dca1000))
