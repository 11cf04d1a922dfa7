"""What lies no higher than the support, or as high as the lid, is no object."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.perception.segmentation._heights import between

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
    np.testing.assert_array_equal(between(every, image_of(width=1.0), support=SUPPORT, lid=LID), every)


def test_an_echo_at_the_images_end_lies_there():
    image = image_of({"tall": Z[-1] + 0.02, "stand": Z[0] - 0.02})
    assert not between(mask_of("tall"), image, lid=LID).any()
    assert not between(mask_of("stand"), image, support=SUPPORT).any()


class Everything:
    """A segmenter that marks all that is bright."""

    name, needs_prompts = "everything", False

    def segment(self, picture, prompts=None):
        from millisight.perception.segmentation import Candidates

        return Candidates(masks=picture.power[None] > 0.05, scores=np.ones(1))


def test_segment_leaves_out_what_does_not_rise_above_the_support():
    image = image_of({"stand": SUPPORT, "tall": -0.25})
    assert ms.segment(image, method=Everything()).inside[PIXELS["stand"]].all()
    found = ms.segment(image, method=Everything(), support=SUPPORT)
    np.testing.assert_array_equal(found.inside, mask_of("tall"))
    empty = ms.segment(image_of({"stand": SUPPORT}), method=Everything(), support=SUPPORT)
    assert not empty.inside.any()
    with pytest.raises(InputError, match="support is nan"):
        ms.segment(image, method=Everything(), support=np.nan)
