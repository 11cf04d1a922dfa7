"""The classes of shapes, and shapes of each with proportions drawn at random: more than a catalogue holds.

The paper names four classes; its published dataset has two more, cups and clamps, and objects of no class.

These are meant for training: a network that has seen two cans knows these two. Sizes are those of a household, evenly
drawn in their logarithms; no shape is drawn after any one object.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from millisight.core import check_known
from millisight.data import TriangleMesh
from millisight.meshes._household import HOUSEHOLD
from millisight.meshes._household.cans import TALLEST_STANDING
from millisight.meshes._odd_shapes import odd_shape
from millisight.meshes._shapes import (
    FLAT,
    body,
    curve,
    cylinder,
    disc,
    ellipse,
    fillet,
    log_uniform,
    mesh_of,
    outline,
    plate,
    revolve,
    rounded_block,
    shell,
    strip,
    tube,
    union,
)
from millisight.meshes._sketches.plain import box, can, standing_can

if TYPE_CHECKING:
    from manifold3d import Manifold

_LIES = 0.7  # of the cans that could stand as well
_FLATTEST, _THICKEST = 10.0, 110.0  # box [mm]
_NEARLY_A_CUBE = 0.25  # of the boxes
_FINE = 0.04  # off the surface at most [mm]


def random_shape(shape_class: str, rng: np.random.Generator, *, household: bool = False) -> TriangleMesh:
    """A shape of a class of `PUBLISHED_CLASSES`, or an "odd" one, as it would lie on a table; its middle at the origin.

    Parameters
    ----------
    shape_class : of `RANDOM_SHAPES`
    rng : draws the kind and the proportions; equal generators give equal shapes
    household : a thing as households have them: tins with beads, pans, pliers, jugs and many kinds more, rather than a
        plain shape; there are no odd ones

    Raises
    ------
    UnknownNameError
        No such class.
    """
    if household:
        check_known("class of household things", shape_class, HOUSEHOLD)
        kinds = HOUSEHOLD[shape_class]
        # Beads and grooves leave more facets than a hundredth of a wavelength is worth.
        solid = kinds[rng.integers(len(kinds))](rng).simplify(_FINE)
    else:
        check_known("class of random shapes", shape_class, RANDOM_SHAPES)
        solid = RANDOM_SHAPES[shape_class](rng)
    # Where two parts nearly coincide, a crumb may be left beside the whole, and another where that is simplified.
    while len(pieces := solid.simplify(1e-3).decompose()) > 1:
        solid = max(pieces, key=lambda piece: piece.volume())
    return mesh_of(solid)


def _can(rng: np.random.Generator) -> "Manifold":
    """A cylinder on its side or its base, with the lips of a tin can, or with plain ends."""
    width, height = log_uniform(rng, 45, 120), log_uniform(rng, 30, 260)
    lies = height > TALLEST_STANDING or rng.random() < _LIES
    if rng.random() < 0.5:
        return cylinder(width / 2, height, axis="x" if lies else "z")
    return can(height, width, width) if lies else standing_can(width, width, height)


def _box(rng: np.random.Generator) -> "Manifold":
    """A box on its largest face, now and then nearly a cube, its edges crisp or round."""
    if rng.random() < _NEARLY_A_CUBE:
        sizes = log_uniform(rng, 30, _THICKEST) * rng.uniform(0.85, 1.15, 3)
    else:
        sizes = np.array([log_uniform(rng, 30, 240), log_uniform(rng, 25, 170), log_uniform(rng, _FLATTEST, _THICKEST)])
    x, y, z = -np.sort(-sizes)
    return box(x, y, z) if rng.random() < 0.6 else rounded_block((x, y, z), rng.uniform(0.05, 0.25) * z)


def _ball(rng: np.random.Generator) -> "Manifold":
    """A ball, an egg or a fruit: a circle whose radius swells and tapers, turned about its axis."""
    radius = log_uniform(rng, 32, 140) / 2
    tapers, swells = (0.0, 0.0) if rng.random() < 0.4 else rng.uniform((-0.2, -0.05), (0.2, 0.12))
    angle = np.linspace(0, np.pi, 60)
    distance = radius * (1 + tapers * np.cos(angle) + swells * np.cos(2 * angle))
    profile = np.column_stack([distance * np.sin(angle), distance * np.cos(angle)])
    profile[[0, -1], 0] = 0
    return revolve(profile, axis="x")


def _tool(rng: np.random.Generator) -> "Manifold":
    """A grip along x, a shaft, and a head."""
    length = log_uniform(rng, 110, 340)
    grip = length * rng.uniform(0.35, 0.65)
    half_width = rng.uniform(5, 17)
    half_height = half_width * rng.uniform(0.35, 1)
    swelling = rng.uniform(0.7, 1.05, 5)
    stations = [
        (-x, 0, 0, half_width * s, half_height * s)
        for x, s in zip(np.linspace(grip, 0, len(swelling)), swelling, strict=True)
    ]
    handle = body(stations, exponent=rng.uniform(2, 3.5), rounding=(2, 1))
    reach = length - grip
    thickness = min(half_height, rng.uniform(2, 8))
    if rng.random() < 0.5:
        shaft = cylinder(thickness, reach + 4, axis="x", at=(reach / 2 - 2, 0, 0))
    else:
        width = max(rng.uniform(0.4, 1) * half_width, thickness)
        shaft = rounded_block((reach + 4, 2 * width, thickness), 0.3 * thickness, at=(reach / 2 - 2, 0, 0))
    head = _HEADS[rng.integers(len(_HEADS))](reach, thickness, rng)
    return union(handle, shaft, *head)


# A head ends where the shaft does, at x = reach [mm].


def _no_head(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    return []


def _blade(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    start, half_width = reach * (1 - rng.uniform(0.3, 0.9)), rng.uniform(6, 40)
    tip = half_width * rng.uniform(0.2, 1)
    corners = [(start, -half_width / 2), (reach, -tip), (reach, tip), (start, half_width / 2)]
    return [plate(fillet(outline(corners), 2), min(thickness, rng.uniform(1, 3)))]


def _bowl(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    half_length, half_width = rng.uniform(15, 40), rng.uniform(9, 28)
    area = outline(ellipse(half_length, half_width, at=(reach - half_length, 0), count=60))
    return [plate(area, rng.uniform(1.5, 8))]


def _block_across(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    deep, high = rng.uniform(14, 34, 2)
    wide = np.clip(rng.uniform(0.4, 0.9) * reach, 35, 130)
    return [rounded_block((deep, wide, high), 2, at=(reach - deep / 2, rng.uniform(-0.2, 0.2) * wide, 0))]


def _rings(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    """One about the axis, as a wrench's; or two beside it, as the bows of scissors."""
    rod, along, across = rng.uniform(3, 6), rng.uniform(14, 30), rng.uniform(12, 22)
    ring = np.pad(ellipse(along, across, at=(reach - along, 0), count=60), ((0, 0), (0, 1)))
    aside = [0.0] if rng.random() < 0.5 else [-across, across]
    return [tube(ring + np.array([0, offset, 0]), rod, normal=FLAT, closed=True) for offset in aside]


