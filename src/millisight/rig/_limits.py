"""Where an arm may hold the radars, and how fast it may move them."""

import numpy as np

from millisight.core import checked_number, checked_numbers, put, record
from millisight.core.errors import InputError
from millisight.rig._protocols import ArmPose

FASTEST = 1.0
"""The largest speed that a rig file may ask for [m/s]."""
_ROUNDING = 1e-9  # [m]


@record
class Limits:
    """The workspace of an arm, and the speed of its moves.

    A move is a straight line, and the workspace a box: a line between two of its points stays inside.

    Attributes
    ----------
    lower, upper : corners of the box that the origin of the radar frame stays in, in the base frame [m]
    speed : [m/s]
    acceleration : [m/s²]
    settle : how long the arm stands before and after each row [s]
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    speed: float = 0.1
    acceleration: float = 0.5
    settle: float = 0.2

    def __post_init__(self) -> None:
        lower = checked_numbers(self.lower, name="lower", count=3, unit="m")
        upper = checked_numbers(self.upper, name="upper", count=3, unit="m")
        if not (np.subtract(upper, lower) >= 0).all():
            raise InputError(f"the workspace runs from {lower} to {upper} m; expected upper >= lower in x, y and z")
        speed = checked_number(self.speed, name="speed", unit="m/s", above=0)
        if speed > FASTEST:
            raise InputError(f"speed is {speed:g} m/s; expected {FASTEST:g} m/s at most")
        put(
            self,
            lower=lower,
            upper=upper,
            speed=speed,
            acceleration=checked_number(self.acceleration, name="acceleration", unit="m/s²", above=0),
            settle=checked_number(self.settle, name="settle", unit="s", minimum=0),
        )

    def check(self, pose: ArmPose, what: str) -> None:
        """Raise unless `pose` lies in the workspace.

        Raises
        ------
        InputError
        """
        low, high = np.array(self.lower), np.array(self.upper)
        outside = (pose.position < low - _ROUNDING) | (pose.position > high + _ROUNDING)
        if outside.any():
            axis = int(np.argmax(outside))
            raise InputError(
                f"{what} has {'xyz'[axis]} = {pose.position[axis]:.4f} m in the base frame; the workspace runs from "
                f"{low[axis]:.4f} to {high[axis]:.4f} m: change the scan, or limits if the arm is free to go there"
            )

    def duration(self, length: float) -> float:
        """How long a move of `length` [m] takes at most, from standing to standing [s]."""
        ramp = self.speed / self.acceleration
        if length < self.speed * ramp:
            return 2 * float(np.sqrt(length / self.acceleration))
        return length / self.speed + ramp
