"""Where a known lid lies: a rectangle, perhaps turned about z.

Across its edges an image changes within a voxel or two, along them it is alike. Its turn is found in two steps: to some
degrees by the smallest rectangle around the cells that echo like one mirror, and to some tenths of a degree by how
alike the image is along the edges.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

_STRAIGHT = 0.9  # of the box along the axes, which a turned rectangle around the same cells must be smaller than
_COARSE = np.radians(np.arange(-44.0, 46.0))  # a rectangle's turn is known up to 90 degrees
_STEPS_DEG = (1.0, 10), (0.25, 3), (0.05, 4)  # of the search for the turn: size, and how many to either side
_SURELY = 0.8  # a turn must leave less than this share of what no turn leaves unexplained
_ENDS = 0.1  # of a side, at either end of an edge, that are left out of the profile across it
_STRIP = 0.015  # near an edge [m]
_LEAST_BINS = 4  # across a lid


class LidPlace(NamedTuple):
    """A rectangle over x and y.

    Attributes
    ----------
    turn : angle from x to its own first axis [rad]; 0: it is in line with the axes
    lower, upper : (2,) its corners along its own axes [m]
    """

    turn: float
    lower: np.ndarray
    upper: np.ndarray

    def along(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (x, y) [m] along its own axes [m]."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return x * cos + y * sin, y * cos - x * sin

    def inside(self, x: np.ndarray, y: np.ndarray, rim: np.ndarray | float = 0.0) -> np.ndarray:
        """Whether places lie in it, and farther than `rim` (2,) from its edges [m]."""
        u, v = self.along(x, y)
        (u0, v0), (u1, v1) = self.lower + rim, self.upper - rim
        return (u0 <= u) & (u <= u1) & (v0 <= v) & (v <= v1)

    def wider(self, by: float) -> "LidPlace":
        """One whose edges lie so much farther out [m]; below 0, farther in, half of its sides at most."""
        by = max(by, -float((self.upper - self.lower).min()) / 2)
        return self._replace(lower=self.lower - by, upper=self.upper + by)

    def nearest(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each place (x, y) the nearest one in it [m]."""
        u, v = (np.clip(*one) for one in zip(self.along(x, y), self.lower, self.upper, strict=True))
        return self._back(u, v)

    @property
    def corners(self) -> np.ndarray:
        """(4, 2) x and y of its corners, counterclockwise [m]."""
        (u0, v0), (u1, v1) = self.lower, self.upper
        return np.column_stack(self._back(np.array([u0, u1, u1, u0]), np.array([v0, v0, v1, v1])))

    def _back(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return u * cos - v * sin, v * cos + u * sin


def sides_of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(2,) of the cells with these middles [m]; 1 m along an axis that has one."""
    return np.array([float(np.diff(axis).mean()) if len(axis) > 1 else 1.0 for axis in (x, y)])


def all_of(x: np.ndarray, y: np.ndarray) -> LidPlace:
    """The rectangle of all cells with these middles [m]."""
    ends = np.array([[axis[0], axis[-1]] for axis in (x, y)], dtype=float)
    return LidPlace(0.0, ends[:, 0] - sides_of(x, y) / 2, ends[:, 1] + sides_of(x, y) / 2)


def rectangle_around(part: np.ndarray, x: np.ndarray, y: np.ndarray) -> LidPlace:
    """The smallest rectangle around the cells of a part, in line with the axes unless a turned one is far smaller.

    Parameters
    ----------
    part : (X, Y) bool, at least one cell
    x, y : middles of the cells [m]
    """
    rows = np.flatnonzero(part.any(axis=1))
    first, last = part[rows].argmax(axis=1), part.shape[1] - 1 - part[rows, ::-1].argmax(axis=1)
    i, j = np.tile(rows, 2), np.concatenate([first, last])  # the others lie between these
    half = sides_of(x, y) / 2

    def around(turn: float) -> LidPlace:
        along = np.stack(LidPlace(turn, half, half).along(x[i], y[j]))
        return LidPlace(turn, along.min(axis=1) - half, along.max(axis=1) + half)

    straight = around(0.0)
    if min(part.shape) == 1:  # of one row a turn means nothing
        return straight
    best = min((around(float(turn)) for turn in _COARSE), key=_area)
    return best if _area(best) < _STRAIGHT * _area(straight) else straight


def _area(place: LidPlace) -> float:
    return float(np.prod(place.upper - place.lower))


def sharpened(place: LidPlace, amplitude: np.ndarray, x: np.ndarray, y: np.ndarray) -> LidPlace:
    """The place with the turn by which the image along its edges is most alike, and edges at half of the amplitude.

    One in line with the axes stays as it is, its edges right to a cell, unless it is surely turned and all its corners
    are seen. A turn of less than about 1.5 degrees may count as none.

    Parameters
    ----------
    place : its turn right to 10 degrees
    amplitude : (X, Y) of the lid's echo
    x, y : of its pixels [m]
    """
    if min(amplitude.shape) < _LEAST_BINS:
        return place
    step = float(max(np.diff(x).mean(), np.diff(y).mean()))
    ring = place.wider(2 * _STRIP).inside(x[:, None], y) & ~place.wider(-2 * _STRIP).inside(x[:, None], y)
    i, j = np.nonzero(ring)
    pixels = x[i], y[j], amplitude[ring]
    best = place.turn
    for size, many in _STEPS_DEG:
        turns = best + np.radians(size * np.arange(-many, many + 1))
        least, best = min((_unlike(_turned(place, turn), pixels, step), turn) for turn in turns)
    if least > _SURELY * _unlike(_turned(place, 0.0), pixels, step):
        if place.turn == 0:
            return place
        best = 0.0
    turned = _turned(place, best)
    ends = [
        _ends(profile, origin, step, low, high)
        for (profile, origin), low, high in zip(
            _profiles(turned, amplitude, x, y, step), turned.lower, turned.upper, strict=True
        )
    ]
    found = LidPlace(float(best), np.array([one[0] for one in ends]), np.array([one[1] for one in ends]))
    corners = found.corners
    all_seen = all(((axis[0] < one) & (one < axis[-1])).all() for axis, one in zip((x, y), corners.T, strict=True))
    return found if all_seen or place.turn else place


def lines_of(
    u: np.ndarray, v: np.ndarray
) -> tuple[Callable[[np.ndarray, np.ndarray, int], np.ndarray], Callable[[np.ndarray, int], np.ndarray]]:
    """`total` and `spread`, as `rippled` asks for them, of lines along turned edges, half a pixel apart.

    Between two lines a pixel has a share of each.

    Parameters
    ----------
    u, v : (X, Y) places of the pixels along the turned axes [m]
    """
    from scipy.sparse import csr_array

    shares = []
    for along in (u, v):
        step = float(np.hypot(*(np.diff(along, axis=axis).mean() for axis in (0, 1)))) / 2
        places = (along - along.min()).ravel() / step
        low = places.astype(int)
        which, share = np.concatenate([low, low + 1]), np.concatenate([low + 1 - places, places - low])
        pixels = np.tile(np.arange(along.size), 2)
        shares.append(csr_array((share.astype(np.float32), (which, pixels)), shape=(low.max() + 2, along.size)))
    back = [one.T.tocsr() for one in shares]

    def total(weights: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
        return shares[axis] @ (weights[..., None] * values).reshape(u.size, -1)

    def spread(table: np.ndarray, axis: int) -> np.ndarray:
        return (back[axis] @ table).reshape(*u.shape, -1)

    return total, spread


def _turned(place: LidPlace, turn: float) -> LidPlace:
    """A rectangle of the same sides about the same middle."""
    middle = np.array(LidPlace(turn, place.lower, place.upper).along(*place.corners.mean(axis=0)))
    half = (place.upper - place.lower) / 2
    return LidPlace(float(turn), middle - half, middle + half)


def _profiles(
    place: LidPlace, amplitude: np.ndarray, x: np.ndarray, y: np.ndarray, step: float
) -> list[tuple[np.ndarray, float]]:
    """The mean amplitude over each of its own axes, in bins of a `step`, and where the first bin begins [m]."""
    along, made = place.along(x[:, None], y), []
    for axis in (0, 1):
        beside = _beside(place, along, axis)
        first = float(along[axis].min())  # the middle of the first bin
        bins = np.rint((along[axis][beside] - first) / step).astype(int)
        counts = np.bincount(bins)
        filled = np.flatnonzero(counts)
        means = np.bincount(bins, weights=amplitude[beside])[filled] / counts[filled]
        made.append((np.interp(np.arange(len(counts)), filled, means), first - step / 2))
    return made


def _beside(place: LidPlace, along: tuple[np.ndarray, np.ndarray], axis: int) -> np.ndarray:
    """Whether pixels, `along` its own axes [m], lie beside the edges across an axis, and not near the ends of these."""
    low, high, other = place.lower[1 - axis], place.upper[1 - axis], along[1 - axis]
    rim = _ENDS * (high - low)
    return (other > low + rim) & (other < high - rim)


def _unlike(place: LidPlace, pixels: tuple[np.ndarray, np.ndarray, np.ndarray], step: float) -> float:
    """Share of the variance near its edges that the distance to them does not explain.

    Parameters
    ----------
    place : LidPlace
    pixels : x, y [m] and amplitude (N,) of those near its edges
    step : between pixels [m]; bins are half as wide
    """
    along, left, whole = place.along(*pixels[:2]), 0.0, 0.0
    for axis in (0, 1):
        mine, beside = along[axis], _beside(place, along, axis)
        for edge in (place.lower[axis], place.upper[axis]):
            near = beside & (abs(mine - edge) < _STRIP)
            if near.any():
                values = pixels[2][near]
                bins = np.rint((mine[near] - edge + _STRIP) / step * 2).astype(int)
                explained = (np.bincount(bins, weights=values) ** 2 / np.maximum(np.bincount(bins), 1)).sum()
                energy = float(values @ values)
                left += energy - float(explained)
                whole += energy - float(values.sum()) ** 2 / len(values)
    return left / max(whole, 1e-30)


def _ends(profile: np.ndarray, origin: float, step: float, low: float, high: float) -> tuple[float, float]:
    """Where a profile falls to half of what it is in between, from 1.5 cm within the expected ends on [m]."""
    first, last = (int(np.clip((one - origin) / step, 0, len(profile))) for one in (low, high))
    strip = min(round(_STRIP / step), (last - first) // 2)
    level = np.median(profile[first:last]) / 2
    below = np.flatnonzero(profile < level)
    start = max(below[below < first + strip], default=-1) + 1
    stop = min(below[below >= last - strip], default=len(profile))
    return origin + step * float(start), origin + step * float(stop)
