"""Autofocus: what is left of rows begun early or late and of a path that wanders, and the seconds it takes.

    make bench TESTS=benchmarks/test_autofocus.py

30 x 30 cm, half a wavelength between frames and rows: single points at 77 and 24 GHz, and nine metal balls by the
virtual rig's physics at 77 GHz. All simulated. Takes some ten minutes on two cores.
"""

import time
from dataclasses import replace

import numpy as np
import pytest

import millisight as ms
from millisight.core import SPEED_OF_LIGHT
from millisight.rig.virtual import EchoModel, Part, RadarSettings, ScanSettings, World, WorldObject, build_layout

FRAMES, WANDER, CORRELATION = 2.0, 2e-3, 1.0  # standard deviation; rms [m]; over which way it changes [m]


def scene(name, count=12):
    """A capture of points along the true path, how many poses a row has, and a grid."""
    preset = ms.Radar.preset(name)
    waveform = ms.Waveform.stepped(preset.waveform.start_frequency, preset.waveform.bandwidth / 32, 32)
    radar = ms.Radar(name=name, waveform=waveform, array=preset.array)
    path = ms.Trajectory.raster(size=(0.3, 0.3), step=waveform.wavelength / 2, center=(0, 0, 0.28), serpentine=True)
    rng = np.random.default_rng(3)
    points = rng.uniform((-0.12, -0.12, -0.02), (0.12, 0.12, 0.03), (count, 3))
    frames = np.zeros((len(path), 1, 1, 32), complex)
    for point, amplitude in zip(points, rng.uniform(0.3, 1, count), strict=True):
        delay = 2 * np.linalg.norm(path.positions - point, axis=1) / SPEED_OF_LIGHT
        frames[:, 0, 0] += amplitude * np.exp(-2j * np.pi * np.multiply.outer(delay, waveform.frequencies))
    frames += rng.normal(size=(*frames.shape, 2)).view(complex)[..., 0] * np.sqrt((abs(frames) ** 2).mean() / 200)
    spacing = (waveform.wavelength / 2, waveform.wavelength / 2, waveform.wavelength)
    grid = ms.VoxelGrid.regular((-0.15, -0.15, -0.04), (0.15, 0.15, 0.05), spacing)
    return ms.Capture(radar=radar, trajectory=path, frames=frames.astype(np.complex64)), grid


def errors(path, seed):
    """(P, 3) [m]: each row's offset, and a Gaussian process over the way."""
    rng = np.random.default_rng(seed)
    steps = np.diff(path.positions, axis=0)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(steps, axis=1))])
    waves, phases = rng.normal(size=(3, 256)) / CORRELATION, rng.uniform(0, 2 * np.pi, (3, 256))
    moved = np.array([np.cos(s * waves + phases).sum(axis=1) for s in way]) * WANDER / np.sqrt(3) * np.sqrt(2 / 256)
    rows = np.array_split(np.arange(len(path)), len(np.unique(path.positions[:, 0].round(6))))
    for row in rows:
        moved[row] += np.clip(rng.normal(0, FRAMES), -2.5 * FRAMES, 2.5 * FRAMES) * steps[row[0]]
    return moved


def left_over(path, moves, middle=(0, 0, 0)):
    """rms along the line of sight to the scene's middle [m], less what shifts, stretches, shears or turns the whole."""
    places = path.positions - middle
    sight = places / np.linalg.norm(places, axis=1, keepdims=True)
    centred = np.concatenate([np.ones((len(places), 1)), places - places.mean(axis=0)], axis=1)
    terms = (sight[:, :, None] * centred[:, None]).reshape(len(places), -1)
    terms = np.concatenate([terms, np.ones((len(places), 1))], axis=1)
    along = (moves * sight).sum(axis=1)
    return np.sqrt(np.mean((along - terms @ np.linalg.lstsq(terms, along, rcond=None)[0]) ** 2))


