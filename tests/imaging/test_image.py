"""Grids, images and their combination."""

import json

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
        ((0, 0, 0), (1, 1, 1), 1e-309, "inf voxels; expected 1e"),
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


def test_images_and_masks_are_arrays_to_numpy():
    one = image(4)
    inside = np.eye(4, 3) > 0
    mask = ms.Mask(grid_xy=GRID.xy, inside=inside)
    voxels = ms.VolumeMask(grid=GRID, inside=np.repeat(inside[..., None], 3, axis=2))
    for record, array in ((one, one.values), (mask, mask.inside), (voxels, voxels.inside)):
        assert np.asarray(record) is array  # no copy where none is needed
        copied = np.array(record, copy=True)
        copied[:] = 0
        assert np.array_equal(np.asarray(record), array)
        assert array.any()
        with pytest.raises(ValueError, match="copy"):
            np.asarray(record, dtype=np.complex64 if array.dtype != np.complex64 else np.complex128, copy=False)
    assert np.asarray(one, dtype=np.complex128).dtype == np.complex128
    assert np.array_equal(abs(one), np.abs(one.values))
    assert np.array_equal(np.asarray(mask, dtype=float), inside.astype(float))


def test_a_plain_array_becomes_an_image():
    values = np.random.default_rng(0).normal(size=(4, 3, 2))
    one = ms.SarImage.from_array(values, (0.01, 0.02, 0.04), center=(0.1, 0, -0.2), metadata={"source": "mine"})
    assert one.grid.x == pytest.approx([0.085, 0.095, 0.105, 0.115])
    assert one.grid.y == pytest.approx([-0.02, 0, 0.02])
    assert one.grid.z == pytest.approx([-0.22, -0.18])
    assert np.array_equal(one.values, values.astype(np.complex64))
    assert one.metadata == {"source": "mine"}
    flat = ms.SarImage.from_array(values[..., 0], 0.01)
    assert flat.grid.shape == (4, 3, 1)
    assert ms.SarImage.from_array(values + 1e-12j, 0.01).values.dtype == np.complex128


def test_a_plain_array_is_segmented_at_its_place():
    """A bright square, in an image of another program."""
    values = np.full((40, 30, 4), 0.01)
    values[8:14, 16:24] = 1.0
    mask = ms.segment(ms.SarImage.from_array(values, 0.005), method="classical", rng=0)
    assert mask.inside[8:14, 16:24].mean() > 0.8
    assert mask.inside.sum() < 100


@pytest.mark.parametrize(
    ("values", "spacing", "message"),
    [
        (np.zeros(3), 0.01, r"values has shape \(3,\); expected \(X, Y, Z\)"),
        (np.zeros((2, 0, 2)), 0.01, "no empty dimension"),
        (np.full((2, 2, 2), np.nan), 0.01, "values has 8 values that are NaN"),
        (np.zeros((2, 2, 2)), 0, "spacing is 0 m; expected more than 0 m"),
        (np.zeros((2, 2, 2)), (1, 1), "spacing has 2 numbers; expected 3"),
    ],
)
def test_arrays_that_are_no_image_are_refused(values, spacing, message):
    with pytest.raises(InputError, match=message):
        ms.SarImage.from_array(values, spacing)


METADATA = {
    "history": [{"step": "simulate", "model": "edge", "edge": None}, {"step": "form_image"}],
    "placed": {"rotate_deg": [0.0, 90.0, 0.0]},
    "seed": 2**40,
    "count": 3,
    "snr_db": 12.5,
    "name": "Würfel",
    "looks_like_json": "[1]",
    "empty": "",
    "two_sided": True,
    "unit": None,
}


@pytest.mark.slow
def test_xarray_carries_coordinates_and_flat_attributes():
    pytest.importorskip("xarray", reason="xarray is an extra")
    given = image(4)
    array = ms.SarImage(grid=GRID, values=given.values, metadata=METADATA).to_xarray()
    assert array.dims == ("x", "y", "z")
    assert array.x.attrs["units"] == "m"
    assert array.sel(x=0.01, y=0.0, z=0.0, method="nearest").item() == given.values[1, 0, 2]
    assert {type(value) for value in array.attrs.values()} == {str, int, float}
    assert json.loads(array.attrs["history"]) == METADATA["history"]
    assert (array.attrs["name"], array.attrs["snr_db"]) == ("Würfel", 12.5)


