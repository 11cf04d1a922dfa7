"""What an object's roundness says of its class: a network sees magnitudes, and phases tell a can from a ball."""

from collections.abc import Mapping, Sequence

import numpy as np

from millisight.data import Mask, SarImage
from millisight.perception.segmentation import Round, find_round

ROUND_SHARES: Mapping[str, Mapping[str, float]] = {
    "ball": {"can": 0.03, "handle": 0.03, "box": 0.02, "sphere": 0.92, "other": 0.08},
    "cylinder": {"can": 0.59, "handle": 0.05, "box": 0.02, "sphere": 0.02, "other": 0.11},
}
"""How often most of an object is a ball, or a cylinder of at least 20 mm radius, by `find_round`.

Counted on simulated images of shapes drawn at random and of training objects, one of each kind added, by
`python benchmarks/round_classes.py`. Cups and clamps count as what is of no class.
"""

_MOST_OF_IT = 0.5  # of a mask, that the outline fills
_THICK = 0.02  # a cylinder's radius, below which it may be a rod or a handle [m]


def roundness_of(mask: np.ndarray, things: Sequence[Round]) -> str | None:
    """Whether most of a mask (A, B) is a "ball" or a thick "cylinder"; None: neither."""
    for thing in things:
        if (thing.inside & mask).sum() > _MOST_OF_IT * mask.sum():
            return thing.kind if thing.kind == "ball" or thing.radius >= _THICK else None
    return None


def roundness_odds(mask: Mask, image: SarImage, class_names: Sequence[str]) -> np.ndarray:
    """(C,) logarithms of how often each class is as round as the object in a mask; 0 where it is not round."""
    kind = roundness_of(mask.inside, find_round(mask, image))
    if kind is None:
        return np.zeros(len(class_names))
    shares = ROUND_SHARES[kind]
    return np.log([shares.get(name, shares["other"]) for name in class_names])
