"""A mask's border follows the image's edges, which are finer than the network's pixels."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from millisight.perception import SPACING
from millisight.perception.segmentation._edges import at_edges

SIDES = 0.002, 0.002
CUT = 0.1
X, Y = np.meshgrid(np.arange(80), np.arange(70), indexing="ij")
RING = (np.hypot(X - 40, Y - 35) < 18) & (np.hypot(X - 40, Y - 35) > 6)


def level_of(inside, peak=1.0):
    """Magnitude of what is bright over these pixels, as sharp as at 77 GHz, over noise 40 dB weaker."""
    speckle = abs(np.random.default_rng(0).standard_normal(inside.shape)) + 0.5
    return peak * gaussian_filter(inside.astype(float), 0.7) * speckle + 0.01


def blurred(inside, most=0.9):
    """How probable a network of 4 mm finds it: more than the truth, and with its holes filled."""
    return np.clip(most * gaussian_filter(gaussian_filter(inside.astype(float), 3) > 0.2, 2.0, output=float), 1e-3, 1)


def f1(mask, truth):
    return 2 * (mask & truth).sum() / (mask.sum() + truth.sum())


def test_a_border_moves_to_the_edge_and_holes_open():
    probability = blurred(RING)
    mask = probability > CUT
    (found,) = at_edges([mask], probability, [CUT], level_of(RING), SIDES)
    assert f1(mask, RING) < 0.8
    assert f1(found, RING) > 0.88
    assert not found[38:42, 33:37].any()


def test_it_grows_by_no_more_than_the_networks_pixel():
    probability = np.where(np.hypot(X - 40, Y - 35) < 10, 0.9, 0.08)
    disc = np.hypot(X - 40, Y - 35) < 18
    (found,) = at_edges([probability > CUT], probability, [CUT], level_of(disc), SIDES)
    outermost = SIDES[0] * np.hypot(X - 40, Y - 35)[found].max()
    assert 0.020 < outermost < 0.020 + SPACING + SIDES[0]


def test_what_is_sure_stays_although_it_is_dark():
    dim = (X > 60) & (X < 70) & (Y > 20) & (Y < 40)
    probability = np.where(RING | dim, 0.999, 0.001)
    level = level_of(RING) + level_of(dim, 10**-1.5)
    (found,) = at_edges([probability > CUT], probability, [CUT], level, SIDES)
    assert found[dim].all()


@pytest.mark.parametrize(("wide", "long", "least"), [(4, 6, 0.79), (5, 9, 0.82), (10, 20, 0.88)])
def test_small_flat_things_are_marked_no_larger_than_they_are(wide, long, least):
    """The network is sure some millimetres beyond their edges, which the radar blurs."""
    brick = (abs(X - 40) < long) & (abs(Y - 35) < wide)
    probability = np.minimum(1.6 * blurred(brick, most=1.0), 0.99)
    mask = probability > CUT
    (found,) = at_edges([mask], probability, [CUT], gaussian_filter(brick.astype(float), 1.2) + 0.01, SIDES)
    assert f1(mask, brick) < 0.7
    assert f1(found, brick) > least


def test_a_ball_is_more_than_its_glint():
    away = np.hypot(X - 40, Y - 35)
    ball = away < 12
    probability = np.where(ball, 0.97, 0.02)
    (found,) = at_edges([ball], probability, [CUT], np.exp(-((away / 1.5) ** 2)) + 0.03 * ball + 0.003, SIDES)
    assert (found & ball).sum() > 0.9 * ball.sum()


def test_every_mask_keeps_its_own_cut():
    probability = blurred(RING)
    cuts = [0.1, 0.5, 0.8]
    found = at_edges([probability > cut for cut in cuts], probability, cuts, level_of(RING), SIDES)
    assert found[0].sum() > found[1].sum() > found[2].sum() > 0


def test_an_empty_mask_among_others_stays_empty():
    probability = blurred(RING)
    masks = [probability > CUT, np.zeros_like(RING)]
    found = at_edges(masks, probability, [CUT, CUT], level_of(RING), SIDES)
    assert found[0].any()
    assert not found[1].any()


@pytest.mark.parametrize(
    ("mask", "level", "sides"),
    [
        (np.zeros_like(RING), level_of(RING), SIDES),
        (RING, np.ones(RING.shape), SIDES),
        (RING, np.zeros(RING.shape), SIDES),
        (RING[:1], level_of(RING)[:1], (0.0, 0.002)),
    ],
    ids=["nothing", "flat", "dark", "one row"],
)
def test_where_there_is_no_edge_the_mask_is_unchanged(mask, level, sides):
    probability = np.where(mask, 0.9, 0.01)
    (found,) = at_edges([mask], probability, [CUT], level, sides)
    np.testing.assert_array_equal(found, mask)


def test_what_is_thick_and_mostly_dark_keeps_its_border():
    """A ball shines in its middle alone, and the image has an edge there that is not the ball's."""
    away = np.hypot(X - 40, Y - 35) * SIDES[0]
    probability = np.where(away < 0.032, 0.8, 0.02)
    level = level_of(away < 0.008) + 0.02 * (away < 0.032)
    (found,) = at_edges([probability > CUT], probability, [CUT], level, SIDES)
    assert (found == (probability > CUT)).all()
    thin = (away < 0.032) & (abs(X - 40) < 10)  # 4 cm wide: its border follows the image
    (found,) = at_edges([thin], np.where(thin, 0.8, 0.02), [CUT], level, SIDES)
    assert found.sum() < 0.8 * thin.sum()


def test_no_edge_is_sought_in_what_is_nearly_dark():
    """Without noise an image is steepest where it ends, far below any outline."""
    bar = (abs(X - 40) < 30) & (abs(Y - 35) < 4)
    level = gaussian_filter(bar.astype(float), 3.0) + 1e-5
    probability = blurred(bar)
    (found,) = at_edges([probability > CUT], probability, [CUT], level, SIDES)
    assert f1(found, bar) > f1(probability > CUT, bar)
