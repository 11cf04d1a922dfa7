"""The plan of factorised backprojection: sub-apertures' sizes and coarse grids of the least cost within a tolerance.

Nothing is assumed of the geometry. The error of carrying a sub-aperture's field from a coarse axis to the voxels is
measured: for waves of random channels and frequencies at random voxels, the eight taps are summed and compared with the
wave itself, in float64. Voxels and antennas that are near each other are taken more often than the rest (`_near`). That
sees what a bound by local frequencies misses: wavefronts that bend across the taps, axes that reach beyond the
antennas, taps that lie to one side at the rim.
"""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Capture
from millisight.imaging._near import distances, near_first, some_ends
from millisight.imaging._taps import TAPS, taps_at

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
    far, caches : a voxel more, where the fields of one largest sub-aperture's parts take more than `caches` [bytes]
    part : a sub-aperture in one level
    top : what is between kernels, for each largest sub-aperture and level
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


COSTS = {
    "cpu": Costs(1.35, 1.3, 1.7, 0.5, 1.5, 0.5, 3e7, 2000.0, 400_000.0),
    # Of an H100: pairs and `top` as `benchmarks/gpu.py` has them, the rest guessed, and small beside starting kernels.
    "cuda": Costs(0.004, 0.004, 0.1, 0.05, 0.1, 0.0, 3e7, 100.0, 3_500_000.0),
}

_LEAST_GAIN = 1.3
_PROMISED = 1.2  # times that, where only local frequencies were asked
_LEAST_CHANNELS = 100
_LEAST_PAIRS = 2e8  # of voxels and channels: below, a plan costs more than it saves

_SPARSE = 16  # cubes per place beyond which those with a place in them are found by sorting

_VOXELS, _WAVES = 64, 16  # of a probe, and waves at each voxel
_POOL = 1024  # random voxels of which those are taken
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
    """

    levels: tuple[Level, ...]
    order: tuple[int, ...]
    gain: float
    error: float = 0.0
    band: float = _BANDS[0][0]


class _Scan(NamedTuple):
    """What of a capture decides the plan, in the plan's order of axes."""

    tx: np.ndarray
    rx: np.ndarray
    middle: np.ndarray
    axes: tuple[np.ndarray, ...]
    frequencies: np.ndarray  # over c [1/m]
    carrier: float


class _Step(NamedTuple):
    """A candidate level, the number of its sub-apertures, and the errors of its two axes."""

    level: Level
    count: int
    errors: tuple[float, float]


def make_plan(
    tx: np.ndarray,
    rx: np.ndarray,
    axes: tuple[np.ndarray, ...],
    capture: Capture,
    tolerance: float,
    *,
    device: str = "cpu",
    seed: int = 0,
) -> Plan | None:
    """The cheapest levels for antennas tx (P, T, 3), rx (P, R, 3) and grid axes [m] whose interpolations together err
    by no more than `tolerance`; None where direct backprojection is cheaper on that device."""
    channels, costs = capture.channels, COSTS[device]
    pairs = channels * float(np.prod([len(a) for a in axes]))
    direct = costs.direct * pairs
    middle = middles(tx, rx)
    # Coarse axes pay most where there are many voxels; the axis with the fewest stays as it is, innermost in memory.
    order = tuple(int(a) for a in np.argsort([-len(a) for a in axes], kind="stable"))
    if (
        np.ptp(middle, axis=0).max() == 0
        or channels < _LEAST_CHANNELS
        or len(axes[order[0]]) <= TAPS
        or pairs < _LEAST_PAIRS
    ):
        return None
    turn = np.array(order)
    frequencies = capture.radar.waveform.frequencies / SPEED_OF_LIGHT
    scan = _Scan(
        tx[..., turn], rx[..., turn], middle[:, turn], tuple(axes[a] for a in order), frequencies,
        capture.radar.waveform.center_frequency / SPEED_OF_LIGHT,
    )  # fmt: skip
    probe = _probe(scan, np.random.default_rng(seed))
    # Every axis of every level may make its share of the error. Three levels are typical; what they come to is known
    # once they are chosen.
    share = tolerance / np.sqrt(6)
    for attempt in range(4):
        band = next(b for b, floor in _BANDS if share >= floor)
        if attempt == 0:
            # What local frequencies promise costs little, and the probe seldom finds axes that are much coarser.
            promised = _candidates(scan, probe, None, band, seed)
            if _cheapest(promised, scan, order, channels, _PROMISED * direct, band, costs) is None:
                return None
        plan = _cheapest(_candidates(scan, probe, share, band, seed), scan, order, channels, direct, band, costs)
        if plan is None or plan.error <= tolerance:
            return plan
        share *= 0.9 * tolerance / plan.error
    return None


