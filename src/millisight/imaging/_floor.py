"""The published imaging, kept for comparison: the nearest of 4096 range bins below, and one frequency's phase."""

from collections.abc import Callable

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, SarImage, VoxelGrid

FLOOR_BINS = 4096
_BLOCK = 512  # poses, whose profiles take 4 x 32 KiB each


def form_as_published(
    capture: Capture, grid: VoxelGrid, *, progress: Callable[[int, int], None] | None = None
) -> SarImage:
    """The image as the published code forms it, which is only roughly paper Eq. 1.

    Of each channel the range profile has 4096 bins, R_k = sum_j S_j exp(+i 2 pi j k / 4096). A voxel takes the bin at
    or below its path length d, with the phase of the first frequency: I(x) = 1 / P sum R_k exp(+i 2 pi f_0 d / c),
    k = floor(4096 d df / c). The sum is divided by the number of poses P, not of channels and samples. `form_image` has
    the right image.

    Parameters
    ----------
    capture : frames in memory, or on disk; of evenly spaced frequencies, without layers
    grid : voxels of the image
    progress : called with (poses done, poses in all)

    Raises
    ------
    InputError
        There are more samples than bins, or the capture looks through layers.
    """
    from millisight.imaging import _floor_kernels

    checked_record(capture, Capture, name="capture")
    points = checked_record(grid, VoxelGrid, name="grid").points
    waveform = capture.radar.waveform
    if waveform.samples_per_chirp > FLOOR_BINS:
        raise InputError(f"a chirp has {waveform.samples_per_chirp} samples; expected {FLOOR_BINS} at most")
    if capture.layers is not None:
        raise InputError("the capture looks through layers, which the published imaging does not know; use form_image")
    first, spacing = waveform.frequencies[0], waveform.slope / waveform.sample_rate
    poses = len(capture.trajectory)
    sums = np.zeros(len(points), np.complex128)
    for start in range(0, poses, _BLOCK):
        block = slice(start, min(start + _BLOCK, poses))
        # Of our sign the inverse transform, which NumPy divides by its length.
        profiles = np.fft.ifft(capture.frames_of(block), FLOOR_BINS, axis=-1) * FLOOR_BINS
        _floor_kernels.add_bins(
            np.ascontiguousarray(profiles, np.complex64),
            np.ascontiguousarray(capture.tx_positions[block]),
            np.ascontiguousarray(capture.rx_positions[block]),
            points,
            capture.radar.path_offset,
            FLOOR_BINS * spacing / SPEED_OF_LIGHT,
            first / SPEED_OF_LIGHT,
            sums,
        )
        if progress is not None:
            progress(block.stop, poses)
    values = (sums / poses).reshape(grid.shape).astype(np.complex64)
    settings = {"bins": FLOOR_BINS, "frequency": float(first), "divided_by": "poses"}
    return SarImage(grid=grid, values=values, metadata=with_step(capture.metadata, "form_as_published", **settings))
