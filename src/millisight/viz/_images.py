"""Figures of images: projections, slices, and many images side by side, all panels in one scale."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.colors import Colormap
from matplotlib.figure import Figure

from millisight.core import check_known, checked_array, checked_colormap, checked_number
from millisight.core.errors import InputError
from millisight.data import SarImage, TriangleMesh, VoxelGrid
from millisight.viz import _panels
from millisight.viz._outline import PLANE, cross_section, outline_of
from millisight.viz._panels import Panel, Scale, styled


@styled
def plot_image(
    image: SarImage,
    *,
    mesh: TriangleMesh | None = None,
    scale: Literal["linear", "db"] | str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | Sequence[str | Colormap | None] | None = None,
    title: str | None = None,
) -> Figure:
    """Plot the mean of |I| along z, y and x, each relative to its own maximum; `SarImage.plot`.

    Parameters
    ----------
    image : SarImage
    mesh : its outline is drawn over the pictures; in the image's frame [m]
    scale : "linear", |I| / max, or "db"
    dynamic_range_db : how far under the maximum the dB scale reaches
    colormap : Matplotlib's name, or a plug-in's; None: that of all pictures, see `set_colormap`. Of several, there is a
        block of panels for each, one above the other
    title : written above; None: what objects it is known to show, and the centre of its band; "" for none

    Raises
    ------
    UnknownNameError, InputError
    """
    shades = Scale.checked(scale, dynamic_range_db)
    title = image_title(image) if title is None else title
    names = colormap if isinstance(colormap, Sequence) and not isinstance(colormap, str) else [colormap]
    if not names:
        raise InputError("colormap is empty; expected at least one name, such as 'inferno'")
    maps = [checked_colormap(name) for name in names]
    outlines = {axis: outline_of(mesh, axis) for axis in PLANE} if mesh is not None else {}
    figure, rows, bars = _panels.place_panels([Panel.views_of(_panels.grid_box(image.grid))] * len(maps), title=title)
    for row, bar, colours in zip(rows, bars, maps, strict=True):
        for axes, axis in zip(row, PLANE, strict=True):
            _panels.show_pixels(axes, *view_coordinates(image.grid, axis), shades(image.project(axis)), shades, colours)
            if mesh is not None:
                _panels.draw_outline(axes, outlines[axis], axis)
            _panels.label_view(axes, axis)
        _panels.add_colour_bar(bar, shades, colours, f"mean {shades.unit}")
    return figure


@styled
def plot_slices(
    image: SarImage,
    *,
    at: Sequence[float] | np.ndarray | None = None,
    mesh: TriangleMesh | None = None,
    scale: Literal["linear", "db"] | str = "db",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    title: str | None = None,
) -> Figure:
    """Plot |I| in three planes through a point, relative to the maximum of the whole image.

    Parameters
    ----------
    image : SarImage
    at : (3,) the point [m], moved to the nearest voxel; default the brightest voxel
    mesh : its cross-section is drawn, and faintly its silhouette; in the image's frame [m]
    scale, dynamic_range_db : as for `plot_image`
    colormap : as for `plot_image`
    title : as for `plot_image`

    Raises
    ------
    UnknownNameError
    InputError
        `at` lies outside the grid.
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    title = image_title(image) if title is None else title
    wanted = image.peak if at is None else checked_array(at, name="at", shape=(3,), unit="m")
    index = _nearest_voxel(image.grid, wanted)
    point = [float(getattr(image.grid, axis)[i]) for axis, i in zip("xyz", index, strict=True)]
    magnitude = image.magnitude
    figure, (row,), (bar,) = _panels.place_panels([Panel.views_of(_panels.grid_box(image.grid))], title=title)
    for axes, axis in zip(row, PLANE, strict=True):
        number = "xyz".index(axis)
        values = shades(magnitude.take(index[number], axis=number), magnitude.max())
        _panels.show_pixels(axes, *view_coordinates(image.grid, axis), values, shades, colours)
        right, up = (point[i] for i in PLANE[axis])
        axes.axvline(right, color="white", linewidth=0.5, linestyle=(0, (4, 4)), alpha=0.55)
        axes.axhline(up, color="white", linewidth=0.5, linestyle=(0, (4, 4)), alpha=0.55)
        if mesh is not None:
            _panels.draw_outline(axes, mesh, axis, inner=False, alpha=0.45)
            cut = cross_section(mesh, axis, point[number])
            _panels.draw_many_lines(axes, cut, color="white", width=0.8, zorder=5)
        _panels.label_view(axes, axis, f"{axis} = {_millimetres(getattr(image.grid, axis), index[number])}")
    _panels.add_colour_bar(bar, shades, colours)
    return figure


