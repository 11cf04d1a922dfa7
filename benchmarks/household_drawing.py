"""How `household_things` are drawn, in millimetres: areas, what is turned, bent or swept, what stands on a place."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, FillRule, JoinType, Manifold, Mesh64, OpType
from numpy.typing import ArrayLike
from odd_shapes import hull, union
from scipy.interpolate import CubicSpline, PchipInterpolator

TURNED = 96
ORIGIN = (0, 0, 0)


def polygon(points: ArrayLike) -> CrossSection:
    return CrossSection([np.asarray(points, dtype=float)], FillRule.NonZero)


def disc(radius: float, at: Sequence[float] = (0, 0), sides: int = 48) -> CrossSection:
    return CrossSection.circle(radius, sides).translate(tuple(at))


def oval(a: float, b: float, at: Sequence[float] = (0, 0)) -> CrossSection:
    return CrossSection.circle(1, 64).scale((a, b)).translate(tuple(at))


def rectangle(x: float, y: float, rounding: float = 0, at: Sequence[float] = (0, 0)) -> CrossSection:
    """About a place, with rounded corners."""
    core = CrossSection.square((x - 2 * rounding, y - 2 * rounding), True)
    return grown(core, rounding).translate(tuple(at))


def grown(area: CrossSection, by: float) -> CrossSection:
    return area.offset(by, JoinType.Round, 2, 24) if by else area


def rounded(area: CrossSection, outer: float, inner: float = 0) -> CrossSection:
    """With its outer and its inner corners rounded."""
    for radius in (-outer, inner):
        area = grown(grown(area, radius), -radius)
    return area.simplify(0.01)


def stroke(points: ArrayLike, widths: ArrayLike) -> CrossSection:
    """What a round pen of changing width draws through points (N, 2)."""
    points = np.asarray(points, dtype=float)
    dots = [disc(width / 2, at, 20) for at, width in zip(points, np.broadcast_to(widths, len(points)), strict=True)]
    return CrossSection.batch_boolean([CrossSection.batch_hull(list(pair)) for pair in pairwise(dots)], OpType.Add)


def smooth(places: Sequence[float], values: Sequence[float], count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Places, evenly spread, and the values there, on a curve that goes no further than what it goes through."""
    spread = np.linspace(places[0], places[-1], count)
    return spread, PchipInterpolator(places, values)(spread)


def wall(points: Sequence[Sequence[float]], count: int = 50) -> list[tuple[float, float]]:
    """A smooth profile through radii and heights, from below."""
    radii, heights = zip(*points, strict=True)
    heights, radii = smooth(heights, radii, count)
    return list(zip(radii.tolist(), heights.tolist(), strict=True))


def through(points: Sequence[Sequence[float]], count: int = 40) -> np.ndarray:
    """Places on a smooth curve through points."""
    corners = np.array(points, dtype=float)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    return CubicSpline(along, corners)(np.linspace(0, along[-1], count))


def turned(profile: Sequence[Sequence[float]], rounding: float) -> Manifold:
    """A profile of radii and heights, turned about z, with rounded outer corners."""
    half = polygon(profile)
    # With its mirror image, so that there are no corners on the axis.
    return rounded(half + half.mirror((1, 0)), rounding).revolve(TURNED)


def bevelled(area: CrossSection, height: float, bevel: float) -> Manifold:
    """An area made thick, its edges rounded by some steps."""
    steps = max(4, int(np.ceil(2.2 * bevel)))
    layers = []
    for turn in np.linspace(0, np.pi / 2, steps + 1):
        low = bevel * (1 - np.sin(turn))
        inset = grown(area, -bevel * (1 - np.cos(turn)))
        layers.append(inset.extrude(height - 2 * low).translate((0, 0, low)))
    return union(*layers)


def on_edge(area: CrossSection, width: float, bevel: float = 0) -> Manifold:
    """An area of x and z, made thick along y on both sides of y = 0."""
    solid = bevelled(area, width, bevel) if bevel else area.extrude(width)
    return solid.rotate((90, 0, 0)).translate((0, width / 2, 0))


