"""Mask metrics: by hand, against their definitions on random masks, and where masks are empty."""

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.data import Mask, PixelGrid
from millisight.evaluation import METRICS, MaskScores, medians, score_mask

NAMES = ("precision", "recall", "f1", "iou", "accuracy")
GRID = PixelGrid(x=np.arange(4) * 0.01, y=np.arange(5) * 0.01)


def mask(inside, grid=GRID):
    return Mask(grid_xy=grid, inside=inside)


def of_pixels(*pixels):
    inside = np.zeros(GRID.shape, bool)
    for pixel in pixels:
        inside[pixel] = True
    return mask(inside)


def values(found, truth):
    scores = score_mask(found, truth)
    assert tuple(scores) == NAMES == METRICS.names()
    return tuple(scores.values())


def test_by_hand():
    truth = of_pixels((0, 0), (0, 1), (0, 2), (1, 0))
    found = of_pixels((0, 0), (0, 1), (3, 4))
    assert values(found, truth) == pytest.approx((2 / 3, 2 / 4, 4 / 7, 2 / 5, 17 / 20))


def test_relations_between_the_metrics():
    rng = np.random.default_rng(0)
    for _ in range(20):
        found, truth = (mask(rng.random(GRID.shape) < share) for share in rng.uniform(0.2, 0.8, 2))
        scores = score_mask(found, truth)
        back = score_mask(truth, found)
        assert (back.precision, back.recall) == pytest.approx((scores.recall, scores.precision))
        assert [back[name] for name in NAMES[2:]] == pytest.approx([scores[name] for name in NAMES[2:]])
        assert scores.f1 == pytest.approx(2 * scores.iou / (1 + scores.iou))
        outside = score_mask(mask(~found.inside), mask(~truth.inside))
        assert outside.accuracy == pytest.approx(scores.accuracy)


@pytest.mark.parametrize(
    ("found", "truth", "expected"),
    [
        ((), (), (1, 1, 1, 1, 1)),
        ((), ((1, 1),), (0, 0, 0, 0, 19 / 20)),
        (((1, 1),), (), (0, 0, 0, 0, 19 / 20)),
        (((1, 1),), ((2, 2),), (0, 0, 0, 0, 18 / 20)),
        (((1, 1),), ((1, 1),), (1, 1, 1, 1, 1)),
    ],
)
def test_empty_masks_have_scores(found, truth, expected):
    assert values(of_pixels(*found), of_pixels(*truth)) == pytest.approx(expected)


def test_masks_of_different_grids_are_refused():
    moved = PixelGrid(x=GRID.x + 0.001, y=GRID.y)
    longer = PixelGrid(x=GRID.x, y=np.arange(6) * 0.01)
    for grid in (moved, longer):
        with pytest.raises(InputError, match="different grids"):
            score_mask(of_pixels((0, 0)), mask(np.zeros(grid.shape, bool), grid))
    rounded = PixelGrid(x=GRID.x + 1e-12, y=GRID.y)
    assert score_mask(of_pixels((0, 0)), mask(of_pixels((0, 0)).inside, rounded)).f1 == 1


def test_medians():
    scores = [MaskScores(dict.fromkeys(NAMES, value)) for value in (0.1, 0.9, 0.3)]
    assert medians(scores) == dict.fromkeys(NAMES, 0.3)
    assert medians(scores).f1 == 0.3
    with pytest.raises(InputError, match="at least one"):
        medians([])
