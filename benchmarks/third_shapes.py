"""Twenty shapes of no class, the third set, in millimetres, as they lie on a table: see `odd_shapes`.

Drawn by someone who did not see the shapes that the classifier learns from, nor any answer of it.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, Manifold
from odd_shapes import SIDES, around, block, ellipsoid, footed, hull, plate, profile_turned, rod, rod_through, union


def _duck():
    body = ellipsoid(46, 33, 26, (0, 0, 22))
    tail = hull(ellipsoid(14, 14, 9, (-34, 0, 30)), ellipsoid(3, 4, 3, (-58, 0, 50)))
    wings = [ellipsoid(24, 7, 13, (-6, y, 28)).rotate((0, 10, 0)) for y in (-31, 31)]
    head, bill = ellipsoid(23, 21, 22, (28, 0, 62)), ellipsoid(15, 12, 4.5, (53, 0, 57))
    return footed(union(body, tail, *wings, head, bill), 2)


def _knight():
    base = profile_turned([(0, 0), (27, 0), (27, 8), (21, 13), (23, 17), (16, 24), (0, 24)])
    side = [(-16, 20), (16, 20), (14, 32), (6, 44), (12, 49), (29, 44), (35, 51), (31, 60), (14, 74), (8, 88),
            (2, 77), (-10, 72), (-20, 58), (-22, 40)]  # fmt: skip
    neck = plate(side, 20).translate((0, 0, -10)).rotate((90, 0, 0))
    mane = [ellipsoid(6, 5, 6, at) for at in ((-9, 0, 73), (-18, 0, 64), (-23, 0, 53), (-24, 0, 41))]
    return union(base, neck, *mane, *(ellipsoid(4, 3, 4, (10, y, 66)) for y in (-10, 10)))


def _bell():
    """A hand bell with a loop to hold, stood on its rim."""
    bell = profile_turned(
        [
            (0, 58),
            (12, 58),
            (20, 50),
            (25, 30),
            (33, 10),
            (44, 0),
            (40, 0),
            (29, 9),
            (21, 28),
            (16, 46),
            (9, 52),
            (0, 52),
        ]
    )
    loop = CrossSection.circle(4, 24).translate((13, 0)).revolve(48).rotate((90, 0, 0)).translate((0, 0, 72))
    return union(bell, loop, rod_through((0, 0, 54), (0, 0, 22), radius=2.5), ellipsoid(8, 8, 8, (0, 0, 18)))


def _dispenser():
    """A soap dispenser on its side: shouldered bottle, neck, pump head and spout."""
    outline = [(-75, -34), (5, -34), (22, -26), (28, -12), (28, 12), (22, 26), (5, 34), (-75, 34)]
    bottle = hull(plate(outline, 24).translate((0, 0, 6)), plate([(0.95 * x - 2, 0.85 * y) for x, y in outline], 36))
    neck = Manifold.cylinder(20, 12, 12, SIDES).rotate((0, 90, 0)).translate((26, 0, 18))
    stem = Manifold.cylinder(30, 5, 5, SIDES).rotate((0, 90, 0)).translate((40, 0, 18))
    head = hull(block(18, 24, 18, (70, 0, 18)), block(12, 6, 14, (72, 16, 18)))
    spout = rod_through((74, 0, 18), (74, 40, 18), (66, 50, 18), radius=5)
    return union(bottle, neck, stem, head, spout)


def _controller():
    middle = hull(*(ellipsoid(20, 22, 15, (x, 8, 20)) for x in (-38, 38)))
    grips = [hull(ellipsoid(22, 22, 16, (x, 6, 19)), ellipsoid(13, 14, 12, (1.5 * x, -46, 13))) for x in (-42, 42)]
    sticks = [
        union(
            rod_through((x, -12, 25), (x, -12, 42), radius=5), Manifold.cylinder(5, 9, 9, SIDES).translate((x, -12, 40))
        )
        for x in (-20, 20)
    ]
    cross = union(block(24, 8, 12, (-44, 12, 36)), block(8, 24, 12, (-44, 12, 36)))
    buttons = [
        Manifold.cylinder(12, 4.5, 4.5, 24).translate((44 + 9 * a, 12 + 9 * b, 30))
        for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    shoulders = [block(30, 16, 10, (x, 28, 22)) for x in (-42, 42)]
    return footed(union(middle, *grips, *sticks, cross, *buttons, *shoulders), 7)


def _starfish():
    """Bent arms that thin out, knobs along each."""
    parts = [ellipsoid(26, 26, 15, (0, 0, 6))]
    for i in range(5):
        far = np.linspace(8, 72 + 6 * (i % 2), 9)
        bend = np.radians(72 * i + 9 * np.sin(far / 18 + 2 * i))
        size = np.linspace(17, 5, 9)
        balls = [
            ellipsoid(s, s, 0.75 * s, (r * np.cos(b), r * np.sin(b), 0.35 * s + 1))
            for r, b, s in zip(far, bend, size, strict=True)
        ]
        parts += [hull(*pair) for pair in pairwise(balls)]
        parts += [
            ellipsoid(3, 3, 3, (r * np.cos(b), r * np.sin(b), 1.1 * s))
            for r, b, s in zip(far[2::2], bend[2::2], size[2::2], strict=True)
        ]
    return footed(union(*parts), 0)


def _crown():
    wall = Manifold.cylinder(62, 46, 58, 60) - Manifold.cylinder(62, 41, 53, 60)
    for i in range(8):
        notch = Manifold.hull_points([(r, y, z) for r in (20, 90) for y, z in ((0, 26), (-26, 70), (26, 70))])
        wall = wall - notch.rotate((0, 0, 45 * i + 22.5))
    band = Manifold.cylinder(9, 50, 51, 60) - Manifold.cylinder(9, 41, 42.5, 60)
    pearls = around(8, ellipsoid(6, 6, 6, (55, 0, 62)))
    return union(wall, band, pearls)


def _cactus():
    """Toy saguaro with a flower pot, lying on its back."""

    def rib(points, radius):
        return rod(np.array(points, dtype=float), radius)

    trunk = rib([(-38, 0, 19), (56, 0, 19)], 17)
    for a in range(8):
        turn = 2 * np.pi * a / 8
        trunk = union(
            trunk,
            rod_through(
                (-38, 16 * np.cos(turn), 19 + 16 * np.sin(turn)),
                (54, 15 * np.cos(turn), 19 + 15 * np.sin(turn)),
                radius=3.5,
            ),
        )
    left = rib([(-8, 10, 19), (-6, 40, 19), (2, 46, 19), (36, 46, 19)], 10.5)
    right = rib([(14, -10, 19), (16, -34, 19), (23, -40, 19), (48, -40, 19)], 9)
    pot = Manifold.cylinder(36, 19, 26, SIDES).rotate((0, 90, 0)).translate((-75, 0, 22))
    rim = Manifold.cylinder(9, 29, 29, SIDES).rotate((0, 90, 0)).translate((-46, 0, 22))
    return footed(union(trunk, left, right, pot, rim), 2)


def _helmet():
    """A cyclist's helmet: a long shell with slots and a visor."""
    shell = ellipsoid(76, 56, 72) - ellipsoid(67, 47, 62)
    shell = footed(shell, 0)
    for y in (-30, 0, 30):
        slot = block(70, 11, 90, (0, y, 55)) if y else block(90, 12, 60, (0, 0, 70))
        shell = shell - slot
    # two bows across, so that the slots do not part the shell
    bows = [(ellipsoid(76, 56, 72) - ellipsoid(66, 46, 61)) ^ block(12, 130, 90, (x, 0, 45)) for x in (-18, 18)]
    visor = plate([(55, -44), (84, -30), (90, 0), (84, 30), (55, 44), (60, 0)], 6).translate((0, 0, 6))
    visor = visor - ellipsoid(67, 47, 62)
    return union(shell, *bows, visor)


