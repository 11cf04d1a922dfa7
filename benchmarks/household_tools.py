"""Handles and clamps of `household_things`, in millimetres, as they lie on a table."""

from collections.abc import Callable

import numpy as np
from household_drawing import (
    bevelled,
    cylinder,
    disc,
    grown,
    laid,
    oval,
    polygon,
    rectangle,
    ring,
    rounded,
    rounded_block,
    smooth,
    standing_block,
    stroke,
    swept,
    through,
    turned,
)
from manifold3d import Manifold
from odd_shapes import around, hull, profile_turned, union
from scipy.interpolate import PchipInterpolator


def straight(places: np.ndarray, height: float = 0) -> np.ndarray:
    """Places along x, for a straight rod."""
    return np.column_stack([places, 0 * places, 0 * places + height])


def _dinner_fork() -> Manifold:
    x, half = smooth([-98, -92, -70, -20, 10, 40, 52, 60], [4, 9.5, 9.2, 5.2, 3.2, 3.4, 7, 10.5], 80)
    handle = polygon(np.vstack([np.column_stack([x, half]), np.column_stack([x, -half])[::-1]]))
    flat = rounded(handle + disc(8.6, (-91, 0)) + rectangle(14, 21, 0, (62, 0)), 1.5, 1.5)
    for y in (-8.1, -2.7, 2.7, 8.1):
        tip = 0.9 * y
        flat += polygon([(62, y - 2.3), (102, tip - 1.1), (104, tip), (102, tip + 1.1), (62, y + 2.3)])
    rise = PchipInterpolator([-100, -70, -20, 20, 45, 62, 85, 105], [1, 3, 9, 12.5, 10, 4, 1.5, 5])
    fork = bevelled(flat, 2.3, 0.7).simplify(0.02).refine_to_length(4)
    fork = fork.warp_batch(lambda points: points + np.outer(rise(points[:, 0]), (0, 0, 1)))
    return fork.rotate((0, 0.15, 0))


def _combination_spanner() -> Manifold:
    """A jaw turned by 15 degrees, a ring with twelve corners, a recess on both sides of the shaft."""
    slot = (rectangle(30, 15.2, 0, (15, 0)) + disc(7.6)).rotate(15).translate((80, 0))
    jaw = rounded(disc(15.5, (78, 0)) + polygon([(60, -6.5), (60, 6.5), (74, 13), (74, -13)]), 1)
    shaft = stroke([(-82, 0), (-60, 0), (62, 0), (70, 0)], [14, 10.5, 12.5, 14])
    shaft = bevelled(shaft, 6, 1.4).translate((0, 0, 1.2))
    eye = bevelled(disc(12.8, (-82, 0)), 11, 1.2).translate((0, 0, -1.3))
    hole = (disc(8.2, sides=6) + disc(8.2, sides=6).rotate(30)).extrude(30).translate((-82, 0, -10))
    recess = rectangle(88, 5.5, 2.7).extrude(3)
    recesses = [recess.translate((0, 0, z)) for z in (-0.9, 6.3)]
    return union(bevelled(jaw, 8.4, 1), eye, shaft) - union(*recesses, hole, slot.extrude(20).translate((0, 0, -5)))


def _slotted_screwdriver_long() -> Manifold:
    """A handle with eight flutes, a hexagon below it, a round shaft and its blade."""
    handle = turned(
        [(0, 0), (7, 0), (12, 2.5), (14.2, 9), (14.2, 56), (12.8, 66), (9.4, 78), (9.2, 84), (12.2, 92), (12.4, 97),
         (9, 102), (5, 103), (0, 103)],
        1,
    )  # fmt: skip
    flute = union(cylinder(3.6, 74, (15.8, 0, -2), 20), Manifold.sphere(3.6, 20).translate((15.8, 0, 72)))
    hexagon = cylinder(5, 10, (0, 0, 102), 6)
    shaft = cylinder(3.1, 112, (0, 0, 100), 32)
    blade = [standing_block(7.6, 1.8, 0.5, (0, 0, 221)), standing_block(6.8, 1, 0.5, (0, 0, 231))]
    tip = hull(cylinder(3.1, 0.5, (0, 0, 211), 24), *blade)
    return laid(union(handle - around(8, flute), hexagon, shaft, tip))


