"""The searches of autofocus: bright cells, and a smooth path by the sharpness of the image."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Capture, Trajectory, VoxelGrid
from millisight.imaging._autofocus_model import Pieces, View, lobe
from millisight.imaging._path_rows import Row

_BLOCK = 8.0  # wavelengths: side of the blocks of the chess board
_MOST_CELLS, _MOST_POINTS = 20_000, 2_000
_LEAST_KNOTS = 100  # of the way, which no capture is refused
_MOST_ACROSS = 12  # points of a lattice, along each axis: 1 728 in all
_RIDGE = 1e-3  # weight of (displacement / wavelength)², averaged over the path


class Subject(NamedTuple):
    """What is being focused: the capture as given, its rows and pieces, what all its frames have in common, and where
    the scene lies (2, 3) [m]."""

    capture: Capture
    rows: list[Row]
    pieces: Pieces
    mean: np.ndarray
    box: np.ndarray

    @property
    def wavelength(self) -> float:
        """[m]"""
        return self.capture.radar.waveform.wavelength

    def at(self, moves: np.ndarray) -> Capture:
        """The capture with its poses displaced by `moves` (P, 3) [m]."""
        path = self.capture.trajectory
        return replace(self.capture, trajectory=replace(path, positions=path.positions + moves))

    def sighted(self, moves: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(P,) `moves` (P, 3) along the line of sight to the middle of `points` (V, 3), less what shifts, stretches,
        shears or turns the image alone [m]."""
        places = self.capture.trajectory.positions
        sight = places - points.mean(axis=0)
        sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        along = (moves * sight).sum(axis=1)
        centred = np.concatenate([np.ones((len(places), 1)), places - places.mean(axis=0)], axis=1)
        terms = (sight[:, :, None] * centred[:, None]).reshape(len(places), -1)
        terms = np.concatenate([terms, np.ones((len(places), 1))], axis=1)
        return along - terms @ np.linalg.lstsq(terms, along, rcond=None)[0]

    def view(self, moves: np.ndarray, points: np.ndarray, pieces: Pieces | None = None) -> View:
        """The pieces of the path displaced by `moves` (P, 3) [m], or some of them, as points (V, 3) [m] see them."""
        return View.of(self.at(moves), pieces or self.pieces, self.mean, points)


