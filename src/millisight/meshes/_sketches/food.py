"""Sketches of what the YCB set calls food: tins, boxes, a squeeze bottle, and plastic fruit."""

from typing import TYPE_CHECKING

from millisight.meshes import (
    FLAT,
    body,
    curve,
    cylinder,
    fillet,
    outline,
    plate,
    revolve,
    sphere,
    stretched,
    stretched_parts,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

# An outline reads best with several points a line; the formatter would give each point its own.
# fmt: off


def chips_can(x: float, y: float, z: float) -> "dict[str, Manifold]":
    """A tube of foil-lined board on its side, a plastic lid over its right end, a metal base in its left."""
    tube = revolve([(0, -122), (34.5, -122), (34.5, -124), (36, -125), (36, 120), (0, 120)], axis="x")
    lid = revolve([(0, 113), (37.5, 113), (37.5, 125), (35, 125), (34, 123), (0, 123)], axis="x")
    return stretched_parts({"lid": lid, "can": tube}, (x, y, z))


def meat_can(x: float, y: float, z: float) -> "Manifold":
    """A tin of rounded rectangular section on its side, its axis along y, a lip around each end."""
    lip, rim, sunk = 1.5, 3.0, 2.5
    section = fillet(outline([(-x / 2, -z / 2), (x / 2, -z / 2), (x / 2, z / 2), (-x / 2, z / 2)]), 16)
    inside = section.offset(-lip, circular_segments=80)
    rims = plate(section, rim, z=(y - rim) / 2) + plate(section, rim, z=(rim - y) / 2)
    lids = plate(inside, sunk * 2, z=y / 2) + plate(inside, sunk * 2, z=-y / 2)
    return (plate(inside, y) + rims - lids).rotate((-90, 0, 0))


def mustard_bottle(x: float, y: float, z: float) -> "dict[str, Manifold]":
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
    return stretched_parts({"cap": revolve(cap, axis="x"), "bottle": bottle}, (x, y, z))


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


def strawberry(x: float, y: float, z: float) -> "Manifold":
    """On its side, the tip to the right; five leaves around the stem."""
    side = [(0, -25.4), (9, -25.4), (16.5, -22.5), (21.9, -9), (19.5, 5), (12.5, 18), (5.5, 26), (0, 27.5)]
    berry = revolve(curve(side, along=2), axis="x")
    leaf = sphere(7).scale((0.25, 1.5, 0.7)).rotate((0, 0, -17)).translate((-23.6, 10, 0))
    leaves = [leaf.rotate((72 * i + 18, 0, 0)) for i in range(5)]
    return stretched(union(berry, cylinder(2, 8, axis="x", at=(-24, 0, 0)), *leaves), (x, y, z))


def lemon(x: float, y: float, z: float) -> "Manifold":
    """On its side: a nipple at the right end, the stem's collar at the left."""
    side = [
        (0, -32), (3.5, -33), (6, -30.5), (13.5, -26), (23, -14), (27, 0), (23.5, 13), (14, 24.5), (7, 29),
        (3.5, 33), (0, 34),
    ]
    return stretched(revolve(curve(side, along=2), axis="x"), (x, y, z))


def pear(x: float, y: float, z: float) -> "Manifold":
    """On its side, the neck and the stem to the right, the blossom's hollow to the left."""
    side = [
        (0, -44), (5, -46.5), (16, -48.5), (27.5, -38), (33.1, -19), (30, 1), (21.5, 18), (15.5, 31), (11, 40),
        (5, 43.5), (0, 42.5),
    ]
    stem = tube(curve([(38, 0, 0), (46, 0.6, 0), (51, 2.2, 0)]), 1.8, normal=FLAT)
    return stretched(union(revolve(curve(side, along=2), axis="x"), stem), (x, y, z))
