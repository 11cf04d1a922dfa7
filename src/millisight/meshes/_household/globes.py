"""Made round things: balls with seams, holes, knobs or dents, beads, capsules, baubles, yarn, globes on a foot."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.profiles import (
    all_over,
    anyhow,
    as_wide,
    coarse_ball,
    hanger,
    lobed,
    on_ball,
    round_profile,
)
from millisight.meshes._shapes import FLAT, cylinder, ellipse, log_uniform, revolve, ring, tube, union

if TYPE_CHECKING:
    from manifold3d import Manifold

_GOLDEN = (1 + np.sqrt(5)) / 2


def _circle(radius: float, high: float = 0.0) -> np.ndarray:
    """(72, 3) points on a ball, round its axis at a height."""
    return np.pad(ellipse(1, 1, count=72), ((0, 0), (0, 1))) * np.sqrt(radius**2 - high**2) + (0, 0, high)


def _corners(rng: np.random.Generator) -> np.ndarray:
    """(N, 3) corners of a cube, of a solid of twelve or of twenty faces, or of a football, on a ball of radius 1."""
    signs = np.array([(i, j) for i in (-1, 1) for j in (-1, 1)])
    twenty = np.array([np.roll((0, i, j * _GOLDEN), k) for i, j in signs for k in range(3)])
    cube = np.array([(i, j, k) for i, j in signs for k in (-1, 1)])
    twelve = np.array([np.roll((0, i / _GOLDEN, j * _GOLDEN), k) for i, j in signs for k in range(3)])
    pairs = [(a, b) for a in twenty for b in twenty if 0 < np.linalg.norm(a - b) < 2.1]
    football = np.array([(2 * a + b) / 3 for a, b in pairs])
    solids = (football, football, np.concatenate([cube, twelve]), twenty, cube)
    points = solids[int(rng.integers(len(solids)))]
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _football(rng: np.random.Generator) -> "Manifold":
    """A football: grooves, or seams that stand out, round panels of three to six corners."""
    radius, corners = log_uniform(rng, 42, 128) / 2, _corners(rng)
    apart = np.linalg.norm(corners[:, None] - corners, axis=2)
    first, second = np.nonzero(np.triu(apart < 1.05 * apart[apart > 0.01].min(), 1))
    share = np.linspace(0, 1, 5)[:, None]
    thick, seams = radius * rng.uniform(0.02, 0.045), []
    for a, b in zip(corners[first], corners[second], strict=True):
        path = a + share * (b - a)
        seams.append(on_ball(radius * path / np.linalg.norm(path, axis=1, keepdims=True), thick, around=5))
    if rng.random() < 0.3:
        return as_wide(anyhow(union(coarse_ball(radius), *seams), rng), 2 * radius)
    return anyhow(coarse_ball(radius) - union(*seams), rng)


def _basketball(rng: np.random.Generator) -> "Manifold":
    """A basketball or a tennis ball: a seam that winds round it like two tongues, and circles across it."""
    radius, bend = log_uniform(rng, 46, 128) / 2, rng.uniform(0.15, 0.4)
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    x, y = (1 - bend) * np.cos(turn) + bend * np.cos(3 * turn), (1 - bend) * np.sin(turn) - bend * np.sin(3 * turn)
    path = radius * np.column_stack([x, y, 2 * np.sqrt(bend * (1 - bend)) * np.sin(2 * turn)])
    groove = radius * rng.uniform(0.025, 0.06)
    cuts = [on_ball(path, groove, closed=True)]
    for turned in ((90, 0, 0), (0, 90, 0))[: int(rng.integers(3))]:
        cuts.append(on_ball(_circle(radius), groove, closed=True).rotate(turned))
    return anyhow(coarse_ball(radius) - union(*cuts), rng)


def _bowling_ball(rng: np.random.Generator) -> "Manifold":
    """A bowling ball or a money box: three deep holes near one another, or one slot."""
    radius, deep = log_uniform(rng, 52, 128) / 2, rng.uniform(0.3, 0.7)
    if rng.random() < 0.25:
        slot = cylinder(1, 2 * deep * radius, at=(0, 0, radius)).scale((*(radius * rng.uniform(0.06, 0.5, 2)), 1))
        return (coarse_ball(radius) - slot).rotate((rng.uniform(0, 120), 0, 0))
    hole = radius * rng.uniform(0.1, 0.17)
    fall = np.degrees(rng.uniform((1.3, 1.3, 1.8), (1.8, 1.8, 3.2)) * hole / radius)
    turns = (60, -60, 180 + rng.uniform(-20, 20))
    drill = cylinder(hole, 2 * deep * radius, at=(0, 0, radius))
    holes = [drill.rotate((0, a, b)) for a, b in zip(fall, turns, strict=True)]
    return (coarse_ball(radius) - union(*holes)).rotate((rng.uniform(0, 150), 0, rng.uniform(0, 360)))


def _knob_ball(rng: np.random.Generator) -> "Manifold":
    """A dog's or a massage ball: knobs, cones or spikes all over."""
    width, count = log_uniform(rng, 40, 128), int(rng.integers(14, 60))
    base = np.sqrt(np.pi / count) * rng.uniform(0.55, 0.95)
    high, point = base * rng.uniform(0.5, 1.3), rng.uniform(0.5, 1.6)
    share = np.linspace(0, 0.97, 6)
    knob = np.column_stack([base * np.cos(0.5 * np.pi * share) ** point, 0.97 + high * np.sin(0.5 * np.pi * share)])
    one = lobed(np.vstack([(base, 0.85), knob]), np.ones(18))
    knobs = [one.rotate((0, fall, turn)) for fall, turn in all_over(count)]
    return as_wide(anyhow(union(coarse_ball(40).scale([1 / 40] * 3), *knobs), rng), width)


