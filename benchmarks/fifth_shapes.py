"""Twenty shapes of no class, the fifth set, in millimetres, as they stand or lie on a table: see `odd_shapes`.

Drawn by someone who did not see the shapes that the classifier learns from, nor any answer of it.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from fourth_shapes import _bead, _disc, _limb
from manifold3d import Manifold
from newer_shapes import _prism, _ring
from odd_shapes import around, block, ellipsoid, footed, hull, plate, profile_turned, rod_through, union
from scipy.interpolate import make_interp_spline


def _smooth(points, count):
    """A smooth run of `count` points through these."""
    return make_interp_spline(np.linspace(0, 1, len(points)), np.array(points, float))(np.linspace(0, 1, count))


def _on_table(solid):
    return solid.translate((0, 0, -solid.bounding_box()[2]))


def _rocking_horse():
    arc = np.linspace(-0.62, 0.62, 15)
    parts = [rod_through(*((130 * np.sin(a), y, 134 - 130 * np.cos(a)) for a in arc), radius=4) for y in (-24, 24)]
    parts += [rod_through((x, -24, 13), (x, 24, 13), radius=3.5) for x in (-48, 48)]
    parts += [_limb((0.65 * x, 0.5 * y, 54, 10), (x, y, 12, 5)) for x in (-48, 48) for y in (-24, 24)]
    parts += [hull(ellipsoid(20, 18, 17, (-28, 0, 62)), ellipsoid(20, 17, 18, (24, 0, 63)))]
    parts += [_limb((30, 0, 68, 15), (50, 0, 92, 9)), _limb((48, 0, 97, 10), (74, 0, 84, 6))]
    parts += [_limb((44, y, 103, 4), (43, 1.4 * y, 114, 2)) for y in (-6, 6)]
    parts += [_limb((-42, 0, 70, 5), (-62, 0, 62, 7), (-70, 0, 38, 3)), block(6, 46, 6, (50, 0, 90))]
    return union(*parts, hull(block(34, 30, 4, (-4, 0, 80)), block(6, 24, 4, (-20, 0, 88))))


def _helicopter():
    parts = [hull(ellipsoid(32, 22, 22, (12, 0, 38)), ellipsoid(14, 13, 14, (-24, 0, 44)))]
    parts += [_limb((-26, 0, 46, 9), (-96, 0, 52, 4)), _prism([(-102, 50), (-86, 50), (-96, 76), (-108, 76)], 4)]
    parts += [block(16, 46, 3, (-80, 0, 50)), block(6, 12, 6, (-98, 4, 62))]
    parts += [block(34, 3, 6).rotate((0, turn, 0)).translate((-98, 8, 62)) for turn in (35, 125)]
    parts += [_disc(26, 8, 5, (6, 0, 54)), block(36, 18, 14, (-8, 0, 60))]
    for y in (-28, 28):
        parts.append(_limb((-36, y, 4, 3.5), (44, y, 4, 3.5), (54, y, 10, 3.5)))
        parts += [rod_through((x, y, 4), (x, 0.4 * y, 26), radius=3) for x in (-10, 28)]
    return union(*parts, around(4, block(78, 9, 3, (39, 0, 76))).rotate((0, 0, 33)).translate((6, 0, 0)))


def _headphones():
    """Lying, the band out flat."""
    bow = _smooth([(-72, -30), (-76, 20), (-52, 68), (0, 88), (52, 68), (76, 20), (72, -30)], 30)
    parts = [hull(*pair) for pair in pairwise(block(7, 7, 22, (x, y, 36)) for x, y in bow)]
    parts += [hull(*pair) for pair in pairwise(block(13, 13, 28, (0.93 * x, 0.93 * y, 36)) for x, y in bow[8:22])]
    shell = hull(_disc(10, 34, 34, (0, 0, 0)), _disc(20, 24, 24, (0, 0, 0)))
    cup = union(shell, _ring(24, 11), _disc(6, 24, 24, (0, 0, -3)))
    return union(*parts, *(cup.rotate((0, 90 * x, 0)).translate((62 * x, -34, 36)) for x in (-1, 1)))


def _frog():
    parts = [hull(ellipsoid(34, 28, 17, (-14, 0, 22)), ellipsoid(18, 24, 13, (34, 0, 36)))]
    for y in (-1, 1):
        parts += [ellipsoid(9, 8, 9, (32, 15 * y, 50)), _limb((-36, 22 * y, 18, 14), (8, 52 * y, 20, 10))]
        parts += [_limb((8, 52 * y, 20, 10), (-40, 62 * y, 8, 7), (2, 74 * y, 4, 5))]
        parts += [_limb((0, 73 * y, 4, 5), (28, (74 + k) * y, 3, 3)) for k in (-14, 0, 14)]
        parts += [_limb((22, 20 * y, 24, 9), (36, 42 * y, 18, 7), (50, 36 * y, 5, 5))]
        parts += [_limb((50, 36 * y, 5, 5), (70, (38 + k) * y, 3, 3)) for k in (-12, 0, 12)]
    return footed(union(*parts), 1)


def _scorpion():
    parts = [hull(ellipsoid(18, 15, 9, (14, 0, 15)), ellipsoid(8, 10, 7, (30, 0, 15)))]
    parts += [ellipsoid(10, 19 - 0.45 * abs(x + 10), 10, (x, 0, 15)) for x in range(-38, 4, 9)]
    tail = [(-40, 16, 9), (-60, 21, 8), (-76, 36, 8), (-80, 56, 7), (-72, 74, 7), (-56, 84, 8), (-38, 66, 2)]
    parts += [_limb(*((x, 0, z, size) for x, z, size in tail))]
    parts += [_bead(size + 2, size + 2, size + 2, (x, 0, z)) for x, z, size in tail[1:6]]
    for y in (-1, 1):
        parts.append(_limb((24, 10 * y, 15, 6), (38, 36 * y, 18, 5), (58, 40 * y, 16, 6)))
        parts.append(hull(ellipsoid(14, 10, 8, (68, 38 * y, 15)), _bead(6, 5, 5, (56, 40 * y, 16))))
        parts += [_limb((74, k * y, 15, 6), (92, 1.2 * k * y - 8 * y, 14, 4), (106, k * y, 13, 2)) for k in (30, 47)]
        for x, far in ((22, 38), (8, 12), (-6, -16), (-20, -46)):
            parts.append(_limb((x, 12 * y, 14, 4), (0.6 * x + 0.4 * far, 36 * y, 26, 3.5), (far, 62 * y, 2, 2.5)))
    return footed(union(*parts), 0)


def _swan():
    parts = [hull(ellipsoid(44, 28, 22, (4, 0, 20)), ellipsoid(8, 14, 5, (-50, 0, 30)), _bead(4, 8, 3, (-68, 0, 40)))]
    neck = _smooth([(36, 0, 26, 15), (54, 0, 46, 10), (52, 0, 72, 7.5), (54, 0, 94, 7.5), (70, 0, 102, 8.5)], 12)
    parts += [_limb(*neck), _limb((70, 0, 101, 7), (94, 0, 90, 3))]
    for y in (-1, 1):
        for reach, lift in ((0, 0), (-13, -12), (-24, -24)):
            tip = _bead(6, 3, 5, (-52 - reach, y * (54 - 0.2 * reach), 76 + lift))
            parts.append(hull(ellipsoid(12, 6, 9, (22 + reach / 3, 25 * y, 34 + lift / 3)), tip))
    return footed(union(*parts), 2)


def _ginger_root():
    run = [(-78, -12, 15, 11), (-62, -4, 16, 16), (-44, 4, 17, 15), (-26, 2, 18, 19), (-6, -5, 17, 15), (14, 2, 18, 19),
           (32, 10, 17, 16), (50, 4, 17, 18), (68, -3, 16, 13), (86, 4, 15, 11)]  # fmt: skip
    parts = [_limb(*run), _limb((-26, 2, 18, 14), (-36, 32, 17, 14), (-52, 46, 16, 15), (-66, 52, 15, 10))]
    parts += [_limb((32, 10, 17, 14), (38, 38, 16, 15), (30, 58, 15, 12), (38, 72, 14, 9))]
    parts += [_limb((-6, -5, 17, 12), (-2, -32, 16, 14), (12, -46, 15, 13), (30, -54, 14, 9))]
    parts += [_limb((68, -3, 16, 10), (76, -28, 14, 11)), _limb((-26, 2, 18, 14), (-20, 4, 40, 11), (-10, 2, 48, 8))]
    return footed(union(*parts), 3)


def _bonsai_tree():
    tray = hull(block(96, 56, 2, (0, 0, 7)), block(112, 70, 2, (0, 0, 21))) - block(100, 58, 10, (0, 0, 22))
    parts = [tray, *(block(16, 12, 8, (x, y, 4)) for x in (-34, 34) for y in (-18, 18))]
    trunk = _smooth([(12, 0, 16, 14), (-6, 3, 34, 10), (4, -2, 58, 8), (18, 2, 76, 6), (10, 0, 98, 4)], 14)
    parts += [_limb(*trunk)]
    parts += [_limb((12, 0, 18, 7), (12 + x, y, 16, 3)) for x, y in ((24, 6), (-4, 22), (10, -22), (-26, -6))]
    for x, y, z, far in ((-58, 14, 52, 38), (62, -20, 64, 60), (-24, -26, 82, 76), (34, 34, 88, 84), (8, 2, 104, 96)):
        parts.append(_limb((*trunk[np.abs(trunk[:, 2] - far).argmin(), :3], 5), (x, y, z, 4)))
        turned = [(x + 13 * np.cos(a), y + 11 * np.sin(a), z + 2 + 2 * np.sin(3 * a)) for a in range(6)]
        parts += [_bead(14, 13, 9, at) for at in (*turned, (x, y, z + 5))]
    return union(*parts)


def _chain():
    """Five links, pulled in a bow."""
    arc = np.linspace(0, 2 * np.pi, 28) + 0.01
    link = rod_through(*((14 * np.cos(a), 14 * np.sin(a) + 12 * np.sign(np.sin(a)), 0) for a in arc), radius=5.5)
    parts, at = [], np.zeros(2)
    for i, heading in enumerate((-62, -30, 4, 38, 66)):
        step = 20.7 * np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading))])
        parts.append(link.rotate((0, 45 - 90 * (i % 2), heading - 90)).translate((*(at + step), 15)))
        at = at + 2 * step
    return _on_table(union(*parts))


def _wing_nut():
    wing = hull(ellipsoid(9, 6, 11, (17, 0, 16)), ellipsoid(8, 5, 8, (40, 0, 26)), ellipsoid(17, 5.5, 18, (56, 0, 42)))
    body = union(profile_turned([(0, 0), (25, 0), (25, 5), (22, 9), (17, 32), (0, 32)]), around(2, wing))
    return body - _disc(40, 11, 11, (0, 0, -2))


def _gate_valve():
    """Flanged pipe, bonnet, yoke and wheel."""
    flange = _disc(9, 29, 29, (0, 0, 0)) - around(6, _disc(9, 3, 3, (23, 0, 0)))
    pipe = union(_disc(140, 17, 17, (0, 0, 0)), flange, flange.translate((0, 0, 131))) - _disc(140, 12, 12, (0, 0, 0))
    parts = [pipe.rotate((0, 90, 0)).translate((-70, 0, 29)), ellipsoid(30, 25, 26, (0, 0, 29))]
    parts += [_disc(24, 20, 18, (0, 0, 36)), _disc(8, 27, 27, (0, 0, 58)), around(6, _disc(14, 4, 4, (22, 0, 55)))]
    parts += [_limb((0, 16 * y, 66, 4), (0, 14 * y, 84, 4), (0, 0, 94, 5)) for y in (-1, 1)]
    spokes = around(5, rod_through((0, 0, 106), (34, 0, 106), radius=3))
    return union(*parts, _disc(56, 5, 5, (0, 0, 62)), _ring(34, 5).translate((0, 0, 106)), spokes)


def _meat_grinder():
    """On three legs, with a hopper and a crank."""
    barrel = profile_turned([(0, -46), (12, -46), (12, -30), (19, -24), (19, 26), (28, 32), (28, 48), (0, 48)])
    barrel -= around(6, _disc(8, 4, 4, (16, 0, 43)))
    hopper = hull(block(36, 28, 2, (-4, 0, 84)), block(60, 48, 8, (-4, 0, 104)))
    hopper -= hull(block(24, 18, 2, (-4, 0, 88)), block(52, 40, 10, (-4, 0, 106)))
    parts = [barrel.rotate((0, 90, 0)).translate((10, 0, 58)), hopper, _disc(30, 14, 14, (-4, 0, 58))]
    for x, y in ((38, 0), (-32, 34), (-32, -34)):
        parts += [_limb((0.1 * x, 0.3 * y, 44, 9), (x, y, 5, 6)), _disc(4, 11, 10, (x, y, 0))]
    parts += [rod_through((-30, 0, 58), (-58, 0, 58), radius=6), _limb((-54, 0, 58, 8), (-58, 72, 46, 6))]
    return _on_table(union(*parts, _limb((-58, 72, 46, 6), (-70, 72, 46, 9), (-92, 72, 46, 7))))


def _toast_rack():
    parts = [rod_through((-70, y, 14), (70, y, 14), radius=4) for y in (-24, 24)]
    hoop = [(0, 42 * np.cos(a), 14 + 72 * np.sin(a) ** 0.7) for a in np.linspace(0.0, np.pi, 22)]
    parts += [rod_through(*hoop, radius=3).translate((x, 0, 0)) for x in (-66, -40, -14, 14, 40, 66)]
    parts += [rod_through((x, -42, 14), (x, 42, 14), radius=3.5) for x in (-66, -40, -14, 14, 40, 66)]
    parts += [ellipsoid(7, 7, 8, (x, y, 8)) for x in (-66, 66) for y in (-42, 42)]
    ring = _ring(13, 3.5).rotate((90, 0, 0)).translate((0, 0, 102))
    return footed(union(*parts, rod_through((-66, 0, 86), (66, 0, 86), radius=3.5), ring), 1)


def _pretzel():
    half = [(36, -46, 26, 7), (20, -24, 27, 8), (0, -4, 23, 8.5), (-8, 8, 15, 9), (0, 20, 9, 9), (18, 40, 10, 9.5),
            (48, 50, 11, 10), (72, 28, 11, 11), (66, -14, 12, 12), (36, -46, 13, 13), (0, -58, 14, 14)]  # fmt: skip
    other = [(-x, y, 30 - z if 10 < z < 24 and y > -10 else z, size) for x, y, z, size in half[-2::-1]]
    return footed(_limb(*_smooth(half + other, 64)), 1)


def _ice_skate():
    """On its side."""
    heel, top = ellipsoid(25, 19, 16, (-31, 0, 48)), block(46, 34, 4, (-34, 0, 116))
    foot = hull(heel, ellipsoid(24, 18, 16, (40, 0, 44)), block(86, 34, 4, (4, 0, 34)))
    boot = union(hull(heel, ellipsoid(16, 18, 14, (10, 0, 52)), top), foot)
    boot -= hull(block(34, 22, 4, (-34, 0, 118)), block(28, 18, 4, (-30, 0, 66)))
    parts = [boot, hull(block(122, 38, 4, (4, 0, 32)), block(110, 32, 2, (4, 0, 27)))]
    blade = [(-70, 4), (-64, 0), (66, 0), (76, 5), (84, 18), (76, 22), (68, 14), (54, 12), (-68, 12)]
    parts += [_prism(blade, 5), *(_prism([(x - 12, 28), (x + 12, 28), (x + 6, 10), (x - 6, 10)], 9) for x in (-36, 42))]
    parts += [block(7, 24, 7).rotate((0, 36, 0)).translate((22 - 0.73 * z, 0, 68 + z)) for z in (0, 11, 22, 33)]
    return _on_table(union(*parts).rotate((90, 0, 0)).trim_by_plane((0, 0, 1), -17.5))


def _shuttlecock():
    """On its side."""
    cork = union(ellipsoid(14, 14, 14), _disc(14, 14, 14, (0, 0, 0)))
    quill = _limb((11, 0, 12, 1.8), (33, 0, 86, 1.3))
    vane = hull(*(_bead(1, w, 1, (x, 0, z)) for x, z, w in ((22, 48, 3), (25, 58, 9), (32, 82, 10), (33, 88, 5))))
    rings = [_ring(x, 1.8).translate((0, 0, z)) for x, z in ((16.5, 30), (20, 42))]
    return _on_table(union(cork, *rings, around(14, union(quill, vane))).rotate((0, 74, 0)))


def _ribbon_bow():
    bend = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    outer = np.column_stack([40 - 42 * np.cos(bend), 20 * np.sin(bend) * np.sin(bend / 2) ** 0.6])
    loop = _prism(outer, 64) - _prism((outer - (42, 0)) * (0.9, 0.76) + (42, 0), 70)
    loop = loop.refine_to_length(8).warp(lambda at: (at[0], at[1] * (0.25 + 0.0095 * at[0]), at[2]))
    tail = plate([(-9, 6), (9, 6), (15, -84), (0, -68), (-15, -84)], 4).refine_to_length(6)
    tail = tail.warp(lambda at: (at[0], at[1], at[2] + 8 * np.cos(at[1] / 13) - 8))
    parts = [around(2, loop).translate((0, 0, 22)), hull(block(16, 22, 26, (0, 0, 22)), block(24, 14, 16, (0, 0, 22)))]
    return _on_table(union(*parts, *(tail.rotate((0, 0, turn)).translate((0, 0, 14)) for turn in (-28, 34))))


def _candelabrum():
    stem = profile_turned([(0, 0), (36, 0), (36, 5), (20, 11), (8, 18), (6, 34), (11, 40), (6, 46), (5, 84), (0, 84)])
    holder = profile_turned([(0, 0), (4, 0), (15, 5), (15, 8), (8, 8), (8, 14), (6, 15), (6, 36), (0, 40)])
    arm = _smooth([(0, 0, 62, 4.5), (26, 0, 46, 4.5), (56, 0, 48, 4), (70, 0, 66, 4)], 14)
    twirl = [(30 + 7 * np.cos(a), 0, 56 + 7 * np.sin(a), 2.5) for a in np.linspace(-1.8, 2.6, 10)]
    side = union(_limb(*arm), _limb(*twirl), holder.translate((70, 0, 64)))
    sides = [around(2, side), around(2, side.scale((0.72, 1, 1))).rotate((0, 0, 90))]
    return union(stem, holder.translate((0, 0, 80)), *sides)


def _ampersand():
    stroke = [(50, -62), (16, -22), (-22, 24), (-26, 48), (-4, 64), (18, 48), (10, 22), (-26, -4), (-42, -30),
              (-26, -58), (4, -60), (32, -38), (48, -6)]  # fmt: skip
    return union(*(hull(*pair) for pair in pairwise(_disc(24, 9, 9, (x, y, 0)) for x, y in _smooth(stroke, 60))))


def _crankshaft():
    """Lying, for four cylinders."""
    parts = [_disc(26, 8, 8, (0, 0, -96)), _disc(20, 11, 11, (0, 0, 70)), _disc(9, 24, 24, (0, 0, 82))]
    for i, side in enumerate((1, -1, -1, 1)):
        pin, end = 36 * i - 52, _disc(7, 13, 13, (0, 22 * side, 0))
        web = union(hull(_disc(7, 14, 14, (0, 0, 0)), end), _disc(7, 34, 34, (0, 0, 0)).trim_by_plane((0, -side, 0), 5))
        parts += [_disc(18, 9, 9, (0, 22 * side, pin - 9)), *(web.translate((0, 0, pin + k)) for k in (-12.5, 5.5))]
    journals = [_disc(18, 11, 11, (0, 0, z - 9)) for z in range(-70, 75, 36)]
    return _on_table(union(*parts, *journals).rotate((0, 90, 0)))


FIFTH_SHAPES: dict[str, Callable[[], Manifold]] = {
    "rocking horse": _rocking_horse, "helicopter": _helicopter, "headphones": _headphones, "frog": _frog,
    "scorpion": _scorpion, "swan": _swan, "ginger root": _ginger_root, "bonsai tree": _bonsai_tree,
    "iron chain": _chain, "wing nut": _wing_nut, "gate valve": _gate_valve, "meat grinder": _meat_grinder,
    "toast rack": _toast_rack, "pretzel": _pretzel, "ice skate": _ice_skate, "shuttlecock": _shuttlecock,
    "ribbon bow": _ribbon_bow, "candelabrum": _candelabrum, "ampersand": _ampersand, "crankshaft": _crankshaft,
}  # fmt: skip