@styled
def plot_sheet(
    images: Mapping[str, SarImage],
    *,
    meshes: Mapping[str, TriangleMesh] | None = None,
    columns: int | None = None,
    scale: Literal["linear", "db"] | str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    title: str | None = None,
) -> Figure:
    """Plot many images side by side: the mean of |I| along z, each relative to its own maximum.

    Parameters
    ----------
    images : name -> image, shown in this order
    meshes : name -> mesh, whose outline is drawn over the image of that name [m]
    columns : pictures in a row; default about as wide as high
    scale, dynamic_range_db : as for `plot_image`
    colormap : as for `plot_image`
    title : written above

    Raises
    ------
    UnknownNameError
        A mesh has no image of its name.
    InputError
    """
    if not images:
        raise InputError("a sheet of no images; expected at least one")
    meshes = dict(meshes or {})
    for name in meshes:
        check_known("image", name, images)
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    if columns is None:
        columns = min(6, int(np.ceil(np.sqrt(1.5 * len(images)))))
    columns = min(int(checked_number(columns, name="columns", minimum=1)), len(images))
    own = [_panels.panel_of(image.grid) for image in images.values()]
    # Every picture shows as much as the widest and the highest need, about its own middle.
    shown = np.array([[-0.5, 0.5]]).T * [max(p.size[k] for p in own) for k in (0, 1)]
    panels = [Panel(*map(tuple, (np.mean([p.u, p.v], axis=1) + shown).T)) for p in own]
    alike = all(np.allclose(np.ravel(p), np.ravel(panels[0])) for p in panels)
    rows = [[[panel] for panel in panels[i : i + columns]] for i in range(0, len(panels), columns)]
    gaps = (0.16, 0.34) if alike else (0.5, 0.6)
    figure, axes_rows, bars = _panels.place_panels(
        rows, title=title, width=1.8 + 2.6 * columns, height=1.2 + 3.2 * len(rows), gaps=gaps
    )
    all_axes = [axes for row in axes_rows for axes in row]
    for number, (axes, (name, image)) in enumerate(zip(all_axes, images.items(), strict=True)):
        _panels.show_pixels(axes, image.grid.x, image.grid.y, shades(image.project("z")), shades, colours)
        if name in meshes:
            _panels.draw_outline(axes, meshes[name], "z")
        axes.set_title(name, fontsize=9, pad=4)
        lowest, leftmost = number + columns >= len(panels), number % columns == 0
        axes.set(xlabel="x [m]" if lowest else "", ylabel="y [m]" if leftmost else "")
        axes.tick_params(labelbottom=lowest or not alike, labelleft=leftmost or not alike)
    for bar in bars[1:]:
        bar.remove()
    places = [bar.get_position() for bar in bars[:1]] + [row[0].get_position() for row in axes_rows]
    low, high = min(p.y0 for p in places), max(p.y1 for p in places)
    tall = min(high - low, 3.2 / figure.get_size_inches()[1])
    bars[0].set_position((places[0].x0, high - tall, places[0].width, tall))
    _panels.add_colour_bar(bars[0], shades, colours, f"mean {shades.unit}")
    return figure


def image_title(image: SarImage, name: str | None = None) -> str | None:
    """A title for pictures of an image: `name`, default the objects of its simulation, and the centre of its band.

    Parameters
    ----------
    image : SarImage
    name : such as its file's; None: what its history tells

    Returns
    -------
    str or None
        None where nothing is known.
    """
    held = [step.get("objects") for step in image.metadata.get("history", ())]
    objects = next((names for names in held if isinstance(names, list | tuple)), ())
    words = [", ".join(map(str, objects)) if name is None else name]
    if image.frequency is not None:
        words.append(f"{image.frequency / 1e9:.3g} GHz")
    return ", ".join(filter(None, words)) or None


def _millimetres(coordinates: np.ndarray, index: int) -> str:
    """A voxel's coordinate, as exact as a tenth of a voxel."""
    spacing = 1e3 * float(np.diff(coordinates).min()) if len(coordinates) > 1 else 1.0
    digits = max(0, int(np.ceil(-np.log10(spacing / 10))))
    rounded = round(1e3 * float(coordinates[index]), digits) + 0.0  # no -0
    return f"{rounded:.10g} mm".replace("-", "\u2212")


def view_coordinates(grid: VoxelGrid, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """The grid's coordinates to the right and up in a view along `axis` [m]."""
    right, up = ("xyz"[i] for i in PLANE[axis])
    return getattr(grid, right), getattr(grid, up)


def _nearest_voxel(grid: VoxelGrid, point: np.ndarray) -> list[int]:
    index = []
    for name, value in zip("xyz", point, strict=True):
        coordinates = getattr(grid, name)
        edge = _panels.borders(coordinates, np.inf)
        if not edge[0] <= value <= edge[-1]:
            raise InputError(
                f"at has {name} = {value:g} m, outside the image, which reaches from {coordinates[0]:g} to "
                f"{coordinates[-1]:g} m; choose a point inside"
            )
        index.append(int(np.abs(coordinates - value).argmin()))
    return index
