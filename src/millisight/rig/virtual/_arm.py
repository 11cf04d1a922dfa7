"""The virtual arm: it moves as arms do, strays from its plan, and logs where it is by its own clock."""

from collections.abc import Callable

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Trajectory
from millisight.rig import NOT_TURNED, ArmPose
from millisight.rig.virtual._settings import ArmSettings, Time

# Waves whose sum is the path error: so many that it is as good as Gaussian.
_WAVES = 256
# Times looked at together while the path error is summed: 30 MB.
_BLOCK = 5000


class _Profile:
    """The way from standing to standing: the speed rises and falls as a raised cosine, so that nothing jerks."""

    def __init__(self, length: float, settings: ArmSettings):
        self.length = length
        self.speed = settings.top_speed(length)
        self.ramp = np.pi * self.speed / (2 * settings.acceleration)
        self.duration = settings.duration(length)

    def distance(self, times: np.ndarray) -> np.ndarray:
        """(n,) the way covered [m] at `times` (n,) since it began [s]; before and after, it stands."""
        if not self.length:
            return np.zeros_like(times)
        times = np.clip(times, 0.0, self.duration)
        # The second half mirrors the first.
        since = np.minimum(times, self.duration - times)
        rising = self.speed / 2 * (since - self.ramp / np.pi * np.sin(np.pi * since / self.ramp))
        covered = np.where(since < self.ramp, rising, self.speed * (since - self.ramp / 2))
        return np.where(times <= self.duration / 2, covered, self.length - covered)

    def until(self, time: float) -> "_Cut":
        """The same way, ended at once at `time` [s] since it began."""
        return _Cut(self, time)


class _Cut(_Profile):
    """A way that was given up."""

    def __init__(self, whole: _Profile, time: float):
        self.duration = min(max(time, 0.0), whole.duration)
        self.length = float(whole.distance(np.array([self.duration]))[0])
        self._whole = whole

    def distance(self, times: np.ndarray) -> np.ndarray:
        return self._whole.distance(np.clip(times, 0.0, self.duration))


class _Stray:
    """The path error: a smooth Gaussian process over the distance travelled, of covariance exp(-s² / (2 l²)).

    A sum of waves with normal wave numbers of deviation 1 / l has that covariance, and can be asked anywhere.
    """

    def __init__(self, rms: float, length: float, rng: np.random.Generator):
        self._amplitude = rms / np.sqrt(3) * np.sqrt(2 / _WAVES)
        self._numbers = rng.standard_normal((3, _WAVES)) / length
        self._phases = rng.uniform(0, 2 * np.pi, (3, _WAVES))

    def at(self, travelled: np.ndarray) -> np.ndarray:
        """(n, 3) [m] after distances (n,) [m]."""
        error = np.zeros((len(travelled), 3))
        for start in range(0, len(travelled) if self._amplitude else 0, _BLOCK):
            some = travelled[start : start + _BLOCK, None, None]
            error[start : start + _BLOCK] = np.cos(some * self._numbers + self._phases).sum(axis=-1)
        return self._amplitude * error


class VirtualArm:
    """The arm of a virtual rig: an `Arm`, and for the virtual radars the truth of where it is."""

    def __init__(self, settings: ArmSettings, time: Time, rng: np.random.Generator):
        self._settings = settings
        self._time = time
        path, encoder = rng.spawn(2)
        self._stray = _Stray(settings.path_error, settings.correlation_length, path)
        self._encoder_seed = int(encoder.integers(2**63))
        self._moves: list[tuple[float, np.ndarray, np.ndarray, _Profile, float]] = []
        self._stands_at = 0.0  # from this time on [s]

    def sweep(self, start: ArmPose, end: ArmPose) -> None:
        for pose in (start, end):
            if not np.allclose(pose.orientation, NOT_TURNED):
                raise InputError(f"the virtual arm keeps the radars level; got the orientation {pose.orientation}")
        self.wait()
        here = self._moves[-1][2] if self._moves else start.position
        if np.linalg.norm(start.position - here) > 1e-6:
            self._move(here, start.position)
            self.wait()
        self._move(start.position, end.position)

    def wait(self, watch: Callable[[], None] | None = None) -> None:
        self._time.wait_until(self._stands_at)

    def stop(self) -> None:
        now = self._time.now
        if now >= self._stands_at:
            return
        began, start, end, profile, travelled = self._moves[-1]
        profile, length = profile.until(now - began), profile.length
        end = start + profile.length / length * (end - start)
        self._moves[-1] = began, start, end, profile, travelled
        self._stands_at = now

    def log(self, since: float | None = None) -> Trajectory:
        settings = self._settings
        first, now = settings.clock.reading(np.array([0.0, self._time.now]))
        readings = first + np.arange(int((now - first) * settings.log_rate) + 1) / settings.log_rate
        # A fresh generator each time: what was logged once is logged for ever.
        noise = np.random.default_rng(self._encoder_seed).standard_normal((len(readings), 3))
        if since is not None:
            readings, noise = readings[readings > since], noise[readings > since]
        positions = self.true_positions(np.clip(settings.clock.true_times(readings), 0.0, self._time.now))
        return Trajectory(times=readings, positions=positions + settings.encoder_noise / np.sqrt(3) * noise)

    def planned_positions(self, times: np.ndarray) -> np.ndarray:
        """(n, 3) where it would be at the true times (n,) [s] if it did not stray, in the base frame [m]."""
        return self._path(times)[0]

    def true_positions(self, times: np.ndarray) -> np.ndarray:
        """(n, 3) where it is at the true times (n,) [s], in the base frame [m]: what processing never sees."""
        planned, travelled = self._path(times)
        return planned + self._stray.at(travelled)

    def _move(self, start: np.ndarray, end: np.ndarray) -> None:
        profile = _Profile(float(np.linalg.norm(end - start)), self._settings)
        travelled = self._moves[-1][4] + self._moves[-1][3].length if self._moves else 0.0
        began = self._time.now + self._settings.settle
        self._moves.append((began, start, end, profile, travelled))
        self._stands_at = began + profile.duration + self._settings.settle

    def _path(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) planned positions [m] and (n,) distances travelled [m]."""
        if not self._moves:
            raise InputError("the arm has not moved yet; call sweep first")
        times = np.asarray(times, dtype=float)
        planned, distances = np.empty((len(times), 3)), np.empty(len(times))
        # Before its move begins the arm stands where the move starts, which is where the one before ended.
        number = np.clip(np.searchsorted([m[0] for m in self._moves], times, side="right") - 1, 0, None)
        for i in np.unique(number):
            began, start, end, profile, travelled = self._moves[i]
            some = number == i
            covered = profile.distance(times[some] - began)
            share = covered / profile.length if profile.length else covered
            planned[some] = start + share[:, None] * (end - start)
            distances[some] = travelled + covered
        return planned, distances
