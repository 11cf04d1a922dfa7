"""Figures of several objects in one image."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.colors import ListedColormap, to_hex
from matplotlib.figure import Figure

from millisight.core.errors import InputError
from millisight.data import Instances, SarImage, grid_difference
from millisight.viz import _figures
from millisight.viz._figures_perception import draw_mask_outline
from millisight.viz._panels import Scale, borders, checked_colormap, draw_outlines, panel_of, show_pixels, styled

if TYPE_CHECKING:
    from millisight.perception.segmentation import Flat, Round

_COLOURS = "tab10"
_VEIL = 0.45  # of an object's colour over the image
_LETTERS = 62  # of a line of the title
_ALONE = 1e-3  # width of the only pixel along an axis [m]


@styled
def plot_instances(
    instances: Instances,
    *,
    image: SarImage | None = None,
    forms: "Sequence[Round | Flat]" = (),
    title: str | None = None,
    dynamic_range_db: float = 30,
    colormap: str = "gray",
) -> Figure:
    """Plot each object in a colour of its own, with its number, over the image.

    Parameters
    ----------
    instances : Instances
    image : on the same pixels; None: nothing below the colours
    forms : what of them is round or flat, drawn with its size
    title : written above
    dynamic_range_db, colormap : of the image, as for `plot_image`

    Raises
    ------
    InputError
        The image has other pixels, or there is no such colour map.
    """
    grid = instances.grid_xy
    shades, colours = Scale.checked("db", dynamic_range_db), checked_colormap(colormap)
    if image is not None and (differs := grid_difference(image.grid, grid)):
        raise InputError(f"the image and the instances have different pixels, along {differs}")
    figure = Figure(figsize=(5.0, max(2.5, 5.0 * _figures.tallness(grid))), layout="constrained")
    axes = figure.add_subplot()
    panel = panel_of(grid)
    axes.set(xlim=panel.u, ylim=panel.v, xlabel="x [m]", ylabel="y [m]")
    if image is not None:
        show_pixels(axes, image.grid.x, image.grid.y, shades(image.project("z")), shades, colours)
    axes.set_aspect("equal")
    palette = matplotlib.colormaps[_COLOURS]
    edges = borders(grid.x, _ALONE), borders(grid.y, _ALONE)
    for number, mask in enumerate(instances.masks, 1):
        colour = palette((number - 1) % palette.N)
        covered = np.where(mask.inside.T, 1.0, np.nan)
        axes.pcolormesh(*edges, covered, cmap=ListedColormap([colour]), alpha=_VEIL, zorder=3)
        draw_mask_outline(axes, mask.inside, grid, color=to_hex(colour))
        i, j = np.argwhere(mask.inside).mean(axis=0).round().astype(int)
        axes.text(
            float(grid.x[i]),
            float(grid.y[j]),
            str(number),
            color="white",
            ha="center",
            va="center",
            weight="bold",
            zorder=5,
        )
    count = f"{len(instances)} object{'' if len(instances) == 1 else 's'}"
    # A file's name has no spaces where it could be broken.
    axes.set_title("\n".join([*textwrap.wrap(title or "", _LETTERS), count]), fontsize=9)
    draw_outlines(axes, [(one.outline, one.short) for one in forms])
    return figure
