"""Captures and grids drawn at random: every kind of scan, from 5 cm to 10 km, small enough to be imaged in a blink."""

from typing import NamedTuple

import numpy as np

import millisight as ms
from helpers.oracles import C

SCANS = (
    "raster", "x-z plane", "rail", "two rails", "circle", "turntable arc", "sphere", "cylinder", "cloud", "drive-by",
)  # fmt: skip


class Problem(NamedTuple):
    """What was drawn, in words, and the capture and the grid."""

    words: str
    capture: ms.Capture
    grid: ms.VoxelGrid


def draw(seed: int) -> Problem:
    """The problem of a seed."""
    rng = np.random.default_rng([17, seed])
    scan = SCANS[seed % len(SCANS)]
    distance = _log(rng, 0.05, 10_000)
    frequency = _log(rng, 1e9, 250e9)
    wavelength = C / frequency
    waveform = _waveform(rng, frequency)
    if seed % 3 == 0 and waveform.slope:
        waveform = ms.Waveform.stepped(waveform.frequencies[-1], -waveform.frequency_step, waveform.samples_per_chirp)
    positions = _positions(rng, scan, distance)
    array = _array(rng, wavelength, distance)
    radar = ms.Radar(name=scan, waveform=waveform, array=array, path_offset=rng.choice([0.0, 0.15, -2 * distance]))
    # A tenth of a map's coordinates, or the scene's own.
    origin = rng.choice([0.0, 1.0]) * rng.normal(0, 3 * distance, 3)
    trajectory = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions + origin)
    axes = _axes(rng, scan, distance, positions, wavelength, waveform)
    grid = ms.VoxelGrid(**{name: axis + o for name, axis, o in zip("xyz", axes, origin, strict=True)})
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    frames = _frames(rng, grid, tx, rx, radar)
    capture = ms.Capture(radar=radar, trajectory=trajectory, frames=frames.astype(np.complex64))
    words = (
        f"seed {seed}: {scan}, {distance:.3g} m, {frequency / 1e9:.3g} GHz, band {waveform.bandwidth / 1e9:.3g} GHz, "
        f"{len(positions)} poses, {len(array.tx_positions)} x {len(array.rx_positions)} antennas, grid {grid.shape}"
    )
    return Problem(words, capture, grid)


