"""The virtual radar: frames of what lies before it, with all that stands between an echo and a file.

An echo gets the front end's path offset, the transmitter's leakage, phase noise and thermal noise, is rounded by the
converter, and some of its packets get lost. Levels are relative to a reference: the echo of a target of 0.01 m² (a
metal sphere of 11 cm) at 0.3 m, whose amplitude in the units of `optics.echoes` is `REFERENCE`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from millisight.capture.capture import PHASE_SIGN
from millisight.capture.radar import Radar
from millisight.capture.trajectory import Trajectory
from millisight.constants import SPEED_OF_LIGHT
from millisight.errors import InputError, UnknownNameError
from millisight.records import checked_integer, checked_number, checked_numbers, put, record
from millisight.rig.protocols import Recording
from millisight.rig.virtual.antenna import Antenna
from millisight.rig.virtual.clocks import DeviceClock, WorldTime

REFERENCE = 0.1 / np.sqrt(4 * np.pi) / 0.3**2
"""sqrt(0.01 m² / 4 pi) / (0.3 m)² [1/m]"""

PACKET = 1456
"""Bytes of samples in one packet of a DCA1000: protocols of its recorder, 1466 with its counters."""

_BYTES = 4  # of a sample of one receiver: int16 I and Q
_PHASE_PATH = 0.6  # path at which phase_noise_deg holds [m]
_FULL = 32767


class _Published(NamedTuple):
    """Of the published set-up; see RadarSettings for the fields.

    The 24 GHz transmitter is 10 cm along y, as its image grid lies. Beamwidths are the boards' own as far as we recall
    their guides.
    """

    folder: str
    frame_period: float
    chirps: int
    mount: tuple[float, float, float]
    beamwidth_deg: tuple[float, float]


_PUBLISHED = {
    "iwr1443": _Published("77_ghz", 0.003, 1, (0.0, 0.0, 0.0), (56.0, 28.0)),
    "position2go": _Published("24_ghz", 0.1, 16, (0.0, 0.10, 0.0), (76.0, 19.0)),
}
Frames = Callable[["RadarSettings", Trajectory], np.ndarray]
"""Echoes of the world: radar, poses of its transmitter in the radar frame -> (P, T, R, N) complex64."""


@record
class RadarSettings:
    """A radar, and how well it works.

    Attributes
    ----------
    preset : "iwr1443" (77 GHz) or "position2go" (24 GHz)
    rx_axis : "x" or "y", along which its receivers lie; None: as the preset
    frame_period : by its own clock [s]; None: as published, 0.003 and 0.1
    chirps : in a frame, each with its own noise; None: as published, 1 and 16; 1: at 24 GHz, where the file repeats it
    mount : its transmitter in the radar frame [m]; None: (0, 0, 0) at 77 GHz, (0, 0.10, 0) at 24 GHz
    path_offset : its true one [m]; None: as the preset
    beamwidth_deg : full widths of the antennas' beams at half power, in the plane of the receivers' row and across it
        [degrees]; None: as the board, 56 and 28 at 77 GHz, 76 and 19 at 24 GHz
    snr_db : of one sample, of the reference echo over thermal noise [dB]; 40 is what 12 dBm, antennas of 10 dBi, 10
        MHz and a noise figure of 15 dB give at 77 GHz
    phase_noise_deg : rms, of an echo of 0.6 m of path; it grows with the path, since transmitter and receiver share
        their oscillator, and is the same for all receivers of a frame [degrees]
    leakage_db : from the transmitter straight into each receiver, over the reference echo [dB]; None: none
    full_scale_db : of the converter, over the reference echo [dB]
    lost_packets : share of packets of 1456 bytes, or at 24 GHz of whole frames, that get lost
    clock_offset, clock_drift : of its clock, see DeviceClock [s], [s/s]
    """

    preset: str = "iwr1443"
    rx_axis: str | None = None
    frame_period: float | None = None
    chirps: int | None = None
    mount: tuple[float, float, float] | None = None
    path_offset: float | None = None
    beamwidth_deg: tuple[float, float] | None = None
    snr_db: float = 40.0
    phase_noise_deg: float = 0.5
    leakage_db: float | None = 0.0
    full_scale_db: float = 40.0
    lost_packets: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    def __post_init__(self) -> None:
        if self.preset not in _PUBLISHED:
            raise UnknownNameError("radar of the rig", self.preset, _PUBLISHED)
        published = _PUBLISHED[self.preset]
        for name, default in (*published._asdict().items(), ("path_offset", self._nominal.path_offset)):
            if name != "folder" and getattr(self, name) is None:
                put(self, **{name: default})
        for name in ("snr_db", "leakage_db", "full_scale_db"):
            value = getattr(self, name)
            if value is not None and not abs(checked_number(value, name=name, unit="dB")) <= 200:
                raise InputError(f"{name} is {value:g} dB; expected between -200 and 200 dB")
        chirps = checked_integer(self.chirps, name="chirps")
        if chirps not in (1, published.chirps):
            raise InputError(f"chirps is {chirps}; expected {published.chirps}, as the published files hold, or 1")
        lost = checked_number(self.lost_packets, name="lost_packets", minimum=0)
        if lost > 1:
            raise InputError(f"lost_packets is {lost:g}; expected a share from 0 to 1")
        clock = DeviceClock(offset=self.clock_offset, drift=self.clock_drift)
        put(
            self,
            frame_period=checked_number(self.frame_period or 0, name="frame_period", unit="s", above=0),
            chirps=chirps,
            mount=checked_numbers(self.mount, name="mount", count=3, unit="m"),
            path_offset=checked_number(self.path_offset or 0, name="path_offset", unit="m"),
            beamwidth_deg=checked_numbers(self.beamwidth_deg, name="beamwidth_deg", count=2, unit="deg", above=0),
            phase_noise_deg=checked_number(self.phase_noise_deg, name="phase_noise_deg", unit="deg", minimum=0),
            lost_packets=lost,
            clock_offset=clock.offset,
            clock_drift=clock.drift,
        )

    @property
    def folder(self) -> str:
        """Of its files in the published layout."""
        return _PUBLISHED[self.preset].folder

    @property
    def radar(self) -> Radar:
        """What it is, with its true path offset."""
        nominal = self._nominal
        offset = float(self.path_offset or 0)
        return Radar(name=nominal.name, waveform=nominal.waveform, array=nominal.array, path_offset=offset)

    @property
    def _nominal(self) -> Radar:
        return Radar.preset(self.preset, rx_axis=self.rx_axis)

    @property
    def antenna(self) -> Antenna:
        """Its antennas' pattern."""
        along, across = self.beamwidth_deg or (90.0, 90.0)
        row = np.ptp(self.radar.array.rx_positions, axis=0)
        widths = (along, across) if row[0] > row[1] else (across, along)
        return Antenna(beamwidth_x_deg=widths[0], beamwidth_y_deg=widths[1])

    @property
    def clock(self) -> DeviceClock:
        return DeviceClock(offset=self.clock_offset, drift=self.clock_drift)


