"""What autofocus looks at: the rows of a path, short pieces of it, and how sharp they see some points."""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, product
from millisight.data import Capture, Trajectory
from millisight.imaging import _autofocus_kernels as kernels
from millisight.imaging._backprojection import OVERSAMPLING, path_bounds, range_steering
from millisight.imaging._path_rows import Row
from millisight.imaging._sparse_kernels import gather

_PIECE = 4.0  # wavelengths along the path
_JUMP = 5  # times the usual distance of neighbouring poses: the path is torn there
_BLOCK = 2000  # poses whose frames are read at a time


class Pieces(NamedTuple):
    """The path cut into short pieces.

    Attributes
    ----------
    order : (n,) poses, in the order of their times
    starts : (S + 1,) where each piece begins in `order`
    rows : (S,) number of the row that a piece is of
    way : (S,) distance travelled up to a piece's middle [m]
    """

    order: np.ndarray
    starts: np.ndarray
    rows: np.ndarray
    way: np.ndarray

    @classmethod
    def of(cls, trajectory: Trajectory, rows: list[Row], wavelength: float) -> "Pieces":
        """Each row, or each run of a path without rows, in pieces of about four wavelengths."""
        groups = [row.poses for row in rows]
        if not groups:
            order = np.argsort(trajectory.times, kind="stable")
            lengths = np.linalg.norm(np.diff(trajectory.positions[order], axis=0), axis=1)
            usual = np.median(lengths[lengths > 0]) if (lengths > 0).any() else 1.0
            groups = np.split(order, np.flatnonzero(lengths > _JUMP * usual) + 1)
        cuts, numbers = [0], []
        for number, poses in enumerate(groups):
            length = np.linalg.norm(np.diff(trajectory.positions[poses], axis=0), axis=1).sum()
            count = int(np.clip(round(length / (_PIECE * wavelength)), 1, len(poses)))
            cuts += [cuts[-1] + int(n) for n in np.linspace(0, len(poses), count + 1)[1:]]
            numbers += [number] * count
        order, starts = np.concatenate(groups), np.array(cuts)
        travelled = np.concatenate(
            [[0], np.cumsum(np.linalg.norm(np.diff(trajectory.positions[order], axis=0), axis=1))]
        )
        return cls(order, starts, np.array(numbers), np.add.reduceat(travelled, starts[:-1]) / np.diff(starts))

    def joined(self) -> "Pieces":
        """All as one piece."""
        return Pieces(self.order, self.starts[[0, -1]], self.rows[:1], self.way[:1])

    def thinned(self, every: int) -> "Pieces":
        """Those of each `every`th row alone."""
        kept = np.flatnonzero(self.rows % every == 0)
        lengths = np.diff(self.starts)[kept]
        runs = [self.order[self.starts[s] : self.starts[s + 1]] for s in kept]
        return Pieces(np.concatenate(runs), np.append(0, np.cumsum(lengths)), self.rows[kept], self.way[kept])

    def means(self, values: np.ndarray) -> np.ndarray:
        """(S, ...) means over pieces of values of the poses (P, ...)."""
        return np.add.reduceat(values[self.order], self.starts[:-1], axis=0) / np.diff(self.starts)[:, None]


class View(NamedTuple):
    """Pieces as some points see them.

    Attributes
    ----------
    real, imag : (S, V) fields of the pieces
    places : (S, 3) their middles [m]
    points : (3, V) [m]
    per_metre : turns of the phase per metre of distance, 2 f_c / c
    """

    real: np.ndarray
    imag: np.ndarray
    places: np.ndarray
    points: np.ndarray
    per_metre: np.floating

    @classmethod
    def of(cls, capture: Capture, pieces: Pieces, mean: np.ndarray, points: np.ndarray) -> "View":
        """Fields of a capture's pieces at points (V, 3) [m], what all frames have in common, `mean`, taken away."""
        origin = points.mean(axis=0)
        tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
        box = np.stack([points.min(axis=0), points.max(axis=0)]) - origin
        nearest, furthest = path_bounds(tx, rx, box)
        steering, per_metre = range_steering(capture, nearest, furthest, OVERSAMPLING, None)
        profiles = np.concatenate([
            product(np.ascontiguousarray(capture.frames_of(slice(start, start + _BLOCK)) - mean), steering)
            for start in range(0, len(tx), _BLOCK)
        ])  # fmt: skip
        fields = np.empty((len(pieces.starts) - 1, len(points)), np.complex64)
        local = np.ascontiguousarray((points - origin).T, dtype=np.float32)
        frequency = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT
        gather(
            profiles, np.float32(nearest), np.float32(per_metre), np.float32(frequency), tx.astype(np.float32),
            rx.astype(np.float32), pieces.order, pieces.starts, local, fields,
        )  # fmt: skip
        places = pieces.means((tx.mean(axis=1) + rx.mean(axis=1)) / 2).astype(np.float32)
        real, imag = (np.ascontiguousarray(part) for part in (fields.real, fields.imag))
        return cls(real, imag, places, local, np.float32(2 * frequency))

    def images(self, pieces: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(C, V) the sums over `pieces` (n,), displaced by `moves` (C, n, 3) [m]."""
        images = np.empty((2, len(moves), self.points.shape[1]), self.real.dtype)
        kernels.displaced_images(
            self.real, self.imag, self.places, pieces, self._typed(moves), self.points, self.per_metre, *images
        )
        return images[0] + 1j * images[1]

    def sharpness(self, moves: np.ndarray) -> tuple[float, np.ndarray]:
        """log of (sum of |I|³)^(1/3) with the pieces displaced by `moves` (S, 3) [m], and its gradient (S, 3) [1/m].

        The differential of the sum is Re sum_v conj(w) dI with w = 3 |I| I, and dI turns one phase a piece: the adjoint
        of backprojection, applied to w, gives all components at the cost of about one image.
        """
        image = self.images(np.arange(len(self.places)), moves[None])[0]
        size = np.abs(image).astype(float)
        cubes = float((size**3).sum())
        if not cubes > 0:
            return -np.inf, np.zeros(self.places.shape)
        weights = size * image / cubes
        scale = float(np.abs(weights).max())
        gradient = np.empty(self.places.shape, self.places.dtype)
        kernels.displaced_gradient(
            self.real, self.imag, self.places, self._typed(moves), self.points, self.per_metre,
            self._typed(weights.real / scale), self._typed(weights.imag / scale), gradient,
        )  # fmt: skip
        return float(np.log(cubes) / 3), scale * gradient.astype(float)

    def _typed(self, values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values, dtype=self.real.dtype)


def lobe(capture: Capture, place: np.ndarray) -> np.ndarray:
    """(3,) width of the main lobe at a place [m]: one over the span of the local frequencies."""
    from millisight.imaging._focus import local_frequencies

    span = np.ptp(local_frequencies(capture, capture.trajectory, place), axis=0)
    return 1 / np.maximum(span, 1e-3)
