"""Real time as a virtual world counts it."""

from time import monotonic, sleep


class RealTime:
    """The world's time [s], from 0 on, which passes by itself: a `Time` for emulators."""

    def __init__(self) -> None:
        self._began = monotonic()

    @property
    def now(self) -> float:
        return monotonic() - self._began

    def wait_until(self, time: float) -> None:
        """Sleep until `time` [s]."""
        left = time - self.now
        if left > 0:
            sleep(left)
