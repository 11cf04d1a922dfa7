"""Factorised backprojection: the image in a cost that grows near linearly (primer 16).

Seen from a small sub-aperture, the field over the grid turns slowly once the phase of the sub-aperture's centre is
taken away. So the smallest sub-apertures are imaged by direct backprojection on coarse grids, and their fields are
interpolated to finer grids, given the phase of the next larger sub-aperture's centre, and added, until the last step
puts the whole phase back on the image's own grid. Positions may lie anywhere, antennas apart.

How coarse a grid may be follows from the geometry: the plan samples the local frequencies of the field and allows
what keeps the interpolation's error under a tolerance; sizes and number of levels are those of the least cost. Where
factorising does not pay, there is no plan, and direct backprojection does the work.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from millisight.capture.capture import Capture
from millisight.constants import SPEED_OF_LIGHT
from millisight.imaging.backprojection import (
    OVERSAMPLING,
    backproject,
    kernels_on,
    path_bounds,
    range_steering,
    weighted_blocks,
)
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.windows import Window

TOLERANCE = 0.006
"""Relative L2 error that the interpolations together may make."""

_TAPS = 8
_BAND = 0.6  # of the Nyquist frequency: where the interpolation's weights are optimal

# Nanoseconds and core: a voxel-channel pair in a leaf and in direct backprojection, a voxel of a merged field.
_COST_LEAF, _COST_DIRECT, _COST_MERGE = 1.8, 1.6, 3.0

# Range profiles are held for so many poses at a time [bytes].
_PROFILE_BYTES = 1_000_000_000


class Level(NamedTuple):
    """Sub-apertures of one size: their side [m], and the two coarse coordinate axes of their fields [m]."""

    size: float
    axes: tuple[np.ndarray, np.ndarray]


class Plan(NamedTuple):
    """Levels from the smallest sub-apertures up, the order of the grid's axes (the last one stays as fine as it
    is), and the estimated cost against that of direct backprojection."""

    levels: tuple[Level, ...]
    order: tuple[int, ...]
    gain: float


def fast(
    capture: Capture,
    grid: VoxelGrid,
    *,
    window: Window = None,
    oversampling: int = OVERSAMPLING,
    device: str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> tuple[np.ndarray, Plan | None]:
    """The image (X, Y, Z) complex64 and the plan that made it; `ms.form_image` is the door to it.

    Memory: range profiles of at most a gigabyte, and the fields of one largest sub-aperture's parts.
    """
    kernels = kernels_on(device)
    origin = grid.bounds.mean(axis=0)
    tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
    axes = tuple(axis - o for axis, o in zip((grid.x, grid.y, grid.z), origin, strict=True))
    plan = make_plan(tx, rx, axes, capture)
    if plan is None:
        values = backproject(
            capture, grid, window=window, oversampling=oversampling, device=device, progress=progress
        )  # fmt: skip
        return values, None

    first, second = plan.levels[0].axes
    inner = axes[plan.order[2]]
    turn = np.array(plan.order)
    box = np.array([[a[0], a[-1]] for a in (first, second, inner)]).T
    tx, rx = tx[..., turn], rx[..., turn]
    nearest, furthest = path_bounds(tx, rx, box)
    steering, per_metre = range_steering(capture, nearest, furthest, oversampling, window)
    carrier = np.float32(capture.radar.waveform.center_frequency / SPEED_OF_LIGHT)

    shape = tuple(len(axes[a]) for a in plan.order)
    image = kernels.zeros((2, 1, *shape))
    poses = len(capture.trajectory)
    channels = int(np.prod(capture.frames.shape[1:3]))
    many = max(1, min(poses, _PROFILE_BYTES // (8 * channels * steering.shape[1])))
    for start in range(0, poses, many):
        some = slice(start, min(start + many, poses))
        profiles = _range_profiles(kernels, capture, some, steering, window)
        scan = _Scan(profiles, tx[some], rx[some], nearest, per_metre, carrier)
        for done, total in _add_sub_apertures(kernels, scan, plan.levels, tuple(axes[a] for a in plan.order), image):
            if progress is not None:
                progress(start + (some.stop - start) * done // total, poses)
    real, imag = kernels.to_host(image)[:, 0]
    values = (real + 1j * imag) / np.float32(capture.channels)
    return np.ascontiguousarray(values.transpose(np.argsort(turn))), plan


class _Scan(NamedTuple):
    """What the kernels need to know of some poses, in the plan's order of axes."""

    profiles: Any
    tx: np.ndarray
    rx: np.ndarray
    nearest: float
    per_metre: float
    carrier: np.float32


