"""Sketches of kitchen ware: bottles, vessels, cutlery."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes import (
    bent,
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
    stretched,
    stretched_parts,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

# An outline reads best with several points a line; the formatter would give each point its own.
# fmt: off


# ---- bottles -----------------------------------------------------------------------------------------------


def bleach_bottle(x: float, y: float, z: float) -> "dict[str, Manifold]":
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
    return stretched_parts({"cap": cap, "bottle": bottle}, (x, y, z))


def windex_bottle(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A spray bottle on its broad side, the base to the right: waisted, on its neck a head with a trigger."""
    bottle = body(
        [
            (-78, 0, 0, 13, 13), (-66, 0, 0, 14, 14), (-56, 0, 0, 24, 22), (-38, 0, 0, 43, 34), (-15, 0, 0, 50, 39),
            (12, 0, 0, 47, 37), (40, 0, 0, 43, 34), (75, 0, 0, 48, 38), (110, 0, 0, 52.5, 40), (135, 0, 0, 52, 39.5),
        ],
        exponent=2.6, rounding=(0, 7),
    )
    side = [
        (-84, -15), (-100, -19), (-120, -27), (-134, -28), (-134, 20), (-132, 44), (-118, 46), (-114, 36),
        (-106, 20), (-84, 15),
    ]
    trigger = strip(curve([(-108, 22, 0), (-98, 36, 0), (-84, 43, 0), (-66, 44, 0)])[:, :2], 7)
    head = union(
        cylinder(18, 20, axis="x", at=(-76, 0, 0)), plate(fillet(outline(side), 3), 24), plate(trigger, 13),
        cylinder(7, 6, axis="y", at=(-125, 47, 0)),
    )
    return stretched_parts({"head": head, "bottle": bottle}, (x, y, z))


# ---- vessels: open, with walls -----------------------------------------------------------------------------


def pitcher(x: float, y: float, z: float) -> "Manifold":
    """A jug on its side, its mouth to the right, the handle up the page, the spout down; wall 3 mm."""
    wall = [(0, 2), (40, 2), (50, 3), (53, 9), (55.5, 60), (57.5, 130), (59.5, 233.5)]
    mouth = disc(60.5) + strip([(0, -52), (0, -66)], [40, 16]) + strip([(0, -58), (0, -70)], [20, 8])
    hollow = plate(mouth.offset(-3), 60, z=230) + cylinder(57, 70, at=(0, 0, 225))
    jug = shell(wall, 3) + plate(mouth, 38, z=216)
    path = curve([(0, 57, 205), (0, 82, 209), (0, 100, 196), (0, 105, 160), (0, 98, 100), (0, 80, 66), (0, 55, 62)])
    handle = tube(path, [(5, 10)], normal=(1, 0, 0)) - cylinder(57, 250, at=(0, 0, 120))
    # Turned over: the jug's up becomes x.
    return stretched((jug - hollow + handle).rotate((0, 90, 0)), (x, y, z))


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
    # Down the foot, and back.
    wall: list[tuple[float, float]] = [(0, 7), (inner - 4, 7), (inner - 4, 1), (inner - 4, 7), (inner, 8)]
    wall += [(inner + 0.5, z - 3), (outer - 1, z - 3), (outer - 1, z - 1), (inner, z - 1)]
    return stretched(shell(wall, 2), (x, y, z))


def dinner_plate(x: float, y: float, z: float) -> "Manifold":
    """A sheet 2 mm thick: a flat middle and a sloping, rolled rim."""
    wall = [(0, 2), (40, 1.8), (75, 1.2), (86, 1.5), (95, 7), (102, 15), (110, 18.5), (122, 22), (128, 22)]
    return stretched(shell(curve(wall, along=2), 2), (x, y, z))


def skillet(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A frying pan, open side up, wall 3 mm; the handle, to the right, rises a little and ends in an eye."""
    wall = [(0, 1.5), (60, 1.5), (97, 1.5), (108, 4), (118, 18), (126, 33), (133.5, 43)]
    handle = body(
        [
            (122, 0, 33, 14, 4), (145, 0, 38, 10, 6), (190, 0, 45, 11, 7), (260, 0, 50, 13, 8),
            (310, 0, 51, 14, 8), (325, 0, 51, 13, 8),
        ],
        exponent=2.5, rounding=(0, 8),
    )
    handle -= cylinder(5, 60, at=(312, 0, 51))
    return stretched_parts({"pan": shell(curve(wall, along=2), 3), "handle": handle}, (x, y, z))


def skillet_lid(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A dome of glass 4 mm thick in a rolled steel rim, a knob on top."""
    upper = curve([(0, 49), (30, 47.5), (62, 42), (92, 31), (114, 18), (129, 6)], along=2, step=8)
    dome = revolve([*upper, *(upper - (0, 4))[::-1]])
    rim = revolve([(123, 2), (122, 6), (126, 9), (131, 8), (134, 5), (133, 1), (129, 0), (126, 0)])
    knob = revolve([(0, 42), (11, 42), (10, 52), (15, 60), (21, 64), (22, 68), (20, 73), (13, 76), (0, 76)])
    return stretched_parts({"knob": knob, "rim": rim, "glass": dome}, (x, y, z))


# ---- cutlery, and what else is in the drawer ---------------------------------------------------------------


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


def fork(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """Four tines, curved up; the handle to the left."""
    head = _mirrored([(-4, 5), (12, 4.5), (28, 4), (36, 8), (46, 12), (58, 12.9), (75, 12.6), (99, 11.8)])
    for i in (-1, 0, 1):
        head -= strip([(52 - 2 * abs(i), 6.6 * i), (105, 6.3 * i)], [2.6, 4.2])
    line = curve([(-4, 0), (30, -1), (45, -4), (60, -5), (75, -2.5), (99, 5)], along=2).T
    head = bent(plate(fillet(head, 0.9), 2), lambda u, v: np.interp(u, *line) + 0.012 * v**2)
    return stretched_parts({"head": head, "handle": _cutlery_handle()}, (x, y, z))


def spoon(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """An oval bowl, its hollow up; the handle to the left."""
    head = _mirrored([(-4, 5), (12, 4.2), (28, 3.6), (40, 5.5), (50, 13), (64, 19), (78, 18.5), (90, 11.5), (96, 0.5)])
    line = curve([(-4, 0), (25, 2), (45, 3), (70, 6), (97, 11.5)], along=2).T

    def lift(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.interp(u, *line) - 9 * np.clip(1 - ((u - 70) / 27) ** 2 - (v / 20) ** 2, 0, 1)

    return stretched_parts({"head": bent(plate(head, 2), lift), "handle": _cutlery_handle()}, (x, y, z))


def knife(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A table knife: a blade 2.4 mm thick with a rounded point; the handle to the left."""
    point = curve(
        [(60, 9.4), (92, 8.6), (108, 5.5), (115.5, 0), (112, -4), (95, -8), (60, -9.6)], along=2, step=1
    )
    blade = outline([(-10, 4), (4, 4.5), (7, 9.3), *point, (10, -9.6), (7, -5), (-10, -4)])
    return stretched_parts({"blade": plate(fillet(blade, 1.1), 2.4), "handle": _cutlery_handle()}, (x, y, z))


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


def sponge(x: float, y: float, z: float) -> "Manifold":
    """A box with soft edges."""
    return rounded_block((x, y, z), 3)
