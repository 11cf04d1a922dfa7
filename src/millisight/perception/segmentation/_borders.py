"""Where masks end: by the image's edges, by the phases of round and flat things, or else by the probabilities."""

from collections.abc import Sequence

import numpy as np

from millisight.data import SarImage
from millisight.perception.segmentation._edges import at_edges
from millisight.perception.segmentation._flat import flat_things
from millisight.perception.segmentation._heights import pixel_sides
from millisight.perception.segmentation._parts import parts_of
from millisight.perception.segmentation._round import round_things, with_outlines

_AROUND = 0.005, 0.03  # a mask, what surrounds it [m]
_BRIGHTER = 2.0  # than that, what stands out
_SURE, _LIKELY = 0.8, 0.5  # of the highest probability, an object's core; probability, where nothing else tells
_BESIDE = 0.003  # a flat top, a mask may reach whatever shines there [m]
_TOP = 0.6  # of its part, that a flat top covers: in masks of empty scenes the tripod's plate covers up to 0.47


def with_borders(
    masks: Sequence[np.ndarray],
    probability: np.ndarray,
    cuts: Sequence[float],
    image: SarImage,
    *,
    covered: bool,
    heights: bool = True,
) -> tuple[list[np.ndarray], bool]:
    """Masks with the borders that an image tells, and whether its phases show that something is there.

    Borders follow the image's edges, see `at_edges`. What lies beyond a flat top, and is no brighter than what
    surrounds the first mask, is left out, and round things get their outlines. Where an object is no brighter than what
    is left of a lid, no edge is its own, and masks hold what is more probable than not.

    Parameters
    ----------
    masks : (A, B) bool each; the first is not empty
    probability : (A, B) that the object lies over a pixel
    cuts : of each mask, the probability at which it begins
    image : sheets taken off
    covered : whether there were any
    heights : whether the image's echoes tell heights; else what is flat or round is not looked for
    """
    from scipy.ndimage import distance_transform_edt

    wide, level, sides = masks[0], image.magnitude.mean(axis=2), pixel_sides(image)
    tops = flat_things(wide, image) if heights else []
    things = round_things(wide, image, covered=covered) if heights else []
    around = brightness_around(np.asarray(distance_transform_edt(~wide, sampling=sides)), level)
    if covered and not (tops or things or _stands_out(wide, probability, level, around)):
        return _more_probable_than_not(masks, probability), False
    bordered = at_edges(masks, probability, cuts, level, sides)
    bordered = _without_dim_borders(bordered, [top.inside for top in tops], level, around, sides)
    bordered = [with_outlines(mask, things) for mask in bordered]
    # A small top may be most of a mask that fits it.
    small = flat_things(bordered[0], image) if heights else []
    shaped = bool(tops or things) or any(top.share >= _TOP for top in small)
    return bordered, shaped


def brightness_around(away: np.ndarray, level: np.ndarray) -> float:
    """The median level of what surrounds a mask, by leftovers of a lid most of the time; 0 if nothing does.

    away : (A, B) from the mask [m]
    """
    around = (away > _AROUND[0]) & (away <= _AROUND[1])
    return float(np.median(level[around])) if around.any() else 0.0


def _stands_out(wide: np.ndarray, probability: np.ndarray, level: np.ndarray, around: float) -> bool:
    """Whether what is most probable in a mask is twice as bright as what surrounds it."""
    core = wide & (probability >= _SURE * probability[wide].max())
    return bool(np.median(level[core]) >= _BRIGHTER * around)


def _more_probable_than_not(masks: Sequence[np.ndarray], probability: np.ndarray) -> list[np.ndarray]:
    """Masks of probabilities of at least 0.5, or nearly the highest."""
    highest = float(probability[masks[0]].max())
    return [mask & (probability > min(_LIKELY, 0.9 * highest)) for mask in masks]


def _without_dim_borders(
    masks: Sequence[np.ndarray], tops: Sequence[np.ndarray], level: np.ndarray, around: float, sides: Sequence[float]
) -> list[np.ndarray]:
    """Masks without what lies beyond the flat tops (A, B) of their parts, and is not twice as bright as around them."""
    from scipy.ndimage import distance_transform_edt

    dim, kept = level <= _BRIGHTER * around, list(masks)
    for top in tops:
        beyond = dim & (distance_transform_edt(~top, sampling=sides) > _BESIDE)
        for i, mask in enumerate(kept):
            parts, count = parts_of(mask)
            its = np.bincount(parts[top], minlength=count + 1) > 0
            its[0] = False
            kept[i] = mask & ~(its[parts] & beyond)
    return kept