def _flat_paint_brush() -> Manifold:
    """A wooden handle with a hole, a nailed ferrule with three ribs, bristles in tufts."""

    def upright_plate(y: float, z: float, rounding: float, x: float, thick: float) -> Manifold:
        return laid(rectangle(z, y, rounding).extrude(thick)).translate((x, 0, 0))

    places = [-118, -112, -95, -60, -25, 0, 14, 22]
    x, wide = smooth(places, [4, 8.5, 10.5, 7.6, 9.5, 20, 25, 25.4], 70)
    _, thick = smooth(places, [2.5, 5, 6, 6.4, 6.6, 6.6, 6.4, 6.4], 70)
    handle = swept(straight(x), wide, thick, power=2.6) - cylinder(4, 30, (-104, 0, -15), 28)
    ferrule = upright_plate(54, 15.5, 5, 14, 36)
    ribs = [upright_plate(55.5, 17, 5.6, x, 1.8) for x in (17, 24, 44)]
    nails = [cylinder(1.7, 18, (31, y, -9), 16) for y in (-15, 15)]
    bristles = hull(
        upright_plate(51, 13, 5, 48, 1), upright_plate(53, 12, 5, 80, 1), upright_plate(50, 3.4, 1.5, 104, 1)
    )
    rng = np.random.default_rng(3)
    gaps = [
        standing_block(60, 0.8, 1.6, (82, y, z))
        for z in (4.6, -6.2)
        for y in np.arange(-23, 24, 3.1) + rng.uniform(-0.6, 0.6, 16)
    ]
    return union(handle, ferrule, *ribs, *nails, bristles - union(*gaps)).rotate((0, -1.38, 0))


def _scissors_half(ring_at: float, a: float, b: float, z: float) -> Manifold:
    """A blade and its handle, the oval ring of it with half sides a and b."""
    blade = [(-6, -7), (4, -8.5), (50, -6.5), (96, 1.6), (97, 2.8), (60, 5.2), (4, 6.5), (-10, 6)]
    arm = stroke(through([(-2, 0), (-24, 4), (-46, 15), (-56, 20)], 14), np.linspace(13, 9, 14))
    outer, inner = (oval(*half).rotate(-12).translate((ring_at, 22)) for half in ((a, b), (a - 6, b - 5.5)))
    handle = rounded(arm - rectangle(64, 90, 0, (10, 0)) + outer, 0, 3) - inner
    tang = stroke(through([(-2, 0), (-24, 4), (-30, 6.5)], 8), 12) - rectangle(10, 60, 0, (5, 0))
    flat = union(polygon(blade).extrude(2.4), tang.extrude(2.4)).translate((0, 0, z))
    return union(flat, bevelled(handle, 10.5, 3).translate((0, 0, -2.6)))


def _paper_scissors_open() -> Manifold:
    """One ring is for a thumb, the other one for fingers."""
    upper = _scissors_half(-74, 27, 15.5, 2.6).rotate((0, 0, -14))
    lower = _scissors_half(-68, 20, 15, 0.2).mirror((0, 1, 0)).rotate((0, 0, 14))
    return union(upper, lower, cylinder(5, 6.4, (0, 0, -0.3))) - standing_block(8, 1.2, 2, (0, 0, 5.4))


