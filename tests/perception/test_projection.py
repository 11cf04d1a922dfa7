"""Projection: what is coloured, where it lies, and what of blank images."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Picture
from millisight.perception import power_on, project

GRID = ms.VoxelGrid(x=np.arange(4) * 0.01, y=np.arange(3) * 0.02, z=np.arange(2) * 0.1)


def image(values, grid=GRID):
    return ms.SarImage(grid=grid, values=np.asarray(values, dtype=complex))


def ramp():
    """|I| is a different number in each pixel; the phase must not matter."""
    magnitude = np.arange(24).reshape(4, 3, 2)
    return magnitude, image(magnitude * np.exp(1j * np.arange(24)).reshape(4, 3, 2))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ("mean", lambda m: m.mean(axis=2)),
        ("max", lambda m: m.max(axis=2)),
        ("rms", lambda m: np.sqrt((m**2).mean(axis=2))),
    ],
)
def test_power_is_the_magnitude_along_z_over_its_maximum(values, expected):
    magnitude, made = ramp()
    picture = project(made, values=values)
    seen = expected(magnitude.astype(float))
    assert picture.power is not None
    np.testing.assert_allclose(picture.power, seen / seen.max(), rtol=1e-6)
    assert picture.power.dtype == np.float32
    assert picture.shape == (4, 3)
    assert picture.image is made


def test_pixels_are_not_turned_and_have_the_rainbow_s_colours():
    values = np.zeros((4, 3, 2))
    values[3, 0] = 1
    values[1, 2] = 0.5
    picture = project(image(values))
    assert picture.rgb.shape == (4, 3, 3)
    assert tuple(picture.rgb[3, 0]) == (127, 0, 0)  # jet at 1: dark red
    assert tuple(picture.rgb[0, 0]) == (0, 0, 127)  # at 0: dark blue
    r, g, b = map(int, picture.rgb[1, 2])  # at 1/2: green, with as much red as blue
    assert g > 200
    assert abs(r - b) < 12
    assert picture.grid_xy is not None
    np.testing.assert_array_equal(picture.grid_xy.x, GRID.x)


def test_other_colours_are_matplotlib_s():
    grey = project(ramp()[1], colours="gray").rgb
    assert (grey == grey[..., :1]).all()
    assert grey[0, 0, 0] < grey[3, 2, 0] == 255


def test_a_blank_image_has_no_power():
    picture = project(image(np.zeros((4, 3, 2))))
    assert picture.power is not None
    assert not picture.power.any()


def test_the_other_band_goes_along():
    other = image(np.ones((4, 3, 2)))
    assert project(ramp()[1], other_band=other).other_band is other


def test_the_other_power_is_interpolated_onto_the_grid():
    fine = ms.VoxelGrid(x=np.linspace(0, 0.03, 7), y=np.linspace(0, 0.04, 9), z=GRID.z)
    coarse = project(image(np.broadcast_to((GRID.x[:, None] + GRID.y)[..., None], (4, 3, 2))))
    on_fine = power_on(coarse, project(image(np.ones(fine.shape), fine)))
    np.testing.assert_allclose(on_fine, (fine.x[:, None] + fine.y) / 0.07, atol=1e-6)


def test_the_other_power_is_nought_where_its_grid_does_not_reach():
    wide = ms.VoxelGrid(x=np.arange(-2, 6) * 0.01, y=GRID.y, z=GRID.z)
    found = power_on(project(image(np.ones(GRID.shape))), project(image(np.ones(wide.shape), wide)))
    np.testing.assert_array_equal(found, [[0] * 3] * 2 + [[1] * 3] * 4 + [[0] * 3] * 2)


def test_bands_without_a_place_in_common_are_refused():
    away = ms.VoxelGrid(x=GRID.x + 1, y=GRID.y, z=GRID.z)
    with pytest.raises(InputError, match=r"do not overlap.*x 0 to 0.03 m.*one grid"):
        power_on(project(image(np.ones(GRID.shape), away)), project(ramp()[1]))


def test_a_photo_has_no_power():
    photo = Picture(rgb=np.zeros((4, 3, 3), np.uint8))
    assert photo.power is None
    with pytest.raises(InputError, match="photo"):
        power_on(photo, project(ramp()[1]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rgb": np.zeros((4, 3), np.uint8)}, r"rgb has shape \(4, 3\)"),
        ({"power": np.full((4, 3), 1.5)}, "power runs from 1.5"),
        ({"power": np.zeros((3, 4))}, "power has shape"),
        ({"grid_xy": ms.PixelGrid(x=[0.0, 1.0], y=[0.0])}, r"grid_xy has \(2, 1\) pixels"),
        ({"image": "image.h5"}, "expected SarImage"),
    ],
)
def test_what_is_no_picture_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        Picture(**{"rgb": np.zeros((4, 3, 3), np.uint8), **change})


def test_unknown_names_are_told():
    with pytest.raises(UnknownNameError, match="Known: max, mean, rms"):
        project(ramp()[1], values="median")
    with pytest.raises(InputError, match="unknown colour map"):
        project(ramp()[1], colours="rainboww")
    with pytest.raises(InputError, match="expected SarImage"):
        project(np.zeros((4, 3, 2)))  # pyright: ignore[reportArgumentType]
