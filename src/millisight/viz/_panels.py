"""How the figures look: the placing of panels in one scale, colours, and lines."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from millisight.core import check_known, checked_colormap, checked_number
from millisight.core import set_colormap as set_colormap
from millisight.data import Mask, PixelGrid, TriangleMesh, VoxelGrid
from millisight.viz._outline import PLANE, Outline, outline_of
from millisight.viz._style import NotebookFigure as NotebookFigure
from millisight.viz._style import styled
from millisight.viz._ticks import ticks_for

SCALES = ("linear", "db")
ORDER = "viridis"
"""Colour map of what is counted, such as poses; that of magnitudes is `checked_colormap()`."""


class Scale(NamedTuple):
    """How magnitudes become colours: over their maximum, or in dB under it."""

    name: str
    floor_db: float

    @classmethod
    def checked(cls, name: str, dynamic_range_db: float) -> "Scale":
        """Raises UnknownNameError, InputError."""
        check_known("scale", name, SCALES)
        return cls(name, -checked_number(dynamic_range_db, name="dynamic_range_db", unit="dB", minimum=1e-3))

    @property
    def unit(self) -> str:
        return "|I| / max" if self.name == "linear" else "|I|  [dB re max]"

    @property
    def norm(self) -> Normalize:
        return Normalize(0, 1) if self.name == "linear" else Normalize(self.floor_db, 0)

    def __call__(self, magnitude: np.ndarray, maximum: float | None = None) -> np.ndarray:
        """`magnitude` over `maximum` (default its own), linear or in dB; empty for a maximum of 0."""
        maximum = float(magnitude.max()) if maximum is None else float(maximum)
        share = magnitude / magnitude.dtype.type(maximum) if maximum > 0 else np.zeros_like(magnitude)
        return share if self.name == "linear" else to_db(share, self.floor_db)


def to_db(ratio: np.ndarray, floor_db: float) -> np.ndarray:
    """20 log10 of an amplitude ratio [dB], nothing under the floor."""
    return np.maximum(20 * np.log10(np.maximum(ratio, 10 ** (floor_db / 20) / 2)), floor_db)


def borders(coordinates: np.ndarray, alone: float) -> np.ndarray:
    """(n + 1,) borders of the pixels around `coordinates` (n,), half-way between them; a lone one is `alone` wide."""
    if len(coordinates) == 1:
        return coordinates[0] + alone * np.array([-0.5, 0.5])
    middle = (coordinates[1:] + coordinates[:-1]) / 2
    ends = 2 * coordinates[[0, -1]] - middle[[0, -1]]
    return np.concatenate([ends[:1], middle, ends[1:]])


def mask_borders(mask: Mask) -> np.ndarray:
    """(n, 2, 2) the borders between pixels inside and outside a mask, around one pixel as around many [m]."""
    x, y = borders(mask.grid_xy.x, 1e-3), borders(mask.grid_xy.y, 1e-3)
    padded = np.pad(mask.inside, 1).astype(np.int8)
    i, j = np.nonzero(np.diff(padded[:, 1:-1], axis=0))
    across_x = np.stack([np.stack([x[i], y[j]], -1), np.stack([x[i], y[j + 1]], -1)], axis=1)
    i, j = np.nonzero(np.diff(padded[1:-1], axis=1))
    across_y = np.stack([np.stack([x[i], y[j]], -1), np.stack([x[i + 1], y[j]], -1)], axis=1)
    return np.concatenate([across_x, across_y])


def grid_box(grid: VoxelGrid) -> np.ndarray:
    """(2, 3) where the outermost voxels end [m]; a lone one is as wide as the others' spacing, or a millimetre."""
    axes = (grid.x, grid.y, grid.z)
    alone = min((float(np.diff(a).mean()) for a in axes if len(a) > 1), default=1e-3)
    return np.array([borders(a, alone)[[0, -1]] for a in axes]).T


class Panel(NamedTuple):
    """What part of a plane a panel shows: (left, right) and (bottom, top) [m]."""

    u: tuple[float, float]
    v: tuple[float, float]

    @classmethod
    def around(cls, u: np.ndarray, v: np.ndarray, *, least: float = 0.3) -> "Panel":
        """The panel that holds all of `u` and `v`, its shorter side at least `least` of its longer one."""
        longest = max(np.ptp(u), np.ptp(v)) or 1e-3
        sides = []
        for values in (u, v):
            middle, half = (values.min() + values.max()) / 2, max(np.ptp(values), least * longest) / 2
            sides.append((float(middle - half), float(middle + half)))
        return cls(*sides)

    @classmethod
    def views_of(cls, box: np.ndarray) -> "list[list[Panel]]":
        """The panels of three views of a box (2, 3): along z, and beside it along y over along x."""
        z, y, x = (cls.around(box[:, right], box[:, up]) for right, up in PLANE.values())
        return [[z], [y, x]]

    @property
    def size(self) -> tuple[float, float]:
        return self.u[1] - self.u[0], self.v[1] - self.v[0]


