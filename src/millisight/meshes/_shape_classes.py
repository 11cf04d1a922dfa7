"""The classes of shapes, and shapes of each with proportions drawn at random: more than a catalogue holds.

These are meant for training: a network that has seen two cans knows these two. Sizes are those of a household, evenly
drawn in their logarithms; no shape is drawn after any one object.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from millisight.core import check_known
from millisight.data import TriangleMesh
from millisight.meshes._shapes import (
    FLAT,
    body,
    cylinder,
    fillet,
    mesh_of,
    outline,
    plate,
    revolve,
    rounded_block,
    tube,
    union,
)
from millisight.meshes._sketches.plain import box, can, standing_can

if TYPE_CHECKING:
    from manifold3d import Manifold

_LIES = 0.7  # of the cans that could stand as well
_TALLEST_STANDING = 130.0  # can [mm]
_FLATTEST, _THICKEST = 10.0, 110.0  # box [mm]
_NEARLY_A_CUBE = 0.25  # of the boxes


def random_shape(shape_class: str, rng: np.random.Generator) -> TriangleMesh:
    """A shape of a class, "can", "handle", "box" or "sphere", as it would lie on a table; its middle at the origin.

    Raises
    ------
    UnknownNameError
        No such class.
    """
    check_known("class of random shapes", shape_class, RANDOM_SHAPES)
    solid = RANDOM_SHAPES[shape_class](rng)
    # Where two parts nearly coincide, a crumb may be left beside the whole.
    pieces = solid.simplify(1e-3).decompose()
    return mesh_of(max(pieces, key=lambda piece: piece.volume()) if len(pieces) > 1 else solid)


def _between(rng: np.random.Generator, lowest: float, highest: float) -> float:
    """Evenly drawn in its logarithm."""
    return float(np.exp(rng.uniform(np.log(lowest), np.log(highest))))


def _can(rng: np.random.Generator) -> "Manifold":
    """A cylinder on its side or its base, with the lips of a tin can, or with plain ends."""
    width, height = _between(rng, 45, 120), _between(rng, 30, 260)
    lies = height > _TALLEST_STANDING or rng.random() < _LIES
    if rng.random() < 0.5:
        return cylinder(width / 2, height, axis="x" if lies else "z")
    return can(height, width, width) if lies else standing_can(width, width, height)


def _box(rng: np.random.Generator) -> "Manifold":
    """A box on its largest face, now and then nearly a cube, its edges crisp or round."""
    if rng.random() < _NEARLY_A_CUBE:
        sizes = _between(rng, 30, _THICKEST) * rng.uniform(0.85, 1.15, 3)
    else:
        sizes = np.array([_between(rng, 30, 240), _between(rng, 25, 170), _between(rng, _FLATTEST, _THICKEST)])
    x, y, z = -np.sort(-sizes)
    return box(x, y, z) if rng.random() < 0.6 else rounded_block((x, y, z), rng.uniform(0.05, 0.25) * z)


def _ball(rng: np.random.Generator) -> "Manifold":
    """A ball, an egg or a fruit: a circle whose radius swells and tapers, turned about its axis."""
    radius = _between(rng, 32, 140) / 2
    tapers, swells = (0.0, 0.0) if rng.random() < 0.4 else rng.uniform((-0.2, -0.05), (0.2, 0.12))
    angle = np.linspace(0, np.pi, 60)
    distance = radius * (1 + tapers * np.cos(angle) + swells * np.cos(2 * angle))
    profile = np.column_stack([distance * np.sin(angle), distance * np.cos(angle)])
    profile[[0, -1], 0] = 0
    return revolve(profile, axis="x")


def _tool(rng: np.random.Generator) -> "Manifold":
    """A grip along x, a shaft, and a head."""
    length = _between(rng, 110, 340)
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
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ellipse = np.column_stack([reach - half_length + half_length * np.cos(turn), half_width * np.sin(turn)])
    return [plate(outline(ellipse), rng.uniform(1.5, 8))]


def _block_across(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    deep, high = rng.uniform(14, 34, 2)
    wide = np.clip(rng.uniform(0.4, 0.9) * reach, 35, 130)
    return [rounded_block((deep, wide, high), 2, at=(reach - deep / 2, rng.uniform(-0.2, 0.2) * wide, 0))]


def _rings(reach: float, thickness: float, rng: np.random.Generator) -> "list[Manifold]":
    """One about the axis, as a wrench's; or two beside it, as the bows of scissors."""
    rod, along, across = rng.uniform(3, 6), rng.uniform(14, 30), rng.uniform(12, 22)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.column_stack([reach - along + along * np.cos(turn), across * np.sin(turn), np.zeros(len(turn))])
    aside = [0.0] if rng.random() < 0.5 else [-across, across]
    return [tube(ring + np.array([0, offset, 0]), rod, normal=FLAT, closed=True) for offset in aside]


_HEADS = (_no_head, _blade, _bowl, _block_across, _rings)

RANDOM_SHAPES: dict[str, Callable[[np.random.Generator], "Manifold"]] = {
    "can": _can,
    "handle": _tool,
    "box": _box,
    "sphere": _ball,
}
"""What draws each class."""

SHAPE_CLASSES: tuple[str, ...] = (*RANDOM_SHAPES, "other")
"""The paper's classes, and what is of none of them."""