@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
@pytest.mark.parametrize("form", ["memory", "netcdf", "zarr", "zarr of complex values"])
def test_what_is_saved_by_xarray_is_read_back(tmp_path, form, dtype):
    xarray = pytest.importorskip("xarray", reason="xarray is an extra")
    if "zarr" in form:
        pytest.importorskip("zarr", reason="zarr is not installed: pip install zarr")
    given = ms.SarImage(grid=GRID, values=np.asarray(image(4), dtype=dtype), metadata=METADATA)
    data = given.to_xarray(parts="complex" not in form)
    if form == "netcdf":
        data.to_netcdf(tmp_path / "image.nc", engine="scipy")
        with xarray.open_dataset(tmp_path / "image.nc", engine="scipy") as file:
            data = file.load()
    elif form != "memory":
        data.to_zarr(tmp_path / "image.zarr", zarr_format=2)
        with xarray.open_zarr(tmp_path / "image.zarr") as file:
            data = file.load() if "complex" not in form else file["image"].load()
    read = ms.SarImage.from_xarray(data)
    assert read.values.dtype == dtype
    assert np.array_equal(read.values, given.values)
    assert all(np.array_equal(getattr(read.grid, name), getattr(GRID, name)) for name in "xyz")
    assert read.metadata == METADATA
    assert [type(read.metadata[name]) for name in ("count", "seed", "two_sided")] == [int, int, bool]


def test_axes_of_xarray_may_be_in_any_order():
    pytest.importorskip("xarray", reason="xarray is an extra")
    data = image(4).to_xarray().transpose("z", "x", "y")
    assert np.array_equal(ms.SarImage.from_xarray(data).values, image(4).values)


def test_units_of_coordinates_in_xarray_count():
    pytest.importorskip("xarray", reason="xarray is an extra")
    data = image(4).to_xarray()
    coarse = data.assign_coords({name: 1000 * data[name] for name in "xyz"})
    for name in "xyz":
        coarse[name].attrs["units"] = "mm"
    read = ms.SarImage.from_xarray(coarse)
    for name in "xyz":
        np.testing.assert_allclose(getattr(read.grid, name), getattr(GRID, name), atol=1e-12)
    coarse["y"].attrs["units"] = "inch"
    with pytest.raises(InputError, match="its coordinate y has the units 'inch', not m, cm, mm"):
        ms.SarImage.from_xarray(coarse)


@pytest.mark.parametrize(
    ("place", "side"),
    [((0, 0, 0.3), "above"), ((0.1, 0, -0.3), "below"), ((0.5, 0.1, 0.1), "beside"), ((0.01, 0, 0), None)],
)
def test_from_where_an_image_was_seen(place, side):
    antennas = [a + b for a, b in zip(GRID.bounds.mean(axis=0), place, strict=True)]
    seen = ms.SarImage(grid=GRID, values=image(4).values, metadata={"history": [{"antennas": [antennas, antennas]}]})
    assert seen.seen_from == side
    assert image(4).seen_from is None
    over = seen.turned_over
    assert over.seen_from == {"above": "below", "below": "above"}.get(side, side)
    np.testing.assert_array_equal(over.turned_over.values, seen.values)
    np.testing.assert_allclose(over.turned_over.antennas, [antennas, antennas])


@pytest.mark.parametrize("box", ["x", [0, 0, 1], [[0, 0, np.nan], [0, 0, 1]]])
def test_a_box_is_two_corners(box):
    with pytest.raises(InputError, match="box"):
        GRID.side_of(box)


def test_a_wide_aperture_is_above_what_lies_under_its_corner():
    radar, wide = (
        ms.Radar.preset("mito-sim-24ghz"),
        ms.Trajectory.raster(size=(0.8, 0.8), step=0.1, center=(0.4, 0.4, 0.3)),
    )
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.04, 0.04, 0.02), 0.02)
    capture = ms.simulate(ms.Scene.from_mesh("golf_ball", vertices=100), radar, wide)
    seen = ms.form_image(capture, grid)
    assert seen.seen_from == "above"
    np.testing.assert_allclose(seen.antennas, [wide.positions.min(axis=0), wide.positions.max(axis=0)], atol=0.05)
    for odd in ([1, 2, 3], "above", [[0, 0, None], [0, 0, 1]]):
        told = {"history": [{"antennas": odd}]}
        assert ms.SarImage(grid=grid, values=seen.values, metadata=told).antennas is None


def test_what_is_no_image_in_xarray_is_refused():
    xarray = pytest.importorskip("xarray", reason="xarray is an extra")
    whole = image(4).to_xarray(parts=True)
    for wrong in (3, whole.drop_vars("imag"), whole.drop_vars("z"), xarray.DataArray(np.zeros((2, 2)))):
        with pytest.raises(InputError, match="data is no image: .*expected an xarray.DataArray"):
            ms.SarImage.from_xarray(wrong)


def test_values_are_complex64_unless_they_come_as_a_complex128_array():
    values = np.full(GRID.shape, 1 + 1e-12j)
    assert ms.SarImage(grid=GRID, values=values).values.tobytes() == values.tobytes()
    assert ms.SarImage(grid=GRID, values=values.tolist()).values.dtype == np.complex64
    assert ms.SarImage(grid=GRID, values=values.real).values.dtype == np.complex64
