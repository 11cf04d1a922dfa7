"""The camera as a baseline: a photo to segment, and prompts from its depth (paper section 5.1).

What lies nearer than the background is taken for the object. Behind cardboard it is the cardboard, and the baseline
fails, as it should.
"""

import numpy as np

from millisight.capture.camera import CameraFrame
from millisight.errors import InputError
from millisight.perception.projection import Picture
from millisight.perception.prompts import Prompts, seed_or_generator
from millisight.records import checked_integer, checked_number, checked_record

COUNT = 20
"""Points of each kind that are drawn; the paper names no number."""


def photo(frame: CameraFrame) -> Picture:
    """The picture of a camera, to be segmented: its pixels are [row, column]."""
    return Picture(rgb=checked_record(frame, CameraFrame, name="frame").rgb)


def depth_prompts(
    frame: CameraFrame, *, farthest: float, count: int = COUNT, rng: int | np.random.Generator
) -> Prompts:
    """Prompts drawn at random from what is near, and from what is not.

    Parameters
    ----------
    frame : the picture with depth
    farthest : depth up to which it is the object; beyond, it is the background [m]
    count : points of each kind, or as many as there are
    rng : a seed, or a generator to draw from

    Returns
    -------
    Prompts
        Positives, then negatives, [row, column]; pixels without a depth are neither.

    Raises
    ------
    InputError
        Nothing is as near as that.
    """
    checked_record(frame, CameraFrame, name="frame")
    farthest = checked_number(farthest, name="farthest", unit="m", above=0)
    wanted = checked_integer(count, name="count")
    depth = np.nan_to_num(frame.depth * frame.depth_unit)
    near = (depth > 0) & (depth <= farthest)
    if not near.any():
        least = f"{depth[depth > 0].min():.3g} m is the nearest" if depth.any() else "the picture has no depth"
        raise InputError(f"nothing in the picture is nearer than {farthest:.3g} m: {least}; is the object in view?")
    generator = seed_or_generator(rng)
    drawn = [generator.permutation(np.argwhere(where))[:wanted] for where in (near, depth > farthest)]
    points = np.concatenate(drawn)
    return Prompts(points=points, positive=np.arange(len(points)) < len(drawn[0]))
