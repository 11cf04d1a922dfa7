"""Masks of voxels: the depths with half the power, lids and supports left out, nothing where nothing stands out."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.perception.segmentation import VolumeSettings, extend_mask

STEP, DEPTH_STEP = 0.0025, 0.005
SHAPE = (40, 36, 30)
OBJECT = (slice(12, 24), slice(10, 22))
SHARP = VolumeSettings(smoothing=0.0)


def echo(middle, width=2.0):
    """(Z,) amplitude around an index: half the power at `width` sqrt(ln 2) from it."""
    return np.exp(-((np.arange(SHAPE[2]) - middle) ** 2) / (2 * width**2))


def image_of(*parts, noise=1e-4):
    """Parts (pixels, profile along z) in noise of random phase, as if sheets had been taken off."""
    rng = np.random.default_rng(0)
    values = noise * (rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE))
    for pixels, profile in parts:
        values[pixels] += profile
    grid = ms.VoxelGrid(
        x=STEP * np.arange(SHAPE[0]), y=STEP * np.arange(SHAPE[1]), z=-0.3 + DEPTH_STEP * np.arange(SHAPE[2])
    )
    history = [{"step": "remove_sheets"}]
    return ms.SarImage(grid=grid, values=values.astype(np.complex64), metadata={"history": history})


def mask_of(*pixels):
    inside = np.zeros(SHAPE[:2], bool)
    for some in pixels:
        inside[some] = True
    return ms.Mask(grid_xy=image_of().grid.xy, inside=inside)


def box(pixels, depths):
    inside = np.zeros(SHAPE, bool)
    inside[(*pixels, depths)] = True
    return inside


def test_each_pixel_gets_the_depths_with_half_its_power():
    """2 sqrt(ln 2) = 1.67: one voxel on either side of the middle."""
    found = extend_mask(mask_of(OBJECT), image_of((OBJECT, echo(12))), settings=SHARP)
    np.testing.assert_array_equal(found.inside, box(OBJECT, slice(11, 14)))
    assert found.grid.shape == SHAPE
    np.testing.assert_array_equal(found.mask.inside, mask_of(OBJECT).inside)
    wider = extend_mask(mask_of(OBJECT), image_of((OBJECT, echo(12))), settings=VolumeSettings(smoothing=0, drop_db=10))
    np.testing.assert_array_equal(wider.inside, box(OBJECT, slice(9, 16)))  # 2 sqrt(ln 10) = 3.03


def test_a_shifted_and_brighter_image_gives_a_shifted_mask():
    first = extend_mask(mask_of(OBJECT), image_of((OBJECT, echo(12))))
    moved = slice(15, 27), slice(12, 24)
    second = extend_mask(mask_of(moved), image_of((moved, 50 * echo(20)), noise=5e-3))
    assert first.inside.any()
    np.testing.assert_array_equal(np.roll(first.inside, (3, 2, 8), axis=(0, 1, 2)), second.inside)


@pytest.mark.parametrize("depth", [2, 25])
def test_a_support_below_and_a_lid_above_are_left_out(depth):
    """Both are as bright beside the mask as within it, and brighter than the object."""
    everywhere = slice(None), slice(None)
    image = image_of((everywhere, 3 * echo(depth)), (OBJECT, echo(12)))
    found = extend_mask(mask_of(OBJECT), image, settings=SHARP)
    np.testing.assert_array_equal(found.inside, box(OBJECT, slice(11, 14)))
    assert (image.magnitude[OBJECT].argmax(axis=2) == depth).all()  # where the maximum alone would look


def test_stray_parts_are_left_out_and_parts_of_the_object_kept():
    """A part at another depth: with a fiftieth of the power, and with a quarter."""
    part = slice(24, 30), slice(10, 22)
    for amplitude, there in ((0.2, False), (0.8, True)):
        image = image_of((OBJECT, echo(8)), (part, amplitude * echo(22)))
        settings = VolumeSettings(smoothing=0, dimmest_db=20)
        found = extend_mask(mask_of(OBJECT, part), image, settings=settings)
        np.testing.assert_array_equal(found.inside, box(OBJECT, slice(7, 10)) | (there & box(part, slice(21, 24))))


def test_range_side_lobes_and_dim_pixels_are_left_out():
    flank = slice(24, 30), slice(10, 22)
    image = image_of((OBJECT, echo(12) + 0.3 * echo(18, 1) + 0.3 * echo(6, 1)), (flank, 0.1 * echo(12)))
    found = extend_mask(mask_of(OBJECT, flank), image, settings=SHARP)
    np.testing.assert_array_equal(found.inside, box(OBJECT, slice(11, 14)))


def test_neither_a_glint_nor_a_mask_of_a_part_hides_a_face():
    """One pixel 20 dB brighter; and a mask of a quarter of a plate, which is as bright beside it."""
    corner = 13, 11
    found = extend_mask(mask_of(OBJECT), image_of((OBJECT, echo(12)), (corner, 9 * echo(12))), settings=SHARP)
    np.testing.assert_array_equal(found.inside, box(OBJECT, slice(11, 14)))
    plate = slice(8, 30), slice(8, 30)
    found = extend_mask(mask_of(OBJECT), image_of((plate, echo(12))), settings=SHARP)
    np.testing.assert_array_equal(found.inside, box(OBJECT, slice(11, 14)))


def test_nothing_gives_nothing():
    image = image_of((OBJECT, echo(12)))
    assert not extend_mask(mask_of(), image).inside.any()
    blank = ms.SarImage(grid=image.grid, values=np.zeros(SHAPE), metadata=image.metadata)
    assert not extend_mask(mask_of(OBJECT), blank).inside.any()
    alike = image_of(((slice(None), slice(None)), echo(12)), noise=0)
    assert not extend_mask(mask_of(OBJECT), alike).inside.any()


def test_of_one_depth_or_one_row_and_of_the_whole_picture():
    flat = ms.VoxelGrid(x=STEP * np.arange(20), y=[0.0], z=[0.1])
    values = np.full((20, 1, 1), 1e-3)
    values[5:10] = 1
    image = ms.SarImage(grid=flat, values=values, metadata={"history": [{"step": "remove_sheets"}]})
    mask = ms.Mask(grid_xy=flat.xy, inside=values[..., 0] > 0.5)
    found = extend_mask(mask, image, settings=SHARP)
    np.testing.assert_array_equal(found.inside[..., 0], mask.inside)
    all_of_it = ms.Mask(grid_xy=flat.xy, inside=np.ones((20, 1), bool))
    np.testing.assert_array_equal(extend_mask(all_of_it, image, settings=SHARP).inside[..., 0], mask.inside)


def test_segment_gives_voxels_on_request():
    image = image_of((OBJECT, echo(12)))
    found = ms.segment(image, method="classical", rng=0, volume=True)
    assert isinstance(found, ms.VolumeMask)
    mask = ms.segment(image, method="classical", rng=0)
    np.testing.assert_array_equal(found.inside, extend_mask(mask, image).inside)
    assert found.inside[18, 16, 12]
    assert not found.inside[:, :, 20:].any()


def test_what_does_not_fit_is_refused():
    image = image_of((OBJECT, echo(12)))
    other = ms.Mask(grid_xy=ms.PixelGrid(x=[0.0, 1.0], y=[0.0]), inside=[[True], [False]])
    with pytest.raises(InputError, match="different pixels, along x: 40 from"):
        extend_mask(other, image)
    for name, value in (("smoothing", -1), ("beside", 101), ("smallest", 2), ("drop_db", -3), ("dimmest_db", np.nan)):
        with pytest.raises(InputError, match=name):
            VolumeSettings(**{name: value})
    with pytest.raises(InputError, match="inside"):
        ms.VolumeMask(grid=image.grid, inside=np.ones((2, 2, 2), bool))
