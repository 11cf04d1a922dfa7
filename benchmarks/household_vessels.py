"""Cans and cups of `household_things`, in millimetres, as they lie on a table."""

from collections.abc import Callable

import numpy as np
from household_drawing import (
    cylinder,
    disc,
    laid,
    oval,
    rectangle,
    ring,
    rounded_block,
    standing_block,
    stroke,
    swept,
    through,
    turned,
    wall,
)
from manifold3d import Manifold
from odd_shapes import around, ellipsoid, hull, profile_turned, union

ACROSS = (0, 1, 0)  # what is up for an ear in the plane of x and z


def inside(outside: list[tuple[float, float]], thickness: float, floor: float) -> list[tuple[float, float]]:
    """The inner side of a wall, from its rim down to a floor."""
    return [(radius - thickness, height) for radius, height in outside[::-1] if height > floor]


def _bean_tin_standing() -> Manifold:
    """With nine beads, raised ends and a seam up its side."""
    heights = np.linspace(26, 84, 90)
    beads = 35.75 + 0.9 * np.cos((heights - 26) / 58 * 18 * np.pi)
    below = [(0, 3.6), (26.5, 3.6), (27.5, 2.8), (31.5, 2.8), (32.5, 3.6), (35.3, 3.4), (35.9, 0), (37.8, 0.6),
             (37.8, 3.2), (36.5, 4.2), (36.5, 14), (36.8, 14.1), (36.8, 24)]  # fmt: skip
    above = [(36.8, 86), (36.8, 95), (36.5, 95.1), (36.5, 105), (37.8, 106), (37.8, 108.6), (37.3, 109), (35.9, 109),
             (35.3, 105), (32.5, 104.6), (31.5, 105.4), (27.5, 105.4), (26.5, 104.6), (0, 104.6)]  # fmt: skip
    tin = profile_turned([*below, *zip(beads, heights, strict=True), *above])
    return union(tin, standing_block(1.2, 5, 97, (36.3, 0, 6)))


def _drink_can_standing() -> Manifold:
    """A dome below; a tab, its rivet and the score of its mouth above."""
    side = wall([(24.5, 0), (26.5, 4), (31.5, 9), (33.1, 14), (33.1, 90), (32, 98), (28.5, 106), (26.6, 112)])
    below = [(0, 9), (8, 8.4), (16, 5.5), (21, 1.5), (22.6, 0)]
    above = [(27.4, 112.6), (27.4, 115), (26.6, 115.4), (25.4, 115), (24.6, 110), (23.6, 109), (22.8, 110.3),
             (0, 110.3)]  # fmt: skip
    tab = (rectangle(26, 15, 7) - disc(4.2, (8, 0))).extrude(1.2).translate((3, 0, 111.2))
    mouth = (oval(9, 7) - oval(8, 6)).extrude(0.8).translate((-13, 0, 110))
    return union(profile_turned([*below, *side, *above]), tab, cylinder(3.4, 2.4, (-4, 0, 110)), mouth)


def _shoe_polish_tin_standing() -> Manifold:
    """Flat, the lid over the base, with a key at the side that lifts it."""
    base = profile_turned([(0, 1), (35, 1), (36, 0), (39.5, 0), (39.5, 14), (0, 14)])
    lid = profile_turned(
        [(0, 9.5), (41, 9.5), (41.7, 9.8), (41.7, 11.2), (41, 11.6), (41, 22.4), (39.6, 24), (37, 24), (36, 23.2),
         (30, 23.2), (29, 24.2), (22, 24.6), (21, 23.8), (0, 23.8)]
    )  # fmt: skip
    key = stroke([(47.5, -7), (49.5, 0), (47.5, 7)], 4.5).extrude(2).translate((0, 0, 11))
    axle = cylinder(2, 6, (44, 0, 8), 20)
    return union(base, lid, key, standing_block(9, 3, 1.6, (44, 0, 11.1)), axle)


def _pesto_jar_standing() -> Manifold:
    """A jar with a label round it and a lid with forty ribs."""
    side = wall([(28, 1.5), (30.8, 5), (31.4, 9), (31.4, 58), (30, 66), (26.5, 72), (25.5, 76)])
    jar = profile_turned([(0, 3), (20, 2.4), (25, 0), (27, 0.2), *side, (25.5, 84), (0, 84)])
    label = cylinder(31.7, 36, (0, 0, 16), 60)
    lid = profile_turned(
        [(0, 79), (28.6, 79), (29.2, 80.2), (28.4, 81), (28.4, 92), (27, 94), (24, 94.6), (22.5, 93.6), (12, 93.6),
         (10, 94.4), (0, 94.4)]
    )  # fmt: skip
    return union(jar, label, lid, around(40, standing_block(1.2, 1, 10, (28.5, 0, 81.3))))