def _mask():
    """A carnival mask with its back on the table: a curved face, eye holes, nose and plumes."""
    half = [
        (0, 18),
        (14, 24),
        (36, 32),
        (64, 34),
        (80, 46),
        (76, 14),
        (64, -14),
        (44, -28),
        (22, -27),
        (9, -14),
        (0, -9),
    ]
    outline = half + [(-x, y) for x, y in half[-2:0:-1]]
    solid = plate(outline, 100).translate((0, 0, -50))
    bow = ellipsoid(84, 400, 44) - ellipsoid(79, 395, 39)
    face = (solid ^ bow).trim_by_plane((0, 0, 1), 19)
    for x in (-34, 34):
        face = face - ellipsoid(17, 9, 80, (0, 0, 0)).rotate((0, 0, 12 if x > 0 else -12)).translate((x, 2, 0))
    nose = hull(ellipsoid(4, 5, 4, (0, 12, 40)), ellipsoid(9, 6, 8, (0, -16, 46)), ellipsoid(3, 4, 3, (0, -26, 38)))
    plumes = [
        hull(ellipsoid(5, 5, 4, (x, 20, 38)), ellipsoid(8, 10, 4, (2.2 * x, 58 - abs(x), 32))) for x in (-16, 0, 16)
    ]
    return union(face, nose, *plumes)


