"""Offsets of rows from magnitudes alone: each row's own image, laid on those of the rows around it.

A row of a raster is an aperture of its own. Its image is sharp along the row, and an offset of the row moves it along
the row as a whole. A row's distance turns phases alone, and magnitudes stay: this works while nothing is in phase.
"""

from typing import NamedTuple

import numpy as np

from millisight.imaging._autofocus_model import Pieces, View, lobe
from millisight.imaging._autofocus_search import Subject

_MOST_CELLS = 6_000
_NEIGHBOURS = (4, 12, 40)  # rows whose images each row is compared with, standard deviation
_AT_ONCE = 1 << 20  # values of the lines that are looked at together
_FINER = 8  # places between two cells at which the correlation is looked at


def row_axes(subject: Subject) -> np.ndarray:
    """(3, 3) unit vectors along the rows, from row to row, and across both."""
    first = subject.rows[0].step
    along = np.sum([row.step * np.sign(row.step @ first) for row in subject.rows], axis=0)
    along = along / np.linalg.norm(along)
    places = subject.capture.trajectory.positions
    middles = np.array([places[row.poses].mean(axis=0) for row in subject.rows])
    apart = middles - middles.mean(axis=0)
    apart = apart - np.outer(apart @ along, along)
    # Rows that all lie in one line have no direction from row to row: any across them will do.
    across = next(v for v in np.linalg.svd(apart)[2] if abs(v @ along) < 0.9)
    across = across - (across @ along) * along
    across = across / np.linalg.norm(across)
    return np.stack([along, across, np.cross(along, across)])


def lattice(subject: Subject, axes: np.ndarray, steps: np.ndarray, most: int) -> tuple[np.ndarray, tuple[int, ...]]:
    """(V, 3) points of the box on a lattice along `axes`, about `steps` (3,) apart [m], and its shape.

    Where these were more than `most`, the steps from row to row and across both are longer.
    """
    corners = np.stack(np.meshgrid(*subject.box.T), axis=-1).reshape(-1, 3) @ axes.T
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    counts = np.maximum(np.ceil(size / steps), 1)
    if counts.prod() > most:
        counts[1:] = np.maximum(np.ceil(counts[1:] * np.sqrt(most / counts.prod())), 1)
    lines = [low[i] + (np.arange(n) + 0.5) * size[i] / n for i, n in enumerate(counts.astype(int))]
    inner = np.stack(np.meshgrid(lines[1], lines[2], lines[0], indexing="ij"), axis=-1)[..., [2, 0, 1]]
    return inner.reshape(-1, 3) @ axes, inner.shape[:3]


def row_lobe(subject: Subject, axes: np.ndarray) -> float:
    """Width of the main lobe along the rows [m]."""
    return float(1 / (np.abs(axes[0]) / lobe(subject.capture, subject.box.mean(axis=0))).sum())


def row_fields(view: View, pieces: Pieces) -> np.ndarray:
    """(R, V) fields of whole rows."""
    first = np.flatnonzero(np.diff(pieces.rows, prepend=-1))
    return np.add.reduceat(view.real + 1j * view.imag, first, axis=0)


class RowOffsets(NamedTuple):
    """By how many frames each row began late (R,), how alike the rows are then (-1 to 1), and how alike rows become
    that were shifted at random."""

    frames: np.ndarray
    likeness: float
    chance: float


def row_offsets(subject: Subject, most: float, rng: np.random.Generator) -> RowOffsets | None:
    """Offsets of `most` frames at most; None where nothing is seen, or the box has too many lobes along a row."""
    axes = row_axes(subject)
    resolution = subject.capture.radar.waveform.range_resolution
    steps = np.array([row_lobe(subject, axes) / 2, resolution, resolution])
    points, shape = lattice(subject, axes, steps, _MOST_CELLS)
    if shape[-1] > _MOST_CELLS:
        return None
    still = np.zeros_like(subject.capture.trajectory.positions)
    sizes = np.abs(row_fields(subject.view(still, points), subject.pieces)).reshape(len(subject.rows), -1, shape[-1])
    sizes = sizes - sizes.mean(axis=2, keepdims=True)
    spacing = float(np.ptp(points @ axes[0])) / max(shape[-1] - 1, 1)
    if not spacing or not sizes.any():
        return None
    frames = np.array([row.step @ axes[0] for row in subject.rows]) / spacing
    # Rows that are shifted by the whole box have nothing in common.
    reach = np.minimum(most * np.abs(frames), shape[-1])
    shifts, likeness = _aligned(sizes, reach)
    rolled = np.stack([np.roll(lines, rng.integers(shape[-1]), axis=1) for lines in sizes])
    return RowOffsets(np.clip(shifts / frames, -most, most), likeness, _aligned(rolled, reach)[1])


def _aligned(sizes: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, float]:
    """(R,) shifts by which rows (R, lines, n) are most alike, `reach` (R,) at most, and how alike they are [-1, 1]."""
    from scipy.ndimage import gaussian_filter1d

    length = 1 << int(np.ceil(np.log2(sizes.shape[-1] + 2 * reach.max() + 8)))
    turns = -2j * np.pi * np.fft.rfftfreq(length)
    # By Parseval: the sum of squares of what a spectrum belongs to.
    twice = np.where((turns == 0) | (np.arange(len(turns)) == length // 2), 1, 2) / length
    places = np.fft.fftfreq(length * _FINER) * length
    some = max(_AT_ONCE // (len(sizes) * length), 1)
    shifts, likeness = np.zeros(len(sizes)), 0.0
    for width in _NEIGHBOURS:
        for _ in range(2):
            both, squares = np.zeros((len(sizes), len(turns)), complex), np.zeros((2, len(sizes)))
            for start in range(0, sizes.shape[1], some):
                spectra = np.fft.rfft(sizes[:, start : start + some], length, axis=2)
                moved = spectra * np.exp(turns * shifts[:, None])[:, None]
                around = gaussian_filter1d(moved, width, axis=0, mode="constant") - moved / (width * np.sqrt(2 * np.pi))
                both += (around.conj() * spectra).sum(axis=1)
                squares += [(np.abs(part) ** 2 @ twice).sum(axis=1) for part in (around, spectra)]
            product = np.fft.irfft(both, length * _FINER, axis=1) * _FINER
            product[np.abs(places) > reach[:, None] + 1e-9] = -np.inf
            likeness = float(np.mean(product.max(axis=1) / np.maximum(np.sqrt(squares.prod(axis=0)), 1e-30)))
            shifts = -places[product.argmax(axis=1)]
            shifts = shifts - np.median(shifts)
    return shifts, likeness
