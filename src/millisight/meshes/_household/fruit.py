"""Fruit and vegetables: round, and each disturbed in its own way by lobes, hollows, leaves, seams, tails or cuts."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.profiles import (
    all_over,
    anyhow,
    as_wide,
    coarse_ball,
    lobed,
    on_ball,
    rolled,
    round_profile,
    stem,
)
from millisight.meshes._shapes import (
    FLAT,
    UPRIGHT,
    curve,
    cylinder,
    ellipse,
    loft,
    log_uniform,
    revolve,
    sphere,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

_TURN = np.linspace(0, 2 * np.pi, 96, endpoint=False)


def _furrows(count: int, depth: float, rng: np.random.Generator, *, sharp: float = 1.5) -> np.ndarray:
    """(N,) factors of the radius around a fruit of so many lobes, no two of a width."""
    wobble = rng.uniform(0, 0.25) * np.sin(_TURN + rng.uniform(0, 2 * np.pi))
    return 1 - depth * (1 - np.abs(np.sin(count * (_TURN + wobble) / 2))) ** sharp


def _bumps(profile: np.ndarray, count: int, rng: np.random.Generator, finest: int = 8) -> np.ndarray:
    """(K, N) of smooth noise, about -1 to 1: so many waves over a fruit."""
    polar = np.arctan2(profile[:, :1], profile[:, 1:])
    waves = np.zeros((len(profile), len(_TURN)))
    for _ in range(count):
        down, about = rng.integers(finest // 4, finest, 2)
        waves += np.cos(down * polar + rng.uniform(0, 6.3)) * np.cos(about * _TURN + rng.uniform(0, 6.3))
    return waves * np.sin(polar) / np.sqrt(count)


def _sepals(points: np.ndarray, wide: float, thick: float, count: int, rng: np.random.Generator) -> "list[Manifold]":
    """A star of narrow leaves, each along a curve through (K, 2) distances and heights, no two alike."""
    leaves = []
    for i in range(count):
        path = curve(np.insert(points * (rng.uniform(0.8, 1.1), 1), 1, 0, axis=1))
        along = np.linspace(0, 1, len(path))
        width = wide * (0.25 + np.sin(np.pi * along**0.8)) * rng.uniform(0.8, 1.1)
        leaf = tube(path, np.column_stack([np.full(len(path), thick), width]), normal=UPRIGHT, around=12)
        leaves.append(leaf.rotate((0, 0, (i + rng.uniform(-0.2, 0.2)) * 360 / count)))
    return leaves


def _tomato(rng: np.random.Generator) -> "Manifold":
    """A tomato of three to six lobes, a deep hollow round the stem, and mostly the star of sepals on it."""
    radius, lobes = log_uniform(rng, 45, 118) / 2, int(rng.integers(3, 7))
    half_height, depth = radius * rng.uniform(0.6, 0.85), radius * rng.uniform(0.15, 0.35)
    width = rng.uniform(0.3, 0.45)
    profile = round_profile(radius, half_height, taper=rng.uniform(-0.05, 0.1), top=-depth, bottom=3, width=width)[3:-3]
    deeper = np.clip(0.6 + 0.5 * profile[:, 1:] / half_height, 0.2, 1)
    fruit = lobed(profile, 1 + deeper * (_furrows(lobes, rng.uniform(0.06, 0.22), rng) - 1))
    floor, over, thick = half_height - depth, half_height * rng.uniform(0.95, 1.1), max(0.02 * radius, 0.7)
    if rng.random() < 0.75:
        ends = np.array([(0, floor), (0.4 * radius, over), (radius * rng.uniform(0.6, 0.9), over - 0.2 * radius)])
        leaves = _sepals(ends, radius * rng.uniform(0.06, 0.12), thick, int(rng.integers(5, 8)), rng)
        fruit = union(fruit, *leaves, stem(floor, depth + 0.2 * radius, 2.5 * thick, rng))
    return rolled(fruit, rng)


def _apple(rng: np.random.Generator) -> "Manifold":
    """An apple with deep hollows above and below, five bumps round the lower one, and mostly a stem."""
    radius = log_uniform(rng, 50, 112) / 2
    half_height, depth, hollow = radius * rng.uniform((0.85, 0.3, 0.15), (1.05, 0.5, 0.3))
    profile = round_profile(
        radius, half_height, taper=rng.uniform(0, 0.22), top=-depth, bottom=hollow, width=rng.uniform(0.25, 0.4)
    )[3:-3]
    below = np.clip(-profile[:, 1:] / half_height, 0, 1) ** 2
    star = rng.uniform(0.05, 0.12) * np.cos(5 * _TURN) * below
    fruit = lobed(profile, 1 + star + 0.02 * _bumps(profile, 3, rng), lift=-0.4 * radius * star)
    if rng.random() < 0.7:
        length, thickness = radius * rng.uniform((0.3, 0.035), (0.8, 0.06))
        fruit = union(fruit, stem(half_height - depth, length, thickness, rng))
    return rolled(fruit, rng)


def _pomegranate(rng: np.random.Generator) -> "Manifold":
    """A pomegranate: a ball with blunt edges, and a crown of teeth on a short neck."""
    radius, edges, teeth = log_uniform(rng, 50, 112) / 2, int(rng.integers(4, 8)), int(rng.integers(5, 8))
    half_height = radius * rng.uniform(0.82, 0.98)
    profile = round_profile(radius, half_height, top=0.1 * radius, bottom=0.05 * radius)[3:-3]
    fruit = lobed(profile, 1 + rng.uniform(0.01, 0.04) * np.cos(edges * _TURN))
    neck, high, flare, tooth = radius * rng.uniform((0.18, 0.15, 0, 0.1), (0.3, 0.35, 0.15, 0.25))
    wall, top = max(0.05 * radius, 1.5), half_height + high
    wide = neck + flare
    crown = np.array([(neck, 0.8 * half_height), (neck, top), (wide, top), (wide - wall, top), (neck - wall, top)])
    crown = np.vstack([crown, (neck - wall, 0.8 * half_height)])
    rise = np.zeros((6, len(_TURN)))
    rise[2:4] = 2 * tooth * np.abs(np.cos(teeth * _TURN / 2))
    crown = lobed(crown, np.ones(len(_TURN)), lift=rise, closed=True)
    return as_wide(rolled(union(fruit, crown), rng), 2 * radius)


def _orange(rng: np.random.Generator) -> "Manifold":
    """An orange or a mandarin: flat poles, short ridges round the stem's button; now and then a navel."""
    radius, ridges = log_uniform(rng, 42, 118) / 2, int(rng.integers(7, 13))
    half_height, dip = radius * rng.uniform(0.75, 0.97), radius * rng.uniform(0.08, 0.2)
    profile = round_profile(radius, half_height, top=-dip, bottom=dip, width=rng.uniform(0.35, 0.6))[3:-3]
    above = np.clip(profile[:, 1:] / half_height, 0, 1) ** 3
    fruit = lobed(profile, 1 + above * (_furrows(ridges, rng.uniform(0.05, 0.2), rng) - 1))
    button, navel = radius * rng.uniform((0.07, 0.08), (0.13, 0.22))
    parts = [fruit, cylinder(button, 0.1 * radius, at=(0, 0, half_height - dip))]
    if rng.random() < 0.6:
        ring = np.pad(ellipse(navel, navel), ((0, 0), (0, 1))) - (0, 0, half_height - dip)
        parts.append(tube(ring, 0.5 * navel, normal=FLAT, closed=True))
    return rolled(union(*parts).rotate((180 * int(rng.integers(2)), 0, 0)), rng)


