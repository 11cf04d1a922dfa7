"""What interpolating fields of sub-apertures errs by, measured.

The error of carrying a field from a coarse axis to the voxels is measured for waves of random channels and frequencies
at random voxels: the eight taps are summed and compared with the wave itself, in float64. Voxels and antennas that are
near each other are taken more often than the rest (`_near`). That sees what a bound by local frequencies misses:
wavefronts that bend across the taps, axes that reach beyond the antennas, taps that lie to one side at the rim.
"""

from typing import NamedTuple

import numpy as np

from millisight.imaging._near import distances, near_first, some_ends
from millisight.imaging._taps import taps_at

_VOXELS, _WAVES = 64, 16  # of a probe, and waves at each voxel
_POOL = 1024  # random voxels of which those are taken


class Scan(NamedTuple):
    """What of a capture decides the plan, in the plan's order of axes."""

    tx: np.ndarray
    rx: np.ndarray
    axes: tuple[np.ndarray, ...]
    frequencies: np.ndarray  # over c [1/m]
    carrier: float


class Probe(NamedTuple):
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

    def along(self, i: int, wanted: np.ndarray, rng: np.random.Generator) -> "Probe":
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


def probe_of(scan: Scan, rng: np.random.Generator) -> Probe:
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
    return Probe(
        pool[voxels], pose[ends], tx[ends], rx[ends], tx[ends], waves, voxel_weights, wave_weights, scan.carrier
    )
