"""Figures of captures: where the radar was, and what it measured."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from millisight.core import SPEED_OF_LIGHT, checked_colormap
from millisight.core.errors import InputError
from millisight.data import Capture, TriangleMesh, VoxelGrid
from millisight.viz import _panels
from millisight.viz._outline import PLANE
from millisight.viz._panels import ORDER, NotebookFigure, Panel, Scale, styled
from millisight.viz._ticks import ticks_for

_MOST_POSES = 1500  # read for one figure
_MOST_DOTS = 20_000
_BLOCK_BYTES = 64_000_000
_ZERO_PADDING = 8
_POSITIONS_WIDTH = 2.5  # of the panel of positions beside profiles, about [inches]


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
    path_step = SPEED_OF_LIGHT / (length * abs(waveform.frequency_step))
    first = -(length // 8)
    blocks = []
    size = max(1, _BLOCK_BYTES // (8 * length * (capture.channels // total))) * step
    for begin in range(start, stop, size):
        frames = capture.frames_of(slice(begin, min(begin + size, stop), step))
        rising = frames if waveform.frequency_step > 0 else frames[..., ::-1]
        profiles = np.abs(np.fft.ifft(rising * window, n=length, axis=-1)) * (length / window.sum())
        blocks.append(np.roll(np.sqrt((profiles**2).mean(axis=(1, 2))), -first, axis=-1).astype(np.float32))
    ranges = ((first + np.arange(length)) * path_step - capture.radar.path_offset) / 2
    return RangeProfiles(np.arange(start, stop, step), ranges, np.concatenate(blocks))


@styled
def plot_capture(capture: Capture, *, dynamic_range_db: float = 60, title: str | None = None) -> Figure:
    """Plot the positions of the radar from above, coloured by pose, and the range profile of each; `Capture.plot`.

    Of a radar with a single frequency, which has no range profiles, the amplitude of every pose is shown. The figures
    `plot_aperture` and `plot_range_profiles` show more of either.

    Parameters
    ----------
    capture : in memory or on disk; 1500 poses at most are read, evenly spread
    dynamic_range_db : how far under the maximum the profiles reach
    title : written above

    Raises
    ------
    InputError, DamagedFileError
        The frames lie in a file that was closed, or cannot be read.
    """
    scale, total = Scale.checked("db", dynamic_range_db), len(capture.trajectory)
    figure = NotebookFigure(figsize=(9.4, 3.4), layout="constrained")
    where, what, bar = figure.subplots(1, 3, width_ratios=(1, 1.4, 0.035))
    dots = _draw_positions(where, capture, "z")
    figure.colorbar(dots, ax=where, fraction=0.05, pad=0.03).ax.set_title("pose", fontsize="medium")
    where.xaxis.set_major_locator(ticks_for(_POSITIONS_WIDTH, sideways=True))
    where.set(title="positions, from above", aspect="equal")
    where.margins(0.06)
    if capture.radar.waveform.samples_per_chirp > 1:
        profiles = range_profiles(capture)
        shown = where_something_is(profiles, capture)
        _draw_profiles(what, profiles, shown, total, scale, profiles.magnitude[:, shown].max())
        _panels.add_colour_bar(bar, scale, None, "|profile|  [dB re max]")
        what.set_title("range profiles")
    else:
        numbers = np.arange(total)[:: -(-total // _MOST_POSES)]
        amplitude = np.abs(capture.frames_of(slice(None, None, numbers[1] if total > 1 else 1)))
        what.plot(numbers, np.sqrt((amplitude**2).mean(axis=(1, 2, 3))), color="black", linewidth=0.8)
        what.set(xlabel="pose", ylabel="|frame|, RMS over channels", title="amplitude", facecolor="white")
        bar.remove()
    if title:
        figure.suptitle(title, fontsize=11.5, fontweight="bold")
    return figure


@styled
def plot_range_profiles(
    capture: Capture,
    *,
    poses: Sequence[int] | None = None,
    dynamic_range_db: float = 60,
    title: str | None = None,
) -> Figure:
    """Plot range profiles: a few poses and the RMS over all poses above, all poses as a picture below.

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
    shown = where_something_is(profiles, capture)
    ranges, mean = profiles.ranges[shown], _rms(profiles)[shown]
    single = {name: range_profiles(capture, poses=slice(p, p + 1)) for name, p in chosen.items()}
    lines = {name: profile.magnitude[0, shown] for name, profile in single.items()}
    maximum = max(float(profiles.magnitude[:, shown].max()), *(float(line.max()) for line in lines.values()), 0.0)
    below = Scale("db", scale.floor_db - 20)  # so that lines leave the picture, rather than run along its floor

    figure = NotebookFigure(figsize=(8.2, 6.4))
    top = 0.905 if title else 0.95
    upper = figure.add_axes((0.095, 0.545, 0.775, top - 0.545), facecolor="white")
    lower = figure.add_axes((0.095, 0.085, 0.775, 0.40), sharex=upper)
    bar = figure.add_axes((0.89, 0.085, 0.016, 0.40))
    colours = checked_colormap(ORDER)(np.linspace(0.1, 0.85, max(len(lines), 2)))
    for (name, line), color in zip(lines.items(), colours, strict=False):
        upper.plot(ranges, below(line, maximum), color=color, linewidth=0.9, label=name)
    stride = profiles.poses[1] - profiles.poses[0] if len(profiles.poses) > 1 else 1
    which = f"{len(profiles.poses)} poses" if stride == 1 else f"every {_ordinal(stride)} pose"
    upper.plot(ranges, below(mean, maximum), color="black", linewidth=1.6, label=f"RMS of {which}")
    upper.set(ylabel="|profile|  [dB re max]", xlim=(ranges[0], ranges[-1]), ylim=(scale.floor_db, 3))
    upper.grid(color="0.88", linewidth=0.6)
    upper.set_axisbelow(True)
    if len(lines) <= 3:
        upper.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=4)
    else:
        upper.legend(loc="upper right", frameon=True, framealpha=0.85, facecolor="white", edgecolor="none")
    _draw_profiles(lower, profiles, shown, total, scale, maximum)
    _panels.add_colour_bar(bar, scale, None, "|profile|  [dB re max]")
    if title:
        figure.text(0.095, 0.985, title, fontsize=11.5, fontweight="bold", va="top")
    return figure


