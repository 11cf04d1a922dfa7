"""How far rows lie from where they should: the phases of single targets, followed from row to row.

Each row's image parts the targets along the row. The phase of one target from row to row is that of its distance: what
the given path does not explain is the row's displacement along the line of sight to it, or the target's own place. Both
are told at once by an extended Kalman filter over the rows, as in simultaneous localisation and mapping: the rows'
displacements change smoothly, the targets stay.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from millisight.imaging._autofocus_search import Subject
from millisight.imaging._row_offsets import lattice, row_axes, row_fields, row_lobe

_MOST_CELLS = 12_000
_MOST_TARGETS, _FAINTEST = 40, 0.03  # of the brightest target's power
_EVERY = 3  # rows looked at for targets: each third
_TARGETS, _NOISES = (10, 14, 20, 30), (0.35, 0.7)  # of the trials: how many; standard deviation of their phases [rad]
_JUDGED = 20  # targets that judge a trial
_SURROGATES = 4  # scrambled phases, each followed from one end
# Standard deviations: of a row's rate, its change and what is neither [wavelengths], its offset [frames]; of a target's
# place from row to row and in depth [wavelengths].
_RATE, _TURN, _JITTER, _OFFSET, _ACROSS, _DEPTH = 0.1, 0.05, 0.01, 0.25, 0.5, 0.4


class Histories(NamedTuple):
    """Targets as the rows see them.

    Attributes
    ----------
    fields : (R, K) complex, of each row at each target, the brightest first; mean power 1
    slopes : (R, K, 3) turning of their phases by displacements of the row [rad/m], along, from row to row, across both
    window : (W, 3) places around a target, where it may lie as well [m]
    axes : (3, 3) the three directions
    """

    fields: np.ndarray
    slopes: np.ndarray
    window: np.ndarray
    axes: np.ndarray

    def scrambled(self, rng: np.random.Generator) -> "Histories":
        """The same with phases drawn at random, as noise has them."""
        turns = rng.uniform(0, 2 * np.pi, self.fields.shape)
        return self._replace(fields=np.abs(self.fields) * np.exp(1j * turns))

    def coherence(self, moves: np.ndarray) -> float:
        """What share of the brightest targets' echoes adds up, rows displaced by `moves` (R, 3) along the axes: 0 to 1.

        Each target may lie anywhere in its window.
        """
        fields, slopes = self.fields[:, :_JUDGED], self.slopes[:, :_JUDGED]
        moved = fields * np.exp(1j * np.einsum("rki,ri->rk", slopes, moves))
        sums = np.abs(np.einsum("rk,rkw->kw", moved, np.exp(-1j * slopes @ self.window.T))).max(axis=1)
        return float(((sums**3).sum() / (np.abs(fields).sum(axis=0) ** 3).sum()) ** (1 / 3))


class Tracked(NamedTuple):
    """Displacements (P, 3) [m], the coherence of the targets then, and the best that phases drawn at random reach."""

    moves: np.ndarray
    coherence: float
    chance: float


def tracked_rows(subject: Subject, moves: np.ndarray, rng: np.random.Generator) -> Tracked | None:
    """Displacements of the rows besides `moves` (P, 3) [m]; None where there are too few targets.

    The filter may lose its way; it starts from both ends with several numbers of targets, and the most coherent wins.
    """
    seen = _histories(subject, moves)
    if seen is None:
        return None
    counts = sorted({min(count, seen.fields.shape[1]) for count in _TARGETS})
    trials = [_follow(subject, seen, *trial) for trial in product(counts, _NOISES, (False, True))]
    values = [seen.coherence(trial) for trial in trials]
    chance = 0.0
    for i in range(_SURROGATES):
        noise = seen.scrambled(rng)
        chance = max(chance, noise.coherence(_follow(subject, noise, counts[i % len(counts)], _NOISES[0], False)))
    best = trials[int(np.argmax(values))] @ seen.axes
    found = np.zeros_like(moves)
    for row, move in zip(subject.rows, best, strict=True):
        found[row.poses] = move
    return Tracked(found, max(values), chance)


def _histories(subject: Subject, moves: np.ndarray) -> Histories | None:
    axes = row_axes(subject)
    places = _targets(subject, moves, axes)
    if len(places) < 3:
        return None
    view = subject.view(moves, places)
    middles = np.array([view.places[subject.pieces.rows == r].mean(axis=0) for r in range(len(subject.rows))])
    towards = (middles[:, None] - view.points.T) @ axes.T
    slopes = 2 * np.pi * float(view.per_metre) * towards / np.linalg.norm(towards, axis=2, keepdims=True)
    fields = row_fields(view, subject.pieces)
    across, depth = np.meshgrid(np.linspace(-1.6, 1.6, 13), np.linspace(-1.6, 1.6, 7))
    window = subject.wavelength * np.stack([0 * across, across, depth], axis=-1).reshape(-1, 3)
    return Histories(fields / np.sqrt((np.abs(fields) ** 2).mean(axis=0)), slopes, window, axes)


def _targets(subject: Subject, moves: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(K, 3) places of targets [m], the brightest first: maxima of the rows' powers, added without their phases."""
    pieces = subject.pieces.thinned(_EVERY)

    def power(points: np.ndarray) -> np.ndarray:
        fields = row_fields(subject.view(moves, points, pieces), pieces)
        return (np.abs(fields) ** 2).sum(axis=0)

    fine = row_lobe(subject, axes)
    steps = np.array([fine / 1.3, 6 * subject.wavelength, 3 * subject.wavelength])
    points, _ = lattice(subject, axes, steps, _MOST_CELLS)
    values = power(points)
    chosen = _apart(points @ axes.T, values, np.array([2.5 * steps[0], 16 * subject.wavelength, np.inf]))
    places = points[chosen]
    for shrink in (1, 0.25):
        inner = np.stack(np.meshgrid([-2 / 3, 0, 2 / 3], *2 * [np.arange(-3, 4) / 3], indexing="ij"), axis=-1)
        around = (places[:, None] + (inner.reshape(-1, 3) * steps * shrink) @ axes).reshape(-1, 3)
        values = power(around).reshape(len(places), -1)
        places = around.reshape(len(places), -1, 3)[np.arange(len(places)), values.argmax(axis=1)]
    return places[_apart(places @ axes.T, values.max(axis=1), np.array([steps[0], *2 * [5 * subject.wavelength]]))]


