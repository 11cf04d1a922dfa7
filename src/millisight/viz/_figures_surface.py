"""Figures of measured surfaces and oriented points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from millisight.core import checked_record
from millisight.data import PointCloud, Surface, TriangleMesh
from millisight.viz._panels import checked_colormap, draw_outline, styled

_VIEWS = ((0, 1, 2, 1), (0, 2, 1, -1), (1, 2, 0, 1))  # right, up, towards the viewer, and from which end
_TRUTH = "#b8bec4"
_GUESSED = 0.55  # grey of what was not seen
_POINT = "#D55E00"
_LIGHT = np.array([0.3, 0.2, 0.93])
_WIDTH, _TALLEST = 3.4, 4.5  # of a panel [inches]
_MOST = 4000  # points that are drawn


@styled
def plot_surface(
    surface: Surface,
    *,
    points: PointCloud | None = None,
    truth: TriangleMesh | None = None,
    title: str | None = None,
    worst: float | None = None,
    colormap: str | None = None,
) -> Figure:
    """Plot a measured surface seen along z, y and x, coloured by its standard deviation; `Surface.plot`.

    Parameters
    ----------
    surface : Surface; what of it was not seen (`metadata["seen_vertices"]`) is grey
    points : of which it was made, drawn as dots; None: none
    truth : true mesh, drawn in grey behind; None: none
    title : written above
    worst : standard deviation at the end of the colours [m]; None: the 95th percentile
    colormap : see `plot_image`

    Raises
    ------
    InputError
        There is no such colour map.
    """
    mesh = checked_record(surface, Surface, name="surface").mesh
    colours = checked_colormap(colormap)
    count = surface.metadata.get("seen_vertices", len(mesh.vertices))
    most = float(np.percentile(surface.sigma[:count], 95)) if worst is None else worst
    norm = Normalize(0, max(1e3 * most, 1e-6))
    boxes = [mesh.bounds] + ([] if truth is None else [truth.bounds])
    lower, upper = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    figure, panels = _views(lower, upper)
    shade = 0.35 + 0.65 * np.clip(mesh.face_normals @ _LIGHT, 0, 1)
    rgb = np.asarray(colours(norm(1e3 * surface.sigma[mesh.faces].mean(axis=1))))
    rgb[(mesh.faces >= count).any(axis=1), :3] = _GUESSED
    rgb[:, :3] *= shade[:, None]
    for axes, (right, up, towards, end) in zip(panels, _VIEWS, strict=True):
        if truth is not None:
            corners = truth.vertices[truth.faces][:, :, [right, up]]
            axes.add_collection(PolyCollection(list(corners), facecolors=_TRUTH, edgecolors="none", alpha=0.35))
        order = np.argsort(end * mesh.vertices[mesh.faces].mean(axis=1)[:, towards])
        corners = mesh.vertices[mesh.faces[order]][:, :, [right, up]]
        axes.add_collection(PolyCollection(list(corners), facecolors=rgb[order], edgecolors="none"))
        if points is not None and len(points):
            some = points.points[:: max(1, len(points) // _MOST)]
            axes.plot(some[:, right], some[:, up], ".", color="white", markersize=0.7)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=panels, pad=0.01, fraction=0.03)
    bar.set_label("standard deviation [mm]")
    if title:
        figure.suptitle(title)
    return figure


@styled
def plot_points(cloud: PointCloud, *, truth: Sequence[TriangleMesh] = (), title: str | None = None) -> Figure:
    """Plot points seen along z, y and x, over the object's parts in grey, their outlines in black.

    Parameters
    ----------
    cloud : PointCloud
    truth : meshes of the object's parts
    title : written above
    """
    points = checked_record(cloud, PointCloud, name="cloud").points
    corners = np.concatenate([mesh.vertices[mesh.faces].reshape(-1, 3) for mesh in truth] or [points])
    every = np.concatenate([points, corners])
    figure, panels = _views(every.min(axis=0), every.max(axis=0))
    for axes, (right, up, toward, _) in zip(panels, _VIEWS, strict=True):
        if truth:
            flat = corners.reshape(-1, 3, 3)[:, :, [right, up]]
            axes.add_collection(PolyCollection(list(flat), facecolors=_TRUTH, edgecolors="none"))
        axes.plot(points[:, right], points[:, up], ".", color=_POINT, markersize=2)
        for mesh in truth:
            draw_outline(axes, mesh, "xyz"[toward], color="black", inner=False)
    if title:
        figure.suptitle(title)
    return figure


def _views(lower: np.ndarray, upper: np.ndarray) -> tuple[Figure, Any]:
    """A figure with three panels that hold a box seen along z, y and x."""
    margin = 0.05 * float((upper - lower).max())
    extent = upper - lower + 2 * margin
    tall = min(_TALLEST, max(1.4, _WIDTH * max(extent[up] / extent[right] for right, up, _, _ in _VIEWS)))
    figure = Figure(figsize=(3 * _WIDTH + 0.9, tall + 0.7), layout="constrained")
    panels: Any = figure.subplots(1, 3)
    for axes, (right, up, _, _) in zip(panels, _VIEWS, strict=True):
        axes.set_xlim(lower[right] - margin, upper[right] + margin)
        axes.set_ylim(lower[up] - margin, upper[up] + margin)
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[right]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.locator_params(nbins=4)
    return figure, panels