def _cheapest(
    steps: list[_Step],
    scan: _Scan,
    order: tuple[int, ...],
    channels: int,
    direct: float,
    band: float,
    costs: Costs,
) -> Plan | None:
    """The ladder of neighbouring levels of the least estimated cost, if that is below direct backprojection's."""
    best, cheapest = None, direct / _LEAST_GAIN
    depth = len(scan.axes[2])
    first = costs.first + costs.short / depth
    for leaf in range(len(steps)):
        for top in range(leaf + 1):
            chosen = steps[top : leaf + 1]
            shapes = [(len(scan.axes[0]), len(scan.axes[1])), *(tuple(map(len, s.level.axes)) for s in chosen)]
            cost = costs.leaf * channels * shapes[-1][0] * shapes[-1][1] * depth
            for step, target, own in zip(chosen, shapes, shapes[1:], strict=False):
                held = 8 * depth * own[0] * own[1] * step.count / chosen[0].count
                each = costs.merge + (costs.far if held > costs.caches else 0)
                cost += step.count * depth * target[0] * (each * target[1] + first * own[1])
                cost += costs.part * step.count + costs.top * chosen[0].count
            if cost < cheapest:
                best, cheapest = chosen, cost
    if best is None:
        return None
    error = float(np.sqrt(sum(e**2 for step in best for e in step.errors)))
    return Plan(tuple(step.level for step in reversed(best)), order, float(direct / cheapest), error, band)


def _candidates(scan: _Scan, probe: "_Probe", share: float | None, band: float, seed: int) -> list[_Step]:
    """Levels of sub-apertures of half the extent, a quarter, …, down to about one position each; without a `share` of
    the error, on axes as coarse as local frequencies promise."""
    rng = np.random.default_rng(seed)
    extent = np.ptp(scan.middle, axis=0).max()
    corner = scan.middle.min(axis=0)
    steps: list[_Step] = []
    most = [len(axis) for axis in scan.axes[:2]]
    for halvings in range(1, 12):
        size = float(extent / 2**halvings * (1 + 1e-9))
        cells = cells_of(scan.middle, corner, size)
        count = int(cells.max()) + 1
        if halvings > 1 and count > len(scan.middle) / 1.5:
            break
        if steps and count == steps[-1].count:
            continue
        waves = probe._replace(centers=means_of(scan.middle, cells)[cells[probe.pose]])
        found = []
        for i in (0, 1):
            # The field is wanted where the next larger sub-apertures' axis lies, a little beyond the grid.
            larger = steps[-1].level.axes[i] if steps else scan.axes[i]
            wanted = larger[1:-1] if len(larger) > TAPS else larger
            found.append(_coarsest(scan.axes[i], larger, i, most[i], waves.along(i, wanted, rng), share, band))
        steps.append(_Step(Level(size, (found[0][0], found[1][0])), count, (found[0][1], found[1][1])))
        # Smaller sub-apertures never need a finer axis.
        most = [min(n, len(axis)) for n, (axis, _) in zip(most, found, strict=True)]
    return steps


