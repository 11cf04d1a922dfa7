"""Boxes of `household_things`, in millimetres, as they lie on a table."""

from collections.abc import Callable

import numpy as np
from household_drawing import (
    bar,
    bevelled,
    bulged,
    cylinder,
    laid,
    polygon,
    rectangle,
    ring,
    rounded,
    rounded_block,
    signed_power,
    standing_block,
)
from manifold3d import Manifold
from odd_shapes import hull, union

SIDES = (-1, 1)


def sleeve(x: float, y: float, z: float, thickness: float) -> Manifold:
    """A block's four long sides, open at both ends."""
    area = rectangle(y, z, 0.8) - rectangle(y - 2 * thickness, z - 2 * thickness, 0.3)
    return bar(area, x).translate((0, 0, z / 2))


def _matchbox_open() -> Manifold:
    """Nineteen matches in a drawer, pulled out by 27 mm; strips to strike on at both sides."""
    rng = np.random.default_rng(1)
    parts = [sleeve(111, 65, 20, 1)]
    parts += [standing_block(105, 0.5, 13, (0, side * 32.6, 3.5)) for side in SIDES]
    parts.append(rounded_block(109, 62, 17.6, 0.8, (27, 0, 0.7)) - standing_block(106.4, 59.4, 30, (27, 0, 2.8)))
    for y in range(-27, 28, 3):
        parts.append(standing_block(95, 2.1, 2.1, (27 + rng.uniform(-3, 3), y, 2.6)))
        parts.append(Manifold.sphere(1, 12).scale((3.2, 1.7, 1.7)).translate((74, y, 3.9)))
    return union(*parts)