def _pepper(rng: np.random.Generator) -> "Manifold":
    """A bell pepper: three or four lobes, square shoulders, a bent stem in a hollow; on its side or its lobes."""
    radius, lobes = log_uniform(rng, 50, 100) / 2, int(rng.integers(3, 5))
    half_height, depth, hollow = radius * rng.uniform((0.85, 0.25, 0.15), (1.15, 0.4, 0.35))
    profile = round_profile(radius, half_height, taper=rng.uniform(0, 0.25), top=-depth, bottom=hollow, width=0.45)[
        3:-3
    ]
    profile[:, 0] = radius * (profile[:, 0] / radius) ** rng.uniform(0.6, 0.8)
    deeper = 0.75 + 0.25 * np.abs(profile[:, 1:]) / half_height
    fruit = lobed(profile, 1 + deeper * (_furrows(lobes, rng.uniform(0.18, 0.35), rng, sharp=1.2) - 1))
    stalk = stem(half_height - depth, depth + radius * rng.uniform(0.1, 0.35), radius * rng.uniform(0.08, 0.13), rng)
    fruit = union(fruit, stalk, sphere(0.2 * radius, at=(0, 0, half_height - 1.1 * depth)))
    return fruit.rotate((0, rng.choice([0, rng.uniform(75, 105)]), 0))


