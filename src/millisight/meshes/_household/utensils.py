"""More tools and utensils with a long handle, lying on a table: the handle along x, the head at its right end."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.tools import grip_of
from millisight.meshes._shapes import (
    FLAT,
    UPRIGHT,
    bent,
    block,
    body,
    curve,
    cylinder,
    disc,
    ellipse,
    fillet,
    log_uniform,
    outline,
    plate,
    revolve,
    ring,
    rounded_block,
    shell,
    sphere,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

_LONGEST = 236.0  # of all [mm]


def _shaft(radius: float, start: float, stop: float) -> "Manifold":
    """A round rod along x."""
    return cylinder(radius, stop - start, axis="x", at=((start + stop) / 2, 0, 0))


def _turned_grip(rng: np.random.Generator, length: float, radius: float) -> "Manifold":
    """A handle from -length to 0: round, with flat sides, or fluted; drawn in before its end, or straight."""
    count = int(rng.integers(4, 10))
    area, around = disc(radius), ring(count, radius)
    kind = rng.integers(3)
    if kind == 1:
        area = fillet(outline(around), 0.12 * radius)
    elif kind == 2:
        for place in around:
            area = area - disc(radius * rng.uniform(0.15, 0.22), tuple(place))
    waist, neck, back = rng.uniform((0.6, 0.5, 0.6), (1, 1, 1))
    line = [(back, -1), (1, -0.93), (1, -0.4), (waist, -0.22), (max(waist, neck), -0.1), (neck, 0)]
    profile = [(0, -length), *((r * radius, x * length) for r, x in line), (0, 0)]
    return plate(area, length, z=-length / 2).rotate((0, 90, 0)) ^ revolve(profile, axis="x")


def _any_grip(rng: np.random.Generator, length: float, radius: float) -> "Manifold":
    """A handle from -length to 0: smooth, turned, or a board with two rivets."""
    kind = rng.integers(3)
    if kind == 0:
        return _turned_grip(rng, length, radius)
    if kind == 1:
        return grip_of(rng, length, radius, radius * rng.uniform(0.5, 1))
    high, slim = radius * rng.uniform(0.7, 1.3), rng.uniform(0.55, 1)
    edge = [(-1, -1), (-1, 1), (-0.8, 1), (-0.4, slim), (0, 0.85), (0, -0.85), (-0.4, -slim), (-0.8, -0.9)]
    board = plate(fillet(outline(np.array(edge) * (length, radius)), 0.35 * radius), high)
    rivets = [cylinder(0.25 * radius, high + 1.5, at=(-x * length, 0, 0)) for x in rng.uniform((0.15, 0.6), (0.3, 0.8))]
    return union(board, *rivets)


def _jaws(rng: np.random.Generator, radius: float) -> "CrossSection":
    """A spanner's end about the origin, open to the right: two jaws, one of them adjustable, or a ring."""
    kind, gap = rng.integers(3), rng.uniform(0.4, 0.58)
    if kind == 0:
        slot = outline([(-0.35, -gap), (2, -gap), (2, gap), (-0.35, gap), (-0.6, 0)])
        return (disc(1) - slot).rotate(rng.choice([0, 15, -15, 30])).scale((radius, radius))
    if kind == 1:
        count = int(rng.choice([6, 12, 40]))
        return disc(radius) - outline(ring(count, radius * rng.uniform(0.55, 0.75)))
    low, far = -gap, -gap + rng.uniform(0.15, 1.1)
    fixed = [(-1.1, -0.5), (-0.3, -1.1), (0.9, -1), (1.1, low), (-0.35, low), (-0.35, 0.9), (-1.1, 0.5)]
    moved = [(-0.5, far), (1.05, far), (0.9, far + 0.45), (-0.1, far + 0.75), (-0.5, far + 0.6)]
    return (outline(fixed) + outline(moved)).rotate(rng.uniform(0, 25)).scale((radius, radius))