def _slim_energy_can_lying() -> Manifold:
    side = wall([(19.5, 0), (21, 3), (25, 8), (26.4, 12), (26.4, 116), (25.4, 122), (23, 129), (22.3, 132)])
    above = [(23.2, 132.6), (23.2, 134.4), (22.4, 134.8), (21, 134.3), (20.2, 130.2), (0, 130.2)]
    can = profile_turned([(0, 7), (8, 6), (15, 2.6), (18, 0), *side, *above])
    tab = (rectangle(20, 12, 5.5) - disc(3.2, (5.5, 0))).extrude(1.1).translate((2, 0, 130.9))
    return laid(union(can, tab, cylinder(2.6, 2, (-3, 0, 130))))


def _tea_caddy_lying() -> Manifold:
    """A lid that goes over the body, a knob on it, hoops on both."""
    body = turned([(0, 1.5), (38, 1.5), (39, 0), (42, 0), (42, 80), (0, 80)], 0.6)
    lid = turned([(0, 77), (43.1, 77), (43.1, 103), (41, 106.5), (34, 108), (33, 107), (0, 107)], 0.8)
    knob = profile_turned([(0, 105), (6, 105), (5, 110), (8.5, 113.5), (8, 117), (4, 119), (0, 119.4)])
    hoops = [ring(radius, 0.9).translate((0, 0, z)) for radius, z in ((41.9, 6), (41.9, 70), (43, 82), (43, 98))]
    return laid(union(body, lid, knob, *hoops))


def _crisp_tube_lying() -> Manifold:
    tube = profile_turned([(0, 3), (35.2, 3), (35.8, 0), (38, 0), (38, 3), (37.2, 3.6), (37.2, 208), (0, 208)])
    lid = profile_turned(
        [(0, 202), (39.1, 202), (39.1, 204), (38.5, 204.6), (38.5, 211.5), (36.7, 213), (34.2, 213), (32.7, 210.5),
         (0, 210.5)]
    )  # fmt: skip
    return laid(union(tube, lid))


def _sweetcorn_tin_lying() -> Manifold:
    """Short, with three beads and a ring to pull."""
    heights = np.linspace(18, 40, 40)
    beads = 41.8 + 0.7 * np.cos((heights - 18) / 22 * 6 * np.pi)
    below = [(0, 4), (35.5, 4), (36.5, 2.6), (39.5, 2.6), (40.5, 4), (41.5, 0), (43.7, 0), (43.7, 3), (42.5, 4)]
    above = [(42.5, 54), (43.7, 55), (43.7, 58), (41.5, 58), (40.5, 53.6), (38.5, 53), (37.5, 54.2), (30.5, 54.2),
             (29.5, 53.4), (0, 53.4)]  # fmt: skip
    tin = profile_turned([*below, *zip(beads, heights, strict=True), *above])
    pull = (rectangle(30, 20, 9) - oval(7.5, 6.5, (5, 0))).extrude(1.5).translate((-11, 0, 54.3))
    return laid(union(tin, pull, cylinder(4, 2.2, (-21, 0, 53.2))))


def _espresso_cup() -> Manifold:
    """With an ear, and a rest for the thumb on it."""
    side = wall([(17, 0), (20, 4), (25.5, 14), (28.6, 30), (30.2, 46), (31, 54)])
    cup = turned([(0, 1.8), (13, 1.8), (14.2, 0), *side, *inside(side, 3.2, 5), (12, 4.8), (0, 4.6)], 1)
    hollow = profile_turned([(0, 5), (12, 5), (22, 14), (25.4, 30), (27, 46), (28, 60), (0, 60)])
    ear = through([(27, 0, 40), (36, 0, 44), (44, 0, 40), (45, 0, 31), (38, 0, 22), (26, 0, 17)])
    return union(cup, swept(ear, 3.4, 2.4, ACROSS) - hollow, ellipsoid(6, 3, 1.3, (40, 0, 46)))


def _barrel_mug() -> Manifold:
    """Bulging, with two hoops, grooves between staves, and a big ear."""
    side = wall([(36, 0), (38.4, 3), (41, 12), (44, 48), (41.6, 84), (41.2, 96)], 60)
    mug = turned([(0, 2.4), (30, 2.4), (31.5, 0), *side, *inside(side, 4, 8), (30, 6.5), (0, 6.2)], 1.6)
    grooves = around(18, standing_block(1.4, 1.4, 44, (44.4, 0, 26)))
    hoops = [rectangle(2.2, 5, 0.9, at).revolve(60) for at in ((42.6, 20), (43, 76))]
    ear = through([(40, 0, 80), (56, 0, 84), (70, 0, 76), (73, 0, 56), (66, 0, 34), (53, 0, 21), (40, 0, 19)])
    thicker = np.linspace(-1, 1, len(ear)) ** 2
    ear = swept(ear, 6 + 2 * thicker, 4.2 + 1.2 * thicker, ACROSS, 2.6)
    hollow = profile_turned([(0, 8), (36, 8), (39.2, 48), (37.4, 84), (37.4, 120), (0, 120)])
    return union(mug - grooves, *hoops, ear - hollow)