def _strawberry(rng: np.random.Generator) -> "Manifold":
    """A strawberry: a blunt cone with pits where its seeds sit, and a star of leaves; on its side or its leaves."""
    radius = log_uniform(rng, 32, 66) / 2
    half_height = radius * rng.uniform(0.95, 1.3)
    profile = round_profile(radius, half_height, taper=rng.uniform(0.2, 0.45), top=-0.15 * radius, width=0.4)[3:-3]
    rows, columns = int(rng.integers(5, 9)), 2 * int(rng.integers(4, 8))
    polar = np.arctan2(profile[:, :1], profile[:, 1:])
    pits = np.clip(np.cos(2 * rows * polar) * np.cos(columns * _TURN) - 0.3, 0, 1) * np.sin(polar)
    flat = 1 + rng.uniform(-0.12, 0.12) * np.cos(2 * _TURN)
    fruit = lobed(profile, flat * (1 - rng.uniform(0.06, 0.12) * pits))
    top, reach = 0.85 * half_height, radius * rng.uniform(0.7, 1.05)
    ends = np.array([(0, top - 2), (0.5 * reach, top + 0.12 * radius), (reach, top + radius * rng.uniform(-0.3, 0.35))])
    leaves = _sepals(ends, radius * rng.uniform(0.12, 0.2), 0.7, int(rng.integers(6, 11)), rng)
    fruit = union(fruit, *leaves, stem(top, radius * rng.uniform(0.15, 0.5), 0.07 * radius, rng))
    return as_wide(fruit.rotate((0, rng.choice([180, rng.uniform(80, 115)]), 0)), 2 * radius)


def _leaf(reach: float, thick: float, rng: np.random.Generator) -> "Manifold":
    """A leaf about a ball of radius 1, round its upper pole: its edge stands off and waves."""
    turn, share = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.linspace(0.05, 1, 9)[:, None]
    waves, flare, ripple = int(rng.integers(4, 10)), rng.uniform(0.05, 0.28), rng.uniform(0.02, 0.07)
    polar = share * reach * (1 + 0.1 * np.cos(2 * turn + rng.uniform(0, 6.3)))
    out = 1.01 + share**4 * (flare + ripple * np.cos(waves * turn)) + 0.012 * share * np.cos(9 * turn)
    polar, out = np.concatenate([polar, polar[::-1]]), np.concatenate([out + thick, out[::-1] - 0.03])
    across = out * np.sin(polar)
    return loft(np.stack([across * np.cos(turn), across * np.sin(turn), out * np.cos(polar)], axis=2))


def _cabbage(rng: np.random.Generator) -> "Manifold":
    """A cabbage or a lettuce: a ball in leaves whose wavy edges stand off, cut flat at the stalk."""
    count, thick, width = int(rng.integers(5, 9)), rng.uniform(0.02, 0.05), log_uniform(rng, 62, 136)
    leaves = []
    for i in range(count):
        leaf = _leaf(rng.uniform(0.8, 1.25), thick, rng)
        leaves.append(leaf.rotate((0, rng.uniform(60, 115), 137.5 * i + rng.uniform(-15, 15))))
    head = union(coarse_ball(30).scale([1 / 30] * 3), *leaves, cylinder(0.25, 0.4, at=(0, 0, -1)))
    head = head.scale((1, 1, rng.uniform(0.8, 1.05))).trim_by_plane((0, 0, 1), -1.12)
    return as_wide(rolled(head, rng), width)


