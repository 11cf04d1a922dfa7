"""Sketches of plain shapes: what a size alone draws."""

from typing import TYPE_CHECKING

from millisight.meshes import block, revolve, sphere, stretched

if TYPE_CHECKING:
    from manifold3d import Manifold


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


def box(x: float, y: float, z: float) -> "Manifold":
    """A box with crisp edges."""
    return block((x, y, z))


def ball(x: float, y: float, z: float) -> "Manifold":
    """A ball, or a fruit that nearly is one."""
    return stretched(sphere((x + y + z) / 6), (x, y, z))
