"""Where the grating lobes of an aperture fall, and how strong they are: the point spread, where the geometry says so.

Neighbouring positions, s apart, see a reflector q and a point x alike when their round-trip phases change alike
(primer 7):

    sin t(x) = sin t(q) + m lambda / (2 s),  m = +-1, +-2, ...

Each position has such a direction of its own. Along it, bandwidth keeps the range r, and curvature keeps cos^2 t / r:
the lobe lies between the two. So the point spread is computed on a lattice of these directions and ranges. It shows
what focuses and what smears, and holds what receivers, or unequal steps, take away.
"""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Radar
from millisight.imaging._exact import image_at

_STARTS, _RANGES = 50, 10  # of the lattice: positions, and ranges from each
_SLACK = 0.08  # of the range, beyond what bandwidth and curvature keep
_FINER = 9  # points a side of the lattice around the strongest
_ORDERS = 3  # m, at most
_STEEPEST = 0.99  # sine


class Line(NamedTuple):
    """The positions along one direction of an aperture.

    Attributes
    ----------
    direction : (3,) unit vector of the step
    step : between neighbouring positions [m]
    tx, rx : (P, T, 3), (P, R, 3) antennas whose point spread has the lobes of this step [m]
    """

    direction: np.ndarray
    step: float
    tx: np.ndarray
    rx: np.ndarray


def lobe(
    line: Line, radar: Radar, reflector: np.ndarray, box: np.ndarray, side: int
) -> tuple[np.ndarray, float] | None:
    """The strongest grating lobe of a reflector (3,) on one side (1 or -1) within a box (2, 3).

    Returns
    -------
    its place (3,) and its magnitude over the reflector's own; None: no position has one there
    """
    frequencies = _frequencies(radar, float(np.linalg.norm(np.ptp(box, axis=0))))
    ways = [np.linalg.norm(reflector - antennas, axis=-1) for antennas in (line.tx, line.rx)]
    paths = ways[0][:, :, None] + ways[1][:, None]
    frames = np.exp(-2j * np.pi / SPEED_OF_LIGHT * paths[..., None] * frequencies)

    def strongest(points: np.ndarray) -> tuple[np.ndarray, float]:
        values = np.abs(image_at(frames, line.tx, line.rx, frequencies, points))
        return points[np.argmax(values)], float(values.max())

    best = None
    for order in range(1, _ORDERS + 1):
        shift = side * order * SPEED_OF_LIGHT / frequencies.mean() / (2 * line.step)
        points, cell = _lattice(line, reflector, shift, box)
        if not len(points):
            continue
        found = strongest(points)
        for _ in range(2):
            ends = np.linspace(-1, 1, _FINER)
            near = found[0] + (ends[:, None, None] * cell[0] + ends[:, None] * cell[1]).reshape(-1, 3)
            found = max(found, strongest(near[_within(near, box)]), key=lambda one: one[1])
            cell = cell * 2 / _FINER
        best = found if best is None or found[1] > best[1] else best
    return best


def _lattice(line: Line, reflector: np.ndarray, shift: float, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) places in the box where a lobe may be, and (2, 3) about their steps, along the direction and in depth."""
    middles = (line.tx.mean(axis=1) + line.rx.mean(axis=1)) / 2
    below = reflector - middles.mean(axis=0)
    below = below - (below @ line.direction) * line.direction
    height = max(float(np.linalg.norm(below)), 1e-12)
    normal = below / height
    along = middles @ line.direction
    starts = np.linspace(along.min(), along.max(), _STARTS)
    offset = reflector @ line.direction - starts
    ranges = np.hypot(offset, height)
    seen = offset / ranges
    towards = seen + shift
    steep = np.abs(towards) > _STEEPEST
    starts, ranges, seen, towards = (values[~steep] for values in (starts, ranges, seen, towards))
    kept = (1 - towards**2) / np.maximum(1 - seen**2, 1e-12)  # of the range, by curvature
    low, high = np.minimum(kept, 1) - _SLACK, np.maximum(kept, 1) + _SLACK
    lengths = ranges * (low + (high - low) * np.linspace(0, 1, _RANGES)[:, None])
    moved = (starts + lengths * towards).reshape(-1, 1) - reflector @ line.direction
    depths = (lengths * np.sqrt(1 - towards**2)).reshape(-1, 1) - height
    points = reflector + moved * line.direction + depths * normal
    widths = np.ptp(along) / _STARTS, float((ranges * (high - low)).mean()) / _RANGES if len(ranges) else 0.0
    return points[_within(points, box)], np.outer(widths, (1, 1, 1)) * np.stack([line.direction, normal])


def _within(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    return np.all((points >= box[0] - 1e-9) & (points <= box[1] + 1e-9), axis=1)


def _frequencies(radar: Radar, size: float) -> np.ndarray:
    """So few frequencies over the band that paths which differ by up to twice `size` [m] are told apart."""
    waveform = radar.waveform
    few = int(np.ceil(4 * size * waveform.bandwidth / SPEED_OF_LIGHT)) + 4
    if few >= waveform.samples_per_chirp:
        return waveform.frequencies
    return waveform.center_frequency + waveform.bandwidth * ((np.arange(few) + 0.5) / few - 0.5)