def bright_points(subject: Subject, moves: np.ndarray, fold: int | None) -> np.ndarray:
    """(V, 3) fine lattices in the brightest cells of the box [m].

    fold : 0 or 1: of every second block of the box alone, as on a chess board; None: of all
    """
    size = np.ptp(subject.box, axis=0)
    # Across a line of positions the lobe has no end: points far beyond the box would tell nothing, and take long.
    widest = 4 * max(float(size.max()), subject.wavelength)
    fine = np.minimum(lobe(subject.at(moves), subject.box.mean(axis=0)), widest)
    coarse = 2 * fine * max(1.0, (np.prod(size / fine / 2 + 1) / _MOST_CELLS) ** (1 / 3))
    cells = VoxelGrid.regular(subject.box[0], subject.box[1], coarse).points
    if fold is not None:
        block = np.floor((cells - subject.box[0]) / (_BLOCK * subject.wavelength))
        cells = cells[block[:, :2].sum(axis=1) % 2 == fold]
    if not len(cells):
        return cells
    view = View.of(subject.at(moves), subject.pieces.joined(), subject.mean, cells)
    power = (view.real**2 + view.imag**2)[0]
    if not power.any():
        return cells[:0]
    order = np.argsort(power)[::-1]
    counts = np.ceil(coarse / fine)
    # The middle of a cell alone, where a lattice over all of it would have more points than are looked at.
    reach = (np.minimum(counts, _MOST_ACROSS) - 1) / 2 * coarse / counts
    within = VoxelGrid.regular(-reach, reach, coarse / counts).points
    return (cells[order[: max(_MOST_POINTS // len(within), 1)], None] + within).reshape(-1, 3)


class Modes(NamedTuple):
    """How displacements of pieces and poses follow from parameters: (S 3, m) and (P 3, m) sparse matrices."""

    pieces: Any
    poses: Any


def row_modes(subject: Subject) -> Modes:
    """One offset a row [m], along its own direction."""
    from scipy.sparse import csr_array

    poses = np.zeros((len(subject.capture.trajectory), len(subject.rows), 3))
    for r, row in enumerate(subject.rows):
        poses[row.poses, r] = row.step / np.linalg.norm(row.step)
    pieces = subject.pieces.means(poses.reshape(len(poses), -1)).reshape(-1, len(subject.rows), 3)
    return Modes(*(csr_array(m.transpose(0, 2, 1).reshape(-1, len(subject.rows))) for m in (pieces, poses)))


def path_modes(subject: Subject, spacing: float) -> Modes:
    """Cubic splines over the way, their knots `spacing` apart [m], of each component."""
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array, eye_array, kron

    path, pieces = subject.capture.trajectory, subject.pieces
    lengths = np.linalg.norm(np.diff(path.positions[pieces.order], axis=0), axis=1)
    travelled = np.concatenate([[0], np.cumsum(lengths)])
    # Poses of turns belong to no row: they take what lies between the rows around them.
    by_time = np.argsort(path.times, kind="stable")
    known = np.full(len(path), np.nan)
    known[pieces.order] = travelled
    filled = known[by_time]
    good = np.flatnonzero(~np.isnan(filled))
    way = np.empty(len(path))
    way[by_time] = np.interp(np.arange(len(path)), good, filled[good])
    most = max(len(path), _LEAST_KNOTS)
    if travelled[-1] > most * spacing:
        raise InputError(
            f"smoothness is {spacing:g} m, of a way of {travelled[-1]:.3g} m; expected at least "
            f"{travelled[-1] / most:.2g} m, so that no pose has several knots"
        )
    count = max(1, int(np.ceil(travelled[-1] / spacing)))
    knots = np.concatenate([np.zeros(3), np.linspace(0, travelled[-1], count + 1), np.full(3, travelled[-1])])

    def spread(places: np.ndarray) -> Any:
        return csr_array(kron(BSpline.design_matrix(np.clip(places, 0, travelled[-1]), knots, 3), eye_array(3)))

    return Modes(spread(pieces.way), spread(way))


def climb(subject: Subject, view: View, modes: list[Modes], steps: int) -> np.ndarray:
    """(P, 3) displacements of the poses [m] at which the points are sharpest, uphill from none (L-BFGS).

    A weak pull towards none keeps still what the image does not tell.
    """
    from scipy.optimize import minimize
    from scipy.sparse import hstack

    # scipy's stubs know no sparse arrays.
    pieces: Any
    poses: Any
    pieces, poses = (hstack([getattr(m, name) for m in modes], format="csr") for name in ("pieces", "poses"))
    unit = subject.wavelength / 10
    pull = _RIDGE / 3 / len(view.places) / subject.wavelength**2

    def cost(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        moves = (pieces @ parameters * unit).reshape(-1, 3)
        value, gradient = view.sharpness(moves)
        slope = pieces.T @ (gradient - 2 * pull * moves).ravel() * unit
        return 3 * (pull * float((moves**2).sum()) - value), -3 * slope

    found = minimize(cost, np.zeros(pieces.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": steps})
    return (poses @ found.x * unit).reshape(-1, 3)


def without_common(trajectory: Trajectory, moves: np.ndarray) -> np.ndarray:
    """`moves` (P, 3) without what shifts, stretches, shears or turns the whole path [m]."""
    terms = np.concatenate([np.ones((len(moves), 1)), trajectory.positions], axis=1)
    return moves - terms @ np.linalg.lstsq(terms, moves, rcond=None)[0]
