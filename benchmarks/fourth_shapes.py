"""Twenty shapes of no class, the fourth set, in millimetres: see `odd_shapes`.

Drawn by someone who did not see the shapes that the classifier learns from, nor any answer of it.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from odd_shapes import SIDES, around, block, ellipsoid, footed, hull, plate, profile_turned, rod_through, union


def _disc(height, low, high, at):
    return Manifold.cylinder(height, low, high, SIDES).translate(tuple(at))


def _bead(a, b, c, at):
    """A coarse ellipsoid, for what is many times there."""
    return Manifold.sphere(1.0, 16).scale((a, b, c)).translate(tuple(at))


def _limb(*run):
    """Balls (x, y, z, radius), one joined to the next."""
    balls = [Manifold.sphere(size, 24).translate(tuple(at)) for *at, size in run]
    return union(*(hull(*pair) for pair in pairwise(balls)))


def _snowflake():
    arm = [block(74, 9, 14, (37, 0, 7)), block(12, 12, 14, (0, 0, 7)).rotate((0, 0, 45)).translate((74, 0, 0))]
    for far, long in ((24, 17), (42, 27), (60, 16)):
        branch = block(long, 7, 10, (long / 2, 0, 5))
        arm += [branch.rotate((0, 0, side * 60)).translate((far, 0, 2)) for side in (-1, 1)]
    ring = Manifold.cylinder(18, 22, 22, 6) - Manifold.cylinder(18, 11, 11, 6)
    return union(around(6, union(*arm)) - Manifold.cylinder(18, 8, 8, 6), ring)


def _maple_leaf():
    """Curled up at both sides, with veins and a stalk."""
    half = [(4, -34), (36, -42), (31, -28), (64, -2), (54, 3), (61, 26), (44, 21), (39, 30), (21, 10), (29, 48),
            (17, 43), (0, 74)]  # fmt: skip
    leaf = plate(half + [(-x, y) for x, y in half[-2::-1]], 7)
    veins = [
        rod_through((0, -36, 6), (x, y, 6), radius=3.5)
        for x, y in ((0, 62), (50, 16), (-50, 16), (26, -36), (-26, -36))
    ]
    stalk = rod_through((0, -30, 4), (3, -60, 5), (12, -84, 8), radius=4)
    leaf = union(leaf, *veins, stalk).refine_to_length(6)
    return leaf.warp(lambda at: (at[0], at[1], at[2] + 0.0045 * at[0] ** 2 + 0.0015 * at[1] ** 2))


def _skateboard():
    deck = hull(*(_disc(6, 27, 27, (x, 0, 0)) for x in (-66, 66))).refine_to_length(7)
    deck = deck.warp(lambda at: (at[0], at[1], at[2] + 0.014 * max(0.0, abs(at[0]) - 58) ** 2))
    parts = [deck.translate((0, 0, 25))]
    for x in (-48, 48):
        parts += [
            hull(block(26, 24, 4, (x, 0, 25)), block(10, 34, 8, (x, 0, 11))),
            rod_through((x, -24, 11), (x, 24, 11), radius=4),
        ]
        parts += [
            Manifold.cylinder(13, 11, 11, SIDES, True).rotate((90, 0, 0)).translate((x, y, 11)) for y in (-26, 26)
        ]
    return union(*parts)


def _windmill():
    """Eight-sided tower with a gallery, a cap, four sails of lattice turned to the side."""
    tower = Manifold.cylinder(92, 36, 23, 8)
    gallery = _disc(4, 43, 43, (0, 0, 34))
    rail = around(16, rod_through((41, 0, 36), (41, 0, 46), radius=1.5))
    rail = union(rail, CrossSection.circle(1.8, 16).translate((41, 0)).revolve(48).translate((0, 0, 46)))
    cap = hull(_disc(4, 25, 25, (0, 0, 90)), ellipsoid(10, 14, 8, (4, 0, 108)))
    cloth = block(4, 22, 48, (0, 9, 42)) - union(
        *(block(9, 6, 8, (0, y, z)) for y in (5, 14) for z in range(24, 62, 12))
    )
    sail = union(rod_through((0, 0, 0), (0, 0, 66), radius=3.5), cloth.rotate((0, 0, 14)))
    sails = [sail.rotate((90 * i + 25, 0, 0)).translate((40, 0, 98)) for i in range(4)]
    door = block(10, 14, 24, (33, 0, 12))
    return union(tower, gallery, rail, cap, rod_through((0, 0, 98), (46, 0, 98), radius=6), *sails, door)


def _spiral_staircase():
    parts = [_disc(5, 34, 34, (0, 0, 0)), _disc(162, 7, 7, (0, 0, 0)), ellipsoid(10, 10, 10, (0, 0, 164))]
    rail = []
    for i in range(12):
        step = plate([(0, -5), (50, -14), (52, 0), (50, 14), (0, 5)], 5)
        post = rod_through((47, 0, 2), (47, 0, 38), radius=2)
        parts.append(union(step, post).rotate((0, 0, 30 * i)).translate((0, 0, 4 + 10 * i)))
    for turn in np.linspace(0, 11, 56):
        rail.append((47 * np.cos(turn * np.pi / 6), 47 * np.sin(turn * np.pi / 6), 42 + 10 * turn))
    return union(*parts, rod_through(*rail, radius=3))


def _twisted_star():
    """Abstract: a star that turns as it rises and thins, with a second, leaning one grown from its foot."""
    angle, radius = np.arange(10) * np.pi / 5, np.where(np.arange(10) % 2, 19, 46)
    star = CrossSection([np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])], FillRule.NonZero)
    tall = star.extrude(160, 48, 170, (0.34, 0.34))
    low = star.scale((0.5, 0.5)).extrude(90, 30, -140, (0.4, 0.4)).rotate((0, 32, 0)).translate((24, 8, 0))
    return footed(union(tall, low))


def _bird_cage():
    rise = [(46, 0, 4), (46, 0, 76)]
    dome = [(46 * np.cos(a), 0, 76 + 46 * np.sin(a)) for a in np.linspace(0, np.pi / 2, 9)[1:]]
    bars = around(12, rod_through(*rise, *dome, radius=2))
    hoops = [CrossSection.circle(2.5, 16).translate((46, 0)).revolve(60).translate((0, 0, z)) for z in (40, 76)]
    floor = union(_disc(6, 50, 50, (0, 0, 0)), _disc(4, 50, 48, (0, 0, 6)))
    hook = CrossSection.circle(2.5, 16).translate((10, 0)).revolve(40).rotate((90, 0, 0)).translate((0, 0, 132))
    perch = [rod_through((-46, 0, 40), (46, 0, 40), radius=2.5), _limb((8, 0, 46, 8), (-4, 0, 50, 9), (-20, 0, 44, 3))]
    return union(floor, bars, *hoops, _disc(6, 8, 6, (0, 0, 119)), hook, *perch, ellipsoid(7, 6, 6, (12, 0, 55)))


def _globe():
    """With raised lands, in a tilted half ring on a foot."""
    ball = ellipsoid(42, 42, 42)
    lands = [((20, 16), (16, 24, 20)), ((95, 30), (26, 15, 10)), ((70, -12), (14, 20, 24)), ((190, 40), (20, 20, 12)),
             ((230, -18), (12, 16, 22)), ((310, -25), (17, 14, 12)), ((0, -90), (18, 15, 6))]  # fmt: skip
    for (east, north), size in lands:
        east, north = np.radians((east, north))
        at = 35 * np.array([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])
        ball = union(ball, ellipsoid(*size, at) ^ ellipsoid(44.5, 44.5, 44.5))
    bow = [(-52 * np.cos(a), 0, 52 * np.sin(a)) for a in np.linspace(-np.pi / 2, np.pi / 2, 25)]
    turned = union(ball, rod_through((0, 0, -57), (0, 0, 57), radius=3), rod_through(*bow, radius=4)).rotate((0, 23, 0))
    foot = profile_turned([(0, 0), (40, 0), (40, 6), (22, 11), (9, 17), (6, 26), (8, 34), (0, 34)])
    return union(turned.translate((8, 0, 84)), foot, rod_through((0, 0, 28), (-8, 0, 34), radius=5))


def _hourglass():
    """Three turned posts round a waisted glass, lying on its side."""
    glass = profile_turned(
        [(0, 4), (20, 4), (27, 14), (28, 26), (22, 40), (9, 52), (4, 60), (9, 68), (22, 80), (28, 94), (27, 106),
         (20, 116), (0, 116)]
    )  # fmt: skip
    post = profile_turned(
        [(0, 2), (4, 2), (4, 18), (7, 24), (4, 30), (3, 60), (4, 90), (7, 96), (4, 102), (4, 118), (0, 118)]
    )
    ends = [profile_turned([(0, z), (46, z), (49, z + 4), (46, z + 8), (0, z + 8)]) for z in (0, 112)]
    whole = union(glass, *ends, around(3, post.translate((39, 0, 0)))).rotate((0, 0, 60)).rotate((0, 90, 0))
    return whole.translate((-60, 0, 49))


def _sea_urchin():
    parts = [ellipsoid(33, 33, 25)]
    count = 84
    for i in range(count):
        z, turn = 1 - (2 * i + 1) / count, i * np.pi * (3 - 5**0.5)
        way = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
        if z > -0.6:
            foot, tip = way * (31, 31, 23), way * (33, 33, 25) + way * (30 + 9 * (i % 3))
            parts.append(hull(_bead(4, 4, 4, foot), _bead(1.3, 1.3, 1.3, tip)))
    whole = union(*parts)
    return footed(whole, -24)


def _pine_cone():
    """On its side, the scales open."""
    parts = [ellipsoid(20, 20, 58, (0, 0, 62))]
    for i in range(78):
        along = i / 77
        out = 40 * np.sin(np.pi * (0.16 + 0.8 * along)) ** 0.8
        scale = hull(
            _bead(3, 6, 3, (8, 0, -4)),
            _bead(2.5, 3 + 0.2 * out, 2.5, (out, 0, 4)),
            _bead(2, 2, 2, (out + 5, 0, 9)),
        )
        parts.append(scale.rotate((0, 0, 137.5 * i)).translate((0, 0, 12 + 98 * along)))
    stalk = rod_through((0, 0, 8), (0, 2, -10), radius=5)
    return footed(union(*parts, stalk).rotate((0, 84, 0)), -36)


def _penguin():
    wings = [
        hull(
            ellipsoid(8, 5, 9, (0, y * 29, 76)), ellipsoid(9, 3.5, 16, (4, y * 40, 46)), _bead(4, 3, 4, (8, y * 46, 30))
        )
        for y in (-1, 1)
    ]
    feet = [
        hull(ellipsoid(9, 8, 6, (2, y * 15, 5)), *(_bead(4, 4, 3, (30, y * 17 + k, 3)) for k in (-9, 0, 9)))
        for y in (-1, 1)
    ]
    belly = hull(ellipsoid(33, 32, 30, (0, 0, 34)), ellipsoid(22, 25, 20, (-2, 0, 78)))
    head = [ellipsoid(22, 21, 20, (2, 0, 108)), _limb((20, 0, 108, 7), (40, 0, 103, 2))]
    tail = hull(ellipsoid(8, 14, 8, (-26, 0, 20)), _bead(3, 8, 2, (-46, 0, 4)))
    return footed(union(belly, *head, *wings, *feet, tail), 1)


def _cairn():
    """A heap of flat pebbles: two carry a third like a bridge, four more lean on that."""
    stones = [
        ((26, 30, 20), (-42, 0, 18), (0, 4, 10)),
        ((24, 28, 22), (42, 4, 19), (5, -6, -20)),
        ((72, 34, 11), (0, 0, 45), (3, 2, 8)),
        ((40, 30, 13), (-8, 2, 65), (-5, -4, 30)),
        ((22, 27, 10), (0, -2, 84), (4, 9, -10)),
        ((17, 14, 12), (-4, 0, 102), (0, -12, 15)),
        ((9, 11, 8), (2, 1, 119), (10, 0, 0)),
    ]
    return footed(union(*(ellipsoid(*size).rotate(turn).translate(at) for size, at, turn in stones)), 1)


def _moebius_band():
    """Three half turns, standing on edge."""
    count = 144
    bars = []
    for turn in np.linspace(0, 360, count, endpoint=False):
        bar = block(7, 0.5, 36).rotate((0, 1.5 * turn, 0)).translate((52, 0, 0))
        bars.append(bar.rotate((0, 0, turn)))
    band = union(*(hull(bars[i], bars[(i + 1) % count]) for i in range(count)))
    band = band.rotate((78, 0, 0))
    return footed(band, band.bounding_box()[2] + 4)


def _octopus():
    parts = [hull(ellipsoid(24, 24, 14, (0, 0, 20)), ellipsoid(33, 30, 30, (-16, 0, 62)))]
    parts += [hull(ellipsoid(8, 8, 8, (14, y, 36)), _bead(5, 5, 5, (24, 1.2 * y, 42))) for y in (-15, 15)]
    far = np.linspace(12, 88, 12)
    for i in range(8):
        bend = np.radians(45 * i + 22) + 0.35 * (-1) ** i * np.sin((far - 12) / 17)
        lift = 9 + 9 * np.exp(-(((far - 14) / 14) ** 2)) + (16 if i % 3 == 0 else 5) * ((far - 12) / 76) ** 3
        size = np.linspace(11, 3, 12)
        reach = far * (1 - 0.1 * (i % 2))
        parts.append(_limb(*zip(reach * np.cos(bend), reach * np.sin(bend), lift - 11 + size, size, strict=True)))
    return footed(union(*parts), 0)


def _elephant():
    legs = [
        hull(ellipsoid(15, 13, 14, (x, y, 38)), _disc(5, 13, 12, (x, 1.1 * y, 0))) for x in (-28, 24) for y in (-17, 17)
    ]
    ears = [
        hull(
            ellipsoid(5, 5, 14, (40, y * 20, 72)),
            ellipsoid(4, 8, 18, (32, y * 46, 72)),
            _bead(4, 6, 6, (36, y * 34, 44)),
        )
        for y in (-1, 1)
    ]
    trunk = _limb((60, 0, 70, 14), (74, 0, 54, 10), (80, 0, 36, 8.5), (84, 0, 20, 7), (94, 0, 11, 6), (106, 0, 16, 5))
    tusks = [_limb((62, y * 10, 56, 5), (78, y * 16, 46, 4), (94, y * 17, 50, 1.5)) for y in (-1, 1)]
    tail = _limb((-46, 0, 62, 4), (-58, 0, 50, 3), (-60, 0, 32, 2.5), (-61, 0, 24, 5))
    return union(
        ellipsoid(50, 33, 32, (0, 0, 56)), ellipsoid(23, 22, 25, (52, 0, 74)), *legs, *ears, trunk, *tusks, tail
    )


def _picnic_table():
    planks = [block(150, 14, 6, (0, y, 77)) for y in (-32, -16, 0, 16, 32)]
    seats = [block(150, 20, 6, (0, y, 43)) for y in (-64, 64)]
    frames = []
    for x in (-52, 52):
        frames += [block(8, 77, 8, (x, 0, 70.5)), block(8, 145, 8, (x, 0, 37.5))]
        frames += [hull(block(7, 11, 2, (x, y * 21.7, 73.6)), block(7, 11, 2, (x, y * 54, 1))) for y in (-1, 1)]
        frames.append(hull(block(2, 6, 6, (x, 0, 37.5)), block(2, 6, 6, (0.2 * x, 0, 74.5))))
    return union(*planks, *seats, *frames)


def _grand_piano():
    """The lid shut, with a music rest, keys, pedals and a stool before it."""
    side = [
        (-62, -40),
        (62, -40),
        (62, 6),
        (52, 24),
        (30, 40),
        (16, 60),
        (6, 84),
        (-12, 98),
        (-36, 100),
        (-54, 90),
        (-62, 70),
    ]
    body = plate(side, 24).translate((0, 0, 50))
    lid = plate([(1.04 * x, 1.03 * y) for x, y in side], 4).translate((0, 0, 74))
    shelf = [block(124, 24, 8, (0, -50, 54)), *(block(9, 24, 20, (x, -50, 60)) for x in (-57.5, 57.5))]
    keys = [block(5, 18, 5, (x, -50, 60)) for x in range(-48, 49, 6)]
    legs = [
        hull(block(13, 13, 2, (x, y, 51)), _disc(2, 5, 5, (x, y, 0))) for x, y in ((-50, -44), (50, -44), (-26, 80))
    ]
    rest = block(64, 4, 24).rotate((-18, 0, 0)).translate((0, -26, 86))
    lyre = [rod_through((x, -20, 52), (0.6 * x, -22, 8), radius=2.5) for x in (-8, 8)]
    pedals = [block(24, 8, 6, (0, -22, 7)), *(block(5, 18, 3, (x, -32, 6)) for x in (-8, 0, 8))]
    return union(body, lid, *shelf, *keys, *legs, rest, *lyre, *pedals)


def _excavator():
    """Tracks, cab, engine, boom, arm and an open bucket."""
    parts = []
    for y in (-25, 25):
        track = hull(
            *(Manifold.cylinder(17, 12, 12, SIDES, True).rotate((90, 0, 0)).translate((x, y, 12)) for x in (-34, 34))
        )
        cleats = [block(4, 17, 3, (x, y, z)) for x in range(-36, 37, 9) for z in (-0.5, 24.5)]
        parts += [track, *cleats]
    parts += [block(50, 40, 14, (0, 0, 16)), _disc(10, 18, 18, (0, 0, 20)), block(84, 56, 8, (-6, 0, 31))]
    cab = hull(block(34, 24, 2, (12, 15, 34)), block(26, 22, 2, (8, 15, 70)))
    cab = cab - union(block(40, 16, 16, (12, 15, 56)), block(18, 40, 16, (9, 15, 56)))
    parts += [cab, block(30, 54, 24, (-32, 0, 46)), rod_through((-38, -16, 54), (-38, -16, 74), radius=3.5)]
    boom = plate([(8, 34), (24, 34), (46, 76), (80, 92), (78, 102), (40, 90), (18, 56)], 12)
    arm = plate([(70, 102), (84, 100), (100, 44), (92, 40)], 9)
    bucket = plate([(88, 50), (104, 50), (108, 34), (100, 18), (78, 12), (74, 18), (84, 28)], 32)
    hollow = plate([(66, 12.3), (96, 20.5), (102, 34), (98, 43), (93, 43), (90, 31), (66, 31)], 25)
    for solid, deep, cut in ((boom, 12, None), (arm, 9, None), (bucket, 32, hollow)):
        solid = solid.translate((0, 0, -deep / 2))
        solid = solid - cut.translate((0, 0, -12.5)) if cut else solid
        parts.append(solid.rotate((90, 0, 0)).translate((0, -12, 0)))
    parts.append(rod_through((30, -12, 40), (58, -12, 80), radius=3.5))
    return union(*parts)


def _faucet():
    """A gooseneck between two taps with crosses, on one plate."""
    foot = hull(*(_disc(6, 19, 17, (0, y, 0)) for y in (-48, 48)))
    neck = [
        (0, 0, 10),
        (0, 0, 88),
        *((34 - 34 * np.cos(a), 0, 88 + 34 * np.sin(a)) for a in np.linspace(0.2, np.pi, 12)),
    ]
    pipe = rod_through(*neck, (68, 0, 70), radius=7.5)
    parts = [foot, pipe, _disc(16, 16, 11, (0, 0, 5)), _disc(5, 10, 10, (0, 0, 40)), _disc(12, 9.5, 9.5, (68, 0, 60))]
    for y, turn in ((-48, 20), (48, 55)):
        tap = profile_turned([(0, 4), (14, 4), (11, 14), (8, 22), (8, 30), (10, 36), (10, 44), (6, 49), (0, 49)])
        bars = [rod_through((-21, 0, 40), (21, 0, 40), radius=4).rotate((0, 0, turn + k)) for k in (0, 90)]
        ends = around(4, _bead(6, 6, 6, (21, 0, 40))).rotate((0, 0, turn))
        parts.append(union(tap, *bars, ends).translate((0, y, 0)))
    return union(*parts)


FOURTH_SHAPES: dict[str, Callable[[], Manifold]] = {
    "snowflake": _snowflake,
    "maple leaf": _maple_leaf,
    "skateboard": _skateboard,
    "windmill": _windmill,
    "spiral staircase": _spiral_staircase,
    "twisted star": _twisted_star,
    "bird cage": _bird_cage,
    "globe": _globe,
    "hourglass": _hourglass,
    "sea urchin": _sea_urchin,
    "pine cone": _pine_cone,
    "penguin": _penguin,
    "cairn": _cairn,
    "moebius band": _moebius_band,
    "octopus": _octopus,
    "elephant": _elephant,
    "picnic table": _picnic_table,
    "grand piano": _grand_piano,
    "excavator": _excavator,
    "faucet": _faucet,
}
