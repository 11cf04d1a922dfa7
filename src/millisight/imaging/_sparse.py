"""Sparse reconstruction: an image from half or a quarter of the rows that plain backprojection needs.

Of all reflectivities q that explain the frames about as well, the one of the least sum of magnitudes:

    minimise  1/2 |A q - s|² / (K N) + weight * sum |q|

over complex voxels, with (A q)_kj = sum_v q_v exp(-i 2 pi f_j d_k(v) / c) and the frames s. It is solved by FISTA
(A. Beck and M. Teboulle, "A fast iterative shrinkage-thresholding algorithm for linear inverse problems", SIAM J.
Imaging Sciences 2 (2009)), its momentum restarted where it overshoots (B. O'Donoghue and E. Candès, "Adaptive restart
for accelerated gradient schemes", Foundations of Computational Mathematics 15 (2015)).

A is the transpose of direct backprojection down to the weights of its interpolation, so that <A q, s> = <q, A* s> holds
to float32 rounding; factorised backprojection is not used, since its transpose is another algorithm, and a pair that is
adjoint to 1 % only lets FISTA drift. The solver is twenty lines: a library would want real matrices, or a framework.

What FISTA finds is sharper than any image of the aperture, and grainy. It is therefore shown as an aperture without
gaps would see it: the image of the frames that were measured, and of rows between them whose frames q predicts.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_integer, checked_number, product
from millisight.core.errors import InputError
from millisight.data import Capture, Trajectory, VoxelGrid
from millisight.imaging._backprojection import OVERSAMPLING, path_bounds, range_steering
from millisight.imaging._path_rows import rows_of_path
from millisight.imaging._scale import at_usual_scale
from millisight.imaging._sparse_kernels import gather, project
from millisight.imaging._windows import Window, window_pair

ITERATIONS = 40
WEIGHT = 0.007
"""Of the sum of magnitudes, relative to the largest magnitude of the backprojected image."""

_POWER_STEPS = 8  # of the power method, for the operator's norm
_MARGIN = 1.1  # over the norm that it finds, which is a little low
_BLOCK_BYTES = 256_000_000
_MOST_CYCLES = 20_000.0  # of a path: float32 then errs by a thousandth of a wave
_MOST_BETWEEN = 16  # rows put between two that were measured
_ROW_SPACING = 0.57  # of those rows, in wavelengths: 2.2 mm at 77.5 GHz, as published scans have


class Operator:
    """Eq. 1's linear model A / sqrt(K N) of a capture's frames over a grid's voxels, and its adjoint.

    On this scale the adjoint of `scaled` frames is the backprojected image, in which a unit reflector has the value 1.
    Memory: range profiles of a block of poses, 256 MB at most; the frames, and as many again for their prediction.
    """

    def __init__(
        self, capture: Capture, grid: VoxelGrid, *, path: Trajectory | None = None, oversampling: int = OVERSAMPLING
    ):
        radar, path = capture.radar, capture.trajectory if path is None else path
        # Distances are float32: count coordinates from the grid's middle.
        origin = grid.bounds.mean(axis=0)
        self._voxels = np.ascontiguousarray((grid.points - origin).T, dtype=np.float32)
        tx, rx = (path.placed(antennas) - origin for antennas in (radar.array.tx_positions, radar.array.rx_positions))
        nearest, furthest = path_bounds(tx, rx, grid.bounds - origin)
        carrier = radar.waveform.center_frequency / SPEED_OF_LIGHT
        if furthest * carrier > _MOST_CYCLES:
            raise InputError(
                f'method="sparse" counts paths in float32, good for {_MOST_CYCLES / carrier:.3g} m at this frequency, '
                f'and the longest is {furthest / 1e3:.3g} km; use method="fast"'
            )
        steering, per_metre = range_steering(capture, nearest, furthest, oversampling, None)
        self.shape = (len(path), *capture.frames.shape[1:])
        self.voxels = grid.size
        self._steering = steering * np.float32(np.sqrt(self.shape[3] / np.prod(self.shape[:3])))
        self._back = np.ascontiguousarray(self._steering.conj().T)
        self._gram = product(self._back, self._steering)
        self._law = (np.float32(nearest), np.float32(per_metre), np.float32(carrier))
        self._tx, self._rx = tx.astype(np.float32), rx.astype(np.float32)
        per_pose = 8 * int(np.prod(self.shape[1:3])) * sum(steering.shape)
        self._step = int(max(1, _BLOCK_BYTES // per_pose))

    def scaled(self, frames: np.ndarray) -> np.ndarray:
        """(P, T, R, N) frames / sqrt(K N)."""
        return frames / np.float32(np.sqrt(frames.size))

    def forward(self, values: np.ndarray) -> np.ndarray:
        """(P, T, R, N) complex64 scaled frames of voxels (V,); voxels that are zero cost nothing."""
        frames = np.empty(self.shape, np.complex64)
        for block, profiles in self._projected(values):
            frames[block] = product(profiles, self._back)
        return frames

    def adjoint(self, frames: np.ndarray) -> np.ndarray:
        """(V,) complex64 from scaled frames (P, T, R, N)."""
        return self._gathered((b, product(np.ascontiguousarray(frames[b]), self._steering)) for b in self._blocks())

    def normal(self, values: np.ndarray) -> np.ndarray:
        """(V,) the adjoint of what `forward` makes of voxels (V,), without the frames between."""
        return self._gathered((b, product(profiles, self._gram)) for b, profiles in self._projected(values))

    def _projected(self, values: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Blocks of poses and their range profiles (p, T, R, M) complex64 of voxels (V,)."""
        some = np.flatnonzero(values)
        real, imag = (np.ascontiguousarray(part[some], dtype=np.float32) for part in (np.real(values), np.imag(values)))
        x, y, z = (np.ascontiguousarray(axis[some]) for axis in self._voxels)
        for block in self._blocks():
            profiles = np.empty((len(self._tx[block]), *self.shape[1:3], self._steering.shape[1]), np.complex64)
            project(real, imag, *self._law, self._tx[block], self._rx[block], x, y, z, profiles)
            yield block, profiles

    def _gathered(self, blocks: Iterable[tuple[slice, np.ndarray]]) -> np.ndarray:
        """(V,) complex64 from range profiles."""
        total, part = np.zeros(self.voxels, np.complex64), np.empty((1, self.voxels), np.complex64)
        for block, profiles in blocks:
            poses = np.arange(len(profiles))
            gather(
                profiles, *self._law, self._tx[block], self._rx[block], poses, np.array([0, len(poses)]),
                self._voxels, part,
            )  # fmt: skip
            total += part[0]
        return total

    def norm(self) -> float:
        """The largest eigenvalue of A* A, by the power method."""
        rng = np.random.default_rng(0)
        values = rng.standard_normal(self.voxels) + 1j * rng.standard_normal(self.voxels)
        size = 0.0
        for _ in range(_POWER_STEPS):
            values = self.normal((values / np.linalg.norm(values)).astype(np.complex64))
            size = float(np.linalg.norm(values))
        return _MARGIN * size

    def _blocks(self) -> list[slice]:
        return [slice(start, start + self._step) for start in range(0, self.shape[0], self._step)]


