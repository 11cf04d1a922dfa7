"""Twenty further shapes of no class, in millimetres, as they lie on a table: see `odd_shapes`.

Drawn by someone who did not see the shapes that the classifier learns from; `millisight.meshes` draws those.
"""

from collections.abc import Callable

import numpy as np
from manifold3d import CrossSection, Manifold
from odd_shapes import SIDES, around, block, ellipsoid, plate, rod, union


def _disc(radius: float, x: float, y: float) -> CrossSection:
    return CrossSection.circle(radius, SIDES).translate((x, y))


def _wheel(radius: float, width: float, at: tuple[float, float, float]) -> Manifold:
    """A wheel whose axle runs along y."""
    return Manifold.cylinder(width, radius, radius, SIDES, True).rotate((90, 0, 0)).translate(at)


def _prism(profile: list[tuple[float, float]], length: float) -> Manifold:
    """A profile (x, z) drawn out along y, its middle at y = 0."""
    return plate(profile, length).translate((0, 0, -length / 2)).rotate((90, 0, 0))


def _ring(large: float, small: float) -> Manifold:
    return CrossSection.circle(small, SIDES).translate((large, 0)).revolve(60)


def _heart() -> Manifold:
    turn = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    y = 13 * np.cos(turn) - 5 * np.cos(2 * turn) - 2 * np.cos(3 * turn) - np.cos(4 * turn)
    return plate(np.column_stack([-16 * np.sin(turn) ** 3, y]) * 3.6, 26)


def _house() -> Manifold:
    front = _prism([(-30, 0), (30, 0), (30, 35), (0, 70), (-30, 35)], 120)
    wing = _prism([(-22, 0), (22, 0), (22, 30), (0, 56), (-22, 30)], 60).rotate((0, 0, 90)).translate((45, 30, 0))
    return union(front, wing, block(14, 14, 45, (-15, -35, 62)))


def _dog() -> Manifold:
    legs = [rod(np.array([[x, y, 6], [x, y, 36]]), 7) for x in (-35, 28) for y in (-13, 13)]
    head = [ellipsoid(14, 11, 20, (36, 0, 54)), ellipsoid(19, 16, 16, (48, 0, 67)), ellipsoid(17, 9, 8, (65, 0, 62))]
    ears = [ellipsoid(8, 4, 14, (42, y, 66)) for y in (-17, 17)]
    tail = rod(np.array([[-42, 0, 50], [-60, 0, 66], [-64, 0, 82]]), 4.5)
    return union(ellipsoid(50, 20, 19, (-4, 0, 42)), *legs, *head, *ears, tail)


def _fish() -> Manifold:
    tail = plate([(-45, 0), (-85, 38), (-74, 0), (-85, -38)], 9).translate((0, 0, -4.5))
    fins = plate([(-22, 20), (18, 25), (-20, 50)], 8), plate([(10, -22), (-18, -22), (-24, -44)], 8)
    return union(ellipsoid(62, 32, 15), tail, *(fin.translate((0, 0, -4)) for fin in fins))


def _anchor() -> Manifold:
    turn = np.linspace(np.pi * 1.08, np.pi * 1.92, 20)
    arms = rod(np.column_stack([55 * np.cos(turn), 55 * np.sin(turn), 0 * turn]), 8)
    flukes = plate([(-72, -22), (-34, -22), (-56, 12)], 14), plate([(72, -22), (56, 12), (34, -22)], 14)
    shank, stock = rod(np.array([[0, -55, 0], [0, 62, 0]]), 8), rod(np.array([[-38, 46, 0], [38, 46, 0]]), 7)
    return union(arms, shank, stock, _ring(15, 6).translate((0, 78, 0)), *(f.translate((0, 0, -7)) for f in flukes))


def _car() -> Manifold:
    side = [(-70, 12), (70, 12), (70, 32), (38, 38), (20, 62), (-32, 62), (-50, 40), (-70, 38)]
    return union(_prism(side, 50), *(_wheel(17, 14, (x, y, 17)) for x in (-42, 42) for y in (-30, 30)))


def _train() -> Manifold:
    boiler = Manifold.cylinder(85, 20, 20, SIDES).rotate((0, 90, 0)).translate((-15, 0, 42))
    cab = union(block(38, 50, 60, (-42, 0, 46)), block(50, 60, 7, (-42, 0, 78)))
    chimney = Manifold.cylinder(30, 7, 12, SIDES).translate((50, 0, 56))
    wheels = [_wheel(r, 10, (x, y, r)) for x, r in ((-42, 18), (-4, 14), (28, 14), (58, 14)) for y in (-26, 26)]
    nose = Manifold.hull_points([(60, -25, 4), (60, 25, 4), (60, -20, 24), (60, 20, 24), (86, 0, 4), (74, 0, 20)])
    top = ellipsoid(11, 11, 12, (14, 0, 62))
    return union(boiler, cab, chimney, nose, top, block(130, 44, 10, (0, 0, 19)), *wheels)


