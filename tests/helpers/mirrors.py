"""Echoes of sheets in closed form: mirrors by the image of the transmitter, their edges by Fresnel's integral."""

import numpy as np
from scipy.special import fresnel

import millisight as ms
from helpers.oracles import C, point_frames
from helpers.scatter import radar

DEVICES = {
    "77 GHz": radar(77.5e9, 3e9 / 32, 32, path_offset=0.15),
    "24 GHz": radar(24.025e9, 2e8 / 16, 16),
    "falling, two receivers": radar(
        80.5e9, -3e9 / 32, 32, ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[-0.005, 0, 0], [-0.007, 0, 0]])
    ),
}
GRID = ms.VoxelGrid.regular((-0.1, -0.1, -0.28), (0.1, 0.1, -0.15), (0.0025, 0.0025, 0.01))
SPOTS = np.array([[0.01, 0.0, -0.25], [-0.015, 0.02, -0.255], [0.02, -0.02, -0.245], [0.0, 0.015, -0.26]])


def raster(size=(0.2, 0.2), step=0.0025, jitter=0.0003):
    """Poses at about z = 0. Were they off their places across as well, a mirror's image would be noisy."""
    path = ms.Trajectory.raster(size=size, step=step, center=(0, 0, 0))
    shaken = path.positions + np.random.default_rng(0).normal(0, jitter, path.positions.shape) * [0, 0, 1]
    return ms.Trajectory(times=path.times, positions=shaken)


def capture_of(device, path, frames):
    return ms.Capture(radar=device, trajectory=path, frames=frames.astype(np.complex64))


def mirror(device, path, height, *, tilt_deg=(0.0, 0.0), bow=0.0, strength=0.1, sides=()):
    """(P, T, R, N) the echo of a sheet that rises by `tilt_deg` along x and along y, and sinks by `bow` [m] towards its
    sides at 10 cm; `sides`: (axis, place, sign) of edges, beyond which in the direction of the sign it goes on."""
    tx = path.placed(device.array.tx_positions)[:, :, None]
    rx = path.placed(device.array.rx_positions)[:, None]
    middle = (tx + rx) / 2
    slope = np.tan(np.radians(tilt_deg))
    above = middle[..., 2] - height - middle[..., :2] @ slope + bow * (middle[..., 0] / 0.1) ** 2
    distance = above / np.sqrt(1 + (slope**2).sum())
    length = np.sqrt((2 * distance) ** 2 + ((tx - rx) ** 2).sum(axis=-1)) + device.path_offset
    frequencies = device.waveform.frequencies
    frames = strength * np.exp(-2j * np.pi * frequencies / C * length[..., None])
    for axis, place, sign in sides:
        beyond = sign * (middle[..., axis] - place) * 2 / np.sqrt(C / device.waveform.center_frequency * distance)
        sine, cosine = fresnel(beyond)
        frames = frames * ((0.5 + cosine - 1j * (0.5 + sine)) / (1 - 1j))[..., None]
    return frames


def leak_of(device, strength):
    """(T, R, N) what leaks straight from each transmitter into each receiver."""
    array = device.array
    straight = np.linalg.norm(array.tx_positions[:, None] - array.rx_positions, axis=-1) + device.path_offset
    return strength * np.exp(-2j * np.pi * device.waveform.frequencies / C * straight[..., None])


def points(device, path, places=SPOTS, strength=0.03):
    """(P, T, R, N) of point reflectors."""
    tx, rx = path.placed(device.array.tx_positions), path.placed(device.array.rx_positions)
    return point_frames(places, strength, tx, rx, device.waveform.frequencies, device.path_offset)


def disc(radius, height, spacing=0.002):
    """Places that make up a flat top."""
    axis = np.arange(-radius, radius + spacing / 2, spacing)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) <= radius
    return np.column_stack([x[inside], y[inside], np.full(inside.sum(), height)])
