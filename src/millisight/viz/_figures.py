"""The paper's figures of images: a grid of samples, both bands in and out of sight, simulations, and what is hidden.

Each function takes records, and axes or none, and returns its axes: `plot_x(...)[0].figure` is a figure of its own,
`plot_x(..., axes=mine)` draws into yours. Colours are those of all pictures; the paper's rainbow is `colormap="jet"`.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, to_rgba_array

from millisight.core import check_shape
from millisight.core.errors import InputError
from millisight.data import Mask, PixelGrid, SarImage, TriangleMesh
from millisight.imaging import combine
from millisight.viz import _panels
from millisight.viz._outline import LIGHT, PLANE, TOWARDS_VIEWER, checked_axis, outline_of
from millisight.viz._panels import NotebookFigure, Scale, checked_colormap, panel_of, styled

BLUE, ORANGE, GREEN, VERMILION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#6b7378"
"""Colours that everybody can tell apart (Okabe and Ito 2008, "Color Universal Design"), and a grey."""

T = TypeVar("T")

_PANEL = 2.1  # [inches]
_BARS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)  # lengths of scale bars [m]


@styled
def plot_samples(
    samples: Mapping[str, Mapping[str, SarImage | np.ndarray | None]],
    *,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """A grid of examples (the paper's Fig. "Sample Images"): a row for each object, a column for each kind of picture.

    Parameters
    ----------
    samples : object -> column -> an image, of which the mean of |I| along z is shown over its own maximum; or a photo
        (H, W, 3); or None, an empty place. Columns stand in the order in which they first come
    scale, dynamic_range_db : "linear" or "db", as for `plot_image`
    colormap : as for `plot_image`; "jet" in the paper
    axes : (rows, columns) as many as there are places, which are returned; default those of a new figure

    Raises
    ------
    InputError, UnknownNameError
    """
    columns = list(dict.fromkeys(name for row in samples.values() for name in row))
    if not columns:
        raise InputError("samples hold no picture; expected {object: {column: image or photo}}")
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    shape = len(samples), len(columns)
    tall = [
        max((tallness(picture.grid.xy) for picture in row.values() if isinstance(picture, SarImage)), default=0.75)
        for row in samples.values()
    ]
    grid = np.array(taken_axes(axes, *shape, tall=tall)).reshape(shape)
    for row, (name, pictures) in zip(grid, samples.items(), strict=True):
        for place, column in zip(row, columns, strict=True):
            picture = pictures.get(column)
            if isinstance(picture, SarImage):
                show_image(place, picture, shades, colours)
            elif picture is not None:
                show_photo(place, picture)
            else:
                place.set_axis_off()
        row[0].annotate(
            name.replace("_", "\n"), (0, 0.5), (-6, 0), xycoords="axes fraction", textcoords="offset points",
            rotation=90, ha="right", va="center",
        )  # fmt: skip
    for place, column in zip(grid[0], columns, strict=True):
        place.set_title(column)
    return grid


@styled
def plot_multispectral(
    los: Mapping[str, SarImage],
    nlos: Mapping[str, SarImage],
    *,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """One object at several frequencies, in sight and hidden (the paper's Fig. "Multi-Spectral Imaging").

    Parameters
    ----------
    los, nlos : name of the band -> image, each over its own maximum; first those in sight, then those through a cover
    scale, dynamic_range_db, colormap : as for `plot_samples`
    axes : (n,) as many as there are images, which are returned; default those of a new figure, in a row

    Raises
    ------
    InputError, UnknownNameError
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    images = [(f"{band}, {where}", i) for where, of in (("LOS", los), ("NLOS", nlos)) for band, i in of.items()]
    if not images:
        raise InputError("neither los nor nlos holds an image; expected {band: image} in each")
    places = taken_axes(axes, 1, len(images), tall=max(tallness(image.grid.xy) for _, image in images))
    for place, (title, image) in zip(places, lettered(images), strict=True):
        show_image(place, image, shades, colours)
        place.set_title(title)
    return np.array(places)


@styled
def plot_simulation(
    mesh: TriangleMesh,
    specular: SarImage,
    edge: SarImage,
    *,
    alphas: Sequence[tuple[float, float]] = ((0.8, 0.2), (0.4, 0.6)),
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """A mesh, its two simulations, and their sums for different materials (the paper's Fig. "Simulation Output").

    Parameters
    ----------
    mesh : as it was simulated, in the images' frame [m]
    specular, edge : images of the two simulations, on one grid
    alphas : weights (a1, a2) of each sum (primer 14)
    scale, dynamic_range_db, colormap : as for `plot_samples`
    axes : (3 + n,) three and one for each of `alphas`, which are returned; default those of a new figure, in a row

    Raises
    ------
    InputError, UnknownNameError
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    images = [("specular", specular), ("edge", edge)]
    images += [(f"{a1:g} specular, {a2:g} edge", combine(specular, edge, (a1, a2))) for a1, a2 in alphas]
    places = taken_axes(axes, 1, 1 + len(images), tall=tallness(specular.grid.xy))
    titled = list(lettered([("mesh", None), *images]))
    for place, (title, image) in zip(places, titled, strict=True):
        if image is not None:
            show_image(place, image, shades, colours)
        place.set_title(title)
    frame = places[1]
    places[0].set(xlim=frame.get_xlim(), ylim=frame.get_ylim(), xticks=[], yticks=[], facecolor="white")
    draw_mesh(places[0], mesh, "z")
    scale_bar(places[0], color="black")
    return np.array(places)


@styled
def plot_hidden(
    open_view: np.ndarray,
    closed_view: np.ndarray,
    image: SarImage,
    *,
    mask: Mask | None = None,
    mesh: TriangleMesh | None = None,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | Colormap | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """The camera picture with open and with closed box, and the radar image through the box (the paper's Fig. 1).

    Parameters
    ----------
    open_view, closed_view : photos (H, W, 3)
    image : SarImage, through the cover
    mask : of the object, on the image's pixels; its outline is drawn over the image
    mesh : what is inside; its outline is drawn over the image, in the image's frame [m]
    scale, dynamic_range_db, colormap : as for `plot_samples`
    axes : (3,) which are returned; default those of a new figure, in a row

    Raises
    ------
    InputError, UnknownNameError
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    for view, name in ((open_view, "open_view"), (closed_view, "closed_view")):
        check_shape(np.shape(view), name=name, shape=("H", "W", 3))
    tall = max(*(len(view) / len(view[0]) for view in (open_view, closed_view)), tallness(image.grid.xy))
    seen, shut, through = taken_axes(axes, 1, 3, size=2.9, tall=tall)
    show_photo(seen, open_view)
    show_photo(shut, closed_view)
    show_image(through, image, shades, colours)
    if mask is not None:
        check_shape(mask.inside.shape, name="mask", shape=image.grid.xy.shape)
        _panels.draw_lines(through, _panels.mask_borders(mask), color="white", width=1.2, zorder=4)
    if mesh is not None:
        _panels.draw_outline(through, outline_of(mesh, "z"), "z", inner=False, alpha=0.7)
    titles = ("the camera, box open", "the camera, box shut", "the radar, box shut")
    for place, title in zip((seen, shut, through), titles, strict=True):
        place.set_title(title)
    return np.array([seen, shut, through])


@styled
def draw_mesh(ax: Axes, mesh: TriangleMesh, axis: str, *, color: Any = "#c9ced3") -> PolyCollection:
    """Draw a mesh as a lit solid seen along an axis: the faces that look at the viewer, nearer ones over farther ones.

    Parameters
    ----------
    ax : axes in metres, as in the figures: z shows x and y, y shows x and z, x shows y and z
    mesh : TriangleMesh
    axis : "x", "y" or "z"
    color : of a face that looks at the light; one for all, or one for each face

    Raises
    ------
    UnknownNameError
    """
    number, plane = "xyz".index(checked_axis(axis)), list(PLANE[axis])
    towards = TOWARDS_VIEWER[axis]
    normals = mesh.face_normals[:, [*plane, number]] * [1, 1, towards]
    facing = np.flatnonzero(normals[:, 2] > 0)
    nearest = mesh.vertices[:, number][mesh.faces[facing]].mean(axis=1) * towards
    order = facing[np.argsort(nearest)]
    light = 0.35 + 0.65 * np.clip(normals[order] @ LIGHT, 0, 1)
    colours = light[:, None] * np.broadcast_to(to_rgba_array(color)[:, :3], (len(mesh.faces), 3))[order]
    faces = mesh.vertices[:, plane][mesh.faces[order]]
    solid = PolyCollection(list(faces), facecolors=colours, edgecolors=colours, linewidths=0.3, rasterized=True)
    ax.add_collection(solid, autolim=False)
    ax.set_aspect("equal")
    return solid


def taken_axes(
    axes: Sequence[Axes] | np.ndarray | None,
    rows: int,
    columns: int,
    *,
    size: float = _PANEL,
    tall: float | Sequence[float] = 1.0,
) -> list[Axes]:
    """`axes` as a list if they are `rows` x `columns`; of None those of a new figure.

    Its panels are `size` inches wide and `tall` times as high, which may differ from row to row.
    """
    if axes is None:
        heights = np.broadcast_to(tall, rows).tolist()
        figure = NotebookFigure(figsize=(0.25 + size * columns, 0.3 + size * sum(heights)), layout="constrained")
        return list(figure.subplots(rows, columns, squeeze=False, height_ratios=heights).ravel())
    taken = list(np.ravel(np.array(axes, dtype=object)))
    if len(taken) != rows * columns or not all(isinstance(one, Axes) for one in taken):
        raise InputError(f"axes are {len(taken)}; expected {rows * columns} Matplotlib Axes, row by row")
    return taken


def lettered(panels: Sequence[tuple[str, T]]) -> Iterator[tuple[str, T]]:
    """Panels (title, thing) with "a) ", "b) " before their titles."""
    for number, (title, thing) in enumerate(panels):
        yield f"{chr(ord('a') + number)}) {title}", thing


def tallness(grid: PixelGrid) -> float:
    """Height over width of an image seen along z, as it is shown."""
    width, height = panel_of(grid).size
    return height / width


def show_image(ax: Axes, image: SarImage, shades: Scale, colours: Colormap) -> None:
    """The mean of |I| along z over its own maximum, with a scale bar in place of ticks."""
    panel = panel_of(image.grid.xy)
    ax.set(xlim=panel.u, ylim=panel.v)
    _panels.show_pixels(ax, image.grid.x, image.grid.y, shades(image.project("z")), shades, colours)
    ax.set(xticks=[], yticks=[])
    scale_bar(ax)


def scale_bar(ax: Axes, *, color: str = "white") -> None:
    """A bar of a round length at the lower left of axes in metres."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    length = next((bar for bar in _BARS if bar <= (right - left) / 3), (right - left) / 3)
    x, y = left + 0.05 * (right - left), low + 0.05 * (high - low)
    ax.plot([x, x + length], [y, y], color=color, linewidth=2.2, solid_capstyle="butt", zorder=6)
    label = f"{1000 * length:g} mm" if length < 0.01 else f"{100 * length:g} cm"
    ax.annotate(label, (x, y), (0, 3), textcoords="offset points", color=color, fontsize=7.5, zorder=6)


def show_photo(ax: Axes, photo: np.ndarray) -> None:
    """A photo (H, W, 3) without ticks."""
    check_shape(np.shape(photo), name="photo", shape=("H", "W", 3))
    ax.imshow(photo)
    ax.set(xticks=[], yticks=[], facecolor="white")
