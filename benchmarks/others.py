"""Direct backprojection by other packages and by ours, in turn, on the same data: `python benchmarks/others.py NAME`.

Prints one line of JSON. Costs are of a pair and core; errors are relative L2 errors at 1000 random voxels against
float64, the others' after the best scaling. `torchbp` images planes by one antenna that sends and receives; its
range profiles are made ready before its clock runs, by the Fourier transform it expects, 16 times as fine as the band.
"""

import argparse
import importlib
import importlib.metadata
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from problems import real_size

import millisight as ms

C = 299_792_458.0
ROUNDS = 3
FINER = 16  # torchbp interpolates range profiles linearly


def part_of_r(scale: float) -> tuple[ms.Capture, ms.VoxelGrid]:
    """100 poses of R, all voxels."""
    whole, grid = real_size(scale)
    poses = slice(0, 100)
    trajectory = ms.Trajectory(times=whole.trajectory.times[poses], positions=whole.trajectory.positions[poses])
    return ms.Capture(radar=whole.radar, trajectory=trajectory, frames=whole.frames[poses]), grid


def plane(scale: float) -> tuple[ms.Capture, ms.VoxelGrid]:
    """A plane of 480 x 480 voxels under 2000 positions of one antenna at 77 GHz, 100 points in the plane."""
    rng = np.random.default_rng(0)
    root = np.sqrt(scale)
    columns, rows = round(50 * root), round(40 * root)
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, columns), np.linspace(-0.2, 0.2, rows), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)], axis=1)
    radar = ms.Radar.preset("mito-sim-77ghz")
    points = np.column_stack([rng.uniform(-0.15, 0.15, (100, 2)), np.zeros(100)])
    strengths = rng.normal(size=100) + 1j * rng.normal(size=100)
    frames = np.zeros((len(positions), 1, 1, radar.waveform.samples_per_chirp), np.complex64)
    for point, strength in zip(points, strengths, strict=True):
        paths = 2 * np.linalg.norm(positions - point, axis=1) + radar.path_offset
        turns = paths[:, None] * (radar.waveform.frequencies / C) % 1
        frames[:, 0, 0] += strength * np.exp(-2j * np.pi * turns)
    trajectory = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)
    # As torchbp lays them: `count` steps from the first edge, without the other.
    axis = -0.18 + 0.36 / round(480 * root) * np.arange(round(480 * root))
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames), ms.VoxelGrid(x=axis, y=axis, z=[0.0])


def fastsar(capture: ms.Capture, grid: ms.VoxelGrid) -> Callable[[], np.ndarray]:
    """Its convention: phase compensated to the origin, half the bistatic path, the sum over samples and pulses."""
    package = importlib.import_module("fastsar")
    frequencies, origin = capture.radar.waveform.frequencies, grid.bounds.mean(axis=0)
    receivers = capture.rx_positions.shape[1]
    tx = np.repeat(capture.tx_positions - origin, receivers, axis=1).reshape(-1, 3)
    rx = (capture.rx_positions - origin).reshape(-1, 3)
    reference = np.linalg.norm(tx, axis=1) + np.linalg.norm(rx, axis=1) + capture.radar.path_offset
    history = capture.frames.reshape(-1, len(frequencies))
    history = (history * np.exp(2j * np.pi * np.outer(reference, frequencies) / C)).astype(np.complex64)
    points = grid.points.reshape(*grid.shape, 3) - origin
    step = frequencies[1] - frequencies[0]
    return lambda: np.asarray(package.backproject(history, tx, frequencies[0], step, points, rcv=rx, window=False))


def torchbp(capture: ms.Capture, grid: ms.VoxelGrid) -> Callable[[], np.ndarray]:
    """`backprojection_cart_2d` on the CPU: range profiles less the carrier, bins of half a path, the plane z = 0."""
    import torch

    package = importlib.import_module("torchbp")
    torch.set_num_threads(numba.get_num_threads())
    waveform = capture.radar.waveform
    frequencies, count = waveform.frequencies, FINER * waveform.samples_per_chirp
    middle, step = (frequencies[0] + frequencies[-1]) / 2, frequencies[1] - frequencies[0]
    resolution = C / (2 * step * count)
    bins = resolution * np.arange(count)
    profiles = np.fft.ifft(capture.frames[:, 0, 0], count, axis=1)
    profiles = (profiles * np.exp(2j * np.pi * (frequencies[0] - middle) * 2 * bins / C)).astype(np.complex64)
    shape = {"nx": len(grid.x), "ny": len(grid.y)}
    ends = [(float(a[0]), float(a[0] + len(a) * (a[1] - a[0]))) for a in (grid.x, grid.y)]
    data = torch.from_numpy(profiles)
    positions = torch.from_numpy(capture.tx_positions[:, 0].astype(np.float32))
    # The whole circle: its beam looks along x, ours down.
    settings = {"d0": capture.radar.path_offset / 2, "beamwidth": 2 * np.pi}
    plot = {"x": ends[0], "y": ends[1], **shape}

    def image() -> np.ndarray:
        with torch.no_grad():
            made = package.ops.backprojection_cart_2d(data, plot, float(middle), resolution, positions, **settings)
        return made.numpy().reshape(grid.shape)

    return image


PACKAGES = {"fastsar": (fastsar, part_of_r), "torchbp": (torchbp, plane)}


def relative(actual: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(actual - expected) / np.linalg.norm(expected))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", choices=PACKAGES)
    parser.add_argument("--scale", type=float, default=1.0, help="of the problem, 1 by default")
    options = parser.parse_args()
    prepared, problem = PACKAGES[options.package]
    try:
        importlib.import_module(options.package)
    except ImportError as error:
        json.dump({"missing": f"{type(error).__name__}: {error}"}, sys.stdout)
        return
    capture, grid = problem(options.scale)
    works = {
        "theirs": prepared(capture, grid),
        "ours": lambda: ms.form_image(capture, grid, method="backprojection").values,
    }
    values: dict[str, Any] = {name: work() for name, work in works.items()}  # compile
    taken: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(ROUNDS):
        for name, work in works.items():
            began = time.perf_counter()
            values[name] = work()
            taken[name].append(time.perf_counter() - began)
    some = np.random.default_rng(2).choice(grid.size, min(1000, grid.size), replace=False)
    exact = ms.image_at(
        capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies,
        grid.points[some], capture.radar.path_offset,
    )  # fmt: skip
    theirs, ours = (np.asarray(values[name]).ravel()[some] for name in works)
    scaled = theirs * (np.vdot(theirs, exact) / np.vdot(theirs, theirs))
    pairs = grid.size * capture.channels / numba.get_num_threads()
    told = {
        "version": importlib.metadata.version(options.package),
        "threads": numba.get_num_threads(),
        "cores": os.cpu_count(),
        **{name: 1e9 * float(np.median(times)) / pairs for name, times in taken.items()},
        "ratio": float(np.median(np.array(taken["theirs"]) / np.array(taken["ours"]))),
        "errors": [relative(scaled, exact), relative(ours, exact)],
    }
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()
