"""Figures of perception: the steps of a segmentation, holes in a camera's depth, and tables."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from millisight.core import check_shape
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Mask, Picture, PixelGrid, Prompts, SarImage
from millisight.viz import _figures, _panels
from millisight.viz._figures import ORANGE, VERMILION, show_image, show_photo, taken_axes
from millisight.viz._panels import Scale, checked_colormap, panel_of, styled

if TYPE_CHECKING:
    from millisight.evaluation import Table

_ROUND = 0.25  # shown around an object, of its own size
_LEAST = 12  # pixels around it
_DEEPER = 0.02  # how far the colours of depth reach beyond the object [m]
_CELL = 0.075  # width of a letter [inches]


@styled
def plot_segmentation_steps(
    picture: Picture,
    prompts: Prompts,
    mask: Mask | np.ndarray,
    *,
    truth: Mask | np.ndarray | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """The steps of a segmentation (the paper's Fig. "Segmentation"): coloured picture, prompts, mask.

    Positive prompts are white rings, negative ones white crosses. The mask stays coloured, with an outline; all else
    is darkened.

    Parameters
    ----------
    picture : Picture, of a radar image or a photo
    prompts : Prompts
    mask : the found one; (A, B) bool of the picture's pixels, or a Mask
    truth : drawn as a dashed outline
    axes : three; default those of a new figure, in a row

    Returns
    -------
    np.ndarray
        (3,) of Axes.

    Raises
    ------
    InputError
        A mask is not of the picture's size, or a prompt does not lie on it.
    """
    prompts.check_on(picture)
    inside = _pixels(mask, picture, "mask")
    tall = picture.shape[0] / picture.shape[1] if picture.grid_xy is None else _figures.tallness(picture.grid_xy)
    places = taken_axes(axes, 1, 3, size=2.6, tall=tall)
    darkened = np.where(inside[..., None], picture.rgb, (picture.rgb * 0.35).astype(np.uint8))
    for place, rgb in zip(places, (picture.rgb, picture.rgb, darkened), strict=True):
        _show_picture(place, picture, rgb)
    for kind, marker, name in ((prompts.positive, "o", "on the object"), (~prompts.positive, "x", "beside it")):
        places[1].plot(
            *_plotted(picture, prompts.points[kind]), marker, mfc="none", mec="white", ms=5, mew=1.2, ls="none",
            label=name, path_effects=[Stroke(linewidth=2.6, foreground="black"), Normal()],
        )  # fmt: skip
    draw_mask_outline(places[2], inside, picture.grid_xy)
    if truth is not None:
        draw_mask_outline(places[2], _pixels(truth, picture, "truth"), picture.grid_xy, color=ORANGE, style="--")
    for place, title in zip(places, ("a) colours", "b) prompts", "c) mask"), strict=True):
        place.set_title(title)
    return np.array(places)


@styled
def plot_depth_holes(
    frame: CameraFrame,
    image: SarImage,
    mask: Mask | np.ndarray,
    *,
    pixels: np.ndarray | None = None,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str | None = None,
    axes: Sequence[Axes] | np.ndarray | None = None,
) -> np.ndarray:
    """Holes in the depth of shiny or transparent objects, and their radar image (Fig. "Qualitative Segmentation").

    a) the photo; b) its depth, without which pixels are red; c) the radar's image; d) its segmentation.

    Parameters
    ----------
    frame : CameraFrame
    image : SarImage
    mask : what was segmented in it; (X, Y) bool, or a Mask
    pixels : (H, W) bool, those of the frame that show the object: photo and depth are cut to its surroundings, and
        the title says for what share of it there is no depth
    scale, dynamic_range_db, colormap : as for `plot_samples`, of the radar's image
    axes : four; default those of a new figure, in a row

    Returns
    -------
    np.ndarray
        (4,) of Axes.

    Raises
    ------
    InputError, UnknownNameError
    """
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    inside = mask.inside if isinstance(mask, Mask) else np.asarray(mask, bool)
    check_shape(inside.shape, name="mask", shape=image.grid.xy.shape)
    shown = (slice(None), slice(None))
    if pixels is not None:
        pixels = np.asarray(pixels, bool)
        check_shape(pixels.shape, name="pixels", shape=frame.depth.shape)
        shown = _around(pixels)
    photo, depth, radar, found = taken_axes(axes, 1, 4, size=2.4, tall=max(0.75, _figures.tallness(image.grid.xy)))
    show_photo(photo, frame.rgb[shown])
    metres = np.where(frame.depth > 0, frame.depth * frame.depth_unit, np.nan)
    seen = metres[shown] if pixels is None else metres[pixels]
    known = seen[np.isfinite(seen)]
    nearest, farthest = (known.min() - _DEEPER, known.max() + _DEEPER) if known.size else (0.0, 1.0)
    depth.imshow(np.isnan(metres[shown]), cmap=ListedColormap(["none", VERMILION]), zorder=2)
    depth.imshow(metres[shown], cmap="Greys", vmin=nearest, vmax=farthest, zorder=1)
    depth.set(xticks=[], yticks=[])
    show_image(radar, image, shades, colours)
    show_image(found, image, shades, colours)
    if inside.any() and not inside.all():
        found.contourf(image.grid.x, image.grid.y, inside.T, levels=[-0.5, 0.5], colors="black", alpha=0.55)
    draw_mask_outline(found, inside, image.grid.xy)
    missing = "" if pixels is None or not pixels.any() else f": {np.isnan(metres[pixels]).mean():.0%} missing"
    for place, title in zip(
        (photo, depth, radar, found), ("a) camera", f"b) depth{missing}", "c) radar", "d) segmented"), strict=True
    ):
        place.set_title(title)
    return np.array([photo, depth, radar, found])


def draw_mask_outline(
    ax: Axes, inside: np.ndarray, grid: PixelGrid | None, *, color: str = "white", style: str = "-"
) -> ContourSet | None:
    """The outline of a mask, if it has one: (X, Y) on a radar image's grid; without a grid (H, W) on a photo."""
    if not inside.any() or inside.all() or min(inside.shape) < 2:
        return None
    look: dict[str, Any] = {"levels": [0.5], "colors": color, "linewidths": 1.2, "linestyles": style}
    return ax.contour(inside, **look) if grid is None else ax.contour(grid.x, grid.y, inside.T, **look)


