"""The fit of a radar's mount to a scan of one reference target.

The frames of a lone target are s = g exp(-i 2 pi f (d + L) / c) in each channel (primer 3): g the channel's gain, L
the path offset, d the way over the target from where the antennas are. First the delays of range profiles are fitted,
where no wavelength can be mistaken for the next; then phases, of those poses alone whose phase the fit so far tells,
until all of them are in. Both go by Gauss-Newton steps with a prior on each of ten unknowns. What all frames share,
such as the antennas' leakage, is found beside.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from millisight.calibration._targets import ReferenceTarget, TargetPaths
from millisight.core import SPEED_OF_LIGHT, rotation_from_quaternion, rotation_from_vector
from millisight.core.errors import InputError
from millisight.data import AntennaArray, Capture

BANDS = 4
"""Parts of the band, each of which gives a phase."""
BLOCKS = 24
"""Runs of neighbouring poses whose errors count as independent."""
_UNKNOWNS = 10  # target (3), offset (3), turn (3), path offset
_OFFSET, _TURN_DEG, _PATH = 0.05, 3.0, 1.0  # how far off a mount may be: standard deviations [m, degrees, m]
_EXACT = 1e-9  # that of a target whose place is exact [m]
_KNOWN = 0.5  # of it may be left: what the scan leaves less sure than that is not determined
_CELLS = 2.0  # range cells either way in which a delay is looked for
_FORETOLD = 1.0  # standard deviation up to which a phase is taken [rad]
_BRIGHT = 0.1  # of the brightest power: below it, the target was hardly in view
_FINEST_DELAY, _FINEST_PHASE = 1e-6, 1e-4  # by which an observation errs at least [m, rad]
_OUTLYING = 3.0  # times the usual error: beyond, an observation weighs less
_STEPS = 30
_LEAST_LEFT = 1e-6  # of what all frames share, that a target is not taken for
_STILL = 1e-3  # a step in standard deviations that ends the fit
_BLOCK_BYTES = 1 << 26
_LEAST = 1e-30


class State(NamedTuple):
    """Where the fit is: the target's place (3,), the antennas' turn (3, 3) and offset (3,), the path offset [m]."""

    place: np.ndarray
    turn: np.ndarray
    offset: np.ndarray
    path_offset: float


class _Observations(NamedTuple):
    """What is too long or too short: `values` (n,), how they change with the unknowns (n, 10), weights and blocks."""

    values: np.ndarray
    slopes: np.ndarray
    weights: np.ndarray
    blocks: np.ndarray


class TargetFit:
    """A fit, as far as it has come.

    Attributes
    ----------
    capture, target : what is fitted
    state : State
    free : (10,) which unknowns are fitted
    spread : (10,) their standard deviations so far [m, rad]
    """

    def __init__(self, capture: Capture, target: ReferenceTarget):
        self.capture: Capture = capture
        self.target: ReferenceTarget = target
        self.state: State = State(target.position, np.eye(3), np.zeros(3), capture.radar.path_offset)
        self.free: np.ndarray = np.ones(_UNKNOWNS, dtype=bool)
        turned, poses = capture.trajectory.orientations, len(capture.trajectory)
        self._turned = np.tile(np.eye(3), (poses, 1, 1)) if turned is None else rotation_from_quaternion(turned)
        self._frequencies = capture.radar.waveform.frequencies
        self._edges = np.linspace(0, len(self._frequencies), BANDS + 1).astype(int)
        bands = [self._frequencies[first:stop].mean() for first, stop in pairwise(self._edges)]
        self._wavenumbers = 2 * np.pi * np.array(bands) / SPEED_OF_LIGHT
        self._cell = SPEED_OF_LIGHT / capture.radar.waveform.bandwidth
        self._blocks = np.arange(poses) * BLOCKS // poses
        sizes = [max(target.uncertainty, _EXACT), _OFFSET, np.radians(_TURN_DEG), _PATH]
        self._prior = np.repeat(sizes, (3, 3, 3, 1))
        self._moved = np.zeros(_UNKNOWNS)  # from the middle of the priors
        self._covariance = np.diag(self._prior**2)
        self._still = self._mean_of(self._frames())

    @property
    def spread(self) -> np.ndarray:
        return np.sqrt(np.maximum(np.diag(self._covariance), 0))

    def find_path_offset(self, search: float) -> None:
        """Take the path offset at which the profiles of all poses together are brightest."""
        shifts = np.arange(-search, search + self._cell / 8, self._cell / 8)
        power = sum((np.abs(profiles) ** 2).sum(axis=(0, 1, 2)) for profiles in self._profiles(shifts))
        found = self.state.path_offset + float(shifts[int(np.argmax(power))])
        self.state = self.state._replace(path_offset=found)

    def fit_delays(self) -> None:
        """Fit the peaks of the range profiles."""
        shifts = np.arange(-_CELLS, _CELLS + 0.01, 0.125) * self._cell
        for _ in range(3):
            found, heights = zip(
                *(_peaks(np.abs(profiles), shifts) for profiles in self._profiles(shifts)), strict=True
            )
            delays, power = np.concatenate(found), np.concatenate(heights) ** 2
            if not power.max() > 0:
                raise InputError("the frames have no signal where the target should be; check its position")
            weights = np.where(power > _BRIGHT * power.max(), power / power.max(), 0)
            self._step(self._observations(delays, self._slopes(), weights), _FINEST_DELAY)

    def fit_phases(self) -> None:
        """Fit the phases in parts of the band, of the poses whose phase is foretold; step by step more of them."""
        most = 0
        for _ in range(_STEPS):
            sums, slopes = self._band_sums(), self._slopes()
            power = (np.abs(sums) ** 2).mean(axis=-1)
            apart = slopes - slopes[np.argmax(power.sum(axis=(1, 2)))]
            spread = np.sqrt(np.maximum(np.einsum("ptri,ij,ptrj->ptr", apart, self._covariance, apart), 0))
            taken = (power > _BRIGHT * power.max()) & (spread * self._wavenumbers.mean() < _FORETOLD)
            weights = np.repeat(np.where(taken, power / power.max(), 0)[..., None], BANDS, axis=-1)
            # A channel's own phase is its gain's; a longer way turns the phase back.
            phases = np.angle(sums * np.conj(_mean(weights, sums / np.maximum(np.abs(sums), _LEAST))))
            steep = slopes[..., None, :] * self._wavenumbers[:, None]
            total = _mean(weights[..., None], steep)
            step = self._step(
                self._observations(_mean(weights, phases) - phases, steep - total, weights), _FINEST_PHASE
            )
            members = int(taken.sum())
            if members <= most and step < _STILL:
                break
            most = max(most, members)

    def find_still(self) -> None:
        """Find what all frames share, by least squares together with an amplitude of the target in each frame.

        With e what they share and t_p = exp(-i 2 pi f (d_p + L) / c): e less the mean of t_p t_p^H e / N is the mean of
        what is left of the frames without the target.
        """
        count = len(self._frequencies)
        left = np.zeros(self._still.shape, dtype=complex)
        mixed = np.zeros((*self._still.shape, count), dtype=complex)
        for frames, turns in self._demodulation():
            ways = np.conj(turns)
            left += ((frames - frames.mean(axis=-1, keepdims=True)) * ways).sum(axis=0)
            mixed += np.moveaxis(ways, 0, -1) @ np.moveaxis(turns, 0, -2)
        poses = len(self.capture.trajectory)
        kept = (1 + _LEAST_LEFT) * np.eye(count) - mixed / (poses * count)
        found = np.linalg.solve(kept, (left / poses)[..., None])[..., 0]
        self._still = (self._still + found).astype(np.complex64)

    def keep_determined(self) -> None:
        """From now on leave alone what the scan does not tell, as it was given; the target has its own uncertainty."""
        self.free = self.spread < _KNOWN * self._prior
        self.free[:3] = True
        turn = (
            self.state.turn
            if self.free[6:9].all()
            else rotation_from_vector(np.where(self.free[6:9], self._moved[6:9], 0))
        )
        self._moved = np.where(self.free, self._moved, 0)
        offset = np.where(self.free[3:6], self.state.offset, 0)
        path_offset = self.state.path_offset if self.free[9] else self.capture.radar.path_offset
        self.state = self.state._replace(turn=turn, offset=offset, path_offset=path_offset)

    def gains(self) -> tuple[np.ndarray, float]:
        """(T, R) complex gains as `RadarCalibration` has them; what the fit leaves of a phase, root mean square [rad].

        Raises
        ------
        InputError
            A channel has no signal.
        """
        sums = self._band_sums()
        power = (np.abs(sums) ** 2).mean(axis=-1, keepdims=True)
        seen = np.broadcast_to(power > _BRIGHT * power.max(), sums.shape)
        answers = _mean(seen.astype(float), sums)
        if not np.abs(answers).min() > 0:
            raise InputError("a channel has no signal from the target; check the target's position and the frames")
        left = np.angle(sums * np.conj(answers))[seen]
        gains = answers[0, :, :, 0]
        gains = gains / (np.abs(gains).mean() * gains[0, 0] / abs(gains[0, 0]))
        return gains, float(np.sqrt(np.mean(left**2)))

    def _array(self) -> AntennaArray:
        return self.capture.radar.array.moved(rotation=self.state.turn, translation=self.state.offset)

    def _paths(self, array: AntennaArray) -> TargetPaths:
        placed = self.capture.trajectory.placed
        return self.target.paths(placed(array.tx_positions), placed(array.rx_positions), self.state.place)

    def _slopes(self) -> np.ndarray:
        """(P, T, R, 10) how the length of a way changes with each unknown."""
        array = self._array()
        paths = self._paths(array)
        tx, rx = (np.einsum("pji,ptrj->ptri", self._turned, by) for by in (paths.by_tx, paths.by_rx))
        turns = np.cross(array.tx_positions[None, :, None], tx) + np.cross(array.rx_positions[None, None], rx)
        place = -(paths.by_tx + paths.by_rx)
        return np.concatenate([place, tx + rx, turns, np.ones((*tx.shape[:3], 1))], axis=-1)

    def _frames(self) -> Iterator[np.ndarray]:
        """Frames, complex64 (p, T, R, N), some poses at a time."""
        poses, per_pose = len(self.capture.trajectory), self.capture.channels // len(self.capture.trajectory)
        size = max(1, _BLOCK_BYTES // (16 * per_pose * len(self._frequencies)))
        for first in range(0, poses, size):
            yield self.capture.frames_of(slice(first, first + size))

    def _mean_of(self, parts: Iterable[np.ndarray]) -> np.ndarray:
        """(T, R, N) the mean over all poses."""
        total = sum(part.sum(axis=0, dtype=complex) for part in parts)
        return np.asarray(total / len(self.capture.trajectory)).astype(np.complex64)

    def _demodulation(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Frames less what they share, times exp(+i 2 pi f (d + L) / c), and that factor, some poses at a time."""
        lengths, first = self._paths(self._array()).lengths + self.state.path_offset, 0
        for frames in self._frames():
            cycles = lengths[first : first + len(frames), ..., None] * (self._frequencies / SPEED_OF_LIGHT)
            turns = np.exp(2j * np.pi * (cycles % 1)).astype(np.complex64)
            first += len(frames)
            yield (frames - self._still) * turns, turns

    def _demodulated(self) -> Iterator[np.ndarray]:
        return (frames for frames, _ in self._demodulation())

    def _profiles(self, shifts: np.ndarray) -> Iterator[np.ndarray]:
        """Range profiles (p, T, R, S) around the target, at `shifts` of the way [m], some poses at a time."""
        middle = self._frequencies - self._frequencies.mean()
        window = np.hanning(len(middle) + 2)[1:-1, None]
        to_range = window * np.exp(2j * np.pi * np.outer(middle, shifts) / SPEED_OF_LIGHT)
        for frames in self._demodulated():
            yield frames @ to_range.astype(np.complex64)

    def _band_sums(self) -> np.ndarray:
        """(P, T, R, B) what is in phase with the target in each part of the band."""
        parts = [np.add.reduceat(frames, self._edges[:-1], axis=-1) for frames in self._demodulated()]
        return np.concatenate(parts).astype(complex)

    def _observations(self, values: np.ndarray, slopes: np.ndarray, weights: np.ndarray) -> _Observations:
        """Those with a weight, one after the other."""
        used = weights.reshape(-1) > 0
        blocks = np.repeat(self._blocks, values.size // len(self._blocks))
        return _Observations(
            values.reshape(-1)[used], slopes.reshape(-1, _UNKNOWNS)[used], weights.reshape(-1)[used], blocks[used]
        )

    def _step(self, seen: _Observations, floor: float) -> float:
        """One step of the unknowns, robust against outliers; how large it was, in standard deviations.

        An observation errs by `floor` at least, in its own unit. Inside, each unknown is in units of its prior.
        """
        scaled, values = seen.slopes * self._prior, seen.values
        free, one = np.ix_(self.free, self.free), np.eye(_UNKNOWNS)
        step, normal, pulls = np.zeros(_UNKNOWNS), one, scaled
        for _ in range(5):
            left = values - scaled @ step
            usual = max(1.4826 * float(np.median(np.abs(left))), floor)
            weights = seen.weights * np.minimum(1, _OUTLYING * usual / np.maximum(np.abs(left), _LEAST))
            weights = weights / max(float((weights * left**2).sum() / weights.sum()), floor**2)
            pulls = scaled * weights[:, None]
            normal = pulls.T @ scaled + one
            step = np.zeros(_UNKNOWNS)
            step[self.free] = np.linalg.solve(normal[free], (pulls.T @ values - self._moved / self._prior)[self.free])
        # Neighbouring poses err alike: the sums are as unsure as what the runs of poses add to them differs.
        added = np.zeros((BLOCKS, _UNKNOWNS))
        np.add.at(added, seen.blocks, pulls * (values - scaled @ step)[:, None])
        inverse = np.zeros((_UNKNOWNS, _UNKNOWNS))
        inverse[free] = np.linalg.inv(normal[free])
        used_up = BLOCKS / (BLOCKS - _UNKNOWNS)  # as many are by the fit
        relative = inverse @ (used_up * added.T @ added + one) @ inverse
        self._covariance = relative * np.outer(self._prior, self._prior)
        self._move(step * self._prior)
        return float(np.max(np.abs(step[self.free]) / np.sqrt(np.diag(relative)[self.free])))

    def _move(self, step: np.ndarray) -> None:
        self._moved = self._moved + step
        place, turn, offset, path_offset = self.state
        small = rotation_from_vector(step[6:9])
        self.state = State(place + step[:3], small @ turn, small @ offset + step[3:6], path_offset + float(step[9]))


def _mean(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(1, T, R, 1, ...) the weighted mean of each channel over poses and parts of the band."""
    total = np.maximum(weights.sum(axis=(0, 3), keepdims=True), _LEAST)
    return (weights * values).sum(axis=(0, 3), keepdims=True) / total


def _peaks(size: np.ndarray, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and heights (p, T, R) of the largest of (p, T, R, S) values, by a parabola through it."""
    i = np.clip(size.argmax(axis=-1), 1, len(shifts) - 2)[..., None]
    low, top, high = (np.take_along_axis(size, i + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = np.minimum(low - 2 * top + high, -_LEAST)
    part = np.clip((low - high) / (2 * bend), -1, 1)
    return shifts[i[..., 0]] + part * (shifts[1] - shifts[0]), top
