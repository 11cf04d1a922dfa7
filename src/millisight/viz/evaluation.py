"""Pictures of how true simulated images are: the scores, their sensitivity, pairs side by side, and the page."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight.evaluation.simulator import Comparing
from millisight.evaluation.simulator_tables import DISTANCES, SIGHTS, THRESHOLDS, Pair
from millisight.evaluation.tables import Table
from millisight.files import make_folder
from millisight.imaging.image import SarImage
from millisight.viz.page import PageItem, write_page
from millisight.viz.style import Panel, borders, checked_colormap, save_figure, show_pixels, styled
from millisight.viz.style import Scale as Shades

_MEASURED, _SIMULATED = "#0072B2", "#D55E00"  # Okabe and Ito's: told apart by everybody
_PARTS = (("combined", "#009E73"), ("specular", "#0072B2"), ("edge", "#E69F00"))
_MOST_DOTS = 4000


class Shown(NamedTuple):
    """A pair to be looked at.

    Attributes
    ----------
    kind : "best" or "worst"
    pair : Pair
    measured, simulated : the images; the simulated one of the best weights
    there, moved : their points, the simulated ones where they were moved to [m]
    """

    kind: str
    pair: Pair
    measured: SarImage
    simulated: SarImage
    there: np.ndarray
    moved: np.ndarray


@styled
def plot_pair(shown: Shown) -> Figure:
    """Four panels: the two images from above, and the aligned points from above and from the front."""
    figure = Figure(figsize=(10.4, 3.3))
    panels = [figure.add_axes((0.055 + 0.248 * n, 0.15, 0.18, 0.64)) for n in range(4)]
    shades, colours = Shades.checked("linear", 30), checked_colormap("inferno")
    for axes, image, name in zip(panels, (shown.measured, shown.simulated), ("measured", "simulated"), strict=False):
        grid = image.grid
        panel = Panel.around(borders(grid.x, 1e-3), borders(grid.y, 1e-3))
        axes.set(xlim=panel.u, ylim=panel.v)
        show_pixels(axes, grid.x, grid.y, shades(image.project("z")), shades, colours)
        axes.set(xlabel="x [m]", ylabel="y [m]" if name == "measured" else "", title=f"{name}, mean along z")
    for axes, (i, j), name in zip(panels[2:], ((0, 1), (0, 2)), ("above", "the front"), strict=True):
        _dots(axes, shown, i, j)
        axes.set(xlabel="x [m]", ylabel=f"{'xyz'[j]} [m]", title=f"points, from {name}")
    panels[3].legend(loc="lower center", bbox_to_anchor=(0.5, 1.1), ncols=2, markerscale=4, handletextpad=0.1)
    figure.suptitle(heading(shown.pair), fontsize=11, y=0.98)
    return figure


def heading(pair: Pair) -> str:
    """What a picture of a pair shows, in a line."""
    score, (a1, a2) = pair.comparison.best.score, pair.comparison.best.weights
    return (
        f"{pair.object}, {SIGHTS[pair.sight]}: F {100 * score.f:.0f} %, precision {100 * score.precision:.0f} %, "
        f"recall {100 * score.recall:.0f} %, weights {a1:.2f} and {a2:.2f}"
    )


def _dots(axes: Axes, shown: Shown, i: int, j: int) -> None:
    clouds = ((shown.there, _MEASURED, "measured", 4.0), (shown.moved, _SIMULATED, "simulated, moved", 1.5))
    for points, colour, label, size in clouds:
        some = points[:: max(1, len(points) // _MOST_DOTS)]
        axes.scatter(some[:, i], some[:, j], s=size, color=colour, alpha=0.5, linewidths=0, label=label)
    axes.set_facecolor("white")
    axes.set_aspect("equal", adjustable="datalim")


@styled
def plot_sensitivity(pairs: Sequence[Pair], *, settings: Comparing, title: str) -> Figure:
    """Median F of the best combinations over tau_P and tau_F, a map for each sight; the table's own values framed."""
    there = [sight for sight in SIGHTS if any(pair.sight == sight for pair in pairs)]
    figure = Figure(figsize=(1.2 + 3.6 * len(there), 3.6))
    width = 0.78 / len(there)
    for number, sight in enumerate(there):
        axes = figure.add_axes((0.11 + number * (width + 0.05), 0.15, width - 0.02, 0.63))
        maps = [pair.sensitivity for pair in pairs if pair.sight == sight and pair.sensitivity is not None]
        median = 100 * np.median(maps, axis=0)
        axes.imshow(median, origin="lower", cmap="viridis", vmin=0, vmax=100, aspect="auto")
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
def plot_scores(pairs: Sequence[Pair]) -> Figure:
    """Every pair's F, sorted: the share of pairs with less, for the combination and for both parts alone."""
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
        axes.set(xlim=(0, 100), ylim=(0, 1), xlabel="F [%]", ylabel="share of pairs with less" if number == 0 else "")
        axes.set_title(SIGHTS[sight])
        axes.grid(color="0.92", linewidth=0.6)
        axes.legend(loc="upper left")
    return figure


def write_report(
    folder: str | os.PathLike[str],
    *,
    pairs: Sequence[Pair],
    shown: Sequence[Shown],
    tables: Sequence[Table],
    data: str,
    settings: Comparing,
) -> Path:
    """Write `index.html`: the tables, the scores, their sensitivity, the best and worst pairs; its pictures beside it.

    Raises
    ------
    FileError
        The folder cannot be written to.
    """
    folder = make_folder(folder)
    save_figure(plot_scores(pairs), folder / "scores.png", dpi=110)
    items = [
        PageItem(heading="Scores", picture="scores.png", caption="F of every pair, sorted. Farther right is better.")
    ]
    if all(pair.sensitivity is not None for pair in pairs):
        figure = plot_sensitivity(pairs, settings=settings, title="Median F [%] of the best combination")
        save_figure(figure, folder / "sensitivity.png", dpi=110)
        caption = (
            "How the score moves with the thresholds: weights as fitted at the framed ones, clouds aligned anew "
            "for each tau_P."
        )
        items.append(PageItem(heading="Sensitivity to tau_P and tau_F", picture="sensitivity.png", caption=caption))
    for number, one in enumerate(shown, 1):
        name = f"{one.kind}-{number:02d}.png"
        save_figure(plot_pair(one), folder / name, dpi=90)
        facts = {"notes": "; ".join(one.pair.comparison.notes)} if one.pair.comparison.notes else {}
        caption = f"One of the {one.kind} pairs. Each image over its own maximum."
        items.append(PageItem(heading=heading(one.pair), picture=name, caption=caption, facts=facts))
    title, introduction = "How true is the simulator?", f"Compared: {data}."
    return write_page(folder, title=title, introduction=introduction, items=items, tables=tables)
