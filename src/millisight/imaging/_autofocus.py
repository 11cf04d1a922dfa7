"""Autofocus: where the radar was, put right by the sharpness of the image."""

from collections.abc import Callable
from dataclasses import field
from typing import NamedTuple

import numpy as np

from millisight.core import checked_array, checked_number, checked_record, put, record
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Capture, VoxelGrid
from millisight.imaging._autofocus_model import Pieces, View, rows_of_path
from millisight.imaging._autofocus_search import (
    Places,
    Subject,
    bright_places,
    climb,
    path_modes,
    row_modes,
    sample,
    search_rows,
    smooth,
    told,
)

FOCUSES = ("rows", "path")

_LEAST_ROWS = 3
# Of the log of the contrast, at places that were not fitted: more than a path that is right gains by chance.
_LEAST_GAIN = 0.04
_STEPS = 70  # uphill
_FOLDS, _FOLDS_OF = 2, 3  # of the bright places: so many are asked in turn, each a third of them

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
    gain : by what factor the contrast of places that were not fitted grew; 1 where nothing was corrected
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
            f"± {self.uncertainty * 1e3:.3f} mm along the line of sight, contrast x {self.gain:.2f})"
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

    Sharp is an image that holds its energy in few voxels: sqrt(sum of |I|²) over the sum of |I|. Each row's offset
    along its own direction is searched by its likeness with the rows before it and by that contrast; the smooth errors
    of all three coordinates, cubic splines over the way, go uphill along its gradient.

    Nothing is corrected on its own word: the bright places are parted in three, and only what makes one part sharper
    when it was fitted to the others is believed. What the answers differ by is the uncertainty.

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
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError("the capture states the antenna positions of each pose; there is no path to correct")
    checked_record(grid, VoxelGrid, name="grid")
    if focus not in FOCUSES:
        raise UnknownNameError("focus", focus, FOCUSES)
    max_offset = checked_number(max_offset, name="max_offset", unit="frames", above=0)
    smoothness = checked_number(smoothness, name="smoothness", unit="m", above=0)
    path = capture.trajectory
    rows = rows_of_path(path)
    trials = _trials(focus, smoothness, max_offset, len(rows) >= _LEAST_ROWS)
    steps = _Steps(progress, 2 + 2 * _FOLDS * len(trials))
    mean = capture.frames_of(slice(None)).mean(axis=0)
    subject = Subject(capture, rows, Pieces.of(path, rows, capture.radar.waveform.wavelength), mean)
    places = bright_places(subject, grid.bounds, _FOLDS_OF)
    steps()
    if not np.ptp(path.positions, axis=0).any():
        return _unchanged(subject, "the radar did not move")
    if not trials:
        return _unchanged(subject, f"the path has {len(rows)} rows; expected {_LEAST_ROWS} at least")
    if len(np.unique(places.folds)) < _FOLDS_OF:
        return _unchanged(
            subject,
            f"{len(places.folds)} bright points are too few: path errors cannot be distinguished from "
            "extended reflectors",
        )
    search = _Search(subject, places, np.random.default_rng(rng), steps)
    tried: list[_Found] = []
    for trial in trials:
        # A path alone is tried last, where offsets of rows were no part of what is wrong.
        if trial.max_offset or not any(found.gain >= _LEAST_GAIN for found in tried):
            tried.append(search.validated(trial))
    best = max(tried, key=lambda found: found.gain)
    if best.gain < _LEAST_GAIN:
        gains = ", ".join(f"{' and '.join(found.trial.name)} {100 * np.expm1(found.gain):+.1f} %" for found in tried)
        return _unchanged(
            subject, f"no correction makes places sharper that it was not fitted to (change of their contrast: {gains})"
        )
    moves = search.fitted_to_all(best)
    steps()
    offsets = np.zeros(len(rows))
    if best.trial.max_offset:
        offsets = np.array([(moves[row.poses] @ row.step).mean() / (row.step @ row.step) for row in rows])
    between = (best.moves[0] - best.moves[1]) / 2
    apart = _without_common(subject, between)
    frames = [np.sqrt((apart[row.poses] ** 2).sum(axis=1).mean()) / np.linalg.norm(row.step) for row in rows]
    settings = {
        "focus": focus,
        "applied": list(best.trial.name),
        "smoothness": smoothness,
        "row_offsets": [round(float(offset), 3) for offset in offsets],
        "gain": round(float(np.exp(best.gain)), 4),
    }
    return Focused(
        capture=told(capture, moves, settings),
        row_offsets=offsets,
        row_uncertainty=float(np.sqrt(np.mean(np.square(frames)))) if best.trial.max_offset else float("inf"),
        displacements=moves,
        uncertainty=float(np.sqrt((subject.sighted(between, places) ** 2).mean())),
        gain=float(np.exp(best.gain)),
        applied=best.trial.name,
        reason="",
    )


