"""The arm behind the emulators: a virtual one that is told speeds move by move, and may be stopped."""

from dataclasses import replace

import numpy as np

from millisight.rig import ArmPose
from millisight.rig.virtual import ArmSettings, Time, VirtualArm

_AT_ONCE = 1e-6  # [s]


class MovingArm(VirtualArm):
    """A `VirtualArm` as a controller moves it, one straight line after the other.

    Parameters
    ----------
    settings : path and encoder errors; speeds are those of the moves
    time : the world's, real or not
    rng : of the errors
    start : where it stands at first (3,), in the base frame [m]
    """

    def __init__(self, settings: ArmSettings, time: Time, rng: np.random.Generator, start: np.ndarray):
        quick = replace(settings, settle=_AT_ONCE)
        super().__init__(quick, time, rng)
        self._noise = settings.encoder_noise / np.sqrt(3)
        self._rng = rng
        here = ArmPose(position=start)
        self.sweep(here, here)

    @property
    def place(self) -> np.ndarray:
        """(3,) where it ought to be now, in the base frame [m]."""
        return self.planned_positions(np.array([self._time.now]))[0]

    def told(self, time: float) -> np.ndarray:
        """(3,) where its encoders say it is at a true time [s], in the base frame [m]."""
        return self.true_positions(np.array([time]))[0] + self._noise * self._rng.standard_normal(3)

    def move(self, target: np.ndarray, *, speed: float, acceleration: float) -> None:
        """Begin to move to `target` (3,) [m], with ramps as long as those of a constant acceleration."""
        self._settings = replace(self._settings, speed=speed, acceleration=acceleration * np.pi / 2)
        self.sweep(ArmPose(position=self.place), ArmPose(position=target))

    @property
    def moving(self) -> bool:
        """Whether it moves now."""
        return self._time.now < self._stands_at