class VirtualRadar:
    """A radar of a virtual rig: a `RadarDevice`.

    Parameters
    ----------
    settings : RadarSettings
    time : the world's
    where : true positions (n, 3) of the radar frame [m], at true times (n,) [s]
    frames : what it would measure if it were perfect
    rng : draws noise and losses
    """

    def __init__(
        self,
        settings: RadarSettings,
        time: WorldTime,
        where: Callable[[np.ndarray], np.ndarray],
        frames: Frames,
        rng: np.random.Generator,
    ):
        self.settings = settings
        self.radar = settings.radar
        self.folder = settings.folder
        self.frame_period = float(settings.frame_period or 0)
        self.mount = np.array(settings.mount)
        self._time, self._where, self._frames, self._rng = time, where, frames, rng
        self._running: tuple[float, int] | None = None
        self._taken: list[np.ndarray] = []

    def start(self, frames: int) -> None:
        if self._running is not None:
            raise InputError(f"the {self.folder} radar is recording; stop it before it is started again")
        count = checked_integer(frames, name="frames")
        self._running = float(self.settings.clock.reading(np.array(self._time.now))), count

    def stop(self) -> Recording:
        if self._running is None:
            raise InputError(f"the {self.folder} radar is not recording; start it first")
        (first, count), self._running = self._running, None
        times = self.settings.clock.true_times(first + self.frame_period * np.arange(count + 1))
        self._time.wait_until(times[-1])
        times = times[:-1]
        self._taken.append(times)
        (rng,) = self._rng.spawn(1)
        samples, lost = digitised(self._perfect(times), self.settings, rng)
        return Recording(samples=samples, first_time=first, period=self.frame_period, lost=lost)

    @property
    def frame_times(self) -> np.ndarray:
        """True times of all frames that it took [s]."""
        if not self._taken:
            raise InputError(f"the {self.folder} radar has recorded nothing; start and stop it first")
        return np.concatenate(self._taken)

    def _perfect(self, times: np.ndarray) -> np.ndarray:
        """(F, 1, R, N) complex64 echoes at true times (F,) [s], of the sign inside millisight."""
        # While the arm stands, frame after frame is the same: it is computed once.
        positions, same = np.unique(self._positions(times), axis=0, return_inverse=True)
        frames = self._frames(self.settings, Trajectory(times=np.arange(len(positions)), positions=positions))
        return frames[same.ravel()]

    def _positions(self, times: np.ndarray) -> np.ndarray:
        return self._where(times) + self.mount


