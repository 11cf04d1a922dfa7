"""Sheets at full size: the seconds that `remove_sheets` takes for frames and for an image, and what is left.

    make bench TESTS=benchmarks/test_sheets.py

A tilted mirror over 30 points: 10 900 poses, 4 receivers, 512 samples; 220 x 240 x 22 voxels. And what is left of a lid
of 8 x 10 cm that ends within an image of 20 cm, however it is turned about z.
"""

import time

import numpy as np

import millisight as ms
from helpers.mirrors import DEVICES, GRID, capture_of, mirror, points, raster
from millisight.core import rotation_from_euler_deg
from millisight.imaging import remove_sheets


def test_seconds_at_full_size():
    device, rng = ms.Radar.preset("iwr1443"), np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(0, 0.55, 109), np.linspace(0, 0.45, 100), indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel(), rng.normal(0, 0.0005, x.size)])
    path = ms.Trajectory(times=np.arange(float(x.size)), positions=places)
    spots = points(device, path, rng.uniform([0.2, 0.15, -0.3], [0.3, 0.25, -0.27], (30, 3)), 0.002)
    sheet = mirror(device, path, -0.2, tilt_deg=(1, -2))
    capture = capture_of(device, path, spots + sheet)
    grid = ms.VoxelGrid(
        x=np.linspace(-0.10, 0.4475, 220), y=np.linspace(-0.05, 0.5475, 240), z=np.linspace(-0.37, -0.16, 22)
    )
    image = ms.form_image(capture, grid, tolerance=0.02)
    frequency = device.waveform.center_frequency
    for what, call in (
        ("frames", lambda: remove_sheets(capture)),
        ("image", lambda: remove_sheets(image, frequency=frequency)),
    ):
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            found = call()
            seconds.append(time.perf_counter() - start)
        assert len(found.sheets) == 1
        print(f"\n{what}: {min(seconds):.2f} to {max(seconds):.2f} s; {found}")
    left = np.linalg.norm(remove_sheets(capture).result.frames - spots) / np.linalg.norm(sheet)
    print(f"left of the sheet in the frames: {100 * left:.1f} % of its amplitude")
    assert left < 0.2


def test_what_is_left_of_a_turned_lid():
    device, path = DEVICES["77 GHz"], raster()
    sides = [(axis, sign * half, -sign) for axis, half in enumerate((0.05, 0.04)) for sign in (-1, 1)]
    spots = ms.form_image(capture_of(device, path, points(device, path, strength=0.005)), GRID, tolerance=0.02).values
    level = abs(GRID.z + 0.2) < 0.025  # above it lie grating lobes
    print()
    for turn_deg in (0, 1, 3, 8, 20, 45):
        turned = path.positions @ rotation_from_euler_deg((0, 0, turn_deg))
        frames = mirror(device, ms.Trajectory(times=path.times, positions=turned), -0.2, sides=sides)
        lid = ms.form_image(capture_of(device, path, frames), GRID, tolerance=0.02).values
        scene = ms.SarImage(grid=GRID, values=spots + lid)
        found = remove_sheets(scene, frequency=device.waveform.center_frequency, clutter="lid")
        left = abs(found.result.values - spots)[..., level]
        share = (left**2).sum() / (abs(lid[..., level]) ** 2).sum()
        print(f"a lid turned by {turn_deg:2} degrees: {100 * share:4.1f} % of its power is left")
        assert share < 0.02
