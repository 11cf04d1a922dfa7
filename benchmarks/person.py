"""A person-sized volume: 2 x 1 x 0.5 m at 2.5 mm, 64 million voxels, from 512 x 512 positions, in bounded memory.

    python benchmarks/person.py
    python benchmarks/person.py --positions 128 --spacing 10mm     a small one

Points at known places are captured at 77 GHz. `millisight image --memory` images them in a process of its own, whose
largest memory is measured; the image is compared with the exact sum at the points and at voxels beside them. Then the
viewer opens it, in a process of its own as well, without a browser.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

import millisight as ms
from millisight.cli.console import length

SIZE = np.array([2.0, 1.0, 0.5])
MIDDLE = np.array([0.0, 0.0, -0.65])
POINTS = 12

VIEW = """
import resource, sys, time
import millisight as ms

before = time.perf_counter()
with ms.view(sys.argv[1], browser=False) as viewer:
    (pane,) = viewer.panes.panes
    levels = pane.exhibit.levels
    seconds = time.perf_counter() - before
used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
print(f"viewer: opened in {seconds:.1f} s with {used:.2f} GB of memory; {levels.grid.size} levels, "
      f"each the strongest of {' x '.join(map(str, levels.block))} voxels")
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--positions", type=int, default=512, help="along x and along y")
    parser.add_argument("--spacing", default="2.5mm")
    parser.add_argument("--memory", default="8GB")
    arguments = parser.parse_args()
    spacing = length(arguments.spacing, option="--spacing")
    grid = ms.VoxelGrid.regular(MIDDLE - SIZE / 2, MIDDLE + SIZE / 2, spacing)
    with tempfile.TemporaryDirectory() as folder:
        places = points(grid)
        capture = captured(arguments.positions, places)
        path, image = Path(folder, "person.capture.h5"), Path(folder, "person.image.h5")
        ms.save(path, capture)
        print(
            f"{len(capture.trajectory)} positions, {capture.frames.nbytes / 1e9:.2f} GB of frames; {grid}", flush=True
        )
        bounds = ",".join(
            f"{a:.6g}m:{b:.6g}m:{spacing}m" for a, b in zip(MIDDLE - SIZE / 2, MIDDLE + SIZE / 2, strict=True)
        )
        command = [sys.executable, "-m", "millisight.cli.main", "image", str(path), f"--grid={bounds}"]
        before = time.perf_counter()
        done = subprocess.run(
            [*command, "--memory", arguments.memory, "-o", str(image)], capture_output=True, text=True, check=False
        )
        seconds = time.perf_counter() - before
        print(done.stdout, *(line for line in done.stderr.splitlines() if "ETA" not in line), sep="\n")
        if done.returncode:
            raise SystemExit(done.returncode)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        errors, largest = compared(image, grid, capture, places)
        viewed = subprocess.run([sys.executable, "-c", VIEW, str(image)], capture_output=True, text=True, check=False)
    print(
        f"{seconds:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of {os.cpu_count()} cores; at most "
        f"{used.ru_maxrss / 1e6:.2f} GB of memory, {arguments.memory} allowed; error {100 * errors.max():.2f} % of the "
        f"largest value, {largest:.3f}"
    )
    print((viewed.stdout or viewed.stderr).strip().splitlines()[-1])


def points(grid: ms.VoxelGrid) -> np.ndarray:
    """(12, 3) voxels all over the grid, not at its borders [m]."""
    rng = np.random.default_rng(3)
    axes = [axis[len(axis) // 10 : -(len(axis) // 10)] for axis in (grid.x, grid.y, grid.z)]
    return np.stack([rng.choice(axis, POINTS, replace=False) for axis in axes], axis=1)


def captured(count: int, places: np.ndarray) -> ms.Capture:
    """The frames of points of strength 1, rows along y."""
    x, y = (size * (np.arange(count) - (count - 1) / 2) / count for size in SIZE[:2])
    positions = np.stack([np.repeat(x, count), np.tile(y, count), np.zeros(count**2)], axis=1)
    radar = ms.Radar.preset("mito-sim-77ghz")
    frequencies = radar.waveform.frequencies
    frames = np.zeros((len(positions), 1, 1, len(frequencies)), np.complex64)
    for first in range(0, len(positions), 4096):
        part = slice(first, first + 4096)
        for place in places:
            ways = 2 * np.linalg.norm(positions[part] - place, axis=1)
            cycles = ways[:, None] * (frequencies / 299_792_458.0)
            frames[part, 0, 0] += np.exp(-2j * np.pi * (cycles % 1)).astype(np.complex64)
    times = 1e-3 * np.arange(len(positions))
    return ms.Capture(radar=radar, trajectory=ms.Trajectory(times=times, positions=positions), frames=frames)


def compared(path: Path, grid: ms.VoxelGrid, capture: ms.Capture, places: np.ndarray) -> tuple[np.ndarray, float]:
    """Errors at the points and at a voxel beside each, relative to the largest value of the image; that value."""
    beside = places + np.array([1, 1, 0]) * (grid.x[1] - grid.x[0])
    errors = []
    with h5py.File(path) as file:
        values = file["values"]
        largest = max(float(np.abs(values[i]).max()) for i in range(grid.shape[0]))
        for place in (*places, *beside):
            i, j, k = (int(np.argmin(abs(a - p))) for a, p in zip((grid.x, grid.y, grid.z), place, strict=True))
            one = ms.VoxelGrid(x=grid.x[i : i + 1], y=grid.y[j : j + 1], z=grid.z[k : k + 1])
            exact = ms.form_image(capture, one, method="exact").values.item()
            errors.append(abs(values[i, j, k] - exact) / largest)
    return np.array(errors), largest


if __name__ == "__main__":
    main()
