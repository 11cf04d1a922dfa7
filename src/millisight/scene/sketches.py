"""How each object of the catalogue is drawn: one function an object, or a kind of object.

A sketch takes the size (x, y, z) in millimetres that it has to fill, and returns a solid. Some are drawn
from that size alone (`can`, `box`, `ball`). The others are drawn by eye, after the outlines and sections of
the YCB scans, and `stretched` over the last few percent. What is closed in use (a can, a bottle) is drawn as
its outer skin, without the inside. Positions are in the pose that `objects` describes: x to the right, y up
the page, z towards the radar.
"""

from typing import TYPE_CHECKING

import numpy as np

from millisight.scene.shapes import (
    bent,
    block,
    body,
    curve,
    cylinder,
    disc,
    fillet,
    outline,
    plate,
    revolve,
    rounded_block,
    shell,
    smooth_outline,
    sphere,
    stretched,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

# An outline reads best with several points a line; the formatter would give each point its own.
# fmt: off

FLAT = (0, 0, 1)  # the normal of the table: a rod bent within the page


# ---- cans, boxes, balls ------------------------------------------------------------------------------------


def standing_can(x: float, y: float, z: float) -> "Manifold":
    """A tin can on its base: lips 1.5 mm wide and 3 mm high at both ends, lids 2.5 mm below them."""
    lip, rim, sunk = 1.5, 3.0, 2.5
    outer, end = x / 2, z / 2
    upper = [(outer - lip, end - rim), (outer, end - rim + 0.5), (outer, end), (outer - lip, end)]
    upper += [(outer - lip, end - sunk), (0, end - sunk)]
    lower = [(radius, -height) for radius, height in reversed(upper)]
    return stretched(revolve(lower + upper), (x, y, z))


def can(x: float, y: float, z: float) -> "Manifold":
    """A tin can on its side, its axis along x."""
    return standing_can(z, y, x).rotate((0, 90, 0))


def meat_can(x: float, y: float, z: float) -> "Manifold":
    """A tin of rounded rectangular section on its side, its axis along y, a lip around each end."""
    lip, rim, sunk = 1.5, 3.0, 2.5
    section = fillet(outline([(-x / 2, -z / 2), (x / 2, -z / 2), (x / 2, z / 2), (-x / 2, z / 2)]), 16)
    inside = section.offset(-lip, circular_segments=80)
    rims = plate(section, rim, z=(y - rim) / 2) + plate(section, rim, z=(rim - y) / 2)
    lids = plate(inside, sunk * 2, z=y / 2) + plate(inside, sunk * 2, z=-y / 2)
    return (plate(inside, y) + rims - lids).rotate((-90, 0, 0))


def box(x: float, y: float, z: float) -> "Manifold":
    """A box with crisp edges."""
    return block((x, y, z))


def ball(x: float, y: float, z: float) -> "Manifold":
    """A ball, or a fruit that nearly is one."""
    return stretched(sphere((x + y + z) / 6), (x, y, z))


def sponge(x: float, y: float, z: float) -> "Manifold":
    """A box with soft edges."""
    return rounded_block((x, y, z), 3)


def foam_brick(x: float, y: float, z: float) -> "Manifold":
    """A brick of foam with three blind holes in its top."""
    holes = [cylinder(7, 26, at=(i * 22, 0, z / 2)) for i in (-1, 0, 1)]
    return block((x, y, z)) - union(*holes)


def rubiks_cube(x: float, y: float, z: float) -> "Manifold":
    """A cube with a groove, 1.6 mm wide and 1 mm deep, between its 27 small ones."""
    wide, deep = 1.6, 1.0
    core = block((x - 2 * deep, y - 2 * deep, z - 2 * deep))
    cuts = [block((wide, y, z), at=(i * x / 6, 0, 0)) for i in (-1, 1)]
    cuts += [block((x, wide, z), at=(0, i * y / 6, 0)) for i in (-1, 1)]
    cuts += [block((x, y, wide), at=(0, 0, i * z / 6)) for i in (-1, 1)]
    return block((x, y, z)) - union(*cuts) + core


# ---- fruit, bottles ----------------------------------------------------------------------------------------


def apple(x: float, y: float, z: float) -> "Manifold":
    """Upright: broad shoulders, a hollow for the stem and one for the blossom."""
    side = [
        (0, 26), (7, 29), (15, 34), (25, 34.5), (34, 24), (37.3, 8), (34, -10), (25, -25), (15, -34.5),
        (7, -34), (0, -29),
    ]
    return stretched(revolve(curve(side, along=2)), (x, y, z))


def banana(x: float, y: float, z: float) -> "Manifold":
    """Bent in the page, the stem to the left; columns x, y, z, radius in the page, radius across it."""
    line = curve(
        [
            (-93, 33, 0, 4.5, 5), (-86, 22, 0, 5.5, 6), (-77, 6, 0, 11, 11), (-62, -5, 0, 15.5, 16),
            (-35, -14, 0, 18, 18), (0, -17, 0, 18.5, 18), (35, -12, 0, 18, 18), (62, 1, 0, 16.5, 17),
            (80, 15, 0, 12.5, 13), (92, 28, 0, 6.5, 7), (95, 32, 0, 4, 4),
        ]
    )
    return stretched(tube(line[:, :3], line[:, 3:], normal=FLAT), (x, y, z))


def mustard_bottle(x: float, y: float, z: float) -> "Manifold":
    """A waisted squeeze bottle lying on its broad side, the nozzle to the left."""
    bottle = body(
        [
            (-57, 0, 0, 19, 19), (-50, 0, 0, 27, 23), (-40, 0, 0, 38, 26), (-26, 0, 0, 46, 28),
            (-10, 0, 0, 48, 28), (12, 0, 0, 44, 26), (32, 0, 0, 40.5, 26), (55, 0, 0, 43, 26),
            (80, 0, 0, 47, 28), (96, 0, 0, 47, 28),
        ],
        exponent=2.6, rounding=(0, 6),
    )
    cap = [(0, -54), (20, -54), (20, -69), (18.5, -71), (13, -71), (12, -80), (8, -83), (6.5, -96), (0, -96)]
    return stretched(union(bottle, revolve(cap, axis="x")), (x, y, z))


def bleach_bottle(x: float, y: float, z: float) -> "Manifold":
    """A slender jug of rounded rectangular section on its broad side, the cap to the left, off the middle."""
    bottle = body(
        [
            (-107, -6, 0, 16, 16), (-97, -6, 0, 20, 20), (-90, -5, 0, 26, 23), (-75, -3, 0, 35, 26),
            (-60, -1, 0, 37, 27), (-25, 0, 0, 42, 29), (20, 0, 0, 46, 31), (80, 0, 0, 49, 33.5),
            (115, 0, 0, 49, 34), (127, 0, 0, 49, 34),
        ],
        exponent=3.2, rounding=(0, 5),
    )
    cap = cylinder(18, 22, axis="x", at=(-116, -6, 0)) + cylinder(20, 4, axis="x", at=(-105, -6, 0))
    return stretched(union(bottle, cap), (x, y, z))


# ---- vessels: open, with walls -----------------------------------------------------------------------------


def bowl(x: float, y: float, z: float) -> "Manifold":
    """A sheet 1.6 mm thick, open side up, its rim rolled outwards."""
    wall = [
        (0, 2), (20, 1.6), (38, 0.9), (44, 0.8), (48, 3.5), (56, 11.5), (64, 23), (69.5, 34), (72.5, 45),
        (74, 51), (77, 53.4), (79.7, 51.5),
    ]
    return stretched(shell(curve(wall, along=2), 1.6), (x, y, z))


def mug(x: float, y: float, z: float) -> "Manifold":
    """Upright, the handle to the right; wall 2.5 mm, a flat rim 5.5 mm wide turned outwards."""
    wall = [(0, 2.3), (33, 1.3), (37, 2), (39.5, 5), (39.9, 12), (39.9, 50), (39.9, 79.5), (45.2, 79.5)]
    cup = shell(np.concatenate([curve(wall[:5], along=2), wall[5:]]), 2.5)
    path = [(39.5, 66), (52, 67), (62, 63), (66.8, 52), (67, 36), (61, 23), (52, 16), (39.5, 13)]
    path = curve([(right, 0, up) for right, up in path])
    handle = tube(path, [(3.4, 7)], normal=(0, 1, 0)) - cylinder(39.5, 78, at=(0, 0, 41))
    return stretched(union(cup, handle), (x, y, z))


def cup(x: float, y: float, z: float) -> "Manifold":
    """A stacking cup, open side up: a foot, a straight wall 2 mm thick, a rim turned outwards."""
    outer, inner = x / 2, 0.85 * x / 2
    wall = [(0, 7), (inner - 4, 7), (inner - 4, 1), (inner - 4, 7), (inner, 8)]  # down the foot, and back
    wall += [(inner + 0.5, z - 3), (outer - 1, z - 3), (outer - 1, z - 1), (inner, z - 1)]
    return stretched(shell(wall, 2), (x, y, z))


def dinner_plate(x: float, y: float, z: float) -> "Manifold":
    """A sheet 2 mm thick: a flat middle and a sloping, rolled rim."""
    wall = [(0, 2), (40, 1.8), (75, 1.2), (86, 1.5), (95, 7), (102, 15), (110, 18.5), (122, 22), (128, 22)]
    return stretched(shell(curve(wall, along=2), 2), (x, y, z))


def skillet(x: float, y: float, z: float) -> "Manifold":
    """A frying pan, open side up, wall 3 mm; the handle, to the right, rises a little and ends in an eye."""
    wall = [(0, 1.5), (60, 1.5), (97, 1.5), (108, 4), (118, 18), (126, 33), (133.5, 43)]
    handle = body(
        [
            (122, 0, 33, 14, 4), (145, 0, 38, 10, 6), (190, 0, 45, 11, 7), (260, 0, 50, 13, 8),
            (310, 0, 51, 14, 8), (325, 0, 51, 13, 8),
        ],
        exponent=2.5, rounding=(0, 8),
    )
    return stretched(shell(curve(wall, along=2), 3) + handle - cylinder(5, 60, at=(312, 0, 51)), (x, y, z))


# ---- cutlery and kitchen tools -----------------------------------------------------------------------------


def _cutlery_handle() -> "Manifold":
    """The thick round handle of the YCB cutlery, from x = -99 to 1."""
    return body(
        [(-99, 0, 0, 9, 7), (-80, 0, 0, 9.3, 7.6), (-40, 0, 0, 8.6, 7), (-12, 0, 0, 7, 6), (1, 0, 0, 6.2, 5)],
        exponent=2.4, rounding=(9, 1.5),
    )


def _mirrored(side: list[tuple[float, float]]) -> "CrossSection":
    """The area between a smooth line above the x axis and its mirror image below."""
    upper = curve(side, along=2)
    return outline(np.concatenate([upper, (upper * (1, -1))[::-1]]))


def fork(x: float, y: float, z: float) -> "Manifold":
    """Four tines, curved up; the handle to the left."""
    head = _mirrored([(-4, 5), (12, 4.5), (28, 4), (36, 8), (46, 12), (58, 12.9), (75, 12.6), (99, 11.8)])
    for i in (-1, 0, 1):
        head -= strip([(52 - 2 * abs(i), 6.6 * i), (105, 6.3 * i)], [2.6, 4.2])
    line = curve([(-4, 0), (30, -1), (45, -4), (60, -5), (75, -2.5), (99, 5)], along=2).T
    head = bent(plate(fillet(head, 0.9), 2), lambda u, v: np.interp(u, *line) + 0.012 * v**2)
    return stretched(union(_cutlery_handle(), head), (x, y, z))


def knife(x: float, y: float, z: float) -> "Manifold":
    """A table knife: a blade 2.4 mm thick with a rounded point; the handle to the left."""
    point = curve(
        [(60, 9.4), (92, 8.6), (108, 5.5), (115.5, 0), (112, -4), (95, -8), (60, -9.6)], along=2, step=1
    )
    blade = outline([(-10, 4), (4, 4.5), (7, 9.3), *point, (10, -9.6), (7, -5), (-10, -4)])
    return stretched(union(_cutlery_handle(), plate(fillet(blade, 1.1), 2.4)), (x, y, z))


def spatula(x: float, y: float, z: float) -> "Manifold":
    """A turner: the blade, to the left, is tilted against the handle, which ends in an eye."""
    blade = _mirrored(
        [(-155, 36), (-148, 40), (-110, 40.8), (-84, 40), (-68, 32), (-52, 16), (-38, 7.5), (-15, 5), (40, 5)]
    )
    line = curve(
        [
            (-156, 14.5), (-130, 6.5), (-95, -6), (-72, -13), (-58, -14.5), (-42, -9), (-15, 0.5),
            (25, 6), (45, 6),
        ],
        along=2,
    ).T
    sheet = bent(plate(fillet(blade, 2), 3), lambda u, _v: np.interp(u, *line))
    grip = body(
        [
            (26, 0, 6, 8.5, 6.5), (40, 0, 6.5, 9.5, 8), (80, 0, 5, 12, 7.5), (110, 0, 3, 13, 7),
            (140, 0, 0, 11, 6), (155, 0, -1, 9, 5),
        ],
        exponent=2.6, rounding=(2, 8),
    )
    return stretched(union(sheet, grip) - cylinder(4.5, 40, at=(142, 0, 0)), (x, y, z))


# ---- workshop tools ----------------------------------------------------------------------------------------


def power_drill(x: float, y: float, z: float) -> "Manifold":
    """A cordless drill on its side: the chuck to the right, the grip down the page to the battery."""
    housing = body(
        [
            (-91, 67, 0, 20, 20), (-75, 65, 0, 27, 25), (-45, 66, 0, 29, 26), (-10, 72, 0, 25, 26),
            (34, 72, 0, 24, 25),
        ],
        exponent=2.6, rounding=(10, 4),
    )
    chuck = [
        (0, 20), (21, 20), (21, 48), (19.5, 49), (19.5, 51), (21, 52), (20, 64), (17, 78), (11, 88),
        (6, 89), (6, 92), (0, 92),
    ]
    # Drawn along x, then turned up the page: its y becomes -x.
    grip = body(
        [
            (-75, 40, 0, 21, 18), (-50, 39, 0, 20, 17), (-20, 38, 0, 20, 17), (5, 34, 0, 23, 17),
            (28, 24, 0, 33, 18), (50, 20, 0, 36, 19),
        ],
        exponent=2.6,
    ).rotate((0, 0, 90))
    trigger = rounded_block((24, 24, 16), 4, at=(0, 22, 0))
    battery = rounded_block((104, 26, 57), 8, at=(-10, -80, 0))
    foot = rounded_block((74, 20, 44), 5, at=(-18, -65, 0))
    jaws = revolve(chuck, axis="x").translate((0, 72, 0))
    return stretched(union(housing, jaws, grip, trigger, foot, battery), (x, y, z))


def scissors(x: float, y: float, z: float) -> "Manifold":
    """Closed, the point to the left; a large and a small bow."""
    blades = outline([(-99, -19), (-97, -16), (-12, 4), (2, 2), (0, -12), (-10, -13), (-90, -22), (-98, -22)])
    shanks = strip([(-8, -4), (18, 2), (38, 12)], [15, 11, 9])
    shanks += strip([(-8, -5), (22, -8), (52, -17)], [15, 11, 9])
    bows = [
        [(36, 9), (46, 28), (60, 38), (78, 40), (91, 34), (94, 24), (86, 13), (68, 5), (50, 2)],
        [(52, -17), (60, -11), (74, -9), (86, -14), (93, -24), (88, -34), (76, -39), (62, -35), (53, -27)],
    ]
    paths = [curve([(*point, 0) for point in bow], closed=True) for bow in bows]
    rods = [tube(path, [(4.2, 7.75)], normal=FLAT, closed=True) for path in paths]
    pivot = cylinder(6, 12, at=(-6, -4, 0))
    return stretched(union(plate(fillet(blades, 1), 4.5), plate(shanks, 10), pivot, *rods), (x, y, z))


def padlock(x: float, y: float, z: float) -> "Manifold":
    """A body with a bumper at its foot, to the right, and a closed shackle of 8 mm rod to the left."""
    case = rounded_block((41, 50, 27), 3, at=(14.5, 0, 0)) + rounded_block((10, 53.9, 28.8), 2, at=(30, 0, 0))
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 40)
    bow = np.column_stack([17 * np.cos(turn) - 14, 17 * np.sin(turn), 0 * turn])
    shackle = tube(np.array([(5, 17, 0), *bow, (5, -17, 0)]), 4.0, normal=FLAT)
    return stretched(union(case, shackle), (x, y, z))


