"""What a notebook shows of a record: `plot` of meshes, scenes and masks, and a card with a small picture and facts."""

import base64
from contextlib import suppress
from html import escape
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from millisight.core import checked_colormap
from millisight.core.errors import InputError, MillisightError
from millisight.data import Capture, Mask, PixelGrid, SarImage, Scene, TriangleMesh, grid_difference
from millisight.viz._captures import range_profiles, where_something_is
from millisight.viz._facts import facts_of
from millisight.viz._figures import BLUE, GREEN, ORANGE, VERMILION, draw_mesh
from millisight.viz._figures_perception import draw_mask_outline
from millisight.viz._outline import PLANE, relief
from millisight.viz._panels import Panel, Scale, borders, label_view, place_panels, show_pixels, styled

_SOLID = "#c9ced3"
_OBJECTS = (_SOLID, ORANGE, "#56B4E9", GREEN, "#F0E442", BLUE, VERMILION, "#CC79A7")  # Okabe and Ito's
_RANGE_DB = 30  # of an image under a mask's outline
_PIXELS = 240  # of a card's picture, along its longer side
_MOST_VOXELS = 8_000_000  # looked at for a card
_MOST_FACES = 200_000
_MOST_BYTES = 64_000_000  # read from disk


@styled
def plot_mesh(mesh: TriangleMesh, *, title: str | None = None) -> Figure:
    """A mesh as a lit solid, seen along z, y and x; `TriangleMesh.plot`.

    Parameters
    ----------
    mesh : TriangleMesh
    title : written above
    """
    return _solid(mesh, _SOLID, title)


@styled
def plot_scene(scene: Scene, *, title: str | None = None) -> Figure:
    """The objects of a scene as lit solids, each in its own colour, seen along z, y and x; `Scene.plot`.

    Parameters
    ----------
    scene : Scene
    title : written above
    """
    colours = [_OBJECTS[i % len(_OBJECTS)] for i in range(len(scene.objects))]
    figure = _solid(scene.mesh, np.repeat(colours, [len(o.mesh.faces) for o in scene.objects]), title)
    names = [f"{o.name}, {o.material.name}" for o in scene.objects]
    entries = [Patch(color=colour, label=name) for colour, name in zip(colours, names, strict=True)]
    figure.axes[0].legend(handles=entries, loc="upper left", bbox_to_anchor=(0, -0.2), borderaxespad=0)
    return figure


def _solid(mesh: TriangleMesh, colours: Any, title: str | None) -> Figure:
    room = 0.06 * float(mesh.extent.max()) * np.array([[-1.0], [1.0]])
    figure, (row,), (bar,) = place_panels([Panel.views_of(mesh.bounds + room)], title=title)
    bar.remove()
    for axes, axis in zip(row, PLANE, strict=True):
        axes.set_facecolor("white")
        draw_mesh(axes, mesh, axis, color=colours)
        label_view(axes, axis)
    return figure


@styled
def plot_mask(mask: Mask, *, image: SarImage | None = None, title: str | None = None) -> Figure:
    """A mask seen along z, as in the figures of images; `Mask.plot`.

    Parameters
    ----------
    mask : Mask
    image : on the same pixels, over which its outline is drawn; None: the mask alone
    title : written above; default how much of the picture it covers

    Raises
    ------
    InputError
        The image has other pixels.
    """
    if image is not None and (differs := grid_difference(image.grid, mask.grid_xy)):
        raise InputError(f"the image and the mask have different pixels, along {differs}")
    edges = [borders(axis, 1e-3) for axis in (mask.grid_xy.x, mask.grid_xy.y)]
    figure, ((axes,),), (bar,) = place_panels([[[Panel.around(*edges)]]], title=None, height=5.0)
    bar.remove()
    if image is None:
        axes.pcolormesh(*edges, mask.inside.T, cmap=ListedColormap(["0.2", "white"]), vmin=0, vmax=1, rasterized=True)
    else:
        shades = Scale.checked("db", _RANGE_DB)
        show_pixels(axes, image.grid.x, image.grid.y, shades(image.project("z")), shades, checked_colormap("gray"))
        draw_mask_outline(axes, mask.inside, mask.grid_xy, color=VERMILION)
    label_view(axes, "z", title or f"mask: {100 * mask.inside.mean():.1f} % of the picture")
    return figure


def html_card(record: SarImage | Mask | Capture | TriangleMesh) -> str:
    """A small picture of a record and a table of facts, as HTML, for notebooks.

    The picture is left out where there are no data to make it of, or where finding it would take long: of captures
    over 64 MB on disk. Of images over 8 million voxels it shows every few; of meshes over 200 000 faces, too.

    Parameters
    ----------
    record : SarImage, Mask, Capture or TriangleMesh
    """
    picture = ""
    with suppress(MillisightError, OSError, MemoryError):
        pixels = _thumbnail(record)
        if pixels is not None:
            held = BytesIO()
            _resized(pixels).save(held, "PNG")
            source = base64.b64encode(held.getvalue()).decode()
            picture = f'<img src="data:image/png;base64,{source}" alt="" style="align-self:flex-start">'
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(fact)}</td></tr>'
        for name, fact in facts_of(record, quick=True)
    )
    return f'<div style="display:flex;gap:1em">{picture}<table style="align-self:flex-start">{rows}</table></div>'


def _thumbnail(record: Any) -> "tuple[np.ndarray, float] | None":
    """(rows, columns, 3) uint8, and how much wider than high it is shown; None: it would take long."""
    if isinstance(record, SarImage):
        every = int(np.ceil(np.sqrt(record.grid.size / _MOST_VOXELS)))
        seen = np.abs(record.values[::every, ::every]).mean(axis=2)
        return _coloured(Scale.checked("linear", 30)(seen).T[::-1]), _ratio(record.grid.xy)
    if isinstance(record, Mask):
        grey = np.where(record.inside.T[::-1], 255, 51).astype(np.uint8)  # as `plot_mask`
        return np.repeat(grey[..., None], 3, axis=2), _ratio(record.grid_xy)
    if isinstance(record, TriangleMesh):
        faces = record.faces[:: -(-len(record.faces) // _MOST_FACES)]
        light = relief(TriangleMesh(vertices=record.vertices, faces=faces), "z", _PIXELS).T[::-1]
        grey = np.where(np.isnan(light), 255, 205 * np.nan_to_num(light)).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2), grey.shape[1] / grey.shape[0]
    samples = record.radar.waveform.samples_per_chirp
    if samples < 2 or (not record.in_memory and 8 * samples * record.channels > _MOST_BYTES):
        return None
    profiles = range_profiles(record, poses=slice(None, None, -(-len(record.trajectory) // _PIXELS)))
    seen = profiles.magnitude[:, where_something_is(profiles, record)]
    scale = Scale.checked("db", 60)
    return _coloured(scale(seen)[::-1] / -scale.floor_db + 1), 1.5


def _ratio(grid: PixelGrid) -> float:
    """How much wider than high the picture of a grid is."""
    width, height = Panel.around(borders(grid.x, 1e-3), borders(grid.y, 1e-3), least=0.02).size
    return width / height


def _coloured(shares: np.ndarray) -> np.ndarray:
    return checked_colormap()(shares, bytes=True)[..., :3]


def _resized(thumbnail: tuple[np.ndarray, float]) -> Any:
    from PIL import Image

    pixels, ratio = thumbnail
    size = (_PIXELS, round(_PIXELS / ratio)) if ratio > 1 else (round(_PIXELS * ratio), _PIXELS)
    return Image.fromarray(np.ascontiguousarray(pixels)).resize((max(1, size[0]), max(1, size[1])), resample=0)