def _spanner(rng: np.random.Generator) -> "Manifold":
    """A flat bar with an open, an adjustable or a ring end, mostly at both its ends."""
    length = log_uniform(rng, 75, _LONGEST)
    radius, share = length * rng.uniform(0.07, 0.13), rng.uniform(0.7, 1)
    thick, back = max(radius * rng.uniform(0.35, 0.8), 3.5), radius * share
    double = rng.random() < 0.65
    start = 2 * radius - length + (0.3 * back if double else 0)  # the heads' own reach apart
    wide, end = radius * rng.uniform(0.3, 0.45), back * rng.uniform(0.3, 0.45 if double else 0.6)
    bar = outline([(-0.7 * radius, -wide), (-0.7 * radius, wide), (start, end), (start, -end)])
    if not double:
        bar = bar + disc(end, (start, 0)) - disc(0.5 * end, (start, 0))
    handle = plate(bar, thick * rng.uniform(0.5, 0.9))
    parts = [handle, plate(_jaws(rng, radius), thick).rotate((0, rng.choice([0, rng.uniform(-15, 0)]), 0))]
    if double:
        parts.append(plate(_jaws(rng, back), thick * share).rotate((0, 0, 180)).translate((start - 0.7 * back, 0, 0)))
    return union(*parts)


def _driver(rng: np.random.Generator) -> "Manifold":
    """A grip, and a rod with a flattened end, a chisel's or a file's blade, or a scraper that widens to its edge."""
    length = log_uniform(rng, 65, _LONGEST)
    grip, radius = length * rng.uniform(0.3, 0.62), np.clip(length * rng.uniform(0.05, 0.1), 5, 19)
    reach, kind = length - grip, rng.integers(4)
    handle = _any_grip(rng, grip, radius) if kind > 1 else _turned_grip(rng, grip, radius)
    if kind < 2:
        rod = radius * rng.uniform(0.18, 0.42)
        tip, flat = rod * rng.uniform(0.4, 1.6), rod * rng.uniform(0.2, 0.5)
        rows = [(-2, rod, rod), (0.8 * reach, rod, rod), (0.9 * reach, tip, 0.8 * rod), (reach, tip, flat)]
        collar = _shaft(rng.uniform(1.1, 2) * rod, -2, rng.uniform(1, 0.15 * reach))
        return union(handle, body([(x, 0, 0, y, z) for x, y, z in rows], exponent=rng.choice([2, 4])), collar)
    neck, begins = radius * rng.uniform(0.3, 0.6), rng.uniform(0.05, 0.35)
    full, wide, thick = rng.uniform(0.5, 0.97), min(radius + reach * rng.uniform(0.15, 0.6), 55), rng.uniform(1.5, 3)
    if kind == 2:
        full, wide, thick = begins + 0.1, radius * rng.uniform(0.4, 1.3), rng.uniform(3, 6)
    half = np.array([(-2, neck), (begins * reach, neck), (full * reach, wide), (reach, wide)])
    blade = plate(outline([*half, *(half[::-1] * (1, -1))]), thick)
    turn = rng.uniform(0.25, 0.6)  # of the bevel
    bevel = reach * np.sin(turn) + (0.6 - thick / 2) * np.cos(turn)
    return union(handle, blade.trim_by_plane((-np.sin(turn), 0, -np.cos(turn)), -bevel))


