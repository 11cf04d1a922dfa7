"""Figures of training data: each augmentation alone, random shapes, and examples as a network gets them."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from millisight.core import checked_integer
from millisight.core.errors import InputError
from millisight.meshes import PUBLISHED_CLASSES, RANDOM_SHAPES, random_shape
from millisight.perception import projected_levels, training
from millisight.perception.classification import CLASSIFIER_CHANNELS, masked_channels
from millisight.perception.training import DEPTH, SceneParts
from millisight.viz._figures import draw_mesh
from millisight.viz._panels import checked_colormap, styled

_COLUMNS = 7
_PANEL = 1.25  # inches
_REACH = 0.15  # of a picture of a shape, from its middle [m]
_WEIGHTS = {"specular": 0.8, "edge": 0.3}  # where no others are shown
_SHARE_DB = -12.0  # of what is added, below the object's maximum


@styled
def plot_augmentations(scene: SceneParts, *, band: str = "77_ghz", seed: int = 0) -> Figure:
    """Each augmentation alone, on one object's image: levels of its mean magnitude along z.

    Rows: the paper's random weights; what is added to the complex image; changes of a classifier's channels; masks with
    errors (outlined).

    Parameters
    ----------
    scene : SceneParts
    band : "77_ghz" or "24_ghz"
    seed : random seed

    Raises
    ------
    InputError
        The scene has no such band.
    """
    if band not in scene.images:
        raise InputError(f"band is {band!r}; expected one of {list(scene.images)}")
    rng = np.random.default_rng(seed)
    rows = [_weighted(scene, band, rng), _added(scene, band, rng), _disturbed(scene, band, rng)]
    figure = Figure(figsize=(_PANEL * _COLUMNS, _PANEL * 1.22 * (len(rows) + 1)))
    axes = figure.subplots(len(rows) + 1, _COLUMNS)
    for places, panels in zip(axes, rows, strict=False):
        for place, (title, picture) in zip(places, panels.items(), strict=False):
            _show(place, picture, title)
    _show_masks(axes[-1], scene, band, rng)
    for place in axes.flat:
        place.set_axis_off()
    figure.tight_layout(pad=0.4)
    return figure


@styled
def plot_random_shapes(*, count: int = 10, seed: int = 0, household: bool = False) -> Figure:
    """Random shapes for training, seen from above: a class in each row, all on one scale.

    Parameters
    ----------
    count : of each class
    seed : random seed
    household : household things rather than plain shapes
    """
    count, rng = checked_integer(count, name="count"), np.random.default_rng(seed)
    classes = PUBLISHED_CLASSES if household else tuple(RANDOM_SHAPES)
    figure = Figure(figsize=(0.85 * count, 0.9 * len(classes)))
    axes = figure.subplots(len(classes), count, squeeze=False)
    for row, shape_class in zip(axes, classes, strict=True):
        for place in row:
            draw_mesh(place, random_shape(shape_class, rng, household=household), "z")
            place.set(xlim=(-_REACH, _REACH), ylim=(-_REACH, _REACH), aspect="equal")
            place.set_axis_off()
        row[0].text(-0.05, 0.5, shape_class, ha="right", va="center", rotation=90, transform=row[0].transAxes)
    figure.tight_layout(pad=0.2)
    return figure


@styled
def plot_examples(
    examples: np.ndarray, titles: Sequence[str], *, channels: Sequence[str] = CLASSIFIER_CHANNELS
) -> Figure:
    """Inputs of a classifier: an example in each row, a channel in each column.

    Parameters
    ----------
    examples : (N, C, S, S)
    titles : (N,) for the rows
    channels : those that are shown, by name

    Raises
    ------
    InputError
        Examples and titles differ in number, or a channel is unknown.
    """
    if len(examples) != len(titles) or not len(examples):
        raise InputError(
            f"{len(examples)} examples and {len(titles)} titles; expected a title for each, and one at least"
        )
    unknown = [name for name in channels if name not in CLASSIFIER_CHANNELS]
    if unknown:
        raise InputError(f"channels {unknown} are unknown; expected some of {list(CLASSIFIER_CHANNELS)}")
    figure = Figure(figsize=(_PANEL * 0.55 * len(channels) + 1, _PANEL * 0.6 * len(examples) + 0.3))
    axes = figure.subplots(len(examples), len(channels), squeeze=False)
    for number, (row, title, example) in enumerate(zip(axes, titles, examples, strict=True)):
        for place, name in zip(row, channels, strict=True):
            _show(place, example[CLASSIFIER_CHANNELS.index(name)], "" if number else name)
            place.set_axis_off()
        row[0].text(-0.08, 0.5, title, ha="right", va="center", fontsize=7, transform=row[0].transAxes)
    figure.tight_layout(pad=0.2)
    return figure


def _weighted(scene: SceneParts, band: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The simulator's two parts, and sums of them with drawn weights."""
    panels = {
        "specular": training.object_image(scene, band, {"specular": 1, "edge": 0}),
        "edge": training.object_image(scene, band, {"specular": 0, "edge": 1}),
    }
    for _ in range(_COLUMNS - len(panels)):
        gains = training.drawn_gains(rng)
        panels[f"{gains['specular']:.2f} s + {gains['edge']:.2f} e"] = training.object_image(scene, band, gains)
    return {title: _levels(image) for title, image in panels.items()}


