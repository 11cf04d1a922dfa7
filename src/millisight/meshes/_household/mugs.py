"""More open vessels, upright, lying on their side, or now and then upside down."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.cups import laid, spout, vessel
from millisight.meshes._shapes import (
    curve,
    cylinder,
    disc,
    ellipse,
    fillet,
    log_uniform,
    outline,
    plate,
    revolve,
    shell,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

_LAID, _TURNED = 0.22, 0.04  # of the cups: on their side, upside down
_HIGHEST = 118.0  # [mm]


def _posed(cup: "Manifold", foot: float, rim: float, height: float, rng: np.random.Generator) -> "Manifold":
    """The cup as it is, lying on its foot's edge and its rim's, a handle at +x turned to the side, or on its rim."""
    draw = rng.random()
    if draw < _TURNED:
        return cup.rotate((180, 0, 0))
    if draw > _TURNED + _LAID or 2 * max(foot, rim) > _HIGHEST:
        return cup
    return laid(cup, foot, rim, height)


def _handle_area(rng: np.random.Generator, tall: float, out: float, thick: float) -> "CrossSection":
    """A handle seen from the side, from x = 0 outwards, about z = 0: a ring, a square, an ear, a bar or a disc."""
    kind, half = rng.integers(5), tall / 2
    if kind == 0:
        round_one = outline(ellipse(out / 1.6, half, at=(0.6 * out / 1.6, 0)))
        return round_one - round_one.offset(-thick)
    if kind == 1:
        area = outline([(-thick, -half), (out, -half), (out, half), (-thick, half)])
        inner = outline([(-2 * thick, thick - half), (out - thick, thick - half), (out - thick, half - thick),
                         (-2 * thick, half - thick)])  # fmt: skip
        return fillet(area - inner, 0.3 * thick)
    if kind == 2:
        knots = [
            (-thick, half),
            (0.6 * out, 0.98 * half),
            (out, 0.35 * half),
            (0.6 * out, -0.5 * half),
            (-thick, -half),
        ]
        area = outline(curve(knots, along=2))
        return area - area.offset(-thick)
    if kind == 3:  # open below, a hook
        line = np.array([(-thick, half), (0.7 * out, half), (out, 0.6 * half), (out, -half)])
        inner = line - thick
        return fillet(outline([*line, (out - thick, -half), *inner[[2, 1]], (-thick, half - thick)]), 0.2 * thick)
    area = outline(ellipse(out, half, exponent=rng.uniform(2, 4)))
    return area - disc(min(out, half) * rng.uniform(0.3, 0.5), (0.5 * out, 0))


def _with_handles(cup: "Manifold", line: np.ndarray, rng: np.random.Generator) -> "Manifold":
    """The vessel with this wall, and a handle at +x, or one on either side; none of it inside."""
    height = line[:, 1].max()
    tall, middle = height * rng.uniform((0.4, 0.45), (0.72, 0.58))
    out, thick = np.clip(tall * rng.uniform(0.4, 0.75), 8, 34), max(height * rng.uniform(0.05, 0.1), 3)
    start = np.interp(middle + np.array([-0.5, 0, 0.5]) * tall, line[:, 1], line[:, 0]).min() - 0.5
    handle = plate(_handle_area(rng, tall, out, thick), thick * rng.uniform(0.8, 2)).rotate((90, 0, 0))
    handle = handle.translate((start, 0, middle)) - revolve([(0, line[0, 1]), *line, (0, height)])
    both = [handle, handle.mirror((1, 0, 0))] if rng.random() < 0.1 else [handle]
    return union(cup, *both)


def _straight_mug(rng: np.random.Generator) -> "Manifold":
    """A mug with straight or hollowed sides, a sharp or round lower edge, and a handle of any form."""
    height, rim = log_uniform(rng, 45, _HIGHEST), log_uniform(rng, 48, 104) / 2
    foot, wall, waist = rim * rng.uniform(0.75, 1.12), rng.uniform(1.8, 5), rng.uniform(0.9, 1.05)
    corner = rng.uniform(0.03, 0.3) * min(foot, height)
    turn = np.linspace(-np.pi / 2, 0, 8)
    edge = np.column_stack([foot - corner + corner * np.cos(turn), wall / 2 + corner * (1 + np.sin(turn))])
    side = curve([edge[-1], (waist * (foot + rim) / 2, 0.55 * height), (rim, height)], along=2)
    line = np.concatenate([[(0, wall / 2)], edge[:-1], side])
    cup = shell(line, wall)
    if rng.random() < 0.3:  # a ring to stand on
        cup = union(cup, shell([(0.8 * foot, -rng.uniform(1, 4)), (0.8 * foot, wall / 2)], wall))
    return _posed(_with_handles(cup, line, rng), foot, rim, height, rng)


def _tea_cup(rng: np.random.Generator) -> "Manifold":
    """A wide cup on a ring, with a handle, mostly on a saucer, its walls round or flaring."""
    rim = log_uniform(rng, 56, 104) / 2
    height, ring, foot = rim * rng.uniform((0.85, 0.06, 0.38), (1.5, 0.16, 0.6))
    wall, belly = rng.uniform(1.6, 3.5), rng.uniform(0.7, 1.02)
    side = [(foot, ring + 1), (belly * rim, ring + rng.uniform(0.35, 0.6) * (height - ring)), (rim, height)]
    line = curve([(0, ring), *side], along=2, step=3)
    cup = union(shell(line, wall), shell([(foot, 0), (0.95 * foot, ring)], wall))
    cup = _with_handles(cup, line, rng)
    if rng.random() < 0.35:
        return _posed(cup, foot, rim, height, rng)
    wide, thick, rise = min(rim * rng.uniform(1.3, 1.75), 72), rng.uniform(2, 4), rng.uniform(5, 16)
    flat = foot + rng.uniform(2, 6)
    saucer = shell(
        curve([(0, 0), (flat, 0), (0.6 * wide + 0.4 * flat, 0.4 * rise), (wide, rise)], along=2, step=4), thick
    )
    stand = shell([(0.9 * flat, -4), (0.9 * flat, 0)], thick)
    cup = union(cup, cylinder(foot, ring + wall + 2, at=(0, 0, ring / 2 - 1)))  # no air shut in
    return union(cup.translate((0, 0, wall / 2 + 0.3)), saucer, stand)


def _egg_cup(rng: np.random.Generator) -> "Manifold":
    """A small or a tall bowl, round or a cone, on a waist: hollow below, or a stem on a thin foot."""
    height, rim = log_uniform(rng, 42, _HIGHEST), log_uniform(rng, 36, 84) / 2
    rim = np.clip(rim, 0.2 * height, 0.85 * height)
    stem, wall, power = rng.uniform(2.5, 0.35 * rim), rng.uniform(1.2, 3.5), rng.uniform(1, 4)
    deep, foot = min(height * rng.uniform(0.35, 0.6), 2.2 * rim), rim * rng.uniform(0.65, 1)
    low, across = height - deep, np.linspace(0, 1, 30)
    line = np.column_stack([rim * across ** (1 / power), low + deep * across])
    bowl = shell(line, wall)
    base = curve([(foot, 0.5 * wall), (0.5 * foot + 0.5 * stem, 0.12 * low + wall), (stem, 0.55 * low)], along=2)
    side = [
        *base,
        *curve([(stem, 0.55 * low), (1.1 * stem, 0.9 * low), (min(2 * stem, 0.6 * rim), low + wall)], along=2),
    ]
    stand = revolve([(0, 0), (foot, 0), *side, (0, low + wall)]) - revolve([(0, line[0, 1]), *line, (0, height)])
    if rng.random() < 0.4:
        hollow = [
            (0.4 * rim, low + deep * 0.4**power),
            (max(stem, 0.35 * rim), 0.8 * low),
            (0.5 * foot, 0.4 * low),
            (foot, wall / 2),
        ]
        stand = shell(curve(hollow, along=2), wall)
    return _posed(union(bowl, stand), foot, rim, height, rng)


def _open_tin(rng: np.random.Generator) -> "Manifold":
    """A tin without a lid, or with it bent up: rims, and rings pressed into its wall."""
    height, radius = log_uniform(rng, 26, _HIGHEST), log_uniform(rng, 48, 112) / 2
    wall, lip, deep = rng.uniform(0.9, 2), rng.uniform(0.8, 1.8), rng.uniform(0.5, 1.6)
    sunk, z = rng.uniform(2, 5), np.linspace(0, 1, 80)
    count, band = int(rng.integers(0, 9)), (z > rng.uniform(0.12, 0.3)) & (z < rng.uniform(0.7, 0.9))
    wave = deep * np.sin(2 * np.pi * (count + 2) * z) * band * (count > 0)
    side = np.column_stack([radius + wave, height * z])
    parts = [shell(side, wall), shell([(0, sunk), (radius, sunk)], wall)]
    parts += [revolve(ellipse(lip, lip, at=(radius + 0.3, at), count=20)) for at in (0, height)]
    tin = union(*parts)
    if rng.random() < 0.2:
        lid = cylinder(radius - 1, 1.3, at=(1 - radius, 0, 0)).rotate((0, rng.uniform(35, 100), 0))
        tin = union(tin, lid.translate((radius + 0.5, 0, height)))
        _, _, low, _, _, high = tin.bounding_box()
        return tin if high - low < _HIGHEST else tin.rotate((90, 0, 0))
    return _posed(tin, radius, radius, height, rng)


def _lab_beaker(rng: np.random.Generator) -> "Manifold":
    """A glass beaker or a cream jug: thin, straight or bellied, a flared lip, a spout, a handle now and then."""
    height, rim = log_uniform(rng, 46, _HIGHEST), log_uniform(rng, 42, 104) / 2
    wall, foot, flare = rng.uniform(1.2, 2.8), rim * rng.uniform(0.8, 1.1), rim * rng.uniform(0, 0.12)
    corner, out = rng.uniform(0.08, 0.3) * foot, rim * rng.uniform(0.1, 0.3)
    belly = rng.choice([0, rng.uniform(0, 0.12)])
    share = np.concatenate([np.linspace(0, 0.1, 12), np.linspace(0.12, 1, 40)])
    lost = corner * (1 - np.sqrt(np.clip(1 - np.clip(1 - height * share / corner, 0, 1) ** 2, 0, 1)))
    along = (
        foot
        + (rim - foot) * share
        + belly * rim * np.sin(np.pi * share)
        - lost
        + flare * np.clip(10 * share - 9, 0, 1) ** 2
    )
    turn, starts = np.linspace(0, 2 * np.pi, 160, endpoint=False), rng.uniform(0.7, 0.92)
    reach = along[:, None] + spout(out, turn, share, starts, rng.uniform(12, 50))
    beaker = vessel(reach, turn, height * share, wall)
    if rng.random() < 0.35:
        beaker = _with_handles(beaker, np.column_stack([along - 0.7 * wall, height * share]), rng)
    return _posed(beaker, foot, rim, height, rng)


def _ribbed_cup(rng: np.random.Generator) -> "Manifold":
    """A tapered cup or plant pot: round, fluted, or of four to ten sides; with steps, or a twist."""
    height, rim = log_uniform(rng, 44, _HIGHEST), log_uniform(rng, 46, 112) / 2
    foot, wall = rim * rng.uniform(0.58, 0.95), rng.uniform(1.2, 4)
    share, turn = np.linspace(0, 1, 61), np.linspace(0, 2 * np.pi, 180, endpoint=False)
    along = foot + (rim - foot) * share
    for _ in range(int(rng.integers(0, 3))):
        along = along + np.where(share > rng.uniform(0.2, 0.95), 1, 0) * rng.uniform(0.01, 0.06) * rim
    count, kind, twist = int(rng.integers(4, 11)), rng.integers(3), rng.choice([0, rng.uniform(-0.6, 0.6)])
    around = turn + twist * share[:, None]
    form = np.ones_like(around)
    if kind == 0:  # flat sides, their corners rounded
        sector = np.abs((around * count / (2 * np.pi)) % 1 - 0.5) * 2 * np.pi / count
        form = np.minimum(np.cos(np.pi / count) / np.cos(sector), rng.uniform(0.9, 0.99))
    elif kind == 1:
        count = 2 * count + 4
        form = 1 - rng.uniform(0.015, 0.05) * (1 + np.cos(count * around)) * (share < rng.uniform(0.7, 1.1))[:, None]
    reach = along[:, None] * form
    cup = vessel(reach, turn, height * share, wall)
    if rng.random() < 0.3:
        cup = cup - cylinder(foot * rng.uniform(0.1, 0.25), 4 * wall)
    return _posed(cup, reach[0].max(), reach[-1].max(), height, rng)


MUGS = (_straight_mug, _tea_cup, _egg_cup, _open_tin, _lab_beaker, _ribbed_cup)
"""What draws each kind."""
