"""Ticks whose labels do not run together."""

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

_MOST, _PER_INCH = 8, 1.7
_LETTER, _GAP = 0.07, 0.1  # width of a letter of a label, and between two labels [inches]
_STEPS = (1, 2, 2.5, 5, 10)


def ticks_for(inches: float, *, sideways: bool) -> MaxNLocator:
    """Ticks at round numbers for an axis so many inches long; `sideways`: its labels stand beside each other."""
    most = int(np.clip(inches * _PER_INCH, 2, _MOST))
    return _Spread(inches, most) if sideways else MaxNLocator(nbins=most, steps=_STEPS)


class _Spread(MaxNLocator):
    """As MaxNLocator, with as many ticks as there is room for their labels beside each other."""

    def __init__(self, inches: float, most: int) -> None:
        super().__init__(nbins=most, steps=_STEPS)
        self._inches, self._most = inches, most

    def tick_values(self, vmin: float, vmax: float) -> Any:
        ticks = np.zeros(0)
        for count in range(self._most, 1, -1):
            self.set_params(nbins=count)
            ticks = np.asarray(super().tick_values(vmin, vmax))
            ticks = ticks[(ticks >= vmin) & (ticks <= vmax)]
            if len(ticks) < 2 or self._apart(ticks, vmax - vmin):
                return ticks
        return ticks[[0, -1]]  # the scale is told by two

    def _apart(self, ticks: np.ndarray, whole: float) -> bool:
        widest = max(_width(tick) for tick in ticks)
        return float(np.diff(ticks).min()) / whole * self._inches >= widest + _GAP


def _width(number: float) -> float:
    """Of the label of a number [inches]."""
    return _LETTER * len(f"{number:.6g}")
