"""The echo of a sheet over a plane of cells: a smooth phase, times smooth amplitudes, fitted robustly.

A lid, a wall or a cloth is a mirror. Each cell (x, y), a column of voxels of an image or the frames of the poses there,
holds the echo of what lies straight below, and its phase follows the sheet's height h(x, y): 2 k h. With that phase
taken off, the echo changes slowly from cell to cell in all channels (slices, or samples):

    D_c(x, y) exp(-i psi(x, y)) = sum_m C_mc B_m(x, y) + what else is there,

psi a polynomial of the second degree (height, tilt, bow) and B_m cubic B-splines, their second differences penalised
(P. H. C. Eilers and B. D. Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11, 89 (1996)).
Cells that hold anything else differ from such a sheet, and lose their weight (iteratively reweighted least squares,
with the weights 1 / (1 + r²)² of S. Geman and D. McClure); under an object the splines go on from its surroundings.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.fft import fft2, next_fast_len
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import uniform_filter1d

from millisight.imaging._sheet_edges import LidPlace, all_of, sides_of
from millisight.imaging._sheet_ripples import rippled, spread_on_grid, total_of_grid

STEEPEST_DEG = 8.0
"""Tilt of a sheet at most: what is steeper is not taken for one."""
SUPPORT = 0.3
"""Share of a sheet's amplitude from which on it is seen."""

_DISTANCE = 0.2  # of a sheet [m], at which a Fresnel zone is as wide as the knots of the splines are apart
_MOST_BENT = 1.0  # curvature of a sheet at most [1/m]; a point at distance d looks like a mirror of curvature 1 / d
_MOST_KNOTS = 22  # along an axis
_PENALTY = 0.3  # of the second differences, over the mean weight of a knot
_WINDOW = 1.5  # over which a sheet is coherent, in distances of the knots
_CHANNELS = 8  # principal components of the channels that are looked at
_ROUNDS, _STEPS = 3, 6  # of the phase; of the weights
_SCALE = 1.5  # median misfits at which a cell's weight has fallen to a quarter
_LEAST_SCALE = 0.03  # and at least this share of the sheet's amplitude
_FAR_OFF = 1e6  # of these scales: the weight is nothing, and within float32's range
_OUTSIDE, _LEAST_RIM = 0.2, 0.75  # of an axis, at either end; of a cell
_INSIDE = 0.1  # weight of cells away from the border before anything is fitted: objects are there
_BRIGHTER = 2.5  # than the sheet: something else


class Cells(NamedTuple):
    """Echoes over a plane.

    x, y : (X,) and (Y,) middles of the cells [m]
    counts : (X, Y) measurements in each; 0: not looked at
    values : for a phase (None: none) that is first taken off each measurement, the cells' means (X, Y, C) complex64
    """

    x: np.ndarray
    y: np.ndarray
    counts: np.ndarray
    values: Callable[["Phase | None"], np.ndarray]


