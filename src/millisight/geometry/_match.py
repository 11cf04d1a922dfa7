"""How well simulated range profiles of a mesh in a pose match measured frames, and the match's slope by the pose."""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT


class Match(NamedTuple):
    """The match of simulated with measured frames, and its derivatives.

    Attributes
    ----------
    value : mean over channels of |<s, d>|² / (|s|² |d|²), 0 to 1
    gradient : (6,) by a shift along x, y and z [1/m], and a turn about x, y and z through the stated point [1/rad]
    """

    value: float
    gradient: np.ndarray


def range_match(
    points: np.ndarray,
    amplitudes: np.ndarray,
    about: np.ndarray,
    tx: np.ndarray,
    rx: np.ndarray,
    frequencies: np.ndarray,
    frames: np.ndarray,
    path_offset: float = 0.0,
) -> Match:
    """Compare frames with the sum of the phasors of points, coherently over the band, channel by channel (primer 27).

    Parameters
    ----------
    points : (V, 3) what shines of the mesh, in its pose [m]; V may be 0
    amplitudes : (C, V) of each for each channel, 0 where it is hidden or does not shine
    about : (3,) the point that turns are about [m]
    tx, rx : (C, 3) antennas of each channel [m]
    frequencies : (N,) [Hz]
    frames : (C, N) complex, measured
    path_offset : added to each path [m]
    """
    to_tx, to_rx = points - tx[:, None], points - rx[:, None]
    far_tx, far_rx = np.linalg.norm(to_tx, axis=2), np.linalg.norm(to_rx, axis=2)
    slopes = to_tx / far_tx[..., None] + to_rx / far_rx[..., None]  # of the path by the point
    by_pose = np.concatenate([slopes, np.cross(points - about, slopes)], axis=2)  # (C, V, 6)
    rate = -2j * np.pi * frequencies / SPEED_OF_LIGHT
    phasors = amplitudes[..., None] * np.exp(rate * (far_tx + far_rx + path_offset)[..., None])
    simulated = phasors.sum(axis=1)
    bent = np.einsum("cvn,cvp->cpn", phasors, by_pose) * rate
    inner = (simulated.conj() * frames).sum(axis=1)
    power, measured = (np.abs(simulated) ** 2).sum(axis=1), (np.abs(frames) ** 2).sum(axis=1)
    seen = (power > 0) & (measured > 0)
    norm = np.where(seen, power * measured, 1.0)
    value = np.where(seen, np.abs(inner) ** 2 / norm, 0.0)
    inner_slope = 2 * (inner.conj()[:, None] * np.einsum("cpn,cn->cp", bent.conj(), frames)).real
    power_slope = 2 * np.einsum("cpn,cn->cp", bent.conj(), simulated).real
    gradient = np.where(
        seen[:, None], inner_slope / norm[:, None] - (value / np.where(seen, power, 1.0))[:, None] * power_slope, 0.0
    )
    return Match(float(value.mean()), gradient.mean(axis=0))