def _paper_coffee_cup() -> Manifold:
    """With a rolled rim, a sleeve and a seam."""
    cup = profile_turned(
        [(0, 7), (27.4, 7), (27.8, 0), (30, 0), (31.3, 11.2), (34.16, 35.84), (34.92, 36.4), (40.84, 87.36),
         (40.2, 87.92), (42.68, 109.2), (41.41, 108.64), (35.3, 56), (29.9, 9.52), (0, 8.4)]
    )  # fmt: skip
    seam = hull(standing_block(0.9, 7, 1, (30.2, 0, 2)), standing_block(0.9, 7, 1, (42.4, 0, 105)))
    return union(cup, ring(42.7, 1.7).translate((0, 0, 110)), seam)


def _lab_beaker() -> Manifold:
    """With a flared rim, a spout, raised marks of its scale and a field to write on."""
    turn = np.linspace(-np.pi / 2, 0, 10)
    below = np.column_stack([27.5 + 7 * np.cos(turn), 7 + 7 * np.sin(turn)])
    floor = np.column_stack([25.5 + 6.6 * np.cos(turn), 8.6 + 6.6 * np.sin(turn)])
    rim = [(34.5, 90), (35.5, 93), (37.5, 95.4), (37.1, 96), (35.1, 95), (32.5, 91)]
    glass = profile_turned([(0, 0), *below, *rim, (32.5, 9), *floor[::-1], (0, 2)])

    def with_spout(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        share = np.exp(-((np.arctan2(y, x) / 0.22) ** 2)) * np.clip((z - 80) / 16, 0, 1) ** 2
        radius = np.hypot(x, y)
        wider = 1 + 8 * share / np.maximum(radius, 1) * (radius > 15)
        return np.column_stack([x * wider, y * wider, z - 1.5 * share])

    marks = [
        rectangle(0.9, 1.2, 0.2, (34.6, z)).revolve(110, angle).rotate((0, 0, 150))
        for height, angle in ((20, 14.9), (30, 26.6))
        for z in range(height, 81, 20)
    ]
    field = rectangle(0.9, 18, 0.4, (34.6, 60)).revolve(110, 26).rotate((0, 0, 205))
    return union(glass.refine_to_length(6).warp_batch(with_spout).simplify(0.02), field, *marks)


def _faceted_tumbler() -> Manifold:
    """Ten flat sides, a round and heavier rim, a hollow below the foot."""
    facets = disc(30.1, sides=10).extrude(88, 8, 0, (1.27, 1.27))
    faceted = Manifold.cylinder(88, 29.6, 39, 100) ^ facets
    round_part = profile_turned([(0, 62), (37.2, 62), (39.4, 88), (0, 88)])
    lip = disc(1.6, (37.6, 87.6), 16).revolve(60)
    hollow = profile_turned([(0, 13), (24.5, 13), (27, 15), (36.2, 89), (0, 89)])
    below = Manifold.sphere(60, 80).translate((0, 0, -57.5))
    groove = ring(29.9, 1.1).translate((0, 0, 7))
    return union(faceted, round_part, lip) - union(hollow, below, groove)


def _enamel_mug_lying() -> Manifold:
    """On its side, held by its ear, which is flat and joined by two plates."""
    mug = profile_turned(
        [(0, 2), (34, 2), (35, 0), (37, 0), (40.5, 3), (42, 7), (42, 81), (40.2, 81), (40.2, 8), (38, 5), (34, 4),
         (0, 4)]
    )  # fmt: skip
    path = [(41, 0, 68), (51, 0, 70), (66, 0, 64), (70, 0, 48), (63, 0, 32), (48, 0, 22), (41, 0, 19)]
    ear = swept(through(path, 48), 6.5, 1.5, ACROSS, 3)
    plates = [rounded_block(2.6, 15, 15, 1, (42, 0, z)) for z in (13, 60)]
    ear = union(ear, *plates) - cylinder(41.1, 82, (0, 0, 3), 60)
    mug = union(mug, ring(42.3, 1.8).translate((0, 0, 81)), ear)
    return mug.rotate((0, 0, -62)).rotate((0, 88, 0)).rotate((5.92, 0.36, 5.92))


CANS: dict[str, Callable[[], Manifold]] = {
    "bean tin standing": _bean_tin_standing,
    "drink can standing": _drink_can_standing,
    "shoe polish tin standing": _shoe_polish_tin_standing,
    "pesto jar standing": _pesto_jar_standing,
    "slim energy can lying": _slim_energy_can_lying,
    "tea caddy lying": _tea_caddy_lying,
    "crisp tube lying": _crisp_tube_lying,
    "sweetcorn tin lying": _sweetcorn_tin_lying,
}

CUPS: dict[str, Callable[[], Manifold]] = {
    "espresso cup": _espresso_cup,
    "barrel mug": _barrel_mug,
    "paper coffee cup": _paper_coffee_cup,
    "lab beaker": _lab_beaker,
    "faceted tumbler": _faceted_tumbler,
    "enamel mug lying": _enamel_mug_lying,
}
