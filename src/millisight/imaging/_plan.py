"""The plan of factorised backprojection: sub-apertures' sizes and coarse grids of the least cost within a tolerance.

Nothing is assumed of the geometry: what interpolating a sub-aperture's field errs by is measured (`_probe`). Where a
grid is deep its parts are imaged by plans of their own: further from the antennas a field turns less, and needs fewer
points.
"""

import itertools
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Capture
from millisight.imaging._probe import Probe, Scan, probe_of
from millisight.imaging._taps import TAPS

# Fractions of the Nyquist frequency below which the interpolation's weights are optimal, and the error they make there
# even so: the wider the band the coarser the axis, and the larger the error.
_BANDS = ((0.6, 1.3e-3), (0.5, 2.6e-4), (0.4, 0.0))


class Costs(NamedTuple):
    """What parts of the work cost on a device, one core of a CPU or a whole GPU [ns].

    Attributes
    ----------
    leaf, direct : a voxel-channel pair in a leaf and in direct backprojection
    merge : a voxel of a merged field
    first, short : a voxel that is interpolated along the first axis alone; a row of them along the innermost axis
    far, caches : a voxel more, where the fields of one group take more than `caches` [bytes]
    part : a sub-aperture in one level
    top : what is between kernels, for each group and level
    parts : of a grid along its innermost axis at most, each of which has a plan of its own; more cost more kernels
    """

    leaf: float
    direct: float
    merge: float
    first: float
    short: float
    far: float
    caches: float
    part: float
    top: float
    parts: int


COSTS = {
    "cpu": Costs(1.35, 1.3, 1.7, 0.5, 1.5, 0.5, 3e7, 2000.0, 400_000.0, 4),
    # Of an H100: pairs and `top` as `benchmarks/gpu.py` has them, the rest guessed, and small beside starting kernels.
    "cuda": Costs(0.004, 0.004, 0.1, 0.05, 0.1, 0.0, 3e7, 100.0, 3_500_000.0, 1),
}

_LEAST_GAIN = 1.3
_PROMISED = 1.2  # times that, where only local frequencies were asked
_LEAST_CHANNELS = 100
_LEAST_PAIRS = 2e8  # of voxels and channels: below, a plan costs more than it saves

_SPARSE = 16  # cubes per place beyond which those with a place in them are found by sorting

# Of `Planner.parts`: how the distance from the antennas grows over one; the least voxels of one; the
# antennas that are asked, at most.
_DEEP, _THIN, _SOME = 1.35, 8, 256

_MARGIN, _NARROW = 2, 1  # coarse steps that an axis reaches beyond the grid, or where that is enough


class Level(NamedTuple):
    """Sub-apertures of one size: their side [m], and the two coarse coordinate axes of their fields [m]."""

    size: float
    axes: tuple[np.ndarray, np.ndarray]


class Plan(NamedTuple):
    """How an image is factorised.

    Attributes
    ----------
    levels : from the smallest sub-apertures up
    order : of the grid's axes; the last one stays as fine as it is
    gain : estimated cost of direct backprojection over that of the plan
    error : relative L2 error that all interpolations together make, as probed
    band : fraction of the Nyquist frequency below which the weights are optimal
    group : side of squares of positions that are imaged one after another [m]: what is held at a time
    """

    levels: tuple[Level, ...]
    order: tuple[int, ...]
    gain: float
    error: float = 0.0
    band: float = _BANDS[0][0]
    group: float = np.inf


class _Rung(NamedTuple):
    """Sub-apertures of one size [m]: their number, that of each pose's (P,), and their mean places (count, 3) [m]."""

    size: float
    count: int
    cells: np.ndarray
    means: np.ndarray


class _Step(NamedTuple):
    """A candidate level, the number of its sub-apertures, and the errors of its two axes."""

    level: Level
    count: int
    errors: tuple[float, float]


