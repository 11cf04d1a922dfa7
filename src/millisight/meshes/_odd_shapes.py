"""Shapes of no class, drawn at random by ten rules: what a classifier must not take for a thing that it knows.

Nothing here is drawn after any one object. Lengths are in millimetres.
"""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    FLAT,
    block,
    body,
    curve,
    cylinder,
    disc,
    outline,
    plate,
    revolve,
    rounded_block,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

_OVERLAP = 1.0  # of parts that touch [mm]


def odd_shape(rng: np.random.Generator) -> "Manifold":
    """A solid by one of the rules."""
    return _RULES[rng.integers(len(_RULES))](rng)


def _around(count: int, rng: np.random.Generator, *, even: float) -> np.ndarray:
    """(count,) ascending angles, evenly spaced but for a share `1 - even` of their spacing [rad]."""
    steps = even + (1 - even) * rng.uniform(0.2, 1.8, count)
    return 2 * np.pi * np.cumsum(steps) / steps.sum()


def _polygon(rng: np.random.Generator) -> np.ndarray:
    """(K, 2) corners of an area that bulges and dents: any, or in turn near and far from the middle."""
    count, size = int(rng.integers(5, 13)), rng.uniform(40, 85)
    angle = _around(count, rng, even=rng.uniform(0, 1))
    radius = rng.uniform(0.35, 1, count)
    if rng.random() < 0.4:
        radius = np.where(np.arange(count) % 2, rng.uniform(0.35, 0.75), 1.0)
    return size * np.column_stack([radius * np.cos(angle), rng.uniform(0.6, 1) * radius * np.sin(angle)])


def _cutout(rng: np.random.Generator) -> "Manifold":
    """A board sawn to any outline, angular or smooth, with a hole now and then."""
    corners = _polygon(rng)
    area = outline(curve(corners, closed=True, step=2, along=2) if rng.random() < 0.4 else corners)
    if rng.random() < 0.3:
        area = area - disc(rng.uniform(8, 18))
    return plate(area, rng.uniform(8, 50))


def _bars(rng: np.random.Generator) -> "Manifold":
    """Straight bars joined end to end at angles, or to a bar before: letters, figures, angles, crosses."""
    wide, high = rng.uniform(10, 30), rng.uniform(8, 45)
    points, bars = [np.zeros(2)], []
    heading = 0.0
    for _ in range(int(rng.integers(2, 6))):
        start = points[-1] if rng.random() < 0.6 else points[int(rng.integers(len(points)))]
        turns = (np.pi / 2, np.pi / 4, np.pi / 3, rng.uniform(0.5, 2.2))
        heading += rng.choice([-1, 1]) * turns[int(rng.integers(len(turns)))]
        end = start + rng.uniform(40, 80) * np.array([np.cos(heading), np.sin(heading)])
        middle, length = (start + end) / 2, float(np.linalg.norm(end - start)) + wide
        bars.append(
            block((length, wide, high)).rotate((0, 0, np.degrees(heading))).translate((*middle, 0))
            if rng.random() < 0.8
            else plate(strip([start, end], wide), high)
        )
        points += [middle, end]
    return union(*bars)


def _frame(rng: np.random.Generator) -> "Manifold":
    """A polygon's border, with bars across now and then."""
    count, size, high = int(rng.integers(3, 8)), rng.uniform(45, 85), rng.uniform(8, 35)
    angle = _around(count, rng, even=0.7) if rng.random() < 0.5 else 2 * np.pi * (np.arange(count) + 0.5) / count
    corners = size * np.column_stack([np.cos(angle), rng.uniform(0.55, 1) * np.sin(angle)])
    frame = plate(outline(corners) - outline(corners * rng.uniform(0.5, 0.78)), high)
    for _ in range(int(rng.integers(0, 4))):
        i, j = rng.choice(count, 2, replace=False)
        bar = strip([(corners[i] + corners[i - 1]) / 2 * 0.9, corners[j] * 0.9], rng.uniform(6, 14))
        frame = union(frame, plate(bar, high))
    return frame


def _spokes(rng: np.random.Generator) -> "Manifold":
    """A hub with arms around it: a propeller, a gear, a wheel, a jack."""
    count, hub, reach = int(rng.integers(3, 11)), rng.uniform(10, 40), rng.uniform(45, 85)
    high, wide = rng.uniform(8, 40), min(rng.uniform(6, 24), 2 * hub * np.sin(np.pi / count) + 4)
    arm = rounded_block((reach, wide, rng.uniform(0.4, 1) * high), 0.2 * min(wide, 0.4 * high), at=(reach / 2, 0, 0))
    arm = arm.rotate((rng.uniform(0, 40) if rng.random() < 0.3 else 0, 0, 0))
    wheel = union(cylinder(hub, high), *(arm.rotate((0, 0, 360 * i / count)) for i in range(count)))
    if rng.random() < 0.3:
        wheel = union(wheel, plate(disc(reach) - disc(reach * rng.uniform(0.7, 0.88)), high))
    if rng.random() < 0.4:
        wheel = wheel - cylinder(0.5 * hub, 2 * high)
    return wheel


def _hull(rng: np.random.Generator) -> "Manifold":
    """A pyramid, a wedge, a cone, a roof: a base, and a top that is much smaller."""
    from manifold3d import Manifold

    high, size = rng.uniform(35, 95), rng.uniform(30, 65)
    if rng.random() < 0.3:
        return revolve([(0, 0), (size, 0), (size * rng.uniform(0.02, 0.35), high), (0, high)])
    angle = _around(int(rng.integers(3, 8)), rng, even=0.6)
    base = size * np.column_stack([np.cos(angle), rng.uniform(0.6, 1) * np.sin(angle)])
    top = base.mean(axis=0) + rng.uniform(-0.5, 0.5, 2) * size
    ridge = rng.uniform(-0.5, 0.5, 2) * size * rng.choice([0, 1])
    points = [(*corner, 0.0) for corner in base] + [(*(top - ridge), high), (*(top + ridge), high)]
    return Manifold.hull_points(np.array(points))


