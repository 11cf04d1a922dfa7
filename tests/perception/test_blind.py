"""What segmenters are compared with: masks that do not look, and one level for all."""

import numpy as np
import pytest

from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Picture, SarImage, VoxelGrid
from millisight.perception import project
from millisight.perception.segmentation import BLIND_SHAPES, SEGMENTERS, BlindSegmenter, ThresholdSegmenter, segmenter


def image(place=(20, 30), spacing=0.004):
    grid = VoxelGrid(x=spacing * np.arange(61), y=spacing * np.arange(81), z=np.array([-0.3, -0.29]))
    values = np.full(grid.shape, 0.01, np.complex64)
    values[place[0] - 5 : place[0] + 5, place[1] - 5 : place[1] + 5] = 1j
    return SarImage(grid=grid, values=values)


@pytest.mark.parametrize("shape", BLIND_SHAPES)
def test_a_blind_mask_is_the_same_whatever_the_image_shows(shape):
    by = segmenter(f"blind {shape}")
    one, other = (by.segment(project(image(place))).masks for place in ((20, 30), (40, 60)))
    np.testing.assert_array_equal(one, other)
    assert one.shape == (1, 61, 81)


def test_blind_masks_are_as_large_as_they_say():
    areas = {shape: BlindSegmenter(shape).segment(project(image())).masks.mean() for shape in BLIND_SHAPES}
    assert areas["all"] == 1
    assert areas["ellipse"] == pytest.approx(np.pi / 4, abs=0.03)
    assert areas["box"] == pytest.approx(1 / 4, abs=0.02)
    assert areas["disc"] * 61 * 81 * 0.004**2 == pytest.approx(np.pi * 0.05**2, rel=0.03)


def test_a_threshold_is_one_level_of_the_maximum():
    picture = project(image())
    (mask,) = ThresholdSegmenter().segment(picture).masks
    assert mask.sum() == 100
    assert mask[20, 30]
    (none,) = ThresholdSegmenter(level=1.0).segment(picture).masks
    assert not none.any()


def test_what_they_cannot_do_is_said():
    photo = Picture(rgb=np.zeros((8, 8, 3), np.uint8))
    for name in ("blind ellipse", "threshold"):
        with pytest.raises(InputError, match="this picture is a photo"):
            SEGMENTERS[name]().segment(photo)
    with pytest.raises(UnknownNameError, match="round"):
        BlindSegmenter("round")
    with pytest.raises(InputError, match="level is 0"):
        ThresholdSegmenter(level=0)
