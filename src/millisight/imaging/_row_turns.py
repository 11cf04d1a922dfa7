"""A first idea of the clock's offset from a scan's rows: to and fro, the radar hears the same at the same places.

How strongly it hears each range bin makes a pattern over position. Between rows that run forward and rows that run
backward, an offset shifts that pattern by twice the offset times the speed. No phase is needed, so that an offset of
many wavelengths is found as well; the drift is not, and is searched afterwards.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, product
from millisight.data import Capture, Trajectory
from millisight.imaging._backprojection import range_steering
from millisight.imaging._focus import BLOCK, pick

_BINS = 12  # range bins that make up the pattern
_BRIGHT = 0.1  # of the strongest bin's power: where the scene lies
_SOME = 500  # frames from which mean and bins are taken
_PLACES = 200  # along a row
_RESAMPLINGS = 30  # of the rows, whose answers' scatter is the uncertainty


class Row(NamedTuple):
    """A run of the log along the main direction: its sign, times (n,) [s], and way (n,) [m], which never falls."""

    sign: float
    times: np.ndarray
    way: np.ndarray

    @property
    def speed(self) -> float:
        """[m/s], its mean."""
        return float(np.ptp(self.way) / np.ptp(self.times))


class Pattern(NamedTuple):
    """Strengths (F, B) of range bins at times (F,), increasing [s]; paths (n,) of the bins where the scene lies [m]."""

    times: np.ndarray
    strengths: np.ndarray
    paths: np.ndarray


def rows_of(log: Trajectory, direction: np.ndarray) -> list[Row]:
    """The runs of a log along a direction (3,), from turn to turn; what is shorter than half of the scan is no row."""
    from scipy.signal import find_peaks

    along = log.positions @ direction
    extent = np.ptp(along)
    if not extent > 0:
        return []
    turns = [find_peaks(side, prominence=0.4 * extent)[0] for side in (along, -along)]
    edges = np.unique(np.concatenate([[0], *turns, [len(along) - 1]]))
    rows = []
    for start, stop in pairwise(edges):
        if abs(along[stop] - along[start]) > extent / 2:
            sign = float(np.sign(along[stop] - along[start]))
            run = slice(start, stop + 1)
            rows.append(Row(sign, log.times[run], np.maximum.accumulate(sign * along[run])))
    return rows


def pattern_of(capture: Capture, rng: np.random.Generator) -> Pattern:
    """The strengths of the range bins that change most, frame by frame; what stands still is taken away before."""
    poses = len(capture.trajectory)
    sample = pick(capture, np.sort(rng.choice(poses, min(_SOME, poses), replace=False)))
    mean = sample.mean(axis=0)
    waveform = capture.radar.waveform
    # Up to the longest path that the samples tell from a shorter one; range_steering adds three entries.
    furthest = (
        max(waveform.samples_per_chirp - 3, 0) * SPEED_OF_LIGHT / waveform.bandwidth if waveform.bandwidth else 1.0
    )
    steering, per_metre = range_steering(capture, 0.0, furthest, 1, "hann")
    power = np.mean(np.abs(product(sample - mean, steering)) ** 2, axis=(0, 1, 2))
    bins = np.sort(np.argsort(power)[-_BINS:])
    steering = np.ascontiguousarray(steering[:, bins])
    strengths = [
        np.abs(product(capture.frames_of(slice(start, start + BLOCK)) - mean, steering))
        for start in range(0, poses, BLOCK)
    ]
    order = np.argsort(capture.trajectory.times, kind="stable")
    return Pattern(
        times=capture.trajectory.times[order],
        strengths=np.concatenate(strengths).reshape(poses, -1)[order],
        paths=bins[power[bins] >= _BRIGHT * power.max()] / per_metre,
    )


class Guess(NamedTuple):
    """Offset in the middle of the frames' times and its standard error [s]."""

    offset: float
    error: float


