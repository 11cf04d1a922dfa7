"""The echoes of frames, pose by pose, as the search for sheets sees them.

The echo of a mirror at height h below a pose comes from the image of the transmitter behind it. With the path to a
level mirror at a first guess of the height taken off, what is left of a frame changes slowly with the frequency: a few
Legendre polynomials hold it, and hardly anything that is farther away in range.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.core.errors import InputError
from millisight.data import Capture
from millisight.imaging._leakage import leakage_of, some_poses
from millisight.imaging._sheet_fit import Cells, Phase, SheetFit, fit_sheet, gather, spline_matrix
from millisight.imaging._sheet_ripples import rippled

_CELL = 0.005  # of poses that are averaged [m]
_LINE = 0.0025  # width of lines of poses along which an edge's ripples are alike [m]
_NEAREST = 0.05  # from an antenna to a sheet [m]
_COARSEST = 1e9  # range resolution by which a height is searched [m]: beyond it, distances are no numbers
_TERMS = 8  # Legendre polynomials over the band
_BLOCK = 512  # poses in one go
_MOST_CELLS, _CELLS_A_POSE = 10_000, 20  # of 5 mm: what poses may lie over
_CLEAR = 2.0  # range resolutions between the antennas and a sheet that is told from leakage


class FrameScene:
    """A capture from whose frames sheets are taken, those below z = `lowest` [m] not looked for.

    With `leaking` the antennas' leakage counts as part of the scene.
    """

    ripples = False

    def __init__(self, capture: Capture, lowest: float, *, leaking: bool = False):
        if capture.layers is not None:
            raise InputError("remove_sheets knows straight paths only; take sheets off before layers are added")
        self._capture = capture
        waveform = capture.radar.waveform
        self._frequencies = waveform.frequencies
        self._tx, self._rx = capture.tx_positions, capture.rx_positions
        self._above = float((self._tx[..., 2].mean() + self._rx[..., 2].mean()) / 2)
        self._places = (self._tx.mean(axis=1) + self._rx.mean(axis=1))[:, :2] / 2
        count = min(_TERMS, len(self._frequencies))
        terms = np.polynomial.legendre.legvander(np.linspace(-1, 1, len(self._frequencies)), count - 1)
        self._terms = np.linalg.qr(terms)[0].astype(np.float32)  # (N, Q), orthonormal over the samples
        spans = np.ptp(self._places, axis=0)
        if np.prod(spans / _CELL + 1) > _MOST_CELLS + _CELLS_A_POSE * len(self._places):
            raise InputError(
                f"{len(self._places)} poses lie over {spans[0]:.3g} x {spans[1]:.3g} m, too far apart to see a sheet "
                'from neighbouring ones; leave stray poses out, or pass clutter="none"'
            )
        # Often stronger than a lid, which its range sidelobes hide.
        self._leak = np.zeros((), np.complex64) if leaking else leakage_of(capture)
        self._level = self._usual_height(lowest)
        if self._above - self._level < _CLEAR * waveform.range_resolution:
            self._leak = np.zeros((), np.complex64)
        self._echoes, self._power = self._projected()
        self._taken = np.zeros_like(self._echoes)
        self._lines = [_lines(self._places[:, i]) for i in (0, 1)]
        self._axes, self._into = zip(*(_cells(self._places[:, i]) for i in (0, 1)), strict=True)

    @property
    def cells(self) -> Cells:
        """Poses averaged over about 5 mm."""
        shape = len(self._axes[0]), len(self._axes[1])
        counts = np.zeros(shape)
        np.add.at(counts, self._into, 1.0)

        def values(phase: Phase | None) -> np.ndarray:
            flat = self._echoes if phase is None else self._echoes * self._turn(phase).conj()
            return gather(flat, self._into, shape)

        return Cells(x=self._axes[0], y=self._axes[1], counts=counts, values=values)

    def first_fit(self, wave_number: float) -> SheetFit | None:
        """The sheet that all cells tell of, before any is taken off."""
        return fit_sheet(self.cells, wave_number, ripples=self.ripples)

    def sharpened(self, fit: SheetFit) -> SheetFit:
        """The fit: poses are too far apart to tell a lid's edges better."""
        return fit

    def take(self, fit: SheetFit) -> float:
        """Take a sheet's echo; returns its power over that of all frames."""
        turn = self._turn(fit.phase)
        smooth, flat, weights = self._smooth(fit) * turn.conj(), self._echoes * turn.conj(), fit.weights[self._into]
        echo = rippled(flat, smooth, weights, self._total, self._spread, factors=0) * turn
        echo *= fit.window[self._into][..., None]
        self._echoes -= echo
        self._taken += echo
        return float((np.abs(echo) ** 2).sum()) / self._power

    def height(self, fit: SheetFit) -> float:
        """z of a sheet [m] by the delay of its echo over the band."""
        samples = fit.profile.reshape(-1, self._terms.shape[1]) @ self._terms.T
        turn = np.angle((samples[:, 1:] * samples[:, :-1].conj()).sum()) if samples.shape[1] > 1 else 0.0
        step = float(self._frequencies[1] - self._frequencies[0]) if samples.shape[1] > 1 else 0.0
        return self._level + (float(turn) * SPEED_OF_LIGHT / (4 * np.pi * step) if step else 0.0)

    def told(self) -> dict[str, float]:
        """Nothing: what the maximum of an image loses is not known before there is one."""
        return {}

    def cleaned(self, metadata: Mapping[str, Any]) -> Capture:
        shape = (len(self._places), self._tx.shape[1], self._rx.shape[1], len(self._frequencies))
        frames = np.empty(shape, dtype=np.complex64)
        for some in self._blocks():
            echo = self._taken[some].reshape(*frames[some].shape[:3], -1) @ self._terms.T
            frames[some] = self._capture.frames_of(some) - echo * self._waves(some)
        frames.flags.writeable = False
        return replace(self._capture, frames=frames, metadata=metadata)

    def _smooth(self, fit: SheetFit) -> np.ndarray:
        """(P, T R Q) the fitted echo without ripples."""
        along_x = spline_matrix(self._places[:, 0], fit.knots[0])
        along_y = spline_matrix(self._places[:, 1], fit.knots[1])
        splines = fit.splines.astype(np.complex64)
        echo = np.empty_like(self._echoes)
        for some in self._blocks():
            echo[some] = (np.tensordot(along_x[some], splines, axes=1) * along_y[some, :, None]).sum(axis=1)
        return echo * self._turn(fit.phase)

    def _total(self, weights: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
        """Weighted sums over the poses with about the same x or y."""
        _, order, first = self._lines[axis]
        return np.add.reduceat((weights[:, None] * values)[order], first, axis=0)

    def _spread(self, table: np.ndarray, axis: int) -> np.ndarray:
        return table[self._lines[axis][0]]

    def _blocks(self) -> list[slice]:
        return [slice(start, start + _BLOCK) for start in range(0, len(self._places), _BLOCK)]

    def _usual_height(self, lowest: float) -> float:
        """z of the echo that most poses have at one distance below them, no lower than `lowest` [m]."""
        waveform = self._capture.radar.waveform
        count = len(self._frequencies)
        if count < 2:
            return float(self._tx[..., 2].mean()) - _NEAREST
        length = 4 * count
        step = abs(waveform.slope) / waveform.sample_rate
        if not waveform.range_resolution < _COARSEST:
            return self._above - _NEAREST
        distances = SPEED_OF_LIGHT / step / length * np.arange(length) / 2 - self._capture.radar.path_offset / 2
        above = self._above
        near = distances > _NEAREST
        if not near.any():  # what the samples tell apart is nearer than that
            return above - _NEAREST
        near &= distances <= max(above - lowest, distances[near].min())
        falling = waveform.slope < 0
        profiles = []
        for pose in some_poses(self._capture):
            frames = self._capture.frames_of(slice(pose, pose + 1))[0] - self._leak
            spectrum = np.fft.fft(frames, length, axis=-1) if falling else np.fft.ifft(frames, length, axis=-1)
            profiles.append(np.abs(spectrum).mean(axis=(0, 1)))
        usual = np.median(profiles, axis=0)
        distance = float(distances[near][np.argmax(usual[near])])
        return above - distance

    def _waves(self, some: slice) -> np.ndarray:
        """(p, T, R, N) complex64 echoes of a level mirror at the usual height."""
        tx, rx = self._tx[some, :, None], self._rx[some, None]
        drop = tx[..., 2] + rx[..., 2] - 2 * self._level
        aside = tx[..., :2] - rx[..., :2]
        path = np.sqrt(drop**2 + (aside**2).sum(axis=-1)) + self._capture.radar.path_offset
        # exp(-i k_j d) as a product over a coarse and a fine part of j: far fewer exponentials.
        turns = path / SPEED_OF_LIGHT
        first, fine = self._frequencies[0], 16
        step = self._frequencies[1] - first if len(self._frequencies) > 1 else 0.0
        coarse = -(-len(self._frequencies) // fine)
        high = np.exp(-2j * np.pi * turns[..., None] * (first + fine * step * np.arange(coarse))).astype(np.complex64)
        low = np.exp(-2j * np.pi * turns[..., None] * (step * np.arange(fine))).astype(np.complex64)
        waves = high[..., :, None] * low[..., None, :]
        return waves.reshape(*turns.shape, -1)[..., : len(self._frequencies)]

    def _projected(self) -> tuple[np.ndarray, float]:
        """(P, T R Q) complex64 the frames' parts near the usual height, and the power of all frames."""
        echoes, power = [], 0.0
        for some in self._blocks():
            frames = self._capture.frames_of(some) - self._leak
            power += float((np.abs(frames) ** 2).sum())
            near = (frames * self._waves(some).conj()) @ self._terms
            echoes.append(near.reshape(len(frames), -1))
        return np.concatenate(echoes), power

    def _turn(self, phase: Phase) -> np.ndarray:
        """(P, 1) exp(i psi)"""
        return np.exp(1j * phase.at(self._places[:, 0], self._places[:, 1])).astype(np.complex64)[:, None]


def _lines(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses in lines across an axis: each one's line, an order by lines, and where each line begins in it."""
    _, line = np.unique(np.round((places - places.min()) / _LINE), return_inverse=True)
    order = np.argsort(line, kind="stable")
    return line, order, np.searchsorted(line[order], np.arange(line.max() + 1))


def _cells(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the cells along an axis [m], and each pose's cell."""
    lower, extent = float(places.min()), float(np.ptp(places))
    count = max(1, round(extent / _CELL))
    width = extent / count if extent > 0 else _CELL
    into = np.minimum(((places - lower) / width).astype(np.int64), count - 1)
    return lower + width * (np.arange(count) + 0.5), into
