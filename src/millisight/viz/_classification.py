"""Figures of classification: the masked image, and the probability of each class."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, Stroke

from millisight.core import check_shape
from millisight.data import Mask, Prediction, SarImage
from millisight.viz._figures import BLUE, GREY, ORANGE, show_image, taken_axes, tallness
from millisight.viz._figures_perception import draw_mask_outline
from millisight.viz._style import Scale, checked_colormap, styled


@styled
def plot_prediction(
    image: SarImage,
    mask: Mask,
    prediction: Prediction,
    *,
    dynamic_range_db: float = 30,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """A prediction: the image in dB with the mask's outline, and a bar for each class.

    The most probable class's bar is blue where the answer is sure, and orange where it is not; a dashed line stands at
    the probability from which it is.

    Parameters
    ----------
    image : SarImage, seen along z
    mask : on the image's grid
    prediction : Prediction
    dynamic_range_db : of the picture, below its maximum [dB]
    axes : two; default those of a new figure, side by side

    Returns
    -------
    np.ndarray
        (2,) of Axes.

    Raises
    ------
    InputError
        The mask is not of the image's size, or `axes` are not two.
    """
    check_shape(mask.inside.shape, name="mask", shape=image.grid.xy.shape)
    left, right = taken_axes(axes, 1, 2, size=3.3, tall=min(max(tallness(image.grid.xy), 0.6), 1.5))
    show_image(left, image, Scale.checked("db", dynamic_range_db), checked_colormap())
    left.set_title(f"mask: {100 * mask.inside.mean():.1f} % of the picture")
    outline = draw_mask_outline(left, mask.inside, mask.grid_xy)
    if outline is not None:
        outline.set_path_effects([Stroke(linewidth=2.1, foreground="black", alpha=0.45), Normal()])
    _draw_bars(right, prediction)
    return np.array([left, right])


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
    axes.set(xlim=(0, 1.12), ylim=(len(names) - 0.4, -0.6), xlabel=label, title=prediction.answer)
    axes.set_xticks(np.linspace(0, 1, 6))
    axes.set_facecolor("white")
    axes.spines[["top", "right"]].set_visible(False)