def _garlic(rng: np.random.Generator) -> "Manifold":
    """A head of garlic: round cloves side by side, drawn up to a neck, now and then one clove gone."""
    radius, cloves = log_uniform(rng, 34, 76) / 2, int(rng.integers(4, 10))
    half_height, tip = radius * rng.uniform(0.65, 0.85), radius * rng.uniform(0.4, 0.8)
    profile = round_profile(
        radius, half_height, taper=-0.12, top=tip, bottom=0.1 * radius, width=rng.uniform(0.13, 0.22)
    )
    profile = profile[6:-3]
    middle = (profile[:, :1] / radius) ** 0.7
    head = lobed(profile, 1 + middle * (_furrows(cloves, rng.uniform(0.25, 0.45), rng, sharp=2.2) - 1))
    if rng.random() < 0.3:
        clove = sphere(0.42 * radius).scale((1, 1, 1.5 * half_height / radius))
        head -= clove.translate((0.85 * radius, 0, 0.05 * radius))
    root = cylinder(0.25 * radius, 0.2 * radius, at=(0, 0, -0.85 * half_height))
    return rolled(union(head, root), rng)


def _beetroot(rng: np.random.Generator) -> "Manifold":
    """A beetroot, a turnip or a radish on its side: a round root, a bent tail, and stubs of leaves."""
    radius = log_uniform(rng, 36, 104) / 2
    half_height, tip, tail = radius * rng.uniform((0.8, 0.2, 0.15), (0.95, 0.35, 0.35))
    profile = round_profile(radius, half_height, taper=rng.uniform(0, 0.25), bottom=-tip, width=rng.uniform(0.18, 0.35))
    profile = profile[3:-3]
    root = lobed(profile, 1 + 0.035 * _bumps(profile, 4, rng))
    low = -half_height - tip
    path = curve([(0, 0, low + 0.15 * radius), (0, 0, low), (rng.uniform(-0.3, 0.3) * radius, 0, low - tail)])
    parts = [root, tube(path, 0.07 * radius * np.linspace(1, 0.3, len(path)), normal=UPRIGHT, around=16)]
    count, length, thick = int(rng.integers(3, 8)), radius * rng.uniform(0.1, 0.35), radius * rng.uniform(0.05, 0.09)
    for i in range(count):
        stub = stem(0.9 * half_height, length + 0.1 * half_height, thick, rng)
        parts.append(stub.translate((1.8 * thick, 0, 0)).rotate((0, 0, (i + rng.uniform(-0.3, 0.3)) * 360 / count)))
    return union(*parts).rotate((0, rng.uniform(80, 115), rng.uniform(0, 360)))


def _half_fruit(rng: np.random.Generator) -> "Manifold":
    """A fruit cut in two, a lemon, a kiwi, an onion: flat side down."""
    radius = log_uniform(rng, 44, 122) / 2
    half_height, tip = radius * rng.uniform((0.85, 0), (1.2, 0.2))
    profile = round_profile(radius, half_height, taper=rng.uniform(-0.15, 0), top=tip, bottom=-tip, width=0.22)[3:-3]
    lobes = int(rng.choice([0, 5, 8, 10]))
    fruit = lobed(profile, _furrows(lobes, rng.uniform(0.03, 0.12), rng) if lobes else np.ones(len(_TURN)))
    fruit = fruit.rotate((0, 90 * int(rng.integers(2)), 0))
    return fruit.trim_by_plane((0, 0, 1), radius * rng.uniform(-0.3, 0.1))


