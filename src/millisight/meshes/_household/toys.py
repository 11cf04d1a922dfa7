"""More things of no class: animals, toys, a hand, a spray bottle, fruit, rope, a funnel, a padlock, an iron."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    FLAT,
    UPRIGHT,
    block,
    body,
    curve,
    cylinder,
    ellipse,
    fillet,
    log_uniform,
    outline,
    plate,
    revolve,
    rounded_block,
    shell,
    smooth_outline,
    sphere,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

_Point = np.ndarray | tuple[float, float, float]


def _egg(half: _Point, at: _Point, turn: _Point = (0, 0, 0)) -> "Manifold":
    """An ellipsoid of these half axes, turned by these angles [degrees], around a point."""
    return sphere(1).scale([*half]).rotate([*turn]).translate([*at])


def _limb(start: _Point, end: _Point, first: float, last: float) -> "Manifold":
    """A round rod between two points with round ends, of these radii."""
    ends = [sphere(first).translate([*start]), sphere(last).translate([*end])]
    return ends[0].batch_hull(ends)


def _animal(rng: np.random.Generator) -> "Manifold":
    """An animal on four legs, of any build; or a bird that swims or sits."""
    if rng.random() < 0.4:
        return _bird(rng)
    length = log_uniform(rng, 45, 165)
    deep, legs, neck, head, foot = length * rng.uniform((0.13, 0.1, 0.02, 0.1, 0.025), (0.24, 0.5, 0.35, 0.18, 0.06))
    wide, back, thigh = deep * rng.uniform(0.7, 1.1), legs + deep, foot * rng.uniform(1, 1.9)
    rows = [(-0.4, 0.35), (-0.3, rng.uniform(0.75, 1.05)), (0, rng.uniform(0.75, 1)), (0.26, rng.uniform(0.8, 1.1))]
    stations = [(x * length, 0, back, s * wide, s * deep) for x, s in [*rows, (0.38, 0.5)]]
    parts = [body(stations, rounding=(0.2 * deep, 0.2 * deep))]
    for x in (-0.29 * length, 0.26 * length):
        hoof = x + rng.uniform(-0.08, 0.08) * length
        leg = _limb((x, 0.6 * wide, back - 0.3 * deep), (hoof, 0.6 * wide, foot), thigh, foot)
        parts += [leg, leg.mirror((0, 1, 0))]
    rise = np.radians(rng.uniform(10, 85))
    start = np.array([0.28 * length, 0, back + 0.2 * deep])
    end = start + (neck + 0.6 * head) * np.array([np.cos(rise), 0, np.sin(rise)])
    parts.append(_limb(start, end, 0.55 * deep, head * rng.uniform(0.5, 0.85)))
    parts.append(_egg((head * rng.uniform(0.9, 1.3), 0.75 * head, 0.8 * head), np.add(end, (0.3 * head, 0, 0))))
    snout = np.add(end, head * rng.uniform((0.9, 0, -0.8), (2, 0, 0)))
    parts.append(_limb(end, snout, 0.6 * head, head * rng.uniform(0.2, 0.5)))
    ear = rng.uniform(0.3, 1.3)
    flap = _egg(head * np.array([0.2, rng.uniform(0.2, 0.5), ear]), (0, 0, 0.6 * ear * head))
    flap = flap.rotate((rng.uniform(-70, 40), 0, 0)).translate(np.add(end, (0, 0.4 * head, 0.4 * head)))
    tail = (-0.36 * length, 0, back + 0.2 * deep), (-0.5 * length, 0, back + rng.uniform(-0.9, 1.2) * deep)
    parts.append(_limb(*tail, *(foot * rng.uniform(0.4, 1.3, 2))))
    return _no_higher(union(*parts, flap, flap.mirror((0, 1, 0))))


def _no_higher(solid: "Manifold", most: float = 112.0) -> "Manifold":
    """The solid, made smaller where it is too high."""
    _, _, low, _, _, high = solid.bounding_box()
    return solid.scale([min(1, most / (high - low))] * 3)


def _bird(rng: np.random.Generator) -> "Manifold":
    """A duck, a hen or a small bird: a round body, flat below, a head on a neck, a beak, a tail, wings."""
    length = log_uniform(rng, 42, 140)
    deep, wide, head, neck, beak = length * rng.uniform((0.24, 0.2, 0.12, 0.02, 0.08), (0.34, 0.32, 0.2, 0.4, 0.16))
    rows = [(-0.5, 0.15, 0.5), (-0.35, 0.6, 0.2), (0, 1, 0), (0.25, 0.9, 0.05), (0.4, 0.45, 0.2)]
    stations = [(x * length, 0, z * deep, s * wide, s * deep) for x, s, z in rows]
    trunk = body(stations, rounding=(0.1 * deep, 0.3 * deep)).trim_by_plane((0, 0, 1), -0.7 * deep)
    start = np.array([0.22 * length, 0, 0.4 * deep])
    top = np.add(start, (rng.uniform(0, 0.12) * length, 0, 0.5 * deep + 0.5 * head + neck))
    bill = beak * np.array([1, 0.5, rng.uniform(0.12, 0.45)])
    wing = _egg((0.3 * length, 0.16 * wide, 0.45 * deep), (-0.08 * length, 0.92 * wide, 0.2 * deep), (0, 20, 6))
    parts = [trunk, _limb(start, top, 0.5 * wide, 0.6 * head), _egg((head, head, head), top), wing]
    parts.append(_egg(bill, np.add(top, (head + 0.3 * beak, 0, -0.15 * head))))
    if rng.random() < 0.3:
        parts.append(_egg((0.7 * head, 0.15 * head, 0.5 * head), np.add(top, (0, 0, head))))
    return _no_higher(union(*parts, wing.mirror((0, 1, 0))))


def _vehicle(rng: np.random.Generator) -> "Manifold":
    """A toy train's engine: a frame on wheels, a boiler with a dome and a chimney, a cab. Or a plane."""
    if rng.random() < 0.5:
        return _plane(rng)
    length = log_uniform(rng, 60, 175)
    wide, wheel, boiler, cab = length * rng.uniform((0.24, 0.07, 0.1, 0.22), (0.38, 0.12, 0.15, 0.38))
    base, deck = 1.4 * wheel, max(0.08 * length, 4)
    level, roof = base + deck + 0.9 * boiler, base + deck + boiler * rng.uniform(2, 2.8)
    high, pipe = boiler * rng.uniform(0.8, 1.7), boiler * rng.uniform(0.25, 0.45)
    stack = [(0, 0), (pipe, 0), (pipe, boiler + 0.6 * high), (pipe * rng.uniform(1, 1.7), boiler + high)]
    parts = [
        rounded_block((length, 0.7 * wide, deck), 1, at=(0, 0, base + deck / 2)),
        cylinder(boiler, 0.92 * length - cab, axis="x", at=(0.5 * cab, 0, level)),
        block((cab, wide, roof - base), at=((cab - length) / 2, 0, (roof + base) / 2)),
        rounded_block((1.25 * cab, 1.15 * wide, 0.06 * length), 1, at=((cab - length) / 2, 0, roof)),
        revolve([*stack, (0, boiler + high)]).translate((0.36 * length, 0, level)),
        _egg((pipe, pipe, 1.3 * boiler), (rng.uniform(0, 0.2) * length, 0, level)),
    ]
    for x in np.linspace(-0.38, 0.38, int(rng.integers(2, 5))) * length:
        parts.append(cylinder(wheel, wide * rng.uniform(0.85, 1), axis="y", at=(x, 0, wheel)))
    return _no_higher(union(*parts))


