"""The search for the poses in which what shines of a mesh agrees with oriented points."""

from typing import NamedTuple

import numpy as np

from millisight.core import rotation_from_vector
from millisight.data import PointCloud
from millisight.geometry import _pose_kernels as kernels
from millisight.geometry._samples import MeshSamples
from millisight.geometry._turns import angle_deg

_SHINES_DEG = 8.0  # from the direction to the nearest of some antennas: what shines
_ANTENNAS = 160
_SURE = 0.0015  # standard deviation of a place at which a point counts half [m]
_CELL, _CELLS = 0.008, 40  # of the votes [m]
_VOTE = np.radians(20.0)
_ROUGH = (0.008, np.radians(20.0))  # standard deviations of place [m] and turn
_STAGES = ((0.008, np.radians(18.0), 12), (0.005, np.radians(12.0), 12), (0.0035, np.radians(9.0), 14))
FINE = (0.004, np.radians(10.0))
"""Standard deviations of place [m] and turn [rad] by which poses are compared."""
CLIMBERS = 80
"""Poses that are fitted."""
_STEP = (0.004, np.radians(5.0))  # of the differences that tell the curvature [m], [rad]
_ALIKE = (0.01, 12.0)  # [m], [degrees]
_RESTS = (-0.002, 0.006)  # how far the lowest corner may lie above the support: its height is told roughly [m]


class Seen(NamedTuple):
    """Oriented points, thinned, and the antennas that saw them.

    Attributes
    ----------
    points, normals : (M, 3), (M, 3)
    weights : (M,)
    antennas : (A, 3) some of the antennas, and their middle at last [m]
    support : height of what the object lies on [m]; None: unknown
    """

    points: np.ndarray
    normals: np.ndarray
    weights: np.ndarray
    antennas: np.ndarray
    support: float | None = None


class Fit(NamedTuple):
    """A pose of a mesh's samples, moved to their middle, and how well it agrees.

    Attributes
    ----------
    rotation, translation : (3, 3), (3,) of the mesh about its middle [m]
    explained : share of the points that the mesh explains
    shown : share of what shines of the mesh that was found
    """

    rotation: np.ndarray
    translation: np.ndarray
    explained: float
    shown: float

    @property
    def score(self) -> float:
        return score_of(self.explained, self.shown)


def score_of(explained, shown):
    """Harmonic mean of both shares."""
    return 2 * explained * shown / np.maximum(explained + shown, 1e-9)


def seen_by(
    cloud: PointCloud,
    normals: np.ndarray,
    antennas: np.ndarray,
    *,
    spacing: float,
    most: int,
    support: float | None = None,
) -> Seen:
    """The surest point of each cube of side `spacing`, the surest `most` of all."""
    cells = np.floor(cloud.points / spacing).astype(np.int64)
    sigma = np.zeros(len(cloud)) if cloud.place_sigma is None else cloud.place_sigma
    weights = 1 / (1 + (sigma / _SURE) ** 2)
    order = np.argsort(-weights, kind="stable")
    first = np.unique(cells[order], axis=0, return_index=True)[1]
    chosen = np.sort(order[np.sort(first)][:most])
    some = some_antennas(antennas)
    return Seen(
        np.ascontiguousarray(cloud.points[chosen]), np.ascontiguousarray(normals[chosen]),
        np.ascontiguousarray(weights[chosen]), np.concatenate([some, some.mean(axis=0, keepdims=True)]), support,
    )  # fmt: skip


def some_antennas(antennas: np.ndarray, count: int = _ANTENNAS) -> np.ndarray:
    """Of antennas (n, 3), the first in each of some `count` cubes."""
    flat = np.asarray(antennas, dtype=float).reshape(-1, 3)
    low, high = 1e-4, max(float(np.ptp(flat, axis=0).max()), 1e-3)
    for _ in range(30):
        side = np.sqrt(low * high)
        first = np.unique(np.floor(flat / side), axis=0, return_index=True)[1]
        low, high = (side, high) if len(first) > count else (low, side)
    return np.ascontiguousarray(flat[np.sort(np.unique(np.floor(flat / high), axis=0, return_index=True)[1])])


