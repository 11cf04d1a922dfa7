"""A TI radar in software: when its frames are started it takes them in real time, and gives their samples to a card."""

import threading
from collections.abc import Callable

import numpy as np

from millisight.data import Trajectory
from millisight.io.raw import pack
from millisight.rig.emulators._clock import RealTime
from millisight.rig.virtual import Frames, RadarSettings, digitised

_BLOCK = 8  # frames taken together
_STILL = 1e-6  # [m]


class BoardEmulator:
    """A radar of a virtual world, as `VirtualRadar` is, whose samples leave it as bytes.

    Parameters
    ----------
    settings : the radar of the world
    time : the world's
    where : true positions (n, 3) of its transmitter in the radar frame [m] at true times (n,) [s]
    frames : what it would measure if perfect
    send : called with bytes, and whether they are a row's last
    rng : of noise
    latency : how late its frames leave it [s]: what the recorder's clock is ahead by
    """

    def __init__(
        self,
        settings: RadarSettings,
        time: RealTime,
        where: Callable[[np.ndarray], np.ndarray],
        frames: Frames,
        send: Callable[..., None],
        rng: np.random.Generator,
        *,
        latency: float = 0.0,
    ):
        self._settings, self._time, self._where, self._frames, self._send = settings, time, where, frames, send
        self._rng, self._latency = rng, latency
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    def start(self, frames: int) -> None:
        """Take `frames` frames from now on, which is when the first one is ready to be sent.

        Its arrival is all that the recorder knows of time, and must not be late by what its echoes take to compute.
        """
        self.stop()
        self._stopping.clear()
        place = self._where(np.array([self._time.now]))
        first = self._taken(self._perfect(place))
        self._thread = threading.Thread(
            target=self._run, args=(self._time.now, frames, [(place, first[0])]), name="millisight radar", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Take no more."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _perfect(self, places: np.ndarray) -> np.ndarray:
        """(n, 1, R, N) echoes at places (n, 3); while the arm stands, frame after frame is the same."""
        positions, same = np.unique(places, axis=0, return_inverse=True)
        perfect = self._frames(self._settings, Trajectory(times=np.arange(len(positions)), positions=positions))
        return perfect[same.ravel()]

    def _taken(self, perfect: np.ndarray) -> list[bytes]:
        """What leaves the board of perfect frames, one by one; the device's phase sign is the other one."""
        (rng,) = self._rng.spawn(1)
        samples, _ = digitised(perfect, self._settings, rng)
        return [pack(np.conj(frame), "four-lane").tobytes() for frame in samples]

    def _run(self, began: float, frames: int, ready: list[tuple[np.ndarray, bytes]]) -> None:
        """Send every frame at its time; echoes are computed ahead, and again where the arm went elsewhere meanwhile."""
        period = float(self._settings.frame_period or 0)
        for number in range(frames):
            time = began + number * period
            if not ready:
                times = time + period * np.arange(min(_BLOCK, frames - number))
                places = self._where(times)
                ready = list(zip(places[:, None], self._taken(self._perfect(places)), strict=True))
            if self._stopping.wait(max(0.0, time + self._latency - self._time.now)):
                return
            place, data = ready.pop(0)
            here = self._where(np.array([time]))
            if np.abs(here - place).max() > _STILL:
                ready, (data,) = [], self._taken(self._perfect(here))
            self._send(data, last=number == frames - 1)
