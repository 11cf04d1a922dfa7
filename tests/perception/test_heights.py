"""What lies no higher than the support, or as high as the lid, is no object."""

from dataclasses import asdict, replace

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError
from millisight.imaging import DetectedSheet, SheetRemoval
from millisight.perception import lids_taken_before
from millisight.perception.segmentation._heights import beneath, between, lid_height, tells_height
from millisight.perception.segmentation._parts import judged_apart

X, Z = 0.004 * np.arange(40), -0.37 + 0.01 * np.arange(22)
SUPPORT, LID = -0.30, -0.20
PIXELS = {
    "stand": (slice(2, 8), slice(2, 8)),
    "low": (slice(14, 22), slice(2, 8)),
    "tall": (slice(2, 8), slice(14, 22)),
    "edge": (slice(26, 38), slice(30, 32)),
}
HEIGHTS = {"stand": SUPPORT, "low": SUPPORT + 0.012, "tall": -0.25, "edge": LID}


def image_of(heights=HEIGHTS, width=0.016):
    """Echoes of these parts at their heights, with half their power at 0.83 `width` from there."""
    values = np.full((40, 40, 22), 1e-3, np.complex64)
    for name, height in heights.items():
        values[PIXELS[name]] += np.exp(-(((Z - height) / width) ** 2) / 2)
    return ms.SarImage(
        grid=ms.VoxelGrid(x=X, y=X, z=Z), values=values, metadata={"history": [{"step": "remove_sheets"}]}
    )


def mask_of(*names):
    inside = np.zeros((40, 40), bool)
    for name in names:
        inside[PIXELS[name]] = True
    return inside


@pytest.mark.parametrize(
    ("known", "kept"),
    [
        ({}, ("stand", "low", "tall", "edge")),
        ({"support": SUPPORT}, ("low", "tall", "edge")),
        ({"lid": LID}, ("stand", "low", "tall")),
        ({"support": SUPPORT, "lid": LID}, ("low", "tall")),
        ({"support": SUPPORT - 0.02, "lid": LID + 0.02}, ("stand", "low", "tall", "edge")),
    ],
)
def test_heights_are_told_to_millimetres_although_an_echo_is_far_wider(known, kept):
    np.testing.assert_array_equal(between(mask_of(*HEIGHTS), image_of(), **known), mask_of(*kept))


def test_what_has_no_height_is_kept():
    """At 24 GHz an echo is longer than the image is high."""
    every = mask_of(*HEIGHTS)
    np.testing.assert_array_equal(between(every, image_of(width=1.0), support=SUPPORT), every)


def test_an_image_tells_heights_where_its_echoes_are_short():
    assert tells_height(mask_of("tall"), image_of())
    assert not tells_height(mask_of("tall"), image_of(width=1.0))
    assert not tells_height(mask_of(), image_of())


def test_where_nothing_would_be_left_what_was_taken_for_the_lid_may_be_a_floor():
    every = mask_of("low", "tall")
    np.testing.assert_array_equal(between(every, image_of(), lid=SUPPORT), every)
    assert not between(mask_of("edge"), image_of(), lid=LID, support=SUPPORT).any()


def test_an_object_that_touches_its_lids_edge_stays_where_a_smaller_mask_has_it_apart():
    bridge = np.zeros((40, 40), bool)
    bridge[6:30, 20:31] = True
    wide, apart, inner = mask_of("tall", "edge") | bridge, mask_of("tall", "edge"), mask_of("tall")
    inner[2] = False
    values = image_of().values.copy()
    values[PIXELS["edge"]] *= 3  # as bright as all else together
    image = ms.SarImage(grid=image_of().grid, values=values)

    def below(masks):
        return [between(mask, image, lid=LID, support=SUPPORT) for mask in masks]

    assert not below([wide])[0].any()
    np.testing.assert_array_equal(judged_apart([wide], [apart, inner], below)[0], mask_of("tall"))
    np.testing.assert_array_equal(judged_apart([wide], [inner], below)[0], inner)
    larger, smaller = judged_apart([wide, inner], [], below)
    np.testing.assert_array_equal(larger, inner)
    np.testing.assert_array_equal(smaller, inner)
    # Where nothing is left out, no other mask is asked; and none adds to a mask that does not hold it.
    asked = []
    judged_apart([inner], [wide], lambda masks: asked.extend(masks) or masks)
    assert len(asked) == 1
    np.testing.assert_array_equal(judged_apart([mask_of("edge")], [inner], below)[0], mask_of())


def removal_of(image, height):
    (x0, x1), (y0, y1) = (
        (axis[part.start], axis[part.stop - 1]) for axis, part in zip((X, X), PIXELS["edge"], strict=True)
    )
    sheet = DetectedSheet(
        height=height, tilt_deg=(0, 0), lower=(x0, y0), upper=(x1, y1), area=0.01, border=0, explained=1, power=0.5
    )
    return SheetRemoval(result=image, sheets=(sheet,), left=(), reason="")


def test_a_lids_height_is_known_where_the_image_tells_heights():
    image = image_of()
    assert lid_height(image, removal_of(image, LID)) == LID
    assert lid_height(image_of(width=1.0), removal_of(image, LID)) is None
    assert lid_height(image, SheetRemoval(result=image, sheets=(), left=(), reason="none")) is None


def test_grating_lobes_above_a_lid_may_be_brighter_than_it():
    lid = image_of({"edge": LID - 0.05})
    brighter = ms.SarImage(grid=lid.grid, values=lid.values + 3 * image_of({"edge": Z[-1]}).values)
    assert lid_height(brighter, removal_of(brighter, LID - 0.05)) == LID - 0.05