class Planner:
    """Makes plans for antennas tx (P, T, 3), rx (P, R, 3) [m] of a capture, on a device.

    What positions alone decide is worked out once for all plans.
    """

    def __init__(self, tx: np.ndarray, rx: np.ndarray, capture: Capture, *, device: str = "cpu", seed: int = 0) -> None:
        self.tx, self.rx, self.channels, self.costs, self.seed = tx, rx, capture.channels, COSTS[device], seed
        self.middle = middles(tx, rx)
        self.frequencies = capture.radar.waveform.frequencies / SPEED_OF_LIGHT
        self.carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT

    @cached_property
    def rungs(self) -> list[_Rung]:
        """Sub-apertures of half the extent, a quarter, ..., down to about one position each."""
        extent, corner, rungs = np.ptp(self.middle, axis=0).max(), self.middle.min(axis=0), []
        for halvings in range(1, 12):
            size = float(extent / 2**halvings * (1 + 1e-9))
            cells = cells_of(self.middle, corner, size)
            count = int(cells.max()) + 1
            if halvings > 1 and count > len(self.middle) / 1.5:
                break
            if not rungs or count != rungs[-1].count:
                rungs.append(_Rung(size, count, cells, means_of(self.middle, cells)))
        return rungs

    def plan(self, axes: tuple[np.ndarray, ...], tolerance: float) -> Plan | None:
        """The cheapest levels for grid axes [m] whose interpolations together err by no more than `tolerance`; None
        where direct backprojection is cheaper."""
        job, direct = self._job(axes), self.costs.direct * self._pairs(axes)
        if job is None:
            return None
        # Every axis of every level may make its share of the error. Three levels are typical; what they come to is
        # known once they are chosen.
        share = tolerance / np.sqrt(6)
        for attempt in range(4):
            band = next(b for b, floor in _BANDS if share >= floor)
            # What local frequencies promise costs little, and the probe seldom finds axes that are much coarser.
            if attempt == 0 and self._cheapest(job, None, band, _PROMISED * direct) is None:
                return None
            plan = self._cheapest(job, share, band, direct)
            if plan is None or plan.error <= tolerance:
                return plan
            share *= 0.9 * tolerance / plan.error
        return None

    def parts(self, axes: tuple[np.ndarray, ...]) -> list[slice]:
        """Slices of the innermost axis, of which each is to have a plan of its own.

        Over each, the distance from the nearest antenna grows by `_DEEP` or somewhat more or less; one slice where it
        does not go one way along the axis.
        """
        inner = order_of(axes)[2]
        some = self.middle[:: len(self.middle) // _SOME + 1]
        ends = np.array([[a.min(), a.max()] for a in axes])
        beside = np.maximum(np.maximum(ends[:, 0] - some, some - ends[:, 1]), 0)
        beside[:, inner] = 0
        apart = np.square(np.subtract.outer(axes[inner], some[:, inner])) + np.square(beside).sum(axis=1)
        away = np.sqrt(apart.min(axis=1))
        depth, turned = len(away), away[0] > away[-1]
        away = away[::-1] if turned else away
        nearest = max(away[0], 0.01 * away[-1])
        count = round(np.log(away[-1] / nearest) / np.log(_DEEP)) if nearest > 0 else 0
        count = min(count, self.costs.parts, depth // _THIN)
        if count < 2 or (np.diff(away) < 0).any():
            return [slice(0, depth)]
        edges = np.searchsorted(away, nearest * (away[-1] / nearest) ** (np.arange(1, count) / count))
        edges = np.clip(edges, _THIN * np.arange(1, count), depth - _THIN * np.arange(count - 1, 0, -1))
        edges = sorted({0, *edges.tolist(), depth})  # some meet where planes lie unevenly
        slices = [slice(*ends) for ends in itertools.pairwise(edges)]
        return [slice(depth - part.stop, depth - part.start) for part in slices[::-1]] if turned else slices

    def _pairs(self, axes: tuple[np.ndarray, ...]) -> float:
        """Of voxels and channels."""
        return self.channels * float(np.prod([len(a) for a in axes]))

    def _job(self, axes: tuple[np.ndarray, ...]) -> "_Job | None":
        """What a plan is made of; None where none can pay."""
        order = order_of(axes)
        if (
            np.ptp(self.middle, axis=0).max() == 0
            or self.channels < _LEAST_CHANNELS
            or len(axes[order[0]]) <= TAPS
            or self._pairs(axes) < _LEAST_PAIRS
        ):
            return None
        turn = np.array(order)
        scan = Scan(
            self.tx[..., turn], self.rx[..., turn], tuple(axes[a] for a in order), self.frequencies, self.carrier
        )  # fmt: skip
        return _Job(order, scan, probe_of(scan, np.random.default_rng(self.seed)))

    def _cheapest(self, job: "_Job", share: float | None, band: float, direct: float) -> Plan | None:
        steps = _candidates(job.scan, job.probe, self.rungs, np.array(job.order), share, band, self.seed)
        return _cheapest(steps, job.scan, job.order, self.channels, direct, band, self.costs)


class _Job(NamedTuple):
    """A grid's order of axes, its scan in that order, and the waves that are tried."""

    order: tuple[int, ...]
    scan: Scan
    probe: Probe


def part_of(axes: tuple[np.ndarray, ...], axis: int, part: slice) -> tuple[np.ndarray, ...]:
    """Grid axes of which one is cut."""
    return *axes[:axis], axes[axis][part], *axes[axis + 1 :]


def order_of(axes: Sequence[np.ndarray]) -> tuple[int, ...]:
    """A plan's order of a grid's axes: coarse ones pay most where there are many voxels; the axis with the fewest stays
    as it is, innermost in memory."""
    return tuple(int(a) for a in np.argsort([-len(a) for a in axes], kind="stable"))


def _cheapest(
    steps: list[_Step],
    scan: Scan,
    order: tuple[int, ...],
    channels: int,
    direct: float,
    band: float,
    costs: Costs,
) -> Plan | None:
    """The ladder of neighbouring levels of the least estimated cost, if that is below direct backprojection's."""
    best, cheapest, size = None, direct / _LEAST_GAIN, 0.0
    depth = len(scan.axes[2])
    first = costs.first + costs.short / depth
    for leaf in range(len(steps)):
        for top in range(leaf + 1):
            chosen = steps[top : leaf + 1]
            shapes = [(len(scan.axes[0]), len(scan.axes[1])), *(tuple(map(len, s.level.axes)) for s in chosen)]
            cost = costs.leaf * channels * shapes[-1][0] * shapes[-1][1] * depth
            held = [8 * depth * own[0] * own[1] * step.count for step, own in zip(chosen, shapes[1:], strict=True)]
            group = _group(steps[: top + 1], max(held), costs.caches)
            for step, target, own, fields in zip(chosen, shapes, shapes[1:], held, strict=False):
                each = costs.merge + (costs.far if fields / group.count > costs.caches else 0)
                cost += step.count * depth * target[0] * (each * target[1] + first * own[1])
                cost += costs.part * step.count + costs.top * group.count
            if cost < cheapest:
                best, cheapest, size = chosen, cost, group.level.size
    if best is None:
        return None
    error = float(np.sqrt(sum(e**2 for step in best for e in step.errors)))
    return Plan(tuple(step.level for step in reversed(best)), order, float(direct / cheapest), error, band, size)


def _group(steps: list[_Step], fields: float, caches: float) -> _Step:
    """Of `steps`, largest first, the first whose share of the fields of all positions fits the caches, else the last:
    one of its sub-apertures after another is imaged. Never all positions at once, or no progress would show."""
    return next((step for step in steps if fields / step.count <= caches), steps[-1])


def _candidates(
    scan: Scan, probe: Probe, rungs: list[_Rung], turn: np.ndarray, share: float | None, band: float, seed: int
) -> list[_Step]:
    """Levels of sub-apertures, largest first; without a `share` of the error, on axes as coarse as local frequencies
    promise."""
    rng = np.random.default_rng(seed)
    steps: list[_Step] = []
    most = [len(axis) for axis in scan.axes[:2]]
    for rung in rungs:
        waves = probe._replace(centers=rung.means[rung.cells[probe.pose]][:, turn])
        found = []
        for i in (0, 1):
            # The field is wanted where the next larger sub-apertures' axis lies, a little beyond the grid.
            larger = steps[-1].level.axes[i] if steps else scan.axes[i]
            wanted = larger[1:-1] if len(larger) > TAPS else larger
            found.append(_coarsest(scan.axes[i], larger, i, most[i], waves.along(i, wanted, rng), share, band))
        steps.append(_Step(Level(rung.size, (found[0][0], found[1][0])), rung.count, (found[0][1], found[1][1])))
        # Smaller sub-apertures never need a finer axis.
        most = [min(n, len(axis)) for n, (axis, _) in zip(most, found, strict=True)]
    return steps


def _coarsest(
    fine: np.ndarray, larger: np.ndarray, i: int, most: int, probe: Probe, share: float | None, band: float
) -> tuple[np.ndarray, float]:
    """The axis of the fewest points, less than `most`, from which the probe's waves are carried within `share`, and
    what they err by; without a share, as few as local frequencies promise. Where there is none: that of the next
    larger sub-apertures, to which nothing is interpolated then."""
    if len(fine) <= TAPS:
        return larger, 0.0

    def tried(count: int, margin: int = _MARGIN) -> float:
        return probe.error(i, coarse_axis(fine, count, margin), band)

    promised = np.ceil((fine[-1] - fine[0]) * probe.rate(i) / (0.5 * band)) + 1 + 2 * _MARGIN
    count = int(np.clip(promised, TAPS, most))
    if share is None:
        return (larger, 0.0) if count >= most else (coarse_axis(fine, count, _MARGIN), 0.0)
    error = tried(count)
    # The error falls by a hundred within a third of the step: a few tries find the edge.
    while error > share:
        if count >= most:
            return larger, 0.0
        count = min(most, max(count + 1, int(count * 1.08)))
        error = tried(count)
    while count > TAPS:
        fewer = max(TAPS, min(count - 1, int(count / 1.06)))
        less = tried(fewer)
        if less > share:
            break
        count, error = fewer, less
    # A narrower rim, at the same step.
    fewer = max(TAPS, count - 2 * (_MARGIN - _NARROW))
    less = tried(fewer, _NARROW)
    if less <= share:
        return coarse_axis(fine, fewer, _NARROW), less
    return (larger, 0.0) if count >= most else (coarse_axis(fine, count, _MARGIN), error)


def coarse_axis(fine: np.ndarray, count: int, margin: int) -> np.ndarray:
    """`count` even coordinates that reach `margin` steps beyond `fine` at both ends."""
    step = (fine[-1] - fine[0]) / (count - 1 - 2 * margin)
    return fine[0] + step * (np.arange(count) - margin)


def middles(tx: np.ndarray, rx: np.ndarray) -> np.ndarray:
    """(P, 3) a pose's phase centre: half way between the means of its transmitters and its receivers."""
    return (tx.mean(axis=1) + rx.mean(axis=1)) / 2


def cells_of(places: np.ndarray, corner: np.ndarray, size: float) -> np.ndarray:
    """(P,) number of the cube of side `size` that each place lies in, counted without gaps."""
    one = np.zeros(len(places), dtype=np.int64)
    for place, start in zip(places.T, corner, strict=True):
        along = np.floor((place - start) / size).astype(np.int64)
        one = one * (along.max(initial=0) + 1) + along
    if one.max(initial=0) > _SPARSE * len(one):
        return np.unique(one, return_inverse=True)[1].reshape(-1)
    taken = np.zeros(one.max(initial=0) + 1, dtype=bool)  # a table is ten times as fast as sorting
    taken[one] = True
    return (np.cumsum(taken) - 1)[one]


def means_of(places: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(cells, 3) mean place of each cell."""
    return np.stack([np.bincount(cells, places[:, i]) for i in range(3)], axis=1) / np.bincount(cells)[:, None]