def _molecule() -> Manifold:
    ends = [(52, 0, -20), (-38, 48, -20), (-38, -48, -20), (-8, 0, 38)]
    sticks = [rod(np.array([(0, 0, 0), end], dtype=float), 5) for end in ends]
    return union(ellipsoid(23, 23, 23), *sticks, *(ellipsoid(15, 15, 15, end) for end in ends))


def _hanger() -> Manifold:
    frame = rod(np.array([[0, 20, 0], [75, -24, 0], [75, -34, 0], [-75, -34, 0], [-75, -24, 0], [0, 20, 0]]), 7.5)
    turn = np.linspace(-np.pi / 2, np.pi, 24)
    hook = np.column_stack([20 * np.cos(turn), 52 + 20 * np.sin(turn), 0 * turn])
    return union(frame, rod(np.vstack([[[0, 18, 0]], hook]), 6))


def _spider() -> Manifold:
    legs = []
    for x, y in ((0.88, 0.47), (0.47, 0.88), (-0.17, 0.98), (-0.77, 0.64)):
        legs.append(rod(np.array([[0, 0, 0], [44 * x, 44 * y, 20], [76 * x, 76 * y, -24]]), 4))
    legs += [leg.mirror((0, 1, 0)) for leg in legs]
    return union(ellipsoid(20, 17, 15), ellipsoid(32, 25, 21, (-42, 0, 5)), *legs)


def _sailboat() -> Manifold:
    deck = [(-60, -22), (-60, 22), (20, 22), (70, 0), (20, -22)]
    hull = Manifold.hull_points([(x, y, 26) for x, y in deck] + [(0.8 * x, 0.6 * y, 0) for x, y in deck])
    sails = _prism([(2, 30), (2, 86), (-54, 32)], 8), _prism([(10, 30), (10, 76), (52, 30)], 8)
    return union(hull, *sails, block(9, 9, 68, (6, 0, 56)), block(114, 8, 14, (-2, 0, 28)))


def _snail() -> Manifold:
    turn = np.linspace(0, 4.5 * np.pi, 90)
    far = 9 + 1.75 * turn
    coil = rod(np.column_stack([far * np.cos(turn) - 12, 0 * turn, far * np.sin(turn) + 46]), 8)
    foot = Manifold.batch_hull([ellipsoid(12, 12, 9, (x, 0, 9)) for x in (-60, 50)])
    neck = rod(np.array([[48, 0, 12], [62, 0, 44]]), 10)
    return union(coil, foot, neck, *(rod(np.array([[62, 0, 46], [72, y, 72]]), 3.5) for y in (-14, 14)))


NEWER_SHAPES: dict[str, Callable[[], Manifold]] = {
    "heart": _heart,
    "crescent": lambda: (_disc(62, 0, 0) - _disc(52, 30, 0)).extrude(24),
    "house": _house,
    "tetrahedron": lambda: Manifold.hull_points([(60, 0, 0), (-30, 52, 0), (-30, -52, 0), (0, 0, 85)]),
    "dog": _dog,
    "fish": _fish,
    "anchor": _anchor,
    "spoked wheel": lambda: union(
        _ring(66, 9), Manifold.cylinder(26, 15, 15, SIDES, True), around(6, block(66, 8, 8, (33, 0, 0)))
    ),
    "doughnut": lambda: _ring(42, 19),
    "puzzle piece": lambda: (
        CrossSection.square((84, 84), True)
        + _disc(17, 54, 0) + _disc(17, 0, 54) - _disc(17, -30, 0) - _disc(17, 0, -30)
    ).extrude(18),
    "pipe elbow": lambda: union(
        _ring(55, 21) ^ block(100, 100, 60, (50, 50, 0)),
        _wheel(32, 14, (55, 7, 0)), _wheel(32, 14, (-55, 7, 0)).rotate((0, 0, -90)),
    ) - _ring(55, 14),
    "car": _car,
    "train engine": _train,
    "number four": lambda: union(
        block(20, 130, 24, (18, 0, 0)), block(104, 20, 24, (-8, -20, 0)),
        rod(np.array([[-48, -20, 0], [16, 56, 0]]), 11),
    ),
    "molecule": _molecule,
    "fir tree": lambda: plate(
        [(-10, -75), (10, -75), (10, -52), (58, -52), (28, -14), (44, -14), (19, 22), (30, 22), (0, 75),
         (-30, 22), (-19, 22), (-44, -14), (-28, -14), (-58, -52), (-10, -52)], 20
    ),
    "coat hanger": _hanger,
    "spider": _spider,
    "sailboat": _sailboat,
    "snail": _snail,
}  # fmt: skip
