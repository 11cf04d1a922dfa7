"""What an object's form says of its class: a network sees magnitudes, and phases tell a can from a ball or a box."""

from collections.abc import Mapping, Sequence

import numpy as np

from millisight.data import Mask, SarImage
from millisight.perception.segmentation import Flat, Round, find_flat, find_round

FORM_SHARES: Mapping[str, Mapping[str, float]] = {
    "ball": {"can": 0.03, "handle": 0.03, "box": 0.02, "sphere": 0.92, "other": 0.08},
    "cylinder": {"can": 0.46, "handle": 0.03, "box": 0.02, "sphere": 0.02, "other": 0.11},
    "rectangle": {"can": 0.05, "handle": 0.08, "box": 0.54, "sphere": 0.02, "other": 0.05},
    "ellipse": {"can": 0.24, "handle": 0.03, "box": 0.07, "sphere": 0.02, "cup": 0.24, "other": 0.08},
}
"""How often most of an object is a ball, or a cylinder of 20 mm radius at least, by `find_round`, or a flat rectangle
or ellipse, by `find_flat`.

Counted on simulated images of shapes drawn at random and of training objects, one of each answer added, by
`python benchmarks/form_classes.py`. Cups, of which two are among them, and clamps count as what is of no class, but a
cup's bottom is as flat as a can's.
"""

_MOST_OF_IT = 0.5  # of a mask, that the outline fills
_THICK = 0.02  # a cylinder's radius, below which it may be a rod or a handle [m]


def form_of(mask: np.ndarray, things: Sequence[Round | Flat]) -> str | None:
    """Whether most of a mask (A, B) is a "ball", a thick "cylinder", or a flat "rectangle" or "ellipse"; None: none."""
    for thing in things:
        if (thing.inside & mask).sum() > _MOST_OF_IT * mask.sum():
            thin = isinstance(thing, Round) and thing.kind == "cylinder" and thing.radius < _THICK
            return None if thin else thing.kind
    return None


def form_odds(mask: Mask, image: SarImage, class_names: Sequence[str]) -> np.ndarray:
    """(C,) logarithms of how often each class has the form of the object in a mask; 0 where it has none of them."""
    shares = FORM_SHARES.get(form_of(mask.inside, [*find_round(mask, image), *find_flat(mask, image)]) or "")
    return np.log([shares.get(name, shares["other"]) for name in class_names]) if shares else np.zeros(len(class_names))
