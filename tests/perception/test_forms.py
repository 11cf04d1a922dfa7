"""A classifier counts with an object's form, as its phases tell it."""

from dataclasses import replace

import numpy as np
import pytest

import millisight as ms
from helpers.form_images import GRID, ball, cylinder, flat, lit
from millisight.perception.classification import FORM_SHARES, form_odds, form_of
from millisight.perception.segmentation import find_flat, find_round

ABOVE = [[-0.1, -0.1, 0.25], [0.1, 0.1, 0.25]]  # the corners of an aperture
NAMES = ("can", "handle", "box", "sphere", "cup", "clamp", "other")
PAIRS = {
    "ball": (ball(0.03, (0, 0, -0.06)), "sphere", "can"),
    "cylinder": (cylinder(0.03, -0.06, 0.12), "can", "sphere"),
}


def vessel(depth):
    """An image of a round floor and, so far above it, a rim around it; and the mask of both."""
    floor = flat((0.07, 0.07), (0, 0, -0.06), kind="ellipse")
    rim = flat((0.09, 0.09), (0, 0, depth - 0.06), kind="ellipse").values
    rim = rim - flat((0.08, 0.08), (0, 0, depth - 0.06), kind="ellipse").values
    return ms.SarImage(grid=GRID, values=floor.values + rim), lit(floor, -6)


@pytest.mark.parametrize("kind", PAIRS)
def test_what_is_round_speaks_for_the_classes_that_are(kind):
    image, likely, unlikely = PAIRS[kind]
    things = find_round(lit(image), image)
    assert form_of(things[0].inside, things) == kind
    mask = ms.Mask(grid_xy=image.grid.xy, inside=things[0].inside)
    odds = dict(zip(NAMES, form_odds(mask, image, NAMES), strict=True))
    assert max(odds, key=odds.__getitem__) == likely
    assert odds[likely] - odds[unlikely] > np.log(10)


@pytest.mark.parametrize(("kind", "likely"), [("rectangle", "box"), ("ellipse", "can")])
def test_a_flat_top_speaks_for_the_classes_that_have_one(kind, likely):
    image = flat((0.08, 0.06), (0, 0, -0.06), (3, 2), 20, kind)
    mask = lit(image, -6)
    assert form_of(mask.inside, find_flat(mask, image)) == kind
    odds = dict(zip(NAMES, form_odds(mask, image, NAMES), strict=True))
    assert max(odds, key=odds.__getitem__) == likely
    assert odds[likely] - odds["sphere"] > np.log(10)


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_floor_under_a_rim_speaks_for_a_cup(upside_down):
    image, mask = vessel(0.06)
    if upside_down:
        image = replace(image, metadata={"history": [{"step": "form_image", "antennas": ABOVE}]}).turned_over
    (floor,) = find_flat(mask, image)
    assert floor.kind == "ellipse"
    assert floor.rim == pytest.approx(0.06, abs=0.004)
    assert f"about {1e3 * floor.rim:.0f} mm below a rim" in str(floor)
    assert floor.plain["rim"] == floor.rim
    assert form_of(mask.inside, [floor]) == "vessel"
    odds = dict(zip(NAMES, form_odds(mask, image, NAMES), strict=True))
    assert max(odds, key=odds.__getitem__) == "cup"
    assert odds["cup"] - odds["can"] > np.log(5)


def test_what_is_left_of_a_lid_is_no_rim():
    top = flat((0.07, 0.07), (0, 0, -0.06), kind="ellipse")
    rest = 0.8 * flat((0.13, 0.16), (0.01, 0.02, 0), kind="ellipse").values
    (top,) = find_flat(lit(top, -6), ms.SarImage(grid=GRID, values=top.values + rest))
    assert top.rim is None
    assert form_of(top.inside, [top]) == "ellipse"


def test_a_tower_beside_a_top_is_no_rim():
    _, mask = vessel(0.06)
    low = flat((0.07, 0.07), (0, 0, -0.06), kind="ellipse")
    tower = flat((0.02, 0.02), (0.045, 0, 0), kind="ellipse").values
    (top,) = find_flat(mask, ms.SarImage(grid=GRID, values=low.values + tower))
    assert top.rim is None


def test_the_lip_of_a_can_is_no_rim():
    image, mask = vessel(0.004)
    (top,) = find_flat(mask, image)
    assert form_of(mask.inside, [top]) == "ellipse"


def test_what_is_not_round_thin_or_little_of_the_mask_says_nothing():
    image = ball(0.03, (0, 0, -0.06))
    (thing,) = find_round(lit(image), image)
    whole = np.ones(image.grid.shape[:2], bool)
    assert form_of(whole, [thing]) is None
    assert form_of(thing.inside, []) is None
    rod = replace(thing, kind="cylinder", radius=0.012, length=0.08)
    assert form_of(thing.inside, [rod]) is None
    real = ms.SarImage(grid=image.grid, values=image.magnitude)
    mask = ms.Mask(grid_xy=image.grid.xy, inside=thing.inside)
    np.testing.assert_array_equal(form_odds(mask, real, NAMES), np.zeros(len(NAMES)))


@pytest.mark.parametrize(("radius", "length"), [(0.012, 0.06), (0.03, 0.2)])
def test_a_short_or_a_thick_cylinder_is_no_rod(radius, length):
    image = ball(0.03, (0, 0, -0.06))
    (thing,) = find_round(lit(image), image)
    assert form_of(thing.inside, [replace(thing, kind="cylinder", radius=radius, length=length)]) == "cylinder"


@pytest.mark.parametrize("kind", PAIRS)
def test_no_answer_becomes_sure_by_it(kind, monkeypatch):
    pytest.importorskip("onnxruntime")
    image, likely, unlikely = PAIRS[kind]
    (thing,) = find_round(lit(image), image)
    mask = ms.Mask(grid_xy=image.grid.xy, inside=thing.inside)
    counted = ms.classify(image, mask)
    monkeypatch.setitem(FORM_SHARES, kind, dict.fromkeys(NAMES, 0.5))
    alone = ms.classify(image, mask)
    of = {
        one: dict(zip(found.class_names, found.probabilities, strict=True))
        for one, found in enumerate((counted, alone))
    }
    assert of[0][likely] > of[1][likely]
    assert of[0][unlikely] < of[1][unlikely] + 1e-9
    assert sum(counted.probabilities) == pytest.approx(1)
    assert not counted.sure or (alone.sure and alone.label == counted.label)