def marker(x: float, y: float, z: float) -> "Manifold":
    """A felt pen with its cap on, to the right; a step and a groove between cap and barrel."""
    barrel = [(0, -60.4), (4.8, -60.4), (5.2, -54), (8.2, -54), (9, -52), (9, 14), (8.2, 14), (8.2, 16)]
    cap = [(9.4, 16), (9.2, 59), (8, 60.4), (0, 60.4)]
    return stretched(revolve(barrel + cap, axis="x"), (x, y, z))


def adjustable_wrench(x: float, y: float, z: float) -> "Manifold":
    """Jaws to the left, set off against the handle; an eye at its end, and the screw in its window."""
    handle = strip([(-45, 3), (78, 15.5)], [23, 17]) + disc(11.5, (90, 17)) - disc(6, (90, 17))
    back = [(-101, 1), (-100, 9), (-93, 20), (-82, 27), (-68, 28), (-54, 22), (-40, 13)]
    mouth = [(-67, -9), (-72, 3), (-79, 9), (-88, 8), (-97, 1)]
    neck = [(-28, 15), (-28, -7), (-42, -9), (-47, -17), (-62, -19)]
    head = fillet(outline([*curve(back, along=2, step=1), *neck, *curve(mouth, along=2, step=1)]), 2)
    jaw = [(-88, -22), (-75, -19.5), (-66, -10), (-58, -12), (-45, -14), (-44, -26), (-58, -29), (-86, -28)]
    window = outline([(-63, 3), (-46, 12), (-40, 1), (-57, -8)])
    screw = cylinder(4, 24, axis="x").rotate((0, 0, 27)).translate((-51.5, 2, 0))
    parts = [plate(handle - window, 8), plate(head - window, 13), plate(fillet(outline(jaw), 1.5), 11)]
    return stretched(union(*parts, screw.scale((1, 1, 1.7))), (x, y, z))


