"""The picture of a virtual world before it is scanned: from above, from the side, and as the camera sees it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from millisight.capture.camera import CameraFrame
from millisight.rig.virtual.looks import look_of
from millisight.rig.virtual.stage import Stage
from millisight.rig.virtual.world import World
from millisight.scene.mesh import TriangleMesh
from millisight.viz.outline import PLANE
from millisight.viz.style import draw_lines, styled

_APERTURE, _GRID, _HIDES, _BEHIND = "#1f5fa8", "#8a8a8a", "#9a6a2f", "#dcdcdc"
_ROWS = 40  # drawn at most
_AROUND = 0.04  # [m]
_TALL = 4.6  # of the views [inches]
_DEEP = 0.3  # of the colours of depth [m]


@styled
def plot_world(stage: Stage, frame: CameraFrame, masks: list[np.ndarray]) -> Figure:
    """A stage from above and from the side, and what the camera sees of it, with depth.

    Parameters
    ----------
    stage : Stage
    frame : CameraFrame
    masks : (480, 640) bool of each object: its pixels if it were alone
    """
    lower, upper = _reach(stage)
    scale = _TALL / max(upper[1] - lower[1], upper[2] - lower[2])  # inches per metre, of both views
    places = _Places(*(scale * (upper - lower)))
    figure = Figure(figsize=places.figure)
    for title, axis, place in (("from above", "z", places.above), ("along x, from the right", "x", places.side)):
        axes = figure.add_axes(places.share(place))
        u, v = PLANE[axis]
        _draw_grid(axes, stage.world, axis)
        _draw_things(axes, stage, axis)
        axes.set(xlim=(lower[u], upper[u]), ylim=(lower[v], upper[v]), aspect="equal", title=title)
        axes.set(xlabel=f"{'xyz'[u]}  [m]", ylabel=f"{'xyz'[v]}  [m]", facecolor="white")
        if axis == "z":
            _draw_aperture(axes, stage.world)
            _name_things(axes, stage)
        else:
            axes.plot(np.add(stage.world.scan.corner[1], (0, stage.world.scan.size[1])), (0, 0), color=_APERTURE, lw=2)
    figure.legend(handles=_legend(stage), loc="lower left", bbox_to_anchor=(0.02, 0.0), ncols=4)

    picture, depth = (figure.add_axes(places.share(place)) for place in (places.picture, places.depth))
    picture.imshow(frame.rgb)
    shown = np.where(frame.depth > 0, frame.depth * frame.depth_unit, np.nan)
    nearest = float(np.nanmin(shown)) if np.isfinite(shown).any() else 0.0
    image = depth.imshow(shown, cmap="viridis_r", vmin=nearest, vmax=nearest + _DEEP)
    bar = figure.colorbar(image, cax=figure.add_axes(places.share(places.bar)), extend="max")
    bar.set_label("[m]")
    depth.set_facecolor("#5a1f1f")
    for axes, title in ((picture, "camera; objects outlined"), (depth, "its depth; dark red: none")):
        axes.set(xticks=[], yticks=[], title=title)
    for mask in masks:
        if mask.any() and not mask.all():
            picture.contour(mask, levels=[0.5], colors="white", linewidths=0.8)
    return figure


class _Places:
    """Where the panels are [inches]: left, bottom, width, height.

    Parameters
    ----------
    x, y, z : what the views show, to scale
    """

    def __init__(self, x: float, y: float, z: float):
        left, bottom, gap, top = 0.7, 0.95, 0.85, 0.4
        tall = max(y, z)
        wide = _TALL * 0.62  # of the camera's pictures, two of which and a gap are as high as the views
        high = wide * 480 / 640
        beside = left + x + gap + y + 0.35
        self.above = (left, bottom + tall - y, x, y)
        self.side = (left + x + gap, bottom + tall - z, y, z)
        self.picture = (beside, bottom + tall - high, wide, high)
        self.depth = (beside, bottom + tall - 2 * high - 0.35, wide, high)
        self.bar = (beside + wide + 0.1, self.depth[1], 0.12, high)
        self.figure = (beside + wide + 0.75, bottom + tall + top)

    def share(self, place: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        """A place as shares of the figure's size."""
        wide, high = self.figure
        return place[0] / wide, place[1] / high, place[2] / wide, place[3] / high


def _fill(axes: Axes, mesh: TriangleMesh, axis: str, colour: Any) -> None:
    """The faces seen along an axis, all in one colour."""
    faces = mesh.vertices[:, list(PLANE[axis])][mesh.faces]
    axes.add_collection(PolyCollection(list(faces), facecolors=[colour], edgecolors=[colour], linewidths=0.4))


def _draw_things(axes: Axes, stage: Stage, axis: str) -> None:
    for part in stage.background:
        _fill(axes, part.mesh, axis, _BEHIND)
    for thing in stage.objects:
        for part in thing.parts:
            _fill(axes, part.mesh, axis, look_of(part.material.name, thing.name).colour)
    for panel in stage.panels:
        corners = panel.mesh.vertices[:, list(PLANE[axis])]
        draw_lines(axes, [np.concatenate([corners, corners[:1]])], color=_HIDES, width=1.2)


def _name_things(axes: Axes, stage: Stage) -> None:
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    for thing in stage.objects:
        (left, low, _), (right, _, _) = thing.bounds
        axes.annotate(
            thing.name.replace("_", " "), ((left + right) / 2, low), (0, -3), textcoords="offset points",
            ha="center", va="top", fontsize=8, zorder=6, bbox=box,
        )  # fmt: skip


def _draw_grid(axes: Axes, world: World, axis: str) -> None:
    """Where the published images reach."""
    for radar in world.radars:
        lower, upper = world.image_grid(radar.folder).bounds[:, list(PLANE[axis])]
        axes.add_patch(Rectangle(tuple(lower), *(upper - lower), fill=False, edgecolor=_GRID, linestyle=":"))


def _draw_aperture(axes: Axes, world: World) -> None:
    """Its rows, no more than can be told apart."""
    rows = world.scan.row_places
    start, stop = np.add(world.scan.corner[1], (0, world.scan.size[1]))
    shown = rows[:: -(-len(rows) // _ROWS)]
    draw_lines(axes, [np.array([[x, start], [x, stop]]) for x in shown], color=_APERTURE, width=0.5, alpha=0.45)
    axes.add_patch(Rectangle((rows[0], start), rows[-1] - rows[0], stop - start, fill=False, edgecolor=_APERTURE))


def _reach(stage: Stage) -> tuple[np.ndarray, np.ndarray]:
    """(3,) corners of what is shown: everything but walls and the tripod's foot."""
    world = stage.world
    boxes = [world.image_grid(radar.folder).bounds for radar in world.radars]
    boxes += [thing.bounds for thing in stage.objects] + [panel.mesh.bounds for panel in stage.panels]
    boxes.append(np.array([[*world.scan.corner, 0.0], [*np.add(world.scan.corner, world.scan.size), 0.0]]))
    return np.min([b[0] for b in boxes], axis=0) - _AROUND, np.max([b[1] for b in boxes], axis=0) + _AROUND


def _legend(stage: Stage) -> list[Line2D | Patch]:
    world = stage.world
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=_APERTURE, label=f"aperture, {len(world.scan.row_places)} rows"),
        Line2D([], [], color=_GRID, linestyle=":", label="published image grid"),
        Patch(color=_BEHIND, label=f"{world.support.kind}{', walls' if world.walls else ''}"),
    ]
    hides = sorted({panel.stack for panel in stage.panels})
    return entries + ([Line2D([], [], color=_HIDES, label=" and ".join(hides))] if hides else [])
