"""Figures of captures, and of many images side by side."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from millisight.capture.capture import Capture
from millisight.constants import SPEED_OF_LIGHT
from millisight.errors import InputError, UnknownNameError
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.image import SarImage
from millisight.records import checked_number
from millisight.scene.mesh import TriangleMesh
from millisight.viz.outline import PLANE
from millisight.viz.style import (
    Panel,
    Scale,
    add_colour_bar,
    borders,
    checked_colormap,
    draw_outline,
    place_panels,
    show_pixels,
    styled,
)

_MOST_POSES = 1500  # read for one figure
_MOST_DOTS = 20_000
_BLOCK_BYTES = 64_000_000
_ZERO_PADDING = 8


@styled
def plot_sheet(
    images: Mapping[str, SarImage],
    *,
    meshes: Mapping[str, TriangleMesh] | None = None,
    columns: int | None = None,
    scale: str = "linear",
    dynamic_range_db: float = 30,
    colormap: str = "inferno",
    title: str | None = None,
) -> Figure:
    """Many images side by side, all equally large: the mean of |I| along z, each over its own maximum.

    Parameters
    ----------
    images : name -> image, shown in this order
    meshes : name -> mesh, whose outline is drawn over the image of that name [m]
    columns : pictures in a row; default about as wide as high
    scale, dynamic_range_db : as for `plot_projections`
    colormap : Matplotlib's name
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
        if name not in images:
            raise UnknownNameError("image", name, images)
    shades, colours = Scale.checked(scale, dynamic_range_db), checked_colormap(colormap)
    if columns is None:
        columns = min(6, int(np.ceil(np.sqrt(1.5 * len(images)))))
    columns = min(int(checked_number(columns, name="columns", minimum=1)), len(images))
    own = [Panel.around(borders(i.grid.x, 1e-3), borders(i.grid.y, 1e-3)) for i in images.values()]
    # Every picture shows as much as the widest and the highest need, about its own middle.
    shown = np.array([[-0.5, 0.5]]).T * [max(p.size[k] for p in own) for k in (0, 1)]
    panels = [Panel(*map(tuple, (np.mean([p.u, p.v], axis=1) + shown).T)) for p in own]
    alike = all(np.allclose(np.ravel(p), np.ravel(panels[0])) for p in panels)
    rows = [[[panel] for panel in panels[i : i + columns]] for i in range(0, len(panels), columns)]
    gaps = (0.16, 0.34) if alike else (0.5, 0.6)
    figure, axes_rows, bars = place_panels(
        rows, title=title, width=1.8 + 2.6 * columns, height=1.2 + 3.2 * len(rows), gaps=gaps
    )
    all_axes = [axes for row in axes_rows for axes in row]
    for number, (axes, (name, image)) in enumerate(zip(all_axes, images.items(), strict=True)):
        show_pixels(axes, image.grid.x, image.grid.y, shades(image.project("z")), shades, colours)
        if name in meshes:
            draw_outline(axes, meshes[name], "z")
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
    add_colour_bar(bars[0], shades, colours, f"mean {shades.unit}")
    return figure


class RangeProfiles(NamedTuple):
    """Magnitudes (n, M), RMS over the channels, of the poses (n,) at one-way ranges (M,) [m]."""

    poses: np.ndarray
    ranges: np.ndarray
    magnitude: np.ndarray


