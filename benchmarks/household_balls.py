"""Balls of `household_things`, in millimetres, as they lie on a table."""

from collections.abc import Callable

import numpy as np
from household_drawing import bulged, cylinder, polygon, rectangle, ring
from manifold3d import Manifold
from odd_shapes import around, hull, plate, profile_turned, union


def directions(polar: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) for angles from the top and around."""
    return np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)


def spread(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles of places that are spread evenly over a ball."""
    number = np.arange(count) + 0.5
    return np.arccos(1 - 2 * number / count), np.pi * (1 + 5**0.5) * number


def _mandarin() -> Manifold:
    """Flat, with faint segments, five hundred pores, dimples above and below, and the star of its stalk."""
    pores = np.random.default_rng(2).normal(size=(500, 3))
    pores /= np.linalg.norm(pores, axis=1, keepdims=True)

    def place(polar: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, ...]:
        way = directions(polar, turn)
        radius = 33 + 0.3 * np.cos(10 * turn) * np.sin(polar) ** 2
        radius = radius - 0.45 * np.exp(-1400 * (1 - (way @ pores.T).max(axis=-1)))
        dimples = -4 * np.exp(-((polar / 0.28) ** 2)) + 1.6 * np.exp(-((polar / 0.5) ** 2))
        dimples = dimples + 2.2 * np.exp(-(((np.pi - polar) / 0.3) ** 2))
        x, y, z = np.moveaxis(radius[..., None] * way, -1, 0)
        return x, y, 0.8 * z + dimples

    angle, far = np.arange(10) * np.pi / 5, np.where(np.arange(10) % 2, 1.8, 3.6)
    star = plate(np.column_stack([far * np.cos(angle), far * np.sin(angle)]), 1.8).translate((0, 0, 22.6))
    return union(bulged(place, 84, 168), star, cylinder(1.3, 3.2, (0, 0, 23), 16))


def _glass_bauble_ribbed() -> Manifold:
    """On its side: twelve ribs, a band, a cap with a fluted rim, and a ring to hang it by."""

    def place(polar: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, ...]:
        radius = 36 * (1 + 0.012 * np.cos(12 * turn) * np.sin(polar) ** 1.5)
        x, y, z = np.moveaxis(radius[..., None] * directions(polar, turn), -1, 0)
        return x, y, 0.99 * z

    band = profile_turned([(0, -2.2), (37.1, -2.2), (37.4, 0), (37.1, 2.2), (0, 2.2)])
    cap = profile_turned([(0, 33), (10, 33), (10.4, 34.5), (9.6, 41), (8, 43), (0, 43.4)])
    flutes = around(18, cylinder(0.9, 8, (10, 0, 33.4), 10))
    loop = ring(5.5, 0.9).rotate((90, 0, 0)).translate((0, 0, 47.5))
    return union(bulged(place, 70, 192), band, cap, flutes, loop).rotate((97, 0, 25))


def _mini_basketball() -> Manifold:
    """Pebbles all over, four grooves and the hole of its valve."""
    pebble = Manifold.sphere(1.6, 8)
    pebbles = [pebble.translate(tuple(59.28 * way)) for way in directions(*spread(360))]
    groove, low = ring(60, 1.1), ring(48, 1.1).rotate((0, 90, 0))
    grooves = [groove, groove.rotate((90, 0, 0)), *(low.translate((x, 0, 0)) for x in (-36, 36))]
    ball = union(Manifold.sphere(60, 96), *pebbles)
    return (ball - union(*grooves, cylinder(2.2, 6, (0, 0, 57), 20))).rotate((20, 12, 0))


