"""Figures of evaluated simulators and segmenters: scores, single pairs of images, and single masks."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from millisight import evaluation
from millisight.data import Mask, Picture, PixelGrid, SarImage
from millisight.evaluation import DISTANCES, SIGHTS, THRESHOLDS, CloudSettings, ImagePair, MaskAttempt, MaskTrial
from millisight.viz._panels import ORDER, borders, checked_colormap, panel_of, show_pixels, styled
from millisight.viz._panels import Scale as Shades

_MEASURED, _SIMULATED = "#0072B2", "#D55E00"  # Okabe and Ito's: told apart by everybody
_PARTS = (("combined", "#009E73"), ("specular", "#0072B2"), ("edge", "#E69F00"))
_MOST_DOTS = 4000
_HIT, _MISSED, _FALSE = "#009E73", "#E69F00", "#CC79A7"  # Okabe and Ito's: told apart by everybody
_SHOWN = ("f1", "recall")


@styled
def plot_pair(
    measured: SarImage,
    simulated: SarImage,
    *,
    measured_points: np.ndarray,
    simulated_points: np.ndarray,
    title: str,
) -> Figure:
    """Four panels: the two images from above, and their points from above and from the front.

    Parameters
    ----------
    measured, simulated : images
    measured_points, simulated_points : (N, 3) and (M, 3), the latter moved onto the former [m]
    title : written above
    """
    figure = Figure(figsize=(10.4, 3.3))
    panels = [figure.add_axes((0.055 + 0.248 * n, 0.15, 0.18, 0.64)) for n in range(4)]
    shades, colours = Shades.checked("linear", 30), checked_colormap()
    for axes, image, name in zip(panels, (measured, simulated), ("measured", "simulated"), strict=False):
        grid = image.grid
        panel = panel_of(grid)
        axes.set(xlim=panel.u, ylim=panel.v)
        show_pixels(axes, grid.x, grid.y, shades(image.project("z")), shades, colours)
        axes.set(xlabel="x [m]", ylabel="y [m]" if name == "measured" else "", title=f"{name}, mean along z")
    for axes, (i, j), name in zip(panels[2:], ((0, 1), (0, 2)), ("above", "the front"), strict=True):
        _dots(axes, measured_points, simulated_points, i, j)
        axes.set(xlabel="x [m]", ylabel=f"{'xyz'[j]} [m]", title=f"points, from {name}")
    panels[3].legend(loc="lower center", bbox_to_anchor=(0.5, 1.1), ncols=2, markerscale=4, handletextpad=0.1)
    figure.suptitle(title, fontsize=11, y=0.98)
    return figure


def _dots(axes: Axes, there: np.ndarray, moved: np.ndarray, i: int, j: int) -> None:
    clouds = ((there, _MEASURED, "measured", 4.0), (moved, _SIMULATED, "simulated, moved", 1.5))
    for points, colour, label, size in clouds:
        some = points[:: max(1, len(points) // _MOST_DOTS)]
        axes.scatter(some[:, i], some[:, j], s=size, color=colour, alpha=0.5, linewidths=0, label=label)
    axes.set_facecolor("white")
    axes.set_aspect("equal", adjustable="datalim")


@styled
def plot_sensitivity(pairs: Sequence[ImagePair], *, settings: CloudSettings, title: str) -> Figure:
    """Median F of the best combinations over tau_P and tau_F, a map for each sight; the table's own values framed.

    Parameters
    ----------
    pairs : measured and simulated images with their scores
    settings : thresholds of the point clouds
    title : written above
    """
    there = [sight for sight in SIGHTS if any(pair.sight == sight for pair in pairs)]
    figure = Figure(figsize=(1.2 + 3.6 * len(there), 3.6))
    width = 0.78 / len(there)
    for number, sight in enumerate(there):
        axes = figure.add_axes((0.11 + number * (width + 0.05), 0.15, width - 0.02, 0.63))
        maps = [pair.sensitivity for pair in pairs if pair.sight == sight and pair.sensitivity is not None]
        median = 100 * np.median(maps, axis=0)
        axes.imshow(median, origin="lower", cmap=checked_colormap(ORDER), vmin=0, vmax=100, aspect="auto")
        for (i, j), value in np.ndenumerate(median):
            axes.text(j, i, f"{value:.0f}", ha="center", va="center", color="white" if float(value) < 60 else "black")
        axes.set_xticks(range(len(DISTANCES)), [f"{1000 * distance:g}" for distance in DISTANCES])
        axes.set_yticks(range(len(THRESHOLDS)), [f"{threshold:g}" for threshold in THRESHOLDS])
        axes.set(xlabel="tau_F [mm]", ylabel="tau_P, share of the maximum" if number == 0 else "")
        axes.set_title(f"{SIGHTS[sight]}, {len(maps)} pairs")
        place = np.interp(settings.within, DISTANCES, range(len(DISTANCES)))
        axes.plot(
            place, np.interp(settings.threshold, THRESHOLDS, range(len(THRESHOLDS))), "s", ms=19, mfc="none", mec="red"
        )
    figure.suptitle(title, fontsize=10, y=0.98)
    return figure


@styled
def plot_scores(pairs: Sequence[ImagePair]) -> Figure:
    """Plot the sorted F-scores of all pairs, for the combination and for both parts alone."""
    there = [sight for sight in SIGHTS if any(pair.sight == sight for pair in pairs)]
    figure = Figure(figsize=(1.0 + 3.8 * len(there), 3.4))
    width = 0.82 / len(there)
    for number, sight in enumerate(there):
        axes = figure.add_axes((0.11 + number * (width + 0.04), 0.16, width - 0.02, 0.72), facecolor="white")
        for part, colour in _PARTS:
            name = "best" if part == "combined" else part
            found = [getattr(pair.comparison, name).score.f for pair in pairs if pair.sight == sight]
            scores = np.sort(100 * np.array(found))
            axes.plot(scores, (np.arange(len(scores)) + 0.5) / len(scores), "o-", ms=3, color=colour, label=part)
        axes.set(
            xlim=(0, 100),
            ylim=(0, 1),
            xlabel="F [%]",
            ylabel="share of pairs with a lower score" if number == 0 else "",
        )
        axes.set_title(SIGHTS[sight])
        axes.grid(color="0.92", linewidth=0.6)
        axes.legend(loc="upper left")
    return figure


@styled
def plot_attempt(attempt: MaskAttempt, *, picture: Picture, truth: Mask, title: str) -> Figure:
    """Three panels: the picture with its prompts, the mask and the truth as outlines, and what is right and wrong.

    Parameters
    ----------
    attempt : the prompts, the mask and its scores
    picture : what the segmenter looked at
    truth : the true mask
    title : written above
    """
    figure = Figure(figsize=(9.6, 3.9))
    left, middle, right = (figure.add_axes((0.06 + 0.315 * n, 0.13, 0.285, 0.66)) for n in range(3))
    grid = truth.grid_xy
    if picture.grid_xy is None:
        left.imshow(picture.rgb)
        left.set_axis_off()
    else:
        _show(left, picture.grid_xy, picture.rgb)
    prompts = None if attempt.found is None else attempt.found.prompts
    _draw_prompts(left, picture, prompts)
    left.set_title("input" if prompts is None else "input and prompts", fontsize=9)
    power = picture.power if picture.grid_xy is not None else None
    grey = np.full((*truth.inside.shape, 3), 230, np.uint8)
    if power is not None:
        grey = np.repeat((255 * (1 - 0.7 * np.sqrt(power)))[..., None], 3, axis=2).astype(np.uint8)
    _show(middle, grid, grey)
    for mask, colour, style in ((truth, "black", "--"), (attempt.mask, "#D55E00", "-")):
        if mask.inside.any() and not mask.inside.all():
            middle.contour(grid.x, grid.y, mask.inside.T, levels=[0.5], colors=colour, linestyles=style, linewidths=1.3)
    middle.set_title("mask (red), truth (dashed)", fontsize=9)
    found, there = attempt.mask.inside, truth.inside
    colours = np.full((*found.shape, 3), 255, np.uint8)
    for where, colour in ((found & there, _HIT), (~found & there, _MISSED), (found & ~there, _FALSE)):
        colours[where] = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    _show(right, grid, colours)
    handles = [Patch(color=c, label=n) for c, n in ((_HIT, "found"), (_MISSED, "missed"), (_FALSE, "too much"))]
    right.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, handlelength=1.0)
    for axes in (middle, right):
        axes.set_yticklabels([])
        axes.set_ylabel("")
    figure.suptitle(title, fontsize=11, y=0.97)
    return figure


def _show(axes: Axes, grid: PixelGrid, rgb: np.ndarray) -> None:
    """(X, Y, 3) colours at their places [m]."""
    x, y = borders(grid.x, 1e-3), borders(grid.y, 1e-3)
    axes.imshow(rgb.transpose(1, 0, 2), origin="lower", extent=(x[0], x[-1], y[0], y[-1]), interpolation="nearest")
    axes.set(xlabel="x [m]", ylabel="y [m]")


def _draw_prompts(axes: Axes, picture: Picture, prompts) -> None:
    if prompts is None:
        return
    for positive, marker, colour in ((True, "o", "white"), (False, "X", "black")):
        i, j = prompts.points[prompts.positive == positive].T
        grid = picture.grid_xy
        across, up = (j, i) if grid is None else (grid.x[i], grid.y[j])
        axes.scatter(across, up, s=26, marker=marker, color=colour, edgecolors="grey", linewidths=0.8)


@styled
def plot_medians(trials: Sequence[MaskTrial], *, data: str) -> Figure:
    """Median F1 and recall of each segmenter and input, with 95 % intervals, and the paper's on real data.

    Parameters
    ----------
    trials : scores of each scene, segmenter, input and seed
    data : words on where the images come from, for the title
    """
    rows = evaluation.rows_of(trials)
    height = 1.25 + 0.3 * len(rows)  # [inches], of which 0.7 above and 0.55 below
    figure = Figure(figsize=(9.6, height))
    left, width = 0.2, 0.37
    for column, metric in enumerate(_SHOWN):
        place = (left + column * (width + 0.03), 0.55 / height, width, 1 - 1.25 / height)
        axes = figure.add_axes(place, facecolor="white")
        for sight, shift, colour in (("los", 0.16, "#0072B2"), ("nlos", -0.16, "#D55E00")):
            for number, row in enumerate(reversed(rows)):
                values = evaluation.by_scene(trials, row, sight, metric)
                if values:
                    median = 100 * float(np.median(np.array(list(values.values()))))
                    low, high = (100 * edge for edge in evaluation.interval_of_median(values))
                    axes.plot([low, high], [number + shift] * 2, color=colour, linewidth=1.6)
                    label = SIGHTS[sight] if number == 0 else None
                    axes.plot([median], [number + shift], "o", color=colour, markersize=5, label=label)
                paper = evaluation.PAPER_MASKS[sight][row.input][metric]
                label = f"paper, real data, {SIGHTS[sight]}" if number == 0 else None
                axes.plot([paper], [number + shift], "|", color=colour, markersize=9, alpha=0.6, label=label)
        axes.set_yticks(range(len(rows)), [str(row) for row in reversed(rows)] if column == 0 else [""] * len(rows))
        axes.set(xlim=(0, 100), ylim=(-0.6, len(rows) - 0.4), xlabel=evaluation.METRICS[metric].column)
        axes.grid(axis="x", color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
        if column == 0:
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    figure.suptitle(data, fontsize=10, y=1 - 0.08 / height)
    return figure
