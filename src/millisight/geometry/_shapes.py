"""Balls, cylinders and cones that fit oriented points."""

from typing import Any, NamedTuple

import numpy as np

_PLACE, _TURN = 0.001, 0.1  # standard deviations of places [m] and normals [rad] in a fit
_WITHIN, _WITHIN_DEG = 0.0025, 12.0  # of a shape, a point agrees with it [m], [degrees]
_SMALLEST, _LARGEST = 0.008, 0.12  # radius [m]
_LEAST = 14  # points that agree
_LEAST_ARC_DEG = 14.0  # that their normals turn by, for a radius to be known
_TAPER = 0.5  # largest slope of a cone
_PAIRS, _SEED = 600, 0  # of points that a shape is guessed from
_APART_DEG = (7.0, 70.0)  # between the normals of a pair
_SIMPLER = 0.9  # a ball is taken where that share of the points agrees with it which does with the best cylinder
_ROUNDS = 3


class Shape(NamedTuple):
    """A ball, or a cylinder or cone between two ends.

    Attributes
    ----------
    kind : "ball", "cylinder" or "cone"
    centre : (3,) of the ball; of the others a point of the axis [m]
    axis : (3,) unit vector of the axis; of a ball towards what was seen
    towards : (3,) unit vector across the axis, towards what was seen
    radius : at the centre [m]
    taper : by which the radius grows along the axis
    ends : along the axis, from the centre [m]; of a ball (0, 0)
    agreeing : (N,) bool, the points that agree with it
    """

    kind: str
    centre: np.ndarray
    axis: np.ndarray
    towards: np.ndarray
    radius: float
    taper: float
    ends: tuple[float, float]
    agreeing: np.ndarray

    @property
    def told(self) -> dict[str, Any]:
        """What JSON holds."""
        made = {"shape": self.kind, "radius": self.radius, "centre": self.centre.tolist()}
        if self.kind != "ball":
            made |= {"axis": self.axis.tolist(), "taper": self.taper, "ends": list(self.ends)}
        return made

    def lattice(self, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        """(I, J, 3) places about `spacing` apart [m], and their outward normals; J goes around and closes.

        Of a ball its half towards what was seen and somewhat more.
        """
        steps = max(int(np.ceil(2 * np.pi * self.radius / spacing)), 12)
        around = np.linspace(-np.pi, np.pi, steps + 1)
        side = np.cross(self.axis, self.towards)
        ring = np.cos(around)[:, None] * self.towards + np.sin(around)[:, None] * side
        if self.kind == "ball":
            tilt = np.linspace(0.02, 0.75 * np.pi, max(steps * 3 // 8, 6))[:, None, None]
            normals = np.cos(tilt) * self.axis + np.sin(tilt) * ring
            return self.centre + self.radius * normals, normals
        count = max(int(np.ceil((self.ends[1] - self.ends[0]) / spacing)), 2)
        along = np.linspace(*self.ends, count + 1)[:, None, None]
        places = self.centre + along * self.axis + (self.radius + self.taper * along) * ring
        normals = (ring - self.taper * self.axis) / np.hypot(1, self.taper)
        return places, np.broadcast_to(normals, places.shape)


def shape_of(points: np.ndarray, normals: np.ndarray) -> Shape | None:
    """The shape that most of the oriented points (N, 3), (N, 3) agree with; None where none does.

    Pairs of points state balls and cylinders; the one with the most points is fitted to them.
    """
    generator = np.random.default_rng(_SEED)
    one, other = generator.integers(0, len(points), (2, 40 * _PAIRS))
    angle = np.degrees(np.arccos(np.clip((normals[one] * normals[other]).sum(axis=1), -1, 1)))
    chosen = np.flatnonzero((angle > _APART_DEG[0]) & (angle < _APART_DEG[1]))[:_PAIRS]
    one, other = one[chosen], other[chosen]
    best = [_best(make(points, normals, one, other), points, normals) for make in (_balls, _cylinders)]
    best = [shape for shape in best if shape is not None]
    return max(best, key=lambda it: it.agreeing.sum() / (_SIMPLER if it.kind == "ball" else 1), default=None)


def _balls(points: np.ndarray, normals: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(K, 4) centres and radii of the balls that pairs of points state."""
    way, turn = points[one] - points[other], normals[one] - normals[other]
    radius = (way * turn).sum(axis=1) / (turn * turn).sum(axis=1)
    return np.column_stack([points[one] - radius[:, None] * normals[one], radius])


def _cylinders(points: np.ndarray, normals: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(K, 7) points of the axes, radii, and axes of the cylinders that pairs of points state."""
    axis = np.cross(normals[one], normals[other])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    ball = _balls(points, normals, one, other)  # what the pair is apart along the axis does not matter
    return np.column_stack([ball, axis])


def _parted(values: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances of points from a shape [m], and (N, 3) its normals there.

    `values` are the centre and the radius of a ball; and of a cylinder or cone its axis and, where it is there, taper.
    """
    ways = points - values[:3]
    if len(values) == 4:
        far = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        return far - values[3], ways / far[:, None]
    axis, taper = values[4:7] / np.linalg.norm(values[4:7]), values[7] if len(values) > 7 else 0.0
    along = ways @ axis
    ways = ways - along[:, None] * axis
    far = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
    slant = np.hypot(1, taper)
    return (far - values[3] - taper * along) / slant, (ways / far[:, None] - taper * axis) / slant


def _agreeing(values: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    off, expected = _parted(values, points)
    alike = (normals * expected).sum(axis=1) > np.cos(np.radians(_WITHIN_DEG))
    return (np.abs(off) < _WITHIN) & alike


def _best(candidates: np.ndarray, points: np.ndarray, normals: np.ndarray) -> Shape | None:
    """The candidate that most points agree with, fitted to them; None where these are too few, or hollow, or flat."""
    sized = candidates[(candidates[:, 3] > _SMALLEST) & (candidates[:, 3] < _LARGEST)]
    if not len(sized):
        return None
    counts = [int(_agreeing(one, points, normals).sum()) for one in sized]
    values = sized[int(np.argmax(counts))]
    if len(values) > 4:
        values = np.r_[values, 0.0]
    for _ in range(_ROUNDS):
        agreeing = _agreeing(values, points, normals)
        if agreeing.sum() < _LEAST:
            return None
        values = _fitted(values, points[agreeing], normals[agreeing])
    agreeing = _agreeing(values, points, normals)
    radius = float(values[3])
    if agreeing.sum() < _LEAST or not _SMALLEST < radius < _LARGEST:
        return None
    mean = normals[agreeing].mean(axis=0)
    mean /= np.linalg.norm(mean)
    spread = np.degrees(np.arccos(np.clip(normals[agreeing] @ mean, -1, 1)))
    if 2 * np.quantile(spread, 0.9) < _LEAST_ARC_DEG:
        return None
    if len(values) == 4:
        return Shape("ball", values[:3], mean, np.linalg.svd(mean[None])[2][1], radius, 0.0, (0.0, 0.0), agreeing)
    axis, taper = values[4:7] / np.linalg.norm(values[4:7]), float(values[7])
    along = (points[agreeing] - values[:3]) @ axis
    ends = float(np.quantile(along, 0.02)), float(np.quantile(along, 0.98))
    if abs(taper) > _TAPER or min(radius + taper * one for one in ends) <= 0:
        return None
    towards = mean - (mean @ axis) * axis
    towards /= np.linalg.norm(towards)
    kind = "cylinder" if abs(taper) < np.radians(2) else "cone"
    return Shape(kind, values[:3], axis, towards, radius, taper, ends, agreeing)


def _fitted(start: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The shape that agrees best, by least squares over places and normals."""
    from scipy.optimize import least_squares

    def residuals(values: np.ndarray) -> np.ndarray:
        off, expected = _parted(values, points)
        made = [off / _PLACE, ((normals - expected) / _TURN).ravel()]
        if len(values) > 4:  # the centre beside the points, the axis of length 1
            made.append(np.r_[(values[:3] - middle) @ values[4:7] / 0.01, np.linalg.norm(values[4:7]) - 1])
        return np.concatenate(made)

    middle = points.mean(axis=0)
    if len(start) > 4:
        axis = start[4:7] / np.linalg.norm(start[4:7])
        slid = (middle - start[:3]) @ axis
        start = np.r_[start[:3] + slid * axis, start[3] + slid * start[7], axis, start[7]]
    scale = np.r_[np.full(4, 1e-2), np.full(len(start) - 4, 0.1)]
    return least_squares(residuals, start, loss="soft_l1", x_scale=scale, max_nfev=40).x
