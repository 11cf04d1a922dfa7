"""The door to the imagers: `form_image`."""

from collections.abc import Callable

import numpy as np

from millisight.capture.capture import Capture
from millisight.device import check_device
from millisight.errors import InputError, UnknownNameError
from millisight.imaging.backprojection import OVERSAMPLING, backproject, weighted_blocks
from millisight.imaging.exact import image_at
from millisight.imaging.fast import fast
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.image import SarImage
from millisight.imaging.windows import Window, range_weights, window_pair
from millisight.records import checked_record, with_step

METHODS = ("fast", "backprojection", "exact")


def form_image(
    capture: Capture,
    grid: VoxelGrid,
    *,
    method: str = "fast",
    window: Window = None,
    oversampling: int = OVERSAMPLING,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> SarImage:
    """Fuse a capture's frames into a 3-D image (paper Eq. 1, primer 4).

    Parameters
    ----------
    capture : frames in memory, or on disk (`ms.open_capture`), then read in blocks
    grid : the voxels wanted, in the world frame
    method : "fast": factorised backprojection, within 1 % of "exact", direct where that is no slower (the metadata
        says which); "backprojection": direct, 0.2 %; "exact": float64, the yardstick, some thousand times slower
    window : None, "hann" or "taylor" over range and aperture, or a pair of them (range, aperture) (primer 9)
    oversampling : entries of a range profile per range bin; not for "exact"
    device : "cpu", or "cuda" for "fast" and "backprojection" where there is a GPU
    progress : called with (poses done, poses in all)

    Returns
    -------
    SarImage
        Normalised so that a unit reflector has the value 1 at its place.

    Raises
    ------
    UnknownNameError, InputError
        An argument cannot be right, or the frames hold NaN.
    DeviceError
        "cuda" was asked for, and there is no GPU that can be used.

    Examples
    --------
    >>> from millisight.capture.radar import Radar
    >>> from millisight.capture.simulate import simulate
    >>> from millisight.capture.trajectory import Trajectory
    >>> from millisight.scene.scene import Scene
    >>> capture = simulate(
    ...     Scene.from_mesh("golf_ball", vertices=300),
    ...     Radar.preset("mito-sim-24ghz"),
    ...     Trajectory.raster(size=(0.1, 0.1), step=0.01),
    ... )
    >>> form_image(capture, VoxelGrid.regular((-0.05, -0.05, 0), (0.05, 0.05, 0), 0.01)).values.shape
    (11, 11, 1)
    """
    checked_record(capture, Capture, name="capture")
    checked_record(grid, VoxelGrid, name="grid")
    if method == "exact" and device == "cuda":
        raise InputError('method="exact" is float64 on the CPU alone; leave device="cuda" out')
    check_device(device)
    if int(oversampling) != oversampling or oversampling < 1:
        raise InputError(f"oversampling is {oversampling}; expected a whole number of at least 1")
    settings: dict[str, object] = {"method": method, "window": list(window_pair(window))}
    if method == "exact":
        values = _exact(capture, grid, window, progress)
    elif method == "backprojection":
        values = backproject(
            capture, grid, window=window, oversampling=int(oversampling), device=device, progress=progress
        )
        settings["oversampling"] = int(oversampling)
    elif method == "fast":
        values, plan = fast(
            capture, grid, window=window, oversampling=int(oversampling), device=device, progress=progress
        )
        settings["oversampling"] = int(oversampling)
        # What was done, with the sides of the sub-apertures [m].
        settings["done_by"] = "backprojection" if plan is None else "factorised backprojection"
        settings["sub_apertures"] = [] if plan is None else [round(float(level.size), 5) for level in plan.levels]
    else:
        raise UnknownNameError("imaging method", method, METHODS)
    values.flags.writeable = False
    return SarImage(grid=grid, values=values, metadata=with_step(capture.metadata, "form_image", **settings))


def _exact(
    capture: Capture, grid: VoxelGrid, window: Window, progress: Callable[[int, int], None] | None
) -> np.ndarray:
    """Eq. 1 over the whole grid in float64, rounded to complex64."""
    waveform = capture.radar.waveform
    tx, rx = capture.tx_positions, capture.rx_positions
    taper = range_weights(window_pair(window)[0], waveform.samples_per_chirp)
    total = np.zeros(grid.size, dtype=np.complex128)
    poses = len(capture.trajectory)
    # A handful of blocks, whose frames are converted to complex128 one at a time.
    for block, frames in weighted_blocks(capture, max(1, poses // 64), window):
        share = (block.stop - block.start) / poses
        values = image_at(
            frames * taper, tx[block], rx[block], waveform.frequencies, grid.points, capture.radar.path_offset
        )
        total += share * values
        if progress is not None:
            progress(block.stop, poses)
    return total.reshape(grid.shape).astype(np.complex64)
