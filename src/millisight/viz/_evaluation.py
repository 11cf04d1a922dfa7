"""Figures of simulated against measured images: scores, their sensitivity to thresholds, and single pairs."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight.data import SarImage
from millisight.evaluation import DISTANCES, SIGHTS, THRESHOLDS, CloudSettings, ImagePair
from millisight.viz._style import ORDER, Panel, borders, checked_colormap, show_pixels, styled
from millisight.viz._style import Scale as Shades

_MEASURED, _SIMULATED = "#0072B2", "#D55E00"  # Okabe and Ito's: told apart by everybody
_PARTS = (("combined", "#009E73"), ("specular", "#0072B2"), ("edge", "#E69F00"))
_MOST_DOTS = 4000


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
        panel = Panel.around(borders(grid.x, 1e-3), borders(grid.y, 1e-3))
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
            axes.text(j, i, f"{value:.0f}", ha="center", va="center", color="white" if value < 60 else "black")
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
    """Every pair's F, sorted: the share of pairs with a lower score, for the combination and for both parts alone."""
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
