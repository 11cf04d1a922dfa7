"""Samples for measuring an error that may sit next to the antennas: the nearest more often than the rest, with weights.

A field turns the faster the nearer its antennas are. Where a scan passes through or close by its grid, a hundredth of
the voxels may hold most of an image's error; a few uniformly random ones miss it, or, by chance, see nothing else.
Stratified by rank of distance, few suffice, and the weighted mean is that over all.
"""

import numpy as np

_ANTENNAS = 256  # whose distance counts, at most


def near_first(pool: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count,) ranks among `pool` sorted by distance, and their weights, whose sum is 1.

    A quarter of them lies in the nearest sixteenth of the pool, the rest beyond, evenly in both. Of a pool that is no
    larger than the count, all are taken.
    """
    if pool <= count:
        return np.arange(pool), np.full(pool, 1 / pool)
    near = count // 4
    parts = (0, pool / 16, near), (pool / 16, pool, count - near)
    ranks = [low + (high - low) * (np.arange(some) + 0.5) / some for low, high, some in parts]
    weights = [np.full(some, (high - low) / pool / some) for low, high, some in parts]
    return np.concatenate(ranks).astype(np.int64), np.concatenate(weights)


def some_ends(tx: np.ndarray, rx: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) poses, and where a transmitter and a receiver of each is, (n, 3): of tx (P, T, 3) and rx (P, R, 3)."""
    pose = rng.integers(0, len(tx), _ANTENNAS)
    return (
        pose,
        tx[pose, rng.integers(0, tx.shape[1], _ANTENNAS)],
        rx[pose, rng.integers(0, rx.shape[1], _ANTENNAS)],
    )


def distances(points: np.ndarray, tx: np.ndarray, rx: np.ndarray) -> np.ndarray:
    """(V, n) distance of points (V, 3) from the nearer of two antennas, tx (n, 3) and rx (n, 3)."""

    def away(ends: np.ndarray) -> np.ndarray:
        return np.sqrt(sum(np.subtract.outer(points[:, i], ends[:, i]) ** 2 for i in range(3)))

    return np.minimum(away(tx), away(rx))
