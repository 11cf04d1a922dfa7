"""Prompts from power: from where, how many, the same from the same seed, and what cannot be."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.perception import LOS, NLOS, RETRY, RETRY_COUNT, Thresholds, power_prompts, project

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.099, 0.079, 0), 0.001)


def picture(power, grid=GRID):
    """A picture of that power (A, B), whose maximum must be 1."""
    return project(ms.SarImage(grid=grid, values=np.asarray(power, dtype=complex)[..., None]))


def steps():
    """2000 pixels at 1, 2000 at 0.3, 2000 at 0.03, 2000 at 0.01."""
    return np.repeat([1, 0.3, 0.03, 0.01], 25)[:, None] * np.ones(80)


def test_the_published_settings():
    assert tuple(LOS) == (0.4, 0.02)
    assert tuple(NLOS) == (0.4, 0.05)
    assert tuple(RETRY) == (0.5, 0.2)
    assert RETRY_COUNT == 5


@pytest.mark.parametrize(("thresholds", "bright", "dark"), [(LOS, 25, 75), (NLOS, 25, 50), (RETRY, 25, 50)])
def test_points_lie_where_the_thresholds_say(thresholds, bright, dark):
    found = power_prompts(picture(steps()), thresholds=thresholds, count=100, rng=0)
    assert found.positive.sum() == (~found.positive).sum() == 100
    assert (found.points[found.positive][:, 0] < bright).all()
    assert (found.points[~found.positive][:, 0] >= dark).all()
    assert len(np.unique(found.points, axis=0)) == 200  # none twice


def test_half_a_percent_of_the_candidates_of_each_kind():
    found = power_prompts(picture(steps()), thresholds=NLOS, rng=0)
    assert found.positive.sum() == 10  # of 2000
    assert (~found.positive).sum() == 20  # of 4000


def test_at_least_one_and_at_most_all():
    power = np.full((100, 80), 0.1)
    power[7, 9], power[70, 60] = 1, 0
    few = power_prompts(picture(power), rng=0)
    np.testing.assert_array_equal(few.points, [[7, 9], [70, 60]])
    np.testing.assert_array_equal(few.positive, [True, False])
    assert len(power_prompts(picture(power), count=5, rng=0).points) == 2


def test_same_seed_same_points_and_another_seed_others():
    one = picture(steps())
    first, again, other = (power_prompts(one, rng=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)
    np.testing.assert_array_equal(power_prompts(one, rng=np.random.default_rng(3)).points, first.points)


def test_draws_are_spread_over_all_candidates():
    drawn = power_prompts(picture(steps()), share=0.5, rng=0)
    rows = drawn.points[drawn.positive][:, 0]
    assert len(rows) == 1000
    assert (np.bincount(rows, minlength=25) > 25).all()  # 40 expected, of 80


def test_with_two_bands_positives_are_bright_in_both():
    power, other = steps(), np.zeros((100, 80))
    other[20:30, :40] = 1  # of the first band's 25 bright rows only 20 to 24 are bright here, in half the columns
    found = power_prompts(picture(power), other=picture(other), count=1000, rng=0)
    assert found.positive.sum() == 5 * 40
    assert (found.points[found.positive][:, 0] >= 20).all()
    assert (found.points[found.positive][:, 1] < 40).all()
    assert (found.points[~found.positive][:, 0] >= 75).all()  # negatives: dark in the picture itself


def test_the_other_band_may_lie_on_another_grid():
    coarse = ms.VoxelGrid.regular((-0.02, -0.02, 0), (0.12, 0.12, 0), 0.01)
    other = np.full(coarse.shape[:2], 0.2)
    other[:4, :4] = 1  # up to 1 cm, from where it falls to 0.2 at 2 cm: 0.44 at 1.7 cm, 0.36 at 1.8 cm
    found = power_prompts(picture(steps()), other=picture(other, coarse), count=1000, rng=0)
    assert found.points[found.positive].max(axis=0).tolist() == [17, 17]


def test_nothing_bright_in_both_is_refused():
    other = np.zeros((100, 80))
    other[90, 70] = 1
    with pytest.raises(InputError, match=r"above 0.4 of the maximum in both bands"):
        power_prompts(picture(steps()), other=picture(other), rng=0)


def test_blank_pictures_and_photos_are_refused():
    with pytest.raises(InputError, match="blank"):
        power_prompts(picture(np.zeros((100, 80))), rng=0)
    with pytest.raises(InputError, match="photo"):
        power_prompts(Picture(rgb=np.zeros((4, 3, 3), np.uint8)), rng=0)


def test_where_all_pixels_are_bright_there_are_positives_only():
    found = power_prompts(picture(np.ones((100, 80))), rng=0)
    assert len(found.points) == 40
    assert found.positive.all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rng": None}, "rng is None"),
        ({"rng": -1}, "rng is -1"),
        ({"rng": True}, "rng is True"),
        ({"count": 0}, "count is 0"),
        ({"share": 0}, "share is 0"),
        ({"thresholds": Thresholds(1, 0)}, "thresholds are 1 and 0"),
        ({"thresholds": Thresholds(0.1, 0.2)}, "not below the other"),
        ({"thresholds": (0.1,)}, "expected 2"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        power_prompts(picture(steps()), **{"rng": 0, **settings})


def test_prompts_go_to_plain_values_and_back():
    made = Prompts(points=[[3, 4], [5, 6]], positive=[True, False])
    assert made.plain == {"points": [[3, 4], [5, 6]], "positive": [True, False]}
    again = Prompts.from_plain(made.plain)
    np.testing.assert_array_equal(again.points, made.points)
    np.testing.assert_array_equal(again.positive, made.positive)


@pytest.mark.parametrize(
    ("plain", "message"),
    [
        ([1, 2], "prompts hold list"),
        ({"points": [[1, 2]]}, "prompts hold points"),
        ({"points": [[1, 2]], "positive": [1]}, "true and false"),
        ({"points": [[1, 2]], "positive": [True, True]}, r"positive has shape \(2,\)"),
        ({"points": [[1, 2.5]], "positive": [True]}, "not whole"),
        ({"points": [[1, -2]], "positive": [True]}, "index -2"),
        ({"points": [], "positive": []}, "shape"),
    ],
)
def test_plain_values_that_are_no_prompts_are_refused(plain, message):
    with pytest.raises(InputError, match=message):
        Prompts.from_plain(plain)


def test_a_point_on_the_object_and_beside_it_is_refused():
    with pytest.raises(InputError, match=r"the point \[3, 4\] is both positive and negative; .*remove one"):
        Prompts(points=[[9, 9], [3, 4], [3, 4]], positive=[False, True, False])
    assert len(Prompts(points=[[3, 4], [3, 4], [4, 3]], positive=[True, True, False]).points) == 3


def test_points_beside_the_picture_are_refused():
    with pytest.raises(InputError, match=r"the point \[100, 0\].*100 x 80 pixels"):
        Prompts(points=[[99, 79], [100, 0]], positive=[True, True]).check_on(picture(steps()))