def _plane(rng: np.random.Generator) -> "Manifold":
    """A fuselage, swept or straight wings, a tail, with engines or a propeller now and then."""
    length = log_uniform(rng, 60, 220)
    half, chord, span, sweep = length * rng.uniform((0.05, 0.12, 0.3, -0.02), (0.1, 0.26, 0.52, 0.3))
    thick, at, level = max(0.16 * chord, 2.2), length * rng.uniform(-0.02, 0.14), half * rng.uniform(-0.6, 0.7)
    rows = [(-0.5, 0.25, 0.5), (-0.25, 0.7, 0.2), (0.1, 1, 0), (0.35, 0.9, 0), (0.5, rng.uniform(0.1, 0.6), -0.1)]
    hull = body([(x * length, 0, z * half, s * half, s * half) for x, s, z in rows], rounding=(1, 2))
    flat = np.array([(0.5, 0), (0, 1), (rng.uniform(-1, -0.5), 1), (-0.5, 0)])
    half_wing = outline(flat * (chord, span) - np.outer(flat[:, 1], (sweep, 0)))
    wing = plate(half_wing + half_wing.mirror((0, 1)), thick)
    tail = wing.scale((0.55, rng.uniform(0.3, 0.5), 1)).translate((-0.4 * length, 0, 0.5 * half))
    fin = outline([(-0.3, 0), (-0.42, 1), (-0.5, 1), (-0.5, 0)])
    fin = plate(fin.scale((length, length * rng.uniform(0.12, 0.22))), thick).rotate((90, 0, 0))
    parts = [hull, tail, wing.translate((at, 0, level)), fin.translate((0, 0, 0.4 * half))]
    if rng.random() < 0.5:
        pod = cylinder(0.5 * half, chord, axis="x", at=(at - 0.3 * sweep, 0.4 * span, level - 0.4 * half))
        parts += [pod, pod.mirror((0, 1, 0))]
    else:
        blade = block((2.5, 3.2 * half, 0.5 * half)).rotate((rng.uniform(0, 90), 0, 0))
        parts.append(blade.translate((0.5 * length - 1.5, 0, -0.1 * half)))
    return union(*parts)