def range_profiles(capture: Capture, *, poses: slice | None = None) -> RangeProfiles:
    """Range profiles of a capture (primer 5) with a Hann window, zero-padded eightfold; less the path offset.

    Parameters
    ----------
    capture : in memory or on disk, then read in blocks
    poses : which to read; default 1500 at most, evenly spread

    Returns
    -------
    RangeProfiles
        Ranges reach from an eighth of the unambiguous range c / (2 frequency step) under zero to seven above.

    Raises
    ------
    InputError
        The radar has a single frequency, and so no range profiles.
    """
    waveform = capture.radar.waveform
    if waveform.samples_per_chirp < 2:
        raise InputError(f"{capture.radar.name} has one sample a chirp, so no range profiles; it needs two or more")
    total = len(capture.trajectory)
    poses = slice(0, total, -(-total // _MOST_POSES)) if poses is None else poses
    start, stop, step = poses.indices(total)
    samples, length = waveform.samples_per_chirp, _ZERO_PADDING * waveform.samples_per_chirp
    window = np.hanning(samples + 2)[1:-1].astype(np.float32)
    # exp(+i 2 pi j step d / c) undoes the delay of the path d: an inverse transform, whose entry m lies at
    # d = m c / (length step). Its first entry is moved to an eighth of the way, to see what lies about zero.
    path_step = SPEED_OF_LIGHT / (length * waveform.frequency_step)
    first = -(length // 8)
    blocks = []
    size = max(1, _BLOCK_BYTES // (8 * length * int(np.prod(capture.frames.shape[1:3])))) * step
    for begin in range(start, stop, size):
        frames = capture.frames_of(slice(begin, min(begin + size, stop), step))
        profiles = np.abs(np.fft.ifft(frames * window, n=length, axis=-1)) * (length / window.sum())
        blocks.append(np.roll(np.sqrt((profiles**2).mean(axis=(1, 2))), -first, axis=-1).astype(np.float32))
    ranges = ((first + np.arange(length)) * path_step - capture.radar.path_offset) / 2
    return RangeProfiles(np.arange(start, stop, step), ranges, np.concatenate(blocks))


@styled
def plot_range_profiles(
    capture: Capture,
    *,
    poses: Sequence[int] | None = None,
    dynamic_range_db: float = 60,
    title: str | None = None,
) -> Figure:
    """Range profiles: of a few poses and the RMS over all poses above, of all poses as a picture below.

    Profiles have a Hann window and are the RMS over the channels of a pose; of a long capture, 1500 poses at
    most are read, evenly spread. The range axis is cut to where something is.

    Parameters
    ----------
    capture : in memory or on disk
    poses : the poses' numbers; default the first, the one nearest to the aperture's middle, and the last
    dynamic_range_db : how far under the maximum the figure reaches
    title : written above

    Raises
    ------
    InputError
        A pose is not there, or the radar has a single frequency.
    """
    scale = Scale.checked("db", dynamic_range_db)
    total = len(capture.trajectory)
    chosen = _usual_poses(capture) if poses is None else {f"pose {pose}": int(pose) for pose in poses}
    for pose in chosen.values():
        if not 0 <= pose < total:
            raise InputError(f"pose {pose} is not in the capture; expected 0 to {total - 1}")
    profiles = range_profiles(capture)
    mean = np.sqrt((profiles.magnitude.astype(float) ** 2).mean(axis=0))
    shown = _where_something_is(profiles.ranges, mean, capture.radar.waveform.range_resolution)
    ranges, picture = profiles.ranges[shown], profiles.magnitude[:, shown]
    single = {name: range_profiles(capture, poses=slice(p, p + 1)) for name, p in chosen.items()}
    lines = {name: profile.magnitude[0, shown] for name, profile in single.items()}
    maximum = max(float(picture.max()), *(float(line.max()) for line in lines.values()), 0.0)
    below = Scale("db", scale.floor_db - 20)  # so that lines leave the picture, rather than run along its floor

    figure = Figure(figsize=(8.2, 6.4))
    top = 0.905 if title else 0.95
    upper = figure.add_axes((0.095, 0.545, 0.775, top - 0.545), facecolor="white")
    lower = figure.add_axes((0.095, 0.085, 0.775, 0.40), sharex=upper)
    bar = figure.add_axes((0.89, 0.085, 0.016, 0.40))
    for (name, line), color in zip(lines.items(), _line_colors(len(lines)), strict=True):
        upper.plot(ranges, below(line, maximum), color=color, linewidth=0.9, label=name)
    stride = profiles.poses[1] - profiles.poses[0] if len(profiles.poses) > 1 else 1
    which = f"{len(profiles.poses)} poses" if stride == 1 else f"every {_ordinal(stride)} pose"
    upper.plot(ranges, below(mean[shown], maximum), color="black", linewidth=1.6, label=f"RMS of {which}")
    upper.set(ylabel="|profile|  [dB re max]", xlim=(ranges[0], ranges[-1]), ylim=(scale.floor_db, 3))
    upper.grid(color="0.88", linewidth=0.6)
    upper.set_axisbelow(True)
    if len(lines) <= 3:
        upper.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=4)
    else:
        upper.legend(loc="upper right", frameon=True, framealpha=0.85, facecolor="white", edgecolor="none")
    colours = checked_colormap("inferno")
    half = (ranges[1] - ranges[0]) / 2
    extent = (ranges[0] - half, ranges[-1] + half, -0.5, total - 0.5)
    values = scale(picture, maximum)
    lower.imshow(values, origin="lower", extent=extent, aspect="auto", cmap=colours, norm=scale.norm)
    lower.set(xlabel="range [m]", ylabel="pose", xlim=(ranges[0], ranges[-1]))
    add_colour_bar(bar, scale, colours, "|profile|  [dB re max]")
    if title:
        figure.text(0.095, 0.985, title, fontsize=11.5, fontweight="bold", va="top")
    return figure


def _usual_poses(capture: Capture) -> dict[str, int]:
    positions = capture.trajectory.positions
    middle = np.linalg.norm(positions - (positions.min(axis=0) + positions.max(axis=0)) / 2, axis=1).argmin()
    usual = {0: "first pose", len(positions) - 1: "last pose", int(middle): "pose nearest the middle"}
    return {name: pose for pose, name in sorted(usual.items())}


def _where_something_is(ranges: np.ndarray, mean: np.ndarray, resolution: float) -> slice:
    """The stretch that holds all within 30 dB of the maximum (and above the noise), with room about it."""
    level = max(float(mean.max()) * 10 ** (-30 / 20), 3 * float(np.median(mean)))
    found = np.flatnonzero(mean >= min(level, float(mean.max())))
    room = 2.5 * resolution
    low, high = float(ranges[found[0]]) - room, float(ranges[found[-1]]) + room
    if ranges[mean.argmax()] >= 0:
        low = max(low, 0.0)
    start, stop = np.searchsorted(ranges, [low, high])
    return slice(int(min(start, len(ranges) - 2)), int(max(stop, start + 2)))


def _line_colors(count: int) -> list:
    return list(checked_colormap("viridis")(np.linspace(0.1, 0.85, max(count, 2)))[:count])


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th") if number % 100 not in (11, 12, 13) else "th"
    return f"{number}{ending}"


@styled
def plot_aperture(
    capture: Capture,
    scene_mesh: TriangleMesh | None = None,
    *,
    grid: VoxelGrid | None = None,
    title: str | None = None,
) -> Figure:
    """Where the radar was, seen from above and from the side, over the object and the image's box.

    Parameters
    ----------
    capture : its trajectory is drawn as dots, whose colour tells their order
    scene_mesh : drawn as an outline, in the world frame [m]
    grid : drawn as a dashed box
    title : written above
    """
    positions = capture.trajectory.positions
    stride = -(-len(positions) // _MOST_DOTS)
    dots, numbers = positions[::stride], np.arange(len(positions))[::stride]
    seen = [positions.min(axis=0), positions.max(axis=0)]
    seen += [] if scene_mesh is None else list(scene_mesh.bounds)
    seen += [] if grid is None else list(grid.bounds)
    bounds = np.array(seen)
    margin = 0.06 * np.ptp(bounds, axis=0).max() or 1e-3
    bounds = np.array([bounds.min(axis=0) - margin, bounds.max(axis=0) + margin])
    views = {"z": "from above", "y": "from the side"}
    panels = [[Panel.around(bounds[:, PLANE[axis][0]], bounds[:, PLANE[axis][1]])] for axis in views]
    figure, (row,), (bar,) = place_panels([panels], title=title, height=6.0)
    for axes, (axis, seen_from) in zip(row, views.items(), strict=True):
        right, up = PLANE[axis]
        axes.set_facecolor("white")
        picture = axes.scatter(
            dots[:, right], dots[:, up], c=numbers, s=3 if len(dots) < 3000 else 1, linewidths=0, cmap="viridis",
            vmin=0, vmax=max(1, len(positions) - 1), rasterized=True, zorder=2,
        )  # fmt: skip
        if scene_mesh is not None:
            draw_outline(axes, scene_mesh, axis, color="black")
        if grid is not None:
            (left, low), (width, tall) = grid.bounds[0, [right, up]], np.ptp(grid.bounds, axis=0)[[right, up]]
            box = Rectangle((left, low), width, tall, fill=False, linestyle="--", linewidth=0.9, edgecolor="tab:red")
            axes.add_patch(box)
            if axis == "y":
                note = {"xytext": (0, -3), "textcoords": "offset points", "va": "top", "fontsize": 7.5}
                axes.annotate("image grid", (left, low), color="tab:red", **note)
        axes.set(xlabel=f"{'xyz'[right]} [m]", ylabel=f"{'xyz'[up]} [m]", title=seen_from, aspect="equal")
    figure.colorbar(picture, cax=bar).set_label("pose")
    return figure
