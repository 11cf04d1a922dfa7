"""Figures of segmentation: prompts and mask over the picture."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight.core.errors import InputError
from millisight.data import PixelGrid
from millisight.perception.segmentation import Segmented
from millisight.viz._style import (
    Panel,
    Scale,
    add_colour_bar,
    borders,
    checked_colormap,
    draw_lines,
    place_panels,
    show_pixels,
    styled,
)


@styled
def plot_segmentation(found: Segmented, *, dynamic_range_db: float = 30, title: str | None = None) -> Figure:
    """A segmentation: the power in the rainbow's colours with the prompts, and in dB with the mask.

    Parameters
    ----------
    found : on a radar image
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
    panel = Panel.around(*(borders(axis, 1e-3) for axis in (grid.x, grid.y)))
    scales = Scale.checked("linear", dynamic_range_db), Scale.checked("db", dynamic_range_db)
    figure, (row,), (bar,) = place_panels([[[panel], [panel]]], title=title)
    for axes, scale, name in zip(row, scales, ("jet", None), strict=True):
        show_pixels(axes, grid.x, grid.y, scale(power), scale, checked_colormap(name))
        axes.set(xlabel="x [m]", ylabel="y [m]")
    _draw_prompts(row[0], found, grid)
    _draw_mask(row[1], found.inside, grid)
    add_colour_bar(bar, scales[1])
    return figure


def _draw_prompts(axes: Axes, found: Segmented, grid: PixelGrid) -> None:
    if found.prompts is None:
        axes.set_title("without prompts")
        return
    points, positive = found.prompts.points, found.prompts.positive
    for kind, marker, colour, edge in ((positive, "o", "white", "0.4"), (~positive, "X", "black", "white")):
        i, j = points[kind].T
        axes.scatter(grid.x[i], grid.y[j], s=24, marker=marker, c=colour, edgecolors=edge, linewidths=0.6, zorder=4)
    axes.set_title(f"{int(positive.sum())} prompts on the object \u25cf, {int((~positive).sum())} beside it \u2716")


def _draw_mask(axes: Axes, inside: np.ndarray, grid: PixelGrid) -> None:
    axes.set_title(f"mask: {100 * inside.mean():.1f} % of the picture")
    # Along the pixels' borders, that is: around one pixel as around many, and along the picture's rim.
    x, y = (borders(axis, 1e-3) for axis in (grid.x, grid.y))
    padded = np.pad(inside, 1)
    across, along = np.diff(padded, axis=0)[:, 1:-1], np.diff(padded, axis=1)[1:-1]
    lines = [((x[i], y[j]), (x[i], y[j + 1])) for i, j in np.argwhere(across)]
    lines += [((x[i], y[j]), (x[i + 1], y[j])) for i, j in np.argwhere(along)]
    draw_lines(axes, np.array(lines).reshape(-1, 2, 2), color="white", width=1.2, zorder=4)
