"""Two point clouds laid one on the other: iterative closest points (Besl and McKay 1992), from several starts.

Pairs are made both ways, from every point of either cloud to its nearest in the other, so that neither cloud slides
about within a larger one. Nothing is drawn by chance: the same clouds give the same alignment.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    check_known,
    checked_array,
    checked_integer,
    checked_number,
    rotation_from_euler_deg,
    rotation_from_vector,
)
from millisight.core.errors import InputError

MODES = ("translation", "rigid")

_FARTHEST = 1e9  # of a point [m], whose square is taken
_SKETCH = 600  # points of either cloud with which the starts are compared
_TURNS_DEG = (-8.0, 0.0, 8.0)  # starts of a rigid alignment, about z
_SHIFTS = (-0.015, 0.0, 0.015)  # starts, along each axis [m]


class Alignment(NamedTuple):
    """The transform of the moving cloud: rotation @ point + translation.

    Attributes
    ----------
    rotation : (3, 3); the identity of a translation alone
    translation : (3,) [m]
    rms : of the distances of the pairs [m]
    iterations : of the last stage
    converged : whether the last step was small enough before the iterations ran out
    """

    rotation: np.ndarray
    translation: np.ndarray
    rms: float
    iterations: int
    converged: bool

    def __repr__(self) -> str:
        shift = ", ".join(f"{1e3 * one:.3g}" for one in self.translation)
        turn_deg = np.degrees(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1)))
        end = "" if self.converged else ", not converged"
        return f"Alignment(by ({shift}) mm and {turn_deg:.3g} degrees, rms {1e3 * self.rms:.3g} mm{end})"

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) points where they are moved to [m]."""
        return points @ self.rotation.T + self.translation


def align(
    moving: ArrayLike,
    fixed: ArrayLike,
    *,
    mode: str = "translation",
    surfaces: bool = False,
    most_points: int = 3000,
    most_iterations: int = 60,
    tolerance: float = 1e-5,
) -> Alignment:
    """Align the cloud `moving` with the cloud `fixed`.

    The starts: the clouds' means, and the middles of their bounding boxes, on each other; then 15 mm off along each
    axis; of a rigid alignment also turned by 8 degrees about z. All are compared on a thinned cloud, and the best goes
    on.

    Parameters
    ----------
    moving, fixed : (N, 3) and (M, 3) points [m]
    mode : "translation", or "rigid": with a rotation
    surfaces : whether the points are samples of surfaces: then the distances along the normals of `fixed` count (Chen
        and Medioni 1991), which is sharper; the points of a voxel grid fill volumes
    most_points : of each cloud; larger clouds are thinned evenly
    most_iterations : of the last stage
    tolerance : the alignment has converged when no point moves further in a step [m]

    Raises
    ------
    InputError
        A cloud is empty, or has fewer points than a rotation needs.
    UnknownNameError
        No such mode.
    """
    check_known("mode of alignment", mode, MODES)
    least = 1 if mode == "translation" else 3
    clouds = []
    for name, points in (("moving", moving), ("fixed", fixed)):
        try:
            count = len(np.atleast_2d(points)) if np.size(points) else 0
        except ValueError:  # of rows that differ, which are refused below
            count = least
        if count < least:
            what = {0: "is empty", 1: "is a single point"}.get(count, f"has {count} points")
            raise InputError(f"the {name} cloud {what}; a {mode} alignment needs at least {least}: lower the threshold")
        clouds.append(checked_array(points, name=name, shape=("N", 3), unit="m"))
        if (far := np.abs(clouds[-1]).max()) > _FARTHEST:
            raise InputError(f"the {name} cloud reaches {far:.3g} m; expected under {_FARTHEST:g} m")
    checked_number(tolerance, name="tolerance", unit="m", above=0)
    most = checked_integer(most_points, name="most_points")
    rigid = mode == "rigid"
    sketch = _Pairing(thinned(clouds[0], min(_SKETCH, most)), thinned(clouds[1], min(_SKETCH, most)), surfaces=False)
    tried = [sketch.run(start, rigid, 15, 20 * tolerance) for start in _starts(clouds[0], clouds[1], rigid)]
    best = min(tried, key=lambda one: one.rms)
    whole = _Pairing(thinned(clouds[0], most), thinned(clouds[1], most), surfaces=surfaces)
    return whole.run(best, rigid, checked_integer(most_iterations, name="most_iterations"), tolerance)


