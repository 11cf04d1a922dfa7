"""Masks whose borders follow the image's edges, which are finer than a network's pixels."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.perception import SPACING

_LEVELS = np.arange(-25.0, -1.0)  # below the maximum, between which an edge is sought [dB]
_SMOOTH = 2.0  # levels over which the sharpness is averaged
_HALF = 6.0  # below the brightest pixel nearby, an edge that was blurred lies [dB]


class _Trust(NamedTuple):
    """How far a border follows the image.

    Attributes
    ----------
    edge, half : log-odds for each decibel above or below the edge, and below half the brightest amplitude nearby
    near : how far that may be [m]
    rise, fall : log-odds at most
    """

    edge: float
    half: float
    near: float
    rise: float
    fall: float


# Chosen on 12 objects in line of sight that may be looked at, on 24 without noise, in sight and hidden, and on a wrench
# in a carton; the second on ten of them and 30 flat or small ones, in sight and in cartons.
_ROUND, _FLAT = _Trust(0.5, 0.5, 0.005, 5.0, 5.0), _Trust(1.0, 2.0, 0.0075, 5.0, 9.0)
# Of something flat or thin: an edge as sharp as the radar makes it [dB/m], and how much of the mask shines, to a tenth
# of its highest power. A ball is a glint.
_SHARP, _SHINING, _SHINES = 1300.0, 0.31, 0.1
# Of something round and thick: less of the mask shines, and somewhere it is so wide [m]. Its sides are dark, and the
# image has edges on them that are not its outline. Chosen on 18 objects by the virtual rig, flat and turned at random.
_DARK, _THICK = 0.25, 0.055


def at_edges(
    masks: Sequence[np.ndarray],
    probability: np.ndarray,
    cuts: Sequence[float],
    level: np.ndarray,
    sides: Sequence[float],
) -> list[np.ndarray]:
    """Masks whose borders lie closer to where the image is sharpest around the first of them.

    The edge's level is that of the contour along which the image falls most steeply, in decibels a metre, times the
    F1 that the probabilities let expect of what lies within. A pixel's log-odds rise or fall with its level above or
    below it. They fall further where the level is less than half the brightest amplitude nearby: there a blurred edge
    ends. Both together are bounded, so that what the network is sure of stays. A border follows the image further where
    the edge is steep and much of the mask shines, as of flat and thin things: the sides of round ones are dark. It
    moves outwards by no more than the network's pixel.

    Masks that are wide somewhere, and of whose first one little shines, stay: a mug's or a ball's sides are dark.

    The mean gradient along each contour follows from two histograms over the pixels' levels, by the coarea formula: the
    sum of the gradient's square over that of the gradient.

    Parameters
    ----------
    masks : (A, B) bool each
    probability : (A, B) that the object lies over a pixel
    cuts : of each mask, the probability at which it begins
    level : (A, B) mean magnitude along z, sheets taken off
    sides : of a pixel, along both axes [m]

    Returns
    -------
    of each mask (A, B) bool; itself where the image has no edge, or is a single row, or of something round and thick
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter1d, maximum_filter

    first = masks[0]
    if min(first.shape) < 2 or not min(sides) or not first.any():
        return list(masks)
    shines = shining(first, level, _SHINES).sum() / first.sum()
    within = distance_transform_edt(np.pad(first, 1), sampling=sides)
    if shines < _DARK and 2 * within.max() > _THICK:
        return list(masks)
    db = np.maximum(20 * np.log10(np.maximum(level / max(float(level.max()), 1e-30), 1e-9)), _LEVELS[0] - 10)
    steep = np.hypot(*np.gradient(db, *sides))
    around = [mask.any() & (distance_transform_edt(~mask, sampling=sides) < SPACING) for mask in masks]
    near = around[0]

    def by_level(weights: np.ndarray) -> np.ndarray:
        return np.histogram(db[near], _LEVELS, weights=weights[near])[0]

    def above(weights: np.ndarray) -> np.ndarray:
        return by_level(weights)[::-1].cumsum()[::-1]

    length, squared = (gaussian_filter1d(by_level(steep**power), _SMOOTH) for power in (1, 2))
    sharpness = squared / np.maximum(length, 1e-9)
    expected = 2 * above(probability) / (above(np.ones_like(db)) + probability[near].sum())
    best = int(np.argmax(sharpness * expected))
    if sharpness[best] <= 0:
        return list(masks)
    flat = sharpness[best] >= _SHARP and shines >= _SHINING
    trust = _FLAT if flat else _ROUND
    nearby = maximum_filter(db, [2 * round(trust.near / side) + 1 for side in sides])
    told = trust.edge * (db - _LEVELS[best]) - trust.half * np.maximum(nearby - db - _HALF, 0)
    odds = np.log(np.maximum(probability, 1e-6) / np.maximum(1 - probability, 1e-6))
    odds = odds + np.clip(told, -trust.fall, trust.rise)
    return [(odds > np.log(cut / (1 - cut))) & there for cut, there in zip(cuts, around, strict=True)]


def shining(mask: np.ndarray, level: np.ndarray, share: float) -> np.ndarray:
    """(A, B) bool, where in a mask that is not empty the power reaches a share of its maximum there.

    level : (A, B) mean magnitude along z
    """
    return mask & (level**2 >= share * level[mask].max() ** 2)
