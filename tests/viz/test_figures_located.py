"""Figures of located objects, of predictions, and what the methods `plot` say of their settings."""

import inspect

import numpy as np
import pytest

import millisight as ms
from millisight import viz
from millisight.core.errors import InputError
from millisight.data import NONE_OF_THEM, Instances, Located, Pose, VolumeMask

MESH = ms.TriangleMesh(
    vertices=[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], faces=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
)
AWAY = np.array([1.0, 2.0, 3.0])


def located(points, magnitude=None):
    pose = Pose(
        name="wedge", rotation=np.eye(3), translation=AWAY, middle=np.zeros(3), covariance=np.eye(6) * 1e-6,
        free_axes=[], score=0.471, explained=0.4, shown=0.5,
    )  # fmt: skip
    cloud = ms.PointCloud(points=points, magnitude=magnitude)
    return Located(poses=(pose,), probabilities={"wedge": 1.0, NONE_OF_THEM: 0.0}, points=cloud)


def test_a_located_mesh_is_seen_among_thousands_of_points():
    rng = np.random.default_rng(0)
    near = AWAY + rng.uniform(0, 0.1, (900, 3))
    far = AWAY + rng.uniform(0.3, 2, (2000, 3))
    magnitude = np.r_[np.arange(900.0), np.full(2000, 1e4)]
    figure = located(np.concatenate([near, far]), magnitude).plot(MESH)
    title, told = (text.get_text() for text in figure.texts)
    assert title == "wedge, score 0.47"
    assert "the brightest 400 of 900 points" in told
    assert "farther off: 2000" in " ".join(told.split())
    for axes, (right, up) in zip(figure.axes, ((0, 1), (0, 2), (1, 2)), strict=True):
        (dots,) = (line for line in axes.lines if line.get_marker() == ".")
        assert sorted(dots.get_xdata()) == sorted(near[500:, right])
        outline = max(axes.collections, key=lambda one: one.get_zorder())
        assert outline.get_zorder() > dots.get_zorder()
        for limits, one in ((axes.get_xlim(), right), (axes.get_ylim(), up)):
            assert AWAY[one] - 0.06 < limits[0] < AWAY[one]
            assert AWAY[one] + 0.1 < limits[1] < AWAY[one] + 0.16


def test_a_located_mesh_without_points_beside_it():
    figure = located([[0, 0, 0]]).plot(MESH, title="mine")
    assert figure.texts[0].get_text() == "mine"
    assert "no points around the mesh; farther off: 1" in " ".join(figure.texts[1].get_text().split())


def test_a_prediction_draws_itself_with_and_without_the_image():
    prediction = ms.Prediction(probabilities=[0.7, 0.3], class_names=("cup", "box"), threshold=0.6)
    (bars,) = prediction.plot().axes
    assert [bar.get_width() for bar in bars.patches] == [0.7, 0.3]
    image = ms.SarImage.from_array(np.ones((5, 4)), 0.01)
    mask = ms.Mask(grid_xy=image.grid.xy, inside=np.eye(5, 4) > 0)
    left, right = prediction.plot(image, mask).axes
    assert left.get_title() == "mask: 20.0 % of the picture"
    assert right.get_title() == "cup"
    assert prediction.plot(image).axes[0].get_title() == ""
    with pytest.raises(InputError, match="no image"):
        prediction.plot(mask=mask)


@pytest.mark.parametrize(
    ("record", "function"),
    [
        (ms.SarImage, viz.plot_image), (ms.Mask, viz.plot_mask), (ms.Capture, viz.plot_capture),
        (ms.TriangleMesh, viz.plot_mesh), (ms.Scene, viz.plot_scene), (ms.Surface, viz.plot_surface),
        (Instances, viz.plot_instances), (VolumeMask, viz.plot_volume), (Located, viz.plot_located),
        (ms.Prediction, viz.plot_prediction),
    ],
)  # fmt: skip
def test_the_methods_name_their_settings(record, function):
    settings = [one.name for one in inspect.signature(function).parameters.values() if one.kind is one.KEYWORD_ONLY]
    assert settings
    assert [name for name in settings if f"`{name}`" not in record.plot.__doc__] == []
