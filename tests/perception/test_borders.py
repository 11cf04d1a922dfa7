"""Where masks end, in images with flat tops and leftovers of a lid."""

import numpy as np
import pytest

import millisight as ms
from helpers.form_images import GRID, ball, flat, lit
from millisight.perception.segmentation import _borders
from millisight.perception.segmentation._borders import with_borders

CENTRE = (0.0, 0.0, -0.06)
CUTS = (0.1, 0.25)


@pytest.fixture
def as_they_are(monkeypatch):
    """No border follows the image's edges."""
    monkeypatch.setattr(_borders, "at_edges", lambda masks, *_: list(masks))


def leftovers(share, seed=0):
    """Of a lid 3 cm above: waves of all directions, so bright that they would be 1."""
    noise = np.random.default_rng(seed).standard_normal((*GRID.shape, 2)) @ [1, 1j] / np.sqrt(2)
    return share * noise * np.exp(-(((GRID.z + 0.03) / 0.04) ** 2))


def wide(half, beyond=0.02):
    """A mask around a top of half sides, and further."""
    x, y = GRID.x[:, None], GRID.y
    return (abs(x) <= half[0] + beyond) & (abs(y) <= half[1] + beyond)


def both(mask, values, probability, *, covered=True):
    image = ms.SarImage(grid=GRID, values=values)
    (first, _), there = with_borders([mask, mask], probability, CUTS, image, covered=covered)
    return first, there


def test_beyond_a_flat_top_nothing_stays_that_is_as_dim_as_its_surroundings(as_they_are):
    image, mask = flat((0.08, 0.06), CENTRE, (3, -2)), wide((0.04, 0.03), 0.015)
    top = lit(image, -6).inside
    found, there = both(mask, image.values + leftovers(0.4), np.where(mask, 0.6, 0.0))
    assert there
    assert (found & top).sum() / (found | top).sum() > 0.8  # 3 mm beyond it stay
    assert (mask & top).sum() / (mask | top).sum() < 0.6


def test_what_shines_beyond_a_flat_top_stays(as_they_are):
    """A rim around a cup's bottom."""
    image, mask = flat((0.06, 0.06), CENTRE, kind="ellipse"), wide((0.03, 0.03), 0.008)
    away = np.hypot(GRID.x[:, None], GRID.y)
    rim = (abs(away - 0.036) < 0.002)[..., None] * np.exp(-(((GRID.z + 0.05) / 0.04) ** 2))
    shine = np.random.default_rng(1).standard_normal((*GRID.shape, 2)) @ [1, 1j]
    found, _ = both(mask, image.values + rim * shine + leftovers(0.03), np.where(mask, 0.6, 0.0))
    rim_pixels = (abs(away - 0.036) < 0.0015) & mask
    assert found[rim_pixels].mean() > 0.8


def test_under_a_lid_what_does_not_stand_out_is_marked_by_its_probability():
    probability = 0.9 * np.exp(-((np.hypot(GRID.x[:, None], GRID.y) / 0.05) ** 2))
    mask = probability > CUTS[0]
    found, there = both(mask, leftovers(1.0), probability)
    assert not there
    np.testing.assert_array_equal(found, probability > 0.5)
    in_sight, _ = both(mask, leftovers(1.0), probability, covered=False)
    assert in_sight.sum() != found.sum()
    weak, _ = both(0.4 * probability > CUTS[0], leftovers(1.0), 0.4 * probability)
    assert weak.any()


@pytest.mark.parametrize("values", [ball(0.03, CENTRE).values, flat((0.03, 0.03), CENTRE).values], ids=["ball", "top"])
def test_round_and_flat_things_are_there(values):
    mask = lit(ms.SarImage(grid=GRID, values=values), -12).inside
    assert both(mask, values, np.where(mask, 0.6, 0.0))[1]


def test_a_top_is_there_only_if_it_covers_most_of_its_part(as_they_are):
    """A tripod's plate is flat, too."""
    plate, mask = flat((0.022, 0.022), CENTRE), wide((0.011, 0.011))
    assert not both(mask, plate.values + leftovers(0.2), np.where(mask, 0.6, 0.0))[1]
