"""Round things: fruit, balls for play, baubles, eggs."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.profiles import all_over, hanger, lobed, rolled, round_profile, stem
from millisight.meshes._shapes import FLAT, ellipse, log_uniform, revolve, sphere, tube, union

if TYPE_CHECKING:
    from manifold3d import Manifold


def _fruit(rng: np.random.Generator) -> "Manifold":
    """An apple, a pear or a plum: a dimple above and one below, and a stem now and then."""
    radius = log_uniform(rng, 32, 104) / 2
    half_height, taper = radius * rng.uniform(0.85, 1.05), rng.uniform(-0.18, 0.12)
    depth = radius * rng.uniform(0.08, 0.3)
    profile = round_profile(
        radius, half_height, taper=taper, top=-depth, bottom=rng.uniform(0, 0.15) * radius, width=rng.uniform(0.25, 0.4)
    )
    fruit = revolve(profile)
    if rng.random() < 0.75:
        length, thickness = depth + radius * rng.uniform(0.05, 0.3), radius * rng.uniform(0.04, 0.09)
        fruit = union(fruit, stem(half_height - depth, length, thickness, rng))
    return rolled(fruit, rng)


def _pumpkin(rng: np.random.Generator) -> "Manifold":
    """A ribbed fruit: grooves from pole to pole, and a thick stem."""
    radius, ribs = log_uniform(rng, 45, 132) / 2, int(rng.integers(6, 15))
    half_height, depth = radius * rng.uniform(0.6, 0.8), radius * rng.uniform(0.1, 0.25)
    profile = round_profile(radius, half_height, top=-depth, bottom=0.5 * depth, width=0.35)[3:-3]
    turn = np.linspace(0, 2 * np.pi, 16 * ribs, endpoint=False)
    around = 1 - rng.uniform(0.05, 0.18) * (1 - np.abs(np.sin(ribs * turn / 2))) ** 1.5
    fruit = lobed(profile, around)
    length, thickness = radius * rng.uniform(0.15, 0.45), radius * rng.uniform(0.08, 0.16)
    return union(fruit, stem(half_height - depth, length, thickness, rng))


def _onion(rng: np.random.Generator) -> "Manifold":
    """An onion, a garlic or a fig: a round body drawn out to a tip, on its base or its side."""
    radius = log_uniform(rng, 34, 88) / 2
    half_height, tip = radius * rng.uniform(0.75, 1.05), radius * rng.uniform(0.3, 0.8)
    root = -radius * rng.uniform(0, 0.12)
    profile = round_profile(
        radius, half_height, taper=rng.uniform(-0.15, 0), top=tip, bottom=root, width=rng.uniform(0.16, 0.35)
    )
    return rolled(revolve(profile), rng)


def _grooved_ball(rng: np.random.Generator) -> "Manifold":
    """A ball for play: narrow grooves from pole to pole, round its middle, or beside it."""
    radius = log_uniform(rng, 36, 129) / 2
    groove, count = radius * rng.uniform(0.025, 0.06), int(rng.integers(1, 5))
    ring = radius * np.pad(ellipse(1, 1), ((0, 0), (0, 1)))
    standing = tube(ring, groove, normal=FLAT, closed=True, around=12).rotate((90, 0, 0))
    cuts = [standing.rotate((0, 0, 180 * i / count)) for i in range(count)]
    heights = ([], [0.0], [-0.5, 0.5], [-0.6, 0.0, 0.6])[int(rng.integers(4))]
    for z in heights:
        circle = ring * np.sqrt(1 - z**2) + np.array([0, 0, z * radius])
        cuts.append(tube(circle, groove, normal=FLAT, closed=True, around=12))
    return (sphere(radius) - union(*cuts)).rotate(tuple(rng.uniform(0, 360, 3)))


def _dimpled_ball(rng: np.random.Generator) -> "Manifold":
    """A ball with round dimples all over, as for golf; they wind down from pole to pole."""
    radius, count = log_uniform(rng, 32, 104) / 2, int(rng.integers(30, 100))
    half_width = radius * np.sqrt(np.pi / count) * rng.uniform(0.6, 0.9)
    depth = half_width * rng.uniform(0.2, 0.4)
    cutter = (half_width**2 + depth**2) / (2 * depth)
    angle = np.linspace(0, np.arccos(1 - 2 * depth / cutter), 6)
    cap = np.column_stack([cutter * np.sin(angle), radius - depth + cutter * (1 - np.cos(angle))])
    dimple = revolve([*cap, (0, radius + depth)])
    cuts = [dimple.rotate((0, fall, turn)) for fall, turn in all_over(count)]
    return (sphere(radius) - union(*cuts)).rotate(tuple(rng.uniform(0, 360, 3)))


def _ornament(rng: np.random.Generator) -> "Manifold":
    """A bauble on its side: a ball or a drop, a cap, and a loop to hang it by."""
    radius = log_uniform(rng, 32, 98) / 2
    half_length, taper = radius * rng.uniform(0.9, 1.15), rng.choice([0.0, rng.uniform(-0.25, 0)])
    cap, high = radius * rng.uniform(0.16, 0.3), radius * rng.uniform(0.15, 0.3)
    loop = radius * rng.uniform(0.1, 0.18)
    ball = revolve(round_profile(radius, half_length, taper=taper), axis="x")
    return union(ball, *hanger(half_length, cap, high, loop))


def _egg(rng: np.random.Generator) -> "Manifold":
    """An egg or a lemon on its side: longer than wide, one end blunter, or both drawn out."""
    radius = log_uniform(rng, 31, 100) / 2
    half_length = radius * rng.uniform(1.15, 1.4)
    tip = rng.choice([0.0, 0.0, rng.uniform(0.05, 0.15)]) * radius
    half_length = min(half_length, 69 - tip)
    return revolve(round_profile(radius, half_length, taper=rng.uniform(-0.2, 0), top=tip, bottom=-tip), axis="x")


BALLS = (
    _fruit,
    _pumpkin,
    _onion,
    _grooved_ball,
    _dimpled_ball,
    _ornament,
    _egg,
)
"""What draws each kind."""
