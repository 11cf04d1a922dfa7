"""Every figure by one name: an image's projections and slices here, and what the rooms beside hold.

`viz.sheets` has captures and many images, `viz.figures`, `viz.figures_background` and `viz.figures_perception` the
figures of the paper.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight.errors import InputError
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.image import SarImage
from millisight.records import checked_array
from millisight.scene.mesh import TriangleMesh
from millisight.viz.figures import draw_mesh, plot_hidden, plot_multispectral, plot_samples, plot_simulation
from millisight.viz.figures_background import plot_aperture_principle, plot_reflection_principle
from millisight.viz.figures_perception import cut_out, plot_depth_holes, plot_segmentation_steps, plot_table
from millisight.viz.outline import PLANE, cross_section, outline_of
from millisight.viz.sheets import plot_aperture, plot_range_profiles, plot_sheet
from millisight.viz.style import (
    Panel,
    Scale,
    add_colour_bar,
    borders,
    checked_colormap,
    draw_lines,
    draw_outline,
    place_panels,
    save_figure,
    show_pixels,
    styled,
)

__all__ = [
    "cut_out",
    "draw_mesh",
    "draw_outline",
    "plot_aperture",
    "plot_aperture_principle",
    "plot_depth_holes",
    "plot_hidden",
    "plot_multispectral",
    "plot_projections",
    "plot_range_profiles",
    "plot_reflection_principle",
    "plot_samples",
    "plot_segmentation_steps",
    "plot_sheet",
    "plot_simulation",
    "plot_slices",
    "plot_table",
    "save_figure",
]

_SEEN = {"z": "along z, from above", "y": "along y, from the front", "x": "along x, from the right"}


@styled
def plot_projections(
    image: SarImage,
    *,
    mesh: TriangleMesh | None = None,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormaps: Sequence[str] = ("jet", "inferno"),
    title: str | None = None,
) -> Figure:
    """The mean of |I| along z, y and x, each over its own maximum, one colour map above the other.

    Parameters
    ----------
    image : SarImage
    mesh : its outline is drawn over the pictures; in the image's frame [m]
    scale : "linear", |I| / max, or "db"
    dynamic_range_db : how far under the maximum the dB scale reaches
    colormaps : Matplotlib's names; by default the paper's rainbow, and one whose brightness tells the value
    title : written above

    Raises
    ------
    UnknownNameError, InputError
    """
    shades = Scale.checked(scale, dynamic_range_db)
    maps = [checked_colormap(name) for name in colormaps]
    if not maps:
        raise InputError("colormaps is empty; expected at least one name, such as 'inferno'")
    outlines = {axis: outline_of(mesh, axis) for axis in PLANE} if mesh is not None else {}
    figure, rows, bars = place_panels([_views(image.grid)] * len(maps), title=title)
    for row, bar, colormap in zip(rows, bars, maps, strict=True):
        for axes, axis in zip(row, PLANE, strict=True):
            show_pixels(axes, *_coordinates(image.grid, axis), shades(image.project(axis)), shades, colormap)
            if mesh is not None:
                draw_outline(axes, outlines[axis], axis)
            _label(axes, axis, _SEEN[axis])
        add_colour_bar(bar, shades, colormap, f"mean {shades.unit}")
    return figure


@styled
def plot_slices(
    image: SarImage,
    *,
    at: Sequence[float] | np.ndarray | None = None,
    mesh: TriangleMesh | None = None,
    scale: str = "db",
    dynamic_range_db: float = 30,
    colormap: str = "inferno",
    title: str | None = None,
) -> Figure:
    """|I| in the three planes through a point, relative to the maximum of the whole image.

    Parameters
    ----------
    image : SarImage
    at : (3,) the point [m], moved to the nearest voxel; default the brightest voxel
    mesh : its cross-section is drawn, and faintly its silhouette; in the image's frame [m]
    scale, dynamic_range_db : as for `plot_projections`
    colormap : Matplotlib's name
    title : written above

    Raises
    ------
    UnknownNameError
    InputError
        `at` lies outside the grid.
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    wanted = image.peak if at is None else checked_array(at, name="at", shape=(3,), unit="m")
    index = _nearest_voxel(image.grid, wanted)
    point = [float(getattr(image.grid, axis)[i]) for axis, i in zip("xyz", index, strict=True)]
    magnitude = image.magnitude
    figure, (row,), (bar,) = place_panels([_views(image.grid)], title=title)
    for axes, axis in zip(row, PLANE, strict=True):
        number = "xyz".index(axis)
        values = shades(magnitude.take(index[number], axis=number), magnitude.max())
        show_pixels(axes, *_coordinates(image.grid, axis), values, shades, colours)
        right, up = (point[i] for i in PLANE[axis])
        axes.axvline(right, color="white", linewidth=0.5, linestyle=(0, (4, 4)), alpha=0.55)
        axes.axhline(up, color="white", linewidth=0.5, linestyle=(0, (4, 4)), alpha=0.55)
        if mesh is not None:
            draw_outline(axes, mesh, axis, inner=False, alpha=0.45)
            draw_lines(axes, cross_section(mesh, axis, point[number]), color="white", width=0.8, zorder=5)
        _label(axes, axis, f"{axis} = {1e3 * point[number]:.4g} mm".replace("-", "\u2212"))
    add_colour_bar(bar, shades, colours)
    return figure


def _coordinates(grid: VoxelGrid, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """The grid's coordinates to the right and up in a view along `axis` [m]."""
    right, up = ("xyz"[i] for i in PLANE[axis])
    return getattr(grid, right), getattr(grid, up)


def _views(grid: VoxelGrid) -> list[list[Panel]]:
    """The panels of the three views: along z, and beside it along y over along x."""
    z, y, x = (Panel.around(*(borders(c, 1e-3) for c in _coordinates(grid, axis))) for axis in PLANE)
    return [[z], [y, x]]


def _nearest_voxel(grid: VoxelGrid, point: np.ndarray) -> list[int]:
    index = []
    for name, value in zip("xyz", point, strict=True):
        coordinates = getattr(grid, name)
        edge = borders(coordinates, np.inf)
        if not edge[0] <= value <= edge[-1]:
            raise InputError(
                f"at has {name} = {value:g} m, outside the image, which reaches from {coordinates[0]:g} to "
                f"{coordinates[-1]:g} m; choose a point inside"
            )
        index.append(int(np.abs(coordinates - value).argmin()))
    return index


def _label(axes: Axes, axis: str, title: str) -> None:
    right, up = ("xyz"[i] for i in PLANE[axis])
    axes.set(xlabel=f"{right} [m]", ylabel=f"{up} [m]", title=title)
