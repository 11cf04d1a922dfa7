"""Direct backprojection: range profiles, then one interpolation and one phase a voxel-channel pair (primer 8)."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from millisight.core import SPEED_OF_LIGHT, check_device, share_of
from millisight.core.errors import InputError
from millisight.data import Capture, VoxelGrid
from millisight.imaging._check import Check, Deviation, of_whole
from millisight.imaging._lengths import boxes, grid_in
from millisight.imaging._refraction import Excess, excess_over
from millisight.imaging._windows import Window, aperture_weights, range_weights, window_pair

OVERSAMPLING = 8
"""Entries of a range profile per range bin c / B of path length: 0.2 % of error, see the tables of primer (8)."""

# One block of poses is held at a time: its frames and range profiles take at most this much [bytes], and its
# voxel-channel pairs at most about a second, so that progress shows and Ctrl-C is heard.
_BLOCK_BYTES = 256_000_000
_BLOCK_PAIRS = 1_000_000_000

# Values of the matrix that makes range profiles of frames: 1 GB, and some gigabytes while it is made; and values of one
# pose's range profiles.
_MOST_STEERING = 1 << 27

# Profiles of all poses start at one path length unless they are so many times longer by it.
_LONGER = 1.5


def backproject(
    capture: Capture,
    grid: VoxelGrid,
    *,
    window: Window = None,
    oversampling: int = OVERSAMPLING,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Complex[np.ndarray, "X Y Z"], Deviation]:
    """The image of a capture on a grid, as complex64 values, and its error; `ms.form_image` is the door to it.

    The capture may lie on disk: it is read in blocks of poses.
    """
    kernels = kernels_on(device)
    carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT
    image = np.empty(grid.shape, dtype=np.complex64)
    parts, deviations = boxes(grid, carrier), []
    for number, box in enumerate(parts):
        image[box], deviation = _backproject_box(
            kernels, capture, grid_in(grid, box), window, oversampling, share_of(progress, number, len(parts))
        )
        deviations.append(deviation)
    return image, of_whole(deviations)


def _backproject_box(
    kernels: Any,
    capture: Capture,
    grid: VoxelGrid,
    window: Window,
    oversampling: int,
    progress: Callable[[int, int], None] | None,
) -> tuple[np.ndarray, Deviation]:
    """(X, Y, Z) complex64 image on a grid that float32 can hold, and its error."""
    # Distances are float32: count coordinates from the grid's middle, wherever the world's origin may lie.
    origin = grid.bounds.mean(axis=0)
    voxels = [kernels.to_device(v) for v in np.ascontiguousarray((grid.points - origin).T, dtype=np.float32)]
    tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
    compression = range_compression(capture, tx, rx, grid.bounds - origin, oversampling, window, kernels)

    sums = kernels.zeros((2, grid.size))
    pairs = int(np.prod(capture.frames.shape[1:3])) * grid.size
    step = max(1, min(compression.poses_at_once, _BLOCK_PAIRS // pairs))
    carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT
    axes = tuple(axis - o for axis, o in zip((grid.x, grid.y, grid.z), origin, strict=True))
    check = Check(axes, tx, rx, oversampling)
    for block, frames in weighted_blocks(capture, step, window):
        profiles = compression.profiles(frames, block)
        scan = compression.nearest(block), compression.per_metre, carrier, tx[block], rx[block]
        # A GPU is waited for before its kernel starts, not after: the check then works beside it.
        checked = kernels.to_host(profiles)
        kernels.backproject(profiles, *scan, *voxels, sums[0], sums[1], compression.excess)
        check.add(checked, *scan, compression.excess, lambda: kernels.to_host(sums))
        if progress is not None:
            progress(block.stop, len(capture.trajectory))
    real, imag = kernels.to_host(sums)
    values = ((real + 1j * imag) / np.float32(capture.channels)).reshape(grid.shape)
    return values, check.deviation(kernels.to_host(sums))


class Compression(NamedTuple):
    """What turns frames into range profiles (primer 8).

    Attributes
    ----------
    kernels : of the device
    channels : of a pose
    steering : (N, M), as the device's `compress` wants it
    starts : (P, T) and (P, R), the transmitters' and the receivers' parts of the path length of entry 0 [m]
    baseband : (N,) (f - f_c) / c of the samples [1/m]; None where all profiles start at one path length
    per_metre : entries per metre of path length
    excess : what refraction adds to straight paths; None: nothing
    """

    kernels: Any
    channels: int
    steering: Any
    starts: tuple[np.ndarray, np.ndarray]
    baseband: np.ndarray | None
    per_metre: float
    excess: Excess | None = None

    def profiles(self, frames: np.ndarray, block: slice, out: np.ndarray | None = None) -> Any:
        """(P, T, R, M) complex64 range profiles of the frames of the poses `block`, on the device, or in `out`."""
        if self.baseband is not None:
            # What lies before a channel's entry 0 is taken away beforehand: the steering is one for all channels.
            to, back = (np.exp(2j * np.pi * np.multiply.outer(s, self.baseband)) for s in self.nearest(block))
            frames = frames * (to[:, :, None] * back[:, None]).astype(np.complex64)
        return self.kernels.compress(frames, self.steering, out)

    @property
    def poses_at_once(self) -> int:
        """How many poses' frames and range profiles are held at a time."""
        return max(1, _BLOCK_BYTES // (8 * self.channels * sum(self.steering.shape)))

    def nearest(self, block: slice) -> tuple[np.ndarray, np.ndarray]:
        """`starts` of the poses `block`."""
        return self.starts[0][block], self.starts[1][block]


def range_compression(
    capture: Capture,
    tx: Float[np.ndarray, "P T 3"],
    rx: Float[np.ndarray, "P R 3"],
    box: Float[np.ndarray, "2 3"],
    oversampling: int,
    window: Window,
    kernels: Any,
    order: tuple[int, ...] = (0, 1, 2),
) -> Compression:
    """Range compression for all paths over a box (2, 3).

    One span of path lengths serves all channels, unless it is much longer than what a single one sees of the box: then
    every channel's profile has a start of its own, and the antennas' distances cost no memory. `order`: of the world's
    axes in tx, rx and box.
    """
    channels = int(np.prod(capture.frames.shape[1:3]))
    excess = excess_over(capture, tx, rx, box, order)
    more = 0.0 if excess is None else excess.most
    (near_tx, far_tx), (near_rx, far_rx) = (
        (near - more, far + more) for near, far in (_reaches(antennas, box) for antennas in (tx, rx))
    )
    nearest, furthest = np.add(path_bounds(tx, rx, box), (-2 * more, 2 * more)).tolist()
    span = float(((far_tx - near_tx).max(axis=1) + (far_rx - near_rx).max(axis=1)).max())
    if furthest - nearest <= _LONGER * span:
        *steering, per_metre = _steering(capture, nearest, furthest, oversampling, window)
        starts = np.full(tx.shape[:2], nearest / 2), np.full(rx.shape[:2], nearest / 2)
        return Compression(kernels, channels, kernels.steering(*steering), starts, None, per_metre, excess)
    waveform = capture.radar.waveform
    *steering, per_metre = _steering(capture, 0.0, span, oversampling, window)
    baseband = (waveform.frequencies - waveform.center_frequency) / SPEED_OF_LIGHT
    starts = near_tx, near_rx
    return Compression(kernels, channels, kernels.steering(*steering), starts, baseband, per_metre, excess)


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
    (near_tx, far_tx), (near_rx, far_rx) = (_reaches(antennas, box) for antennas in (tx, rx))
    nearest = near_tx.min(axis=1) + near_rx.min(axis=1)
    return float(nearest.min()), float((far_tx.max(axis=1) + far_rx.max(axis=1)).max())


def _reaches(antennas: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, A) shortest and longest distance of antennas (P, A, 3) from a point of a box [m]."""
    lower, upper = box
    outside = np.maximum(np.maximum(lower - antennas, antennas - upper), 0)
    corner = np.maximum(np.abs(lower - antennas), np.abs(upper - antennas))
    return np.linalg.norm(outside, axis=-1), np.linalg.norm(corner, axis=-1)


def range_steering(
    capture: Capture, nearest: float, furthest: float, oversampling: int, window: Window
) -> tuple[Complex[np.ndarray, "N M"], float]:
    """The matrix (N, M) that turns frames into range profiles, and its entries per metre of path (primer 8).

    Entry m of a profile is the frame's answer at path length nearest + m / per_metre, range-compressed, the
    carrier's phase over the path removed (it turns too fast to interpolate) but not that over the path offset.

    Raises
    ------
    InputError
        The matrix would be too large, as a single stray pose makes it, or the range profiles of a pose, with very many
        receivers.
    """
    turns, matrix, per_metre = _steering(capture, nearest, furthest, oversampling, window)
    return (turns[:, None] * matrix).astype(np.complex64), per_metre


def _steering(
    capture: Capture, nearest: float, furthest: float, oversampling: int, window: Window
) -> tuple[np.ndarray, np.ndarray, float]:
    """`range_steering`'s matrix as the phases (N,) of the span's middle, and what is even about it (N, M)."""
    waveform = capture.radar.waveform
    bandwidth = waveform.bandwidth or SPEED_OF_LIGHT / max(furthest - nearest, 1.0)
    per_metre = oversampling * bandwidth / SPEED_OF_LIGHT
    # Two more entries than the span: one for the interpolation's far side, one for the rounding of float32.
    entries = int(np.ceil((furthest - nearest) * per_metre)) + 3
    rows = max(waveform.samples_per_chirp, int(np.prod(capture.frames.shape[1:3])))
    if entries * rows > _MOST_STEERING:
        raise InputError(
            f"the paths from antenna to grid and back are {nearest:.4g} to {furthest:.4g} m long; expected a span of "
            f"{_MOST_STEERING / rows / per_metre:.3g} m at most for this radar: remove positions "
            "that are far from the others, or choose a smaller grid"
        )
    middle = (entries - 1) / 2
    offset = capture.radar.path_offset
    baseband = (waveform.frequencies - waveform.center_frequency) / SPEED_OF_LIGHT
    carrier = waveform.center_frequency / SPEED_OF_LIGHT
    weights = range_weights(window_pair(window)[0], waveform.samples_per_chirp)
    # Linear interpolation weakens the band towards its ends by sinc², which is undone beforehand.
    weights = weights / np.sinc(baseband / per_metre) ** 2
    turns = np.exp(2j * np.pi * (baseband * (nearest + middle / per_metre + offset) + carrier * offset))
    around = np.exp(2j * np.pi * np.multiply.outer(baseband, (np.arange(entries) - middle) / per_metre))
    return turns, weights[:, None] / waveform.samples_per_chirp * around, per_metre
