"""The door to the imagers: `form_image`."""

import logging
from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np

from millisight.core import check_device, checked_integer, checked_number, checked_record, with_step
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Capture, SarImage, VoxelGrid
from millisight.imaging._accuracy import (
    MOST_OVERSAMPLING,
    estimated_oversampling,
    finer,
    profile_error,
    some_of,
)
from millisight.imaging._backprojection import OVERSAMPLING, backproject, weighted_blocks
from millisight.imaging._exact import image_at
from millisight.imaging._fast import fast
from millisight.imaging._refraction import check_behind
from millisight.imaging._sampling import steps_of
from millisight.imaging._sides import antennas_of
from millisight.imaging._windows import Window, range_weights, window_pair

logger = logging.getLogger(__name__)

Method = Literal["fast", "backprojection", "exact", "sparse"]
METHODS: tuple[str, ...] = get_args(Method)

TOLERANCE = 0.005
"""Relative L2 error of an image, where none is asked for."""

_TOLERANCES = (0.0005, 0.1)

# Of the tolerance: what the whole may err by, as measured, and what range profiles alone may. The margin is for other
# voxels than those of the measurement: 11 images of 2 547 erred by more than 1.35 times what was stated.
_WHOLE, _PROFILES = 0.7, 0.55


def form_image(
    capture: Capture,
    grid: VoxelGrid,
    *,
    method: Method | str = "fast",
    window: Window = None,
    tolerance: float | None = None,
    oversampling: int | None = None,
    device: Literal["cpu", "cuda"] | str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> SarImage:
    """Form a 3-D image from the frames of a capture (paper Eq. 1, primer 4).

    Parameters
    ----------
    capture : frames in memory, or on disk (`ms.open_capture`), then read in blocks
    grid : voxels of the image, in the world frame
    method : "fast": factorised backprojection, or direct where that is not slower (the metadata states which);
        "backprojection": direct; "exact": the reference in float64, about a thousand times slower; "sparse": for scans
        with half or a quarter of the rows, about a hundred times slower than "backprojection" (`sparse`)
    window : None, "hann" or "taylor" over range and aperture, or a pair of them (range, aperture) (primer 9)
    tolerance : largest relative L2 error of the image against "exact", at random voxels and at the brightest, from
        0.0005 to 0.1; default 0.005. It determines the oversampling, and for "fast" the sub-apertures and their grids.
        The metadata state the measured error. Not for "exact" and "sparse"
    oversampling : entries of a range profile per range bin, instead of the number from the tolerance; not for "exact"
    device : "cpu", or "cuda" for "fast" and "backprojection" where there is a GPU
    progress : called with (poses done, poses in all)

    Returns
    -------
    SarImage
        Normalised so that a unit reflector has the value 1 at its position. It tells the scan's `steps`.

    Raises
    ------
    UnknownNameError, InputError
        An argument is invalid, or the frames hold NaN.
    DeviceError
        `device` is "cuda", and there is no usable GPU.

    Examples
    --------
    >>> from millisight.data import Radar
    >>> from millisight.simulation import simulate
    >>> from millisight.data import Trajectory
    >>> from millisight.data import Scene
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
    if not isinstance(method, str) or method not in METHODS:
        raise UnknownNameError("imaging method", method, METHODS)
    if method in ("exact", "sparse") and device == "cuda":
        raise InputError(f'method="{method}" runs on the CPU alone; leave device="cuda" out')
    if method in ("exact", "sparse") and tolerance is not None:
        raise InputError(f'method="{method}" has no tolerance; leave tolerance out, or use "fast"')
    check_device(device)
    check_behind(capture, grid)
    if oversampling is not None:
        oversampling = checked_integer(oversampling, name="oversampling")
    if oversampling is not None and tolerance is not None:
        raise InputError("tolerance and oversampling are both given; pass one: the tolerance decides the oversampling")
    frequency = float(capture.radar.waveform.center_frequency)
    settings: dict[str, Any] = {"method": method, "window": list(window_pair(window)), "frequency": frequency}
    if method == "exact":
        values = _exact(capture, grid, window, progress)
    elif method == "sparse":
        if capture.layers is not None and capture.layers.error > capture.radar.waveform.wavelength / 20:
            raise InputError(
                f'method="sparse" approximates refracted paths as straight, with an error of '
                f"{capture.layers.error * 1e3:.2g} mm here, more than a twentieth of the wavelength; use another method"
            )
        from millisight.imaging._sparse import sparse  # Numba and SciPy: not for --help

        settings["oversampling"] = OVERSAMPLING if oversampling is None else int(oversampling)
        values, settings["solver"] = sparse(
            capture, grid, window=window, oversampling=settings["oversampling"], progress=progress
        )
    else:
        wanted = TOLERANCE if tolerance is None else check_tolerance(tolerance)
        values, told = _within(
            wanted, capture, grid, method, window, None if oversampling is None else int(oversampling), device, progress
        )
        settings |= {"tolerance": wanted, **told}
    steps = () if method == "sparse" else steps_of(capture)  # "sparse" leaves no ghosts to tell of
    if steps:
        settings["steps"] = list(steps)
    settings["antennas"] = antennas_of(capture).tolist()
    values.flags.writeable = False
    return SarImage(grid=grid, values=values, metadata=with_step(capture.metadata, "form_image", **settings))


def check_tolerance(tolerance: float) -> float:
    """`tolerance` as a number; `InputError` before any work where no image can be formed with it."""
    value = checked_number(tolerance, name="tolerance")
    if not _TOLERANCES[0] <= value <= _TOLERANCES[1]:
        raise InputError(
            f"tolerance is {value:g}; expected {_TOLERANCES[0]:g} to {_TOLERANCES[1]:g}, an image's relative error: "
            'for less, use method="exact"'
        )
    return value


def _within(
    tolerance: float,
    capture: Capture,
    grid: VoxelGrid,
    method: str,
    window: Window,
    oversampling: int | None,
    device: str,
    progress: Callable[[int, int], None] | None,
) -> tuple[np.ndarray, dict[str, object]]:
    """The image by "fast" or "backprojection", within the tolerance, and what the metadata say of it."""
    fixed = oversampling is not None
    oversampling = oversampling or estimated_oversampling(_PROFILES * tolerance)
    profiles = profile_error(capture, grid, some_of(grid), window, oversampling)
    while not fixed and profiles > _PROFILES * tolerance and oversampling < MOST_OVERSAMPLING:
        oversampling = finer(oversampling, profiles, _PROFILES * tolerance)
        profiles = profile_error(capture, grid, some_of(grid), window, oversampling)
    expected, rising = profiles, None if progress is None else _rising(progress)
    while True:
        told: dict[str, object] = {"oversampling": oversampling}
        if method == "fast":
            values, plan, deviation = fast(
                capture, grid, window=window, oversampling=oversampling, tolerance=_WHOLE * tolerance,
                profiles=expected, device=device, progress=rising,
            )  # fmt: skip
            # What was done, with the sides of the sub-apertures [m].
            told["done_by"] = "backprojection" if plan is None else "factorised backprojection"
            told["sub_apertures"] = [round(float(level.size), 5) for level in plan.levels] if plan else []
        else:
            values, deviation = backproject(
                capture, grid, window=window, oversampling=oversampling, device=device, progress=rising
            )
        error, theirs = deviation.error, deviation.profile_error
        # Finer profiles help where it is they that err: now measured with all channels, and at the brightest as well.
        done = error <= _WHOLE * tolerance or not deviation.by_profiles
        if fixed or done or oversampling >= MOST_OVERSAMPLING:
            stated = float(f"{max(error, profiles):.3g}")
            if stated > tolerance and not fixed:
                logger.warning(
                    "this image errs by %g of its norm, and not by at most %g: float32 allows no less here; use "
                    'method="exact"', stated, tolerance,
                )  # fmt: skip
            return values, {**told, "error": stated}
        again = finer(oversampling, theirs, _PROFILES * tolerance)
        profiles = profile_error(capture, grid, some_of(grid), window, again)
        expected = max(profiles, theirs * (oversampling / again) ** 2)
        oversampling = again


def _rising(progress: Callable[[int, int], None]) -> Callable[[int, int], None]:
    """What reports progress only beyond the furthest so far: an image that is formed again does not go back."""
    furthest = 0.0

    def report(done: int, total: int) -> None:
        nonlocal furthest
        if done / total > furthest:
            furthest = done / total
            progress(done, total)

    return report


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
            frames * taper, tx[block], rx[block], waveform.frequencies, grid.points, capture.radar.path_offset,
            layers=capture.layers,
        )  # fmt: skip
        total += share * values
        if progress is not None:
            progress(block.stop, poses)
    return total.reshape(grid.shape).astype(np.complex64)