class Phase(NamedTuple):
    """psi(x, y) [rad], a polynomial of the second degree without its constant: coefficients (5,) of u, v, u², u v, v²,
    with u and v the distance from `middle` (2,) over `reach` (2,) [m]."""

    coefficients: np.ndarray
    middle: np.ndarray
    reach: np.ndarray

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, v = (x - self.middle[0]) / self.reach[0], (y - self.middle[1]) / self.reach[1]
        a, b, c, d, e = self.coefficients
        return a * u + b * v + c * u * u + d * u * v + e * v * v

    def slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of psi along x and y [rad/m], of each term (5, ...)."""
        u, v = (x - self.middle[0]) / self.reach[0], (y - self.middle[1]) / self.reach[1]
        one, zero = np.ones(np.broadcast_shapes(u.shape, v.shape)), np.zeros(np.broadcast_shapes(u.shape, v.shape))
        along_x = np.stack([one, zero, 2 * u * one, v * one, zero]) / self.reach[0]
        along_y = np.stack([zero, one, zero, u * one, 2 * v * one]) / self.reach[1]
        return along_x, along_y


class SheetFit(NamedTuple):
    """A sheet's echo over some cells.

    phase : Phase
    splines : (mx, my, C) coefficients of its knots
    knots : of the two axes
    support : (X, Y) bool, where the sheet is seen
    weights : (X, Y) how well each cell agrees with it, 0 to 1
    window : (X, Y) bool, cells in which it was fitted
    place : the rectangle of a known lid in which it was fitted; None: it was fitted everywhere
    profile : (C,) its mean echo there
    explained : median share of the energy of the support's cells that is the sheet's
    """

    phase: Phase
    splines: np.ndarray
    knots: tuple[np.ndarray, np.ndarray]
    support: np.ndarray
    weights: np.ndarray
    window: np.ndarray
    place: LidPlace | None
    profile: np.ndarray
    explained: float


def fit_sheet(cells: Cells, wave_number: float, *, ripples: bool, place: LidPlace | None = None) -> SheetFit | None:
    """The sheet that most of the cells agree on, or None where nothing there is coherent.

    Parameters
    ----------
    cells : Cells
    wave_number : k at the band's centre [rad/m], by which the phase of the steepest sheet is known
    ripples : whether the cells show the ripples of an aperture's edges
    place : in which to look, to whose edges the sheet reaches; None: everywhere
    """
    looked_in = place or all_of(cells.x, cells.y)
    within = looked_in.inside(cells.x[:, None], cells.y)
    cells = cells._replace(counts=np.where(within, cells.counts, 0))
    looked_at = cells.counts > 0
    zone, seen = fresnel_zone(wave_number), plane_wave(cells, wave_number)
    if seen is None:
        return None
    basis, phase = seen
    rim = np.maximum(_OUTSIDE * (looked_in.upper - looked_in.lower), _LEAST_RIM * sides_of(cells.x, cells.y))
    outside = within & ~looked_in.inside(cells.x[:, None], cells.y, rim)
    for last in (False,) * _ROUNDS + (True,):
        flat = cells.values(phase) * looked_at[..., None] @ basis.conj()
        weights, level = _first_weights(flat, cells, zone, outside)
        if not level > 0:
            return None
        if not last:
            phase = _refined(phase, local_means(flat, weights, cells, zone), weights, cells, wave_number)
    knots = _knots(cells.x, zone), _knots(cells.y, zone)
    matrices = spline_matrix(cells.x, knots[0]), spline_matrix(cells.y, knots[1])
    rest = np.zeros_like(flat)
    for _ in range(_STEPS):
        splines = _splines(matrices, flat - rest, weights * cells.counts)
        smooth = spline_values(matrices, splines)
        if ripples:
            rest = rippled(flat, smooth, weights * cells.counts, total_of_grid, spread_on_grid, factors=1) - smooth
        misfit, amplitude = np.linalg.norm(flat - smooth - rest, axis=2), np.linalg.norm(smooth, axis=2)
        level = _typical(amplitude, weights * amplitude**2)
        support = (amplitude > SUPPORT * level) & looked_at
        if not support.any():
            return None
        weights = looked_at * agreement(misfit, support, level)
    energy = np.maximum((np.abs(flat[support]) ** 2).sum(axis=1), 1e-30)
    missed = (np.abs(flat[support] - smooth[support]) ** 2).sum(axis=1)
    return SheetFit(
        phase=phase,
        splines=splines @ basis.T,
        knots=knots,
        support=support,
        weights=weights,
        window=within,
        place=place,
        profile=(smooth[support] * weights[support, None]).sum(axis=0) @ basis.T / weights[support].sum(),
        explained=float(np.median(1 - missed / energy)),
    )


def plane_wave(cells: Cells, wave_number: float) -> tuple[np.ndarray, Phase] | None:
    """Principal components (C, K) of what the cells hold, and the linear phase of most of it; None of nothing."""
    raw = cells.values(None) * (cells.counts > 0)[..., None]
    if not raw.any():
        return None
    basis = _principal(raw)
    return basis, _linear_phase(raw @ basis.conj(), cells, wave_number)


def fresnel_zone(wave_number: float) -> float:
    """sqrt(wavelength distance / 2) [m] of a sheet at a usual distance, over which it is looked at as one."""
    return float(np.sqrt(np.pi * _DISTANCE / wave_number))


def agreement(misfit: np.ndarray, support: np.ndarray, level: float) -> np.ndarray:
    """Weights of places that miss a sheet's echo by `misfit`; it is seen at `support`, about as strong as `level`."""
    scale = _SCALE * max(float(np.median(misfit[support])), _LEAST_SCALE * level)
    return 1 / (1 + np.minimum(misfit / scale, _FAR_OFF) ** 2) ** 2


