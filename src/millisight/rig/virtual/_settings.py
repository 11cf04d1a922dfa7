"""How well the devices of a virtual rig work: clocks, antennas, arm, radars and camera, as records that a world file
holds. There is one true time, which waits jump over; devices tell it by their own clocks.
"""

from typing import NamedTuple, Protocol

import numpy as np

from millisight.core import (
    check_known,
    checked_integer,
    checked_number,
    checked_numbers,
    checked_record,
    put,
    record,
)
from millisight.core.errors import InputError
from millisight.data import Radar
from millisight.rig import CameraMount

_MOST_NOISE = 1e3


@record
class Antenna:
    """An antenna that looks along -z of the radar frame; transmitters and receivers have the same.

    Attributes
    ----------
    beamwidth_x_deg, beamwidth_y_deg : full width at half power in the planes of z with x and with y [degrees]

    Its power pattern is cos^p α_x cos^q α_y, with α_x and α_y the angles off -z as seen along y and along x, so a
    power of a cosine in either plane (Balanis, "Antenna Theory" (2016), section 2.5, has such patterns), nothing
    behind, and 1 in front.
    """

    beamwidth_x_deg: float
    beamwidth_y_deg: float

    def __post_init__(self) -> None:
        for name in ("beamwidth_x_deg", "beamwidth_y_deg"):
            width = checked_number(getattr(self, name), name=name, unit="degrees", above=0)
            if width >= 180:
                raise InputError(
                    f"{name} is {width:g} degrees; expected under 180; leave the antenna out for an isotropic one"
                )
            put(self, **{name: width})

    @property
    def exponents(self) -> np.ndarray:
        """(2,) p and q: half the power at half the beamwidth."""
        halves = np.radians([self.beamwidth_x_deg, self.beamwidth_y_deg]) / 2
        return np.log(0.5) / np.log(np.cos(halves))

    def amplitude(self, directions: np.ndarray) -> np.ndarray:
        """(...) of the wave sent along `directions` (..., 3) of any length in the radar frame, 1 in front."""
        ahead = -directions[..., 2]
        power = np.ones(ahead.shape)
        for axis, exponent in enumerate(self.exponents):
            across = np.hypot(ahead, directions[..., axis])
            power *= np.where(ahead > 0, ahead / np.where(across > 0, across, 1.0), 0.0) ** exponent
        return np.sqrt(power)

    @property
    def gain(self) -> float:
        """In front, over an isotropic antenna's, without losses: 4 pi over the integral of the power pattern."""
        nodes, weights = np.polynomial.legendre.leggauss(200)
        cosine = (1 + nodes[:, None]) / 2
        turn = 2 * np.pi * np.arange(200) / 200
        sine = np.sqrt(1 - cosine**2)
        away = np.broadcast_to(-cosine, (200, 200))
        directions = np.stack([sine * np.cos(turn), sine * np.sin(turn), away], axis=-1)
        mean = (weights[:, None] / 2 * self.amplitude(directions) ** 2).sum() / 200
        return float(2 / mean)


EPOCH = 1_700_000_000.0
"""What a right clock shows when a virtual world begins [s]: Unix time, as the published time stamps are."""


class Time(Protocol):
    """What tells the time of a virtual world [s], from 0 on."""

    @property
    def now(self) -> float: ...

    def wait_until(self, time: float) -> None:
        """Return when it is `time` [s] or later."""
        ...


class WorldTime:
    """The world's true time [s], from 0 on. Waiting costs nothing: it moves `now`."""

    def __init__(self) -> None:
        self.now: float = 0.0

    def wait_until(self, time: float) -> None:
        """Let time pass until `time` [s]; a moment in the past is here already."""
        self.now = max(self.now, float(time))


@record
class DeviceClock:
    """A clock that is wrong: it shows EPOCH + offset + (1 + drift) t at the true time t."""

    offset: float = 0.0  # what it is ahead by when the world begins [s]
    drift: float = 0.0  # what it gains [s/s]; 50e-6 is 50 ppm

    def __post_init__(self) -> None:
        put(
            self,
            offset=checked_number(self.offset, name="clock_offset", unit="s"),
            drift=checked_number(self.drift, name="clock_drift", unit="s/s", above=-0.5),
        )

    def reading(self, times: np.ndarray) -> np.ndarray:
        """What it shows [s] at the true times (n,) [s]."""
        return EPOCH + self.offset + (1 + self.drift) * np.asarray(times)

    def true_times(self, readings: np.ndarray) -> np.ndarray:
        """The true times [s] at which it shows the readings (n,) [s]."""
        return (np.asarray(readings) - EPOCH - self.offset) / (1 + self.drift)