def _cricket_ball() -> Manifold:
    """A raised seam with a groove in its middle, four rows of forty stitches, the joint of its two quarters."""
    radius = 35.8
    joint = rectangle(1.2, 0.5, 0.1, (radius, 0)).revolve(112).rotate((90, 0, 0))
    seam = rectangle(2.4, 7, 1, (radius - 0.1, 0)).revolve(112)
    stitches = []
    for z, far, turn in ((-5.6, 35.51, 0), (-3, 36.7, 0), (3, 36.7, 4), (5.6, 35.51, 4)):
        stitch = Manifold.sphere(1, 8).scale((0.7, 1.5, 0.6)).translate((far, 0, z))
        stitches.append(around(40, stitch).rotate((0, 0, turn)))
    middle = rectangle(1.2, 0.9, 0.2, (radius + 1, 0)).revolve(112)
    return (union(Manifold.sphere(radius, 112) - joint, seam, *stitches) - middle).rotate((62, 20, 0))


def _pomegranate() -> Manifold:
    """Slightly six-sided, on its side: a crown with six notches and stamens, a stalk."""

    def place(polar: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, ...]:
        edges = 0.02 * np.cos(6 * turn + 0.3) * np.sin(polar) ** 2 + 0.012 * np.cos(3 * turn) * np.sin(polar)
        x, y, z = np.moveaxis(43 * (1 + edges)[..., None] * directions(polar, turn), -1, 0)
        ends = np.exp(-((polar / 0.35) ** 2)) + np.exp(-(((np.pi - polar) / 0.4) ** 2))
        return x, y, 0.93 * z + 2.5 * ends

    crown = profile_turned(
        [(0, 38), (11, 38), (8.5, 44), (9.5, 50), (13, 57), (10.8, 57.5), (7, 50), (6, 43.5), (0, 43.5)]
    )
    notch = polygon([(-4.2, 1), (4.2, 1), (0, -8.5)]).extrude(30).rotate((90, 0, 0)).translate((0, 0, 58))
    stamens = around(5, cylinder(0.5, 6, (2.5, 0, 43), 6))
    stalk = cylinder(3.5, 7, (0, 0, -40.5), 20)
    return union(bulged(place, 70, 120), crown - around(6, notch), stamens, stalk).rotate((64, 0, 30))


def _walnut() -> Manifold:
    """Random wrinkles, a rim with a seam where its halves meet, and a tip."""
    rng = np.random.default_rng(4)
    waves, phase = 3.2 * rng.normal(size=(14, 3)), rng.uniform(0, 6, 14)

    def place(polar: np.ndarray, turn: np.ndarray) -> np.ndarray:
        way = directions(polar, turn)
        wrinkles = np.abs(np.sin(way @ waves.T + phase))
        radius = 18.2 + np.tanh(8 * wrinkles[..., :7].min(axis=-1)) + 1.2 * (wrinkles.mean(axis=-1) - 0.64)
        radius = radius + 1.3 * np.exp(-((way[..., 1] / 0.09) ** 2)) - 0.5 * np.exp(-((way[..., 1] / 0.02) ** 2))
        radius = radius + 1.8 * np.exp(-((polar / 0.22) ** 2))
        return np.moveaxis(radius[..., None] * way * (1, 0.95, 1.12), -1, 0)

    return bulged(place, 100, 160).rotate((85, 20, 0))


def _spiky_massage_ball() -> Manifold:
    """Ninety-two blunt spikes and the seam of its mould."""
    spike = hull(cylinder(4.4, 1, (0, 0, 38.5), 14), Manifold.sphere(1.5, 10).translate((0, 0, 44)))
    spikes = [spike.rotate((0, polar, turn)) for polar, turn in np.degrees(spread(92)).T.tolist()]
    seam = rectangle(2, 1.2, 0.4, (40, 0)).revolve(96)
    return union(Manifold.sphere(40, 84), seam, *spikes)


SPHERES: dict[str, Callable[[], Manifold]] = {
    "mandarin": _mandarin,
    "glass bauble ribbed": _glass_bauble_ribbed,
    "mini basketball": _mini_basketball,
    "cricket ball": _cricket_ball,
    "pomegranate": _pomegranate,
    "walnut": _walnut,
    "spiky massage ball": _spiky_massage_ball,
}
