"""Factorised backprojection: the image in a cost that grows near linearly (primer 16).

Seen from a small sub-aperture, the field over the grid turns slowly once the phase of the sub-aperture's centre is
taken away. So the smallest sub-apertures are imaged by direct backprojection on coarse grids, and their fields are
interpolated to finer grids, given the phase of the next larger sub-aperture's centre, and added, until the last step
puts the whole phase back on the image's own grid. Positions may lie anywhere, antennas apart.

Sizes, spacings and the number of levels are `_plan`'s, by a probe of the interpolations' error; once formed, the image
is checked at random voxels and at its brightest (`_check`). Where factorising does not pay, or errs by too much, direct
backprojection does the work.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, share_of
from millisight.data import Capture, VoxelGrid
from millisight.imaging._backprojection import (
    Compression,
    backproject,
    kernels_on,
    range_compression,
    weighted_blocks,
)
from millisight.imaging._check import Check, Deviation, of_whole
from millisight.imaging._lengths import antenna_rows, boxes, grid_in, rows_of_pairs
from millisight.imaging._plan import Plan, Planner, cells_of, means_of, middles, order_of, part_of
from millisight.imaging._refraction import Excess
from millisight.imaging._taps import axis_weights
from millisight.imaging._windows import Window

# Range profiles are held for so many poses at a time [bytes].
_PROFILE_BYTES = 1_000_000_000

_ATTEMPTS = 3  # plans that are tried before direct backprojection does it

# Of the tolerance, what the first plan may take: where it is dark an image errs by more than the waves of the probe,
# and a finer plan costs little beside a second image.
_PLANNED = 0.55

_SPENT = 0.9  # of the tolerance, what range profiles may take before another plan is tried


class Factorised(NamedTuple):
    """An image and how it was made.

    Attributes
    ----------
    values : (X, Y, Z) complex64
    plan : None where direct backprojection did all of it; where the grid was imaged in boxes, the first plan
    deviation : as measured at random voxels and at the brightest
    """

    values: np.ndarray
    plan: Plan | None
    deviation: Deviation


def fast(
    capture: Capture,
    grid: VoxelGrid,
    *,
    window: Window,
    oversampling: int,
    tolerance: float,
    profiles: float,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> Factorised:
    """The image, within `tolerance` unless its range profiles alone err by more; `ms.form_image` is the door to it.

    `profiles` is what they err by as far as is known beforehand.

    Memory: range profiles of at most a gigabyte, and the fields of one group of positions.
    """
    image = np.empty(grid.shape, dtype=np.complex64)
    parts = boxes(grid, capture.radar.waveform.center_frequency / SPEED_OF_LIGHT)
    plans, deviations = [], []
    for number, box in enumerate(parts):
        image[box], plan, deviation = _fast_box(
            capture, grid_in(grid, box), window, oversampling, tolerance, profiles, device,
            share_of(progress, number, len(parts)),
        )  # fmt: skip
        deviations.append(deviation)
        if plan is not None:
            plans.append(plan)
    return Factorised(image, plans[0] if plans else None, of_whole(deviations))


def _fast_box(
    capture: Capture,
    grid: VoxelGrid,
    window: Window,
    oversampling: int,
    tolerance: float,
    profiles: float,
    device: str,
    progress: Callable[[int, int], None] | None,
) -> Factorised:
    """The image on a grid that float32 can hold."""
    origin = grid.bounds.mean(axis=0)
    tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
    axes = tuple(axis - o for axis, o in zip((grid.x, grid.y, grid.z), origin, strict=True))
    # The errors of range profiles and of factorising have nothing to do with each other: their squares add up.
    planned = _PLANNED * float(np.sqrt(max(tolerance**2 - profiles**2, 0.0)))
    planner = Planner(tx, rx, capture, device=device)
    for _ in range(_ATTEMPTS):
        parts = _parts(planner, axes, planned)
        if not parts:
            break
        values, deviation = _factorise(kernels_on(device), capture, tx, rx, axes, parts, window, oversampling, progress)
        # Where the range profiles take it all, no plan helps: others are tried once these are finer.
        spent = deviation.by_profiles and deviation.profile_error > _SPENT * tolerance
        if deviation.error <= tolerance or spent:
            return Factorised(values, parts[0].plan, deviation)
        planned *= 0.7 * tolerance / deviation.error
    values, deviation = backproject(
        capture, grid, window=window, oversampling=oversampling, device=device, progress=progress
    )
    return Factorised(values, None, deviation)


class _Part(NamedTuple):
    """A slice of the grid's innermost axis, and how it is imaged."""

    along: slice
    plan: Plan


