"""Sheets at full size: the seconds that `remove_sheets` takes for frames and for an image, and what is left.

    make bench TESTS=benchmarks/test_sheets.py

A tilted mirror over 30 points: 10 900 poses, 4 receivers, 512 samples; 220 x 240 x 22 voxels.
"""

import time

import numpy as np

import millisight as ms
from helpers.mirrors import capture_of, mirror, points
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