def _log(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _waveform(rng, frequency):
    samples = int(rng.choice([1, 2, 6, 16, 33]))
    band = 0.0 if samples == 1 else frequency * _log(rng, 0.001, 0.6)
    step = band / samples
    return ms.Waveform.stepped(frequency - step * (samples - 1) / 2, step, samples)


def _array(rng, wavelength, distance):
    """1 to 8 channels: one antenna, a row of a few wavelengths, or antennas far apart."""
    kind = rng.integers(0, 4)
    if kind == 0:
        return ms.AntennaArray.monostatic()
    counts = [(1, 1), (1, 2), (1, 4), (2, 2), (2, 4)][rng.integers(0, 5)]
    spread = min((2 * wavelength, 5 * wavelength, 0.3 * distance)[kind - 1], 0.3 * distance)
    tx, rx = (rng.uniform(-spread, spread, (n, 3)) for n in counts)
    return ms.AntennaArray(tx_positions=tx, rx_positions=rx)


def _positions(rng, scan, distance):
    """(P, 3) about the origin, where the scene is; the radar above it, or round it."""
    size = distance * rng.uniform(0.1, 2, 2)
    count = int(_log(rng, 60, 900))
    angle, height = np.sort(rng.uniform(0, 2 * np.pi, count)), rng.uniform(-1, 1, count)
    if scan in ("raster", "x-z plane"):
        rows = max(2, int(np.sqrt(count * size[0] / size.sum())))
        x, y = np.linspace(-0.5, 0.5, rows) * size[0], np.linspace(-0.5, 0.5, max(2, count // rows)) * size[1]
        x, y = np.meshgrid(x, y)
        p = np.stack([x.ravel(), y.ravel(), np.full(x.size, distance)], axis=1)
        p = p if scan == "raster" else p[:, [0, 2, 1]]
    elif scan in ("rail", "two rails"):
        p = np.zeros((count, 3))
        p[:, 0], p[:, 2] = np.linspace(-0.5, 0.5, count) * size[0], distance
        if scan == "two rails":
            p[count // 2 :, 1] += 0.3 * size[1]
    elif scan in ("circle", "turntable arc"):
        angle = angle if scan == "circle" else angle * rng.uniform(0.01, 0.5)
        p = distance * np.stack([np.cos(angle), np.sin(angle), np.full(count, rng.uniform(0, 0.5))], axis=1)
    elif scan == "sphere":
        ring = np.sqrt(1 - height**2)
        p = distance * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    elif scan == "cylinder":
        p = distance * np.stack([np.cos(angle), np.sin(angle), rng.uniform(0.1, 1) * height], axis=1)
    elif scan == "cloud":
        p = rng.uniform(-0.5, 0.5, (count, 3)) * [*size, 0.2 * distance] + [0, 0, distance]
    else:  # a way past the scene, many times longer than its nearest distance
        p = np.zeros((count, 3))
        p[:, 0], p[:, 1], p[:, 2] = np.linspace(-5, 5, count) * size[0], 0.05 * distance, 0.2 * distance
    return p + rng.normal(0, rng.choice([0, 1e-3]) * min(size.min(), distance), p.shape)


def _axes(rng, scan, distance, positions, wavelength, waveform):
    """Three axes: two long ones, and 1 to 22 planes along one that may be any; now and then a line of voxels."""
    counts = [int(_log(rng, 20, 150)), int(_log(rng, 20, 90)), int(rng.choice([1, 1, 2, 5, 9, 22]))]
    if rng.uniform() < 0.1:
        counts[1] = 1
    most = 4e4 / np.prod(counts)
    counts[0] = max(9, int(counts[0] * min(1.0, most)))
    order = rng.permutation(3)
    # A share of the distance, but a spacing that shows something: a twentieth of a wavelength to a cell or two.
    spacings = wavelength * np.exp(rng.uniform(np.log(0.05), np.log(20), 3))
    spacings = np.minimum(spacings, distance * 0.6 / np.array(counts))
    middle = rng.normal(0, 0.1, 3) * distance
    axes = [m + s * (np.arange(n) - (n - 1) / 2) for m, s, n in zip(middle, spacings, counts, strict=True)]
    return [axes[i] for i in order]


def _frames(rng, grid, tx, rx, radar):
    """(P, T, R, N) of some reflectors in and around the grid, with noise; or of noise alone."""
    shape = (len(tx), tx.shape[1], rx.shape[1], radar.waveform.samples_per_chirp)
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    count = int(rng.choice([0, 1, 5, 30]))
    if count == 0:
        return noise
    lower, upper = grid.bounds
    points = (lower + upper) / 2 + rng.uniform(-0.6, 0.6, (count, 3)) * (upper - lower)
    amplitudes = rng.normal(size=count) + 1j * rng.normal(size=count)
    to = np.linalg.norm(points - tx[:, :, None], axis=-1)[:, :, None]
    d = to + np.linalg.norm(points - rx[:, :, None], axis=-1)[:, None] + radar.path_offset
    waves = radar.waveform.frequencies / C
    step = np.exp(-2j * np.pi * ((waves[1] - waves[0]) if len(waves) > 1 else 0.0) * d)
    value = amplitudes * np.exp(-2j * np.pi * waves[0] * d)
    frames = np.empty(shape, complex)
    for j in range(shape[-1]):
        frames[..., j] = value.sum(axis=-1)
        value = value * step
    return frames + rng.choice([0.0, 0.1]) * noise