def gather(values: np.ndarray, into: tuple[np.ndarray, np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """(X, Y, C) means of values (N, C) over the cells that `into`, twice (N,), names; 0 where there are none."""
    index = into[0] * shape[1] + into[1]
    order = np.argsort(index, kind="stable")
    filled, first = np.unique(index[order], return_index=True)
    sums = np.zeros((shape[0] * shape[1], values.shape[1]), dtype=values.dtype)
    counts = np.diff(np.append(first, len(order)))
    sums[filled] = np.add.reduceat(values[order], first, axis=0) / counts[:, None]
    return sums.reshape(*shape, -1)


def spline_matrix(places: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N, m) float32 of the cubic B-splines at places (N,) [m]; constant where the axis has one cell."""
    if not len(knots):
        return np.ones((len(places), 1), dtype=np.float32)
    inside = np.clip(places, knots[3], np.nextafter(knots[-4], knots[0]))
    return BSpline.design_matrix(inside, knots, 3).toarray().astype(np.float32)


def spline_values(matrices: tuple[np.ndarray, np.ndarray], splines: np.ndarray) -> np.ndarray:
    """(X, Y, C) complex64 over the cells of two axes."""
    along_y = np.einsum("yj,ijc->iyc", matrices[1], splines.astype(np.complex64), optimize=True)
    return np.einsum("xi,iyc->xyc", matrices[0], along_y, optimize=True)


def _knots(axis: np.ndarray, zone: float) -> np.ndarray:
    extent = float(axis[-1] - axis[0])
    if not extent > 0:
        return np.zeros(0)
    pieces = min(max(1, round(extent / zone)), _MOST_KNOTS)
    return axis[0] + extent / pieces * np.arange(-3, pieces + 4)


def _principal(values: np.ndarray) -> np.ndarray:
    """(C, K) the strongest principal components of the channels, no cell counting more than the median one."""
    clipped = _clipped(values.reshape(-1, values.shape[2]))
    if clipped.shape[1] <= clipped.shape[0]:
        _, vectors = np.linalg.eigh(clipped.T @ clipped.conj())
        return np.ascontiguousarray(vectors[:, : -_CHANNELS - 1 : -1]).astype(np.complex64)
    # Of fewer cells than channels: from the smaller of both matrices, whose values other than 0 are the same.
    _, vectors = np.linalg.eigh(clipped.conj() @ clipped.T)
    found = clipped.T @ vectors[:, : -_CHANNELS - 1 : -1]
    return (found / np.maximum(np.linalg.norm(found, axis=0), 1e-30)).astype(np.complex64)


def _clipped(values: np.ndarray) -> np.ndarray:
    """The values (..., C), no cell stronger than the median of those that are not empty."""
    strength = np.linalg.norm(values, axis=-1, keepdims=True)
    usual = np.median(strength[strength > 0]) if strength.any() else 1.0
    return values * (usual / np.maximum(strength, usual)).astype(np.float32)


def _linear_phase(values: np.ndarray, cells: Cells, wave_number: float) -> Phase:
    """The linear phase whose plane wave the values hold most of, no steeper than a sheet may be."""
    x_window, y_window = (np.hanning(n + 2)[1:-1].astype(np.float32) for n in values.shape[:2])
    tapered = _clipped(values) * (x_window[:, None, None] * y_window[:, None])
    shape = [int(next_fast_len(2 * n) or 1) if n > 1 else 1 for n in values.shape[:2]]
    power = (np.abs(np.asarray(fft2(tapered, shape, axes=(0, 1)))) ** 2).sum(axis=2)
    slopes = [
        2 * np.pi * np.fft.fftfreq(n, axis[1] - axis[0] if n > 1 else 1.0)
        for n, axis in zip(shape, (cells.x, cells.y), strict=True)
    ]
    steepest = 2 * wave_number * np.sin(np.radians(STEEPEST_DEG))
    power[np.hypot(slopes[0][:, None], slopes[1]) > steepest] = 0
    i, j = np.unravel_index(int(power.argmax()), power.shape)
    middle = np.array([cells.x.mean(), cells.y.mean()])
    reach = np.array([max(np.ptp(axis) / 2, 1e-9) for axis in (cells.x, cells.y)])
    linear = np.array([slopes[0][i], slopes[1][j]]) * reach
    return Phase(np.array([*linear, 0.0, 0.0, 0.0]), middle, reach)


def _first_weights(flat: np.ndarray, cells: Cells, zone: float, outside: np.ndarray) -> tuple[np.ndarray, float]:
    """(X, Y) weights before anything is fitted, and the sheet's amplitude as it is `outside`.

    Weighty are cells about which the phase is alike, and dark ones, which tell where the sheet is not; cells that are
    far brighter than the sheet outside hold something else.
    """
    looked_at = cells.counts > 0
    amplitude = np.linalg.norm(flat, axis=2)
    trust = _trust(coherence(flat, cells, zone)) * looked_at
    bright = np.minimum(amplitude, np.quantile(amplitude, 0.95)) ** 2
    level = _typical(amplitude[outside], (trust * bright)[outside])
    weights = np.where(amplitude < SUPPORT * level, 1.0, trust) * looked_at
    weights = np.where(amplitude > _BRIGHTER * level, 0.0, weights)
    return np.where(outside, weights, _INSIDE * weights), level


def coherence(flat: np.ndarray, cells: Cells, zone: float) -> np.ndarray:
    """(X, Y) share of the energy about each cell that is in the mean there."""
    sizes = _sizes(cells, _WINDOW * zone)
    filled = np.maximum(_averaged((cells.counts > 0).astype(np.float32), sizes), 1e-6)
    mean = _averaged(np.real(flat), sizes) + 1j * _averaged(np.imag(flat), sizes)
    energy = _averaged((np.abs(flat) ** 2).sum(axis=2), sizes)
    return (np.abs(mean) ** 2).sum(axis=2) / filled / np.maximum(energy, 1e-30)


def local_means(flat: np.ndarray, weights: np.ndarray, cells: Cells, zone: float) -> np.ndarray:
    """(X, Y, C) weighted means about each cell, in which another sheet of another tilt is weaker."""
    sizes = _sizes(cells, zone)
    weighted = flat * weights.astype(np.float32)[..., None]
    mean = _averaged(np.real(weighted), sizes) + 1j * _averaged(np.imag(weighted), sizes)
    return mean / np.maximum(_averaged(weights.astype(np.float32), sizes), 1e-3)[..., None]


def _sizes(cells: Cells, width: float) -> list[int]:
    """How many cells are as wide as that [m], along each axis."""
    return [
        max(1, min(round(width / (axis[1] - axis[0])), len(axis))) if len(axis) > 1 else 1
        for axis in (cells.x, cells.y)
    ]


def _averaged(values: np.ndarray, sizes: list[int], mode: str = "constant") -> np.ndarray:
    """Means over windows of the first two axes; those of an even size reach half a cell beyond it on either side."""
    for axis, size in enumerate(sizes):
        mean = uniform_filter1d(values, size, axis=axis, mode=mode)
        if size % 2 == 0:  # its middle lies between two cells
            mean = (mean + uniform_filter1d(values, size, axis=axis, mode=mode, origin=-1)) / 2
        values = mean
    return values


def _trust(coherence: np.ndarray) -> np.ndarray:
    """Weights of cells by the coherence about them, before a sheet is fitted."""
    return np.clip(2 * coherence - 0.6, 0, 1) ** 2


def _typical(amplitude: np.ndarray, weights: np.ndarray) -> float:
    """The weighted median."""
    order = np.argsort(amplitude, axis=None)
    summed = np.cumsum(weights.ravel()[order])
    return float(amplitude.ravel()[order][np.searchsorted(summed, summed[-1] / 2)]) if summed[-1] > 0 else 0.0


def _splines(matrices: tuple[np.ndarray, np.ndarray], values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(mx, my, C) coefficients by penalised weighted least squares over the cells."""
    bx, by = (matrix.astype(float) for matrix in matrices)
    mx, my = bx.shape[1], by.shape[1]
    pairs = [(b[:, :, None] * b[:, None, :]).reshape(len(b), -1) for b in (bx, by)]
    normal = (pairs[0].T @ weights @ pairs[1]).reshape(mx, mx, my, my).transpose(0, 2, 1, 3).reshape(mx * my, mx * my)
    usual = np.trace(normal) / len(normal)
    normal += usual * _PENALTY * _stiffness(mx, my)
    normal[np.diag_indices(len(normal))] += 1e-6 * usual + 1e-30
    weighted = values * weights.astype(np.float32)[..., None]
    along_x = np.tensordot(matrices[0], weighted, (0, 0))
    right = np.einsum("yj,iyc->ijc", matrices[1], along_x, optimize=True).reshape(mx * my, -1).astype(complex)
    # Splines further apart than three knots have nothing in common.
    bands = np.zeros((min(3 * my + 4, len(normal)), len(normal)))
    for k, band in enumerate(bands):
        band[: len(normal) - k] = normal.diagonal(-k)
    factor = cholesky_banded(bands, overwrite_ab=True, lower=True, check_finite=False), True
    both = cho_solve_banded(factor, np.concatenate([right.real, right.imag], axis=1), check_finite=False)
    return (both[:, : right.shape[1]] + 1j * both[:, right.shape[1] :]).reshape(mx, my, -1)


@lru_cache(maxsize=2)
def _stiffness(mx: int, my: int) -> np.ndarray:
    """(mx my, mx my) the sum of the squares of second differences along both axes."""
    bends = [np.diff(np.eye(m), 2, axis=0) if m > 2 else np.zeros((0, m)) for m in (mx, my)]
    stiff = [bend.T @ bend for bend in bends]
    return np.kron(stiff[0], np.eye(my)) + np.kron(np.eye(mx), stiff[1])


def _refined(phase: Phase, flat: np.ndarray, weights: np.ndarray, cells: Cells, wave_number: float) -> Phase:
    """The phase, less what is left of its slopes: those between neighbours, averaged over a few, have no jumps."""
    rows, slopes, trust = [], [], []
    x, y = cells.x, cells.y
    for axis, places in enumerate((x, y)):
        if len(places) < 2:
            continue
        ahead, behind = (slice(1, None), slice(None, -1))
        one, other = ((ahead, slice(None)), (behind, slice(None))) if axis == 0 else (
            (slice(None), ahead), (slice(None), behind),
        )  # fmt: skip
        products = (flat[one] * flat[other].conj()).sum(axis=2) * np.sqrt(weights[one] * weights[other])
        mean = _averaged(np.real(products), [5, 5], "nearest") + 1j * _averaged(np.imag(products), [5, 5], "nearest")
        halfway = (places[1:] + places[:-1]) / 2
        at = (halfway[:, None], y[None]) if axis == 0 else (x[:, None], halfway[None])
        terms = phase.slopes(*at)[axis]
        rows.append(terms.reshape(5, -1))
        slopes.append(
            (np.angle(mean) / np.diff(places)[:, None] if axis == 0 else np.angle(mean) / np.diff(places)).ravel()
        )
        trust.append(np.sqrt(np.abs(mean)).ravel())
    if not rows:
        return phase
    by = np.concatenate(trust)
    terms = (np.concatenate(rows, axis=1) * by).T
    scale = np.maximum(np.linalg.norm(terms, axis=0), 1e-30)
    change = np.linalg.lstsq(terms / scale, np.concatenate(slopes) * by, rcond=1e-6)[0] / scale
    coefficients = phase.coefficients + change
    bend = np.abs(
        coefficients[2:] * [2, 1, 2] / (2 * wave_number * np.outer(phase.reach, phase.reach)[[0, 0, 1], [0, 1, 1]])
    )
    coefficients[2:] *= min(1.0, _MOST_BENT / max(float(bend.max()), 1e-30))
    return phase._replace(coefficients=coefficients)
