"""Profiles and parts that several kinds of things share."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import FLAT, UPRIGHT, curve, cylinder, ellipse, loft, sides, tube

if TYPE_CHECKING:
    from manifold3d import Manifold


def round_profile(
    radius: float, half_height: float, *, taper: float = 0.0, top: float = 0.0, bottom: float = 0.0, width: float = 0.3
) -> np.ndarray:
    """(90, 2) radii and heights from the upper pole to the lower; `top` and `bottom` lift the poles' surroundings."""
    share = np.linspace(0, 1, 90)
    angle = np.pi * (share - 0.7 * np.sin(2 * np.pi * share) / (2 * np.pi))  # closer at the poles
    lift = np.where(angle < np.pi / 2, top, bottom) * np.exp(-((np.sin(angle) / width) ** 2))
    across = radius * np.sin(angle) * (1 + taper * np.cos(angle))
    profile = np.column_stack([across, half_height * np.cos(angle) + lift])
    profile[[0, -1], 0] = 0
    return profile


def coarse_ball(radius: float) -> "Manifold":
    """A ball about the origin of fewer facets than `sphere` has, for parts to be cut from it or set on it."""
    from manifold3d import Manifold

    return Manifold.sphere(radius, min(sides(radius), 128))


def lobed(
    profile: np.ndarray, around: np.ndarray, *, lift: float | np.ndarray = 0.0, closed: bool = False
) -> "Manifold":
    """A (K, 2) profile turned about z, its radii times `around`, (N,) or (K, N), its heights lifted likewise."""
    across = profile[:, :1] * around
    turn = np.linspace(0, 2 * np.pi, across.shape[1], endpoint=False)
    height = np.broadcast_to(profile[:, 1:] + lift, across.shape)
    return loft(np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=2), closed=closed)


def on_ball(path: np.ndarray, half_width: float, *, closed: bool = False, around: int = 8) -> "Manifold":
    """A thin rod along an (N, 3) path on a ball about the origin."""
    ahead = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    if not closed:
        ahead[0], ahead[-1] = path[1] - path[0], path[-1] - path[-2]
    up = path / np.linalg.norm(path, axis=1, keepdims=True)
    aside = np.cross(up, ahead)
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)[:, None]
    rings = path[:, None] + half_width * (np.cos(turn) * aside[:, None] + np.sin(turn) * up[:, None])
    return loft(rings, closed=closed)


def all_over(count: int) -> list[tuple[float, float]]:
    """How far from the upper pole, and how far round [degrees], points lie that wind down a ball evenly."""
    falls = np.degrees(np.arccos(1 - (2 * np.arange(count) + 1) / count))
    turns = 180 * (3 - np.sqrt(5)) * np.arange(count)
    return list(zip(falls, turns, strict=True))


def stem(start: float, length: float, thickness: float, rng: np.random.Generator) -> "Manifold":
    """A stalk up from a height, leaning a little."""
    lean = rng.uniform(0, 0.4) * length
    path = curve([(0, 0, start - thickness), (0, 0, start + 0.4 * length), (lean, 0, start + length)])
    return tube(path, thickness * np.linspace(1, rng.uniform(0.8, 1.3), len(path)), normal=UPRIGHT)


def hanger(half_length: float, cap: float, high: float, loop: float) -> "tuple[Manifold, Manifold]":
    """The cap of a bauble along x, `cap` its radius, and the loop to hang it by."""
    top = half_length + 0.6 * high
    ring = np.pad(ellipse(loop, loop, at=(top + 0.8 * loop, 0)), ((0, 0), (0, 1)))
    return (
        cylinder(cap, high, axis="x", at=(top - high / 2, 0, 0)),
        tube(ring, max(0.2 * loop, 0.8), normal=FLAT, closed=True),
    )


def rolled(solid: "Manifold", rng: np.random.Generator) -> "Manifold":
    """Half of them upright, half tipped over."""
    return solid.rotate((0, rng.uniform(0, 110) * int(rng.integers(2)), 0))


def anyhow(solid: "Manifold", rng: np.random.Generator) -> "Manifold":
    """The solid turned any way."""
    return solid.rotate(tuple(rng.uniform(0, 360, 3)))


def as_wide(solid: "Manifold", width: float, *, highest: float = 128.0) -> "Manifold":
    """The solid scaled to be so wide [mm], less where it were too high."""
    low, high = np.reshape(solid.bounding_box(), (2, 3))
    size = high - low
    return solid.scale([min(width / size[:2].max(), highest / size[2])] * 3)