def bar(area: CrossSection, length: float, bevel: float = 0) -> Manifold:
    """An area of y and z, made long along x on both sides of x = 0."""
    solid = bevelled(area, length, bevel) if bevel else area.extrude(length)
    return solid.rotate((90, 0, 90)).translate((-length / 2, 0, 0))


def laid(solid: Manifold) -> Manifold:
    """Its z axis along x."""
    return solid.rotate((0, 90, 0))


def standing_block(x: float, y: float, z: float, at: Sequence[float] = ORIGIN) -> Manifold:
    """A block, the middle of its foot at a place."""
    return Manifold.cube((x, y, z), True).translate((at[0], at[1], at[2] + z / 2))


def rounded_block(x: float, y: float, z: float, rounding: float, at: Sequence[float] = ORIGIN) -> Manifold:
    """The same with round edges."""
    ball = Manifold.sphere(rounding, 16)
    corners = [
        ball.translate((right * (x / 2 - rounding), back * (y / 2 - rounding), up))
        for right in (-1, 1)
        for back in (-1, 1)
        for up in (rounding, z - rounding)
    ]
    return hull(*corners).translate(tuple(at))


def cylinder(radius: float, height: float, at: Sequence[float] = ORIGIN, sides: int = 48) -> Manifold:
    """The middle of its foot at a place."""
    return Manifold.cylinder(height, radius, radius, sides).translate(tuple(at))


def ring(radius: float, thick: float) -> Manifold:
    """A round rod bent about z; `thick` is the radius of the rod."""
    return disc(thick, (radius, 0), 14).revolve(TURNED)


def swept(
    points: np.ndarray, across: ArrayLike, along: ArrayLike, up: Sequence[float] = (0, 0, 1), power: float = 2.0
) -> Manifold:
    """A rod through points (N, 3), its half widths across and along `up`; a power above 2 makes it squarer."""
    way = np.gradient(points, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    side = np.cross(way, up)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    x, y = signed_power(np.cos(turn), 2 / power), signed_power(np.sin(turn), 2 / power)
    count = len(points)
    rings = points[:, None] + np.broadcast_to(across, count)[:, None, None] * x[:, None] * side[:, None]
    rings = rings + np.broadcast_to(along, count)[:, None, None] * y[:, None] * np.cross(way, side)[:, None]
    return _closed(rings, points[0], points[-1])


def signed_power(values: np.ndarray, power: float) -> np.ndarray:
    """Powers that keep the sign."""
    return np.sign(values) * np.abs(values) ** power


def bulged(place: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]], steps: int, sides: int) -> Manifold:
    """A bent ball: x, y and z for angles from the top and around, in radians."""
    polar = np.linspace(np.pi, 0, steps + 1)[:, None]
    around = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :]
    points = np.stack(np.broadcast_arrays(*place(*np.broadcast_arrays(polar, around))), axis=-1)
    return _closed(points[1:-1], points[0, 0], points[-1, 0])


def _closed(rings: np.ndarray, first: np.ndarray, last: np.ndarray) -> Manifold:
    """What rings of points (K, N, 3) enclose, counter-clockwise about the way, between two tips."""
    count, sides = rings.shape[:2]
    corner = np.arange(count * sides).reshape(count, sides)
    beside = np.roll(corner, -1, axis=1)
    tips = count * sides + np.broadcast_to([[0], [1]], (2, sides))
    faces = [
        np.stack([corner[:-1], beside[:-1], beside[1:]], axis=-1),
        np.stack([corner[:-1], beside[1:], corner[1:]], axis=-1),
        np.stack([tips[0], beside[0], corner[0]], axis=-1),
        np.stack([tips[1], corner[-1], beside[-1]], axis=-1),
    ]
    return Manifold(
        Mesh64(
            vert_properties=np.vstack([rings.reshape(-1, 3), first, last]),
            tri_verts=np.vstack([some.reshape(-1, 3) for some in faces]).astype(np.uint64),
        )
    )
