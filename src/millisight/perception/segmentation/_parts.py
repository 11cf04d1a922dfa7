"""Connected parts of a mask."""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np


def parts_of(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Numbers of the parts of a mask (A, B), from 1 on and 0 outside, and how many; pixels touch at corners as well."""
    from scipy.ndimage import label

    return cast("tuple[np.ndarray, int]", label(mask, structure=np.ones((3, 3))))


def judged_apart(
    masks: Sequence[np.ndarray],
    further: Sequence[np.ndarray],
    kept: Callable[[Sequence[np.ndarray]], Sequence[np.ndarray]],
) -> list[np.ndarray]:
    """What `kept` leaves of masks that hold one another, where it judges a part of a mask as a whole.

    Two things that touch in a mask may be apart in a smaller one, and one of them then stays: of each mask this is what
    is left of it, and of all that it holds.

    Parameters
    ----------
    masks : (A, B) bool each
    further : masks that are asked as well, if something is left out
    kept : from masks to what is left of each
    """
    left = list(kept(masks))
    if all(np.array_equal(some, mask) for some, mask in zip(left, masks, strict=True)):
        return left
    every, rests = [*masks, *further], [*left, *kept(further)]
    return [
        np.any([rest for other, rest in zip(every, rests, strict=True) if not (other & ~mask).any()], axis=0)
        for mask in masks
    ]