def _range_profiles(kernels: Any, capture: Capture, some: slice, steering: np.ndarray, window: Window) -> Any:
    """(P, T, R, M) complex64 range profiles of the poses `some`, on the device; their frames are read in blocks."""
    shape = (some.stop - some.start, *capture.frames.shape[1:3], steering.shape[1])
    profiles = np.empty(shape, dtype=np.complex64)
    steering = kernels.to_device(steering)
    for block, frames in weighted_blocks(capture, 1000, window, some):
        profiles[block.start - some.start : block.stop - some.start] = kernels.to_host(
            kernels.product(frames, steering)
        )
    return kernels.to_device(profiles)


def _add_sub_apertures(
    kernels: Any, scan: _Scan, levels: tuple[Level, ...], axes: tuple[np.ndarray, ...], image: Any
) -> Iterator[tuple[int, int]]:
    """Add the image of a scan to `image` (2, 1, X, Y, Z), one largest sub-aperture after the other."""
    tx, rx, inner = (kernels.to_device(_f32(a)) for a in (scan.tx, scan.rx, axes[2]))
    middle = _middles(scan.tx, scan.rx)
    corner = middle.min(axis=0)
    tops = _cells(middle, corner, levels[-1].size)
    targets = [*(level.axes for level in levels[1:]), (axes[0], axes[1])]
    weights = [
        (*_axis_weights(level.axes[0], target[0]), *_axis_weights(level.axes[1], target[1]))
        for level, target in zip(levels, targets, strict=True)
    ]
    points = [kernels.to_device(_f32(p.ravel())) for p in np.meshgrid(*levels[0].axes, axes[2], indexing="ij")]
    for top in range(tops.max() + 1):
        members = np.flatnonzero(tops == top)
        cells = [_cells(middle[members], corner, level.size) for level in levels]
        centers = [_f32(_means(middle[members], cell)) for cell in cells]
        order = np.argsort(cells[0], kind="stable")
        fields = kernels.empty((2, len(centers[0]), *map(len, levels[0].axes), len(axes[2])))
        flat = fields.reshape(2, len(centers[0]), len(points[0]))
        kernels.leaf_fields(
            scan.profiles, np.float32(scan.nearest), np.float32(scan.per_metre), scan.carrier, tx, rx, members[order],
            _starts(cells[0]), centers[0], *points, flat[0], flat[1],
        )  # fmt: skip
        for n, (target, (base_1, weights_1, base_2, weights_2)) in enumerate(zip(targets, weights, strict=True)):
            last = n == len(levels) - 1
            # Which parent each child belongs to; in the last step all belong to the image.
            parent = np.zeros(len(centers[n]), dtype=np.int64)
            if not last:
                parent[cells[n]] = cells[n + 1]
            out = image if last else kernels.zeros((2, len(centers[n + 1]), *map(len, target), len(axes[2])))
            wide = kernels.empty((2, *fields.shape[1:3], len(target[1]), len(axes[2])))
            for part in (0, 1):
                kernels.interpolate_middle(fields[part], base_2, weights_2, wide[part])
            kernels.merge(
                wide[0], wide[1], np.argsort(parent, kind="stable"), _starts(parent), centers[n],
                centers[n] if last else centers[n + 1], not last, scan.carrier, base_1, weights_1,
                *map(_f32, target), inner, out[0], out[1],
            )  # fmt: skip
            fields = out
        yield top + 1, tops.max() + 1