class _Trial(NamedTuple):
    """What is corrected: offsets of rows up to so many frames; a path, its knots so far apart [m]; 0: not."""

    name: tuple[str, ...]
    max_offset: float
    smoothness: float


def _trials(focus: str, smoothness: float, max_offset: float, has_rows: bool) -> list[_Trial]:
    rows, path, both = (
        _Trial(("rows",), max_offset, 0.0), _Trial(("path",), 0.0, smoothness),
        _Trial(("rows", "path"), max_offset, smoothness),
    )  # fmt: skip
    if focus == "rows":
        return [rows] if has_rows else []
    return [rows, both, path] if has_rows else [path]


class _Found(NamedTuple):
    """A trial, its answers (P, 3) when fitted to some of the places [m], and the mean growth of the log of the contrast
    of the other places."""

    trial: _Trial
    moves: list[np.ndarray]
    gain: float


def _unchanged(subject: Subject, reason: str) -> Focused:
    return Focused(
        capture=subject.capture,
        row_offsets=np.zeros(len(subject.rows)),
        row_uncertainty=float("inf"),
        displacements=np.zeros_like(subject.capture.trajectory.positions),
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
    """Fits trials to some of the bright places, and asks the others."""

    def __init__(self, subject: Subject, places: Places, rng: np.random.Generator, steps: _Steps):
        self._subject, self._places, self._rng, self._step_done = subject, places, rng, steps
        self._nothing = np.zeros_like(subject.capture.trajectory.positions)
        self._views: dict[int, View] = {}

    def validated(self, trial: _Trial) -> _Found:
        """A trial fitted to all places but those of one fold, which are asked, for each of two folds."""
        found, grown = [], []
        for fold in range(_FOLDS):
            found.append(self._fit(trial, fold))
            self._step_done()
            asked = self._asked(fold)
            still, moved = (asked.contrast(self._subject.pieces.means(m))[0] for m in (self._nothing, found[-1]))
            grown.append(moved - still)
            self._step_done()
        return _Found(trial, found, float(np.mean(grown)))

    def fitted_to_all(self, best: _Found) -> np.ndarray:
        """(P, 3) the sharpest of the answers that all places give, from nothing and from each fold's answer."""
        points = self._points(np.ones(len(self._places.folds), bool))
        view = self._subject.view(self._nothing, points)

        def sharpest(answers: list[np.ndarray]) -> np.ndarray:
            return max(answers, key=lambda moves: view.contrast(self._subject.pieces.means(moves))[0])

        answers = [*best.moves, self._begun(best.trial, view)]
        if best.trial.smoothness:
            # The last one begins from the rows that all places tell; the sharper one of all is brought to its top.
            answers[-1] = answers[-1] + self._climbed(best.trial, answers[-1], points)
            moves = sharpest(answers)
            answers.append(moves + self._climbed(best.trial, moves, points))
        moves = sharpest(answers)
        # A shift of everything only moves the image.
        return moves - moves.mean(axis=0)

    def _fit(self, trial: _Trial, fold: int) -> np.ndarray:
        """(P, 3) a trial's answer from all places but those of a fold [m]."""
        points = self._points(self._places.folds != fold)
        moves = self._begun(trial, self._subject.view(self._nothing, points))
        return moves + self._climbed(trial, moves, points) if trial.smoothness else moves

    def _begun(self, trial: _Trial, view: View) -> np.ndarray:
        """(P, 3) what the rows one by one tell [m]; where there are none, nothing."""
        subject = self._subject
        moves = np.zeros_like(self._nothing)
        if len(subject.rows) < _LEAST_ROWS:
            return moves
        offsets, shifts = search_rows(subject, view, trial.max_offset, depths=trial.smoothness > 0)
        if trial.smoothness:
            for row, shift in zip(subject.rows, shifts, strict=True):
                moves[row.poses] = shift
            moves = smooth(path_modes(subject, trial.smoothness), moves)
        for row, offset in zip(subject.rows, offsets, strict=True):
            moves[row.poses] += offset * row.step
        return moves

    def _climbed(self, trial: _Trial, moves: np.ndarray, points: np.ndarray) -> np.ndarray:
        modes = [path_modes(self._subject, trial.smoothness)]
        if trial.max_offset:
            modes.append(row_modes(self._subject))
        return climb(self._subject, self._subject.view(moves, points), modes, _STEPS)

    def _points(self, chosen: np.ndarray) -> np.ndarray:
        return sample(self._subject, self._places, chosen, self._rng)

    def _asked(self, fold: int) -> View:
        if fold not in self._views:
            self._views[fold] = self._subject.view(self._nothing, self._points(self._places.folds == fold))
        return self._views[fold]


def _without_common(subject: Subject, moves: np.ndarray) -> np.ndarray:
    """`moves` (P, 3) without what shifts, stretches, shears or turns the whole path [m]."""
    terms = np.concatenate([np.ones((len(moves), 1)), subject.capture.trajectory.positions], axis=1)
    return moves - terms @ np.linalg.lstsq(terms, moves, rcond=None)[0]
