"""Captures of mirrors by their closed forms: the path is that of the one specular ray, the amplitude 1."""

import numpy as np

import millisight as ms
from millisight.core import SPEED_OF_LIGHT

BAND = 3e9
PLANE_TILT_DEG = 8.0


def radar(array: ms.AntennaArray | None = None, samples: int = 32) -> ms.Radar:
    """At 77.5 to 80.5 GHz, by default with one antenna that transmits and receives."""
    return ms.Radar(
        name="mirror test",
        waveform=ms.Waveform.stepped(77.5e9, BAND / samples, samples),
        array=array or ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0, 0, 0]]),
    )


def capture_of(paths, array=None, *, size=0.24, step=0.0025, noise=0.0, rng=0, shift=(0.0, 0.0, 0.0)) -> ms.Capture:
    """Frames of the path lengths that `paths(tx, rx)` gives for antennas (P, T, 1, 3) and (P, 1, R, 3) [m]."""
    held, raster = radar(array), ms.Trajectory.raster(size=(size, size), step=step)
    # The aperture is the plane z = 0.
    where = ms.Trajectory(times=raster.times, positions=raster.positions * [1, 1, 0])
    tx, rx = (where.placed(ends)[:, :, None] for ends in (held.array.tx_positions, held.array.rx_positions))
    lengths = paths(tx, rx.transpose(0, 2, 1, 3))
    frames = np.exp(-2j * np.pi / SPEED_OF_LIGHT * lengths[..., None] * held.waveform.frequencies)
    if noise:
        generator = np.random.default_rng(rng)
        frames = frames + noise * (generator.normal(size=frames.shape) + 1j * generator.normal(size=frames.shape))
    moved = ms.Trajectory(times=where.times, positions=where.positions + np.array(shift))
    return ms.Capture(radar=held, trajectory=moved, frames=frames.astype(np.complex64))


def ball(radius, depth=0.25):
    """Paths by a sphere whose top lies `depth` under the origin; antennas of a pair close together."""
    middle = np.array([0, 0, -depth - radius])
    return lambda tx, rx: 2 * (np.linalg.norm((tx + rx) / 2 - middle, axis=-1) - radius)


def rod(radius, depth=0.25):
    """Paths by a cylinder along x."""
    middle = np.array([0, 0, -depth - radius])
    return lambda tx, rx: 2 * (np.linalg.norm(((tx + rx) / 2 - middle)[..., 1:], axis=-1) - radius)


def bowl(radius, depth=0.25):
    """Paths by the inside of a cup's round floor, whose lowest place lies `depth` under the origin."""
    middle = np.array([0, 0, -depth + radius])
    return lambda tx, rx: 2 * (np.linalg.norm((tx + rx) / 2 - middle, axis=-1) + radius)


def plane(depth=0.25, tilt_deg=PLANE_TILT_DEG):
    """Paths by an endless plane, exact for antennas apart: from the transmitter to the receiver's mirror image."""
    normal = np.array([np.sin(np.radians(tilt_deg)), 0, np.cos(np.radians(tilt_deg))])
    foot = np.array([0, 0, -depth])
    return lambda tx, rx: np.linalg.norm(tx - (rx - 2 * ((rx - foot) @ normal)[..., None] * normal), axis=-1)