def cut_out(rgb: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The part of a photo that shows an object, all else white: the first column of the paper's "Sample Images".

    Parameters
    ----------
    rgb : (H, W, 3) uint8
    pixels : (H, W) bool, those that show the object

    Returns
    -------
    np.ndarray
        (h, w, 3) uint8, cut to the object and a margin.

    Raises
    ------
    InputError
        The shapes do not fit, or no pixel shows the object.
    """
    check_shape(np.shape(pixels), name="pixels", shape=np.shape(rgb)[:2])
    pixels = np.asarray(pixels, bool)
    if not pixels.any():
        raise InputError("pixels are all False; expected some that show the object")
    return np.where(pixels[..., None], rgb, np.uint8(255))[_around(pixels)]


@styled
def plot_table(table: "Table", *, bold_largest: bool = True, axes: Axes | None = None) -> Axes:
    """Plot a table as a figure with ruled lines; numbers are right-aligned.

    Parameters
    ----------
    table : evaluation.Table
    bold_largest : the largest number of each column in bold: for scores, of which more is better
    axes : one; default that of a new figure, as large as the table

    Returns
    -------
    Axes

    Raises
    ------
    InputError
    """
    cells = [[_cell(value) for value in row] for row in table.rows]
    lengths = [max(len(row[i]) for row in [list(table.columns), *cells]) for i in range(len(table.columns))]
    edges = np.concatenate([[0.0], np.cumsum(np.array(lengths) + 2.5)])
    height = len(cells) + 1
    if axes is None:
        below = len(table.notes)
        figure = Figure(figsize=(_CELL * edges[-1] + 0.4, 0.26 * (height + 1.2 + below)), layout="constrained")
        (axes,) = taken_axes([figure.subplots()], 1, 1)
    best = [_largest([row[i] for row in table.rows]) if bold_largest else None for i in range(len(table.columns))]
    text_columns = [i == 0 or any(isinstance(row[i], str) for row in table.rows) for i in range(len(table.columns))]
    axes.set(xlim=(0, edges[-1]), ylim=(-height - len(table.notes), 0), title=table.title)
    axes.set_axis_off()
    for y, width in ((0, 1.1), (-1, 0.7), (-height, 1.1)):
        axes.plot([0, edges[-1]], [y, y], color="black", linewidth=width, clip_on=False)
    for number, row in enumerate([list(table.columns), *cells]):
        for i, text in enumerate(row):
            left = text_columns[i]
            x = edges[i] + 0.6 if left else edges[i + 1] - 0.6
            bold = number == 0 or (best[i] is not None and table.rows[number - 1][i] == best[i])
            look: dict[str, Any] = {"ha": "left" if left else "right", "weight": "bold" if bold else "normal"}
            axes.text(x, -number - 0.5, text, va="center", **look)
    for number, note in enumerate(table.notes):
        axes.text(0.6, -height - number - 0.6, note, va="center", fontsize=7, color="0.35")
    return axes


def _cell(value: str | float | None) -> str:
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.4g}"


def _largest(values: Sequence[str | float | None]) -> float | None:
    numbers = [value for value in values if isinstance(value, int | float)]
    return max(numbers) if len(numbers) > 1 else None


def _pixels(mask: Mask | np.ndarray, picture: Picture, name: str) -> np.ndarray:
    inside = mask.inside if isinstance(mask, Mask) else np.asarray(mask, bool)
    check_shape(inside.shape, name=name, shape=picture.shape)
    return inside


def _plotted(picture: Picture, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What pixels (n, 2) have to the right and up: x and y in metres, of a photo column and row."""
    i, j = points.T
    grid = picture.grid_xy
    return (grid.x[i], grid.y[j]) if grid is not None else (j, i)


def _show_picture(ax: Axes, picture: Picture, rgb: np.ndarray) -> None:
    grid = picture.grid_xy
    if grid is None:
        show_photo(ax, rgb)
        return
    u, v = _panels.borders(grid.x, 1e-3), _panels.borders(grid.y, 1e-3)
    ax.pcolormesh(u, v, rgb.transpose(1, 0, 2), rasterized=True)
    panel = panel_of(grid)
    ax.set(xlim=panel.u, ylim=panel.v, aspect="equal", xticks=[], yticks=[])
    _figures.scale_bar(ax)


def _around(pixels: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of a photo about what is True, with a margin; all of them if nothing is."""
    where = np.argwhere(pixels)
    if not len(where):
        return slice(None), slice(None)
    low, high = where.min(axis=0), where.max(axis=0) + 1
    margin = max(_LEAST, int(_ROUND * (high - low).max()))
    rows, columns = (slice(max(0, a - margin), b + margin) for a, b in zip(low, high, strict=True))
    return rows, columns
