"""Examples from scenes: what the simulator does not have, and radars do, is added at random.

Each example mixes a scene's parts with weights of its own, adds echoes, ringing, noise and clutter, cuts it somewhere,
turns it, and forgets a band or another. All of it is drawn from the generator that is passed in.
"""

from typing import Any, NamedTuple

import numpy as np

from millisight.perception import wave_features
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
    gains = _gains(rng)
    first = _mixed(scene, "24_ghz" if alone else "77_ghz", gains, rng)
    second = None if alone or rng.random() < _ONE_BAND else _mixed(scene, "24_ghz", _other_gains(gains, rng), rng)
    scale = rng.uniform(0.85, 1.2)
    along_x, along_y = _window(scene.x, scale, rng), _window(scene.y, scale, rng)
    first = first[:, :, _depths(first.shape[2], rng)]
    power = wave_features.resampled_power(first, along_x, along_y)
    other = None if second is None else wave_features.resampled_power(second, along_x, along_y)
    inside = along_x @ scene.inside.astype(np.float32) @ along_y.T
    power, inside = _turned(power, way := int(rng.integers(8))), _turned(inside, way)
    other = None if other is None else _turned(other, way)
    channels = wave_features.stacked(power, other, _prompts(power, inside > 0.5, rng))
    channels[: 1 + SLICES] = _distorted(channels[: 1 + SLICES], rng)
    if other is not None:
        channels[_OTHER] = _distorted(channels[_OTHER][None], rng)[0]
    return _placed(channels, inside, rng)


def _gains(rng: np.random.Generator) -> dict[str, float]:
    """Of the parts, relative to the object's brightest place: the paper's weights, and how bright what is around is."""
    return {
        "specular": rng.uniform(0.2, 1),
        "edge": rng.uniform(0, 0.6),
        "plate": _amplitude(rng, -28, 8) if rng.random() < 0.85 else 0.0,
        "sheet": _amplitude(rng, -35, 8) if rng.random() < 0.75 else 0.0,
    }


def _other_gains(gains: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """The same at another wavelength."""
    return {part: gain * _amplitude(rng, -8, 8) for part, gain in gains.items()}


def _amplitude(rng: np.random.Generator, lowest_db: float, highest_db: float) -> float:
    return 10 ** (rng.uniform(lowest_db, highest_db) / 20)


def _mixed(scene: SceneParts, band: str, gains: dict[str, float], rng: np.random.Generator) -> np.ndarray:
    """(X, Y, Z) magnitude of a scene by one radar."""
    specular, edge, plate, sheet = scene.images[band]
    strength = scene.scales[band][:2] / scene.scales[band][:2].max()
    thing = gains["specular"] * strength[0] * specular + gains["edge"] * strength[1] * edge
    peak = abs(thing).max()
    thing = thing / (peak if peak > 0 else 1)
    total = thing + gains["plate"] * plate
    if rng.random() < 0.5:  # waves that go to and fro once more: between the object and what is around it
        total = total + _echo(total, rng, highest_db=-12, sideways=3)
    hidden = gains["sheet"] * sheet
    if gains["sheet"] and rng.random() < 0.7:  # and within the layers of what hides it, or between lid and floor
        hidden = hidden + _echo(hidden, rng, highest_db=0, sideways=0)
        total = total + _echo(total, rng, highest_db=-6, sideways=0)
    total = total + hidden
    if rng.random() < 0.5:
        total = total + _clutter(total.shape, rng) * (abs(total).max() * _amplitude(rng, -35, -6))
    peak = abs(total).max()
    noise = rng.standard_normal((2, *total.shape), dtype=np.float32)
    noisy = total + np.float32(peak * _amplitude(rng, -60, -24)) * (noise[0] + 1j * noise[1])
    if rng.random() < 0.3:  # speckle
        noisy = noisy * (1 + rng.uniform(0, 0.5) * noise[0])
    return abs(noisy).astype(np.float32)


def _echo(image: np.ndarray, rng: np.random.Generator, *, highest_db: float, sideways: int) -> np.ndarray:
    """A weaker copy further down, and a little beside."""
    steps = (*rng.integers(-sideways, sideways + 1, 2), -int(rng.integers(1, 4)))
    moved = np.zeros_like(image)
    to, fro = (tuple(slice(max(s * k, 0), size + min(s * k, 0)) for k, size in zip(steps, image.shape, strict=True))
               for s in (1, -1))  # fmt: skip
    moved[to] = image[fro]
    return moved * (_amplitude(rng, highest_db - 22, highest_db) * np.exp(2j * np.pi * rng.random()))


def _clutter(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """(X, Y, Z) smooth field of random phase, at some depth: of a rectangle, or of clouds."""
    from scipy.ndimage import gaussian_filter, gaussian_filter1d

    if rng.random() < 0.5:
        flat = np.zeros(shape[:2])
        ends = [np.sort(rng.integers(-size // 4, size + size // 4, 2)).clip(0, size) for size in shape[:2]]
        flat[ends[0][0] : ends[0][1], ends[1][0] : ends[1][1]] = 1
        flat = gaussian_filter(flat, rng.uniform(0.5, 3))
    else:
        flat = gaussian_filter(rng.standard_normal(shape[:2]), rng.uniform(3, 15))
        flat = np.maximum(flat, 0) / max(abs(flat).max(), 1e-9)
    depth = np.exp(-(((np.arange(shape[2]) - rng.uniform(-1, shape[2])) / rng.uniform(0.5, 2.5)) ** 2))
    grain = gaussian_filter1d(rng.standard_normal(shape[:2]), rng.uniform(0.5, 3), axis=0)
    return flat[..., None] * np.exp(1j * rng.uniform(0, 3) * grain / grain.std())[..., None] * depth


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


def _turned(values: np.ndarray, way: int) -> np.ndarray:
    """One of the eight ways to lay a square onto itself."""
    values = values[::-1] if way & 1 else values
    values = values[:, ::-1] if way & 2 else values
    return values.swapaxes(0, 1) if way & 4 else values


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


def _distorted(levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, A, B) levels, of another contrast, unevenly lit, perhaps blurred."""
    from scipy.ndimage import gaussian_filter, zoom

    lit = levels > 0
    uneven = zoom(rng.standard_normal((3, 3)), [size / 3 for size in levels.shape[1:]], order=1)
    changed: Any = levels * rng.uniform(0.85, 1.15) + uneven * rng.uniform(0, 0.06) + rng.uniform(-0.05, 0.0)
    if rng.random() < 0.25:
        sigma = rng.uniform(0.3, 1.2)
        changed = gaussian_filter(changed, (0, sigma, sigma))
    return np.clip(changed * lit, 0, 1).astype(np.float32)


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
