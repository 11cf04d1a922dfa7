"""The searches of autofocus: bright cells, rows one after another, and a smooth path, by the sharpness of the image."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from millisight.data import Capture, Trajectory, VoxelGrid
from millisight.imaging._autofocus_model import Pieces, View, lobe
from millisight.imaging._path_rows import Row

_BLOCK = 8.0  # wavelengths: side of the blocks whose likenesses are added without their phases
_MOST_CELLS, _MOST_POINTS = 20_000, 2_000
_FAINTEST = 0.08  # of the brightest cell's power, to be looked at before anything is aligned
_MEMORY = 0.7  # weight of a row in what the next one is compared with, again and again
_PREDICTED = 0.8  # of the last row's change of depth
_STEPS = (0.25, 0.12, 0.06)  # frames, after a search by half frames
_PHASE, _DEPTH = 0.7, 0.13  # standard deviation of a block's phase [rad]; of the depth's change [wavelengths]
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

    def view(self, moves: np.ndarray, points: np.ndarray) -> View:
        """The pieces of the path displaced by `moves` (P, 3) [m], as points (V, 3) [m] see them."""
        return View.of(self.at(moves), self.pieces, self.mean, points)


def bright_points(
    subject: Subject, moves: np.ndarray, together: int, fold: int | None, rng: np.random.Generator | None = None
) -> np.ndarray:
    """(V, 3) fine lattices in the brightest cells of the box, by the powers of so many rows' images `together` [m].

    fold : 0 or 1: of every second block of the box alone, as on a chess board; None: of all
    rng : in cells drawn from all that are not faint, for a path along which nothing is sharp yet
    """
    fine = lobe(subject.at(moves), subject.box.mean(axis=0))
    size = np.ptp(subject.box, axis=0)
    coarse = 2 * fine * max(1.0, (np.prod(size / fine / 2 + 1) / _MOST_CELLS) ** (1 / 3))
    cells = VoxelGrid.regular(subject.box[0], subject.box[1], coarse).points
    if fold is not None:
        block = np.floor((cells - subject.box[0]) / (_BLOCK * subject.wavelength))
        cells = cells[block[:, :2].sum(axis=1) % 2 == fold]
    if not len(cells):
        return cells
    view = View.of(subject.at(moves), subject.pieces.joined(together), subject.mean, cells)
    power = (view.real**2 + view.imag**2).sum(axis=0)
    order = np.argsort(power)[::-1]
    if rng is not None:
        return cells[rng.permutation(order[power[order] > _FAINTEST * power.max()])[:_MOST_POINTS]]
    counts = np.ceil(coarse / fine)
    reach = (counts - 1) / 2 * coarse / counts
    within = VoxelGrid.regular(-reach, reach, coarse / counts).points
    return (cells[order[: max(_MOST_POINTS // len(within), 1)], None] + within).reshape(-1, 3)


def follow_rows(subject: Subject, points: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """(R,) offsets of the rows [frames], `most` at most, and (R, 3) their shifts along the line of sight [m].

    Each row is compared with the image of the rows before it, block by block of the scene: its offset is where the
    likenesses are largest; their phases tell how much nearer or farther it runs than the last row's change lets expect.
    """
    side = _BLOCK * subject.wavelength
    number = np.unique(np.floor((points - points.min(axis=0)) / side), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(number, kind="stable")
    starts = np.flatnonzero(np.diff(number[order], prepend=-1))
    view = subject.view(np.zeros_like(subject.capture.trajectory.positions), points[order])
    centres = (np.add.reduceat(view.points, starts, axis=1) / np.diff(np.append(starts, len(order)))).T
    middle, turns = view.points.mean(axis=1), 2 * np.pi * view.per_metre
    offsets, depths, shifts = np.zeros(len(subject.rows)), np.zeros(len(subject.rows)), []
    wide = 0.5 * np.arange(-np.ceil(2 * most), np.ceil(2 * most) + 1)
    before = np.zeros(len(order), np.complex64)
    for r, row in enumerate(subject.rows):
        own = np.flatnonzero(subject.pieces.rows == r)
        place = view.places[own].mean(axis=0)
        sight = (place - middle) / np.linalg.norm(place - middle)

        def tried(at: np.ndarray, depth: float, own=own, row=row, sight=sight) -> np.ndarray:
            moves = at[:, None] * row.step + depth * sight
            return view.images(own, np.broadcast_to(moves[:, None], (len(at), len(own), 3)))

        if r:
            depth = depths[r - 1] + _PREDICTED * (depths[r - 1] - depths[max(r - 2, 0)])
            for step in (None, *_STEPS):
                at = wide if step is None else np.clip(offsets[r] + step * np.arange(-1, 2), -most, most)
                likeness = np.add.reduceat(tried(at, depth) * before.conj(), starts, axis=1)
                best = int(np.argmax(np.abs(likeness).sum(axis=1)))
                offsets[r] = at[best]
            like = likeness[best]
            weight = (np.abs(like) / (np.abs(like).max() or 1)).astype(float) ** 2 + 1e-30
            common = np.angle((like * np.abs(like)).sum())
            phases = -(common + np.angle(like * np.exp(-1j * common)))
            towards = place - centres
            slope = turns * (towards @ sight) / np.linalg.norm(towards, axis=1)
            # As many blocks count as share the weight.
            weight *= weight.sum() / (weight**2).sum() / _PHASE**2
            expected = 1 / (_DEPTH * subject.wavelength) ** 2
            depths[r] = depth + (weight * slope * phases).sum() / ((weight * slope**2).sum() + expected)
        before = _MEMORY * before + tried(offsets[r : r + 1], depths[r])[0]
        shifts.append(depths[r] * sight)
    return offsets, np.array(shifts)


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