def _hammer(rng: np.random.Generator) -> "Manifold":
    """A handle through a head across it: a face, and a ball, a wedge, a claw or a second face."""
    length = log_uniform(rng, 120, _LONGEST)
    wide, grip = length * rng.uniform((0.25, 0.35), (0.45, 0.8))
    half, radius = wide * rng.uniform(0.11, 0.18), np.clip(length * rng.uniform(0.04, 0.065), 6, 14)
    reach = length - grip - half
    slim, face = min(radius, half) * rng.uniform(0.5, 0.85), half * rng.uniform(0.95, 1.4)
    near, long = wide * rng.uniform(0.1, 0.2, 2)
    head = rounded_block((2 * half, 2.2 * near, 2 * half), 0.25 * half)
    neck = cylinder(0.75 * half, wide / 2, axis="y", at=(0, wide / 4, 0))
    end = block((1.8 * face, long, 1.8 * face)) if rng.random() < 0.3 else cylinder(face, long, axis="y")
    side = union(neck, end.translate((0, wide / 2 - long / 2, 0)))
    kind, other = rng.integers(4), side.mirror((0, 1, 0))
    if kind == 0:
        other = union(neck.mirror((0, 1, 0)), sphere(1.1 * half, at=(0, 1.1 * half - wide / 2, 0)))
    elif kind == 1:
        along, edge = half * rng.uniform(0.9, 1.3), rng.uniform(0.08, 0.35) * half
        wedge = [head, block((2 * along, 1, 2 * edge), at=(0, 0.5 - wide / 2, 0))]
        other = head.batch_hull(wedge).rotate((0, rng.choice([0, 90]), 0))
    elif kind == 2:
        droop = rng.uniform(0.05, 0.25) * wide
        path = curve([(0, 0, 0), (0, -0.2 * wide, 0), (-0.35 * droop, -0.38 * wide, 0), (-droop, -wide / 2, 0)])
        radii = np.column_stack([np.linspace(0.8, 0.25, len(path)), np.linspace(0.8, 1.1, len(path))]) * half
        other = tube(path, radii, normal=FLAT) - block((wide, 0.3 * wide, 0.5 * half), at=(0, -0.42 * wide, 0))
    handle = union(_any_grip(rng, grip, radius), _shaft(slim, -2, reach + 1.1 * half))
    return union(handle, *(part.translate((reach, 0, 0)) for part in (head, side, other)))


def _saw(rng: np.random.Generator) -> "Manifold":
    """A toothed blade that narrows to its end, or one held in a frame, and an open or closed grip."""
    length = log_uniform(rng, 130, _LONGEST)
    grip, wide, narrow = length * rng.uniform((0.28, 0.14, 0.05), (0.38, 0.26, 0.12))
    reach, high, pitch = length - grip, rng.uniform(10, 22), rng.uniform(3, 8)
    edge = [(-0.2, -1), (-0.1, 0.9), (-0.5, 1), (-0.95, 1.1), (-0.93, 0.3), (-0.8, -0.3), (-1, -1), (-0.6, -1.1)]
    tall = max(wide, rng.uniform(0.6, 1) * grip) / 2
    edge = curve(edge * rng.uniform(0.88, 1.08, (8, 1)) * (grip, tall), closed=True, along=2)
    ends = np.array([(-0.4, -0.9), (-0.4, 0.8), (0, 0.8), (0, -0.9)])
    area = outline(edge) + outline(ends * (grip, tall))
    if rng.random() < 0.75:
        area = area - outline(ellipse(0.2 * grip, rng.uniform(0.5, 0.62) * tall, at=(-0.52 * grip, -0.1 * tall)))
    handle, low = plate(fillet(area, 2), high), -0.8 * tall
    if rng.random() < 0.65:
        x = np.arange(0, reach, pitch)
        teeth = np.column_stack([np.repeat(x, 2), low + np.tile([0, 0.5 * pitch], len(x))])
        back = [(reach, low + narrow), (0, low + wide), (-0.3 * grip, low + wide), (-0.3 * grip, low)]
        return union(handle, plate(outline([*teeth, (reach, low), *back]), rng.uniform(1.5, 2.5)))
    rod, deep = rng.uniform(5, 10), wide * rng.uniform(0.8, 1.5)
    corners = [(-0.2 * grip, 0), (0.08 * reach, deep), (reach - rod / 2, deep), (reach - rod / 2, 0)]
    frame = plate(strip(corners, rod), rng.uniform(0.3, 0.8) * high).translate((0, low + 2, 0))
    band = block((reach + 0.2 * grip - rod, rng.uniform(5, 12), 1.8), at=(reach / 2 - 0.1 * grip, low + 2, 0))
    return union(handle, frame, band)