def sparse(
    capture: Capture,
    grid: VoxelGrid,
    *,
    window: Window = None,
    oversampling: int = OVERSAMPLING,
    weight: float = WEIGHT,
    iterations: int = ITERATIONS,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[np.ndarray, dict[str, float]]:
    """The image (X, Y, Z) complex64 and how it was found; `ms.form_image` is the door to it.

    Time: that of fifty to a hundred direct backprojections; voxels that are zero save some.
    Memory: the frames three times over, and blocks of range profiles.

    Parameters
    ----------
    weight : of the sum of magnitudes, relative to the largest magnitude of the backprojected image
    iterations : of FISTA
    progress : called with (steps done, steps in all)

    Raises
    ------
    InputError
        A window was asked for; the capture states each pose's antennas (`tx_points`); or the antennas are too
        far from the grid for float32.
    """
    if window_pair(window) != (None, None):
        raise InputError(f'method="sparse" takes no window, as its image has no gaps; window is {window!r}: pass None')
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError(
            'method="sparse" puts rows between those of a path, and this capture has antennas of its own at every pose '
            '(tx_points, rx_points); use method="fast"'
        )
    weight = checked_number(weight, name="weight", above=0)
    iterations = checked_integer(iterations, name="iterations")
    capture, scale = at_usual_scale(capture)
    model = Operator(capture, grid, oversampling=oversampling)
    steps = iterations + _POWER_STEPS + 2
    frames = model.scaled(capture.frames_of(slice(None)))
    image = model.adjoint(frames)
    threshold = np.float32(weight * np.abs(image).max())
    if not threshold > 0:
        return (image / np.float32(scale)).reshape(grid.shape), {"weight": weight, "iterations": 0, "misfit": 1.0}
    size = model.norm()
    for done, values in enumerate(solutions(model, image, threshold, size, iterations), _POWER_STEPS + 1):  # noqa: B007
        _report(progress, done, steps)
    unexplained = frames - model.forward(values)
    with np.errstate(over="ignore", invalid="ignore"):  # an image beyond float32 is refused as such
        misfit = float(np.linalg.norm(unexplained) / np.linalg.norm(frames))
    path = without_gaps(capture.trajectory, _ROW_SPACING * capture.radar.waveform.wavelength)
    full = Operator(capture, grid, path=path, oversampling=oversampling)
    # What q does not explain counts in the measured rows alone: with full weight it would bring their ghosts back.
    share = np.float32(len(capture.trajectory) / len(path))
    restored = full.normal(values) + share * model.adjoint(unexplained)
    _report(progress, steps, steps)
    found = {"weight": weight, "iterations": iterations, "misfit": round(misfit, 6)}
    return (restored / np.float32(scale)).reshape(grid.shape), found


def solutions(
    model: Operator, image: np.ndarray, threshold: float | np.floating, size: float, iterations: int
) -> Iterator[np.ndarray]:
    """FISTA's voxels (V,) complex64 after each iteration, from nothing.

    Parameters
    ----------
    image : (V,) the adjoint of the frames
    threshold : weight of the sum of magnitudes
    size : the operator's norm, or more
    """
    values = ahead = np.zeros_like(image)
    momentum = 1.0
    for _ in range(iterations):
        slope = model.normal(ahead) - image
        new = shrunk(ahead - slope / np.float32(size), threshold / size)
        if np.vdot(ahead - new, new - values).real > 0:  # it overshoots: forget the momentum
            momentum = 1.0
        faster = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + np.float32((momentum - 1) / faster) * (new - values)
        values, momentum = new, faster
        yield values


def without_gaps(path: Trajectory, spacing: float) -> Trajectory:
    """The path with as many rows between neighbouring ones as bring them nearest to `spacing` [m]; itself without rows.

    Their frames are not known: it is the path of a prediction.
    """
    rows = rows_of_path(path)
    if len(rows) < 2:
        return path
    positions, numbers = [path.positions], [np.arange(len(path))]
    for one, next_one in pairwise(rows):
        way = one.step / np.linalg.norm(one.step)
        here, there = (row.poses[np.argsort(path.positions[row.poses] @ way)] for row in (one, next_one))
        there = there[np.linspace(0, len(there) - 1, len(here)).round().astype(int)]
        across = path.positions[there] - path.positions[here]
        gap = np.median(np.linalg.norm(across - np.outer(across @ way, way), axis=1))
        count = min(round(gap / spacing), _MOST_BETWEEN)
        for part in np.arange(1, count) / count:
            positions.append(path.positions[here] + part * across)
            numbers.append(here)
    number = np.concatenate(numbers)
    turned = None if path.orientations is None else path.orientations[number]
    return Trajectory(times=path.times[number], positions=np.concatenate(positions), orientations=turned)


def shrunk(values: np.ndarray, threshold: float | np.floating) -> np.ndarray:
    """Complex values with their magnitudes less `threshold`, not below zero; phases kept."""
    size = np.abs(values)
    return values * (np.maximum(size - threshold, 0) / np.maximum(size, 1e-30)).astype(np.float32)


def _report(progress: Callable[[int, int], None] | None, done: int, steps: int) -> None:
    if progress is not None:
        progress(done, steps)
