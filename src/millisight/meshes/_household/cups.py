"""Open vessels, upright or lying on their side."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    UPRIGHT,
    curve,
    cylinder,
    ellipse,
    loft,
    log_uniform,
    revolve,
    shell,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

_LAID = 0.25  # of the cups


def _stood_or_laid(cup: "Manifold", foot: float, rim: float, height: float, rng: np.random.Generator) -> "Manifold":
    """The cup as it is, or lying on its foot's edge and its rim's, a handle along x turned to the side."""
    return laid(cup, foot, rim, height) if rng.random() < _LAID else cup


def laid(cup: "Manifold", foot: float, rim: float, height: float) -> "Manifold":
    """The cup lying on its foot's edge and its rim's, a handle along x turned to the side."""
    return cup.rotate((0, 0, 90)).rotate((0, 90 - np.degrees(np.arctan2(rim - foot, height)), 0))


def vessel(reach: np.ndarray, turn: np.ndarray, heights: np.ndarray, wall: float) -> "Manifold":
    """An open vessel of radii (K, N) at angles `turn` (N,) and heights (K,)."""
    levels = np.broadcast_to(heights[:, None], reach.shape)
    outer, inner = (loft(np.stack([r * np.cos(turn), r * np.sin(turn), levels], 2)) for r in (reach, reach - wall))
    return outer - inner.translate((0, 0, wall))


def spout(out: float, turn: np.ndarray, share: np.ndarray, starts: float, narrow: float) -> np.ndarray:
    """(K, N) by how much a spout at -x widens a vessel's radii, at shares (K,) of its height from `starts` on."""
    rise = np.clip((share - starts) / (1 - starts), 0, 1) ** 1.5
    return out * rise[:, None] * np.clip(-np.cos(turn), 0, 1) ** narrow


def _handle_of(line: np.ndarray, rng: np.random.Generator) -> "Manifold":
    """A handle at +x of the vessel with this wall; none of it inside."""
    height = line[:, 1].max()
    low, high, out = height * rng.uniform(0.15, 0.3), height * rng.uniform(0.68, 0.88), np.clip(0.3 * height, 15, 34)
    lower, upper = np.interp((low, high), line[:, 1], line[:, 0])
    far = max(lower, upper) + out * rng.uniform(0.8, 1.15)
    middle = (low + high) / 2 + rng.uniform(-0.05, 0.1) * height
    knots = [(lower - 3, low), (lower + 0.65 * out, low), (far, middle), (upper + 0.65 * out, high), (upper - 3, high)]
    path = curve([(x, 0, z) for x, z in knots])
    section = [(max(height * rng.uniform(0.03, 0.05), 1.8), max(height * rng.uniform(0.04, 0.09), 2.5))]
    return tube(path, section, normal=UPRIGHT) - revolve([*line, (0, line[-1, 1])])


def _mug(rng: np.random.Generator) -> "Manifold":
    """A bellied mug with a handle."""
    height, rim = log_uniform(rng, 50, 126), log_uniform(rng, 50, 112) / 2
    belly, foot = min(rim * rng.uniform(1.02, 1.3), 60), rim * rng.uniform(0.65, 0.9)
    wall = rng.uniform(1.8, 4.5)
    side = curve(
        [(foot, wall / 2), (belly, height * rng.uniform(0.3, 0.55)), (rim, 0.92 * height), (rim, height)], along=2
    )
    line = np.concatenate([[(0, wall / 2)], side])
    return _stood_or_laid(union(shell(line, wall), _handle_of(line, rng)), belly, belly, height, rng)


def _tumbler(rng: np.random.Generator) -> "Manifold":
    """A straight drinking glass, its base thin or thick."""
    height, rim = log_uniform(rng, 60, 127), log_uniform(rng, 45, 100) / 2
    foot, wall, base = rim * rng.uniform(0.8, 1), rng.uniform(1.2, 4), rng.uniform(2, 14)
    corner = rng.uniform(0.02, 0.15) * foot
    glass = shell([(0, wall / 2), (foot - corner, wall / 2), (foot, corner + wall / 2), (rim, height)], wall)
    glass = union(glass, cylinder(foot - corner, base, at=(0, 0, base / 2 + 0.1)))
    return _stood_or_laid(glass, foot, rim, height, rng)


