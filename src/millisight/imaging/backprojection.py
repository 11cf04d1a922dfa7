"""Direct backprojection: range profiles, then one interpolation and one phase a voxel-channel pair (primer 8)."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from millisight.capture.capture import Capture
from millisight.constants import SPEED_OF_LIGHT
from millisight.device import check_device
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.windows import Window, aperture_weights, range_weights, window_pair

OVERSAMPLING = 8
"""Entries of a range profile per range bin c / B of path length: 0.2 % of error, see the tables of primer (8)."""

# One block of poses is held at a time: its frames and range profiles take at most this much [bytes], and its
# voxel-channel pairs at most about a second, so that progress shows and Ctrl-C is heard.
_BLOCK_BYTES = 256_000_000
_BLOCK_PAIRS = 1_000_000_000


def backproject(
    capture: Capture,
    grid: VoxelGrid,
    *,
    window: Window = None,
    oversampling: int = OVERSAMPLING,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> Complex[np.ndarray, "X Y Z"]:
    """The image of a capture on a grid, as complex64 values; `ms.form_image` is the door to it.

    The capture may lie on disk: it is read in blocks of poses.
    """
    kernels = kernels_on(device)
    # Distances are float32: count coordinates from the grid's middle, wherever the world's origin may lie.
    origin = grid.bounds.mean(axis=0)
    voxels = [kernels.to_device(v) for v in np.ascontiguousarray((grid.points - origin).T, dtype=np.float32)]
    tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
    nearest, furthest = path_bounds(tx, rx, grid.bounds - origin)
    steering, per_metre = range_steering(capture, nearest, furthest, oversampling, window)

    sums = kernels.zeros((2, grid.size))
    channels = int(np.prod(capture.frames.shape[1:3]))
    per_pose = 8 * channels * sum(steering.shape)
    steering = kernels.to_device(steering)
    step = int(max(1, min(_BLOCK_BYTES // per_pose, _BLOCK_PAIRS // (channels * grid.size))))
    carrier = np.float32(capture.radar.waveform.center_frequency / SPEED_OF_LIGHT)
    for block, frames in weighted_blocks(capture, step, window):
        kernels.backproject(
            kernels.product(frames, steering), np.float32(nearest), np.float32(per_metre), carrier,
            tx[block].astype(np.float32), rx[block].astype(np.float32), *voxels, sums[0], sums[1],
        )  # fmt: skip
        if progress is not None:
            progress(block.stop, len(capture.trajectory))
    real, imag = kernels.to_host(sums)
    return ((real + 1j * imag) / np.float32(capture.channels)).reshape(grid.shape)


def kernels_on(device: str) -> Any:
    """The inner loops for a device, and what moves arrays there and back: `_kernels` or `_cuda`, with the same names.

    Raises
    ------
    UnknownNameError, DeviceError
    """
    check_device(device)
    if device == "cuda":
        from millisight.imaging import _cuda as kernels
    else:
        from millisight.imaging import _kernels as kernels
    return kernels


def weighted_blocks(
    capture: Capture, step: int, window: Window, some: slice | None = None
) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of `step` poses, of all or of `some`; their frames (p, T, R, N) complex64 times the aperture's window."""
    weights = aperture_weights(window_pair(window)[1], capture.trajectory.positions).astype(np.float32)
    some = some or slice(0, len(capture.trajectory))
    for start in range(some.start, some.stop, step):
        block = slice(start, min(start + step, some.stop))
        frames = capture.frames_of(block)
        yield block, frames if (weights[block] == 1).all() else frames * weights[block, None, None, None]


def path_bounds(
    tx: Float[np.ndarray, "P T 3"], rx: Float[np.ndarray, "P R 3"], box: Float[np.ndarray, "2 3"]
) -> tuple[float, float]:
    """Shortest and longest path [m] from any transmitter over a point of `box` (2, 3) to any receiver of its pose."""
    lower, upper = box
    shortest, longest = [], []
    for antennas in (tx, rx):
        outside = np.maximum(np.maximum(lower - antennas, antennas - upper), 0)
        corner = np.maximum(np.abs(lower - antennas), np.abs(upper - antennas))
        shortest.append(np.linalg.norm(outside, axis=-1).min(axis=1))
        longest.append(np.linalg.norm(corner, axis=-1).max(axis=1))
    return float(np.add(*shortest).min()), float(np.add(*longest).max())


def range_steering(
    capture: Capture, nearest: float, furthest: float, oversampling: int, window: Window
) -> tuple[Complex[np.ndarray, "N M"], float]:
    """The matrix (N, M) that turns frames into range profiles, and its entries per metre of path (primer 8).

    Entry m of a profile is the frame's answer at path length nearest + m / per_metre, range-compressed, the
    carrier's phase over the path removed (it turns too fast to interpolate) but not that over the path offset.
    """
    waveform = capture.radar.waveform
    bandwidth = waveform.bandwidth or SPEED_OF_LIGHT / max(furthest - nearest, 1.0)
    per_metre = oversampling * bandwidth / SPEED_OF_LIGHT
    # Two more entries than the span: one for the interpolation's far side, one for the rounding of float32.
    paths = nearest + np.arange(int(np.ceil((furthest - nearest) * per_metre)) + 3) / per_metre
    offset = capture.radar.path_offset
    baseband = (waveform.frequencies - waveform.center_frequency) / SPEED_OF_LIGHT
    carrier = waveform.center_frequency / SPEED_OF_LIGHT
    weights = range_weights(window_pair(window)[0], waveform.samples_per_chirp)
    # Linear interpolation weakens the band towards its ends by sinc², which is undone beforehand.
    weights = weights / np.sinc(baseband / per_metre) ** 2
    cycles = np.multiply.outer(baseband, paths + offset) + carrier * offset
    steering = weights[:, None] / waveform.samples_per_chirp * np.exp(2j * np.pi * cycles)
    return steering.astype(np.complex64), per_metre