def _paperback_book() -> Manifold:
    """A round back, covers, and grooves between the pages on three sides."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 16)
    edge = np.column_stack([53.5 - 1.2 * np.cos(turn), 11.52 * np.sin(turn)])
    pages = bar(polygon([(-55, -11.5), *edge, (-55, 11.5)]), 176).translate((0, 0, 12))
    grooves = []
    for z in np.arange(2, 22.5, 1.9):
        grooves.append(standing_block(176, 1, 0.5, (0, 52.8, z + 0.25)))
        grooves += [standing_block(0.9, 104, 0.5, (side * 88, 1, z)) for side in SIDES]
    back = np.column_stack([-55.5 - 2.6 * np.cos(turn), 12 + 12.2 * np.sin(turn)])
    spine = bar(polygon([(-54, 0), *back, (-54, 24)]), 178)
    below = rectangle(178, 112, 1.2).extrude(0.8).translate((0, 0, -0.3))
    # The cover above is a little open and has a fold along the back.
    above = hull(standing_block(178, 1, 0.9, (0, -50, 23.4)), standing_block(178, 1, 0.9, (0, 55.5, 25.2)))
    hinge = standing_block(178, 8, 0.9, (0, -52, 23.4)) - standing_block(180, 1, 0.5, (0, -50, 23.9))
    return union(pages - union(*grooves), below, above, hinge, spine)


def _clay_brick() -> Manifold:
    """Three holes, pits and grooves on its long sides, one corner knocked off."""
    rng = np.random.default_rng(8)
    cuts = [cylinder(14, 80, (x, 0, -5), 40) for x in (-65, 0, 65)]
    for _ in range(22):
        pit = Manifold.sphere(rng.uniform(1.5, 4), 16).scale((1.5, 1, 0.5))
        cuts.append(pit.translate((rng.uniform(-100, 100), rng.choice([-51, 51]), rng.uniform(6, 57))))
    cuts += [standing_block(240, 1.4, 1.2, (0, side * 51, z)) for z in (12, 24, 38, 51) for side in SIDES]
    return bevelled(rectangle(213, 101, 3), 63, 2.2) - union(*cuts, Manifold.sphere(9, 24).translate((108, 51, 64)))


def _tea_bag_carton() -> Manifold:
    """A lid with a flap in front, a slit, and perforations behind."""
    lid = rounded_block(139.6, 73.6, 24, 1, (0, 0, 63))
    flap = rounded(polygon([(-60, 0), (60, 0), (48, -17), (-48, -17)]), 6).extrude(0.8)
    cuts = [standing_block(3, 1, 1, (x, 36, 61)) for x in range(-64, 66, 7)]
    cuts += [standing_block(1, 50, 0.8, (side * 69, 0, 20)) for side in SIDES]
    cuts.append(standing_block(44, 0.8, 3, (0, -34, 85)))
    flap = flap.rotate((90, 0, 0)).translate((0, -36.3, 66))
    return union(rounded_block(138, 72, 84, 1), lid, flap) - union(*cuts)


def _glasses_case() -> Manifold:
    """Two shells with a gap between them, three hinges and a snap."""

    def shell(a: float, b: float, c: float, z: float) -> Manifold:
        def place(polar: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, ...]:
            wide = signed_power(np.sin(polar), 0.34)
            x, y = signed_power(np.cos(turn), 1 / 1.8), signed_power(np.sin(turn), 1 / 1.8)
            return a * x * wide, b * y * wide, z + c * signed_power(np.cos(polar), 0.6)

        return bulged(place, 50, 96)

    lower = shell(80, 30, 19, 19).trim_by_plane((0, 0, -1), -20)
    upper = shell(80.8, 30.8, 20, 19).trim_by_plane((0, 0, 1), 20.8)
    hinges = [laid(cylinder(2.6, 22)).translate((x - 11, 30.6, 20.4)) for x in (-42, 0, 42)]
    snap = rounded_block(14, 4, 9, 1.2, (0, -30.6, 16))
    return union(lower, upper, shell(79, 29, 16, 20.3), *hinges, snap).trim_by_plane((0, 0, 1), 1)


def _toothpaste_carton() -> Manifold:
    """Flaps tucked in at both ends, raised print on top."""
    parts = [sleeve(192, 46, 38, 0.9), standing_block(187, 45, 37, (0, 0, 0.5))]
    parts.append(standing_block(188, 0.6, 32, (0, -23.1, 3)))
    for side in SIDES:
        parts.append(standing_block(0.9, 43, 36.8, (side * 94.6, 0, 0.6)))
        parts.append(standing_block(0.8, 12, 30, (side * 95.2, side * 14, 4)))
    parts += [
        rectangle(*size).extrude(0.5).translate((x, 0, 37.9)) for size, x in (((120, 26, 8), -10), ((22, 22, 4), 75))
    ]
    return union(*parts)


def _butter_pack() -> Manifold:
    """Soft and somewhat dented, the paper folded on top and at both ends."""

    def dented(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        narrower = 1 - 0.03 * (z / 39) ** 2
        return np.column_stack(
            [
                x * narrower * (1 + 0.006 * np.sin(z / 4)),
                y * narrower * (1 + 0.018 * np.sin(x / 11) * np.cos(y / 13)),
                z * (1 + 0.02 * np.cos(x / 19) * np.cos(y / 14)),
            ]
        )

    parts = [rounded_block(104, 66, 39, 4).refine_to_length(5).warp_batch(dented)]
    for side in SIDES:
        below = bar(polygon([(-29, 0), (29, 0), (2, 18), (-2, 18)]), 1.6)
        above = bar(polygon([(-28, 0), (28, 0), (8, -11), (-8, -11)]), 1.4)
        parts += [below.translate((side * 51.4, 0, 4)), above.translate((side * 50.8, 0, 35.5))]
    parts.append(rectangle(97, 17, 1).extrude(1.3).translate((0, 3, 38.4)))
    parts.append(rectangle(96, 6, 1).extrude(1.1).translate((0, 8, 39.3)))
    return union(*parts)


def _wooden_chest() -> Manifold:
    """A round lid, two bands over it, feet, a latch, and a ring to lift it by at both ends."""
    turn = np.linspace(0, np.pi, 40)
    lid = bar(polygon(np.column_stack([42.5 * np.cos(turn), 48 + 30 * np.sin(turn)])), 125, 1)
    arc = np.column_stack([43.8 * np.cos(turn), 48 + 31.2 * np.sin(turn)])
    band = bar(polygon([*arc, (-43.8, 8), (43.8, 8)]), 9)
    feet = [rounded_block(16, 16, 9, 2, (x, y, 0)) for x in (-53, 53) for y in (-33, 33)]
    gaps = [standing_block(142, 1.2, 1.2, (0, side * 41.8, 47.4)) for side in SIDES]
    keyhole = cylinder(2.2, 20, (0, 0, -10)).rotate((90, 0, 0)).translate((0, -47, 42))
    parts = [union(rounded_block(122, 82, 46, 1.2, (0, 0, 4)), *feet, lid) - union(*gaps)]
    parts += [band.translate((x, 0, 0)) for x in (-38, 38)]
    parts.append(rounded_block(18, 4, 18, 1.2, (0, -42.6, 36)) - keyhole)
    for side in SIDES:
        parts.append(ring(9, 1.8).rotate((0, 78, 0)).translate((side * 62.6, 0, 28)))
        parts.append(rounded_block(6, 18, 6, 2, (side * 62, 0, 34)))
    return union(*parts)


BOXES: dict[str, Callable[[], Manifold]] = {
    "matchbox open": _matchbox_open,
    "paperback book": _paperback_book,
    "clay brick": _clay_brick,
    "tea bag carton": _tea_bag_carton,
    "glasses case": _glasses_case,
    "toothpaste carton": _toothpaste_carton,
    "butter pack": _butter_pack,
    "wooden chest": _wooden_chest,
}