def _egg_pan() -> Manifold:
    """Small, with three grooves in its foot; the handle rises, has a collar and a hole."""
    hollow = [(0, 3.2), (45, 3.2), (49, 4), (52.5, 8), (56.4, 27)]
    outside = [(0, 0), (47, 0), (51, 1), (55, 6), (59, 26), (62.5, 29), (62.5, 30.5), (60.5, 30.6)]
    pan = turned([*outside, *hollow[::-1]], 0.5) - union(*(ring(radius, 0.8) for radius in (16, 26, 36)))
    path = through([(57.5, 0, 20), (74, 0, 25), (110, 0, 36), (148, 0, 43), (176, 0, 44)])
    share, places = np.linspace(0, 1, len(path)), [0, 0.12, 0.2, 0.5, 0.85, 0.97, 1]
    wide = np.interp(share, places, [9, 6, 8, 9.5, 11.5, 8, 4])
    thick = np.interp(share, places, [3, 2.8, 6, 7, 7.5, 5.5, 2.5])
    handle = swept(path, wide, thick, power=2.5) - cylinder(3.6, 60, (165, 0, 20), 28)
    handle = handle - profile_turned([*hollow, (56.4, 60), (0, 60)])
    collar = swept(path[5:9], wide[8] + 1.5, thick[8] + 1.2, power=2.5)
    rivets = [Manifold.sphere(2.6, 20).translate((55, y, 19)) for y in (-5, 5)]
    return union(pan, handle, collar, *rivets)


def _dish_brush() -> Manifold:
    """On its bristles and the end of its handle; a scraper at the head."""
    path = through([(-108, 0, 12), (-60, 0, 16), (0, 0, 22), (40, 0, 30), (66, 0, 32)], 60)
    share = np.linspace(0, 1, len(path))
    wide = np.interp(share, [0, 0.03, 0.15, 0.5, 0.7, 0.85, 1], [3, 8, 10, 7.5, 6, 8, 12])
    thick = np.interp(share, [0, 0.03, 0.15, 0.5, 0.7, 1], [2, 4, 5, 5.5, 5, 4])
    handle = swept(path, wide, thick, power=2.4) - oval(8, 4.2).extrude(60).translate((-92, 0, -10))
    head = turned([(0, 28), (27, 28), (29, 30), (29, 33), (24, 37), (0, 39)], 0.8)
    tufts = [
        around(count, hull(cylinder(2.1, 1, (radius, 0, 28), 8), cylinder(2.7, 1, (1.2 * radius, 0, 4), 8)))
        for radius, count in ((0, 1), (7.5, 6), (15, 12), (22.5, 18))
    ]
    scraper = bevelled(rectangle(9, 30, 3), 10, 1).translate((108, 0, 29))
    brush = union(handle, scraper, union(head, *tufts).translate((78, 0, 0)))
    return brush.rotate((0.32, -1.8, -0.32))


def _pizza_wheel() -> Manifold:
    wheel = profile_turned([(0, 0), (32, 0), (37, 0.75), (32, 1.5), (0, 1.5)]).translate((72, 0, 9.5))
    hub = union(cylinder(8, 8, (72, 0, 6.2)), cylinder(4, 11, (72, 0, 4.8)))
    tine = stroke([(72, 0), (45, 0), (28, 0)], [16, 13, 18]).extrude(1.8)
    fork = union(*(tine.translate((0, 0, z)) for z in (5.6, 13.4)), standing_block(6, 18, 9.5, (28, 0, 5.6)))
    guard = rounded_block(9, 46, 16, 3.5, (20, 0, 2.2))
    x, half = smooth([-112, -108, -95, -60, -20, 5, 18], [4, 9, 12, 10.5, 12.5, 8.5, 9])
    handle = swept(straight(x, 10.2), half, 0.8 * half)
    rings = [laid(ring(9.3, 1.1)).scale((1, 1, 0.83)).translate((x, 0, 10.3)) for x in (6, 10, 14)]
    return union(wheel, hub, fork, guard, handle, *rings) - cylinder(3.4, 40, (-101, 0, -5))


