"""The F-score held to theory."""

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.evaluation import f_score

CLOUD = np.random.default_rng(0).random((500, 3))


def all_pairs(measured, simulated, within):
    """Precision and recall by every distance."""
    far = np.linalg.norm(measured[:, None] - simulated[None], axis=-1)
    return (far.min(axis=1) < within).mean(), (far.min(axis=0) < within).mean()


def plane(shift=0.0, size=40, step=0.0025):
    x, y = np.meshgrid(*[np.arange(size) * step] * 2, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, shift)], axis=-1)


def test_identical_clouds_score_one():
    score = f_score(CLOUD, CLOUD[::-1], within=1e-6)
    assert score == (1.0, 1.0)
    assert score.f == 1.0


def test_against_all_pairs():
    other = np.random.default_rng(1).random((300, 3))
    for within in (0.02, 0.05, 0.1, 0.2):
        assert f_score(CLOUD, other, within) == pytest.approx(all_pairs(CLOUD, other, within), abs=1e-12)


def test_exchanged_clouds_exchange_precision_and_recall():
    other = CLOUD[:200] + 0.03
    one, two = f_score(CLOUD, other, 0.06), f_score(other, CLOUD, 0.06)
    assert 0 < one.precision < 1
    assert (one.precision, one.recall, one.f) == (two.recall, two.precision, two.f)


def test_a_plane_off_itself_matches_until_it_is_too_far():
    assert f_score(plane(), plane(0.0099), 0.01).f == 1.0
    assert f_score(plane(), plane(0.0101), 0.01).f == 0.0


@pytest.mark.parametrize("steps", [0, 4, 10, 20, 39])
def test_a_plane_shifted_along_itself_falls_as_the_overlap(steps):
    """Of n rows, those match that overlap and those nearer than tau_F to the overlap: (n - k + m) / n."""
    size, step, within = 40, 0.0025, 0.006
    near = 2  # rows within 6 mm of the overlap
    score = f_score(plane(), plane() + np.array([steps * step, 0, 0]), within)
    expected = min(1.0, (size - steps + near) / size)
    assert score.precision == score.recall == pytest.approx(expected)
    assert score.f == pytest.approx(expected)


def test_a_part_has_recall_one_and_the_share_as_precision():
    half = plane()[:800]
    assert f_score(plane(), half, 0.001) == (0.5, 1.0)
    assert f_score(plane(), half, 0.001).f == pytest.approx(2 / 3)


def test_a_point_at_tau_f_itself_does_not_match():
    assert f_score([[0, 0, 0]], [[0, 0, 0.5]], 0.5).f == 0.0
    assert f_score([[0, 0, 0]], [[0, 0, 0.5]], 0.5000001).f == 1.0


def test_empty_clouds_score_nothing_and_single_points_count():
    empty = np.empty((0, 3))
    assert f_score(empty, CLOUD, 0.1) == f_score(CLOUD, empty, 0.1) == f_score(empty, empty, 0.1) == (0.0, 0.0)
    assert f_score(empty, CLOUD, 0.1).f == 0.0
    assert f_score(CLOUD[:1], CLOUD, 1e-9) == (1.0, 1 / 500)


@pytest.mark.parametrize(
    ("clouds", "within", "named"),
    [
        ((CLOUD, CLOUD[:, :2]), 0.1, "simulated"),
        ((CLOUD * np.nan, CLOUD), 0.1, "measured"),
        ((CLOUD, CLOUD), 0, "within"),
    ],
)
def test_what_cannot_be_right_is_refused(clouds, within, named):
    with pytest.raises(InputError, match=named):
        f_score(*clouds, within)