class _Probe(NamedTuple):
    """Waves (V, n) whose interpolation is tried, n of them at each of V voxels, the nearest voxels first.

    Attributes
    ----------
    points : (V, 3) [m]
    pose : (V n,) of the wave
    tx, rx, centers : (V n, 3) antennas, and the centre of their sub-aperture [m]
    waves : (V n,) frequency over c [1/m]
    voxel_weights, wave_weights : (V,) and (n,), sums 1
    carrier : over c [1/m]
    """

    points: np.ndarray
    pose: np.ndarray
    tx: np.ndarray
    rx: np.ndarray
    centers: np.ndarray
    waves: np.ndarray
    voxel_weights: np.ndarray
    wave_weights: np.ndarray
    carrier: float

    def along(self, i: int, wanted: np.ndarray, rng: np.random.Generator) -> "_Probe":
        """The same with places along axis i that are drawn from an axis (n,), its ends more often than the rest; the
        nearest stay where they are."""
        points = self.points.copy()
        near = len(points) // 4
        # What would lie beyond an end is folded back: next to it taps lie to one side, while it is a tap's own place.
        part = np.abs(rng.uniform(-0.06, 1.06, len(points) - near))
        part = np.minimum(part, 2 - part)
        points[near:, i] = np.interp(part * (len(wanted) - 1), np.arange(len(wanted)), wanted)
        return self._replace(points=points)

    def error(self, i: int, coarse: np.ndarray, band: float) -> float:
        """Relative rms error of carrying the waves from a coarse axis i to their points: over all voxels, or half of
        that over the worst tenth of them, if that is more."""
        from millisight.imaging._kernels import interpolation_errors

        points = np.repeat(self.points, len(self.wave_weights), axis=0)
        base, weights = taps_at(coarse, points[:, i], band)
        squares = np.empty(len(points))
        interpolation_errors(
            points, self.tx, self.rx, self.centers, self.waves, self.carrier, i, coarse, base, weights, squares
        )
        each = squares.reshape(len(self.points), -1) @ self.wave_weights
        worst = np.argsort(-each)
        before = np.cumsum(self.voxel_weights[worst]) - self.voxel_weights[worst]
        tenth = np.clip(0.1 - before, 0, self.voxel_weights[worst])
        return float(np.sqrt(max(each @ self.voxel_weights, each[worst] @ tenth / 0.1 / 4)))

    def rate(self, i: int) -> float:
        """How fast nearly all of the waves turn along axis i [cycles/m]."""
        points = np.repeat(self.points, len(self.wave_weights), axis=0)

        def slope(ends: np.ndarray) -> np.ndarray:
            away = points - ends
            return away[:, i] / np.maximum(np.linalg.norm(away, axis=1), 1e-12)

        turns = np.abs(self.waves * (slope(self.tx) + slope(self.rx)) - 2 * self.carrier * slope(self.centers))
        order = np.argsort(turns)
        share = np.cumsum(np.outer(self.voxel_weights, self.wave_weights).ravel()[order])
        return float(turns[order[np.searchsorted(share, 0.97)]])


def _probe(scan: _Scan, rng: np.random.Generator) -> _Probe:
    """Waves at random voxels, with their sub-apertures' centres still to be told."""
    pool = np.stack([rng.choice(axis, _POOL) for axis in scan.axes], axis=1)
    pose, tx, rx = some_ends(scan.tx, scan.rx, rng)
    away = distances(pool, tx, rx)
    ranks, voxel_weights = near_first(_POOL, _VOXELS)
    voxels = np.argsort(away.min(axis=1))[ranks]
    ranks, wave_weights = near_first(len(pose), _WAVES)
    ends = np.argsort(away[voxels], axis=1)[:, ranks].ravel()
    # Both ends of the band as often as all that lies between.
    part = np.clip(rng.uniform(-0.5, 1.5, len(ends)), 0, 1)
    waves = scan.frequencies[0] + part * (scan.frequencies[-1] - scan.frequencies[0])
    return _Probe(
        pool[voxels], pose[ends], tx[ends], rx[ends], tx[ends], waves, voxel_weights, wave_weights, scan.carrier
    )


def _coarsest(
    fine: np.ndarray, larger: np.ndarray, i: int, most: int, probe: _Probe, share: float | None, band: float
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
    cube = np.floor((places - corner) / size).astype(np.int64)
    one = np.ravel_multi_index(tuple(cube.T), tuple(cube.max(axis=0) + 1))
    if one.max(initial=0) > _SPARSE * len(one):
        return np.unique(one, return_inverse=True)[1].reshape(-1)
    taken = np.zeros(one.max(initial=0) + 1, dtype=bool)  # a table is ten times as fast as sorting
    taken[one] = True
    return (np.cumsum(taken) - 1)[one]


def means_of(places: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(cells, 3) mean place of each cell."""
    return np.stack([np.bincount(cells, places[:, i]) for i in range(3)], axis=1) / np.bincount(cells)[:, None]