def _parts(planner: Planner, axes: tuple[np.ndarray, ...], tolerance: float) -> list[_Part]:
    """The parts that a grid is imaged in; none where direct backprojection is cheaper."""
    inner = order_of(axes)[2]
    slices = planner.parts(axes)
    whole = [slice(0, len(axes[inner]))]
    for some in [slices, whole] if len(slices) > 1 else [whole]:
        plans = [planner.plan(part_of(axes, inner, along), tolerance) for along in some]
        made = [_Part(along, plan) for along, plan in zip(some, plans, strict=True) if plan is not None]
        if len(made) == len(some):
            return made
    return []


def _factorise(
    kernels: Any,
    capture: Capture,
    tx: np.ndarray,
    rx: np.ndarray,
    axes: tuple[np.ndarray, ...],
    parts: list[_Part],
    window: Window,
    oversampling: int,
    progress: Callable[[int, int], None] | None,
) -> tuple[np.ndarray, Deviation]:
    """The image (X, Y, Z) complex64 by the plans of its parts, and its error."""
    order = parts[0].plan.order
    turn = np.array(order)
    fine = tuple(axes[a] for a in order)
    reached = [*zip(*(part.plan.levels[0].axes for part in parts), strict=True), ()]  # by the coarse grids
    box = np.array(
        [[min(axis[0] for axis in some), max(axis[-1] for axis in some)]
         for some in ((axis, *coarse) for axis, coarse in zip(fine, reached, strict=True))]
    ).T  # fmt: skip
    tx, rx = tx[..., turn], rx[..., turn]
    compression = range_compression(capture, tx, rx, box, oversampling, window, kernels, order)
    carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT

    images = [kernels.zeros((2, 1, len(fine[0]), len(fine[1]), part.along.stop - part.along.start)) for part in parts]

    def whole() -> np.ndarray:
        return np.concatenate([kernels.to_host(image)[:, 0] for image in images], axis=3)

    poses = len(capture.trajectory)
    channels = int(np.prod(capture.frames.shape[1:3]))
    many = max(1, min(poses, _PROFILE_BYTES // (8 * channels * compression.steering.shape[1])))
    check = Check(fine, tx, rx, oversampling)
    for start in range(0, poses, many):
        some = slice(start, min(start + many, poses))
        profiles = _range_profiles(capture, some, compression, window)
        nearest = compression.nearest(some)
        rows = rows_of_pairs(tx[some], rx[some], nearest, compression.per_metre, carrier)
        scan = _Scan(
            kernels.to_device(profiles),
            tx[some],
            rx[some],
            *rows,
            np.float32(compression.per_metre),
            np.float32(carrier),
            compression.excess,
        )
        for number, (part, image) in enumerate(zip(parts, images, strict=True)):
            for done, total in _add_sub_apertures(kernels, scan, part.plan, (*fine[:2], fine[2][part.along]), image):
                if progress is not None:
                    progress(start + (some.stop - start) * (number * total + done) // (total * len(parts)), poses)
        check.add(
            profiles, nearest, compression.per_metre, carrier, tx[some], rx[some], compression.excess, whole
        )  # fmt: skip
    real, imag = both = whole()
    values = (real + 1j * imag) / np.float32(capture.channels)
    return np.ascontiguousarray(values.transpose(np.argsort(turn))), check.deviation(both)


class _Scan(NamedTuple):
    """What the kernels need to know of some poses, in the plan's order of axes: antennas' positions and rows."""

    profiles: Any
    tx: np.ndarray
    rx: np.ndarray
    tx_rows: np.ndarray
    rx_rows: np.ndarray
    per_metre: np.float32
    carrier: np.float32
    excess: Excess | None


def _range_profiles(capture: Capture, some: slice, compression: Compression, window: Window) -> np.ndarray:
    """(P, T, R, M) complex64 range profiles of the poses `some`; their frames are read in blocks."""
    shape = (some.stop - some.start, *capture.frames.shape[1:3], compression.steering.shape[1])
    profiles = np.empty(shape, dtype=np.complex64)
    for block, frames in weighted_blocks(capture, min(1000, compression.poses_at_once), window, some):
        compression.profiles(frames, block, profiles[block.start - some.start : block.stop - some.start])
    return profiles


def _add_sub_apertures(
    kernels: Any, scan: _Scan, plan: Plan, axes: tuple[np.ndarray, ...], image: Any
) -> Iterator[tuple[int, int]]:
    """Add the image of a scan to `image` (2, 1, X, Y, Z), one group of positions after the other."""
    levels = plan.levels
    tx, rx, inner = (kernels.to_device(a) for a in (scan.tx_rows, scan.rx_rows, _f32(axes[2])))
    middle = middles(scan.tx, scan.rx)
    corner = middle.min(axis=0)
    groups = cells_of(middle, corner, plan.group)
    targets = [*(level.axes for level in levels[1:]), (axes[0], axes[1])]
    weights = [
        [axis_weights(*pair, plan.band) for pair in zip(level.axes, target, strict=True)]
        for level, target in zip(levels, targets, strict=True)
    ]
    points = [kernels.to_device(_f32(p.ravel())) for p in np.meshgrid(*levels[0].axes, axes[2], indexing="ij")]
    buffers = _Buffers(kernels)
    for group in range(groups.max() + 1):
        members = np.flatnonzero(groups == group)
        cells = [cells_of(middle[members], corner, level.size) for level in levels]
        centers = [antenna_rows(means_of(middle[members], cell), 0.0, 0.0, 0.0) for cell in cells]
        order = np.argsort(cells[0], kind="stable")
        fields = buffers.take(0, 2, len(centers[0]), *map(len, levels[0].axes), len(axes[2]))
        flat = fields.reshape(2, len(centers[0]), len(points[0]))
        kernels.leaf_fields(
            scan.profiles, scan.per_metre, scan.carrier, tx, rx, members[order], _starts(cells[0]), centers[0],
            *points, flat[0], flat[1], scan.excess,
        )  # fmt: skip
        for n, (target, pair) in enumerate(zip(targets, weights, strict=True)):
            last = n == len(levels) - 1
            # Which parent each child belongs to; in the last step all belong to the image.
            parent = np.zeros(len(centers[n]), dtype=np.int64)
            if not last:
                parent[cells[n]] = cells[n + 1]
            shape = () if last else (2, len(centers[n + 1]), *map(len, target), len(axes[2]))
            out = image if last else buffers.take(n + 1, *shape)
            kernels.merge(
                fields, np.argsort(parent, kind="stable"), _starts(parent), centers[n],
                centers[n] if last else centers[n + 1], not last, scan.carrier, *pair, *map(_f32, target), inner, out,
            )  # fmt: skip
            fields = out
        yield group + 1, groups.max() + 1


class _Buffers:
    """Arrays that are used again for one group after the other: new memory costs more than the work."""

    def __init__(self, kernels: Any):
        self._kernels, self._kept = kernels, {}

    def take(self, name: int, *shape: int) -> Any:
        """An array of that shape, with anything in it; what was taken by this name before is lost."""
        size = int(np.prod(shape))
        if name not in self._kept or self._kept[name].size < size:
            self._kept[name] = self._kernels.empty((size,))
        return self._kept[name][:size].reshape(shape)


def _starts(cells: np.ndarray) -> np.ndarray:
    """(n + 1,) where each cell's members begin once they are sorted by cell."""
    return np.concatenate([[0], np.cumsum(np.bincount(cells))])


def _f32(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float32)
