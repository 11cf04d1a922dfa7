"""Scores of several objects: the best matching by hand, what is missed and what is invented."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.evaluation import score_instances

GRID = ms.PixelGrid(x=np.arange(10.0), y=np.arange(4.0))


def instances(*spans, grid=GRID):
    """Objects over columns [start, stop) of all rows."""
    labels = np.zeros(grid.shape, np.int32)
    for number, (start, stop) in enumerate(spans, 1):
        labels[start:stop] = number
    return ms.Instances(grid_xy=grid, labels=labels, scores=np.zeros(len(spans)))


def test_the_same_in_another_order_is_right():
    scores = score_instances(instances((0, 3), (5, 9)), instances((5, 9), (0, 3)))
    assert scores.matches == ((1, 2, 1.0), (2, 1, 1.0))
    assert (scores.precision, scores.recall, scores.mean_iou) == (1, 1, 1)


def test_the_sum_of_ious_decides_and_not_the_best_pair():
    """Found 4-10 and 0-4; true 2-8 and 8-10: greedy would pair 4-10 with 2-8 (0.5) and leave 8-10 to 0-4 (0)."""
    scores = score_instances(instances((4, 10), (0, 4)), instances((2, 8), (8, 10)))
    assert [(i, j, round(iou, 3)) for i, j, iou in scores.matches] == [(1, 2, 0.333), (2, 1, 0.25)]
    assert scores.mean_iou == pytest.approx((1 / 3 + 1 / 4) / 2)
    assert (scores.precision, scores.recall) == (0, 0)
    assert score_instances(instances((4, 10), (0, 4)), instances((2, 8), (8, 10)), threshold=0.3).recall == 0.5


def test_what_is_missed_and_what_is_invented_count():
    scores = score_instances(instances((0, 3), (4, 5), (6, 7)), instances((0, 4)))
    assert (scores.found, scores.true) == (3, 1)
    assert (scores.precision, scores.recall, scores.mean_iou) == pytest.approx((1 / 3, 1, 0.75))
    scores = score_instances(instances((0, 2)), instances((0, 2), (3, 6)))
    assert (scores.precision, scores.recall, scores.mean_iou) == (1, 0.5, 0.5)


def test_of_nothing():
    none = instances()
    assert score_instances(none, none)[3:] == (1, 1, 1)
    assert score_instances(instances((0, 2)), none)[3:] == (0, 1, 0)
    assert score_instances(none, instances((0, 2)))[3:] == (1, 0, 0)


def test_other_grids_and_thresholds_are_refused():
    other = ms.PixelGrid(x=np.arange(10.0) + 0.5, y=GRID.y)
    with pytest.raises(InputError, match="lie on different grids, along x"):
        score_instances(instances((0, 2)), instances((0, 2), grid=other))
    with pytest.raises(InputError, match="threshold"):
        score_instances(instances(), instances(), threshold=0)