def make_plan(
    tx: np.ndarray, rx: np.ndarray, axes: tuple[np.ndarray, ...], capture: Capture, tolerance: float = TOLERANCE
) -> Plan | None:
    """The cheapest levels for antennas tx (P, T, 3), rx (P, R, 3) and grid axes [m]; None where direct is cheaper."""
    waveform = capture.radar.waveform
    channels = capture.channels
    direct = _COST_DIRECT * channels * np.prod([len(a) for a in axes])
    middle = _middles(tx, rx)
    extent = np.ptp(middle, axis=0).max()
    if extent == 0 or channels < 100:
        return None
    # Coarse axes pay most where there are many voxels; the axis with the fewest stays as it is, innermost in memory.
    order = tuple(int(a) for a in np.argsort([-len(a) for a in axes], kind="stable"))
    turn = np.array(order)
    fine = (axes[order[0]], axes[order[1]])
    inner = axes[order[2]]

    # Candidate levels: sub-apertures of half the extent, a quarter, …, down to about one position each.
    levels, counts = [], []
    for halvings in range(1, 12):
        size = extent / 2**halvings * (1 + 1e-9)
        cells = _cells(middle, middle.min(axis=0), size)
        count = int(cells.max()) + 1
        if halvings > 1 and count > len(middle) / 1.5:
            break
        frequencies = _local_frequencies(tx, rx, middle, cells, axes, waveform)[:, turn]
        # Every level may make its share of the error; three levels are typical.
        steps = [_coarsest_step(frequencies[:, i], tolerance / np.sqrt(6)) for i in (0, 1)]
        levels.append(Level(size, (_coarse_axis(fine[0], steps[0]), _coarse_axis(fine[1], steps[1]))))
        counts.append(count)
    best, cheapest = None, direct / 1.2
    for leaf in range(len(levels)):
        for top in range(leaf + 1):
            chosen = levels[top : leaf + 1]
            sizes = [len(a) * len(b) * len(inner) for a, b in [fine, *(level.axes for level in chosen)]]
            cost = _COST_LEAF * channels * sizes[-1]
            cost += _COST_MERGE * sum(n * size for n, size in zip(counts[top : leaf + 1], sizes, strict=False))
            if cost < cheapest:
                best, cheapest = tuple(reversed(chosen)), cost
    return Plan(best, order, float(direct / cheapest)) if best else None


def _local_frequencies(tx, rx, middle, cells, axes, waveform) -> np.ndarray:
    """(n, 3) local frequencies [cycles/m] of sub-apertures' fields, less their centres' phase, at sampled places.

    A sample at frequency f adds exp(i 2 pi (f d - f_c d_s) / c), whose gradient is f_c (grad d - grad d_s) / c plus
    (f - f_c) grad d / c; f is taken in the middle of the band and near both ends.
    """
    centers = _means(middle, cells)[cells]
    poses = np.linspace(0, len(middle) - 1, min(len(middle), 100)).astype(int)
    places = np.stack(np.meshgrid(*[_spread(axis) for axis in axes], indexing="ij"), axis=-1).reshape(-1, 3)

    def towards(antennas):  # (places, poses, ..., 3) unit vectors from antennas to places
        difference = places.reshape(-1, *[1] * (antennas.ndim - 1), 3) - antennas
        return difference / np.maximum(np.linalg.norm(difference, axis=-1, keepdims=True), 1e-12)

    to, back = towards(tx[poses])[..., :, None, :], towards(rx[poses])[..., None, :, :]
    gradient = to + back
    slow = gradient - 2 * towards(centers[poses])[..., None, None, :]
    carrier = waveform.center_frequency / SPEED_OF_LIGHT
    band = waveform.bandwidth / 2 / SPEED_OF_LIGHT
    return np.concatenate([np.abs(carrier * slow + part * band * gradient).reshape(-1, 3) for part in (-0.8, 0, 0.8)])


def _spread(axis: np.ndarray) -> np.ndarray:
    return axis[np.unique(np.linspace(0, len(axis) - 1, 5).astype(int))]


