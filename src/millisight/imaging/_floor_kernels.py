"""The inner loop of the published imaging, compiled by Numba."""

import math

from millisight.core import inline, kernel, phase, prange

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)


@kernel()
def add_bins(profiles, tx, rx, points, path_offset, bins, wavenumber, sums):
    """sums[v] += over channels of the bin at or below the path length times its phase, float64.

    profiles (P, T, R, K), tx (P, T, 3), rx (P, R, 3), points (V, 3); `bins` per metre of path, `wavenumber` in cycles
    per metre. Beyond the last bin there is nothing.
    """
    poses, transmitters, receivers, count = profiles.shape
    for v in prange(len(points)):
        total = 0.0 + 0.0j
        x, y, z = points[v]
        for p in range(poses):
            for t in range(transmitters):
                to = _distance(x - tx[p, t, 0], y - tx[p, t, 1], z - tx[p, t, 2])
                for r in range(receivers):
                    fro = _distance(x - rx[p, r, 0], y - rx[p, r, 1], z - rx[p, r, 2])
                    path = to + fro + path_offset
                    place = math.floor(bins * path)
                    if 0 <= place < count:
                        angle = phase.TAU * _wrapped(wavenumber * path)
                        total += profiles[p, t, r, place] * complex(math.cos(angle), math.sin(angle))
        sums[v] += total
