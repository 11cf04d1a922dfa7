"""Figures of what was found in one image: its mask, and the classes of it."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from millisight.core import PUBLISHED_COLORMAP, check_shape
from millisight.core.errors import InputError
from millisight.data import Mask, PixelGrid, Prediction, SarImage
from millisight.viz import _figures, _panels
from millisight.viz._figures import BLUE, GREY, ORANGE, show_image, taken_axes
from millisight.viz._figures_perception import draw_mask_outline
from millisight.viz._panels import Scale, checked_colormap, panel_of, styled

if TYPE_CHECKING:
    from millisight.perception.segmentation import Flat, Round, Segmented

_WIDEST_REASON = 40  # letters of a line
_BAR_ROOM = 1.75  # between two panels, for a colour bar and the labels of both [inches]


@styled
def plot_prediction(
    image: SarImage | None,
    mask: Mask | None,
    prediction: Prediction,
    *,
    dynamic_range_db: float = 30,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """Plot a prediction: the image in dB with the outline of the mask, and a bar for each class; `Prediction.plot`.

    The most probable class's bar is blue where the answer is sure, and orange where it is not; a dashed line stands at
    the probability from which it is.

    Parameters
    ----------
    image : SarImage, seen along z; None: the bars alone
    mask : on the image's grid; None: no outline
    prediction : Prediction
    dynamic_range_db : of the picture, below its maximum [dB]
    axes : two, or one without an image; default those of a new figure, side by side

    Returns
    -------
    np.ndarray
        (2,) of Axes, or (1,) without an image.

    Raises
    ------
    InputError
        The mask is not of the image's size, there is a mask and no image, or `axes` are not as many.
    """
    if image is None:
        if mask is not None:
            raise InputError("a prediction with a mask and no image; expected the image that the mask lies on as well")
        (alone,) = taken_axes(axes, 1, 1, size=3.3)
        _draw_bars(alone, prediction)
        return np.array([alone])
    if mask is not None:
        check_shape(mask.inside.shape, name="mask", shape=image.grid.xy.shape)
    left, right = taken_axes(axes, 1, 2, size=3.3, tall=min(max(_figures.tallness(image.grid.xy), 0.6), 1.5))
    show_image(left, image, Scale.checked("db", dynamic_range_db), checked_colormap())
    if mask is not None:
        left.set_title(f"mask: {100 * mask.inside.mean():.1f} % of the picture")
        outline = draw_mask_outline(left, mask.inside, mask.grid_xy)
        if outline is not None:
            outline.set_path_effects([Stroke(linewidth=2.1, foreground="black", alpha=0.45), Normal()])
    _draw_bars(right, prediction)
    return np.array([left, right])


def _answer(prediction: Prediction) -> str:
    if not prediction.novel:
        return prediction.answer
    words = f"{prediction.answer}: novelty {prediction.novelty:.2f}"
    return "\n".join((words, *(textwrap.fill(reason, _WIDEST_REASON) for reason in prediction.reasons)))


def _draw_bars(axes: Axes, prediction: Prediction) -> None:
    """The classes from top to bottom as the network has them, so that pictures can be compared."""
    names, shares = prediction.class_names, prediction.probabilities
    colours = [GREY] * len(names)
    colours[int(np.argmax(shares))] = BLUE if prediction.sure else ORANGE
    bars = axes.barh(np.arange(len(names)), shares, height=0.7, color=colours, zorder=2)
    axes.bar_label(
        bars,
        [f"{share:.2f}" for share in shares],
        padding=3,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        zorder=4,
    )
    label = "probability"
    if prediction.threshold > 0:
        label += f" (dashed: threshold {prediction.threshold:.2f})"
        axes.axvline(prediction.threshold, color="black", linewidth=1, linestyle="--", zorder=3)
    axes.set_yticks(np.arange(len(names)), names)
    axes.set(xlim=(0, 1.12), ylim=(len(names) - 0.4, -0.6), xlabel=label, title=_answer(prediction))
    axes.set_xticks(np.linspace(0, 1, 6))
    axes.set_facecolor("white")
    axes.spines[["top", "right"]].set_visible(False)


@styled
def plot_segmentation(
    found: "Segmented", *, forms: "Sequence[Round | Flat]" = (), dynamic_range_db: float = 30, title: str | None = None
) -> Figure:
    """Plot a segmentation: the picture that it was found on, linear, and in dB with the mask's outline.

    With prompts, they lie on the picture in the rainbow colours of the paper, as the segmenters with prompts see it.
    Without, the picture has the same colours as the one in dB.

    Parameters
    ----------
    found : on a radar image
    forms : what of it is round or flat, drawn with its size
    dynamic_range_db : of the picture with the mask, below its maximum [dB]
    title : written above

    Raises
    ------
    InputError
        It was found on a photo.
    """
    grid, power = found.picture.grid_xy, found.picture.power
    if grid is None or power is None:
        raise InputError("plot_segmentation got a mask on a photo; expected one on a radar image")
    scales = Scale.checked("linear", dynamic_range_db), Scale.checked("db", dynamic_range_db)
    figure, (row,), (bar,) = _panels.place_panels(
        [[[panel_of(grid)], [panel_of(grid)]]], title=title, width=10.0, gaps=(_BAR_ROOM, 0.78), headroom=0.15
    )
    colours = checked_colormap(PUBLISHED_COLORMAP if found.prompts is not None else None), checked_colormap()
    for axes, scale, colour_map, place in zip(row, scales, colours, (_bar_beside(row[0]), bar), strict=True):
        _panels.show_pixels(axes, grid.x, grid.y, scale(power), scale, colour_map)
        _panels.add_colour_bar(place, scale, colour_map, f"mean {scale.unit}")
        axes.set(xlabel="x [m]", ylabel="y [m]")
    _draw_prompts(row[0], found, grid)
    row[1].set_title(f"mask: {100 * found.inside.mean():.1f} % of the picture")
    _panels.draw_lines(row[1], _panels.mask_borders(found.mask), color="white", width=1.2, zorder=4)
    _panels.draw_outlines(row[1], [(one.outline, one.short) for one in forms])
    return figure


def _bar_beside(axes: Axes) -> Axes:
    """Axes for a colour bar in the gap to the right of a panel, as wide and as far from it as the last panel's."""
    figure: Any = axes.figure
    place, inches = axes.get_position(), figure.get_size_inches()[0]
    return figure.add_axes((place.x1 + 0.16 / inches, place.y0, 0.13 / inches, place.height))


def _draw_prompts(axes: Axes, found: "Segmented", grid: PixelGrid) -> None:
    if found.prompts is None:
        axes.set_title("the picture")
        return
    points, positive = found.prompts.points, found.prompts.positive
    for kind, marker, colour, edge in ((positive, "o", "white", "0.4"), (~positive, "X", "black", "white")):
        i, j = points[kind].T
        axes.scatter(grid.x[i], grid.y[j], s=24, marker=marker, c=colour, edgecolors=edge, linewidths=0.6, zorder=4)
    counts = f"{int(positive.sum())} on the object \u25cf, {int((~positive).sum())} beside it \u2716"
    axes.set_title(f"the picture and prompts:\n{counts}")