def guess_from_rows(
    pattern: Pattern,
    rows: list[Row],
    *,
    wavelength: float,
    max_offset: float,
    max_late: float,
    rng: np.random.Generator,
) -> Guess | None:
    """The offset at which rows to and fro are most alike, for the drift that suits it; None where they tell nothing.

    The drift that suits it is worth nothing: what changes steadily from row to row looks like it.
    """
    middle, half = (pattern.times[0] + pattern.times[-1]) / 2, np.ptp(pattern.times) / 2
    reach = max_offset + max_late
    step = float(np.clip(wavelength / 16 / np.median([row.speed for row in rows]), reach / 500, reach / 20))
    shifts = step * np.arange(-np.ceil(reach / step), np.ceil(reach / step) + 1)
    likeness, when = _likeness(pattern, rows, shifts)
    if not likeness.any():
        return None
    offsets = shifts[np.abs(shifts) <= max_offset + step]
    count = int(np.ceil(max_late / step))
    lates = max_late * np.arange(-count, count + 1) / count
    table = np.zeros((len(when), len(offsets), len(lates)))
    for line, time, values in zip(table, when, likeness, strict=True):
        for j, late in enumerate(lates):
            line[:, j] = np.interp(offsets + late * (time - middle) / half, shifts, values)

    def best(chosen: np.ndarray) -> float:
        total = table[chosen].sum(axis=0)
        i, j = np.unravel_index(np.argmax(total), total.shape)
        near = slice(max(i - 2, 0), i + 3), slice(max(j - 2, 0), j + 3)
        top = peak(offsets[near[0]] - offsets[i], lates[near[1]] - lates[j], total[near])
        return float(offsets[i] + (0.0 if top is None else np.clip(top[0], -2 * step, 2 * step)))

    # Neighbours stay together: what a row running forward gets wrong, one running backward gets wrong the other way.
    pairs = np.array_split(np.arange(len(when)), max(len(when) // 2, 1))
    again = [
        best(np.concatenate([pairs[k] for k in rng.integers(0, len(pairs), len(pairs))])) for _ in range(_RESAMPLINGS)
    ]
    return Guess(best(np.arange(len(when))), float(np.std(again)) if len(pairs) > 1 else float("inf"))


def peak(x: np.ndarray, y: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """(2,) the peak of the paraboloid next to values (X, Y) over x (X,) and y (Y,); None where it has none."""
    px, py = (p.ravel() for p in np.meshgrid(x, y, indexing="ij"))
    terms = np.stack([np.ones_like(px), px, py, px * px / 2, px * py, py * py / 2], axis=1)
    _, a, b, xx, xy, yy = np.linalg.lstsq(terms, values.ravel(), rcond=None)[0]
    curvature = np.array([[xx, xy], [xy, yy]])
    largest = float(np.linalg.eigvalsh(curvature)[1])
    return np.linalg.solve(curvature, [-a, -b]) if largest < 0 else None


def _likeness(pattern: Pattern, rows: list[Row], shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, shifts) correlation of a row with the sum of its two neighbours, which run the other way; its times (n,).

    Between two neighbours, what changes steadily from row to row cancels.
    """
    middles = [i for i in range(1, len(rows) - 1) if rows[i - 1].sign == rows[i + 1].sign == -rows[i].sign]
    lowest = max((row.sign * row.way).min() for row in rows)
    highest = min((row.sign * row.way).max() for row in rows)
    places = np.linspace(lowest, highest, _PLACES + 2)[1:-1]
    at = [np.interp(row.sign * places, row.way, row.times) for row in rows]
    tick = float(np.median(np.diff(pattern.times)))
    likeness = np.zeros((len(middles), len(shifts)))
    if not middles:
        return likeness, np.zeros(0)
    here, times = np.array(middles), np.concatenate(at)
    for s, shift in enumerate(shifts):
        strengths, near = _strengths_at(pattern, times - shift, tick)
        strengths, near = strengths.reshape(len(rows), _PLACES, -1), near.reshape(len(rows), _PLACES)
        good = near[here - 1] & near[here] & near[here + 1]
        enough = good.sum(axis=1) > _PLACES // 2
        some, good = here[enough], good[enough]
        likeness[enough, s] = _correlations(strengths[some], strengths[some - 1] + strengths[some + 1], good)
    return likeness, np.array([rows[i].times.mean() for i in middles])


def _strengths_at(pattern: Pattern, times: np.ndarray, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """Strengths (n, B) between the frames around each time, and (n,) whether these are near enough to tell."""
    after = np.clip(np.searchsorted(pattern.times, times), 1, len(pattern.times) - 1)
    gap = pattern.times[after] - pattern.times[after - 1]
    part = (times - pattern.times[after - 1]) / np.maximum(gap, 1e-12)
    low, high = pattern.strengths[after - 1], pattern.strengths[after]
    strengths = low + np.clip(part, 0, 1)[:, None].astype(np.float32) * (high - low)
    return strengths, (gap < 3 * tick) & (part >= 0) & (part <= 1)


def _correlations(a: np.ndarray, b: np.ndarray, good: np.ndarray) -> np.ndarray:
    """(n,) correlations of patterns (n, places, B) at the good places (n, places); 0 where one does not change."""
    weight = good[..., None].astype(np.float32)
    count = weight.sum(axis=1, keepdims=True)
    a, b = ((p - (p * weight).sum(axis=1, keepdims=True) / count) * weight for p in (a, b))
    together, alone, other = (np.einsum("npb,npb->n", *pair) for pair in ((a, b), (a, a), (b, b)))
    norm = np.sqrt(alone * other)
    return np.divide(together, norm, out=np.zeros(len(a), norm.dtype), where=norm > 0)