def _soft_ball(rng: np.random.Generator) -> "Manifold":
    """A ball half flat: a deep round dent with a blunt rim, a valve, and a flat base where it lies."""
    width, rim = log_uniform(rng, 48, 138), rng.uniform(0.03, 0.12)
    dents = [(rng.uniform(0.68, 0.88), rng.uniform(0, 75), rng.uniform(0, 360))]
    if rng.random() < 0.35:
        dents.append((rng.uniform(0.75, 0.88), rng.uniform(60, 100), dents[0][2] + rng.uniform(100, 260)))
    ball = coarse_ball(50).scale([1 / 50] * 3)
    for edge, tip, turn in dents:
        ball = ball.rotate((0, 0, -turn)).rotate((0, -tip, 0))
        # The cap beyond a plane is turned in, as a soft shell folds.
        ball = ball.warp_batch(
            lambda points, edge=edge: np.column_stack(
                [points[:, :2], edge - np.sqrt((points[:, 2] - edge) ** 2 + rim**2) + rim]
            )
        )
        ball = ball.rotate((0, tip, 0)).rotate((0, 0, turn))
    if rng.random() < 0.6:
        valve = cylinder(0.1, 0.12, at=(0, 0, 0.98)) - cylinder(0.05, 0.1, at=(0, 0, 1.04))
        ball = union(ball, valve.rotate((0, rng.uniform(95, 115), dents[0][2] + rng.uniform(120, 240))))
    ball = ball.trim_by_plane((0, 0, 1), -rng.uniform(0.7, 0.95))
    return as_wide(ball.scale((1, 1, rng.uniform(0.8, 1))), width)


def _bead(rng: np.random.Generator) -> "Manifold":
    """A bead: a ball with a hole through it, round or flat, smooth or fluted; on its side or its hole."""
    radius, squeeze = log_uniform(rng, 32, 126) / 2, rng.uniform(0.7, 1)
    flutes, turn = int(rng.choice([0, 0, 8, 12])), np.linspace(0, 2 * np.pi, 120, endpoint=False)
    around = 1 - 0.12 * (1 - np.abs(np.sin(flutes * turn / 2))) if flutes else np.ones(120)
    bead = lobed(round_profile(radius, squeeze * radius)[3:-3], around)
    bead -= cylinder(radius * rng.uniform(0.14, 0.45), 3 * radius)
    return bead.rotate((0, rng.choice([0, 90, rng.uniform(0, 90)]), rng.uniform(0, 360)))


def _capsule(rng: np.random.Generator) -> "Manifold":
    """A toy capsule: two shells, one often the wider, that meet in a rim round the middle; now and then a lug."""
    width, out, thick, step = log_uniform(rng, 34, 126), *rng.uniform((1.04, 0.05, 0.95), (1.16, 0.2, 1))
    groove, lower = rng.uniform(0.01, 0.03), rng.uniform(0.8, 1)
    upper = rng.uniform(0.85, 1.05)
    parts = [
        coarse_ball(40).scale((1, 1, upper)).trim_by_plane((0, 0, 1), 0),
        coarse_ball(40).scale((step, step, lower)).trim_by_plane((0, 0, -1), 0),
        cylinder(40 * out, 40 * thick) - (cylinder(50, 80 * groove) - cylinder(39, 80 * groove)),
    ]
    if rng.random() < 0.5:
        lug = cylinder(40 * rng.uniform(0.12, 0.25), 40 * thick, at=(40 * out, 0, 0))
        parts += [lug, lug.rotate((0, 0, 180))] if rng.random() < 0.5 else [lug]
    ball = union(*parts)
    if rng.random() < 0.3:
        ball = ball.trim_by_plane((0, 0, 1), -40 * lower * rng.uniform(0.75, 0.9))
        return as_wide(ball, width)
    return as_wide(ball.rotate((0, rng.choice([0, 90, rng.uniform(0, 180)]), rng.uniform(0, 360))), width)


