"""The searches of autofocus: bright places, offsets of rows, and a smooth path, each by the sharpness of the image."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from millisight.core import with_step
from millisight.data import Capture, Trajectory
from millisight.imaging._autofocus_model import Pieces, Row, View, fine_lattice, lobe

_BLOCK = 8.0  # wavelengths: side of the blocks in which bright places are looked for
_FAINTEST = 0.08  # of the brightest block's power
_TOGETHER = 3  # pieces whose fields are added
_SPACING = 1.0  # main lobes between voxels
_MOST_COARSE = 4_000
_MOST_POINTS = 4_000
_NEIGHBOURS = 12  # rows that a row is compared with
_STEP = 0.5  # frames, of the search for a row's offset
# Of all rows: steps either way, and their length [frames].
_SWEEPS = ((8, 0.5), (6, 0.5), (4, 0.35), (4, 0.2))
_DEPTHS = np.array([-0.06, 0.0, 0.06])  # wavelengths
_RIDGE = 1e-3  # weight of (displacement / wavelength)², averaged over the path


class Subject(NamedTuple):
    """What is being focused: the capture as given, its rows and pieces, and what all its frames have in common."""

    capture: Capture
    rows: list[Row]
    pieces: Pieces
    mean: np.ndarray

    @property
    def wavelength(self) -> float:
        """[m]"""
        return self.capture.radar.waveform.wavelength

    def at(self, moves: np.ndarray) -> Capture:
        """The capture with its poses displaced by `moves` (P, 3) [m]."""
        path = self.capture.trajectory
        moved = Trajectory(times=path.times, positions=path.positions + moves, orientations=path.orientations)
        return Capture(
            radar=self.capture.radar, trajectory=moved, frames=self.capture.frames, layers=self.capture.layers
        )

    def sighted(self, moves: np.ndarray, places: "Places") -> np.ndarray:
        """(P,) `moves` (P, 3) along the line of sight to the middle of the places, less what moves the image alone."""
        sight = self.capture.trajectory.positions - places.centres.mean(axis=0)
        sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        along = (moves * sight).sum(axis=1)
        terms = np.concatenate([sight, np.ones((len(sight), 1))], axis=1)
        return along - terms @ np.linalg.lstsq(terms, along, rcond=None)[0]

    def view(self, moves: np.ndarray, points: np.ndarray) -> View:
        """The pieces of the path displaced by `moves` (P, 3) [m], as points (V, 3) [m] see them."""
        return View.of(self.at(moves), self.pieces, self.mean, points)


class Places(NamedTuple):
    """Bright blocks of the scene: centres (n, 3) and side [m], and to which of some folds (n,) each belongs."""

    centres: np.ndarray
    side: float
    folds: np.ndarray

    def points(self, spacing: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """(V, 3) a fine lattice in the `chosen` ones (n,) of the blocks [m]."""
        some = self.centres[chosen]
        box = np.array([-0.5, 0.5])[:, None] * self.side * (1 - 1e-9) * np.ones(3)
        inside = fine_lattice(box, spacing, max(4 * _MOST_POINTS / max(len(some), 1), 8))
        return (some[:, None] + inside).reshape(-1, 3)


def bright_places(subject: Subject, box: np.ndarray, folds: int) -> Places:
    """The blocks of a box (2, 3) [m] where short pieces of the path see most power, whatever their phases."""
    side = _BLOCK * subject.wavelength
    lattice = fine_lattice(box, np.full(3, side / 3), _MOST_COARSE)
    view = subject.view(np.zeros_like(subject.capture.trajectory.positions), lattice)
    few = np.arange(0, len(view.places), _TOGETHER)
    power = sum((np.add.reduceat(part, few, axis=0) ** 2).sum(axis=0) for part in (view.real, view.imag))
    block = np.floor((lattice - box[0]) / side).astype(int)
    blocks, number = np.unique(block, axis=0, return_inverse=True)
    strongest = np.zeros(len(blocks))
    np.maximum.at(strongest, number.ravel(), power)
    order = np.argsort(strongest)[::-1]
    kept = order[strongest[order] > _FAINTEST * strongest.max()][:60]
    centres = np.clip(box[0] + side * (blocks[kept] + 0.5), box[0], box[1])
    # Neighbouring blocks go to different folds along x and y; a reflector's spread along z stays together.
    return Places(centres, side, blocks[kept][:, :2].sum(axis=1) % folds)


def sample(subject: Subject, places: Places, chosen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(V, 3) random voxels of the `chosen` bright blocks, dark ones among them, in a random order [m]."""
    points = places.points(_SPACING * lobe(subject.capture, places.centres[0]), chosen)
    return points[rng.choice(len(points), min(_MOST_POINTS, len(points)), replace=False)]