def _butterfly():
    fore = [(4, 4), (22, 40), (52, 62), (74, 60), (76, 42), (62, 18), (30, 0)]
    hind = [(4, 2), (34, 0), (56, -14), (56, -36), (40, -52), (26, -44), (12, -18)]
    wing = (
        union(plate(fore, 6, CrossSection.circle(9, 24).translate((56, 44))), plate(hind, 6))
        .rotate((0, -14, 0))
        .translate((0, 0, 6))
    )
    body = hull(ellipsoid(6, 5, 6, (0, -36, 8)), ellipsoid(9, 12, 8, (0, 6, 9)))
    feelers = [rod_through((0, 22, 12), (s * 10, 44, 16), (s * 24, 56, 18), radius=2.5) for s in (-1, 1)]
    return footed(union(body, wing, wing.mirror((1, 0, 0)), ellipsoid(9, 9, 8, (0, 20, 11)), *feelers), 2)


def _shoe():
    """A child's shoe: sole with heel, hollow to the foot, open at the ankle."""
    sole = [
        (-74, -18),
        (-80, 0),
        (-74, 18),
        (-50, 24),
        (-10, 22),
        (30, 32),
        (58, 30),
        (76, 14),
        (80, -4),
        (70, -24),
        (40, -31),
        (0, -24),
        (-50, -24),
    ]

    def upper(shrink, low):
        heel = ellipsoid(30 - shrink, 24 - shrink, 10, (-48, 0, low + 8))
        ankle = ellipsoid(30 - shrink, 23 - shrink, 8, (-46, 0, 70))
        instep = ellipsoid(20 - shrink, 20 - shrink, 20 - shrink, (0, 0, 36))
        toe = ellipsoid(34 - shrink, 29 - shrink, 26 - shrink, (40, 0, low + 14))
        return union(hull(heel, ankle, instep), hull(heel, instep, toe))

    outer = upper(0, 8).trim_by_plane((0, 0, 1), 6).trim_by_plane((0, 0, -1), -70)
    inner = upper(4, 8).trim_by_plane((0, 0, 1), 14)
    inner = union(inner, hull(ellipsoid(25, 18, 3, (-46, 0, 60)), ellipsoid(27, 20, 3, (-46, 0, 90))))
    laces = [
        rod_through((x, -16, z - 8), (x, 0, z + 3), (x, 16, z - 8), radius=3.5)
        for x, z in ((2, 53), (14, 49), (26, 46))
    ]
    base = union(
        plate(sole, 8).translate((0, 0, 6)), plate(sole, 8).translate((0, 0, 0)) - block(40, 100, 12, (-8, 0, 0))
    )
    return union(base, outer - inner, *laces)


def _saddle():
    """A toy riding saddle, astride: a sheet bent over x and y, pommel, cantle, flaps."""
    nx, ny = 45, 45
    u, v = np.meshgrid(np.linspace(-1, 1, nx), np.linspace(-1, 1, ny), indexing="ij")
    x = 64 * u * (1 - 0.22 * v**2)
    y = 48 * np.sin(1.3 * v) / np.sin(1.3)
    z = 48 - 48 * np.abs(v) ** 1.7 + 26 * u**2 * (1 - v**2) ** 1.0
    top = np.stack([x, y, z + 8], -1).reshape(-1, 3)
    low = np.stack([x, y * 0.92, z], -1).reshape(-1, 3)
    from manifold3d import Mesh

    n = nx * ny
    at = np.arange(n).reshape(nx, ny)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = [
        np.column_stack([a, b, c]),
        np.column_stack([a, c, d]),
        n + np.column_stack([a, c, b]),
        n + np.column_stack([a, d, c]),
    ]
    loop = np.concatenate([at[:-1, 0], at[-1, :-1], at[:0:-1, -1], at[0, :0:-1]])
    after = np.roll(loop, -1)
    faces += [np.column_stack([loop, n + loop, n + after]), np.column_stack([loop, n + after, after])]
    sheet = Manifold(Mesh(np.vstack([top, low]).astype(np.float32), np.vstack(faces).astype(np.uint32)))
    horn = union(rod_through((58, 0, 74), (63, 0, 84), radius=5), ellipsoid(8, 8, 3.5, (63, 0, 86)))
    side = [(-90, 46), (-34, 36), (-30, 14), (-16, 0), (24, 0), (36, 14), (38, 34), (90, 46), (90, 110), (-90, 110)]
    sheet = sheet ^ plate(side, 120).translate((0, 0, -60)).rotate((90, 0, 0))
    rolls = [rod_through((18, y, 44), (32, 1.25 * y, 22), radius=6) for y in (-30, 30)]
    return union(sheet, horn, *rolls)