def _reflector(rng: np.random.Generator) -> "Manifold":
    """A bauble on its side with one to four hollows of rays, like a lamp's reflector; a cap and a loop."""
    radius, count, rays = log_uniform(rng, 40, 108) / 2, int(rng.integers(1, 5)), int(rng.integers(8, 17))
    deep, wide = radius * rng.uniform(0.3, 0.6), radius * (rng.uniform(0.6, 0.85) if count < 3 else 0.6)
    rim = np.sqrt(radius**2 - wide**2)
    turn = np.linspace(0, 2 * np.pi, 8 * rays, endpoint=False)
    rows = np.array([(0.02 * wide, -deep), (0.5 * wide, -0.62 * deep), (wide, 0), (1.3 * wide, deep)])
    rays_in = 1 - rng.uniform(0.05, 0.25) * np.array([[0], [1], [0.3], [0]]) * np.abs(np.sin(rays * turn / 2))
    dish = lobed(rows, rays_in).translate((0, 0, rim)).rotate((90, 0, 0))
    cuts = [dish.rotate((360 * i / count + rng.uniform(-10, 10), 0, 0)) for i in range(count)]
    cap, high, loop = radius * rng.uniform((0.16, 0.15, 0.1), (0.26, 0.25, 0.16))
    bauble = union(coarse_ball(radius) - union(*cuts), *hanger(radius, cap, high, loop))
    return bauble.rotate((rng.uniform(0, 360), 0, 0))


def _yarn(rng: np.random.Generator) -> "Manifold":
    """A ball of yarn or string: bands of strands side by side, wound one over another."""
    radius, bands, strands = log_uniform(rng, 42, 118) / 2, int(rng.integers(4, 6)), int(rng.integers(3, 6))
    thick, turn = radius * rng.uniform(0.06, 0.1), np.linspace(0, 2 * np.pi, 44, endpoint=False)
    parts = [coarse_ball(0.97 * radius)]
    for i in range(bands):
        out, middle = radius * (0.97 + 0.09 * i / bands), rng.uniform(-0.2, 0.2) * radius
        profile = [(0.7 * radius, middle - strands * thick)]
        for j in range(strands):
            high = middle + 2 * thick * (j - (strands - 1) / 2)
            profile.extend(ellipse(thick, thick, at=(np.sqrt(out**2 - high**2), high), count=12)[[10, 11, 0, 1, 2]])
        profile.append((0.7 * radius, middle + strands * thick))
        wave = thick * np.sin(2 * turn + rng.uniform(0, 6.3))
        band = lobed(np.array(profile), np.ones(44), lift=wave, closed=True)
        parts.append(band.rotate((rng.uniform(0, 180), 0, rng.uniform(0, 360))))
    return as_wide(union(*parts), 2 * radius)


def _globe(rng: np.random.Generator) -> "Manifold":
    """A ball on a small foot: a snow globe, a paperweight, a round candle or a lamp."""
    width, foot, high, sunk = log_uniform(rng, 40, 126), *rng.uniform((0.5, 0.2, 0.65), (0.9, 0.5, 0.93))
    waist, lip = foot * rng.uniform(0.75, 1), rng.uniform(0.02, 0.08)
    base = [(0, 0), (foot, 0), (foot, -lip), (waist, -0.5 * high), (foot, lip - high), (foot, -high), (0, -high)]
    base = revolve(50 * np.array(base)).translate((0, 0, -50 * sunk))
    parts = [coarse_ball(50), base, cylinder(50 * min(foot, 0.6), 40, at=(0, 0, -40 * sunk))]
    if rng.random() < 0.35:
        parts.append(cylinder(50 * rng.uniform(0.06, 0.2), 50 * rng.uniform(0.1, 0.3), at=(0, 0, 51)))
    return as_wide(union(*parts).trim_by_plane((0, 0, 1), -50 * (sunk + high)), width)


def _facet_ball(rng: np.random.Generator) -> "Manifold":
    """A ball of flat facets: rows of them as at a disco, or 20 to 80 corners all over; now and then a loop."""
    from manifold3d import Manifold

    width = log_uniform(rng, 34, 126)
    if rng.random() < 0.5:
        rows, columns = int(rng.integers(6, 14)), int(rng.integers(8, 22))
        polar = np.pi * (np.arange(rows) + 0.5) / rows
        circles = [np.insert(ring(columns, np.sin(a)), 2, np.cos(a), axis=1) for a in polar]
        ball = Manifold.hull_points(np.concatenate(circles))
    else:
        points = np.radians(all_over(int(rng.integers(20, 80)))) + rng.uniform(-0.12, 0.12, 2)
        fall, turn = (points + rng.uniform(-0.1, 0.1, points.shape)).T
        ball = Manifold.hull_points(
            np.column_stack([np.sin(fall) * np.cos(turn), np.sin(fall) * np.sin(turn), np.cos(fall)])
        )
    if rng.random() < 0.3:
        ball = union(ball, tube(_circle(0.16).round(9), 0.04, normal=FLAT, closed=True).rotate((90, 0, 0)))
    return as_wide(anyhow(ball, rng), width)


GLOBES = (
    _football,
    _basketball,
    _bowling_ball,
    _knob_ball,
    _soft_ball,
    _bead,
    _capsule,
    _reflector,
    _yarn,
    _globe,
    _facet_ball,
)
"""What draws each kind."""
