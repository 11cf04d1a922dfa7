"""Augmentation: images from the simulator's, as radars might have seen them; all of it drawn from one generator.

First comes physics, on the parts of a scene's complex image: weights of its own for the specular and the edge part (the
paper's augmentation: materials differ, and nobody knows by how much), what lies below, echoes, clutter, noise. Then, on
channels of levels, what changes a picture and not its object: turns, scale, shift, blur, uneven light, places that are
missing; and masks that err. `millisight.viz.plot_augmentations` draws each.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from millisight.perception.training._augmentation_kernels import sampled
from millisight.perception.training._scenes import SceneParts


def drawn_gains(rng: np.random.Generator) -> dict[str, float]:
    """Drawn gains of the parts, relative to the object's maximum: the paper's weights, and that of the plate."""
    return {
        "specular": rng.uniform(0.2, 1),
        "edge": rng.uniform(0, 0.6),
        "plate": amplitude(rng, -35, 4) if rng.random() < 0.7 else 0.0,
    }


def other_gains(gains: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """The same at another wavelength."""
    return {part: gain * amplitude(rng, -8, 8) for part, gain in gains.items()}


def amplitude(rng: np.random.Generator, lowest_db: float, highest_db: float) -> float:
    """A factor, drawn evenly in decibels."""
    return 10 ** (rng.uniform(lowest_db, highest_db) / 20)


def object_image(scene: SceneParts, band: str, gains: Mapping[str, float]) -> np.ndarray:
    """(X, Y, Z) complex image of the object alone, its parts by the gains "specular" and "edge"; 1 at its maximum."""
    specular, edge, _ = scene.images[band]
    strength = scene.scales[band][:2] / max(scene.scales[band][:2].max(), 1e-30)
    target = gains["specular"] * strength[0] * specular + gains["edge"] * strength[1] * edge
    peak = abs(target).max()
    return target / (peak if peak > 0 else 1)


def with_noise(image: np.ndarray, noise: np.ndarray, share: float) -> np.ndarray:
    """The image (X, Y, Z) with noise (2, X, Y, Z), of variance 1, times this share of the image's maximum."""
    return image + np.float32(abs(image).max() * share) * (noise[0] + 1j * noise[1])


def echo(image: np.ndarray, rng: np.random.Generator, *, highest_db: float, sideways: int) -> np.ndarray:
    """A weaker copy further down, and a little beside."""
    steps = (*rng.integers(-sideways, sideways + 1, 2), -int(rng.integers(1, 4)))
    moved = np.zeros_like(image)
    to, fro = (tuple(slice(max(s * k, 0), size + min(s * k, 0)) for k, size in zip(steps, image.shape, strict=True))
               for s in (1, -1))  # fmt: skip
    moved[to] = image[fro]
    return moved * (amplitude(rng, highest_db - 22, highest_db) * np.exp(2j * np.pi * rng.random()))