def _nylon_lever() -> Manifold:
    """Half of a clamp, its jaw at +x and +y, with a recess on both sides."""
    jaw = through([(-8, 0), (10, 20), (34, 24), (56, 13), (66, 5)], 24)
    handle = through([(-6, 2), (-34, -12), (-66, -29), (-86, -35)], 24)
    share, places = np.linspace(0, 1, 24), [0, 0.3, 0.8, 1]
    area = stroke(jaw, np.interp(share, places, [20, 17, 13, 9]))
    area += stroke(handle, np.interp(share, places, [20, 16, 14, 11]))
    area = rounded(area + disc(13, (-4, 0)), 0, 4)
    recess = rounded(grown(area, -3.6) - disc(14, (-4, 0)) - rectangle(20, 60, 0, (62, 10)), 1.5).extrude(6)
    return bevelled(area, 26, 1.8) - union(*(recess.translate((0, 0, z)) for z in (-2, 22)))


def _nylon_spring_clamp() -> Manifold:
    """On its side: one lever is forked about the other one, both have ribs for the fingers and a grooved pad."""
    lever = _nylon_lever()
    outer = lever - cylinder(14.6, 14.8, (-4, 0, 5.6))
    inner = lever.mirror((0, 1, 0)) - union(*(cylinder(14.6, 7, (-4, 0, z)) for z in (-1.2, 20.2)))
    core = [cylinder(*size) for size in ((4.4, 31, (-4, 0, -2.5)), (7, 1.8, (-4, 0, -2.5)), (7, 1.8, (-4, 0, 26.7)))]
    core.append(cylinder(6.6, 24, (-4, 0, 1)))
    pad = bevelled(rectangle(26, 22, 3), 6, 1.2).rotate((-90, 0, 0))
    pad = (pad - union(*(standing_block(1.2, 2, 40, (x, 0, -20)) for x in range(-10, 11, 4)))).translate((64, 0.2, 13))
    rib = bevelled(rectangle(3, 13, 1.2), 27, 0.6).rotate((0, 0, 20))
    ribs = union(*(rib.translate((-58 - 8 * i, -25.5 - 3.3 * i, -0.5)) for i in range(4)))
    parts = [side for solid in (pad, ribs) for side in (solid, solid.mirror((0, 1, 0)))]
    return union(outer, inner, *core, *parts)


def _steel_spring_clamp_small() -> Manifold:
    """Two bent strips with ears about a pin and its spring, and coated at their ends."""
    path = through([(46, 1.2), (40, 9), (26, 14), (8, 9), (-6, 2.5), (-24, -7), (-44, -15)], 50)
    strip = stroke(path, 2).extrude(17)
    ear = rounded(stroke([(20, 12.5), (8, 7), (0, 0)], [5, 10, 13]), 0, 2).extrude(1.4)
    grip = bevelled(stroke(path[34:], 6.2), 21, 2).translate((0, 0, -2))
    jaw = bevelled(stroke(path[:6], 4.6), 19.4, 1.2).translate((0, 0, -1.2))
    half = union(strip, grip, jaw)
    upper = union(half, *(ear.translate((0, 0, z)) for z in (0, 15.6)))
    lower = union(half, *(ear.translate((0, 0, z)) for z in (1.5, 14.1))).mirror((0, 1, 0))
    pin = union(cylinder(2.6, 21, (0, 0, -2)), *(cylinder(4.2, 1.5, (0, 0, z)) for z in (-2, 17.5)))
    turn = np.linspace(0, 10 * np.pi, 120)
    coil = np.column_stack([5.6 * np.cos(turn), 5.6 * np.sin(turn), 3.2 + 1.1 * turn / np.pi])
    return union(upper, lower, pin, swept(coil, 1, 1), cylinder(5.4, 13, (0, 0, 2)))


HANDLES: dict[str, Callable[[], Manifold]] = {
    "dinner fork": _dinner_fork,
    "combination spanner": _combination_spanner,
    "slotted screwdriver long": _slotted_screwdriver_long,
    "flat paint brush": _flat_paint_brush,
    "paper scissors open": _paper_scissors_open,
    "egg pan": _egg_pan,
    "dish brush": _dish_brush,
    "pizza wheel": _pizza_wheel,
}

CLAMPS: dict[str, Callable[[], Manifold]] = {
    "nylon spring clamp": _nylon_spring_clamp,
    "steel spring clamp small": _steel_spring_clamp_small,
}