def test_an_echo_at_the_images_end_lies_there():
    image = image_of({"tall": Z[-1] + 0.02, "stand": Z[0] - 0.02})
    assert not between(mask_of("tall"), image, lid=LID, support=SUPPORT).any()
    assert not between(mask_of("stand"), image, support=SUPPORT).any()


class Everything:
    """A segmenter that marks all that is bright."""

    name, needs_prompts = "everything", False

    def segment(self, picture, prompts=None):
        from millisight.perception.segmentation import Candidates

        return Candidates(masks=picture.power[None] > 0.05, scores=np.ones(1))


def test_a_support_above_the_whole_image_is_refused():
    with pytest.raises(InputError, match=r"support is 3 m, above the whole image, whose z is"):
        ms.segment(image_of(), method=Everything(), support=3.0)


def test_segment_leaves_out_what_does_not_rise_above_the_support():
    image = image_of({"stand": SUPPORT, "tall": -0.25})
    assert ms.segment(image, method=Everything()).inside[PIXELS["stand"]].all()
    found = ms.segment(image, method=Everything(), support=SUPPORT)
    np.testing.assert_array_equal(found.inside, mask_of("tall"))
    empty = ms.segment(image_of({"stand": SUPPORT}), method=Everything(), support=SUPPORT)
    assert not empty.inside.any()
    with pytest.raises(InputError, match="support is nan"):
        ms.segment(image, method=Everything(), support=np.nan)


def test_what_lies_beside_the_lid_is_not_under_it():
    """By a part's middle: what reaches out from under the lid is kept whole."""
    image, mask = image_of(), mask_of("low", "tall")
    mask[24:32, 31:37] = True  # its middle is 1 cm beyond the sheet, which ends where "edge" does
    under = np.zeros_like(mask)
    under[30:39, 28:32] = True
    removal = removal_of(image, LID)
    assert not beneath(mask, image, removal, surely=True).any()
    np.testing.assert_array_equal(beneath(mask, image, removal), mask)  # what was taken for a lid may be a floor
    np.testing.assert_array_equal(beneath(mask | under, image, removal), mask | under)  # one part, its middle below
    np.testing.assert_array_equal(beneath(under, image, removal), under)
    nothing = SheetRemoval(result=image, sheets=(), left=(), reason="none")
    np.testing.assert_array_equal(beneath(mask, image, nothing), mask)


def lid_told(clutter="lid", *, border=0.0, **step):
    """A step of a history: a lid over a part of the image was taken off."""
    lid = DetectedSheet(
        height=LID, tilt_deg=(0.0, 0.0), lower=(X[0], X[0]), upper=(X[24], X[-1]), area=0.015, border=border,
        explained=0.9, power=0.5,
    )  # fmt: skip
    return {"history": [{"step": "remove_sheets", "clutter": clutter, "sheets": [asdict(lid)]} | step]}


def test_lids_that_were_taken_before_are_as_the_history_tells():
    image = replace(image_of(), metadata=lid_told(taken_db=-10.0))
    before = lids_taken_before(image)
    assert before.result is image
    assert [sheet.height for sheet in before.sheets] == [LID]
    assert lid_height(image, before, before=True) == LID
    # An image along whose depth echoes do not fall tells no heights.
    long = replace(image_of(width=1.0), metadata=image.metadata)
    assert lid_height(long, lids_taken_before(long), before=True) is None
    # What was found though no lid is known to be there may be a floor; what cannot be read is nothing.
    for odd in (lid_told("auto"), lid_told(sheets=[{"height": 1}]), lid_told(sheets=[{"sheet": "lid"}]), {}):
        assert lids_taken_before(replace(image, metadata=odd)).sheets == ()
    # Off the frames: known where the poses are, beyond whose border it goes on.
    (within,) = lids_taken_before(replace(image, metadata=lid_told())).sheets
    (beyond,) = lids_taken_before(replace(image, metadata=lid_told(border=0.4))).sheets
    assert (within.lower, within.upper) == ((X[0], X[0]), (X[24], X[-1]))
    assert (beyond.lower, beyond.upper) == ((X[0], X[0]), (X[-1], X[-1]))


def test_instances_under_a_lid_lie_below_it_and_above_the_support():
    image = replace(image_of(), metadata=lid_told(taken_db=-10.0))
    seen = {}
    for condition, support in (("los", None), ("nlos", None), ("nlos", SUPPORT), ("los", SUPPORT)):
        found = ms.segment_instances(image, condition=condition, support=support)
        marked = {name for name in PIXELS for mask in found if (mask.inside & mask_of(name)).any()}
        seen[condition, support] = marked
    assert seen["los", None] == {"stand", "low", "tall", "edge"}
    assert seen["nlos", None] == {"stand", "low", "tall"}
    assert seen["nlos", SUPPORT] == {"low", "tall"}
    assert seen["los", SUPPORT] == {"low", "tall", "edge"}
    # A lid below all objects is a floor.
    floor = image.metadata["history"][0]["sheets"][0] | {"height": -0.36, "upper": (X[-1], X[-1])}
    below = replace(image, metadata=lid_told(sheets=[floor], taken_db=-10.0))
    assert len(ms.segment_instances(below, condition="nlos")) == len(ms.segment_instances(below))
    with pytest.raises(UnknownNameError, match="condition"):
        ms.segment_instances(image, condition="hidden")
    with pytest.raises(InputError, match="support"):
        ms.segment_instances(image, support=np.nan)