def screwdriver(x: float, y: float, z: float) -> "Manifold":
    """A fluted handle to the left, a round shaft, a cross-shaped point."""
    bulge = curve([(15, -99), (17, -88), (17, -62), (14.5, -42), (11.5, -25), (13.5, -11), (13, -5)], along=2)
    dome = [(16 * np.sin(a), -93.5 - 14.5 * np.cos(a)) for a in np.linspace(0, 1.2, 10)]
    handle = revolve([*dome, *bulge, (9, -1), (7, 6), (0, 6)], axis="x")
    for angle in range(0, 360, 60):
        handle -= cylinder(4.5, 46, axis="x", at=(-70, 0, 20)).rotate((angle, 0, 0))
    shaft = revolve([(0, 0), (3, 0), (3, 101), (0.8, 108), (0, 108)], axis="x")
    for angle in range(45, 360, 90):
        shaft -= cylinder(1.3, 12, axis="x", at=(106, 0, 2.4)).rotate((angle, 0, 0))
    return stretched(union(handle, shaft), (x, y, z))


def hammer(x: float, y: float, z: float) -> "Manifold":
    """A claw hammer, its handle to the right: the head's face up the page, its split claw down."""
    handle = body(
        [
            (-130, 0, 0, 12, 10), (-112, 2, 0, 13, 11), (-60, 9, 0, 13, 12), (0, 18, 0, 14, 13),
            (60, 27, 0, 15, 14), (130, 38, 0, 17.5, 15), (166, 44, 0, 18, 15),
        ],
        exponent=2.6, rounding=(0, 4),
    )
    face = [(0, -10), (12, -10), (11, 12), (10, 30), (14.5, 38), (16, 42), (16, 60), (14.5, 62), (0, 62)]
    eye = rounded_block((48, 30, 30), 4, at=(-138, 6, 0))
    claw = smooth_outline(
        [
            (-163, 20), (-165, 0), (-160, -22), (-146, -42), (-125, -56), (-96, -64), (-96, -62),
            (-115, -50), (-130, -36), (-138, -18), (-132, 0), (-130, 18),
        ]
    )
    # The wedge that parts the claw, drawn in the x-z plane and pushed through it along y.
    notch = outline([(-90, 0), (-140, 4.4), (-140, -4.4)])
    notch = plate(notch, 120).rotate((90, 0, 0)).translate((0, -50, 0))
    head = union(revolve(face, axis="y").translate((-152, 0, 0)), eye, plate(claw, 27) - notch)
    return stretched(union(handle, head), (x, y, z))


def spring_clamp(x: float, y: float, z: float) -> "Manifold":
    """Two levers on a pivot: the closed jaws to the left, the handles spread to the right."""
    jaw = curve([(-38.5, 3.2, 6), (-31, 8.5, 8.5), (-20, 14, 9.5), (-9, 14.5, 10), (2, 9, 13)], along=2)
    grip = [(2, 8, 17), (14, 14, 11), (30, 28, 9.5), (38, 35, 8)]
    lever = strip(jaw[:, :2], jaw[:, 2]) + strip(np.array(grip)[:, :2], np.array(grip)[:, 2])
    levers = fillet(lever + lever.mirror((0, 1)) + disc(12, (4, 0)), 1.5)
    pads = strip([(-36, -3), (-36, 3)], 9)
    place = (x / 84.6, y / 77.2)  # drawn for the medium clamp
    solids = [plate(levers.scale(place), 0.6 * z), plate(pads.scale(place), 0.75 * z)]
    return stretched(union(*solids, cylinder(0.09 * x, z, at=(0.05 * x, 0, 0))), (x, y, z))