def _walnut(rng: np.random.Generator) -> "Manifold":
    """A walnut: a wrinkled shell, a raised seam from pole to pole, and a tip."""
    radius = log_uniform(rng, 31, 62) / 2
    half_height, tip = radius * rng.uniform((0.95, 0.05), (1.2, 0.2))
    profile = round_profile(radius, half_height, top=tip, width=0.25)[3:-3]
    shell = lobed(profile, 1 + rng.uniform(0.04, 0.08) * _bumps(profile, 8, rng, finest=16))
    seam = revolve(round_profile(1.06 * radius, half_height + 0.06 * radius, top=tip, width=0.25))
    wide = radius * rng.uniform(0.05, 0.11)
    seam = seam.trim_by_plane((0, 1, 0), -wide).trim_by_plane((0, -1, 0), -wide)
    nut = union(shell, seam - seam.scale((0.8, 1, 0.8)))
    return nut.rotate((rng.uniform(0, 360), rng.uniform(60, 120), 0))


def _coconut(rng: np.random.Generator) -> "Manifold":
    """A coconut: three blunt ridges, a rough shell, tufts of fibre, and three eyes round one end."""
    radius = log_uniform(rng, 66, 126) / 2
    half_height = radius * rng.uniform(0.95, 1.2)
    profile = round_profile(radius, half_height, taper=rng.uniform(0, 0.12), top=0.06 * radius)[3:-3]
    rough = rng.uniform(0.02, 0.05) * _bumps(profile, 6, rng)
    ridges = rng.uniform(0.01, 0.05) * np.cos(3 * _TURN)
    eye, aside = radius * rng.uniform((0.09, 0.2), (0.15, 0.32))
    nut = lobed(profile, 1 + rough + ridges)
    holes = [sphere(eye, at=(aside, 0, half_height)).rotate((0, 0, 120 * i)) for i in range(3)]
    nut -= union(*holes)
    fibres = []
    for fall, turn in all_over(int(rng.integers(6, 16))):
        angle = np.linspace(0, rng.uniform(0.4, 1), 12) - 0.4
        path = radius * np.column_stack([np.sin(angle), 0.04 * np.cos(9 * angle), np.cos(angle)])
        fibre = on_ball(path, radius * rng.uniform(0.015, 0.04), around=6)
        fibres.append(fibre.rotate((0, 0, rng.uniform(0, 180))).rotate((0, fall, turn)))
    return as_wide(anyhow(union(nut, *fibres), rng), 2 * radius)


def _melon(rng: np.random.Generator) -> "Manifold":
    """A melon: a ball or an oval under a raised net, now and then in slices, and the scar of its stem."""
    radius, lines = log_uniform(rng, 76, 124) / 2, int(rng.integers(7, 11))
    thick, squeeze = radius * rng.uniform(0.018, 0.04), rng.uniform(0.88, 1.18)
    slices = int(rng.choice([0, 8, 10]))
    fruit = coarse_ball(radius)
    if slices:
        fruit = lobed(round_profile(radius, radius)[3:-3:2], _furrows(slices, 0.06, rng))
    net = []
    for fall, turn in all_over(lines):
        high = radius * rng.uniform(-0.75, 0.75)
        ring = np.pad(ellipse(1, 1, count=40), ((0, 0), (0, 1))) * np.sqrt(radius**2 - high**2) + (0, 0, high)
        net.append(on_ball(ring, thick, closed=True, around=6).rotate((0, fall, turn)))
    scar = cylinder(radius * rng.uniform(0.08, 0.16), 0.1 * radius, at=(0, 0, radius))
    fruit = union(fruit, *net, scar).scale((1, 1, squeeze))
    return as_wide(fruit.rotate((0, rng.uniform(0, 110), 0)), 2 * radius)


FRUIT = (
    _tomato,
    _apple,
    _pomegranate,
    _orange,
    _pepper,
    _strawberry,
    _cabbage,
    _garlic,
    _beetroot,
    _half_fruit,
    _walnut,
    _coconut,
    _melon,
)
"""What draws each kind."""
