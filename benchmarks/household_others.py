"""Things of no class of `household_things`, in millimetres, as they lie on a table."""

from collections.abc import Callable

import numpy as np
from household_drawing import (
    bevelled,
    cylinder,
    disc,
    laid,
    on_edge,
    oval,
    polygon,
    rectangle,
    ring,
    rounded,
    rounded_block,
    smooth,
    standing_block,
    swept,
    turned,
    wall,
)
from household_vessels import inside
from manifold3d import Manifold
from odd_shapes import around, ellipsoid, footed, hull, union

SIDES = (-1, 1)


def _shampoo_bottle_lying() -> Manifold:
    """Flat, with a label around it and a ribbed cap that has a lip to open it."""
    places = [0, 3, 10, 40, 110, 150, 168, 176]
    x, wide = smooth(places, [26, 31.5, 34, 36, 33, 29, 17, 14])
    _, thick = smooth(places, [13, 17.5, 19.5, 20.5, 20, 18, 14.5, 14])
    path = np.column_stack([x, 0 * x, 0 * x])
    label = swept(path, wide + 0.4, thick + 0.4, power=2.5) ^ standing_block(86, 42, 100, (78, 0, -50))
    cap = turned(
        [(0, 177), (15.5, 177), (16.3, 178), (16.3, 186), (15.6, 186.6), (15.6, 187.4), (16.3, 188), (15.8, 203),
         (13.5, 206), (0, 206.6)],
        0.6,
    )  # fmt: skip
    ribs = around(36, standing_block(0.9, 1.1, 7, (16.3, 0, 178.6)))
    neck = laid(union(cylinder(13, 8, (0, 0, 170)), cap, ribs))
    return union(swept(path, wide, thick, power=2.5), label, neck, rounded_block(5, 12, 3, 1, (196, 0, 14.8)))


def _rice_bowl() -> Manifold:
    """On a foot, with two lines around it and twelve petals pressed into its side."""
    side = wall([(26, 7), (38, 12), (49, 24), (56, 42), (59.5, 57), (61, 62)])
    within = [(radius, height + 1.2) for radius, height in inside(side, 3.6, 9)]
    bowl = turned([(0, 6), (20, 6), (21, 0), (25, 0), (25.5, 6.6), *side, *within, (20, 10), (0, 9.4)], 0.9)
    lines = [ring(radius, 0.8).translate((0, 0, z)) for radius, z in ((59.9, 53), (58.6, 48))]
    petal = ellipsoid(2.2, 1.8, 9).rotate((0, 20, 0)).translate((54, 0, 34))
    return bowl - union(*lines, around(12, petal))


def _desk_stapler() -> Manifold:
    base = rounded(polygon([(-70, 0), (72, 0), (72, 5), (60, 6.5), (-48, 7), (-58, 22), (-70, 22)]), 2, 3)
    slots = oval(5, 1.3, (0, 2.5)) + oval(5, 1.3, (0, -2.5))
    anvil = (rectangle(18, 12, 2) - slots).extrude(1.6).translate((58, 0, 6))
    magazine = on_edge(polygon([(-62, 0), (70, 0), (70, 9), (-62, 9)]), 15).rotate((0, -7, 0)).translate((0, 0, 19))
    arm = [(-74, 0), (-72, 12), (-40, 17), (20, 19), (60, 16), (74, 9), (75, -3), (70, -5), (60, 3), (-60, 3)]
    arm = on_edge(rounded(polygon(arm), 2.5, 2), 30, 4.5).rotate((0, -8, 0)).translate((0, 0, 30))
    pivot = on_edge(disc(4.5, (-60, 18)), 38)
    cheek = on_edge(rounded(polygon([(-70, 4), (-46, 4), (-50, 26), (-66, 28)]), 3), 2.4)
    cheeks = [cheek.translate((0, side * 16.4, 0)) for side in SIDES]
    spring = hull(standing_block(3, 8, 1.2, (-5, 0, 6)), standing_block(3, 8, 1.2, (15, 0, 22)))
    dent = bevelled(rectangle(44, 14, 6), 4, 1).rotate((0, -8, 0)).translate((20, 0, 49.8))
    return union(on_edge(base, 34, 1.2), anvil, magazine, arm, pivot, *cheeks, spring) - dent


def _rubber_duck() -> Manifold:
    body = [ellipsoid(41, 31, 27, (0, 0, 27)), ellipsoid(24, 25, 25, (18, 0, 31))]
    tail = hull(ellipsoid(14, 16, 10, (-26, 0, 36)), ellipsoid(4, 4, 4, (-46, 0, 54)))
    head = [ellipsoid(24, 22.5, 22.5, (22, 0, 69)), cylinder(17, 20, (19, 0, 42))]
    bill = [
        hull(ellipsoid(6, 12, 4, (40, 0, 66)), ellipsoid(5, 9, 2.2, (55, 0, 68))),
        hull(ellipsoid(6, 10, 3, (40, 0, 62)), ellipsoid(4, 7, 1.8, (51, 0, 61))),
    ]
    tuft = hull(ellipsoid(5, 4, 3, (16, 0, 90)), ellipsoid(2, 2, 2, (6, 0, 97)))
    parts = [*body, tail, *head, *bill, tuft]
    for side in SIDES:
        parts.append(ellipsoid(3.6, 3.6, 3.6, (38, side * 12.5, 76)))
        parts.append(hull(ellipsoid(17, 4, 12, (0, side * 29.5, 32)), ellipsoid(5, 3, 5, (-26, side * 27.5, 44))))
        parts.append(ring(10, 1.2).scale((1.2, 1, 0.8)).rotate((90, 0, 0)).translate((2, side * 32.5, 30)))
    return footed(union(*parts), 2) - cylinder(4, 3, (0, 0, 1), 24)


def _dessert_plate() -> Manifold:
    """A scalloped rim with thirty-six raised drops on it."""
    plate = turned(
        [(0, 2.6), (48, 2.6), (49, 0), (52, 0), (53, 2.6), (62, 5), (70, 11.5), (92, 16.5), (95, 17.4), (95.2, 19),
         (93, 19.6), (70, 14.6), (61, 8.2), (52, 6), (0, 5.6)],
        0.5,
    )  # fmt: skip
    drops = around(36, Manifold.sphere(1, 12).scale((5, 2.2, 1.2)).translate((83, 0, 17.4)))
    return union(plate, drops) - around(24, cylinder(3.6, 10, (97.2, 0, 12), 16))


OTHERS: dict[str, Callable[[], Manifold]] = {
    "shampoo bottle lying": _shampoo_bottle_lying,
    "rice bowl": _rice_bowl,
    "desk stapler": _desk_stapler,
    "rubber duck": _rubber_duck,
    "dessert plate": _dessert_plate,
}
