"""How far off a coordinate may be: what lies beyond is damage, and float64 no longer holds its phase."""

import numpy as np

from millisight.core.errors import InputError

FARTHEST = 1e9
"""Coordinate, in a mesh file's unit or in metres: beyond it float64 resolves no micrometre."""


def check_reach(
    points: np.ndarray, name: str, *, advice: str = "correct or remove it", error: type[InputError] = InputError
) -> None:
    """Refuse coordinates so large that areas, volumes and phases would overflow or drown in rounding.

    Parameters
    ----------
    points : any shape, coordinates
    name : of what has them, for the message
    advice : what to do, for the message
    error : what to raise

    Raises
    ------
    InputError
    """
    # Not np.abs: a capture's positions may take most of the memory.
    farthest = max(float(points.max(initial=0)), -float(points.min(initial=0)))
    if farthest > FARTHEST:
        raise error(f"{name} has coordinates of {farthest:.3g}; expected under {FARTHEST:g}: {advice}")