@record
class ArmSettings:
    """Motion and logging errors of the arm.

    Attributes
    ----------
    speed : on the straight [m/s]
    acceleration : largest [m/s²]
    settle : how long it stands before and after each sweep [s]
    path_error : rms distance of the true path from the planned one [m]
    correlation_length : over which the path error changes, along the path [m]
    encoder_noise : rms distance of a logged position from the true one [m]
    log_rate : poses a second, by its own clock [Hz]
    clock_offset, clock_drift : of its clock, see DeviceClock [s], [s/s]
    """

    speed: float = 0.1
    acceleration: float = 2.0
    settle: float = 0.1
    path_error: float = 0.3e-3
    correlation_length: float = 0.05
    encoder_noise: float = 0.03e-3
    log_rate: float = 125.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0

    def __post_init__(self) -> None:
        above = {"speed": "m/s", "acceleration": "m/s²", "settle": "s", "correlation_length": "m", "log_rate": "Hz"}
        checked = {n: checked_number(getattr(self, n), name=n, unit=unit, above=0) for n, unit in above.items()}
        for name in ("path_error", "encoder_noise"):
            checked[name] = checked_number(getattr(self, name), name=name, unit="m", minimum=0)
        clock = DeviceClock(offset=self.clock_offset, drift=self.clock_drift)
        put(self, **checked, clock_offset=clock.offset, clock_drift=clock.drift)

    @property
    def clock(self) -> DeviceClock:
        return DeviceClock(offset=self.clock_offset, drift=self.clock_drift)

    def top_speed(self, length: float) -> float:
        """What a sweep of `length` [m] reaches [m/s]; a short one never reaches full speed."""
        # A ramp to speed v lasts pi v / (2 a) and covers half of v times that.
        return min(self.speed, np.sqrt(2 * self.acceleration * length / np.pi))

    def duration(self, length: float) -> float:
        """How long a sweep of `length` [m] takes [s], without settling."""
        speed = self.top_speed(length)
        return np.pi * speed / (2 * self.acceleration) + length / speed if length else 0.0


class _Published(NamedTuple):
    """Of the published set-up; see RadarSettings for the fields.

    The 24 GHz transmitter is 10 cm along y, as its image grid lies. Beamwidths are the boards' own as far as we recall
    their guides.
    """

    name: str
    frame_period: float
    chirps: int
    mount: tuple[float, float, float]
    beamwidth_deg: tuple[float, float]


_LONGEST_PERIOD = 3600.0  # [s]
_PUBLISHED = {
    "iwr1443": _Published("77_ghz", 0.003, 1, (0.0, 0.0, 0.0), (56.0, 28.0)),
    "position2go": _Published("24_ghz", 0.1, 16, (0.0, 0.10, 0.0), (76.0, 19.0)),
}


@record
class RadarSettings:
    """A radar and its errors.

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
        check_known("radar of the rig", self.preset, _PUBLISHED)
        published = _PUBLISHED[self.preset]
        for name, default in (*published._asdict().items(), ("path_offset", self._nominal.path_offset)):
            if name != "name" and getattr(self, name) is None:
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
        period = checked_number(self.frame_period or 0, name="frame_period", unit="s", above=0)
        if period > _LONGEST_PERIOD:
            raise InputError(f"frame_period is {period:g} s; expected {_LONGEST_PERIOD:g} s at most")
        clock = DeviceClock(offset=self.clock_offset, drift=self.clock_drift)
        put(
            self,
            frame_period=period,
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
    def name(self) -> str:
        """What the published layout calls it: "77_ghz" or "24_ghz"."""
        return _PUBLISHED[self.preset].name

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


@record
class CameraSettings:
    """Position of the camera.

    Attributes
    ----------
    at : where the arm holds the radar frame for the picture [m]; None: so that the camera looks at the aperture's
        middle from 10 cm above it
    offset : hand-eye: the camera in the radar frame [m]
    tilt_deg : hand-eye: how far it is turned from looking straight down [degrees]
    depth_noise : of the stereo pair's own, 1 as of a RealSense D415, 0 for none
    holes : whether depth is missing on shiny and clear surfaces, and where one eye is covered
    """

    at: tuple[float, float, float] | None = None
    offset: tuple[float, float, float] = (0.0, 0.07, 0.02)
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depth_noise: float = 1.0
    holes: bool = True

    def __post_init__(self) -> None:
        put(
            self,
            at=None if self.at is None else checked_numbers(self.at, name="at", count=3, unit="m"),
            offset=checked_numbers(self.offset, name="offset", count=3, unit="m"),
            tilt_deg=checked_numbers(self.tilt_deg, name="tilt_deg", count=3, unit="deg"),
            depth_noise=checked_number(self.depth_noise, name="depth_noise", minimum=0),
            holes=checked_record(self.holes, bool, name="holes"),
        )
        if self.depth_noise > _MOST_NOISE:
            raise InputError(f"depth_noise is {self.depth_noise:g}; expected at most {_MOST_NOISE:g}")

    def pose(self, radar_frame: np.ndarray) -> np.ndarray:
        """(4, 4) camera frame to radar frame of the world, with the arm at `radar_frame` (3,) [m]."""
        return CameraMount(np.add(radar_frame, self.offset), np.array(self.tilt_deg)).pose