def _knife(rng: np.random.Generator) -> "Manifold":
    """A grip, a collar now and then, and a flat blade: pointed, curved, or a cleaver's; its edge smooth or wavy."""
    length = log_uniform(rng, 90, _LONGEST)
    blade, deep = length * rng.uniform((0.45, 0.05), (0.65, 0.14))
    half, spine = np.clip(length * rng.uniform(0.04, 0.07), 5, 15), length * rng.uniform(0.02, 0.05)
    if rng.random() < 0.2:
        deep, edge = 2 * deep, [(1, 0.95), (1, -1), (0.9, -1), (0, -1)]
    else:
        tip, belly = rng.uniform((-1, -1.05), (0.9, -0.85))
        edge = [(0.97, tip), (1, tip - 0.1), (0.85, 0.6 * tip - 0.45), (0.55, belly), (0.05, -1), (0.02, -0.6)]
    corners = [(x * blade, y * (spine if y > 0 else deep)) for x, y in edge]
    start = [(-2, -0.4 * spine), (-2, spine), (rng.uniform(0.5, 0.8) * blade, spine)]
    area = fillet(outline([*start, *corners]), 0.8)
    if rng.random() < 0.3:
        for x in np.arange(0.1 * blade, 0.95 * blade, 7):
            area = area - disc(2.2, (x, -deep))
    parts = [_any_grip(rng, length - blade, half), plate(area, rng.uniform(1.5, 3))]
    if rng.random() < 0.4:
        parts.append(rounded_block((rng.uniform(4, 10), *(half * rng.uniform((1.8, 0.8), (2.6, 1.6)))), 1.5))
    return union(*parts)