_HEADS = (_no_head, _blade, _bowl, _block_across, _rings)


def _cup(rng: np.random.Generator) -> "Manifold":
    """An open vessel with a wall and a floor, straight or wider at the top, with a handle now and then."""
    height, radius = log_uniform(rng, 45, 130), log_uniform(rng, 45, 110) / 2
    wall, foot = rng.uniform(1.5, 4), radius * rng.uniform(0.65, 1)
    corner = rng.uniform(0.05, 0.3) * foot
    side = [(0, wall / 2), (foot - corner, wall / 2), (foot, corner + wall / 2), (radius, height)]
    if rng.random() < 0.4:
        side.append((radius + rng.uniform(2, 6), height))
    cup = shell(np.array(side), wall)
    if rng.random() < 0.5:
        low, high, out = height * rng.uniform(0.12, 0.3), height * rng.uniform(0.65, 0.9), rng.uniform(18, 35)
        at = np.interp((low, high), (0, height), (foot, radius))
        path = curve([(at[0] - 1, 0, low), (at.mean() + out, 0, (low + high) / 2), (at[1] - 1, 0, high)])
        hollow = cylinder(min(foot, radius) - wall, 2 * height)
        cup = union(cup, tube(path, [(rng.uniform(2.5, 5), rng.uniform(4, 9))], normal=(0, 1, 0)) - hollow)
    return cup.rotate((0, 90, 0)) if rng.random() < 0.3 else cup


def _clamp(rng: np.random.Generator) -> "Manifold":
    """Two levers that cross at a pivot, jaws on one side and spread handles on the other; or a frame with a screw."""
    length, high = log_uniform(rng, 70, 240), rng.uniform(12, 40)
    if rng.random() < 0.7:
        jaw, grip, spread = 0.4 * length, 0.6 * length, length * rng.uniform(0.18, 0.38)
        wide = length * rng.uniform(0.07, 0.13)
        open_by, bulge = rng.uniform(0, 0.15) * length, length * rng.uniform(0.1, 0.2)
        line = np.array([(-jaw, open_by / 2 + wide / 3), (-jaw / 2, bulge), (0, wide / 2), (grip, spread)])
        lever = strip(curve(line, along=2), wide)
        levers = plate(lever + lever.mirror((0, 1)) + disc(wide, (0, 0)), 0.7 * high)
        return union(levers, cylinder(0.7 * wide, high))
    deep, bar = length * rng.uniform(0.35, 0.7), length * rng.uniform(0.08, 0.14)
    frame = plate(outline([(0, 0), (deep, 0), (deep, bar), (bar, bar), (bar, length - bar), (deep, length - bar),
                           (deep, length), (0, length)]), rng.uniform(8, high))  # fmt: skip
    thread, gap = rng.uniform(4, 8), length * rng.uniform(0.1, 0.6)
    x, end = deep - bar, length + rng.uniform(0.1, 0.4) * length
    screw = cylinder(thread, end - gap, axis="y", at=(x, (gap + end) / 2, 0))
    turn = cylinder(0.7 * thread, rng.uniform(30, 60), axis="x", at=(x, end - thread, 0))
    return union(frame, screw, turn)


