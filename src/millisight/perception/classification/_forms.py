"""What an object's form says of its class: a network sees magnitudes, and phases tell a can from a ball or a box."""

from collections.abc import Mapping, Sequence

import numpy as np

from millisight.data import Mask, SarImage
from millisight.perception.segmentation import Flat, Round, find_flat, find_round

FORM_SHARES: Mapping[str, Mapping[str, float]] = {
    "ball": {"can": 0.02, "handle": 0.02, "box": 0.02, "sphere": 0.88, "cup": 0.02, "clamp": 0.02, "other": 0.05},
    "cylinder": {"can": 0.48, "handle": 0.02, "box": 0.02, "sphere": 0.016, "cup": 0.19, "clamp": 0.02, "other": 0.01},
    "rectangle": {"can": 0.04, "handle": 0.08, "box": 0.45, "sphere": 0.016, "cup": 0.02, "clamp": 0.02, "other": 0.08},
    "ellipse": {"can": 0.19, "handle": 0.02, "box": 0.05, "sphere": 0.016, "cup": 0.02, "clamp": 0.02, "other": 0.12},
    "vessel": {"can": 0.02, "handle": 0.02, "box": 0.02, "sphere": 0.016, "cup": 0.54, "clamp": 0.02, "other": 0.01},
}
"""How often most of an object is a ball, or a cylinder, either thick or short, by `find_round`; or a flat rectangle
or ellipse, by `find_flat`; or a "vessel": a flat ellipse below a rim (`Flat.rim`).

Counted on simulated images of shapes drawn at random and of training objects, one of each answer added, by
`python benchmarks/form_classes.py`. There rims do not echo, and the floors of cups, which all stand open or lie, count
as vessels. A class that is not named counts like what is of no class.
"""

_MOST_OF_IT = 0.5  # of a mask, that the outline fills
_FLOOR = 0.25  # of a mask, that the floor of a vessel fills, whose rim and handle are marked, too
_THICK = 0.02  # a cylinder's radius, below which a long one may be a rod or a handle [m]
_LONG = 3.0  # times as long as thick: screwdrivers' handles are 3.2 to 9 times, batteries and small tins 1.5 to 2.7


def form_of(mask: np.ndarray, things: Sequence[Round | Flat]) -> str | None:
    """The form of most of a mask (A, B), of what `find_round` and `find_flat` see in it; None: none of `FORM_SHARES`.

    "ball", a "cylinder" that is no rod, a flat "rectangle" or "ellipse", or "vessel".
    """
    for thing in things:
        filled = (thing.inside & mask).sum() / max(mask.sum(), 1)
        if isinstance(thing, Flat) and thing.kind == "ellipse" and thing.rim is not None and filled > _FLOOR:
            return "vessel"
        if filled > _MOST_OF_IT:
            rod = isinstance(thing, Round) and thing.kind == "cylinder" and thing.radius < _THICK
            return None if rod and thing.length > _LONG * 2 * thing.radius else thing.kind
    return None


def form_odds(mask: Mask, image: SarImage, class_names: Sequence[str]) -> np.ndarray:
    """(C,) logarithms of how often each class has the form of the object in a mask; 0 where it has none of them."""
    things = [*find_round(mask, image), *find_flat(mask, image)]
    shares = FORM_SHARES.get(form_of(mask.inside, things) or "")
    return np.log([shares.get(name, shares["other"]) for name in class_names]) if shares else np.zeros(len(class_names))