def _spray_bottle(rng: np.random.Generator) -> "Manifold":
    """On its side: a body with shoulders, a neck, a head with a nozzle to one side and a trigger below it."""
    length = log_uniform(rng, 110, 236)
    half, flat, long = length * rng.uniform(0.13, 0.2), rng.uniform(0.55, 1), length * rng.uniform(0.55, 0.68)
    neck, waist = half * rng.uniform(0.25, 0.42), rng.uniform(0.75, 1)
    rows = [(0, 0.95), (0.35, 1), (0.6, waist), (0.75, rng.uniform(0.6, 0.9)), (0.92, 0.4), (1.08, 0.35)]
    trunk = [(x * long, 0, 0, half * s, max(half * flat * s, neck)) for x, s in rows]
    thick, top, nozzle = half * rng.uniform(0.25, 0.4), length - long, half * rng.uniform(0.9, 1.6)
    line = np.array([(0.35, -0.6), (0.55, 0.3), (0.6, 1), (0.95, 1), (1, 0.2), (1, -0.5), (0.8, -0.9)])
    head = plate(fillet(outline(line * (top, nozzle) + (long, 0)), 0.08 * top), 2 * thick)
    knots = [(0.6, 0.35), (0.3, 0.75), (-rng.uniform(0, 0.25), rng.uniform(0.6, 1))]
    path = curve([(long + x * top, y * nozzle, 0) for x, y in knots])
    return union(
        body(trunk, exponent=rng.uniform(2, 4), rounding=(0.15 * half, 0)),
        cylinder(1.25 * neck, 0.35 * top, axis="x", at=(long + 0.15 * top, 0, 0)),
        cylinder(0.5 * neck, 0.6 * top, axis="x", at=(long + 0.3 * top, 0, 0)),
        head,
        cylinder(0.6 * thick, 0.3 * nozzle, axis="y", at=(long + 0.78 * top, 1.08 * nozzle, 0)),
        tube(path, [rng.uniform((1.5, 0.4), (3, 0.9)) * (1, thick)], normal=FLAT),
    )


def _fruit(rng: np.random.Generator) -> "Manifold":
    """One to three bananas, or a pear, an aubergine, a carrot on its side with its stem."""
    if rng.random() < 0.5:
        length, bend = log_uniform(rng, 80, 200), np.radians(rng.uniform(25, 100))
        radius, turn = length * rng.uniform(0.07, 0.11), np.linspace(-0.5, 0.5, 60)
        swell = np.interp(turn, (-0.5, -0.42, -0.38, -0.2, 0.25, 0.44, 0.5), (0.25, 0.28, 0.5, 0.95, 1, 0.55, 0.25))
        path = np.column_stack([np.sin(turn * bend), np.cos(turn * bend) - 1, 0 * turn]) * length / bend
        one = tube(path, swell * radius, normal=FLAT, around=int(rng.choice([10, 40])))
        turns = np.arange(rng.integers(1, 4)) * rng.uniform(10, 18)
        return union(*(one.translate(-path[0]).rotate((0, 0, a)).translate((0, 0, 0.15 * a)) for a in turns))
    length = log_uniform(rng, 55, 200)
    radius, top, waist = length * rng.uniform((0.13, 0.04, 0.1), (0.38, 0.2, 0.3))
    side = [(0, 0), (0.8 * radius, 0.08 * length), (radius, 0.3 * length), (waist, 0.68 * length), (top, 0.93 * length)]
    line = curve([*side, (0.3 * top, length)], along=2)
    stalk = tube(curve(length * np.array([(0, 0, 0.9), (0, 0, 1.04), (0.12, 0, 1.15)])), 0.2 * top + 1, normal=UPRIGHT)
    tilt = 90 + np.degrees(np.arctan2(radius - max(waist, top), 0.45 * length))
    return union(revolve([*line, (0, length)]), stalk).rotate((0, 0, rng.uniform(0, 360))).rotate((0, tilt, 0))