def digitised(echoes: np.ndarray, settings: RadarSettings, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """What the recorder keeps of perfect frames.

    Parameters
    ----------
    echoes : (F, 1, R, N) complex, of the sign inside millisight, path offset and all
    settings : RadarSettings
    rng : Generator

    Returns
    -------
    samples : (F, C, R, N) complex64, whole numbers
    lost : (F,) bool
    """
    phases, thermal, losses = rng.spawn(3)
    frames = with_phase_noise(echoes[:, 0] + leakage(settings), settings, phases)
    shape = (len(frames), int(settings.chirps or 1), *frames.shape[1:])
    sigma = REFERENCE / 10 ** (settings.snr_db / 20)
    noise = thermal.standard_normal((*shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
    scale = _FULL / (REFERENCE * 10 ** (settings.full_scale_db / 20))
    counts = scale * (frames[:, None] + np.float32(sigma / np.sqrt(2)) * noise)
    whole = np.clip(np.rint(counts.astype(np.complex64).view(np.float32)), -_FULL, _FULL).view(np.complex64)
    return whole, _lose(whole, settings, losses)


def leakage(settings: RadarSettings) -> np.ndarray:
    """(R, N) what goes from the transmitter straight into each receiver, a path no longer than they are apart."""
    radar = settings.radar
    if settings.leakage_db is None:
        return np.zeros((len(radar.array.rx_positions), radar.waveform.samples_per_chirp), dtype=np.complex64)
    paths = np.linalg.norm(radar.array.rx_positions - radar.array.tx_positions, axis=1) + radar.path_offset
    cycles = paths[:, None] * radar.waveform.frequencies / SPEED_OF_LIGHT
    amplitude = REFERENCE * 10 ** (settings.leakage_db / 20)
    return (amplitude * np.exp(1j * PHASE_SIGN * 2 * np.pi * cycles)).astype(np.complex64)


def with_phase_noise(frames: np.ndarray, settings: RadarSettings, rng: np.random.Generator) -> np.ndarray:
    """(F, R, N) frames whose oscillator has jittered: what comes from the path d is turned by g d / 0.6 m.

    g is normal, one a frame. A jitter of the frequency by df does just that: it turns an echo by 2 pi df d / c. The
    turn is given to every bin of the range profile.
    """
    if not settings.phase_noise_deg:
        return frames
    waveform = settings.radar.waveform
    samples = waveform.samples_per_chirp
    # The profile over signed paths: small negative ones hold side lobes of what is near.
    paths = PHASE_SIGN * np.fft.fftfreq(samples) * SPEED_OF_LIGHT / waveform.frequency_step
    turns = np.radians(settings.phase_noise_deg) * rng.standard_normal(len(frames)) / _PHASE_PATH
    profile = np.fft.fft(frames, axis=-1) * np.exp(1j * turns[:, None, None] * paths)
    return np.fft.ifft(profile, axis=-1).astype(np.complex64)


def _lose(samples: np.ndarray, settings: RadarSettings, rng: np.random.Generator) -> np.ndarray:
    """Make zeros of what got lost; returns (F,) bool, the frames that it touched.

    A DCA1000 sends all receivers of a sample together, packet after packet whatever the frames, and its recorder
    fills what does not arrive with zeros. Of the 24 GHz radar, whole frames get lost.
    """
    frames, chirps, receivers, per_chirp = samples.shape
    lost = np.zeros(frames, dtype=bool)
    if not settings.lost_packets:
        return lost
    if settings.folder == "24_ghz":
        lost = rng.random(frames) < settings.lost_packets
        samples[lost] = 0
        return lost
    step = PACKET // (_BYTES * receivers)
    total = frames * chirps * per_chirp
    gone = np.repeat(rng.random(-(-total // step)) < settings.lost_packets, step)[:total]
    gone = gone.reshape(frames, chirps, per_chirp)
    samples[np.broadcast_to(gone[:, :, None], samples.shape)] = 0
    return np.asarray(gone.any(axis=(1, 2)))
