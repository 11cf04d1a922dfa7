"""The match of range profiles: its value by closed forms, its slope by finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from millisight.core import SPEED_OF_LIGHT
from millisight.geometry import range_match

FREQUENCIES = 77.5e9 + np.linspace(0, 3e9, 40)
MIDDLE = np.array([0.01, 0.02, 0.0])


@pytest.fixture
def case():
    """Points, amplitudes of 7 channels with some hidden, antennas, frames of other points."""
    random = np.random.default_rng(0)
    points, amplitudes = 0.03 * random.normal(size=(30, 3)), random.random((7, 30))
    amplitudes[amplitudes < 0.3] = 0
    tx = 0.05 * random.normal(size=(7, 3)) + [0, 0, 0.25]
    rx = tx + np.array([0.01, 0, 0])
    frames = random.normal(size=(7, 40)) + 1j * random.normal(size=(7, 40))
    return points, amplitudes, tx, rx, frames


def phasors(points, amplitudes, tx, rx, offset):
    paths = np.linalg.norm(points - tx[:, None], axis=2) + np.linalg.norm(points - rx[:, None], axis=2) + offset
    waves = np.exp(-2j * np.pi * paths[..., None] * FREQUENCIES / SPEED_OF_LIGHT)
    return (amplitudes[..., None] * waves).sum(axis=1)


def test_frames_of_the_pose_itself_match_wholly_and_are_a_maximum(case):
    points, amplitudes, tx, rx, _ = case
    frames = phasors(points, amplitudes, tx, rx, 0.15)
    frames *= np.exp(2j * np.pi * np.random.default_rng(1).random((7, 1)))  # a phase of each channel is no matter
    found = range_match(points, amplitudes, MIDDLE, tx, rx, FREQUENCIES, frames, 0.15)
    assert found.value == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(found.gradient, 0, atol=1e-9)
    moved = range_match(points + np.array([0, 0, 0.02]), amplitudes, MIDDLE, tx, rx, FREQUENCIES, frames, 0.15)
    assert moved.value < 0.9


@pytest.mark.parametrize("k", range(6))
def test_the_slope_is_that_of_finite_differences(case, k):
    points, amplitudes, tx, rx, frames = case
    gradient = range_match(points, amplitudes, MIDDLE, tx, rx, FREQUENCIES, frames, 0.1).gradient
    step = np.zeros(6)
    step[k] = 1e-8 if k < 3 else 1e-7

    def at(sign):
        turned = (points - MIDDLE) @ Rotation.from_rotvec(sign * step[3:]).as_matrix().T
        moved = turned + MIDDLE + sign * step[:3]
        return range_match(moved, amplitudes, MIDDLE, tx, rx, FREQUENCIES, frames, 0.1).value

    assert abs(gradient[k]) > 1e-3
    assert (at(1) - at(-1)) / (2 * step[k]) == pytest.approx(gradient[k], rel=1e-5)


def test_nothing_lit_matches_nothing(case):
    points, amplitudes, tx, rx, frames = case
    found = range_match(points, 0 * amplitudes, MIDDLE, tx, rx, FREQUENCIES, frames)
    assert found.value == 0
    np.testing.assert_array_equal(found.gradient, np.zeros(6))