def _keys():
    """Four keys on a ring, fanned out, fused where they cross."""
    ring = CrossSection.circle(4, 20).translate((21, 0)).revolve(60).translate((0, 0, 7))
    parts = [ring]
    for i, (angle, long, tilt) in enumerate(((-165, 44, 4), (-118, 56, 4), (-70, 46, 4), (-22, 50, 4))):
        bow = [
            CrossSection.circle(15, 6),
            CrossSection.circle(14, SIDES),
            CrossSection.square((26, 26), True),
            CrossSection.circle(15, 3),
        ][i]
        bow = bow - CrossSection.circle(4, 20).translate((4, 0))
        shank = CrossSection.square((long, 9)).translate((8, -4.5))
        teeth = [CrossSection.square((5, 7)).translate((long - 18 + 9 * k, -9 - 2 * (k % 2))) for k in range(3)]
        for tooth in [*teeth, shank]:
            bow = bow + tooth
        key = bow.extrude(11).translate((31, 0, tilt))
        parts.append(key.rotate((0, 0, angle)))
    tag = hull(*(Manifold.cylinder(9, 13, 13, SIDES).translate((x, 0, 4)) for x in (32, 50))).rotate((0, 0, 80))
    return union(*parts, tag).scale((1, 1, 1.4))


def _dinosaur():
    """Long neck, plates on the back, tail on the ground."""
    legs = [
        hull(ellipsoid(12, 9, 9, (x, y, 30)), Manifold.cylinder(4, 10, 9, 24).translate((x, 1.15 * y, 0)))
        for x in (-22, 22)
        for y in (-14, 14)
    ]
    neck = [(26, 0, 42, 15), (46, 0, 56, 10), (56, 0, 70, 8), (70, 0, 74, 9), (80, 0, 71, 6)]
    tail = [(-26, 0, 36, 16), (-48, 4, 24, 11), (-66, 12, 12, 7), (-84, 24, 5, 4)]
    parts = [ellipsoid(40, 21, 22, (0, 0, 40)), *legs]
    for run in (neck, tail):
        balls = [ellipsoid(s, s, s, at) for *at, s in run]
        parts += [hull(*pair) for pair in pairwise(balls)]
    for x, z, s in ((-42, 38, 9), (-24, 54, 12), (-4, 60, 14), (16, 58, 12), (36, 58, 9)):
        parts.append(plate([(x - s, z), (x + s, z), (x, z + 1.6 * s)], 6).translate((0, 0, -3)).rotate((90, 0, 0)))
    return union(*parts).scale((0.95, 1, 1))


def _turtle():
    shell = footed(ellipsoid(46, 38, 34, (0, 0, 14)), 12)
    scutes = [ellipsoid(11, 11, 6, (22 * np.cos(a), 19 * np.sin(a), 41)) for a in np.arange(6) * np.pi / 3]
    rim = Manifold.cylinder(6, 50, 48, SIDES).scale((1, 0.83, 1)).translate((0, 0, 9))
    flippers = [hull(ellipsoid(12, 10, 8, (34, y * 26, 12)), ellipsoid(12, 7, 4, (40, y * 60, 5))) for y in (-1, 1)]
    paws = [hull(ellipsoid(10, 9, 8, (-32, y * 22, 11)), ellipsoid(8, 8, 4, (-54, y * 38, 5))) for y in (-1, 1)]
    head = [
        hull(ellipsoid(10, 9, 9, (40, 0, 16)), ellipsoid(9, 9, 9, (58, 0, 25))),
        ellipsoid(17, 13, 12, (68, 0, 28)),
    ]
    tail = hull(ellipsoid(6, 6, 5, (-44, 0, 11)), ellipsoid(2, 2, 2, (-64, 0, 6)))
    return footed(union(shell, rim, *scutes, *flippers, *paws, *head, tail), 1.5)