def _added(scene: SceneParts, band: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """What is added to the object's image, each at one strength."""
    target, share = training.object_image(scene, band, _WEIGHTS), 10 ** (_SHARE_DB / 20)
    plate = scene.images[band][2]
    noise = rng.standard_normal((2, *target.shape), dtype=np.float32)
    panels = {
        "none": target,
        "below: plate" if plate.any() else "below: none": target + plate,
        "echo": target + training.echo(target, rng, highest_db=-3, sideways=3),
        "clutter": target + share * training.clutter(target.shape, rng),
        "noise": training.with_noise(target, noise, share / 2),
        "speckle": target * (1 + 0.5 * noise[0]),
    }
    return {title: _levels(image) for title, image in panels.items()}


def _disturbed(scene: SceneParts, band: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """What is done to a classifier's channels."""
    power, inside = _power_of(scene, band), scene.inside.astype(np.float32)
    channels = masked_channels(power, np.arange(power.shape[2]) * DEPTH, inside)
    steps: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
        "masked": lambda c, rng: c,
        "moved": training.moved,
        "moved again": training.moved,
        "blurred": training.blurred,
        "uneven light": training.distorted,
        "erased": training.erased,
        "several": training.seen_otherwise,
    }
    level = CLASSIFIER_CHANNELS.index("level")
    return {title: step(channels.copy(), rng)[level] for title, step in steps.items()}


def _show_masks(places: Sequence[Axes], scene: SceneParts, band: str, rng: np.random.Generator) -> None:
    power, truth = _power_of(scene, band), scene.inside
    seen = projected_levels(power)
    for index, place in enumerate(places):
        mask = truth if index == 0 else training.erring_mask(truth, power.max(axis=2), rng)
        _show(place, seen, "a mask with errors" if index else "true mask")
        place.contour(mask.T, levels=[0.5], colors="white", linewidths=1.2)


def _power_of(scene: SceneParts, band: str) -> np.ndarray:
    """(A, B, Z) power of the object alone."""
    return np.square(np.abs(training.object_image(scene, band, _WEIGHTS))).astype(np.float32)


def _levels(image: np.ndarray) -> np.ndarray:
    return projected_levels(np.square(np.abs(image)))


def _show(place: Axes, picture: np.ndarray, title: str) -> None:
    place.imshow(picture.T, origin="lower", cmap=checked_colormap(), vmin=0, vmax=1, interpolation="nearest")
    place.set_title(title, fontsize=7, pad=2)