def register(
    shape: MeshSamples, rotations: np.ndarray, seen: Seen, *, most: int = 20, climbers: int = CLIMBERS
) -> list[Fit]:
    """The best poses, best first, no two alike; of all `rotations` the best `climbers` are fitted."""
    points = np.ascontiguousarray(shape.points - shape.middle)
    normals, clear = np.ascontiguousarray(shape.normals), shape.clear
    cosine = float(np.cos(np.radians(_SHINES_DEG)))
    middle = np.median(seen.points, axis=0)
    of_mesh = points, normals, clear
    places = kernels.vote(
        *of_mesh,
        rotations,
        middle,
        seen.antennas,
        cosine,
        seen.points,
        seen.normals,
        seen.weights,
        _VOTE,
        _CELL,
        _CELLS,
    )
    _rest(shape, rotations, places, seen)
    rough = score_of(*agreements(shape, rotations, places, seen, *_ROUGH).T)
    chosen = np.argsort(-rough, kind="stable")[:climbers]
    turned, moved = rotations[chosen].copy(), places[chosen].copy()
    for place, turn, steps in _STAGES:
        kernels.climb(
            *of_mesh,
            turned,
            moved,
            seen.antennas,
            cosine,
            seen.points,
            seen.normals,
            seen.weights,
            place,
            turn,
            shape.spacing,
            steps,
        )
        _rest(shape, turned, moved, seen)
    shares = agreements(shape, turned, moved, seen, *FINE)
    scores = score_of(*shares.T)
    fits: list[Fit] = []
    for n in np.argsort(-scores, kind="stable"):
        if all(
            np.linalg.norm(moved[n] - one.translation) > _ALIKE[0] or angle_deg(turned[n], one.rotation) > _ALIKE[1]
            for one in fits
        ):
            fits.append(Fit(turned[n], moved[n], float(shares[n, 0]), float(shares[n, 1])))
            if len(fits) == most:
                break
    return fits


def _rest(shape: MeshSamples, rotations: np.ndarray, translations: np.ndarray, seen: Seen) -> None:
    """Raise or lower poses in place so that they rest on the support, where its height is known."""
    if seen.support is None:
        return
    lowest = ((shape.corners - shape.middle) @ rotations[:, 2].T).min(axis=0)
    above = translations[:, 2] + lowest - seen.support
    translations[:, 2] += np.clip(above, *_RESTS) - above


def rescored(shape: MeshSamples, fits: list[Fit], seen: Seen) -> list[Fit]:
    """Poses by their agreement with other points, or of other samples about the same middle, best first."""
    turned, moved = np.stack([one.rotation for one in fits]), np.stack([one.translation for one in fits])
    shares = agreements(shape, turned, moved, seen, *FINE)
    made = [Fit(one.rotation, one.translation, float(e), float(s)) for one, (e, s) in zip(fits, shares, strict=True)]
    return sorted(made, key=lambda one: -one.score)


def agreements(
    shape: MeshSamples, rotations: np.ndarray, translations: np.ndarray, seen: Seen, place: float, turn: float
) -> np.ndarray:
    """(n, 2) shares explained and shown, of n poses about the mesh's middle."""
    return kernels.agreements(
        np.ascontiguousarray(shape.points - shape.middle), np.ascontiguousarray(shape.normals), shape.clear,
        np.ascontiguousarray(rotations), np.ascontiguousarray(translations), seen.antennas,
        float(np.cos(np.radians(_SHINES_DEG))), seen.points, seen.normals, seen.weights, place, turn,
        shape.spacing,
    )  # fmt: skip


def curvature(shape: MeshSamples, fit: Fit, seen: Seen) -> np.ndarray:
    """(6, 6) negative second derivatives of ln(score) by a shift [m] and a turn about the middle [rad]."""
    steps = np.repeat(_STEP, 3)
    offsets = [np.zeros(6)]
    pairs = [(i, j) for i in range(6) for j in range(i, 6)]
    for i, j in pairs:
        for one, other in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            offset = np.zeros(6)
            offset[i] += one * steps[i] / 2
            offset[j] += other * steps[j] / 2
            offsets.append(offset)
    moves = np.array(offsets)
    turned = rotation_from_vector(moves[:, 3:]) @ fit.rotation
    shares = agreements(shape, turned, fit.translation + moves[:, :3], seen, *FINE)
    values = np.log(np.maximum(score_of(*shares.T), 1e-6))[1:].reshape(-1, 4)
    made = np.zeros((6, 6))
    for (i, j), (pp, pm, mp, mm) in zip(pairs, values, strict=True):
        made[i, j] = made[j, i] = -(pp - pm - mp + mm) / (steps[i] * steps[j])
    return made