def _beaker(rng: np.random.Generator) -> "Manifold":
    """A cone, wider above, with a rolled rim and a raised floor: a paper or plastic cup."""
    height, rim = log_uniform(rng, 55, 125), log_uniform(rng, 50, 112) / 2
    foot, wall, roll = rim * rng.uniform(0.58, 0.85), rng.uniform(0.8, 2), rng.uniform(1.2, 3.5)
    raised = rng.uniform(0.03, 0.12) * height
    floor = np.interp(raised, (0, height), (foot, rim))
    ring = ellipse(roll, roll, at=(rim + roll / 2, height))
    cup = union(shell([(foot, 0), (rim, height)], wall), shell([(0, raised), (floor, raised)], wall), revolve(ring))
    return _stood_or_laid(cup, foot, rim, height, rng)


def _goblet(rng: np.random.Generator) -> "Manifold":
    """A bowl on a stem on a flat foot."""
    height, rim = log_uniform(rng, 75, 127), log_uniform(rng, 42, 110) / 2
    top, stem, wall = height * rng.uniform(0.25, 0.55), rng.uniform(3, 7), rng.uniform(1.5, 3.5)
    foot, belly = max(rim * rng.uniform(0.6, 1), 4 * stem), min(rim * rng.uniform(0.9, 1.2), 58)
    bowl = [(0, top), (0.45 * belly, top + 0.06 * height), (belly, top + rng.uniform(0.4, 0.6) * (height - top))]
    bowl = shell(curve([*bowl, (rim, height)], along=2), wall)
    side = curve([(foot, 2), (2 * stem, 0.1 * top + 3), (stem, 0.5 * top), (1.6 * stem, top)], along=2)
    return _stood_or_laid(union(bowl, revolve([(0, 0), (foot, 0), *side, (0, top + wall / 2)])), foot, rim, height, rng)


def _jug(rng: np.random.Generator) -> "Manifold":
    """A measuring jug: a spout pulled out of the rim, a handle across from it."""
    height, rim = log_uniform(rng, 60, 128), log_uniform(rng, 60, 115) / 2
    foot, wall, out = rim * rng.uniform(0.7, 1), rng.uniform(2.5, 4.5), rim * rng.uniform(0.2, 0.45)
    turn, share = np.linspace(0, 2 * np.pi, 160, endpoint=False), np.linspace(0, 1, 40)
    narrow, starts = rng.uniform(6, 20), rng.uniform(0.4, 0.75)
    reach = (foot + (rim - foot) * share)[:, None] + spout(out, turn, share, starts, narrow)
    line = np.array([(0, wall / 2), (foot - wall / 2, wall / 2), (rim - wall / 2, height)])
    jug = union(vessel(reach, turn, height * share, wall), _handle_of(line, rng))
    return _stood_or_laid(jug, foot, rim, height, rng)


def _flower_pot(rng: np.random.Generator) -> "Manifold":
    """A cone with a collar about its rim, and a hole in its floor."""
    height, rim = log_uniform(rng, 45, 126), log_uniform(rng, 50, 116) / 2
    foot, wall = rim * rng.uniform(0.55, 0.75), rng.uniform(2, 5)
    collar, step = height * rng.uniform(0.15, 0.32), wall * rng.uniform(0.6, 1)
    below = rim - step - 0.03 * rim
    side = [(foot, wall / 2), (below, height - collar), (below + step, height - collar), (rim, height)]
    pot = shell([(0, wall / 2), *side], wall) - cylinder(foot * rng.uniform(0.12, 0.3), 4 * wall)
    return _stood_or_laid(pot, foot, rim, height, rng)


def _footed_bowl(rng: np.random.Generator) -> "Manifold":
    """A tea bowl: a round wall on a ring."""
    rim = log_uniform(rng, 60, 118) / 2
    height, ring = min(max(2 * rim * rng.uniform(0.45, 0.8), 41), 100), rng.uniform(4, 12)
    wall, foot = rng.uniform(2, 4.5), rim * rng.uniform(0.4, 0.6)
    side = [(0.9 * foot, ring + 1), (rim * rng.uniform(0.85, 0.98), ring + rng.uniform(0.35, 0.55) * (height - ring))]
    bowl = shell(curve([(0, ring), *side, (rim, height)], along=2), wall)
    stand = shell([(foot, 0), (foot * rng.uniform(0.85, 1), ring + wall)], wall)
    return _stood_or_laid(union(bowl, stand), foot, rim, height, rng)


CUPS = (
    _mug,
    _tumbler,
    _beaker,
    _goblet,
    _jug,
    _flower_pot,
    _footed_bowl,
)
"""What draws each kind."""
