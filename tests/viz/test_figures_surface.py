"""Figures of surfaces and oriented points, and the viewer's reading of them."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection

import millisight as ms
from millisight.viz import plot_points, plot_surface

MESH = ms.TriangleMesh(vertices=[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], faces=[[0, 1, 2], [0, 1, 3]])
SEEN = ms.Surface(mesh=MESH, sigma=[1e-3, 2e-3, 3e-3, 4e-3])
CLOUD = ms.PointCloud(points=MESH.vertices, normals=[[0, 0, 1]] * 4)


def test_a_surface_is_drawn_three_times_in_the_colours_of_its_deviation():
    figure = SEEN.plot(truth=MESH, points=CLOUD, title="mug")
    *panels, bar = figure.axes
    assert len(panels) == 3
    assert bar.get_ylabel() == "standard deviation [mm]"
    for panel in panels:
        truth, seen = (one for one in panel.collections if isinstance(one, PolyCollection))
        assert len(truth.get_paths()) == len(seen.get_paths()) == 2
        assert len(np.unique(seen.get_facecolor(), axis=0)) == 2
    assert plot_surface(SEEN, worst=0.01).axes[3].get_ylim()[1] == pytest.approx(10)


def test_points_are_drawn_over_the_object():
    figure = plot_points(CLOUD, truth=[MESH])
    assert len(figure.axes) == 3
    assert all(len(axes.lines[0].get_xdata()) == 4 for axes in figure.axes)
    outlined = [[one for one in axes.collections if isinstance(one, LineCollection)] for axes in figure.axes]
    assert all(outlined)
    assert not any(isinstance(one, LineCollection) for axes in plot_points(CLOUD).axes for one in axes.collections)


def test_the_viewer_takes_points_of_a_ply_file_as_points(tmp_path):
    pytest.importorskip("viser", reason="needs viser: make setup")
    from millisight.viz.viewer import gather

    ms.write_point_cloud(tmp_path / "points.ply", CLOUD)
    ms.save(tmp_path / "seen.h5", SEEN)
    (exhibit,) = gather([tmp_path / "points.ply", tmp_path / "seen.h5"]).exhibits
    assert exhibit.meshes[0].faces.shape == (2, 3)
    assert exhibit.points[0].normals.shape == (4, 3)
