"""Figures of voxels: outlines in three views at their place, over the image's maximum."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection

import millisight as ms
from millisight import viz
from millisight.core.errors import InputError

GRID = ms.VoxelGrid(x=0.01 * np.arange(8), y=0.1 + 0.01 * np.arange(6), z=-0.3 + 0.02 * np.arange(5))
LOWER, UPPER = np.array([0.015, 0.105, -0.29]), np.array([0.055, 0.135, -0.25])  # borders of the voxels inside
PLANES = {"z": (0, 1), "y": (0, 2), "x": (1, 2)}


def volume():
    inside = np.zeros(GRID.shape, bool)
    inside[2:6, 1:4, 1:3] = True
    return ms.VolumeMask(grid=GRID, inside=inside)


def image():
    return ms.SarImage(grid=GRID, values=np.random.default_rng(0).random(GRID.shape))


def panels(figure):
    return dict(zip(PLANES, (axes for axes in figure.axes if axes.get_xlabel().endswith("[m]")), strict=True))


def test_outlines_surround_the_voxels_in_each_view():
    figure = viz.plot_volume(volume(), image=image(), title="box")
    for axis, axes in panels(figure).items():
        (lines,) = [c for c in axes.collections if isinstance(c, LineCollection)]
        ends = np.concatenate(lines.get_segments())
        plane = list(PLANES[axis])
        np.testing.assert_allclose([ends.min(axis=0), ends.max(axis=0)], [LOWER[plane], UPPER[plane]], atol=1e-12)
        shown = np.asarray(axes.images[0].get_array()).T
        expected = image().project(axis, reduce="max")
        np.testing.assert_allclose(shown, 20 * np.log10(expected / expected.max()), atol=1e-4)
    assert [axes.get_ylabel() for axes in figure.axes if "max |I|" in axes.get_ylabel()] == ["max |I|  [dB re max]"]


def test_without_an_image_the_voxels_are_white():
    figure = volume().plot()
    assert len(figure.axes) == 3  # and no colour bar
    for axis, axes in panels(figure).items():
        seen = volume().inside.any(axis="xyz".index(axis))
        np.testing.assert_array_equal(np.asarray(axes.images[0].get_array()).T, seen)


def test_nothing_inside_has_no_outline(tmp_path):
    none = ms.VolumeMask(grid=GRID, inside=np.zeros(GRID.shape, bool))
    viz.save_figure(viz.plot_volume(none, image=image()), tmp_path / "none.png")
    assert (tmp_path / "none.png").stat().st_size > 1000


def test_what_does_not_fit_is_refused():
    other = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=GRID.z + 0.01)
    with pytest.raises(InputError, match="different voxels, along z"):
        viz.plot_volume(volume(), image=ms.SarImage(grid=other, values=image().values))
    with pytest.raises(InputError, match="map"):
        viz.plot_volume(volume(), image=image(), colormap="nothing")
