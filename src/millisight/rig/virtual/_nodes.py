"""Receivers whose views and amplitudes stand for those between them.

Receivers of one radar stand in a line some millimetres long. But for its phase, what a patch returns to them changes
smoothly along the line: it is computed for the two at the ends, and interpolated to the others. Phases are each
receiver's own.
"""

from typing import NamedTuple

import numpy as np

from millisight.data import AntennaArray

LONGEST = 0.04
"""Of a line of receivers, over the distance to the nearest surface. Frames are then good to 0.2 %, and all but the
weakest channels to 0.1 dB and 1 degree."""

_OFF_LINE = 1e-3  # of a receiver, over the line's length


class Nodes(NamedTuple):
    """T transmitters, R receivers, and which M of the receivers stand for all.

    Attributes
    ----------
    transmitters : T
    receivers : (M,) int64, the numbers of those
    between : (R, 2) int64, between which two of the M a receiver lies
    shares : (R,) float32, of the second; 0 at the first
    """

    transmitters: int
    receivers: np.ndarray
    between: np.ndarray
    shares: np.ndarray

    @classmethod
    def of(cls, array: AntennaArray, distance: float) -> "Nodes":
        """The ends of a line that is short for `distance` [m], else every receiver by itself."""
        places = array.rx_positions
        away = np.linalg.norm(places[:, None] - places, axis=2)
        start, end = np.unravel_index(away.argmax(), away.shape)
        length, count = away[start, end], len(places)
        if count > 2 and 0 < length <= LONGEST * distance:
            along = (places - places[start]) @ (places[end] - places[start]) / length**2
            off = np.linalg.norm(places - places[start] - along[:, None] * (places[end] - places[start]), axis=1)
            if off.max() <= _OFF_LINE * length:
                nodes, between = np.array([start, end]), np.tile([0, 1], (count, 1))
                return cls(len(array.tx_positions), nodes, between, along.astype(np.float32))
        numbers = np.arange(count)
        return cls(len(array.tx_positions), numbers, np.column_stack([numbers, numbers]), np.zeros(count, np.float32))