def clutter(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
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


def clouds(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(A, B) smooth field of mean 0 and variance 1, some pixels from cloud to cloud."""
    smooth = blurred_once(rng.standard_normal(shape).astype(np.float32), rng.uniform(0.7, 4))
    return (smooth - smooth.mean()) / max(smooth.std(), 1e-9)


def patches(shape: tuple[int, int], rng: np.random.Generator, *, highest_db: float) -> np.ndarray:
    """(A, B) float32 gains, bright and dim places some centimetres wide, of a standard deviation to `highest_db`.

    An object is of several materials, and of its faces some are turned away from the radar.
    """
    smooth = blurred_once(rng.standard_normal(shape), rng.uniform(3, 12))
    smooth = (smooth - smooth.mean()) / max(smooth.std(), 1e-9)
    return (10 ** (rng.uniform(0, highest_db) * smooth / 20)).astype(np.float32)


def blurred_once(values: np.ndarray, sigma: float) -> np.ndarray:
    """(A, B) blurred by `sigma` pixels."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, sigma))


def turned(values: np.ndarray, way: int) -> np.ndarray:
    """One of the eight ways to lay a square onto itself."""
    values = values[::-1] if way & 1 else values
    values = values[:, ::-1] if way & 2 else values
    return values.swapaxes(0, 1) if way & 4 else values


def distorted(levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, A, B) levels, of another contrast, unevenly lit, perhaps blurred."""
    from scipy.ndimage import gaussian_filter, zoom

    lit = levels > 0
    uneven = zoom(rng.standard_normal((3, 3)), [size / 3 for size in levels.shape[1:]], order=1)
    changed: Any = levels * rng.uniform(0.85, 1.15) + uneven * rng.uniform(0, 0.06) + rng.uniform(-0.05, 0.0)
    if rng.random() < 0.25:
        sigma = rng.uniform(0.3, 1.2)
        changed = gaussian_filter(changed, (0, sigma, sigma))
    return np.clip(changed * lit, 0, 1).astype(np.float32)


def moved(channels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Channels (C, S, S) turned by any angle, 0.85 to 1.15 times as large, shifted a little, perhaps mirrored."""
    angle, scale, shift = rng.uniform(0, 2 * np.pi), rng.uniform(0.85, 1.15), rng.uniform(-3, 3, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / scale
    if rng.random() < 0.5:
        turn[:, 0] *= -1
    middle = (np.array(channels.shape[1:]) - 1) / 2
    offset: Any = middle - turn @ (middle + shift)
    return sampled(np.ascontiguousarray(channels, np.float32), turn, offset)


def blurred(channels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Channels (C, S, S) out of focus; the paper's 0.1 to 4 pixels of 224 are 0.04 to 1.4 of 80."""
    from scipy.ndimage import gaussian_filter

    sigma = rng.uniform(0.04, 1.4)
    return gaussian_filter(channels, (0, sigma, sigma))


def erased(channels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Channels (C, S, S) without a rectangle somewhere on the object, a third as long as it at most."""
    places = np.argwhere(channels[0] > 0.5)
    if not len(places):
        return channels
    place, size = places[rng.integers(len(places))], np.ptp(places, axis=0) * rng.uniform(0.1, 0.33, 2)
    low, high = np.maximum(place - size / 2, 0).astype(int), np.ceil(place + size / 2).astype(int)
    channels = channels.copy()
    channels[:, low[0] : high[0] + 1, low[1] : high[1] + 1] = 0
    return channels


def erring_mask(inside: np.ndarray, power: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A mask (A, B) bool as a segmenter makes it of a true one.

    It is a little too large or too small, the lit part of a lid around the object, or no more than what shines; and
    always ragged.

    Parameters
    ----------
    inside : (A, B) bool, the truth, not empty
    power : (A, B) of the image seen from above
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    ragged: Any = gaussian_filter(rng.standard_normal(inside.shape), rng.uniform(1, 4))
    ragged *= rng.uniform(0, 1) / max(ragged.std(), 1e-9)
    kind = rng.choice(3, p=(0.6, 0.1, 0.3))
    drawn = _surroundings(inside, rng) if kind == 1 else inside
    away: Any = distance_transform_edt(~drawn)
    within: Any = distance_transform_edt(drawn)
    mask = away - within + 0.5 < rng.uniform(-1.5, 1.5) + ragged
    if kind == 2:
        shining = gaussian_filter(power, rng.uniform(0.5, 1.5))
        mask &= shining > shining[drawn].max() * 10 ** rng.uniform(-3, -0.8)
    # Around a pixel in a corner there may be nothing.
    return next(one for one in (mask, drawn, inside) if one.any())


def _surroundings(inside: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(A, B) bool: a rectangle with round corners about an object, as much of a lid as the aperture lights."""
    rows, columns = (np.arange(size)[:, None] for size in inside.shape)
    places = np.argwhere(inside)
    low, high = places.min(axis=0) - rng.uniform(-1, 6, 2), places.max(axis=0) + rng.uniform(-1, 6, 2)
    middle, half = (low + high) / 2, np.maximum(high - low, 2) / 2
    across, along = abs(rows - middle[0]) / half[0], abs(columns - middle[1]).T / half[1]
    return (across**6 + along**6 <= 1) | (inside & (across <= 1) & (along <= 1))


def seen_otherwise(channels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A classifier's channels (C, S, S) moved, perhaps blurred, unevenly lit, with noise, or with a part missing."""
    channels = moved(channels, rng)
    if rng.random() < 0.3:
        channels = blurred(channels, rng)
    if rng.random() < 0.6:
        channels[1:] = distorted(channels[1:], rng)
    if rng.random() < 0.25:
        spread = np.float32(rng.uniform(0, 0.1))
        channels[1:] += (channels[1:] > 0) * spread * rng.standard_normal(channels[1:].shape, np.float32)
    if rng.random() < 0.15:
        channels = erased(channels, rng)
    return np.clip(channels, 0, 1).astype(np.float32)
