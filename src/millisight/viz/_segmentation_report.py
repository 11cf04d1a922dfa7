"""Figures of segmenters: medians of each, and single masks beside the truth."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from millisight.data import Mask, Picture, PixelGrid
from millisight.evaluation import (
    METRICS,
    PAPER_MASKS,
    SIGHTS,
    MaskAttempt,
    MaskTrial,
    by_scene,
    interval_of_median,
    rows_of,
)
from millisight.viz._style import borders, styled

_HIT, _MISSED, _FALSE = "#009E73", "#E69F00", "#CC79A7"  # Okabe and Ito's: told apart by everybody
_SHOWN = ("f1", "recall")


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
    rows = rows_of(trials)
    height = 1.25 + 0.3 * len(rows)  # [inches], of which 0.7 above and 0.55 below
    figure = Figure(figsize=(9.6, height))
    left, width = 0.2, 0.37
    for column, metric in enumerate(_SHOWN):
        place = (left + column * (width + 0.03), 0.55 / height, width, 1 - 1.25 / height)
        axes = figure.add_axes(place, facecolor="white")
        for sight, shift, colour in (("los", 0.16, "#0072B2"), ("nlos", -0.16, "#D55E00")):
            for number, row in enumerate(reversed(rows)):
                values = by_scene(trials, row, sight, metric)
                if values:
                    median = 100 * float(np.median(np.array(list(values.values()))))
                    low, high = (100 * edge for edge in interval_of_median(values))
                    axes.plot([low, high], [number + shift] * 2, color=colour, linewidth=1.6)
                    label = SIGHTS[sight] if number == 0 else None
                    axes.plot([median], [number + shift], "o", color=colour, markersize=5, label=label)
                paper = PAPER_MASKS[sight][row.input][metric]
                label = f"paper, real data, {SIGHTS[sight]}" if number == 0 else None
                axes.plot([paper], [number + shift], "|", color=colour, markersize=9, alpha=0.6, label=label)
        axes.set_yticks(range(len(rows)), [str(row) for row in reversed(rows)] if column == 0 else [""] * len(rows))
        axes.set(xlim=(0, 100), ylim=(-0.6, len(rows) - 0.4), xlabel=METRICS[metric].column)
        axes.grid(axis="x", color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
        if column == 0:
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    figure.suptitle(data, fontsize=10, y=1 - 0.08 / height)
    return figure