def _bananas():
    """A bunch of four, lying on their side."""
    parts = []
    for fan in (-27, -9, 9, 27):
        turn = np.linspace(0.15, 1.9, 12)
        size = np.interp(turn, [0.15, 0.35, 0.6, 1.4, 1.75, 1.9], [5, 7, 14, 15, 9, 4])
        path = np.column_stack([80 * np.sin(turn) - 10, 0 * turn, 80 - 80 * np.cos(turn)])
        path = np.column_stack([path[:, 0], path[:, 2] * 0.9, 0 * turn])
        balls = [ellipsoid(s, s, s, (0, 0, 0)).translate(tuple(p)) for s, p in zip(size, path, strict=True)]
        fruit = union(*(hull(*pair) for pair in pairwise(balls)))
        parts.append(fruit.rotate((0.25 * fan, 0, 0)).rotate((0, 0, -0.8 * fan)))
    bunch = union(*parts, rod_through((-20, -8, 0), (8, 4, 0), radius=10))
    return footed(bunch, bunch.bounding_box()[2] + 13)


def _spectacles():
    """Thick frames, sides open, lenses up, stood on the frame's lower rim and the ends of the sides."""
    lens = CrossSection.circle(29, SIDES).scale((1.1, 0.85))
    hole = CrossSection.circle(22, SIDES).scale((1.12, 0.85))
    rims = [(lens - hole).extrude(8).translate((x, 0, -4)) for x in (-38, 38)]
    panes = [lens.extrude(3).translate((x, 0, -1.5)) for x in (-38, 38)]
    front = union(*rims, *panes, rod_through((-12, 8, 0), (0, 12, 2), (12, 8, 0), radius=4.5))
    front = front.rotate((90, 0, 0)).translate((0, 0, 26))
    sides = [
        rod_through((s * 68, 0, 36), (s * 74, 8, 38), (s * 70, 88, 36), (s * 66, 118, 5.85), radius=4.5)
        for s in (-1, 1)
    ]
    return union(front, *sides)


def _crab():
    body = hull(ellipsoid(34, 22, 14, (0, 0, 22)), ellipsoid(22, 12, 12, (0, -16, 20)))
    parts = [body]
    for s in (-1, 1):
        for k, (a, far) in enumerate(((-62, 58), (-35, 66), (-8, 68))):
            c, d = np.cos(np.radians(a)), np.sin(np.radians(a))
            parts.append(
                rod_through(
                    (s * 20, -6 + 6 * k, 20),
                    (s * 0.72 * far * c, 0.72 * far * d, 32),
                    (s * far * c, far * d, 4),
                    radius=4,
                )
            )
        parts.append(rod_through((s * 26, 8, 22), (s * 54, 22, 20), (s * 50, 42, 10), radius=6))
        claw = plate([(-13, 0), (13, 0), (18, 20), (12, 38), (3, 46), (6, 24), (-3, 22), (-9, 36), (-16, 20)], 18)
        parts.append(claw.translate((0, 0, -9)).rotate((0, 0, s * 22)).translate((s * 50, 42, 9)))
        parts += [rod_through((s * 10, 18, 28), (s * 12, 24, 42), radius=2.5), ellipsoid(5, 5, 5, (s * 12, 24, 44))]
    return union(*parts)


def _bear():
    """A teddy bear, sitting."""
    ears = [ellipsoid(9, 6, 9, (0, y, 80)) for y in (-17, 17)]
    arms = [hull(ellipsoid(9, 9, 9, (2, y * 22, 44)), ellipsoid(9, 9, 8, (26, y * 36, 28))) for y in (-1, 1)]
    legs = [hull(ellipsoid(13, 13, 12, (8, y * 18, 12)), ellipsoid(11, 11, 11, (46, y * 30, 11))) for y in (-1, 1)]
    feet = [ellipsoid(6, 12, 16, (54, y * 31, 16)) for y in (-1, 1)]
    head = [ellipsoid(21, 24, 20, (2, 0, 66)), ellipsoid(11, 11, 9, (22, 0, 61)), ellipsoid(4, 4, 3, (33, 0, 63))]
    return footed(union(ellipsoid(27, 28, 31, (-4, 0, 28)), *head, *ears, *arms, *legs, *feet), 1)


THIRD_SHAPES: dict[str, Callable[[], Manifold]] = {
    "rubber duck": _duck,
    "chess knight": _knight,
    "hand bell": _bell,
    "soap dispenser": _dispenser,
    "game controller": _controller,
    "starfish": _starfish,
    "crown": _crown,
    "cactus": _cactus,
    "helmet": _helmet,
    "mask": _mask,
    "butterfly": _butterfly,
    "shoe": _shoe,
    "saddle": _saddle,
    "key ring": _keys,
    "dinosaur": _dinosaur,
    "turtle": _turtle,
    "bananas": _bananas,
    "spectacles": _spectacles,
    "crab": _crab,
    "teddy bear": _bear,
}