def _coil(rng: np.random.Generator) -> "Manifold":
    """A coil of rope or cable with a tie, a free end and a plug now and then; or a chain."""
    if rng.random() < 0.4:
        return _chain(rng)
    radius = log_uniform(rng, 26, 85)
    rod, count = np.clip(radius * rng.uniform(0.05, 0.13), 1.8, 7), int(rng.integers(3, 9))
    spread, long, loops = rod * rng.uniform(0.6, 1.7), rng.uniform(0.7, 1), []
    high, middle = 1.2 * spread * count**0.5, radius - rod - spread
    for _ in range(count):
        size = (middle + rng.uniform(-1, 1, 2) * spread) * (1, long)
        loop = tube(np.pad(ellipse(*size, count=72), ((0, 0), (0, 1))), rod, normal=FLAT, closed=True, around=14)
        loops.append(loop.rotate(rng.uniform(-3, 3, 3)).translate((0, 0, rng.uniform(0, high))))
    tie = (spread * 1.4 + 1.3 * rod, rng.uniform(4, 14), max(high / 2, 1) + 1.6 * rod)
    start = (0.95 * middle / radius, 0.3 * long * middle / radius)
    free = radius * np.array([start, (0.85, -0.2), (0.9, -0.7), (rng.uniform(0.9, 1.5), -1.1)])
    path = curve(np.column_stack([free, np.full(4, high / 2)]), step=4)
    parts = [*loops, _egg(tie, (middle, 0, high / 2)), tube(path, rod, normal=FLAT, around=14)]
    if rng.random() < 0.5:
        parts.append(rounded_block((4 * rod, 5 * rod, 3 * rod), 0.6 * rod).translate([*path[-1]]))
    return union(*parts)


def _chain(rng: np.random.Generator) -> "Manifold":
    """Links of round wire, each turned against the one before, in a line that bends."""
    half = log_uniform(rng, 9, 28)
    rod, wide = half * rng.uniform((0.16, 0.5), (0.26, 0.75))
    ring = np.pad(ellipse(half - rod, wide - 0.5 * rod, exponent=2.6, count=48), ((0, 0), (0, 1)))
    link = tube(ring, rod, normal=FLAT, closed=True, around=14)
    step, heading, at, links, bend = 2 * half - 3.7 * rod, 0.0, np.zeros(3), [], rng.uniform(-14, 14)
    for i in range(min(int(rng.integers(4, 15)), int(225 / step) - 1)):
        links.append(link.rotate((45 + 90 * (i % 2), 0, heading)).translate([*at]))
        turn = np.clip(bend + rng.uniform(-8, 8), -16, 16)
        along = np.radians(heading + turn / 2)
        at, heading = at + step * np.array([np.cos(along), np.sin(along), 0]), heading + turn
    return union(*links)