def search_rows(subject: Subject, view: View, most: float, *, depths: bool) -> tuple[np.ndarray, np.ndarray]:
    """(R,) offsets of the rows [frames], `most` at most either way, and (R, 3) shifts along the line of sight [m].

    First each row in its order, by its likeness with the image that the rows before it make; the phase of that likeness
    tells how much nearer or farther it runs than the last one, up to a quarter of a wavelength. Then all rows again and
    again, by the contrast of the whole image. Without `depths` the shifts are zero.
    """
    numbers, rows = subject.pieces.rows, subject.rows
    own = [np.flatnonzero(numbers == r) for r in range(len(rows))]
    sight = np.array([(view.places[pieces] - view.points.mean(axis=1)).mean(axis=0) for pieces in own])
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    offsets, depth = np.zeros(len(rows)), np.zeros(len(rows))

    def tried(r: int, at: np.ndarray, deep: np.ndarray) -> np.ndarray:
        return view.tried(own[r], at[:, None] * rows[r].step + deep[:, None] * sight[r])

    count = np.ceil(most / _STEP)
    wide = _STEP * np.arange(-count, count + 1)
    before: list[np.ndarray] = []
    for r in range(len(rows)):
        if r:
            depth[r] = depth[r - 1]
            likeness = tried(r, wide, np.full(len(wide), depth[r])) @ np.sum(before[-_NEIGHBOURS:], axis=0).conj()
            offsets[r] = _top(wide, np.abs(likeness))
            if depths:
                depth[r] -= np.angle(likeness[np.argmax(np.abs(likeness))]) / (2 * np.pi * view.per_metre)
        before.append(tried(r, offsets[r : r + 1], depth[r : r + 1])[0])
    whole = np.sum(before, axis=0)
    deep = subject.wavelength * (_DEPTHS if depths else np.zeros(1))
    for reach, step in _SWEEPS:
        around = step * np.arange(-reach, reach + 1) if most else np.zeros(1)
        for r in range(len(rows)):
            at, away = (a.ravel() for a in np.meshgrid(np.clip(offsets[r] + around, -most, most), depth[r] + deep))
            made = tried(r, at, away)
            rest = whole - before[r]
            best = int(np.argmax(_contrast(rest + made)))
            offsets[r], depth[r], before[r] = at[best], away[best], made[best]
            whole = rest + made[best]
    return offsets, depth[:, None] * sight


def smooth(modes: "Modes", moves: np.ndarray) -> np.ndarray:
    """(P, 3) what of `moves` (P, 3) the modes can follow [m]."""
    from scipy.sparse.linalg import lsqr

    return (modes.poses @ lsqr(modes.poses, moves.ravel(), iter_lim=50)[0]).reshape(-1, 3)


def _contrast(images: np.ndarray) -> np.ndarray:
    """(C,) as `View.contrast`, of images (C, V)."""
    size = np.abs(images)
    return 0.5 * np.log((size**2).sum(axis=-1)) - np.log(size.sum(axis=-1))


def _top(places: np.ndarray, values: np.ndarray) -> float:
    """Where the parabola through the largest value and its neighbours is highest."""
    i = int(np.argmax(values))
    if not 0 < i < len(values) - 1:
        return float(places[i])
    a, b, c = values[i - 1 : i + 2]
    return float(places[i] + (places[i + 1] - places[i]) * 0.5 * (a - c) / min(a - 2 * b + c, -1e-30))


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
    way = np.empty(len(path))
    travelled = np.concatenate([[0], np.cumsum(lengths)])
    # Poses of turns belong to no row: they take what the row before them has.
    by_time = np.argsort(path.times, kind="stable")
    known = np.full(len(path), np.nan)
    known[pieces.order] = travelled
    filled = known[by_time]
    good = np.flatnonzero(~np.isnan(filled))
    way[by_time] = np.interp(np.arange(len(path)), good, filled[good])
    count = max(1, int(np.ceil(travelled[-1] / spacing)))
    knots = np.concatenate([np.zeros(3), np.linspace(0, travelled[-1], count + 1), np.full(3, travelled[-1])])

    def spread(places: np.ndarray) -> Any:
        return csr_array(
            kron(BSpline.design_matrix(np.clip(places, 0, travelled[-1]), knots, 3), eye_array(3))
        )  # fmt: skip

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
    pull = _RIDGE / len(view.places) / subject.wavelength**2

    def cost(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        moves = (pieces @ parameters * unit).reshape(-1, 3)
        value, gradient = view.contrast(moves)
        slope = pieces.T @ (gradient - 2 * pull * moves).ravel() * unit
        return pull * float((moves**2).sum()) - value, -slope

    found = minimize(cost, np.zeros(pieces.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": steps})
    return (poses @ found.x * unit).reshape(-1, 3)


def told(capture: Capture, moves: np.ndarray, settings: dict[str, Any]) -> Capture:
    """The capture with its poses displaced by `moves` (P, 3) [m], which its history tells."""
    path = capture.trajectory
    moved = Trajectory(times=path.times, positions=path.positions + moves, orientations=path.orientations)
    metadata = with_step(capture.metadata, "autofocus", **settings)
    return replace(capture, trajectory=moved, metadata=metadata)
