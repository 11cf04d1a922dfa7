"""How closely positions must lie for what they look at (primer 7)."""

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Radar

_POSES = 400  # from which angles are taken
_LATTICE = (5, 5, 3)  # points of a box


def needed_step(
    radar: Radar, direction: np.ndarray, tx: np.ndarray, rx: np.ndarray, view: np.ndarray, reflectors: np.ndarray
) -> float:
    """The largest step along a direction without ghosts: lambda / (2 Delta) (primer 7) [m].

    Lambda is the shortest wavelength of the band. Delta is the largest difference of sin(theta) between a voxel and a
    reflector, as any position sees them, theta from the plane normal to the direction. For antennas in one place that
    see the whole view under theta_max on both sides, that is lambda / (4 sin(theta_max)).

    Parameters
    ----------
    radar : its band
    direction : (3,) unit vector
    tx, rx : (P, T, 3), (P, R, 3) antennas at all positions [m]
    view : (2, 3) box of the voxels [m]
    reflectors : (2, 3) box of the objects [m]
    """
    some = np.unique(np.linspace(0, len(tx) - 1, _POSES).round().astype(int))
    voxels, objects = (_sines(lattice(box, _LATTICE), tx[some], rx[some], direction) for box in (view, reflectors))
    above, below = voxels.max(axis=1) - objects.min(axis=1), objects.max(axis=1) - voxels.min(axis=1)
    spread = max(float(above.max()), float(below.max()), 1e-9)
    return float(SPEED_OF_LIGHT / radar.waveform.frequencies.max() / (2 * spread))


def _sines(points: np.ndarray, tx: np.ndarray, rx: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(P, V) sines; of antennas apart, half the change of the path length with the position."""
    total = np.zeros((len(tx), len(points)))
    for antennas in (tx.mean(axis=1), rx.mean(axis=1)):
        away = points - antennas[:, None]
        total += (away @ direction) / np.maximum(np.linalg.norm(away, axis=-1), 1e-12)
    return total / 2


def lattice(box: np.ndarray, counts: tuple[int, int, int]) -> np.ndarray:
    """(V, 3) points that fill a box (2, 3), so many along x, y and z, its corners among them."""
    lines = [np.linspace(low, high, count) for low, high, count in zip(*box, counts, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
