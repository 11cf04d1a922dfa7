"""Autofocus: where the radar was, put right by the sharpness of the image."""

from collections.abc import Callable
from dataclasses import field, replace

import numpy as np

from millisight.core import (
    check_known,
    checked_array,
    checked_number,
    checked_record,
    put,
    record,
    seed_or_generator,
    with_step,
)
from millisight.core.errors import InputError
from millisight.data import Capture, VoxelGrid
from millisight.imaging._autofocus_model import Pieces
from millisight.imaging._autofocus_search import Subject, bright_points, climb, path_modes, row_modes, without_common
from millisight.imaging._focus import mean_frame
from millisight.imaging._path_rows import Row, rows_of_path
from millisight.imaging._row_offsets import row_offsets
from millisight.imaging._row_tracking import tracked_rows
from millisight.imaging._scale import at_usual_scale, scaled

FOCUSES = ("rows", "path")

_LEAST_ROWS = 3
_LEAST_AGREEMENT = 1 / 15  # wavelengths rms by which two halves of the scene may differ on the path
_LEAST_CORRECTION = 3  # times the uncertainty: what is less stays as it was given
_LEAST_GAIN = 1.005  # of the sharpness of places that were not fitted
_LEAST_COHERENCE = 1.5  # times what rows that have nothing in common reach, of likeness and of coherence
# Steps uphill, what is bright looked for again before each: by halves of the scene, and by all of it.
_MOST_FRAMES = 1e9  # of an offset
_HALVES, _ALL = (20, 30), (20, 30, 30)

UNOBSERVABLE = (
    "A shift of the whole path moves the image and changes nothing else: the path as a whole stays where it was given.",
    "A path stretched, sheared or turned evenly stretches, shears or turns the image: such an error may remain.",
    "Displacements across the line of sight to the bright points have little effect: only distances to them are "
    "accurate.",
    "A slow bend of the path looks like a curved reflector: it can only be found in scenes with several small "
    "reflectors.",
)
"""What no sharpness tells, in words."""


@record
class Focused:
    """What `autofocus` found.

    Attributes
    ----------
    capture : with the corrected path, its history telling what was done; the given one where nothing was corrected
    row_offsets : (R,) by how many frames each row began late (its poses lie that far ahead of the given ones); zero
        where rows were not corrected; empty where the path has none
    row_uncertainty : standard error of a row's offset [frames]; infinite where it is not known
    displacements : (P, 3) what was added to the given positions [m], offsets of rows included
    uncertainty : standard error of the distance from a pose to the bright places [m]; infinite where it is not known
    gain : by what factor (sum of |I|³)^(1/3) of places that were not fitted grew; 1 where nothing was corrected
    applied : what was corrected: (), ("rows",), ("path",) or ("rows", "path")
    reason : why not all that was asked for was; empty where it was
    unobservable : what cannot be observed, in words
    """

    capture: Capture
    row_offsets: np.ndarray
    row_uncertainty: float
    displacements: np.ndarray
    uncertainty: float
    gain: float
    applied: tuple[str, ...]
    reason: str
    unobservable: tuple[str, ...] = field(default=UNOBSERVABLE)

    def __post_init__(self) -> None:
        offsets = np.asarray(self.row_offsets, dtype=float)
        offsets.flags.writeable = False
        shape = (len(self.capture.trajectory), 3)
        put(
            self,
            row_offsets=offsets,
            displacements=checked_array(self.displacements, name="displacements", shape=shape, unit="m"),
        )

    def __repr__(self) -> str:
        if not self.applied:
            return f"Focused(nothing corrected: {self.reason})"
        largest = 1e3 * float(np.linalg.norm(self.displacements, axis=1).max())
        return (
            f"Focused({' and '.join(self.applied)} corrected by up to {largest:.2f} mm, "
            f"± {self.uncertainty * 1e3:.3f} mm along the line of sight, sharper x {self.gain:.2f})"
        )


