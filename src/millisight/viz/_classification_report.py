"""Figures of classifiers: accuracy, confusions, calibration, and mistakes."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight import evaluation
from millisight.evaluation import PREDICTED, SIGHT_GROUPS, ClassifierAnswer, Mistake, Variant, chosen
from millisight.perception import project
from millisight.viz._panels import borders, checked_colormap, styled

# Okabe and Ito's, told apart by everybody; markers beside, for print.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black")
_MARKERS = "osD^vP*X"
_SIGHT_COLOURS = dict(zip(SIGHT_GROUPS, ("#56B4E9", "#E69F00", "0.75"), strict=True))
_ACROSS = 4  # mistakes in a row


@styled
def plot_accuracy(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Figure:
    """Plot the accuracy of each variant in line of sight, out of it and overall, with both intervals, and the paper's.

    Parameters
    ----------
    answers : of each classifier to each image
    split : "disjoint" or "closed", see `ClassifierAnswer`
    data : words on where the images come from, for the title
    """
    variants = evaluation.variants_of(chosen(answers, split=split))
    height = 1.35 + 0.72 * len(variants)  # [inches], of which 0.8 above and 0.55 below
    figure = Figure(figsize=(9.6, height))
    axes = figure.add_axes((0.2, 0.55 / height, 0.77, 1 - 1.35 / height), facecolor="white")
    for number, variant in enumerate(variants):
        mine = chosen(answers, split=split, variant=variant)
        for sight, shift in zip(SIGHT_GROUPS, (-0.26, 0.0, 0.26), strict=True):
            _draw_bar(axes, number + shift, mine, sight, variant, label=number == 0)
    axes.set_yticks(range(len(variants)), [f"{one.name}\n{_kind(one)}" for one in variants])
    axes.set(xlim=(0, 100), ylim=(len(variants) - 0.45, -0.55), xlabel="accuracy [%]")
    axes.grid(axis="x", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.2, 1.0), ncols=7, columnspacing=1.2, handletextpad=0.4)
    figure.suptitle(f"{split}: {data}", fontsize=10, y=1 - 0.08 / height)
    return figure


def _draw_bar(
    axes: Axes, at: float, answers: list[ClassifierAnswer], sight: str, variant: Variant, *, label: bool
) -> None:
    found = evaluation.accuracy(chosen(answers, sight=sight, masks=PREDICTED))
    if found is None:
        return
    colour = _SIGHT_COLOURS[sight]

    def named(text: str) -> str | None:
        return text if label and (sight == "overall" or text in SIGHT_GROUPS.values()) else None

    axes.barh(at, 100 * found.share, height=0.22, color=colour, label=named(SIGHT_GROUPS[sight]))
    if found.by_object is not None:
        edges = [100 * edge for edge in found.by_object]
        axes.plot(edges, [at, at], "|-", color="0.2", linewidth=0.8, markersize=6, label=named("by objects"))
    edges = [100 * edge for edge in found.wilson]
    axes.plot(edges, [at, at], color="0.2", linewidth=2.6, solid_capstyle="butt", label=named("Wilson"))
    true = evaluation.accuracy(chosen(answers, sight=sight, masks=evaluation.TRUE))
    if true is not None:
        axes.plot([100 * true.share], [at], "D", mfc="white", mec="black", markersize=4.5, label=named("true masks"))
    if variant.parts in evaluation.PAPER and evaluation.of_papers_classes(answers):
        share, told = evaluation.PAPER[variant.parts][sight][0], named("paper, real data")
        axes.plot([share], [at], "|", color="#D55E00", markersize=9, markeredgewidth=2.4, label=told)


def _axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place [inches]."""
    wide, tall = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / tall, width / wide, height / tall), facecolor="white")


def _kind(variant: Variant) -> str:
    return ", ".join(text for text in (variant.network, evaluation.PARTS.get(variant.parts, variant.parts)) if text)


@styled
def plot_confusion(answers: Sequence[ClassifierAnswer], split: str, variant: Variant, *, data: str) -> Figure:
    """Plot confusion matrices in line of sight, out of it and overall: counts, shaded by shares of the class.

    Parameters
    ----------
    answers : of each classifier to each image
    split : "disjoint" or "closed", see `ClassifierAnswer`
    variant : the classifier whose answers are drawn
    data : words on where the images come from, for the title
    """
    mine = chosen(answers, split=split, variant=variant, masks=PREDICTED)
    whole = evaluation.confusion(mine)
    wide, tall = 0.52 * len(whole.answers), 0.52 * len(whole.truths)  # of a matrix [inches]
    size = (1.15 + 3 * (wide + 0.35), 1.65 + tall)
    figure = Figure(figsize=size)
    for number, sight in enumerate(SIGHT_GROUPS):
        axes = _axes(figure, 1.05 + number * (wide + 0.35), 0.8, wide, tall)
        counts = np.zeros(whole.counts.shape, int)
        some = chosen(mine, sight=sight)
        for one in some:
            counts[whole.truths.index(one.truth), whole.answers.index(one.label)] += 1
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (row, column), count in np.ndenumerate(counts):
            colour = "white" if shares[row, column] > 0.55 else "black" if count else "0.75"
            axes.text(column, row, str(count), ha="center", va="center", color=colour, fontsize=9)
        axes.set_xticks(range(len(whole.answers)), whole.answers, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(whole.truths)), whole.truths if number == 0 else [""] * len(whole.truths))
        axes.tick_params(length=0)
        axes.set_ylabel("truth" if number == 0 else "")
        axes.set_title(f"{SIGHT_GROUPS[sight]}: {sum(one.right for one in some)} of {len(some)}")
    figure.suptitle(f"{variant.name}, {split}\n{data}", fontsize=9, y=1 - 0.08 / size[1], va="top")
    return figure


