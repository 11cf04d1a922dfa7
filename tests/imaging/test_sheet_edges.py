"""Where a known lid lies, from amplitudes that are made up."""

import numpy as np
import pytest
from scipy.special import erf

from millisight.imaging._sheet_edges import LidPlace, all_of, rectangle_around, sharpened

HALF = np.array([0.05, 0.04])


def lid(x, y, turn_deg, half=HALF, *, noise=0.02):
    """The amplitude of a lid about 0, with edges 4 mm wide."""
    u, v = LidPlace(np.radians(turn_deg), -half, half).along(x[:, None], y)
    amplitude = np.prod([(erf((h - abs(w)) / 0.002) + 1) / 2 for w, h in zip((u, v), half, strict=True)], axis=0)
    return amplitude + noise * np.random.default_rng(0).random(amplitude.shape)


@pytest.mark.parametrize("axis", [np.linspace(-0.1, 0.1, 81), -0.12 + 0.003 * np.arange(81)])
@pytest.mark.parametrize(("turn_deg", "guess_deg"), [(0, 3), (0, -8), (5, 0), (20, 24), (40, 44), (-30, -33)])
def test_turn_and_edges_are_found_from_a_guess(axis, turn_deg, guess_deg):
    guess = LidPlace(np.radians(guess_deg), -HALF - 0.004, HALF + 0.002)
    found = sharpened(guess, lid(axis, axis, turn_deg), axis, axis)
    assert np.degrees(found.turn) == pytest.approx(turn_deg, abs=0.5)
    step = axis[1] - axis[0]
    np.testing.assert_allclose([-found.lower, found.upper], [HALF, HALF], atol=0.8 * step)


def test_a_straight_lid_stays_as_the_cells_tell_it():
    axis = np.linspace(-0.1, 0.1, 81)
    guess = LidPlace(0.0, -HALF - 0.004, HALF + 0.002)
    assert sharpened(guess, lid(axis, axis, 0), axis, axis) is guess
    # Beyond the image's border nothing tells whether it is turned.
    large = LidPlace(0.0, np.full(2, -0.1), np.full(2, 0.1))
    assert sharpened(large, lid(axis, axis, 0, np.array([0.3, 0.3])), axis, axis) is large


@pytest.mark.parametrize("turn_deg", [0, 25, 45, 70])
def test_the_rectangle_around_cells(turn_deg):
    x, y = 0.005 * np.arange(40), 0.005 * np.arange(44)
    u, v = LidPlace(np.radians(turn_deg), HALF, HALF).along(x[:, None] - x.mean(), y - y.mean())
    found = rectangle_around((abs(u) < HALF[0]) & (abs(v) < HALF[1]), x, y)
    assert (np.degrees(found.turn) - turn_deg + 45) % 90 - 45 == pytest.approx(0, abs=3)
    assert sorted(found.upper - found.lower) == pytest.approx([0.08, 0.1], abs=0.01)
    assert found.corners.mean(axis=0) == pytest.approx([x.mean(), y.mean()], abs=0.003)


def test_one_row_of_cells_is_in_line():
    x = 0.005 * np.arange(20)
    for found in (rectangle_around(np.ones((20, 1), dtype=bool), x, np.zeros(1)), all_of(x, np.zeros(1))):
        assert found.turn == 0
        assert found.inside(x[:, None], np.zeros(1)).all()
