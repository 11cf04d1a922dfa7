"""Examples for the segmenter, from scenes: mixed and disturbed by `augmentation`, cut somewhere, turned, prompted.

Some forget a band or the other. All of it is drawn from the generator that is passed in.
"""

from typing import NamedTuple

import numpy as np

from millisight.perception import augmentation, wave_features
from millisight.perception.training_scenes import SceneParts
from millisight.perception.wave_features import CHANNELS, SLICES, SPACING

SIDE = 64
"""Pixels of an example along x and y."""

_ONE_BAND, _OTHER_ALONE = 0.35, 0.12  # shares of examples: 77 GHz without 24, 24 without 77
_PROMPTED = 0.35
_POINT_SHARE = 0.0125  # of pixels, prompts by power: as published of pixels two and a half times as many
_OTHER = CHANNELS.index("other")


class Example(NamedTuple):
    """One input of the network, and what it should find.

    Attributes
    ----------
    channels : (C, SIDE, SIDE) float32, as `wave_features.CHANNELS`
    inside : (SIDE, SIDE) float32, share of each pixel over which the object lies
    weight : (SIDE, SIDE) float32, 1 where there is an image, else 0
    """

    channels: np.ndarray
    inside: np.ndarray
    weight: np.ndarray


def example_of(scene: SceneParts, rng: np.random.Generator) -> Example:
    """An example of a scene, drawn from `rng`."""
    alone = rng.random() < _OTHER_ALONE
    gains = augmentation.drawn_gains(rng)
    first = augmentation.mixed(scene, "24_ghz" if alone else "77_ghz", gains, rng)
    second = None
    if not alone and rng.random() >= _ONE_BAND:
        second = augmentation.mixed(scene, "24_ghz", augmentation.other_gains(gains, rng), rng)
    scale = rng.uniform(0.85, 1.2)
    along_x, along_y = _window(scene.x, scale, rng), _window(scene.y, scale, rng)
    first = first[:, :, _depths(first.shape[2], rng)]
    power = wave_features.resampled_power(first, along_x, along_y)
    other = None if second is None else wave_features.resampled_power(second, along_x, along_y)
    inside = along_x @ scene.inside.astype(np.float32) @ along_y.T
    power, inside = augmentation.turned(power, way := int(rng.integers(8))), augmentation.turned(inside, way)
    other = None if other is None else augmentation.turned(other, way)
    channels = wave_features.stacked(power, other, _prompts(power, inside > 0.5, rng))
    channels[: 1 + SLICES] = augmentation.distorted(channels[: 1 + SLICES], rng)
    if other is not None:
        channels[_OTHER] = augmentation.distorted(channels[_OTHER][None], rng)[0]
    return _placed(channels, inside, rng)


def _window(known: np.ndarray, scale: float, rng: np.random.Generator) -> np.ndarray:
    """(w, k) weights onto the network's pixels, of a part of the image, its coordinates scaled."""
    axis = wave_features.canvas_axis((known - known[0]) * scale)
    low, high = (int(rng.integers(0, 4)) if rng.random() < 0.4 else 0 for _ in range(2))
    axis = axis[low : len(axis) - high] + rng.uniform(-0.5, 0.5) * SPACING
    return wave_features.resampling((known - known[0]) * scale, axis)[:SIDE]


def _depths(count: int, rng: np.random.Generator) -> slice:
    """Of an image's voxels along z, those that are left."""
    low, high = rng.integers(0, 2, 2) if count > 5 else (0, 0)
    return slice(int(low), count - int(high))


def _prompts(power: np.ndarray, inside: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positive and negative points (n, 2): most often none, else a user's clicks, which are right, or from power."""
    none = np.zeros((0, 2), int)
    if rng.random() > _PROMPTED:
        return none, none
    if rng.random() < 0.5:
        return _drawn(inside, int(rng.integers(0, 5)), rng), _drawn(~inside, int(rng.integers(0, 5)), rng)
    seen = np.sqrt(power).mean(axis=2)
    seen = seen / max(seen.max(), 1e-12)
    bright, dark = seen > 0.4, seen < rng.choice([0.02, 0.05])
    counts = [max(1, round(_POINT_SHARE * where.sum())) for where in (bright, dark)]
    return _drawn(bright, counts[0], rng), _drawn(dark, counts[1], rng)


def _drawn(where: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    candidates = np.argwhere(where)
    return candidates[rng.permutation(len(candidates))[:count]]


def _placed(channels: np.ndarray, inside: np.ndarray, rng: np.random.Generator) -> Example:
    """The example on pixels of `SIDE`, 0 where it has no image."""
    across, along = inside.shape
    a, b = (int(rng.integers(0, (SIDE - size) // 8 + 1)) * 8 if rng.random() < 0.3 else 0 for size in (across, along))
    held = np.zeros((len(channels), SIDE, SIDE), np.float32)
    held[:, a : a + across, b : b + along] = channels[:, :across, :along]
    truth, weight = np.zeros((SIDE, SIDE), np.float32), np.zeros((SIDE, SIDE), np.float32)
    truth[a : a + across, b : b + along] = inside
    weight[a : a + across, b : b + along] = 1
    return Example(held, truth, weight)
