"""The F-score of two clouds as large as those of a 77 GHz image, against a plain form with all pairs."""

from time import perf_counter

import numpy as np
import pytest

from millisight.data import VoxelGrid
from millisight.evaluation import f_score

LEAST = 20  # times as fast as all pairs


def clouds():
    """Two clouds of 14 000 points of a voxel grid, as of a cracker box."""
    points = VoxelGrid.regular((0, 0, 0), (0.21, 0.16, 0.02), (0.0025, 0.0025, 0.01)).points
    return points, points + np.array([0.0013, -0.0007, 0.004])


def all_pairs(measured, simulated, within):
    """The plain form, by rows so that the distances fit into memory."""
    near_measured = np.zeros(len(measured), dtype=bool)
    near_simulated = np.zeros(len(simulated), dtype=bool)
    for start in range(0, len(measured), 500):
        part = measured[start : start + 500]
        far = np.sqrt(((part[:, None] - simulated[None]) ** 2).sum(axis=-1))
        near_measured[start : start + 500] = far.min(axis=1) < within
        near_simulated |= (far < within).any(axis=0)
    return near_measured.mean(), near_simulated.mean()


def seconds(function, *arguments):
    started = perf_counter()
    result = function(*arguments)
    return result, perf_counter() - started


def test_the_f_score_is_twenty_times_as_fast_as_all_pairs(benchmark):
    measured, simulated = clouds()
    expected, plain = seconds(all_pairs, measured, simulated, 0.003)
    found = benchmark(f_score, measured, simulated, 0.003)
    assert found == pytest.approx(expected)
    fast = min(seconds(f_score, measured, simulated, 0.003)[1] for _ in range(5))
    ratio = plain / fast
    print(
        f"\nF-score of {len(measured)} and {len(simulated)} points: {1e3 * fast:.1f} ms; "
        f"all pairs {plain:.2f} s; {ratio:.0f} x"
    )
    assert ratio > LEAST