def _bricks(rng: np.random.Generator) -> "Manifold":
    """Toy bricks with studs, plugged into each other as steps."""
    pitch = log_uniform(rng, 10.5, 22)
    high, stud, rise = pitch * rng.uniform((0.4, 0.27, 0.18), (1.25, 0.34, 0.28))
    parts, at, cells = [], np.zeros(2), rng.integers((3, 1), (9, 4))
    for level in high * np.arange(min(int(rng.integers(1, 6)), max(int(95 // high), 1))):
        parts.append(block((*(cells * pitch), high + 0.2), at=(*((at + cells / 2) * pitch), level + high / 2)))
        for place in np.ndindex(*cells):
            centre = (at + np.add(place, 0.5)) * pitch
            parts.append(cylinder(stud, rise + 1, at=(*centre, level + high + (rise - 1) / 2)))
        fewer = np.maximum(cells - rng.integers(0, 3, 2), 1)
        over = np.minimum(fewer - 1, 1)  # a cell that sticks out
        at, cells = at + rng.integers(-over, cells - fewer + over + 1), fewer
    return union(*parts)


def _hand(rng: np.random.Generator) -> "Manifold":
    """A hand or a glove on the table: a palm, four fingers spread and bent, a thumb, a cuff."""
    length, finger = log_uniform(rng, 60, 225), rng.uniform(0.6, 1)
    palm, wide, thick = length * rng.uniform((0.38, 0.17, 0.05), (0.46, 0.24, 0.1))
    rows = [(-0.2, 0.6), (0.1, 0.75), (0.6, 1), (1, 0.92)]
    parts = [body([(x * palm, 0, 0, s * wide, thick) for x, s in rows], exponent=2.6, rounding=(2, 0.6 * thick))]
    spread, curl, rod = rng.uniform(0, 0.28), rng.uniform(-0.1, 0.8), min(0.24 * wide, 1.1 * thick)
    for place, share in zip((-0.72, -0.24, 0.24, 0.72), (0.78, 0.95, 1, 0.9), strict=True):
        reach, angle = finger * share * (0.98 * length - palm) / 2, place * spread + rng.uniform(-0.04, 0.04)
        points = [np.array([0.88 * palm, place * wide, 0])]
        for bend in np.cumsum(rng.uniform(0.5, 1.3, 2)) * curl * 0.7:
            step = np.array([np.cos(angle) * np.cos(bend), np.sin(angle) * np.cos(bend), np.sin(bend)])
            points.append(points[-1] + reach * step)
        parts += [_limb(points[i], points[i + 1], rod * (1 - 0.1 * i), rod * (0.9 - 0.1 * i)) for i in (0, 1)]
    out, up = rng.uniform((0.5, -0.3), (1.1, 1))
    tip = (palm * (0.3 + 0.6 * np.cos(out)), 0.6 * wide + 0.6 * palm * np.sin(out), thick * up)
    parts.append(_limb((0.25 * palm, 0.45 * wide, 0), tip, 1.3 * rod, rod))
    cuff, widths = length * rng.uniform(0.05, 0.2), wide * rng.uniform((0.6, 0.5), (1, 0.65))
    stations = [(-cuff - 0.1 * palm, 0, 0, widths[0], 1.1 * thick), (0, 0, 0, widths[1], 0.95 * thick)]
    return union(*parts, body(stations, exponent=2.6))


def _funnel(rng: np.random.Generator) -> "Manifold":
    """A funnel with its spout, on its rim or its side; or a bell with a knob, a ring or a handle, on its mouth."""
    rim, wall = log_uniform(rng, 42, 118) / 2, rng.uniform(1.3, 3)
    if rng.random() < 0.5:
        deep, spout, tip = rim * rng.uniform((0.7, 0.6, 0.08), (1.4, 1.5, 0.2))
        funnel = shell([(tip, -spout), (1.4 * tip, 0), (rim, deep), (rim, deep + rng.uniform(2, 15))], wall)
        if rng.random() < 0.6:
            tab = strip([(0, 0), (0.35 * rim, 0)], 0.35 * rim)
            funnel = union(funnel, plate(tab, wall, z=deep + 1).translate((rim + 0.12 * rim, 0, 0)))
        lean = 90 - np.degrees(np.arctan2(rim - tip, deep + 0.5 * spout))
        funnel = _no_higher(funnel)
        return funnel.rotate((180, 0, 0)) if rng.random() < 0.5 else funnel.rotate((0, 0, 90)).rotate((0, lean, 0))
    high, waist = rim * rng.uniform((0.9, 0.5), (1.7, 0.8))
    line = curve([(rim, 0), (waist, 0.5 * high), (0.85 * waist, 0.85 * high), (0.3 * rim, high), (0, high)], along=2)
    kind, rod = rng.integers(3), rim * rng.uniform(0.08, 0.14)
    if kind == 0:
        top = sphere(2.5 * rod, at=(0, 0, high + 2 * rod))
    elif kind == 1:
        ring = np.insert(ellipse(rim * 0.3, rim * 0.3, at=(0, high + 0.3 * rim), count=40), 1, 0, axis=1)
        top = tube(ring, rod, normal=UPRIGHT, closed=True)
    else:
        tall = min(rim * rng.uniform(1, 2), 116 - high)
        grip = curve(np.array([(1, 0), (1.2, 0.3), (2, 0.7), (1, 1)]) * (rod, tall) + (0, high), along=2)
        top = revolve([(0, high - wall), (rod, high - wall), *grip, (0, high + tall)])
    return _no_higher(union(shell(line, wall), top))


def _padlock(rng: np.random.Generator) -> "Manifold":
    """On its side: a body, square, round or like a shield, with a keyhole, and a bow, closed or swung open."""
    wide = log_uniform(rng, 28, 100)
    high, thick, rod = wide * rng.uniform((0.7, 0.3, 0.07), (1.15, 0.5, 0.12))
    kind, half = rng.integers(3), 0.5 * wide
    area = outline([(-half, -high), (half, -high), (half, 0), (-half, 0)])
    if kind == 1:
        area = outline(ellipse(half, 0.55 * high, at=(0, -0.48 * high)))
    elif kind == 2:
        shield = [(-1, 0), (-0.9, -0.5), (0, -1), (0.9, -0.5), (1, 0), (0, 0.03)]
        area = smooth_outline(np.array(shield) * (half, high))
    case = plate(fillet(area, 0.08 * wide), thick)
    slot = strip([(0, -0.55 * high), (0, -0.7 * high)], [0.14 * wide, 0.07 * wide])
    apart, tall, up = wide * rng.uniform((0.24, 0.45, 0.05), (0.34, 0.9, 0.3)) * (1, 1, rng.random() < 0.5)
    arc = np.pad(ellipse(apart, apart, at=(0, tall - apart + up))[:41], ((0, 0), (0, 1)))
    foot = up - 2 * rod if up else -0.25 * high
    bow = tube(np.array([(apart, -0.25 * high, 0), *arc, (-apart, foot, 0)]), rod, normal=FLAT, around=24)
    if up:
        bow = bow.translate((-apart, 0, 0)).rotate((0, rng.uniform(-20, 50), 0)).translate((apart, 0, 0))
    return union(case - plate(slot, thick, z=0.7 * thick), bow)


def _iron(rng: np.random.Generator) -> "Manifold":
    """A flat sole with a point, a body that narrows upwards, a handle above it, and a dial."""
    length = log_uniform(rng, 80, 226)
    half, high, sole = length * rng.uniform((0.18, 0.12, 0.02), (0.26, 0.24, 0.05))
    edge = np.array([(0.5, 0), (0.36, 0.42), (0.1, 0.85), (-0.2, 1), (-0.44, 0.9), (-0.5, 0.5)])
    edge = smooth_outline(np.concatenate([edge, edge[:0:-1] * (1, -1)]) * (length, half))
    small = rng.uniform(0.5, 0.8)
    trunk = plate(edge, sole, z=sole / 2) + edge.scale((0.94, 0.92)).extrude(high, scale_top=(small, small))
    rise, rod, front, rear = length * np.array([*rng.uniform((0.12, 0.035), (0.2, 0.055)), 0.3 * small, -0.4 * small])
    knots = [(rear + 0.1 * length, 0.6 * high), (rear, high + 0.5 * rise), (rear + 0.1 * length, high + rise)]
    knots.append((0.6 * front, high + rise + 0.02 * length))
    if rng.random() < 0.7:  # else open in front
        knots += [(front, high + 0.6 * rise), (front - 0.02 * length, 0.6 * high)]
    handle = tube(curve([(x, 0, z) for x, z in knots]), [(rod, rod * rng.uniform(0.8, 1.2))], normal=UPRIGHT)
    dial = cylinder(0.35 * half, 0.4 * high + 4, at=(0, 0, 0.8 * high + 2))
    iron = _no_higher(union(trunk, handle, dial), 116)
    return iron.rotate((98, 0, 0)) if rng.random() < 0.2 else iron


TOYS = (_animal, _vehicle, _spray_bottle, _fruit, _coil, _bricks, _hand, _funnel, _padlock, _iron)
"""What draws each kind."""
