"""The picture of a virtual world before it is scanned: from above, from the side, and as the camera sees it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from millisight.data import CameraFrame, TriangleMesh
from millisight.rig.virtual import World, WorldLayout, appearance_of, image_grid
from millisight.viz._outline import PLANE
from millisight.viz._panels import ORDER, Panel, checked_colormap, draw_lines, label_view, place_panels, styled

_APERTURE, _GRID, _HIDES, _BEHIND = "#1f5fa8", "#8a8a8a", "#9a6a2f", "#dcdcdc"
_ROWS = 40  # drawn at most
_AROUND = 0.04  # [m]
_WIDTH, _HEIGHT = 13.0, 5.6  # at most [inches]
_DEEP = 0.3  # of the colours of depth [m]


@styled
def plot_world(layout: WorldLayout, frame: CameraFrame, masks: list[np.ndarray]) -> Figure:
    """Plot a layout from above and from the side, and the camera picture with depth.

    Parameters
    ----------
    layout : WorldLayout
    frame : CameraFrame
    masks : (480, 640) bool of each object: its pixels if it were alone
    """
    reach = _reach(layout)
    above, side = (Panel(*map(tuple, reach[:, list(PLANE[axis])].T)) for axis in "zx")
    tall = max(above.size[1], side.size[1])
    picture = Panel((0.0, 0.68 * tall), (0.0, 0.51 * tall))  # of 640 x 480 pixels; two are as high
    figure, (row,), (bar,) = place_panels(
        [[[above], [side], [picture, picture]]], title=None, width=_WIDTH, height=_HEIGHT
    )
    for axes, axis, title in zip(row, "zx", ("from above", "along x, from the right"), strict=False):
        _draw_grid(axes, layout.world, axis)
        _draw_objects(axes, layout, axis)
        axes.set(aspect="equal", facecolor="white")
        label_view(axes, axis, title)
    _draw_aperture(row[0], layout.world)
    _name_objects(row[0], layout)
    row[1].plot(np.add(layout.world.scan.corner[1], (0, layout.world.scan.size[1])), (0, 0), color=_APERTURE, lw=2)
    row[0].legend(handles=_legend(layout), loc="upper left", bbox_to_anchor=(-0.1, -0.14), ncols=4, borderaxespad=0)

    rgb, depth = row[2:]
    rgb.imshow(frame.rgb)
    shown = np.where(frame.depth > 0, frame.depth * frame.depth_unit, np.nan)
    nearest = float(np.nanmin(shown)) if np.isfinite(shown).any() else 0.0
    image = depth.imshow(shown, cmap=checked_colormap(f"{ORDER}_r"), vmin=nearest, vmax=nearest + _DEEP)
    place, beside = bar.get_position(), depth.get_position()
    bar.set_position((beside.x1 + 0.01, beside.y0, place.width, beside.height))
    figure.colorbar(image, cax=bar, extend="max").set_label("[m]")
    depth.set_facecolor("#5a1f1f")
    for axes, title in ((rgb, "camera; objects outlined"), (depth, "depth; dark red: missing")):
        axes.set(xlim=(-0.5, 639.5), ylim=(479.5, -0.5), xticks=[], yticks=[], title=title)
    for mask in masks:
        if mask.any() and not mask.all():
            rgb.contour(mask, levels=[0.5], colors="white", linewidths=0.8)
    return figure


def _fill(axes: Axes, mesh: TriangleMesh, axis: str, colour: Any) -> None:
    """The faces seen along an axis, all in one colour."""
    faces = mesh.vertices[:, list(PLANE[axis])][mesh.faces]
    axes.add_collection(PolyCollection(list(faces), facecolors=[colour], edgecolors=[colour], linewidths=0.4))


def _draw_objects(axes: Axes, layout: WorldLayout, axis: str) -> None:
    for part in layout.background:
        _fill(axes, part.mesh, axis, _BEHIND)
    for item in layout.objects:
        for part in item.parts:
            _fill(axes, part.mesh, axis, appearance_of(part.material.name, item.name).colour)
    for panel in layout.panels:
        corners = panel.mesh.vertices[:, list(PLANE[axis])]
        draw_lines(axes, [np.concatenate([corners, corners[:1]])], color=_HIDES, width=1.2)


def _name_objects(axes: Axes, layout: WorldLayout) -> None:
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    for item in layout.objects:
        (left, low, _), (right, _, _) = item.bounds
        axes.annotate(
            item.name.replace("_", " "), ((left + right) / 2, low), (0, -3), textcoords="offset points",
            ha="center", va="top", fontsize=8, zorder=6, bbox=box,
        )  # fmt: skip


def _draw_grid(axes: Axes, world: World, axis: str) -> None:
    """Where the published images reach."""
    for radar in world.radars:
        lower, upper = image_grid(world, radar.name).bounds[:, list(PLANE[axis])]
        axes.add_patch(Rectangle(tuple(lower), *(upper - lower), fill=False, edgecolor=_GRID, linestyle=":"))


def _draw_aperture(axes: Axes, world: World) -> None:
    """Its rows, no more than can be told apart."""
    rows = world.scan.row_places
    start, stop = np.add(world.scan.corner[1], (0, world.scan.size[1]))
    shown = rows[:: -(-len(rows) // _ROWS)]
    draw_lines(axes, [np.array([[x, start], [x, stop]]) for x in shown], color=_APERTURE, width=0.5, alpha=0.45)
    axes.add_patch(Rectangle((rows[0], start), rows[-1] - rows[0], stop - start, fill=False, edgecolor=_APERTURE))


def _reach(layout: WorldLayout) -> np.ndarray:
    """(2, 3) corners of what is shown: everything but walls and the tripod's foot [m]."""
    world = layout.world
    boxes = [image_grid(world, radar.name).bounds for radar in world.radars]
    boxes += [item.bounds for item in layout.objects] + [panel.mesh.bounds for panel in layout.panels]
    boxes.append(np.array([[*world.scan.corner, 0.0], [*np.add(world.scan.corner, world.scan.size), 0.0]]))
    return np.array([np.min(boxes, axis=0)[0] - _AROUND, np.max(boxes, axis=0)[1] + _AROUND])


def _legend(layout: WorldLayout) -> list[Line2D | Patch]:
    world = layout.world
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=_APERTURE, label=f"aperture, {len(world.scan.row_places)} rows"),
        Line2D([], [], color=_GRID, linestyle=":", label="published image grid"),
        Patch(color=_BEHIND, label=f"{world.support.kind}{', walls' if world.walls else ''}"),
    ]
    hides = sorted({panel.stack for panel in layout.panels})
    return entries + ([Line2D([], [], color=_HIDES, label=" and ".join(hides))] if hides else [])
