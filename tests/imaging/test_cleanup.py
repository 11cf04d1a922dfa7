"""What is taken off finished images."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.imaging import crop_slices
from millisight.imaging._clutter import subtract_empty

GRID = ms.VoxelGrid.regular((0, 0, -0.37), (0.03, 0.02, -0.16), 0.01)


def image_of(values):
    return ms.SarImage(grid=GRID, values=values)


@pytest.fixture
def image():
    rng = np.random.default_rng(0)
    return image_of(rng.normal(size=GRID.shape) + 1j * rng.normal(size=GRID.shape))


def test_slices_go_with_their_coordinates(image):
    cropped = crop_slices(image, low=12, high=7)
    np.testing.assert_array_equal(cropped.values, image.values[:, :, 12:-7])
    np.testing.assert_array_equal(cropped.grid.z, GRID.z[12:-7])
    assert cropped.metadata["history"][-1] == {"step": "crop_slices", "low": 12, "high": 7}
    np.testing.assert_array_equal(crop_slices(image).values, image.values)
    with pytest.raises(InputError, match="expected at least one to stay"):
        crop_slices(image, low=20, high=2)


def test_the_empty_scene_goes_in_magnitude_and_phases_stay(image):
    empty = image_of(np.full(GRID.shape, 0.5j))
    less = subtract_empty(image, empty)
    np.testing.assert_allclose(less.magnitude, np.maximum(image.magnitude - 0.5, 0), atol=1e-6)
    bright = less.magnitude > 0.01
    assert bright.any()
    assert (less.magnitude == 0).any()
    np.testing.assert_allclose(np.angle(less.values[bright] / image.values[bright]), 0, atol=1e-5)
    dark = image_of(np.zeros(GRID.shape))
    np.testing.assert_array_equal(subtract_empty(dark, empty).values, 0)
    with pytest.raises(InputError, match="differ along z"):
        subtract_empty(image, crop_slices(empty, low=1))
