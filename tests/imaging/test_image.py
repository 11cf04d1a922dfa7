"""Grids, images and their combination."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError

GRID = ms.VoxelGrid.regular((0, 0, -0.1), (0.03, 0.02, 0), (0.01, 0.01, 0.05))


def image(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=GRID.shape) + 1j * rng.normal(size=GRID.shape)
    return ms.SarImage(grid=GRID, values=values, metadata={"seed": seed})


def test_points_run_along_z_first():
    points = GRID.points.reshape(*GRID.shape, 3)
    assert points[3, 2, 1] == pytest.approx([GRID.x[3], GRID.y[2], GRID.z[1]])


@pytest.mark.parametrize(
    ("lower", "upper", "spacing", "message"),
    [
        ((0, 0, 0), (1, 1, 1), 0, "spacing is 0 m; expected more than 0 m"),
        ((0, 0, 0), (1, -1, 1), 0.1, "grid along y runs from 0 to -1 m"),
        ((0, 0), (1, 1, 1), 0.1, "lower has 2 numbers; expected 3"),
        (0, (1, 1, 1), 0.1, "lower is 0; expected 3 numbers"),
        ((0, 0, 0), (1, 1, 1), (1, 1), "spacing has 2 numbers; expected 3, or one"),
        ((0, 0, 0), (1, 1, 1), "fine", "spacing is 'fine'; expected 3 numbers, or one"),
        ((0, 0, 0), (1, 1, 1), 1e-5, r"1e\+05 x 1e\+05 x 1e\+05 = 1e\+15 voxels; .* coarser"),
        ((0, 0, 0), (1, 0, 0), 1e-300, "voxels; expected 1e"),
        ((0, 0, np.nan), (1, 1, 1), 0.1, "lower is nan; expected a finite number in m"),
    ],
)
def test_impossible_grids_are_refused(lower, upper, spacing, message):
    with pytest.raises(InputError, match=message):
        ms.VoxelGrid.regular(lower, upper, spacing)


def test_coordinates_must_increase():
    with pytest.raises(InputError, match="x must increase strictly"):
        ms.VoxelGrid(x=[0.0, 0.0], y=[0.0], z=[0.0])


def test_projection_is_the_mean_of_the_magnitude():
    one = image(0)
    assert one.project("z") == pytest.approx(np.abs(one.values).mean(axis=2))
    assert one.project("x", reduce="max") == pytest.approx(np.abs(one.values).max(axis=0))
    with pytest.raises(UnknownNameError):
        one.project("w")


def test_peak_is_the_brightest_voxel():
    values = np.zeros(GRID.shape, complex)
    values[2, 1, 0] = 3j
    assert ms.SarImage(grid=GRID, values=values).peak == pytest.approx([0.02, 0.01, -0.1])


def test_combine_is_the_weighted_mean():
    a, b = image(1), image(2)
    combined = ms.combine(a, b, alpha=(0.6, 0.2))
    assert np.abs(combined.values - (0.75 * a.values + 0.25 * b.values)).max() < 1e-6
    assert combined.metadata["history"][-1]["alpha"] == [0.6, 0.2]


@pytest.mark.parametrize("alpha", [(0, 0), (-1, 2), (1,), (np.nan, 1), 0.5, "ab", None])
def test_impossible_weights_are_refused(alpha):
    with pytest.raises(InputError, match="alpha"):
        ms.combine(image(1), image(2), alpha=alpha)


def test_combine_refuses_what_does_not_belong_together():
    other = ms.SarImage(grid=ms.VoxelGrid(x=GRID.x + 0.1, y=GRID.y, z=GRID.z), values=image(1).values)
    with pytest.raises(InputError, match="differ along x"):
        ms.combine(image(1), other, alpha=(1, 1))
    with pytest.raises(InputError, match="two images or two captures"):
        ms.combine(image(1), "edge", alpha=(1, 1))


def test_values_are_read_only_and_of_the_grids_shape():
    one = image(3)
    with pytest.raises(ValueError, match="read-only"):
        one.values[0, 0, 0] = 0
    with pytest.raises(InputError, match=r"values has shape \(2, 2, 2\); expected \(4, 3, 3\)"):
        ms.SarImage(grid=GRID, values=np.zeros((2, 2, 2)))


@pytest.mark.parametrize("largest", [-3e38, 3e38j, 2e15])
def test_values_whose_squares_would_overflow_are_refused(largest):
    with pytest.raises(InputError, match=r"values reach .*; expected at most 1e\+15, .* divide them"):
        ms.SarImage(grid=GRID, values=np.full(GRID.shape, largest))
    bright = ms.SarImage(grid=GRID, values=np.full(GRID.shape, -1e15 + 1e15j))
    assert ms.project(bright, values="rms").power.max() == 1


def test_reprs_are_short():
    assert repr(GRID) == "VoxelGrid(4 x 3 x 3 voxels, x 0 to 0.03 m, y 0 to 0.02 m, z -0.1 to 0 m)"
    assert repr(image(0)) == f"SarImage(complex128 on {GRID!r})"
    assert repr(GRID.xy) == "PixelGrid(4 x 3 pixels, x 0 to 0.03 m, y 0 to 0.02 m)"
    inside = np.zeros((4, 3), bool)
    inside[0] = True
    assert repr(ms.Mask(grid_xy=GRID.xy, inside=inside)) == "Mask(4 x 3 pixels, 25.0 % inside)"
    assert repr(ms.Prompts(points=[[0, 1], [2, 2]], positive=[True, False])) == "Prompts(1 positive, 1 negative)"
    assert repr(ms.Picture(rgb=np.zeros((4, 3, 3), np.uint8))) == "Picture(4 x 3 pixels, photo)"
    two = {"probabilities": [0.75, 0.25], "class_names": ("box", "can")}
    sure, unsure = (ms.Prediction(**two, threshold=threshold) for threshold in (0, 0.8))
    assert repr(sure) == "Prediction(box 0.75 of 2 classes)"
    assert repr(unsure) == "Prediction(box 0.75 of 2 classes, not sure below 0.80)"


def test_the_grid_must_be_a_grid():
    with pytest.raises(InputError, match="grid is of type int; expected VoxelGrid"):
        ms.SarImage(grid=3, values=np.zeros((1, 1, 1)))


@pytest.mark.parametrize("window", [3, ("hann",), ["hann", "taylor", None], {"a", "b"}])
def test_impossible_windows_are_refused(window):
    from millisight.imaging._windows import window_pair

    with pytest.raises(InputError, match="expected a name, or a pair of names"):
        window_pair(window)


def test_xarray_carries_coordinates():
    pytest.importorskip("xarray", reason="xarray is an extra")
    array = image(4).to_xarray()
    assert array.dims == ("x", "y", "z")
    assert array.x.attrs["units"] == "m"
    assert array.sel(x=0.01, y=0.0, z=0.0, method="nearest").item() == image(4).values[1, 0, 2]


def test_values_are_complex64_unless_they_come_as_a_complex128_array():
    values = np.full(GRID.shape, 1 + 1e-12j)
    assert ms.SarImage(grid=GRID, values=values).values.tobytes() == values.tobytes()
    assert ms.SarImage(grid=GRID, values=values.tolist()).values.dtype == np.complex64
    assert ms.SarImage(grid=GRID, values=values.real).values.dtype == np.complex64