def _cutlery(rng: np.random.Generator) -> "Manifold":
    """A spoon or a fork of one sheet, its neck raised, its head hollow; or a garden fork with a thick grip."""
    length, kind = log_uniform(rng, 100, _LONGEST), rng.integers(5)
    head, half = length * rng.uniform((0.2, 0.055), (0.32, 0.1))
    neck, count, stem = length * rng.uniform(0.012, 0.025), int(rng.integers(2, 5)), length - head
    if kind == 4:
        rod, lift, grip = rng.uniform(2, 4), rng.uniform(0, 20), stem * rng.uniform(0.6, 0.8)
        spread = np.linspace(-1, 1, max(count, 3)) * 1.6 * half
        knots = [[(-5, 0, 0), (0.15 * head, y, 0), (0.6 * head, y, -0.25 * lift), (head, 0.9 * y, 0)] for y in spread]
        tines = [tube(curve(k, step=4), [(rod, 0.8 * rod)], normal=FLAT, around=16) for k in knots]
        path = curve([(2, 0, 0), (0.3 * (grip - stem), 0, 0), (grip - stem - 5, 0, lift)])
        handle = _any_grip(rng, grip, rng.uniform(8, 15))
        return union(handle.translate((grip - stem, 0, lift)), tube(path, 1.3 * rod, normal=UPRIGHT), *tines)
    end, widest = length * rng.uniform(0.02, 0.055), rng.uniform(0.4, 0.65)
    handle = strip([(-stem + end, 0), (-0.3 * stem, 0), (0.15 * head, 0)], [2 * end, 2 * neck, 2 * neck])
    if kind < 2:
        turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        along = (1 + np.cos(turn)) / 2 * head
        bowl = outline(np.column_stack([along, half * np.sin(turn) * (1 + (1 - 2 * widest) * np.cos(turn))]))
    else:
        sheet = [(0, neck), (0.2 * head, 0.75 * half), (0.35 * head, half), (head, 0.9 * half)]
        bowl = outline([*sheet, *((x, -y) for x, y in sheet[::-1])])
        gap = half * rng.uniform(0.35, 0.55) * 2 / count
        for y in np.linspace(-1, 1, count + 1)[1:-1] * half:
            bowl = bowl - strip([(rng.uniform(0.35, 0.42) * head, y), (1.2 * head, y)], gap)
    depth, rise = half * rng.uniform(0.2, 0.8) if kind < 2 else rng.uniform(0, 4), length * rng.uniform(0, 0.07)

    def lift(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        raised = rise * np.exp(-(((x + 0.1 * stem) / (0.35 * stem)) ** 2))
        return raised - depth * np.clip(1 - (1.8 * x / head - 0.9) ** 2 - (0.9 * y / half) ** 2, 0, 1)

    return bent(plate(handle + bowl, rng.uniform(1.8, 3.2)), lift)


def _turner(rng: np.random.Generator) -> "Manifold":
    """A flat head with slots or holes, or without; a neck that rises from it; a grip."""
    length = log_uniform(rng, 120, _LONGEST)
    head, half = length * rng.uniform((0.25, 0.09), (0.4, 0.2))
    near, lift, grip = half * rng.uniform(0.4, 1), rng.uniform(4, 45), length * rng.uniform(0.3, 0.45)
    area = fillet(outline([(0, -near), (head, -half), (head, half), (0, near)]), 0.2 * near)
    count, kind, start = int(rng.integers(2, 6)), rng.integers(4), rng.uniform(0.2, 0.35)
    for y in np.linspace(-1, 1, count) * 0.65 * min(near, half):
        wide = min(near, half) * 0.6 / count
        if kind < 2:
            area = area - strip([(start * head, y), (rng.uniform(0.75, 0.85) * head, 1.2 * y)], wide)
        elif kind == 2:
            for x in np.linspace(start, 0.85, 4) * head:
                area = area - disc(wide, (x, y))
    flange = rng.choice([0, rng.uniform(0, 0.02)])
    sheet = bent(plate(area, rng.uniform(1.8, 4)), lambda x, y: flange * y**2)
    stem, rod = length - head - grip, rng.uniform(2.5, 4.5)
    knots = [(0.12 * head, 0), (-0.15 * stem, 0.3 * rod), (-0.6 * stem, 0.85 * lift), (-stem - 4, lift)]
    path = curve([(x, 0, z) for x, z in knots])
    neck = tube(path, [(0.7 * rod, rng.uniform(1, 2.2) * rod)], normal=UPRIGHT)
    handle = _any_grip(rng, grip, rng.uniform(6, 13)).rotate((0, rng.uniform(0, 12), 0))
    return union(sheet, neck, handle.translate((-stem, 0, lift)))


def _hoop(rng: np.random.Generator) -> "Manifold":
    """A grip with a ring: empty, or around a lens, a mirror, strings, or a bowl with holes."""
    length = log_uniform(rng, 75, _LONGEST)
    along, kind = length * rng.uniform(0.15, 0.27), rng.integers(5)
    across, rim = along * rng.uniform(0.7, 1.15), min(rng.uniform(1.8, 5), 0.13 * along)
    neck, radius = length * rng.uniform(0.02, 0.2), np.clip(length * rng.uniform(0.035, 0.07), 4, 14)
    line = np.pad(ellipse(along, across), ((0, 0), (0, 1)))
    parts = [tube(line, [(rim, rim * rng.uniform(0.8, 1.8))], normal=FLAT, closed=True)]
    if kind in (1, 2):
        edge, bulge = rng.uniform((0.6, 1.2), (1.5, 5))
        parts.append(revolve([(0, -bulge), (1, -edge), (1, edge), (0, bulge)]).scale((along, across, 1)))
    elif kind == 3:
        pitch = rng.uniform(6, 14) * np.arange(-9, 10)
        web = [block((1.6, 2 * across, 1.6), at=(x, 0, 0)) for x in pitch]
        web += [block((2 * along, 1.6, 1.6), at=(0, y, 0)) for y in pitch]
        parts.append(union(*web) ^ plate(outline(line[:, :2]), 3))
    elif kind == 4:
        depth, wall, pore = across * rng.uniform(0.1, 0.7), rng.uniform(1.2, 2.2), rng.uniform(0.04, 0.09)
        ring = [(0.3, a) for a in np.linspace(0, 6.28, 7)[1:]] + [(0.6, a) for a in np.linspace(0, 6.28, 12)[1:]]
        holes = union(*(cylinder(pore, 4, at=(r * np.cos(a), r * np.sin(a), 0)) for r, a in ring))
        bowl = shell(curve([(0, -depth), (0.6 * along, -0.75 * depth), (along, 0)], along=2), wall)
        parts.append(bowl.scale((1, across / along, 1)) - holes.scale((along, across, 40)))
    grip = max(length - 2 * along - neck - rim, 0.25 * length)
    parts += [_shaft(min(rim, 0.7 * radius), -along - neck - 3, -along + 0.3 * rim)]
    return union(*parts, _any_grip(rng, grip, radius).translate((-along - neck, 0, 0)))


def _torch(rng: np.random.Generator) -> "Manifold":
    """A torch: a ringed tube, a wider head, a switch. Or a marker: a tube, a cap with a clip, a nib."""
    length = log_uniform(rng, 75, _LONGEST)
    if rng.random() < 0.45:
        radius, cap = min(length * rng.uniform(0.028, 0.075), 13), length * rng.uniform(0.22, 0.42)
        slim, over, nib = radius * rng.uniform((0.6, 1.02, 0.1), (1, 1.18, 0.4))
        side = [(slim, 0), (radius, 0.15), (radius, 0.75), (0.6 * radius, 0.88), (nib, 0.92), (nib, 1)]
        pen = revolve([(0, 0), *((r, x * length) for r, x in side), (0, length)], axis="x")
        at = rng.choice([0.0, length - cap])  # over either end, the nib free
        return union(
            pen,
            _shaft(over, at, at + cap),
            rounded_block((0.8 * cap, 0.5 * over, 3), 0.7, at=(at + 0.45 * cap, 0, over + 0.5)),
        )
    radius, long = length * rng.uniform((0.05, 0.16), (0.1, 0.35))
    wide, body_end, cone = min(radius * rng.uniform(1.2, 2.1), 40), length - long, long * rng.uniform(0.25, 0.8)
    rings = []
    for x in np.arange(0.12 * length, 0.85 * body_end, rng.uniform(7, 25)):
        rings += [(radius, x), (radius - 1.2, x + 0.5), (radius - 1.2, x + 2.5), (radius, x + 3)]
    front = [(radius, body_end), (wide, body_end + cone), (wide, length), (0.8 * wide, length - 3), (0, length - 3)]
    torch = revolve([(0, 0), (0.9 * radius, 0), (radius, 3), *rings, *front], axis="x")
    lug = rounded_block((0.12 * length, 0.7 * radius, 5), 1.2, at=(body_end * rng.uniform(0.6, 0.85), 0, radius))
    return union(torch, lug.rotate((rng.uniform(-180, 180), 0, 0)))


def _nutcracker(rng: np.random.Generator) -> "Manifold":
    """Two levers from a hinge at their end, closed or apart, with teeth beside it."""
    length, high = log_uniform(rng, 90, 230), rng.uniform(6, 18)
    spread, wide = length * rng.uniform((0.03, 0.025), (0.16, 0.05))
    bulge, gap = length * rng.uniform(0.04, 0.09), wide * rng.uniform(0.9, 1.6)
    rows = [(0, 0.8 * wide, wide), (-0.12 * length, bulge, 1.3 * wide), (-0.35 * length, gap, 1.2 * wide)]
    rows += [(-0.7 * length, 0.7 * spread + wide, 1.6 * wide), (wide - length, spread + wide, wide)]
    path = curve(rows, along=2)
    lever = strip(path[:, :2], path[:, 2])
    for x in np.linspace(-0.25, -0.08, int(rng.integers(3, 9))) * length:
        lever = lever - disc(0.25 * wide, (x, np.interp(-x, -path[:, 0], path[:, 1] - path[:, 2] / 2)))
    pin = cylinder(wide * rng.uniform(1, 1.5), high + 3)
    return union(plate(lever + lever.mirror((0, 1)), high), pin)


UTENSILS = (_spanner, _driver, _hammer, _saw, _knife, _cutlery, _turner, _hoop, _torch, _nutcracker)
"""What draws each kind."""