def _draw_profiles(axes: Axes, profiles: RangeProfiles, shown: slice, total: int, scale: Scale, maximum: float) -> None:
    """Range to the right, poses up, of `total` poses; relative to `maximum`."""
    ranges = profiles.ranges[shown]
    half = (ranges[1] - ranges[0]) / 2
    extent = (ranges[0] - half, ranges[-1] + half, -0.5, total - 0.5)
    values = scale(profiles.magnitude[:, shown], maximum)
    axes.imshow(values, origin="lower", extent=extent, aspect="auto", cmap=checked_colormap(), norm=scale.norm)
    axes.set(xlabel="range [m]", ylabel="pose", xlim=(ranges[0], ranges[-1]))


def _usual_poses(capture: Capture) -> dict[str, int]:
    positions = capture.trajectory.positions
    middle = np.linalg.norm(positions - (positions.min(axis=0) + positions.max(axis=0)) / 2, axis=1).argmin()
    usual = {0: "first pose", len(positions) - 1: "last pose", int(middle): "pose nearest the middle"}
    return {name: pose for pose, name in sorted(usual.items())}


def _rms(profiles: RangeProfiles) -> np.ndarray:
    """(M,) over the poses."""
    return np.sqrt((profiles.magnitude.astype(float) ** 2).mean(axis=0))


def where_something_is(profiles: RangeProfiles, capture: Capture) -> slice:
    """The stretch that holds all within 30 dB of the maximum (and above the noise), with room about it."""
    ranges, mean = profiles.ranges, _rms(profiles)
    level = max(float(mean.max()) * 10 ** (-30 / 20), 3 * float(np.median(mean)))
    found = np.flatnonzero(mean >= min(level, float(mean.max())))
    room = 2.5 * capture.radar.waveform.range_resolution
    low, high = float(ranges[found[0]]) - room, float(ranges[found[-1]]) + room
    if ranges[mean.argmax()] >= 0:
        low = max(low, 0.0)
    start, stop = np.searchsorted(ranges, [low, high])
    return slice(int(min(start, len(ranges) - 2)), int(max(stop, start + 2)))


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
    """Plot the positions of the radar from above and from the side, with the object and the box of the image.

    Parameters
    ----------
    capture : its trajectory is drawn as dots, whose colour tells their order
    scene_mesh : drawn as an outline, in the world frame [m]
    grid : drawn as a dashed box
    title : written above
    """
    positions = capture.trajectory.positions
    seen = [positions.min(axis=0), positions.max(axis=0)]
    seen += [] if scene_mesh is None else list(scene_mesh.bounds)
    seen += [] if grid is None else list(grid.bounds)
    bounds = np.array(seen)
    margin = 0.06 * np.ptp(bounds, axis=0).max() or 1e-3
    bounds = np.array([bounds.min(axis=0) - margin, bounds.max(axis=0) + margin])
    views = {"z": "from above", "y": "from the side"}
    panels = [[Panel.around(bounds[:, PLANE[axis][0]], bounds[:, PLANE[axis][1]])] for axis in views]
    figure, (row,), (bar,) = _panels.place_panels([panels], title=title, height=6.0)
    for axes, (axis, seen_from) in zip(row, views.items(), strict=True):
        dots = _draw_positions(axes, capture, axis)
        if scene_mesh is not None:
            _panels.draw_outline(axes, scene_mesh, axis, color="black")
        if grid is not None:
            plane = list(PLANE[axis])
            low, size = grid.bounds[0, plane], np.ptp(grid.bounds, axis=0)[plane]
            axes.add_patch(Rectangle(tuple(low), *size, fill=False, linestyle="--", linewidth=0.9, edgecolor="tab:red"))
            if axis == "y":
                note: dict[str, Any] = {"xytext": (0, -3), "textcoords": "offset points", "va": "top", "fontsize": 7.5}
                axes.annotate("image grid", tuple(low), color="tab:red", **note)
        axes.set(title=seen_from, aspect="equal")
    figure.colorbar(dots, cax=bar).set_label("pose")
    return figure


def _draw_positions(axes: Axes, capture: Capture, axis: str) -> Any:
    """Dots seen along an axis, coloured by their order."""
    positions = capture.trajectory.positions
    numbers = np.arange(len(positions))[:: -(-len(positions) // _MOST_DOTS)]
    right, up = PLANE[axis]
    axes.set(facecolor="white", xlabel=f"{'xyz'[right]} [m]", ylabel=f"{'xyz'[up]} [m]")
    return axes.scatter(
        positions[numbers, right], positions[numbers, up], c=numbers, s=3 if len(numbers) < 3000 else 1, linewidths=0,
        cmap=checked_colormap(ORDER), vmin=0, vmax=max(1, len(positions) - 1), rasterized=True, zorder=2,
    )  # fmt: skip