@styled
def plot_reliability(answers: Sequence[ClassifierAnswer], split: str, *, data: str) -> Figure:
    """Plot accuracy over confidence of each variant, with Wilson intervals; below, the number of answers.

    Parameters
    ----------
    answers : of each classifier to each image
    split : "disjoint" or "closed", see `ClassifierAnswer`
    data : words on where the images come from, for the title
    """
    mine = chosen(answers, split=split, masks=PREDICTED)
    figure = Figure(figsize=(6.6, 6.2))
    axes = figure.add_axes((0.11, 0.36, 0.85, 0.44), facecolor="white")
    below = figure.add_axes((0.11, 0.09, 0.85, 0.2), facecolor="white")
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=0.8, linestyle="--", label="perfect calibration")
    variants = evaluation.variants_of(mine)
    for number, variant in enumerate(variants):
        bins = evaluation.reliability(chosen(mine, variant=variant))
        colour, marker = _COLOURS[number % len(_COLOURS)], _MARKERS[number % len(_MARKERS)]
        error = evaluation.expected_calibration_error(bins)
        if error is None:
            continue
        places = [one.confidence for one in bins]
        axes.plot(places, [one.right / one.images for one in bins], color=colour, marker=marker, markersize=5,
                  linewidth=1.1, label=f"{variant.name}: error {error:.3f}")  # fmt: skip
        for one in bins:
            low, high = evaluation.wilson_interval(one.right, one.images)
            axes.plot([one.confidence] * 2, [low, high], color=colour, linewidth=0.8, alpha=0.7)
        width = 0.09 / len(variants)
        middles = [(one.low + one.high) / 2 + (number - (len(variants) - 1) / 2) * width for one in bins]
        below.bar(middles, [one.images for one in bins], width=width, color=colour)
    axes.set(xlim=(0, 1), ylim=(0, 1.02), ylabel="share of right answers")
    below.set(xlim=(0, 1), xlabel="confidence", ylabel="images")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    for one in (axes, below):
        one.grid(color="0.92", linewidth=0.6)
        one.set_axisbelow(True)
    figure.suptitle(f"{split}: {data}", fontsize=9, y=0.975)
    return figure


@styled
def plot_mistakes(mistakes: Sequence[Mistake], *, title: str) -> Figure:
    """Plot each mistake as two pictures: the image with outlines of mask and truth, and the classified part.

    Parameters
    ----------
    mistakes : images that were classified wrongly
    title : written above
    """
    rows = -(-len(mistakes) // _ACROSS)
    wide, tall, above = 3.1, 1.95, 0.5  # of a mistake, and above all [inches]
    size = (0.2 + _ACROSS * wide, above + rows * tall + 0.1)
    figure = Figure(figsize=size)
    for number, one in enumerate(mistakes):
        left, top = 0.1 + (number % _ACROSS) * wide, size[1] - above - (number // _ACROSS) * tall
        for half, masked in enumerate((False, True)):
            _show(_axes(figure, left + half * 1.48, top - 1.8, 1.42, 1.42), one, masked=masked)
        figure.text((left + 0.03) / size[0], (top - 0.02) / size[1], _heading(one), fontsize=7.5, va="top")
    figure.text(0.12 / size[0], 1 - 0.1 / size[1], title, fontsize=10, va="top", fontweight="bold")
    return figure


def _heading(one: Mistake) -> str:
    answer = one.answer
    said = answer.label
    if answer.prediction is not None:
        held = "" if answer.prediction.sure else ", not sure"
        said = f"{said}, {100 * answer.prediction.confidence:.0f} %{held}"
    return (
        f"{answer.truth} → {said}\n{answer.object} ({answer.shape}), {answer.sight.upper()}, "
        f"{answer.scene.split('/')[1].replace('_', ' ')}°, IoU {answer.iou:.2f}"
    )


def _show(axes: Axes, one: Mistake, *, masked: bool) -> None:
    """The projection, in shades of its magnitude's root; `masked`: what is left of it in the mask."""
    power = project(one.image).power
    grid = one.image.grid.xy
    if power is None:
        return
    shade = np.sqrt(power)
    if masked:
        shade = np.where(one.mask.inside, shade, 0.0) if one.mask is not None else np.zeros_like(shade)
        shade = shade / max(float(shade.max()), 1e-12)
    x, y = borders(grid.x, 1e-3), borders(grid.y, 1e-3)
    axes.imshow(shade.T, origin="lower", extent=(x[0], x[-1], y[0], y[-1]), cmap=checked_colormap(), vmin=0, vmax=1)
    if not masked:
        for mask, colour, style in ((one.truth, "white", "--"), (one.mask, "#56B4E9", "-")):
            if mask is not None and mask.inside.any() and not mask.inside.all():
                axes.contour(grid.x, grid.y, mask.inside.T, [0.5], colors=colour, linestyles=style, linewidths=1.0)
    axes.set(xticks=[], yticks=[], anchor="N")