def panel_of(grid: PixelGrid | VoxelGrid) -> Panel:
    """What is shown of an image seen along z."""
    return Panel.around(borders(grid.x, 1e-3), borders(grid.y, 1e-3))


def place_panels(
    rows: Sequence[Sequence[Sequence[Panel]]],
    *,
    title: str | None,
    width: float = 9.0,
    height: float = 10.0,
    gaps: tuple[float, float] = (0.82, 0.78),
    headroom: float = 0.0,
) -> tuple[Figure, list[list[Axes]], list[Axes]]:
    """A figure of panels in one scale (inches per metre), with axes for a colour bar beside each row.

    A row is made of columns, and a column of panels one above the other. The figure is at most `width` by
    `height` inches; `gaps` [inches] between panels and its margins hold ticks, labels and titles, `headroom` [inches]
    more lines above them. Returns the figure, the panels' axes row by row, and the bars' axes.
    """
    from scipy.optimize import root_scalar  # half a second that a notebook's card need not wait

    left, right, top, bottom = 0.72, 1.05, headroom + (0.66 if title else 0.36), 0.5

    def row_sizes(scale: float) -> list[tuple[float, float]]:
        """Width and height of each row [inches]."""
        return [
            (
                sum(scale * max(p.size[0] for p in column) for column in row) + gaps[0] * (len(row) - 1),
                max(scale * sum(p.size[1] for p in column) + gaps[1] * (len(column) - 1) for column in row),
            )
            for row in rows
        ]

    def excess(scale: float) -> float:
        """By how much the figure is too large [inches]."""
        sizes = row_sizes(scale)
        tall = sum(s[1] for s in sizes) + gaps[1] * (len(rows) - 1)
        return max(left + max(s[0] for s in sizes) + right - width, top + tall + bottom - height)

    high = width / max(p.size[0] for row in rows for column in row for p in column)
    scale = root_scalar(excess, bracket=(0, high)).root if excess(0) < 0 < excess(high) else high
    sizes = row_sizes(scale)
    wide = max(*(s[0] for s in sizes), 2.2)
    tall = sum(s[1] for s in sizes) + gaps[1] * (len(rows) - 1)
    figure = NotebookFigure(figsize=(left + wide + right, top + tall + bottom))
    inches = np.tile(figure.get_size_inches(), 2)
    all_axes: list[list[Axes]] = []
    bars = []
    row_top = inches[1] - top
    for row, (_, row_height) in zip(rows, sizes, strict=True):
        all_axes.append([])
        x = left
        for column in row:
            free = row_height - scale * sum(p.size[1] for p in column)
            gap = free / (len(column) - 1) if len(column) > 1 else 0.0
            y = row_top if gap else row_top - free / 2
            for panel in column:
                w, h = scale * np.array(panel.size)
                y -= h
                all_axes[-1].append(_panel_axes(figure, _place((x, y, w, h), inches), panel, (w, h)))
                y -= gap
            x += scale * max(p.size[0] for p in column) + gaps[0]
        bars.append(figure.add_axes(_place((left + wide + 0.16, row_top - row_height, 0.13, row_height), inches)))
        row_top -= row_height + gaps[1]
    if title:
        figure.text(left / inches[0], 1 - 0.13 / inches[1], title, fontsize=11.5, fontweight="bold", va="top")
    return figure, all_axes, bars


def _place(inches: tuple[float, float, float, float], total: np.ndarray) -> tuple[float, float, float, float]:
    """Left, bottom, width and height [inches] as shares of the figure's size."""
    left, bottom, width, height = (float(v) for v in inches / total)
    return left, bottom, width, height


def _panel_axes(
    figure: Figure, place: tuple[float, float, float, float], panel: Panel, inches: tuple[float, float]
) -> Axes:
    axes = figure.add_axes(place)
    axes.set(xlim=panel.u, ylim=panel.v)
    for ticks, length in zip((axes.xaxis, axes.yaxis), inches, strict=True):
        ticks.set_major_locator(ticks_for(length, sideways=ticks is axes.xaxis))
    return axes


_LETTERS_PER_INCH = 15  # of a title
_SEEN = {"z": "along z, from above", "y": "along y, from the front", "x": "along x, from the right"}


def label_view(axes: Axes, axis: str, title: str | None = None) -> None:
    """Name the coordinates of a view along `axis`, and where it is seen from unless there is another title."""
    right, up = ("xyz"[i] for i in PLANE[axis])
    axes.set(xlabel=f"{right} [m]", ylabel=f"{up} [m]", title=_SEEN[axis] if title is None else title)
    # Over a narrow panel the title is smaller, lest it reach beyond its sides.
    figure: Any = axes.figure
    room = axes.get_position().width * figure.get_size_inches()[0] * _LETTERS_PER_INCH / len(axes.get_title())
    axes.title.set_fontsize(float(axes.title.get_fontsize()) * float(np.clip(room, 0.7, 1)))


