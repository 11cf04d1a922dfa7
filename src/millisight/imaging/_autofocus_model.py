"""What autofocus looks at: the rows of a path, short pieces of it, and how sharp they see some points."""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, product
from millisight.data import Capture, Trajectory, VoxelGrid
from millisight.imaging import _autofocus_kernels as kernels
from millisight.imaging._backprojection import OVERSAMPLING, path_bounds, range_steering
from millisight.imaging._path_rows import Row as Row
from millisight.imaging._path_rows import rows_of_path as rows_of_path
from millisight.imaging._sparse_kernels import gather

_PIECE = 4.0  # wavelengths along the path
_JUMP = 5  # times the usual distance of neighbouring poses: the path is torn there
_SHORTEST_ROW = 0.5  # of the extent along the rows
_DARK = 1e-3  # of the mean power, under which a voxel is dark
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
        """Each row, or each run of a path without rows, in pieces of 2.4 wavelengths at most."""
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

    def image(self, moves: np.ndarray) -> np.ndarray:
        """(V,) the sum over pieces, displaced by `moves` (S, 3) [m]."""
        image = np.empty((2, self.points.shape[1]), self.real.dtype)
        kernels.displaced_image(
            self.real, self.imag, self.places, self._typed(moves), self.points, self.per_metre,
            np.arange(len(self.places)), *image,
        )  # fmt: skip
        return image[0] + 1j * image[1]

    def contrast(self, moves: np.ndarray) -> tuple[float, np.ndarray]:
        """How sharp the image is, and the gradient of that (S, 3) [1/m]: log of sqrt(sum of |I|²) / sum of |I|.

        It is high where few voxels hold the energy and the others are dark. (The sum of |I|⁴ is not used: moving one
        reflector's energy onto another raises it.) Its differential is Re sum_v conj(w) dI with
        w = I (1 / sum of |I|² - 1 / (|I| sum of |I|)), and dI turns one phase a piece: the adjoint of backprojection,
        applied to w, tells all components at the cost of about two images.
        """
        image = self.image(moves)
        power = np.abs(image).astype(float) ** 2
        energy = power.sum()
        # Rounded off where it is dark, so that it has a derivative everywhere.
        size = np.sqrt(power + _DARK * energy / len(power))
        weights = image * (1 / energy - (1 / size + _DARK / len(power) * (1 / size).sum()) / size.sum())
        scale = float(np.abs(weights).max())
        weights = weights / scale
        gradient = np.empty(self.places.shape, self.places.dtype)
        kernels.displaced_gradient(
            self.real, self.imag, self.places, self._typed(moves), self.points, self.per_metre,
            self._typed(weights.real), self._typed(weights.imag), gradient,
        )  # fmt: skip
        return float(0.5 * np.log(energy) - np.log(size.sum())), scale * gradient.astype(float)

    def tried(self, pieces: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(C, V) the sum over `pieces` (n,) alone, all displaced by each of `moves` (C, 3) [m]."""
        images = np.empty((2, len(moves), self.points.shape[1]), self.real.dtype)
        kernels.tried_images(
            self.real, self.imag, self.places, pieces, self._typed(moves), self.points, self.per_metre, *images
        )
        return images[0] + 1j * images[1]

    def _typed(self, values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values, dtype=self.real.dtype)


def lobe(capture: Capture, place: np.ndarray) -> np.ndarray:
    """(3,) width of the main lobe at a place [m]: one over the span of the local frequencies."""
    from millisight.imaging._focus import local_frequencies

    span = np.ptp(local_frequencies(capture, capture.trajectory, place), axis=0)
    return 1 / np.maximum(span, 1e-3)


def fine_lattice(box: np.ndarray, spacing: np.ndarray, most: float) -> np.ndarray:
    """(V, 3) points of a box (2, 3), `spacing` (3,) apart, or coarser so that there are no more than `most` [m]."""
    size = spacing * max(1.0, (np.prod(np.ptp(box, axis=0) / spacing + 1) / most) ** (1 / 3))
    return VoxelGrid.regular(box[0], box[1], size).points