def _coarsest_step(frequencies: np.ndarray, tolerance: float) -> float:
    """The largest step [m] at which interpolating waves of these frequencies errs by no more than `tolerance` (rms)."""
    turns = np.linspace(0, 1, 401)  # cycles a step
    errors = _interpolation_error(turns)
    steps = np.geomspace(1e-5, 1.0, 400)
    typical = np.quantile(frequencies, np.linspace(0, 1, 101))
    mean = np.sqrt(np.mean(np.interp(np.multiply.outer(steps, typical), turns, errors) ** 2, axis=1))
    within = steps[mean <= tolerance]
    return float(within[-1]) if len(within) else float(steps[0])


def _interpolation_error(turns: np.ndarray) -> np.ndarray:
    """Rms error, over all places between two samples, of interpolating a wave of so many cycles a sample."""
    places = _TAPS // 2 - 1 + np.linspace(0, 1, 17)
    samples = np.exp(2j * np.pi * np.multiply.outer(turns, np.arange(_TAPS)))
    exact = np.exp(2j * np.pi * np.multiply.outer(turns, places))
    return np.sqrt(np.mean(np.abs(samples @ _weights_at(places).T - exact) ** 2, axis=1))


def _weights_at(places: np.ndarray) -> np.ndarray:
    """(n, taps) weights that interpolate at `places` (n,), in samples from the first tap: the least mean squared
    error over all waves below the fraction `_BAND` of the Nyquist frequency."""
    taps = np.arange(_TAPS)
    normal = np.sinc(_BAND * (taps[:, None] - taps)) + 1e-9 * np.eye(_TAPS)
    return np.linalg.solve(normal, np.sinc(_BAND * (places[:, None] - taps)).T).T


def _coarse_axis(fine: np.ndarray, step: float) -> np.ndarray:
    """Even coordinates with one step of margin around `fine`, or `fine` itself where that is no coarser; at least
    as many as the interpolation has taps."""
    count = int(np.ceil((fine[-1] - fine[0]) / step - 1e-9)) + 3
    if count < max(len(fine), _TAPS + 1):
        axis = fine[0] + step * (np.arange(count) - 1)
    else:
        axis, step = fine, float(fine[-1] - fine[-2]) if len(fine) > 1 else step
    short = max(0, _TAPS - len(axis))
    return np.concatenate([axis, axis[-1] + step * np.arange(1, short + 1)])


def _axis_weights(coarse: np.ndarray, fine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First tap (n,) and float32 weights (n, taps) that carry a field from one axis to another."""
    last = len(coarse) - _TAPS
    if len(fine) <= len(coarse) and np.array_equal(coarse[: len(fine)], fine):
        base = np.minimum(np.arange(len(fine)), last)
        return base, np.eye(_TAPS, dtype=np.float32)[np.arange(len(fine)) - base]
    places = (fine - coarse[0]) / (coarse[1] - coarse[0])
    base = np.clip(np.floor(places).astype(np.int64) - _TAPS // 2 + 1, 0, last)
    return base, np.ascontiguousarray(_weights_at(places - base), dtype=np.float32)


def _middles(tx: np.ndarray, rx: np.ndarray) -> np.ndarray:
    """(P, 3) a pose's phase centre: half way between the means of its transmitters and its receivers."""
    return (tx.mean(axis=1) + rx.mean(axis=1)) / 2


def _cells(places: np.ndarray, corner: np.ndarray, size: float) -> np.ndarray:
    """(P,) number of the cube of side `size` that each place lies in, counted without gaps."""
    cube = np.floor((places - corner) / size).astype(np.int64)
    return np.unique(cube, axis=0, return_inverse=True)[1].reshape(-1)


def _means(places: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(cells, 3) mean place of each cell."""
    return np.stack([np.bincount(cells, places[:, i]) for i in range(3)], axis=1) / np.bincount(cells)[:, None]


def _starts(cells: np.ndarray) -> np.ndarray:
    """(n + 1,) where each cell's members begin once they are sorted by cell."""
    return np.concatenate([[0], np.cumsum(np.bincount(cells))])


def _f32(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float32)
