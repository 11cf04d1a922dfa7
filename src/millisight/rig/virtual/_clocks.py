"""Time in the virtual world: one true time that waits jump over, and the clocks by which devices tell it."""

import numpy as np

from millisight.core import checked_number, put, record

EPOCH = 1_700_000_000.0
"""What a right clock shows when a virtual world begins [s]: Unix time, as the published time stamps are."""


class WorldTime:
    """The world's true time [s], from 0 on. Waiting costs nothing: it moves `now`."""

    def __init__(self) -> None:
        self.now = 0.0

    def wait_until(self, time: float) -> None:
        """Let time pass until `time` [s]; a moment in the past is here already."""
        self.now = max(self.now, float(time))


@record
class DeviceClock:
    """A clock that is wrong: it shows EPOCH + offset + (1 + drift) t at the true time t."""

    offset: float = 0.0  # what it is ahead by when the world begins [s]
    drift: float = 0.0  # what it gains [s/s]; 50e-6 is 50 ppm

    def __post_init__(self) -> None:
        put(
            self,
            offset=checked_number(self.offset, name="clock_offset", unit="s"),
            drift=checked_number(self.drift, name="clock_drift", unit="s/s", above=-0.5),
        )

    def reading(self, times: np.ndarray) -> np.ndarray:
        """What it shows [s] at the true times (n,) [s]."""
        return EPOCH + self.offset + (1 + self.drift) * np.asarray(times)

    def true_times(self, readings: np.ndarray) -> np.ndarray:
        """The true times [s] at which it shows the readings (n,) [s]."""
        return (np.asarray(readings) - EPOCH - self.offset) / (1 + self.drift)
