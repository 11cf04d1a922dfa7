"""Sketches of shapes, puzzles and toys."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes import (
    FLAT,
    block,
    body,
    cylinder,
    fillet,
    outline,
    plate,
    revolve,
    rounded_block,
    smooth_outline,
    sphere,
    stretched,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

# An outline reads best with several points a line; the formatter would give each point its own.
# fmt: off


# ---- balls, dice, marbles, a chain -------------------------------------------------------------------------


def dice(x: float, y: float, z: float) -> "Manifold":
    """A cube with soft edges and hollow pips, six opposite one."""
    half = x / 2
    near, far = -0.5 * half, 0.5 * half
    spots = {
        1: [(0, 0)], 2: [(near, far), (far, near)], 3: [(near, near), (0, 0), (far, far)],
        4: [(near, near), (near, far), (far, near), (far, far)],
        5: [(near, near), (near, far), (far, near), (far, far), (0, 0)],
        6: [(u, v) for u in (near, far) for v in (near, 0, far)],
    }
    turns = {1: (0, 0, 0), 6: (180, 0, 0), 2: (90, 0, 0), 5: (-90, 0, 0), 3: (0, 90, 0), 4: (0, -90, 0)}
    pips = [sphere(0.16 * half, at=(u, v, half)).rotate(turns[n]) for n, at in spots.items() for u, v in at]
    return stretched(rounded_block((x, x, x), 0.18 * half) - union(*pips), (x, y, z))


def bag_of_marbles(x: float, y: float, z: float) -> "Manifold":
    """A heap of marbles, 16 mm each, close-packed and held together as by a net."""
    spacing, reach = 15.8, 30.0
    steps = np.arange(-4, 5)
    cells = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    places = cells[cells.sum(axis=1) % 2 == 0] * spacing / np.sqrt(2)
    near = places[np.linalg.norm(places, axis=1) < reach]
    heap = union(*(sphere(8, at=(u, v, w)) for u, v, w in near))
    return stretched(heap.rotate((20, 30, 10)), (x, y, z))


def chain(x: float, y: float, z: float) -> "Manifold":
    """Links of 6 mm wire, 36 mm by 25 mm, laid down in a spiral, each at right angles to the last."""
    wire, pitch = 3.0, 24.4
    bend = np.linspace(-np.pi / 2, np.pi / 2, 11)
    right = np.column_stack([5.5 + 9.5 * np.cos(bend), 9.5 * np.sin(bend), 0 * bend])
    path = np.concatenate([right, right * (-1, -1, 1)])
    # 18 degrees a side: finer ones would be wasted on so many links.
    link = tube(path, wire, normal=FLAT, closed=True, around=20)
    links, turn = [], 0.0
    while len(links) < 47:
        radius = 147 - 32 * turn / (2 * np.pi)
        at = (radius * np.cos(turn), radius * np.sin(turn), 0.0)
        upright = 90 * (len(links) % 2)
        links.append(link.rotate((upright, 0, 0)).rotate((0, 0, 90 + np.degrees(turn))).translate(at))
        turn += pitch / radius
    return stretched(union(*links), (x, y, z))


# ---- blocks and puzzles ------------------------------------------------------------------------------------


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


def block_pyramid(x: float, y: float, z: float) -> "Manifold":
    """Cubes stacked with gaps, 5 x 5 of them, then 4 x 4, and so on up to one, and a roof on that."""
    cube, pitch = 26.0, 29.0
    cubes = []
    for floor, across in enumerate((5, 4, 3, 2, 1)):
        line = (np.arange(across) - (across - 1) / 2) * pitch
        height = cube / 2 + floor * (cube - 0.1)  # each sunk a tenth of a millimetre into those below
        cubes += [block((cube, cube, cube), at=(u, v, height)) for u in line for v in line]
    roof = plate(outline([(-17, 0), (17, 0), (0, 36)]), cube).rotate((90, 0, 0)).translate((0, 0, 129.4))
    return stretched(union(*cubes, roof), (x, y, z))


def nine_hole_peg_test(x: float, y: float, z: float) -> "Manifold":
    """A wooden block on its back, nine holes up; a tray with a knob slides out of its side, to the right."""
    case = rounded_block((125, 124.5, 40), 1.5, at=(-13.5, 2.5, 0))
    holes = [cylinder(3.3, 40, at=(-13.5 + 33.4 * i, 2.5 + 33.4 * j, 20)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    dish = cylinder(9, 12, axis="y", at=(-59, -60, 0))
    tray, knob = block((80, 9, 27.5), at=(36, -55, 0)), sphere(4.7, at=(13, -61.5, 0))
    return stretched(case - union(*holes, dish) + tray + knob, (x, y, z))


# ---- a toy airplane ----------------------------------------------------------------------------------------


def _wheels(at: tuple[float, float, float], radius: float, width: float, leg: float) -> "Manifold":
    """Two wheels beside the middle plane, their centres at `at` and mirrored, and a leg up from their axle."""
    u, v, w = at
    half, rim, hub = width / 2, radius - 3, 0.3 * width
    side = [(0.5 * radius, hub), (0.6 * radius, half), (rim, half), (radius, half - 3)]
    tyre = revolve([(0, hub), *side, *((r, -h) for r, h in reversed(side)), (0, -hub)], axis="y")
    wheels = [tyre.translate((u, v, w)), tyre.mirror((0, 1, 0)).translate((u, -v, w))]
    axle = cylinder(4, 2 * v, axis="y", at=(u, 0, w))
    return union(*wheels, axle, rounded_block((14, 12, leg), 3, at=(u, 0, w + leg / 2 - 4)))


def airplane(x: float, y: float, z: float) -> "Manifold":
    """A biplane on its wheels, the propeller to the right."""
    fuselage = body(
        [
            (-127, 0, 10, 12, 8), (-110, 0, 11, 17, 14), (-60, 0, 13, 26, 22), (0, 0, 14, 33, 30), (60, 0, 14, 36, 35),
            (90, 0, 14, 36, 36), (105, 0, 14, 30, 30), (114, 0, 14, 18, 18),
        ],
        rounding=(6, 4),
    )
    wing = fillet(outline([(-8, -126), (91, -126), (91, 126), (-8, 126)]), 20)
    upper = plate(wing, 13).rotate((0, -4, 0)).translate((0, 0, 55))
    lower = plate(wing, 12).rotate((0, -2, 0)).translate((0, 0, -16))
    tail = plate(fillet(outline([(-132, -57), (-76, -57), (-76, 57), (-132, 57)]), 14), 9, z=10)
    fin = plate(smooth_outline([(-131, 12), (-128, 55), (-118, 82), (-104, 90), (-92, 82), (-84, 50), (-80, 12)]), 9)
    spinner = [(0, 110), (9, 110), (9, 118), (13, 121), (13, 127), (8, 132.5), (0, 132.5)]
    hub = revolve(spinner, axis="x").translate((0, 0, 14))
    blade = sphere(30).scale((0.09, 0.28, 1)).rotate((0, 0, 25)).translate((122, 0, 30))
    blades = union(blade, blade.rotate((180, 0, 0))).translate((0, 0, 14))
    cockpit = cylinder(19, 60, at=(-8, 0, 50)) ^ sphere(30, at=(-8, 0, 34))
    parts = [fuselage, upper, lower, tail, fin.rotate((90, 0, 0)), hub, blades, cockpit]
    wheels = [_wheels((65, 41, -62), 29, 30, 60), _wheels((-100, 17, -42), 20, 20, 48)]
    return stretched(union(*parts, *wheels), (x, y, z))


# ---- toy bricks --------------------------------------------------------------------------------------------

PITCH, FLOOR, STUD = 16.0, 19.2, 4.5  # of large toy bricks: from stud to stud, one brick's height, a stud's height


def brick(x: float, y: float, z: float) -> "Manifold":
    """A tower of bricks, studs up: as many studs and storeys as fit into the size; hollow from below."""
    return stretched(_brick(*_studs(x, y, z)), (x, y, z))


def arch(x: float, y: float, z: float) -> "Manifold":
    """A brick with a round arch through it along y."""
    long, wide, storeys = _studs(x, y, z)
    opening = min((long - 2) * PITCH / 2, storeys * FLOOR - 5)
    bridge = _brick(long, wide, storeys, hollow=False)
    return stretched(bridge - cylinder(opening, 2 * wide * PITCH, axis="y"), (x, y, z))


def roof_brick(x: float, y: float, z: float) -> "Manifold":
    """A brick sloping to the right from its left row of studs."""
    long, wide, storeys = _studs(x, y, z)
    far, top = long * PITCH / 2 - 0.1, storeys * FLOOR
    slope = outline([(PITCH - far, top), (far, 5), (far + 9, 5), (far + 9, top + 10), (PITCH - far, top + 10)])
    cut = plate(slope, 2 * wide * PITCH).rotate((90, 0, 0))
    return stretched(_brick(long, wide, storeys, hollow=False) - cut, (x, y, z))


def _studs(x: float, y: float, z: float) -> tuple[int, int, int]:
    return round(x / PITCH), round(y / PITCH), round((z - STUD) / FLOOR)


def _brick(long: int, wide: int, storeys: int, *, hollow: bool = True) -> "Manifold":
    """A brick with its foot at z = 0, a groove between its storeys."""
    side = (long * PITCH - 0.2, wide * PITCH - 0.2, storeys * FLOOR)
    solid = block(side, at=(0, 0, side[2] / 2))
    frame = block((2 * side[0], 2 * side[1], 0.6)) - block((side[0] - 0.8, side[1] - 0.8, 2))
    for floor in range(1, storeys):
        solid -= frame.translate((0, 0, floor * FLOOR))
    if hollow:
        solid -= block((side[0] - 3, side[1] - 3, side[2] - 2), at=(0, 0, side[2] / 2 - 2))
    at = [((i - (long - 1) / 2) * PITCH, (j - (wide - 1) / 2) * PITCH) for i in range(long) for j in range(wide)]
    return union(solid, *(cylinder(4.7, STUD + 1, at=(u, v, side[2] + (STUD - 1) / 2)) for u, v in at))
