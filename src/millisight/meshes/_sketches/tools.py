"""Sketches of workshop tools."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes import (
    FLAT,
    body,
    curve,
    cylinder,
    disc,
    fillet,
    outline,
    plate,
    revolve,
    rounded_block,
    smooth_outline,
    stretched,
    stretched_parts,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

# An outline reads best with several points a line; the formatter would give each point its own.
# fmt: off


def power_drill(x: float, y: float, z: float) -> "dict[str, Manifold]":
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
    rest = union(housing, grip, trigger, foot, battery)
    return stretched_parts({"chuck": jaws, "housing": rest}, (x, y, z))


def scissors(x: float, y: float, z: float) -> "dict[str, Manifold]":
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
    parts = {"blades": union(plate(fillet(blades, 1), 4.5), pivot), "handles": union(plate(shanks, 10), *rods)}
    return stretched_parts(parts, (x, y, z))


def padlock(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A body with a bumper at its foot, to the right, and a closed shackle of 8 mm rod to the left."""
    case = rounded_block((41, 50, 27), 3, at=(14.5, 0, 0))
    bumper = rounded_block((10, 53.9, 28.8), 2, at=(30, 0, 0))
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 40)
    bow = np.column_stack([17 * np.cos(turn) - 14, 17 * np.sin(turn), 0 * turn])
    shackle = tube(np.array([(5, 17, 0), *bow, (5, -17, 0)]), 4.0, normal=FLAT)
    return stretched_parts({"shackle": shackle, "bumper": bumper, "case": case}, (x, y, z))


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


def _screwdriver_handle() -> "Manifold":
    """A fluted handle, from x = -108 to 6."""
    bulge = curve([(15, -99), (17, -88), (17, -62), (14.5, -42), (11.5, -25), (13.5, -11), (13, -5)], along=2)
    dome = [(16 * np.sin(a), -93.5 - 14.5 * np.cos(a)) for a in np.linspace(0, 1.2, 10)]
    handle = revolve([*dome, *bulge, (9, -1), (7, 6), (0, 6)], axis="x")
    for angle in range(0, 360, 60):
        handle -= cylinder(4.5, 46, axis="x", at=(-70, 0, 20)).rotate((angle, 0, 0))
    return handle


def phillips_screwdriver(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A fluted handle to the left, a round shaft, a cross-shaped point."""
    shaft = revolve([(0, 0), (3, 0), (3, 101), (0.8, 108), (0, 108)], axis="x")
    for angle in range(45, 360, 90):
        shaft -= cylinder(1.3, 12, axis="x", at=(106, 0, 2.4)).rotate((angle, 0, 0))
    return stretched_parts({"shaft": shaft, "handle": _screwdriver_handle()}, (x, y, z))


def flat_screwdriver(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A fluted handle to the left, a round shaft, a point flared and flattened."""
    side = [(88, 1), (93, 3), (99, 4), (108, 3.6), (108, -3.6), (99, -4), (93, -3), (88, -1)]
    edge = [(86, 3), (93, 3), (108, 0.6), (108, -0.6), (93, -3), (86, -3)]
    point = plate(outline(side), 8) ^ plate(outline(edge), 10).rotate((90, 0, 0))
    shaft = union(cylinder(3, 91, axis="x", at=(45.5, 0, 0)), point)
    return stretched_parts({"shaft": shaft, "handle": _screwdriver_handle()}, (x, y, z))


def hammer(x: float, y: float, z: float) -> "dict[str, Manifold]":
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
    return stretched_parts({"head": head, "handle": handle}, (x, y, z))


def spring_clamp(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """Two levers on a pivot: the closed jaws to the left, the handles spread to the right."""
    jaw = curve([(-38.5, 3.2, 6), (-31, 8.5, 8.5), (-20, 14, 9.5), (-9, 14.5, 10), (2, 9, 13)], along=2)
    grip = [(2, 8, 17), (14, 14, 11), (30, 28, 9.5), (38, 35, 8)]
    lever = strip(jaw[:, :2], jaw[:, 2]) + strip(np.array(grip)[:, :2], np.array(grip)[:, 2])
    levers = fillet(lever + lever.mirror((0, 1)) + disc(12, (4, 0)), 1.5)
    pads = strip([(-36, -3), (-36, 3)], 9)
    place = (x / 84.6, y / 77.2)  # drawn for the medium clamp
    parts = {
        "pivot": cylinder(0.09 * x, z, at=(0.05 * x, 0, 0)),
        "pads": plate(pads.scale(place), 0.75 * z),
        "levers": plate(levers.scale(place), 0.6 * z),
    }
    return stretched_parts(parts, (x, y, z))
