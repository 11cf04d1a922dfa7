"""The picture of a prediction: the image under its mask, and a bar for each class."""

import dataclasses
import io

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import Prediction
from millisight.viz import plot_prediction, save_figure
from millisight.viz._figures import BLUE, GREY, ORANGE

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.15, 0.1, 0.01), (0.005, 0.005, 0.01))
CLASSES = ("can", "handle", "box", "sphere")


def image():
    values = 0.02 * np.random.default_rng(0).rayleigh(size=GRID.shape)
    values[8:16, 5:15] += 1
    return ms.SarImage(grid=GRID, values=values)


def mask(inside=(slice(8, 16), slice(5, 15))):
    pixels = np.zeros(GRID.xy.shape, bool)
    pixels[inside] = True
    return ms.Mask(grid_xy=GRID.xy, inside=pixels)


def prediction(*shares, threshold=0.6):
    return Prediction(probabilities=np.array(shares), class_names=CLASSES, threshold=threshold)


def bars(axes):
    """Length and colour of each class's bar, from top to bottom."""
    assert axes.yaxis_inverted()
    names = [label.get_text() for label in axes.get_yticklabels()]
    return {name: (bar.get_width(), to_hex(bar.get_facecolor())) for name, bar in zip(names, axes.patches, strict=True)}


def test_every_class_has_its_bar_and_the_answer_its_colour():
    _, sure = plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05))
    held = bars(sure)
    assert list(held) == list(CLASSES)
    assert [share for share, _ in held.values()] == pytest.approx([0.1, 0.05, 0.8, 0.05])
    assert [colour for _, colour in held.values()] == [c.lower() for c in (GREY, GREY, BLUE, GREY)]
    assert sure.get_title() == "box"
    assert [text.get_text() for text in sure.texts] == ["0.10", "0.05", "0.80", "0.05"]
    _, unsure = plot_prediction(image(), mask(), prediction(0.35, 0.1, 0.45, 0.1))
    assert bars(unsure)["box"] == (pytest.approx(0.45), ORANGE.lower())
    assert unsure.get_title() == "not sure"


def test_why_it_is_novel_stands_above_the_bars():
    novel = dataclasses.replace(
        prediction(0.1, 0.05, 0.8, 0.05), novelty=0.9, novelty_limit=0.4,
        reasons=("the mask looks like a lid, or like the flat top of something large",),
    )  # fmt: skip
    title = plot_prediction(image(), mask(), novel)[1].get_title()
    first, *others = title.splitlines()
    assert first == "not sure: novelty 0.90"
    assert " ".join(others) == novel.reasons[0]
    assert len(others) == 2


def test_the_threshold_is_a_line_where_there_is_one():
    _, with_it = plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05))
    (line,) = with_it.lines
    assert set(line.get_xdata()) == {0.6}
    assert with_it.get_xlabel() == "probability (dashed: threshold 0.60)"
    _, without = plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05, threshold=0))
    assert not without.lines
    assert without.get_xlabel() == "probability"


def test_the_outline_is_that_of_the_mask():
    left, _ = plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05))
    (rim,) = (one for one in left.get_children() if isinstance(one, ContourSet))
    (around,) = rim.get_paths()
    x, y = around.vertices.T
    assert (x.min(), x.max()) == pytest.approx((GRID.x[7] + 0.0025, GRID.x[15] + 0.0025))
    assert (y.min(), y.max()) == pytest.approx((GRID.y[4] + 0.0025, GRID.y[14] + 0.0025))
    share = 100 * mask().inside.mean()
    assert left.get_title() == f"mask: {share:.1f} % of the picture"


@pytest.mark.parametrize("everything", [(slice(None), slice(None)), (slice(0, 0), slice(0, 0))])
def test_a_mask_of_all_or_nothing_has_no_outline(everything):
    left, _ = plot_prediction(image(), mask(everything), prediction(0.1, 0.05, 0.8, 0.05))
    assert not [one for one in left.get_children() if isinstance(one, ContourSet)]


def test_it_is_drawn_into_axes_that_are_given_and_comes_out_the_same():
    figure = Figure()
    mine = figure.subplots(1, 2)
    axes = plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05), axes=mine)
    assert axes.shape == (2,)
    assert all(isinstance(one, Axes) and one is other for one, other in zip(axes, mine, strict=True))
    figure.savefig(io.BytesIO())


@pytest.mark.slow
def test_the_same_prediction_gives_the_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        save_figure(plot_prediction(image(), mask(), prediction(0.1, 0.05, 0.8, 0.05))[0].figure, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_what_does_not_fit_is_refused():
    shares = prediction(0.1, 0.05, 0.8, 0.05)
    other = ms.Mask(grid_xy=ms.PixelGrid(x=GRID.x[1:], y=GRID.y), inside=mask().inside[1:])
    with pytest.raises(InputError, match="mask has shape"):
        plot_prediction(image(), other, shares)
    with pytest.raises(InputError, match="expected 2 Matplotlib Axes"):
        plot_prediction(image(), mask(), shares, axes=[Figure().subplots()])