def _figure(rng: np.random.Generator) -> "Manifold":
    """Ellipsoids that grow out of each other: animals, dolls, roots."""
    from manifold3d import Manifold

    unit = Manifold.sphere(1.0, 48)
    axes = np.sort(rng.uniform(14, 48, 3))[::-1]
    parts, places = [unit.scale(tuple(axes))], [(np.zeros(3), axes)]
    for _ in range(int(rng.integers(2, 7))):
        middle, axes = places[int(rng.integers(min(len(places), 2)))]
        direction = rng.standard_normal(3) * [1, 1, 0.7]
        at = middle + direction / np.linalg.norm(direction) * axes * rng.uniform(0.85, 1.05)
        axes = rng.uniform(6, 26, 3)
        part = unit.scale(tuple(axes)).rotate(tuple(rng.uniform(-60, 60, 3))).translate(tuple(at))
        parts.append(part)
        places.append((at, axes))
        if rng.random() < 0.5:  # the other ear
            parts.append(part.mirror((0, 1, 0)))
    return union(*parts)


def _bent_rod(rng: np.random.Generator) -> "Manifold":
    """A rod that winds on the table, or up from it."""
    count = int(rng.integers(4, 8))
    heading = np.cumsum(rng.uniform(-1.4, 1.4, count))
    steps = rng.uniform(25, 50, count)[:, None] * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(count)])
    path, radius = curve(np.cumsum(steps, axis=0), step=4), rng.uniform(5, 14)
    if rng.random() < 0.5:
        turn = np.linspace(0, 2 * np.pi * rng.uniform(1.3, 5), 140)
        wide, pitch = rng.uniform(20, 45), rng.uniform(2.4, 5) * min(radius, 6) / (2 * np.pi)
        radius = min(radius, 6)
        path = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), pitch * turn])
    return tube(path, radius, normal=FLAT, around=20)


def _steps(rng: np.random.Generator) -> "Manifold":
    """Blocks or discs of different heights side by side, or ever smaller ones on top of each other."""
    count, parts = int(rng.integers(2, 5)), []
    if rng.random() < 0.5:
        x, wide = 0.0, rng.uniform(40, 110)
        heights = rng.permutation(np.linspace(rng.uniform(8, 25), rng.uniform(50, 90), count))
        for high in heights:
            deep = rng.uniform(20, 50)
            parts.append(block((deep + _OVERLAP, wide * rng.uniform(0.6, 1), high), at=(x + deep / 2, 0, high / 2)))
            x += deep
        return union(*parts)
    size, z = rng.uniform(35, 65), 0.0
    for _ in range(count):
        high = rng.uniform(12, 35)
        at = (*rng.uniform(-0.2, 0.2, 2) * size, z + high / 2)
        round_one = cylinder(size, high + _OVERLAP, at=at)
        parts.append(
            round_one if rng.random() < 0.4 else block((2 * size, rng.uniform(1, 2) * size, high + _OVERLAP), at=at)
        )
        size, z = size * rng.uniform(0.4, 0.75), z + high
    return union(*parts)


def _pipes(rng: np.random.Generator) -> "Manifold":
    """Round bars that cross or meet at angles, with balls or discs on them: fittings, dumbbells, stands."""
    radius, length = rng.uniform(10, 26), rng.uniform(70, 140)
    parts = [cylinder(radius, length, axis="x")]
    for _ in range(int(rng.integers(1, 4))):
        at, other = rng.uniform(-0.5, 0.5) * length, radius * rng.uniform(0.6, 1.1)
        kind = int(rng.integers(3))
        if kind == 0:
            branch = rng.uniform(40, 90)
            part = cylinder(other, branch, axis="y", at=(0, branch / 2, 0)).rotate((0, 0, rng.uniform(-50, 50)))
            parts.append(part.translate((0.9 * at, 0, 0)))
        elif kind == 1:
            parts.append(cylinder(radius * rng.uniform(1.4, 2.4), rng.uniform(8, 30), axis="x", at=(at, 0, 0)))
        else:
            parts.append(
                body([(at - other, 0, 0, 3, 3), (at, 0, 0, 1.6 * radius, 1.6 * radius), (at + other, 0, 0, 3, 3)])
            )
    return union(*parts)


def _tiles(rng: np.random.Generator) -> "Manifold":
    """Squares of a grid that hang together, some of them higher: figures of bricks."""
    side, high = rng.uniform(16, 34), rng.uniform(10, 40)
    cells: list[tuple[int, int]] = [(0, 0), (1, 0), (2, 0), (int(rng.integers(3)), 1)]  # no row
    for _ in range(int(rng.integers(1, 5))):
        x, y = cells[int(rng.integers(len(cells)))]
        dx, dy = ((1, 0), (-1, 0), (0, 1), (0, -1))[int(rng.integers(4))]
        if (x + dx, y + dy) not in cells:
            cells.append((x + dx, y + dy))
    heights = high * rng.choice([1.0, rng.uniform(1, 2.2)], len(cells))
    return union(
        *(
            block((side + 0.2, side + 0.2, h), at=(side * x, side * y, h / 2))
            for (x, y), h in zip(cells, heights, strict=True)
        )
    )


_RULES = (_cutout, _bars, _frame, _spokes, _hull, _figure, _bent_rod, _steps, _pipes, _tiles)
