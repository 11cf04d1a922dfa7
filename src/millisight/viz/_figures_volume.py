"""Figures of masks in three dimensions."""

import numpy as np
from matplotlib.figure import Figure

from millisight.core import checked_record
from millisight.core.errors import InputError
from millisight.data import Mask, PixelGrid, SarImage, VolumeMask, grid_difference
from millisight.viz import _panels
from millisight.viz._images import view_coordinates
from millisight.viz._outline import PLANE
from millisight.viz._panels import Scale, checked_colormap, mask_borders, styled

_OUTLINE = "white"
_PLAIN = "gray"


@styled
def plot_volume(
    volume: VolumeMask,
    *,
    image: SarImage | None = None,
    title: str | None = None,
    dynamic_range_db: float = 30,
    colormap: str | None = None,
) -> Figure:
    """Plot the outline of the voxels seen along z, y and x, over the image's maximum along each; `VolumeMask.plot`.

    Parameters
    ----------
    volume : VolumeMask
    image : on the same voxels; None: the voxels alone, in white
    title : written above
    dynamic_range_db, colormap : of the image, as for `plot_image`

    Raises
    ------
    InputError
        The image has other voxels, or there is no such colour map.
    """
    grid = checked_record(volume, VolumeMask, name="volume").grid
    if image is not None and (differs := grid_difference(image.grid, grid)):
        raise InputError(f"the image and the mask have different voxels, along {differs}")
    colours = checked_colormap(colormap if image is not None else _PLAIN)
    shades = Scale.checked("db", dynamic_range_db) if image is not None else Scale.checked("linear", dynamic_range_db)
    figure, (row,), (bar,) = _panels.place_panels([_panels.Panel.views_of(_panels.grid_box(grid))], title=title)
    for axes, axis in zip(row, PLANE, strict=True):
        inside = np.asarray(volume.inside.any(axis="xyz".index(axis)))
        right, up = view_coordinates(grid, axis)
        pixels = inside.astype(np.float32) if image is None else shades(image.project(axis, reduce="max"))
        _panels.show_pixels(axes, right, up, pixels, shades, colours)
        if image is not None:
            outline = mask_borders(Mask(grid_xy=PixelGrid(x=right, y=up), inside=inside))
            _panels.draw_lines(axes, outline, color=_OUTLINE, width=1.2)
        _panels.label_view(axes, axis)
    if image is None:
        bar.remove()
    else:
        _panels.add_colour_bar(bar, shades, colours, f"max {shades.unit}")
    return figure
