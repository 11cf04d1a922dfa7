"""Pictures of classifiers: what they show is read back from their own artists."""

import numpy as np
import pytest
from matplotlib.contour import QuadContourSet

import millisight as ms
from helpers.some_answers import EDGE, NAMES, answer, several
from millisight.evaluation import Mistake
from millisight.evaluation._answers import CLOSED, DISJOINT, NO_MASK
from millisight.viz import plot_accuracy, plot_confusion, plot_mistakes, plot_reliability

ANSWERS = several()
DATA = "tests (virtual rig; simulated, not real data)"


def words(figure):
    texts = [one.get_text() for axes in figure.axes for one in (*axes.texts, axes.title)]
    return " ".join(
        [*texts, *(one.get_text() for one in figure.texts), figure._suptitle.get_text() if figure._suptitle else ""]
    )


def mistake(*, masked=True):
    grid = ms.VoxelGrid(x=np.arange(8) * 0.01, y=np.arange(6) * 0.01, z=np.array([0.0]))
    values = np.ones(grid.shape, np.complex64)
    values[3, 2] = 16
    inside = np.zeros(grid.xy.shape, bool)
    inside[2:5, 1:4] = True
    truth = np.roll(inside, 1, axis=0)
    return Mistake(
        answer("can" if masked else None, 0.83),
        ms.SarImage(grid=grid, values=values),
        ms.Mask(grid_xy=grid.xy, inside=inside) if masked else None,
        ms.Mask(grid_xy=grid.xy, inside=truth),
    )


def test_bars_are_as_long_as_the_accuracy_and_lines_as_the_intervals():
    figure = plot_accuracy(ANSWERS, DISJOINT, data=DATA)
    (axes,) = figure.axes
    assert [round(bar.get_width(), 1) for bar in axes.patches] == [100, 75, 87.5, 50, 50, 50]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["shipped\nsmall, both", "edges\nsmall, edge only"]
    ticks = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "|" and len(line.get_xdata()) == 1]
    assert ticks == [88.8, 81.2, 85.2, 61.1, 75.0, 67.6]
    spans = [tuple(np.round(line.get_xdata(), 1)) for line in axes.lines if len(line.get_xdata()) == 2]
    assert (46.8, 91.1) in spans
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert sorted(labels) == sorted(
        ["line of sight", "out of sight", "overall", "by objects", "Wilson", "true masks", "paper, real data"]
    )
    assert DATA in words(figure)


def test_matrices_hold_the_counts():
    figure = plot_confusion(ANSWERS, CLOSED, EDGE, data=DATA)
    assert len(figure.axes) == 3
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["line of sight: 6 of 12", "out of sight: 6 of 12", "overall: 12 of 24"]
    seen, hidden, overall = (
        np.array([int(text.get_text()) for text in axes.texts]).reshape(4, 5) for axes in figure.axes
    )
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == [*NAMES, NO_MASK]
    assert seen.tolist() == [[3, 0, 0, 0, 0], [3, 0, 0, 0, 0], [0, 0, 3, 0, 0], [3, 0, 0, 0, 0]]
    assert hidden[3].tolist() == [0, 0, 0, 0, 3]
    assert np.array_equal(overall, seen + hidden)
    shares = figure.axes[2].images[0].get_array()
    assert np.allclose(shares.sum(axis=1), 1)
    assert DATA in words(figure)


def test_the_curve_goes_through_the_bins():
    figure = plot_reliability(ANSWERS, CLOSED, data=DATA)
    axes, below = figure.axes
    curves = [line for line in axes.lines if line.get_marker() not in ("None", None, "")]
    assert [line.get_label() for line in curves] == ["shipped: error 0.100", "edges: error 0.171"]
    assert [line.get_xdata()[0] for line in curves] == pytest.approx([0.9, 0.4])
    assert [line.get_ydata()[0] for line in curves] == pytest.approx([1.0, 12 / 21])
    assert [bar.get_height() for bar in below.patches] == [21, 21]


def test_a_mistake_shows_the_image_both_masks_and_what_is_left():
    figure = plot_mistakes([mistake(), mistake(masked=False)], title=f"mine: {DATA}")
    assert len(figure.axes) == 4
    whole, left, _, nothing = (axes.images[0].get_array() for axes in figure.axes)
    assert whole.shape == (6, 8)
    assert whole[2, 3] == left[2, 3] == 1
    assert whole[0, 0] == pytest.approx(0.25)
    assert left[0, 0] == 0
    assert (left > 0).sum() == 9
    assert not nothing.any()
    outlines = [len([one for one in axes.get_children() if isinstance(one, QuadContourSet)]) for axes in figure.axes]
    assert outlines == [2, 0, 1, 0]
    text = words(figure)
    assert "box → can, 83 %\ndice (built), LOS, 0 0 0°, IoU 0.80" in text
    assert "box → no mask" in text
    assert DATA in text