def autofocus(
    capture: Capture,
    grid: VoxelGrid,
    *,
    focus: str = "path",
    max_offset: float = 5.0,
    smoothness: float = 0.5,
    rng: int | np.random.Generator = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Focused:
    """The path that makes the image sharpest: rows begun early or late, then smooth errors along the way.

    Each row's image, without its phases, is laid on those of the rows around it: that tells the rows' offsets. Then the
    phases of single targets are followed from row to row by a Kalman filter, which tells how far each row lies from
    where it should. Last, the smooth errors of all three coordinates, cubic splines over the way, and the rows' offsets
    go uphill along the gradient of the sum of |I|³ over the brightest cells, which are looked for again on the way.

    Nothing is corrected on one word: rows are only followed where that makes the targets more coherent than it makes
    phases drawn at random. Then the scene is parted in two like a chess board, each half tells the path alone, and only
    what both agree on, and what makes each half sharper when the other was fitted, is believed. What the two differ by
    is the uncertainty.

    Parameters
    ----------
    capture : frames in memory or on disk; background subtraction before helps
    grid : where the scene lies: its box is looked at, not its voxels
    focus : "rows": offsets of rows alone; "path": these, and smooth errors of the path
    max_offset : of a row [frames]
    smoothness : distance of the spline's knots along the way [m]; errors that change faster are not followed
    rng : a seed, or a generator: which voxels are looked at
    progress : called with (steps done, steps in all)

    Raises
    ------
    UnknownNameError, InputError
        An argument cannot be right.
    """
    checked_record(capture, Capture, name="capture")
    checked_record(grid, VoxelGrid, name="grid")
    check_known("focus", focus, FOCUSES)
    max_offset = min(checked_number(max_offset, name="max_offset", unit="frames", above=0), _MOST_FRAMES)
    smoothness = checked_number(smoothness, name="smoothness", unit="m", above=0)
    generator = seed_or_generator(rng)
    path = capture.trajectory
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError(
            "the capture states the antennas' places at each pose (tx_points, rx_points), which no path moves; "
            "autofocus expects the radar's array carried along the trajectory"
        )
    if capture.layers is not None:
        raise InputError("the capture was measured through layers; autofocus expects straight paths")
    if not np.ptp(path.positions, axis=0).any():
        return _unchanged(capture, [], "the radar did not move")
    taken, (capture, scale) = capture, at_usual_scale(capture)
    rows = rows_of_path(path)
    tried = (("rows", "path"), ("rows",)) if focus == "path" else (("rows",),)
    if len(rows) < _LEAST_ROWS:
        rows, tried = [], (("path",),) if focus == "path" else ()
    if not tried:
        return _unchanged(taken, rows, f"the path has {len(rows_of_path(path))} rows; expected {_LEAST_ROWS} at least")
    pieces = Pieces.of(path, rows, capture.radar.waveform.wavelength)
    subject = Subject(capture, rows, pieces, mean_frame(capture), grid.bounds)
    search = _Search(
        subject, max_offset, smoothness, generator, _Steps(progress, (2 * len(_HALVES) + len(_ALL)) * len(tried))
    )
    reasons = []
    for what in tried:
        found = search.focused(what)
        if isinstance(found, Focused):
            focused = found.capture if scale == 1 else scaled(found.capture, 1 / scale)
            return replace(found, capture=focused, reason="; ".join(reasons))
        reasons.append(f"{' and '.join(what)}: {found}")
    return _unchanged(taken, rows, "; ".join(reasons))


def _unchanged(capture: Capture, rows: list[Row], reason: str) -> Focused:
    return Focused(
        capture=capture,
        row_offsets=np.zeros(len(rows)),
        row_uncertainty=float("inf"),
        displacements=np.zeros_like(capture.trajectory.positions),
        uncertainty=float("inf"),
        gain=1.0,
        applied=(),
        reason=reason,
    )


class _Steps:
    """Counts the steps done for a call-back."""

    def __init__(self, progress: Callable[[int, int], None] | None, total: int):
        self._progress, self._done, self._total = progress, 0, total

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


class _Search:
    """Fits the path to each half of the scene, lets the other half judge it, and then fits it to all."""

    def __init__(self, subject: Subject, most: float, smoothness: float, rng: np.random.Generator, steps: _Steps):
        self._subject, self._smoothness, self._steps = subject, smoothness, steps
        self._rng = rng
        self._nothing = np.zeros_like(subject.capture.trajectory.positions)
        # What the given path shows, for every attempt alike.
        self._bright = self._points(self._nothing, None)
        self._late = row_offsets(subject, most, self._rng) if subject.rows else None

    def focused(self, what: tuple[str, ...]) -> Focused | str:
        """The correction; where it is not to be believed, the reason."""
        subject = self._subject
        if not len(self._bright):
            return "no echo comes from the grid"
        begun = self._sharpest([self._nothing, *self._begun(what)])
        halves = [self._fit(what, begun, fold) for fold in range(2)]
        seen = [self._points(m, 1 - fold) for fold, m in enumerate(halves)]
        if not all(len(p) for p in seen):
            return "the grid is too small to be parted: one half of the scene cannot judge what the other tells"
        between = (halves[0] - halves[1]) / 2
        places = np.concatenate(seen)
        uncertainty = _rms(subject.sighted(between, places))
        least = _LEAST_AGREEMENT * subject.wavelength
        if uncertainty > least:
            return (
                f"two halves of the scene differ by {1e3 * uncertainty:.2f} mm on the path, expected "
                f"{1e3 * least:.2f} at most"
            )
        gain = float(np.exp(np.mean([self._grown(m, p) for m, p in zip(halves, seen, strict=True)])))
        size = _rms(subject.sighted(np.mean(halves, axis=0), places))
        if size < _LEAST_CORRECTION * uncertainty or gain < _LEAST_GAIN:
            return (
                f"nothing to correct: what was found is {1e3 * size:.3f} mm along the line of sight, uncertain by "
                f"{1e3 * uncertainty:.3f}, and places that were not fitted got sharper by {100 * gain - 100:.1f} %"
            )
        moves = self._fit(what, self._sharpest([begun, *halves]), None)
        # The halves were fitted apart; an answer of all that is far from theirs is less certain than they are.
        uncertainty = max(uncertainty, _rms(subject.sighted(moves - np.mean(halves, axis=0), places)))
        offsets = np.array([(moves[row.poses] @ row.step).mean() / (row.step @ row.step) for row in subject.rows])
        apart = without_common(subject.capture.trajectory, between)
        frames = [_rms(apart[row.poses] @ row.step / (row.step @ row.step)) for row in subject.rows]
        settings = {
            "focus": what[-1],
            "applied": list(what),
            "smoothness": self._smoothness,
            "row_offsets": [round(float(offset), 3) for offset in offsets],
            "row_uncertainty": round(_rms(np.array(frames)), 4) if "rows" in what else None,
            "largest": float(np.linalg.norm(moves, axis=1).max()),
            "uncertainty": uncertainty,
            "gain": round(gain, 4),
        }
        capture = subject.at(moves)
        return Focused(
            capture=replace(capture, metadata=with_step(capture.metadata, "autofocus", **settings)),
            row_offsets=offsets if "rows" in what else np.zeros(len(offsets)),
            row_uncertainty=_rms(np.array(frames)) if "rows" in what else float("inf"),
            displacements=moves,
            uncertainty=uncertainty,
            gain=gain,
            applied=what,
            reason="",
        )

    def _points(self, moves: np.ndarray, fold: int | None) -> np.ndarray:
        return bright_points(self._subject, moves, fold)

    def _begun(self, what: tuple[str, ...]) -> list[np.ndarray]:
        """(P, 3) what the rows tell before anything is in phase [m]: their offsets; these and their distances."""
        subject, moves, late = self._subject, np.zeros_like(self._nothing), self._late
        if late is None or late.likeness < _LEAST_COHERENCE * late.chance:
            return []
        for row, offset in zip(subject.rows, late.frames, strict=True):
            moves[row.poses] = offset * row.step
        found = tracked_rows(subject, moves, self._rng) if "path" in what else None
        if found is None or found.coherence < _LEAST_COHERENCE * found.chance:
            return [moves]
        return [moves, moves + found.moves]

    def _sharpest(self, tried: list[np.ndarray]) -> np.ndarray:
        """The sharpest of displacements (P, 3) [m], each seen where any of them is bright."""
        if len(tried) == 1:
            return tried[0]
        points = np.concatenate([self._bright if m is self._nothing else self._points(m, None) for m in tried])
        still = np.zeros((len(self._subject.pieces.rows), 3))
        sharp = [self._subject.view(moves, points).sharpness(still)[0] for moves in tried]
        return tried[int(np.argmax(sharp))]

    def _fit(self, what: tuple[str, ...], moves: np.ndarray, fold: int | None) -> np.ndarray:
        """(P, 3) the answer of one half of the scene, or of all, from `moves` on [m]."""
        subject = self._subject
        modes = [path_modes(subject, self._smoothness)] if "path" in what else []
        modes += [row_modes(subject)] if "rows" in what else []
        for steps in _ALL if fold is None else _HALVES:
            points = self._points(moves, fold)
            if len(points):
                moves = moves + climb(subject, subject.view(moves, points), modes, steps)
            # A shift of everything only moves the image.
            moves = moves - moves.mean(axis=0)
            self._steps()
        return moves

    def _grown(self, moves: np.ndarray, points: np.ndarray) -> float:
        """By how much the log of the sharpness of some points grew."""
        still = np.zeros((len(self._subject.pieces.rows), 3))
        after, before = (self._subject.view(m, points).sharpness(still)[0] for m in (moves, self._nothing))
        return after - before


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
