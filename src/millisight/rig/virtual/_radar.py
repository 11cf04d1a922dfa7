"""The virtual radar: frames of what lies before it, with all that stands between an echo and a file.

An echo gets the front end's path offset, the transmitter's leakage, phase noise and thermal noise, is rounded by the
converter, and some of its packets get lost. Levels are relative to a reference: the echo of a target of 0.01 m² (a
metal sphere of 11 cm) at 0.3 m, whose amplitude in the units of `optics.echoes` is `REFERENCE`.
"""

from collections.abc import Callable

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_integer
from millisight.core.errors import InputError
from millisight.data import PHASE_SIGN, Trajectory
from millisight.rig import Recording
from millisight.rig.virtual._settings import RadarSettings, WorldTime

REFERENCE = 0.1 / np.sqrt(4 * np.pi) / 0.3**2
"""sqrt(0.01 m² / 4 pi) / (0.3 m)² [1/m]"""

PACKET = 1456
"""Bytes of samples in one packet of a DCA1000: protocols of its recorder, 1466 with its counters."""

_BYTES = 4  # of a sample of one receiver: int16 I and Q
_PHASE_PATH = 0.6  # path at which phase_noise_deg holds [m]
_FULL = 32767


Frames = Callable[[RadarSettings, Trajectory], np.ndarray]
"""Echoes of the world: radar, poses of its transmitter in the radar frame -> (P, T, R, N) complex64."""


class VirtualRadar:
    """A radar of a virtual rig: a `RadarDevice`.

    `where(times)` are true positions (n, 3) [m] at true times (n,) [s]; `frames` what it would measure if perfect.
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
        self.name = settings.name
        self.frame_period = float(settings.frame_period or 0)
        self.mount = np.array(settings.mount)
        self._time, self._where, self._frames, self._rng = time, where, frames, rng
        self._running: tuple[float, int] | None = None
        self._taken: list[np.ndarray] = []

    def start(self, frames: int) -> None:
        if self._running is not None:
            raise InputError(f"the {self.name} radar is recording; stop it before it is started again")
        count = checked_integer(frames, name="frames")
        self._running = float(self.settings.clock.reading(np.array(self._time.now))), count

    def stop(self) -> Recording:
        if self._running is None:
            raise InputError(f"the {self.name} radar is not recording; start it first")
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
            raise InputError(f"the {self.name} radar has recorded nothing; start and stop it first")
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
    """What is kept of perfect `echoes` (F, 1, R, N): (F, C, R, N) whole numbers complex64, and (F,) what is lost."""
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
    if settings.name == "24_ghz":
        lost = rng.random(frames) < settings.lost_packets
        samples[lost] = 0
        return lost
    step = PACKET // (_BYTES * receivers)
    total = frames * chirps * per_chirp
    gone = np.repeat(rng.random(-(-total // step)) < settings.lost_packets, step)[:total]
    gone = gone.reshape(frames, chirps, per_chirp)
    samples[np.broadcast_to(gone[:, :, None], samples.shape)] = 0
    return np.asarray(gone.any(axis=(1, 2)))
