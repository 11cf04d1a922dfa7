"""The error of range profiles, measured with a few poses, and the oversampling that keeps it within a tolerance.

It decides the oversampling that an image is tried with; `_check` measures the image (primer 8).
"""

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Capture, VoxelGrid
from millisight.imaging._backprojection import kernels_on, range_compression
from millisight.imaging._exact import image_at
from millisight.imaging._lengths import boxes, grid_in
from millisight.imaging._windows import Window, range_weights, window_pair

_PICKS = 128  # voxels of a measurement
_POSES = 16
_RIPPLE = 0.165  # rms error of a profile times the oversampling squared, over a flat band

MOST_OVERSAMPLING = 128
"""Beyond it float32 errs by more than the profiles do."""


def profile_error(capture: Capture, grid: VoxelGrid, picks: np.ndarray, window: Window, oversampling: int) -> float:
    """Relative L2 error against `image_at` of direct backprojection of some poses, at the voxels `picks` (n,)."""
    poses = len(capture.trajectory)
    some = np.sort(np.random.default_rng(0).choice(poses, min(_POSES, poses), replace=False))
    waveform = capture.radar.waveform
    taper = range_weights(window_pair(window)[0], waveform.samples_per_chirp)
    carrier = waveform.center_frequency / SPEED_OF_LIGHT
    kernels = kernels_on("cpu")
    squares = np.zeros(2)
    for box in boxes(grid, carrier):
        inside, numbers = grid_in(grid, box), np.unravel_index(picks, grid.shape)
        here = np.all([(n >= b.start) & (n < b.stop) for n, b in zip(numbers, box, strict=True)], axis=0)
        if not here.any():
            continue
        origin = inside.bounds.mean(axis=0)
        places = zip((grid.x, grid.y, grid.z), numbers, strict=True)
        points = np.stack([axis[n[here]] for axis, n in places], axis=1) - origin
        tx, rx = capture.tx_positions[some] - origin, capture.rx_positions[some] - origin
        compression = range_compression(capture, tx, rx, inside.bounds - origin, oversampling, window, kernels)
        sums, truth = np.zeros((2, len(points)), dtype=np.float32), np.zeros(len(points), dtype=np.complex128)
        for first in range(0, len(some), compression.poses_at_once):
            block = slice(first, first + compression.poses_at_once)
            frames = np.concatenate([capture.frames_of(slice(p, p + 1)) for p in some[block]])
            kernels.backproject(
                compression.profiles(frames, block), compression.nearest(block), compression.per_metre, carrier,
                tx[block], rx[block], *np.ascontiguousarray(points.T, dtype=np.float32), sums[0], sums[1],
                compression.excess,
            )  # fmt: skip
            truth += np.prod(frames.shape[:3]) * image_at(
                frames * taper, tx[block], rx[block], waveform.frequencies, points, capture.radar.path_offset,
                layers=capture.layers,
            )  # fmt: skip
        squares += [np.sum(np.abs(sums[0] + 1j * sums[1] - truth) ** 2), np.sum(np.abs(truth) ** 2)]
    return float(np.sqrt(squares[0] / squares[1]) if squares[1] > 0 else squares[0] > 0)


def estimated_oversampling(tolerance: float) -> int:
    """The oversampling with which range profiles of a flat band err by `tolerance`."""
    return int(np.ceil(np.sqrt(_RIPPLE / tolerance)))


def finer(oversampling: int, error: float, tolerance: float) -> int:
    """The oversampling that brings the error, which falls with its square, down to the tolerance."""
    wanted = np.ceil(oversampling * min(2.0, 1.05 * np.sqrt(error / tolerance)))
    return int(min(max(wanted, oversampling + 1), MOST_OVERSAMPLING))


def some_of(grid: VoxelGrid) -> np.ndarray:
    """(n,) numbers of random voxels."""
    return np.random.default_rng(1).integers(0, grid.size, min(_PICKS, grid.size))
