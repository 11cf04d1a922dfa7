"""Clamps, flat on a table."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    body,
    curve,
    cylinder,
    disc,
    fillet,
    log_uniform,
    outline,
    plate,
    rounded_block,
    strip,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold


def _spring_clamp(rng: np.random.Generator) -> "Manifold":
    """Two bent levers about a pivot, with pads at the tips of the jaws and handles that spread."""
    length, high = log_uniform(rng, 72, 215), rng.uniform(12, 36)
    jaw, wide = length * rng.uniform(0.38, 0.5), length * rng.uniform(0.07, 0.12)
    grip, spread, gap = length - jaw, length * rng.uniform(0.12, 0.3), length * rng.choice([0.0, rng.uniform(0, 0.15)])
    bulge = gap / 2 + length * rng.uniform(0.1, 0.2)
    knots = [(-jaw, gap / 2 + 0.45 * wide, 0.7 * wide), (-0.5 * jaw, bulge, wide), (0, 0.5 * wide, 1.3 * wide),
             (0.5 * grip, 0.75 * spread, wide), (grip, spread, 0.8 * wide)]  # fmt: skip
    path = curve(knots, along=2)
    lever = strip(path[:, :2], path[:, 2])
    pads = disc(0.55 * wide, (-jaw, gap / 2 + 0.5 * wide))
    levers = plate(lever + lever.mirror((0, 1)), high * rng.uniform(0.5, 0.8))
    return union(levers, plate(pads + pads.mirror((0, 1)), high), cylinder(0.8 * wide, high))


def _screw_clamp(rng: np.random.Generator) -> "Manifold":
    """A frame like a C; through its end a screw with a pad, and a bar to turn it by."""
    length, high = log_uniform(rng, 62, 180), rng.uniform(9, 26)
    deep, bar, thread = length * rng.uniform((0.45, 0.1, 0.035), (0.8, 0.16, 0.06))
    inner = outline([(bar, bar), (2 * deep, bar), (2 * deep, length - bar), (bar, length - bar)])
    frame = fillet(outline([(0, 0), (deep, 0), (deep, length), (0, length)]), 0.8 * bar) - fillet(inner, 0.7 * bar)
    x, gap, end = deep - 0.7 * bar, bar + (length - 3 * bar) * rng.uniform(0.05, 0.8), length * rng.uniform(1.15, 1.3)
    return union(
        plate(frame, high),
        cylinder(thread, end - gap, axis="y", at=(x, (gap + end) / 2, 0)),
        cylinder(min(2 * thread, 0.7 * high), 0.05 * length, axis="y", at=(x, gap, 0)),
        cylinder(0.6 * thread, length * rng.uniform(0.25, 0.45), axis="x", at=(x, end - thread, 0)),
    )


def _bar_clamp(rng: np.random.Generator) -> "Manifold":
    """A long flat bar, an arm fixed at its end, an arm that slides, and in that a screw with a thick grip."""
    length, high = log_uniform(rng, 110, 230), rng.uniform(9, 20)
    reach, bar, arm = length * rng.uniform((0.25, 0.06, 0.07), (0.42, 0.1, 0.11))
    slide, grip = length * rng.uniform(0.4, 0.62), length * rng.uniform(0.22, 0.34)
    fixed = plate(strip([(arm / 2, 0), (arm / 2, reach)], [1.3 * arm, 0.8 * arm]), 1.4 * high)
    sliding = plate(strip([(slide, -0.4 * arm), (slide, reach)], [1.5 * arm, 1.2 * arm]), 1.5 * high)
    gap, y = arm + (slide - 2 * arm) * rng.uniform(0.05, 0.8), reach - 0.1 * arm
    screw = cylinder(0.25 * arm, slide + 0.1 * length - gap, axis="x", at=((slide + 0.1 * length + gap) / 2, y, 0))
    pad = cylinder(0.6 * arm, 0.03 * length, axis="x", at=(gap, y, 0))
    half = arm * rng.uniform(0.5, 0.8)
    stations = [(0, 0, 0, 0.8 * half, 0.8 * half), (0.6 * grip, 0, 0, half, half), (grip, 0, 0, 0.8 * half, 0.8 * half)]
    handle = body(stations, rounding=(2, 3)).translate((slide + 0.06 * length, y, 0))
    return union(rounded_block((length, bar, 0.5 * high), 1, at=(length / 2, 0, 0)), fixed, sliding, screw, pad, handle)


def _hand_screw(rng: np.random.Generator) -> "Manifold":
    """Two wooden jaws side by side, and through both two screws whose grips point opposite ways."""
    length = log_uniform(rng, 80, 190)
    wide, high, gap = length * rng.uniform((0.11, 0.1, 0.02), (0.18, 0.16, 0.22))
    corners = [(0, 0), (length, 0), (length, 0.35 * wide), (length * rng.uniform(0.55, 0.75), wide), (0, wide)]
    jaw = outline(corners).translate((0, gap / 2))
    parts = [plate(jaw + jaw.mirror((0, 1)), high)]
    grip, rod, half = length * rng.uniform(0.22, 0.32), 0.14 * wide + 1.2, high * rng.uniform(0.35, 0.5)
    for x, side in ((0.1, 1), (rng.uniform(0.4, 0.52), -1)):
        near, far = -gap / 2 - 1.25 * wide, gap / 2 + 1.4 * wide
        at = length * x, side * (near + far) / 2, 0
        parts.append(cylinder(rod, far - near, axis="y", at=at))
        parts.append(cylinder(half, grip, axis="y", at=(at[0], side * (far + grip / 2 - 1), 0)))
    return union(*parts)


CLAMPS = (
    _spring_clamp,
    _screw_clamp,
    _bar_clamp,
    _hand_screw,
)
"""What draws each kind."""