def _apart(places: np.ndarray, values: np.ndarray, least: np.ndarray) -> list[int]:
    """The largest values that lie apart: their numbers, the largest first."""
    chosen: list[int] = []
    free = values > _FAINTEST * values.max()
    for i in np.argsort(values)[::-1]:
        if free[i]:
            chosen.append(int(i))
            free &= (np.abs(places - places[i]) >= least).any(axis=1)
            if len(chosen) == _MOST_TARGETS:
                break
    return chosen


def _follow(subject: Subject, seen: Histories, count: int, noise: float, backwards: bool) -> np.ndarray:
    """(R, 3) displacements of the rows [m] along the axes, mean 0, from the phases of the brightest `count` targets.

    The state: a row's displacement from row to row and across both with their rates, its offset along the row, and of
    each target the place (from row to row, across both) and the phase.
    """
    fields, slopes = seen.fields[:, :count], seen.slopes[:, :count]
    angles, sizes = np.angle(fields), np.clip(np.abs(fields), 0.1, 2)
    order = np.arange(len(fields))[:: -1 if backwards else 1]
    wavelength, targets = subject.wavelength, np.arange(count)
    offset = (_OFFSET * float(np.linalg.norm(subject.rows[0].step))) ** 2
    change = (_TURN * wavelength) ** 2
    across, depth, phase = 5 + targets, 5 + count + targets, 5 + 2 * count + targets
    state = np.zeros(5 + 3 * count)
    state[phase] = -angles[order[0]]
    variances = np.zeros(len(state))
    variances[2:4] = (_RATE * wavelength) ** 2
    variances[4] = offset
    variances[across], variances[depth] = (_ACROSS * wavelength) ** 2, (_DEPTH * wavelength) ** 2
    variances[phase] = (noise / sizes[order[0]]) ** 2
    covariance = np.diag(variances)
    spread = np.full(count, noise**2)
    found = np.zeros((len(fields), 3))
    for r in order[1:]:
        # Places move by their rates; offsets begin anew.
        state[:2] += state[2:4]
        state[4] = 0
        covariance[:2] += covariance[2:4]
        covariance[:, :2] += covariance[:, 2:4]
        covariance[4] = covariance[:, 4] = 0
        for place, rate in ((0, 2), (1, 3)):
            covariance[place, place] += change / 4 + (_JITTER * wavelength) ** 2
            covariance[[place, rate], [rate, place]] += change / 2
            covariance[rate, rate] += change
        covariance[4, 4] = offset

        def seen_by(values: np.ndarray, along=slopes[r]) -> np.ndarray:
            """(K, ...) turning of the phases by a state, or by each column of a matrix."""
            own = along.reshape(*along.shape, *(1,) * (values.ndim - 1))
            moved = along @ values[[4, 0, 1]]
            return moved - own[:, 1] * values[across] - own[:, 2] * values[depth] + values[phase]

        surprise = -(angles[r] + seen_by(state))
        # What all phases share lies within half a turn of what is expected, and each within half a turn of that.
        common = np.angle((sizes[r] ** 2 / spread * np.exp(1j * surprise)).sum())
        surprise = common + np.angle(np.exp(1j * (surprise - common)))
        shared = seen_by(covariance)
        expected = seen_by(shared.T)
        doubt = spread / sizes[r] ** 2
        for _ in range(2):
            gain = np.linalg.solve(expected + np.diag(doubt), shared).T
            left = surprise - seen_by(gain @ surprise)
            # Targets that fit badly count less.
            doubt = spread / sizes[r] ** 2 * (1 + left**2 / (4 * spread))
        state = state + gain @ surprise
        covariance = covariance - gain @ shared
        covariance = (covariance + covariance.T) / 2
        left = np.angle(np.exp(1j * left))
        spread = np.clip(0.97 * spread + 0.03 * np.minimum(left**2, 1.5), 0.01, 2)
        found[r] = state[4], state[0], state[1]
    return found - found.mean(axis=0)