def show_pixels(axes: Axes, u: np.ndarray, v: np.ndarray, values: np.ndarray, scale: Scale, colormap: Colormap) -> Any:
    """Show `values` (U, V), in the scale's unit, at pixel centres `u` to the right and `v` up [m].

    Each pixel reaches half-way to its neighbours. Returns the AxesImage, or a QuadMesh where spacings differ.
    """
    # A single row of pixels is as wide as the other side's pixels, or a millimetre.
    spacings = [float(np.diff(c).mean()) for c in (u, v) if len(c) > 1]
    u_borders, v_borders = (borders(c, spacings[0] if spacings else 1e-3) for c in (u, v))
    steps = [np.diff(b) for b in (u_borders, v_borders)]
    limits = axes.get_xlim(), axes.get_ylim()
    if all(np.allclose(s, s[0], rtol=1e-3) for s in steps):
        extent = (u_borders[0], u_borders[-1], v_borders[0], v_borders[-1])
        picture = axes.imshow(values.T, origin="lower", extent=extent, cmap=colormap, norm=scale.norm, aspect="auto")
    else:
        picture = axes.pcolormesh(u_borders, v_borders, values.T, cmap=colormap, norm=scale.norm, rasterized=True)
    axes.set(xlim=limits[0], ylim=limits[1], aspect="equal")
    return picture


def add_colour_bar(bar: Axes, scale: Scale, colormap: Colormap | None = None, label: str | None = None) -> None:
    """Fill the axes `bar` with the colour bar of a scale and colour map; None: that of all pictures."""
    colours = bar.figure.colorbar(ScalarMappable(scale.norm, checked_colormap(colormap)), cax=bar)
    colours.outline.set_linewidth(0.6)
    colours.set_label(label or scale.unit)


def draw_lines(
    axes: Axes, segments: Iterable[np.ndarray], *, color: str, width: float, alpha: float = 1.0, zorder: float = 3
) -> Any:
    """Lines on a picture; light ones get a thin dark edge, to be seen on every colour."""
    lines = _lines(segments, color, width, alpha, zorder)
    if color == "white":
        lines.set_path_effects([Stroke(linewidth=width + 0.9, foreground="black", alpha=0.45 * alpha), Normal()])
    return axes.add_collection(lines, autolim=False)


def draw_outlines(axes: Axes, outlines: Iterable[tuple[np.ndarray, str]]) -> None:
    """Outlines (N, 2) on a picture, each with a few words above it."""
    edge = [Stroke(linewidth=2.4, foreground="black", alpha=0.6), Normal()]
    for points, words in outlines:
        axes.plot(*points.T, color="cyan", linewidth=1.2, linestyle="--", zorder=5, path_effects=edge)
        axes.annotate(
            words, (points[:-1, 0].mean(), points[:, 1].max()), (0, 2), textcoords="offset points", ha="center",
            va="bottom", color="cyan", fontsize=8, zorder=6, path_effects=edge, annotation_clip=True,
        )  # fmt: skip


def draw_many_lines(
    axes: Axes, segments: np.ndarray, *, color: str, width: float, alpha: float = 1.0, zorder: float = 3
) -> None:
    """As `draw_lines`, thousands of them, with the edges as lines of their own: a path effect takes 0.3 ms a line."""
    if color == "white":
        axes.add_collection(_lines(segments, "black", width + 0.9, 0.45 * alpha, zorder), autolim=False)
    axes.add_collection(_lines(segments, color, width, alpha, zorder), autolim=False)


def _lines(segments: Iterable[np.ndarray], color: str, width: float, alpha: float, zorder: float) -> LineCollection:
    return LineCollection(
        list(segments),
        colors=color,
        linewidths=width,
        alpha=alpha,
        zorder=zorder,
        capstyle="round",
        joinstyle="round",
    )


@styled
def draw_outline(
    ax: Axes,
    mesh: TriangleMesh | Outline,
    axis: str,
    *,
    color: str = "white",
    inner: bool = True,
    alpha: float = 1.0,
) -> LineCollection:
    """Draw over a picture what `mesh` looks like along an axis: its silhouette and, thinner, its inner lines.

    Parameters
    ----------
    ax : axes in metres, as in the figures: z shows x and y, y shows x and z, x shows y and z
    mesh : TriangleMesh, or what `outline_of` made of it
    axis : "x", "y" or "z"
    color : white gets a dark edge, to be seen on every colour
    inner : also draw where a part hides another, and creases
    alpha : opacity

    Returns
    -------
    LineCollection
        The silhouette.

    Raises
    ------
    UnknownNameError
    """
    outline = mesh if isinstance(mesh, Outline) else outline_of(mesh, axis)
    if inner and len(outline.inner):
        draw_many_lines(ax, outline.inner, color=color, width=0.45, alpha=0.6 * alpha)
    return draw_lines(ax, outline.silhouette, color=color, width=1.0, alpha=alpha, zorder=4)