def peak(capture, grid):
    """The largest magnitude, between the voxels as well: around the ten brightest that lie apart."""
    size, points, brightest = ms.form_image(capture, grid).magnitude.ravel(), grid.points, []
    steps = np.array([np.diff(axis)[0] for axis in (grid.x, grid.y, grid.z)])
    for _ in range(10):
        brightest.append(points[size.argmax()])
        size = np.where((abs(points - brightest[-1]) < 2.5 * steps).all(axis=1), 0, size)
    around = np.stack(np.meshgrid(*3 * [np.linspace(-0.5, 0.5, 5)]), axis=-1).reshape(-1, 3) * steps
    values = ms.image_at(
        capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies,
        (np.array(brightest)[:, None] + around).reshape(-1, 3),
    )  # fmt: skip
    return abs(values).max()


def rig_scene():
    """A capture of nine metal balls of 43 mm on their stands by the virtual rig's physics, and a grid."""
    settings = RadarSettings(chirps=1)
    places = [(5, 6), (14, 3), (25, 7), (10, 13), (20, 15), (4, 21), (13, 25), (26, 24), (17, 20)]
    balls = [WorldObject(object="golf_ball", at=(x / 100, y / 100), material="metal") for x, y in places]
    layout = build_layout(World(objects=tuple(balls), radars=(settings,), scan=ScanSettings(size=(0.3, 0.3))))
    array = ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0, 0, 0]])
    radar = ms.Radar(name="one receiver", waveform=settings.radar.waveform, array=array)
    step = radar.waveform.wavelength / 2
    path = ms.Trajectory.raster(size=(0.3, 0.3), step=step, center=(0.15, 0.15, 0.0), serpentine=True)
    parts = [Part(mesh=part.mesh, material=part.material) for part in layout.parts]
    frames = EchoModel(parts, radar, path, antenna=settings.antenna, rng=0).frames(path)
    rng = np.random.default_rng(0)
    frames = frames + rng.normal(size=(*frames.shape, 2)).view(complex)[..., 0] * np.sqrt(
        (abs(frames) ** 2).mean() / 200
    )
    tops = [item.bounds for item in layout.objects]
    low, high = min(lower[2] for lower, _ in tops), max(upper[2] for _, upper in tops)
    grid = ms.VoxelGrid.regular((-0.03, -0.03, low - 0.03), (0.33, 0.33, high + 0.03), (0.002, 0.002, 0.004))
    return ms.Capture(radar=radar, trajectory=path, frames=frames.astype(np.complex64)), grid


# What makes them; the least that is left, one over so many wavelengths; the least peak [% of the true path's].
SCENES = {
    "points at 77 GHz": (lambda: scene("mito-sim-77ghz"), 18, 90),
    "points at 24 GHz": (lambda: scene("mito-sim-24ghz"), 6, 70),
    "the rig's balls at 77 GHz": (rig_scene, 18, 70),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_left(name):
    make, least, least_peak = SCENES[name]
    right, grid = make()
    path, wavelength = right.trajectory, right.radar.waveform.wavelength
    middle = grid.bounds.mean(axis=0)
    best = peak(right, grid)
    same = ms.autofocus(right, grid)  # compiles, and holds still
    assert not same.applied
    print(f"\n{name}: {len(path)} poses; the right path: {same.reason}")
    for seed in range(5):
        moved = errors(path, seed)
        bad = replace(right, trajectory=replace(path, positions=path.positions - moved))
        start, worked = time.perf_counter(), time.process_time()
        found = ms.autofocus(bad, grid)
        taken, worked = time.perf_counter() - start, time.process_time() - worked
        before, after = (wavelength / left_over(path, m, middle) for m in (moved, found.displacements - moved))
        peaks = [100 * peak(c, grid) / best for c in (bad, found.capture)]
        print(
            f"seed {seed}: wavelength / {before:.1f} to / {after:.1f} (told {wavelength / found.uncertainty:.1f}), "
            f"peak {peaks[0]:.0f} to {peaks[1]:.0f} %, {taken:.1f} s ({worked:.0f} s of processor); "
            f"{' and '.join(found.applied) or found.reason}"
        )
        assert after > least
        assert peaks[1] > least_peak