def _other(rng: np.random.Generator) -> "Manifold":
    """What is of no class: a bottle, a dish, a ring, a bent bar, or several parts that meet at angles."""
    return _OTHERS[rng.integers(len(_OTHERS))](rng)


def _bottle(rng: np.random.Generator) -> "Manifold":
    """On its side: a body of oval section, shoulders, and a neck."""
    length, half = log_uniform(rng, 140, 300), rng.uniform(22, 50)
    flat, neck = rng.uniform(0.55, 1), rng.uniform(0.25, 0.5)
    shoulder = length * rng.uniform(0.55, 0.75)
    stations = [
        (-length / 2, 0, 0, half, half * flat), (shoulder - length / 2, 0, 0, half, half * flat),
        (shoulder - length / 2 + 0.14 * length, 0, 0, neck * half, neck * half * max(flat, 0.8)),
        (length / 2, 0, 0, neck * half, neck * half * max(flat, 0.8)),
    ]  # fmt: skip
    return body(stations, exponent=rng.uniform(2, 3.5), rounding=(6, 2))


def _dish(rng: np.random.Generator) -> "Manifold":
    """A plate, a bowl or a lid: a thin sheet, wider than high, either side up."""
    radius, height = log_uniform(rng, 45, 130), log_uniform(rng, 10, 70)
    floor = radius * rng.uniform(0.3, 0.75)
    bulge = (floor + (radius - floor) * rng.uniform(0.5, 0.9), height * rng.uniform(0.2, 0.6))
    dish = shell(curve([(0, 2), (floor / 2, 1.5), (floor, 2.5), bulge, (radius, height)], along=2), rng.uniform(1.5, 4))
    return dish.rotate((180, 0, 0)) if rng.random() < 0.3 else dish


def _ring(rng: np.random.Generator) -> "Manifold":
    """A rod bent to a closed ring, or to an arc."""
    turn = np.linspace(0, 2 * np.pi * rng.choice([1.0, rng.uniform(0.25, 0.6)]), 60)
    along, across = rng.uniform(30, 110), rng.uniform(30, 110)
    points = np.column_stack([along * np.cos(turn), across * np.sin(turn), np.zeros(len(turn))])
    closed = bool(turn[-1] > 6)
    return tube(points[:-1] if closed else points, rng.uniform(5, 18), normal=FLAT, closed=closed)


def _parts(rng: np.random.Generator) -> "Manifold":
    """Two to four blocks, rods or balls, each at the side of one before."""
    size = rng.uniform(25, 90, 3)
    whole = rounded_block((size[0], size[1], size[2]), 2)
    for _ in range(rng.integers(1, 4)):
        along, across, high = rng.uniform(20, 80, 3)
        lower, upper = np.array(whole.bounding_box()).reshape(2, 3)
        place = rng.uniform(lower, upper)
        axis = rng.integers(3)
        place[axis] = (lower, upper)[rng.integers(2)][axis]
        at = float(place[0]), float(place[1]), float(place[2])
        choice = rng.integers(3)
        if choice == 0:
            part = rounded_block((along, across, high), 2, at=at)
        elif choice == 1:
            part = cylinder(across / 2, along, axis="xyz"[axis], at=at)
        else:
            part = revolve([(0, -across / 2), (across / 2, 0), (0, across / 2)]).translate(at)
        whole = union(whole, part)
    return whole


_OTHERS = (_bottle, _dish, _ring, _parts)

NO_SHAPE_CLASS = "other"

ODD = "odd"
"""Shapes of no class as well, by rules of their own: angles, arms, steps, figures."""

RANDOM_SHAPES: dict[str, Callable[[np.random.Generator], "Manifold"]] = {
    "can": _can,
    "handle": _tool,
    "box": _box,
    "sphere": _ball,
    "cup": _cup,
    "clamp": _clamp,
    NO_SHAPE_CLASS: _other,
    ODD: odd_shape,
}
"""What draws each class, and odd shapes."""

PAPER_CLASSES: tuple[str, ...] = ("can", "handle", "box", "sphere")
"""That the paper's classifier tells apart."""

PUBLISHED_CLASSES: tuple[str, ...] = tuple(name for name in RANDOM_SHAPES if name != ODD)
"""Of the published dataset; "other" is its unnamed class."""

SHAPE_CLASSES: tuple[str, ...] = (*PAPER_CLASSES, NO_SHAPE_CLASS)
"""The paper's classes, and what is of none of them."""
