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
    near = np.arange(pool) < pool // 16
    return evenly([(near, count // 4), (~near, count - count // 4)])


def evenly(groups: list[tuple[np.ndarray, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of so many members of each group, and their weights, whose sum is 1: each stands for as many of its own.

    Parameters
    ----------
    groups : which are in it, (n,) bool, each in one of them; and how many are taken. All, where there are no more
    """
    size = len(groups[0][0])
    if size <= sum(count for _, count in groups):
        return np.arange(size), np.full(size, 1 / size)
    picks, weights = [], []
    for which, count in groups:
        members = np.flatnonzero(which)
        some = min(count, len(members))
        picks.append(members[((np.arange(some) + 0.5) * len(members) / max(some, 1)).astype(np.int64)])
        weights.append(np.full(some, len(members) / size / max(some, 1)))
    return np.concatenate(picks), np.concatenate(weights)


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