def thinned(points: np.ndarray, most: int) -> np.ndarray:
    """`most` of the points (N, 3), evenly spread through their order; all where they are no more."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).round().astype(int)]


def _starts(moving: np.ndarray, fixed: np.ndarray, rigid: bool) -> list[Alignment]:
    boxes = [(cloud.min(axis=0) + cloud.max(axis=0)) / 2 for cloud in (moving, fixed)]
    means = [cloud.mean(axis=0) for cloud in (moving, fixed)]
    shifts = [np.zeros(3), *(shift * axis for axis in np.eye(3) for shift in _SHIFTS if shift)]
    places = [(means, np.zeros(3)), *((boxes, shift) for shift in shifts)]
    starts = []
    for turn in _TURNS_DEG if rigid else (0.0,):
        rotation = rotation_from_euler_deg((0, 0, turn))
        for (source, target), shift in places:
            starts.append(Alignment(rotation, target - rotation @ source + shift, np.inf, 0, False))
    return starts


class _Pairing:
    """Two clouds with their trees; pairs of nearest points, both ways."""

    def __init__(self, moving: np.ndarray, fixed: np.ndarray, *, surfaces: bool):
        from scipy.spatial import KDTree

        self.moving, self.fixed = moving, fixed
        self.trees: tuple[Any, Any] = KDTree(moving), KDTree(fixed)
        self.normals = _normals(fixed, self.trees[1]) if surfaces and len(fixed) > 8 else None
        self.reach = float(np.ptp(moving, axis=0).max())

    def pairs(self, at: Alignment) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the pairs in the moving and in the fixed cloud."""
        forth = self.trees[1].query(at.apply(self.moving))[1]
        back = self.trees[0].query((self.fixed - at.translation) @ at.rotation)[1]
        return (
            np.concatenate([np.arange(len(self.moving)), back]),
            np.concatenate([forth, np.arange(len(self.fixed))]),
        )

    def run(self, start: Alignment, rigid: bool, most: int, tolerance: float) -> Alignment:
        at = start
        for number in range(1, most + 1):
            i, j = self.pairs(at)
            source, target = self.moving[i], self.fixed[j]
            moved = at.apply(source)
            # Either way counts alike, however many points it has.
            weights = np.concatenate(
                [np.full(len(self.moving), 0.5 / len(self.moving)), np.full(len(self.fixed), 0.5 / len(self.fixed))]
            )
            if self.normals is not None:
                rotation, translation = _plane_step(at, moved, target, self.normals[j], weights, rigid)
            else:
                rotation, translation = _point_step(source, target, weights, rigid)
            turned = np.linalg.norm(rotation - at.rotation) * self.reach
            middle = source.mean(axis=0)
            step = np.linalg.norm((rotation - at.rotation) @ middle + translation - at.translation) + turned
            rms = float(np.sqrt((weights * ((moved - target) ** 2).sum(axis=1)).sum()))
            at = Alignment(rotation, translation, rms, number, bool(step < tolerance))
            if at.converged:
                break
        return at


def _point_step(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray, rigid: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of the least weighted squared distances, in closed form (Kabsch 1976)."""
    a, b = weights @ source, weights @ target
    if not rigid:
        return np.eye(3), b - a
    u, _, vt = np.linalg.svd(((target - b) * weights[:, None]).T @ (source - a))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rotation, b - rotation @ a


def _plane_step(
    at: Alignment, moved: np.ndarray, target: np.ndarray, normals: np.ndarray, weights: np.ndarray, rigid: bool
) -> tuple[np.ndarray, np.ndarray]:
    """One Gauss-Newton step of the weighted squared distances along the normals."""
    middle = moved.mean(axis=0)
    rows = np.hstack([np.cross(moved - middle, normals), normals]) if rigid else normals
    away = ((target - moved) * normals).sum(axis=1)
    scaled = rows * weights[:, None]
    normal_matrix = scaled.T @ rows
    # Where nothing holds the cloud, as about a ball's middle or along a plane, it stays.
    step = np.linalg.lstsq(normal_matrix, scaled.T @ away, rcond=1e-5)[0]
    turn = rotation_from_vector(step[:3]) if rigid else np.eye(3)
    translation = turn @ (at.translation - middle) + middle + step[-3:]
    return turn @ at.rotation, translation


def _normals(points: np.ndarray, tree: Any, neighbours: int = 9) -> np.ndarray:
    """(N, 3) unit normals: of each point's nearest the direction in which they spread least."""
    near = points[tree.query(points, k=min(neighbours, len(points)))[1]]
    spread = near - near.mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
