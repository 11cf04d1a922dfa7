"""More closed cans: thin tubes, rolls, wide flat tins, flasks; on their base or on their side, the axis along x."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.cans import grooved, turned
from millisight.meshes._shapes import (
    block,
    curve,
    cylinder,
    disc,
    ellipse,
    fillet,
    log_uniform,
    outline,
    plate,
    ring,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

_HIGHEST = 114.0  # as it stands or lies [mm]
_SMALLEST, _LARGEST = 32.0, 236.0  # its largest extent [mm]


def _set_down(can: "Manifold", rng: np.random.Generator, lies: float = 0.5) -> "Manifold":
    """The can on its base, or on its side, as this share of them and the long ones, rolled by any angle."""
    size = np.diff(np.reshape(can.bounding_box(), (2, 3)), axis=0)[0]
    scale = np.clip(size.max(), _SMALLEST, _LARGEST) / size.max()
    wide, _, high = scale * size
    on_side = high > _HIGHEST or (wide < _HIGHEST and rng.random() < lies)
    return can.scale((scale,) * 3).rotate((0, 0, rng.uniform(0, 360))).rotate((0, 90 if on_side else 0, 0))


def _pleated(radius: float, depth: float, count: int, *, exponent: float = 1.0) -> "CrossSection":
    """A disc with so many waves about its rim; `exponent` below 1 makes its ridges wide, above it makes them narrow."""
    turn = np.linspace(0, 2 * np.pi, 10 * count, endpoint=False)
    wave = radius - depth * (1 - (0.5 + 0.5 * np.cos(count * turn)) ** exponent)
    return outline(np.column_stack([wave * np.cos(turn), wave * np.sin(turn)]))


def _round_edge(radius: float, edge: float, drop: float) -> np.ndarray:
    """(12, 2) radii and heights of a base's edge, a quarter of an ellipse, from z = 0 up to z = `drop`."""
    turn = np.linspace(-np.pi / 2, 0, 12)
    return np.column_stack([radius - edge + edge * np.cos(turn), drop + drop * np.sin(turn)])


def _screw_tube(rng: np.random.Generator) -> "Manifold":
    """A thin tube, mostly on its side: a grooved, smooth or tapering cap, and a step or a knob to twist at its foot."""
    radius = log_uniform(rng, 13, 46) / 2
    long = float(np.clip(radius * log_uniform(rng, 2.2, 9), 30, 175))
    cap, wide = long * rng.uniform(0.1, 0.45), radius * rng.uniform(0.85, 1.2)
    foot, knob = long * rng.uniform(0.05, 0.2), radius * rng.choice([1, rng.uniform(0.75, 1.12)])
    neck, seam = radius - rng.uniform(0.8, 1.6), long - cap
    body = turned([(0, 0), (knob, 0), (knob, foot), (neck, foot), (neck, foot + 1.2), (radius, foot + 1.2),
                    (radius, seam - 1.2), (neck, seam - 1.2), (neck, seam + 1), (0, seam + 1)], 0.3)  # fmt: skip
    if rng.random() < 0.5:
        lid = plate(grooved(wide, rng), cap, z=long - cap / 2)
    else:
        end, soft = wide * rng.choice([1, rng.uniform(0.55, 0.95)]), 0.15 * min(wide, cap)
        lid = turned([(0, seam), (wide, seam), (wide, seam + 0.3 * cap), (end, long), (0, long)], soft)
    return _set_down(union(body, lid), rng, 0.85)


def _coins(rng: np.random.Generator) -> "Manifold":
    """A stack of coins or biscuits, none quite in the middle, the lower ones wrapped, the wrapping curled in below."""
    radius = log_uniform(rng, 15, 66) / 2
    long, thick = float(np.clip(radius * log_uniform(rng, 2.2, 6), 32, 180)), radius * rng.uniform(0.13, 0.35)
    wrapped, lip = long * rng.uniform(0.3, 1), 0.12 * radius
    paper = turned([(0, lip), (radius - 2.5 * lip, lip), (radius - 2 * lip, 0), (radius - 0.4 * lip, 0),
                     (radius, lip), (radius, wrapped), (0, wrapped)], 0.2 * lip)  # fmt: skip
    coins = [paper]
    for place in np.arange(wrapped, long + 0.1, thick):
        at = (*(0.02 * radius * rng.normal(size=2)), place)
        coins += [cylinder(0.95 * radius, 0.85 * thick, at=at), cylinder(0.87 * radius, 1.3 * thick, at=at)]
    return union(*coins)


def _bored(roll: "Manifold", bore: float, rng: np.random.Generator) -> "Manifold":
    """The roll with a bore right through it, or into both its ends."""
    lowest, highest = roll.bounding_box()[2::3]
    deep = rng.choice([1.2 * (highest - lowest), rng.uniform(3, 0.3 * (highest - lowest))])
    return roll - union(*(cylinder(bore, 2 * deep, at=(0, 0, z)) for z in (lowest, highest)))


def _spool(rng: np.random.Generator) -> "Manifold":
    """A spool with two flanges, its winding straight, bulged or drawn in, with a bore through it or into each end."""
    flange = log_uniform(rng, 26, 112) / 2
    high, edge = min(flange * log_uniform(rng, 0.6, 5), 190), max(flange * rng.uniform(0.06, 0.16), 1.6)
    z, swell, wound = np.linspace(-1, 1, 21), flange * rng.uniform(-0.15, 0.15), flange * rng.uniform(0.55, 0.95)
    side = np.column_stack([np.minimum(wound + swell * (1 - z**2), 1.02 * flange), z * (high / 2 - edge)])
    upper = np.array([(flange, high / 2 - edge), (flange, high / 2), (0, high / 2)])
    roll = turned([*(upper[::-1] * (1, -1)), *side, *upper], 0.3 * edge)
    return _bored(roll, flange * rng.uniform(0.1, 0.4), rng)


def _paper_roll(rng: np.random.Generator) -> "Manifold":
    """A roll of paper, tape or cloth about a core, its layers shifted to one end, its loose end lying on it."""
    radius = log_uniform(rng, 28, 110) / 2
    high = float(np.clip(radius * log_uniform(rng, 0.4, 6), 12, 235))
    core, lean, wall = radius * rng.uniform(0.25, 0.75), rng.uniform(-0.1, 0.1) * radius, max(0.06 * radius, 1.5)
    end = np.array([(radius, high / 2), (core + wall, high / 2 + lean), (0, high / 2 + lean)])
    roll = _bored(turned([*(end[::-1] - (0, high)), *end], 0.4), core, rng)
    thick, reach = rng.uniform(0.8, 2), radius * rng.uniform(0.5, 1.1)
    flap = block((reach, 2 * thick, high - 2 * abs(lean) - 1), at=(0.3 * radius, radius - thick, 0))
    return union(roll, flap) if rng.random() < 0.6 else roll


def _roll(rng: np.random.Generator) -> "Manifold":
    """A roll of coins or of paper, or a spool."""
    return _set_down((_coins, _spool, _paper_roll)[rng.integers(3)](rng), rng, 0.65)


def _candle(rng: np.random.Generator) -> "Manifold":
    """A candle: straight, fluted or twisted, or in a tin cup, its top sunk or peaked, with a wick."""
    radius = log_uniform(rng, 18, 108) / 2
    high = float(np.clip(radius * log_uniform(rng, 0.6, 9), 11, 215))
    wick, rise = radius * rng.uniform(0.06, 0.1), radius * rng.uniform(0.2, 0.5)
    choice, dip = rng.integers(3), float(np.clip(radius * rng.uniform(-0.5, 0.4), -18, 0.4 * high))
    if choice == 0:
        lobes, depth = int(rng.integers(4, 17)), radius * rng.uniform(0.04, 0.14)
        twist = rng.choice([0, rng.uniform(-40, 40)]) * high / radius
        solid = _pleated(radius, depth, lobes, exponent=0.7).extrude(high, int(high / 3), twist)
        return _set_down(union(solid, cylinder(wick, rise, at=(0, 0, high + 0.4 * rise))), rng, 0.5)
    cup = [(radius, 0), (radius, high)]
    if choice == 1:
        low, rim = high * rng.uniform(0.2, 0.85), radius + rng.uniform(1.2, 2.5)
        cup = [(radius, 0), (radius, low), (rim, low), (rim, low + 1.5), (radius - 1, low + 1.5), (radius - 1, high)]
    edge, turn = radius * rng.uniform(0.75, 0.9), np.linspace(0, np.pi / 2, 12)[:, None]
    top = np.hstack([edge * np.cos(turn), high - dip * np.sin(turn)])
    solid = turned([(0, 1), (0.8 * radius, 1), (0.85 * radius, 0), *cup, *top[:-1], (0, high - dip)], 0.3)
    return _set_down(union(solid, cylinder(wick, rise + 2, at=(0, 0, high - dip + rise / 2 - 1))), rng, 0.5)


def _emblem(radius: float, rng: np.random.Generator) -> "CrossSection":
    """What a lid is embossed with: a star, a flower, or a ring of dots."""
    count, choice = int(rng.integers(3, 13)), rng.integers(3)
    if choice == 0:
        points = ring(2 * count, radius)
        points[1::2] *= rng.uniform(0.4, 0.75)
        return fillet(outline(points), 0.02 * radius)
    if choice == 1:
        return _pleated(radius, radius * rng.uniform(0.2, 0.6), count, exponent=0.6)
    dots = [disc(min(0.17, 1.8 / count) * radius, at) for at in ring(count, 0.8 * radius)]
    return sum(dots, disc(radius * rng.uniform(0.15, 0.4)))


def _embossed_tin(rng: np.random.Generator) -> "Manifold":
    """A wide flat tin, its base's edge round, a rolled rim on its lid, and the lid domed, in steps, or embossed."""
    radius = log_uniform(rng, 32, 195) / 2
    high = float(np.clip(radius * log_uniform(rng, 0.2, 0.95), 9, 80))
    edge, seam, over = high * rng.uniform(0.05, 0.35), high * rng.uniform(0.4, 0.75), rng.uniform(0.8, 2)
    rim, wide = rng.uniform(0.8, 2), radius + over
    base = [(0, 0.8), (0.8 * (radius - edge), 0.8), (0.8 * (radius - edge) + 1, 0), *_round_edge(radius, edge, edge)]
    side = [(radius, seam), (wide + rim, seam), (wide + rim, seam + 2), (wide, seam + 2.5), (wide, high)]
    choice, inner, level = rng.integers(3), wide - rng.uniform(2, 0.2 * radius + 2), high
    if choice == 0:
        turn, dome = np.linspace(0, np.pi / 2, 30), radius * rng.uniform(0.06, 0.3)
        level = high + dome
        top = [*np.column_stack([inner * np.cos(turn), high + dome * np.sin(turn)])[:-1], (0, level)]
    else:
        top = []
        for place in inner * np.linspace(1, rng.uniform(0.4, 0.9), int(rng.integers(1, 5))):
            step = rng.uniform(0.8, 3) * rng.choice([1, 1, -1])
            top += [(place, level), (place - 1, level + step)]
            level += step
        top.append((0, level))
    tin = turned([*base, *side, *top], 0.3)
    if choice == 2 or rng.random() < 0.2:
        flat = 0.35 * inner if choice == 0 else 0.92 * top[-2][0]
        tin = union(tin, plate(_emblem(flat, rng), rng.uniform(1.2, 3) + 2, z=level))
    return _set_down(tin, rng, 0.3)


def _gas_cartridge(rng: np.random.Generator) -> "Manifold":
    """A cartridge with a hollow or a round base, round shoulders, a collar, and a small valve."""
    radius = log_uniform(rng, 18, 112) / 2
    high = float(np.clip(radius * log_uniform(rng, 0.5, 4.5), 12, 175))
    neck, power = radius * rng.uniform(0.12, 0.35), rng.uniform(1.6, 3)
    rise, turn = radius * rng.uniform(0.4, 1.2), np.linspace(0, np.pi / 2, 40)
    dome = np.column_stack([np.cos(turn), np.sin(turn)]) ** (2 / power)
    shoulder = dome[dome[:, 0] * radius > neck] * (radius, rise) + (0, high)
    if rng.random() < 0.4 and high + rise > 3 * radius:
        low = radius * rng.uniform(0.5, 1)
        base = [(0, -low), *(dome[-2::-1] * (radius, -low))]
    else:
        foot, hollow = radius * rng.uniform(0.75, 0.92), radius * rng.uniform(0.1, 0.3)
        base = [*(dome[-1:5:-1] * (0.92 * foot, hollow)), (0.94 * foot, 0), (foot, 0), (radius, radius - foot)]
        base[0] = (0, hollow)
    level = shoulder[-1][1]
    collar, stem, up = neck * rng.uniform(1, 1.7), neck * rng.uniform(0.4, 0.7), max(radius * rng.uniform(0.1, 0.3), 2)
    top = [(neck, level + up), (collar, level + up), (collar, level + 1.6 * up), (stem, level + 1.6 * up)]
    end = level + up * rng.uniform(2.2, 3)
    return _set_down(turned([*base, *shoulder, *top, (stem, end), (0, end)], 0.3), rng)


def _paint_tin(rng: np.random.Generator) -> "Manifold":
    """A tin with rims, a groove about its pressed-in lid, an ear at each side, and a handle of wire, up or down."""
    radius = log_uniform(rng, 34, 106) / 2
    high, rim = min(radius * log_uniform(rng, 1, 2.6), 102), rng.uniform(0.8, 2)
    groove, deep = max(radius * rng.uniform(0.06, 0.14), 2), rng.uniform(2, 5)
    lid, plateau = radius - groove - rng.uniform(1.5, 3), rng.uniform(0.55, 0.85)
    base = [(0, 2), (radius - 3, 2), (radius - 2, 0), (radius + rim, 0), (radius + rim, 2.5), (radius, 3)]
    top = [(radius, high - 4), (radius + rim, high - 3.5), (radius + rim, high), (radius - 1.5, high),
           (radius - 1.5, high - deep), (radius - 1.5 - groove, high - deep), (lid, high + 1), (lid - 3, high + 1),
           (lid - 3.5, high - 1), (plateau * lid, high - 1), (plateau * lid - 1, high), (0, high)]  # fmt: skip
    ear, wire, at = radius * rng.uniform(0.1, 0.2), rng.uniform(1.2, 2.4), high * rng.uniform(0.66, 0.82)
    ears = [cylinder(ear, 5, axis="x", at=(side * (radius + 1), 0, at)) for side in (-1, 1)]
    wide = radius + rim + wire + 0.5
    turn, reach = np.linspace(0, np.pi, 50), wide * rng.uniform(1.05, 1.35)
    swing = -rng.uniform(0.3, 1) * np.arccos(wide / reach)  # at the most the wire touches the tin
    if rng.random() < 0.3 and at + reach < _HIGHEST:
        swing = rng.uniform(0.6, 2.2)
    bow = [wide * np.cos(turn), reach * np.sin(turn) * np.cos(swing), at + reach * np.sin(turn) * np.sin(swing)]
    handle = tube(np.column_stack(bow), wire, normal=(0, -np.sin(swing), np.cos(swing)), around=12)
    can = union(turned([*base, *top], 0.4), *ears, handle)
    lies = radius + reach < _HIGHEST and rng.random() < 0.3
    return can.rotate((0, 0, rng.uniform(30, 150))).rotate((0, 90, 0)) if lies else can


def _thermos(rng: np.random.Generator) -> "Manifold":
    """A flask, mostly on its side: a foot, bands or ribs about it, shoulders, and a cup with a step as its cap."""
    radius = log_uniform(rng, 26, 98) / 2
    long = float(np.clip(radius * log_uniform(rng, 3.4, 7.5), 70, 236))
    cup, taper = long * rng.uniform(0.14, 0.32), rng.uniform(0.75, 1)
    seam, slope, foot = long - cup, rng.uniform(0.02, 0.14) * long, rng.uniform(3, 0.1 * long)
    mouth, sole = radius * rng.uniform(0.68, 1), radius * rng.choice([1.04, 0.92])
    side = [(0, 1.5), (0.8 * sole, 1.5), (0.84 * sole, 0), (sole, 0), (sole, foot), (radius, foot)]
    for place in np.sort(rng.uniform(foot + 8, seam - slope - 8, int(rng.integers(0, 4)))):
        if place > side[-1][1] + 5:
            out = radius + rng.choice([-1, 1]) * rng.uniform(0.8, 2)
            side += [(radius, place - 2), (out, place - 1.5), (out, place + 1.5), (radius, place + 2)]
    side += [(radius, seam - slope), (mouth - 0.5, seam), (mouth - 0.5, seam + 1), (mouth, seam + 1)]
    rim, step = mouth * rng.choice([1, 1.06]), rng.uniform(2, 0.3 * cup)
    top = [(rim, seam + 1.2), (rim, seam + 4), (mouth, seam + 4.2), (taper * mouth, long - step)]
    end = taper * mouth * rng.uniform(0.5, 0.9)
    return _set_down(turned([*side, *top, (end, long - step), (end, long), (0, long)], 0.5), rng, 0.9)


def _shaker(rng: np.random.Generator) -> "Manifold":
    """A shaker: a round or faceted body, drawn in or widening, and a flat or domed cap with holes."""
    radius = log_uniform(rng, 22, 84) / 2
    high, upper = radius * log_uniform(rng, 1.4, 3.6), rng.uniform(0.75, 1.1)
    if rng.random() < 0.5:
        area = fillet(outline(ring(int(rng.integers(5, 13)), radius)), 0.06 * radius)
        body = area.extrude(high, 1, rng.choice([0, 20]), (upper, upper))
    else:
        knots = [(radius, 0.1 * high), (radius * rng.uniform(0.78, 1.1), 0.55 * high), (radius * upper, 0.9 * high)]
        side = curve(knots, along=2)
        body = turned([(0, 0), (0.9 * radius, 0), *side, (0.9 * radius * upper, high), (0, high)], 0.05 * radius)
    wide, cap = radius * upper * rng.uniform(0.9, 1.1), radius * rng.uniform(0.25, 0.7)
    dome, turn = radius * rng.choice([0.04, rng.uniform(0.1, 0.6)]), np.linspace(0, np.pi / 2, 24)
    inner = wide * rng.uniform(0.75, 0.98)
    arc = np.column_stack([inner * np.cos(turn), high + cap + dome * np.sin(turn)])[:-1]
    top = [(0, high - 2), (wide, high - 2), (wide, high + cap - 1), *arc, (0, high + cap + dome)]
    hole, rings, places = max(radius * rng.uniform(0.05, 0.09), 1.2), int(rng.integers(1, 3)), [(0, 0)]
    for circle in range(1, rings + 1):
        places += [*ring(int(rng.integers(4, 5 + 3 * circle)), inner * 0.6 * circle / rings)]
    fall = [high + cap - 3 + dome * np.sqrt(1 - (x**2 + y**2) / inner**2) for x, y in places]
    holes = [plate(disc(hole, at), radius, z=z + radius / 2) for at, z in zip(places, fall, strict=True)]
    return _set_down(union(body, turned(top, 0.5)) - union(*holes), rng)


def _pot(rng: np.random.Generator) -> "Manifold":
    """A pot of cream or a box of cheese: a round base edge, a deep or flat lid, now and then with grooves or a tab."""
    radius = log_uniform(rng, 30, 150) / 2
    high = float(np.clip(radius * log_uniform(rng, 0.3, 1.7), 10, 100))
    edge = min(radius * rng.uniform(0.12, 0.6), 0.5 * high)
    seam, wide = high * rng.uniform(0.4, 0.9), radius * rng.uniform(0.96, 1.08)
    soft = min((high - seam) * rng.uniform(0.1, 0.9), 0.4 * radius)
    lid = _round_edge(wide, soft, soft)[::-1] * (1, -1) + (0, high)
    foot = [(0, rng.uniform(0.5, 2.5)), (0.7 * (radius - edge), 0.5), (0.75 * (radius - edge), 0)]
    gap = [(radius, seam - 1.5), (min(radius, wide) - 1.5, seam - 1.5), (min(radius, wide) - 1.5, seam)]
    pot = turned([*foot, *_round_edge(radius, edge, edge), *gap, (wide, seam), *lid, (0, high)], 0.4)
    choice, flat = rng.integers(3), wide - soft
    if choice == 0:  # between the wedges of cheese
        count, wall = int(rng.integers(4, 9)), max(0.04 * radius, 1.2)
        bar = block((0.8 * flat, wall, 2.4), at=(0.5 * flat, 0, high))
        pot = pot - union(*(bar.rotate((0, 0, place * 360 / count)) for place in range(count)))
    if choice == 1:
        tab, deep = rng.uniform(0.2, 0.4) * radius, max(0.2 * (high - seam), 1.5)
        area = outline(ellipse(tab, 0.8 * tab, at=(wide + 0.2 * tab, 0), exponent=2.5))
        return _set_down(union(pot, plate(area, deep, z=min(seam + deep, high - soft))), rng, 0)
    return _set_down(pot, rng, 0.35)


def _filter(rng: np.random.Generator) -> "Manifold":
    """A filter: pleats between two discs; or a can with flats about its dome, and a bore and holes in its other end."""
    radius = log_uniform(rng, 30, 112) / 2
    high, bore = float(np.clip(radius * log_uniform(rng, 0.9, 4), 18, 200)), radius * rng.uniform(0.15, 0.4)
    if rng.random() < 0.5:
        disc_thick, count = max(0.05 * high, 2.5), int(rng.integers(14, 36))
        pleats = plate(_pleated(0.96 * radius, radius * rng.uniform(0.08, 0.2), count), high - disc_thick)
        ends = [cylinder(radius, disc_thick, at=(0, 0, side * (high - disc_thick) / 2)) for side in (-1, 1)]
        deep = rng.uniform(0.2, 2.4) * high
        return _set_down(union(pleats, *ends) - cylinder(bore, deep, at=(0, 0, high / 2)), rng)
    dome, rim = radius * rng.uniform(0.15, 0.5), rng.uniform(1, 2.5)
    crown = _round_edge(radius, 0.6 * radius, dome)[::-1] * (1, -1) + (0, high)
    base = [(0, 1.5), (0.72 * radius, 1.5), (0.74 * radius, 0), (0.9 * radius, 0), (0.92 * radius, 1.5)]
    side = [(radius + rim, 1.5), (radius + rim, 4), (radius, 5)]
    can = turned([*base, *side, *crown, (0, high)], 0.4)
    flats = fillet(outline(ring(int(rng.integers(6, 15)), 1.08 * radius)), 0.5)
    can = can - plate(disc(2 * radius) - flats, 4 * radius, z=high - 0.8 * dome + 2 * radius)
    holes = [cylinder(0.08 * radius + 0.8, 12, at=(x, y, 0)) for x, y in ring(int(rng.integers(5, 9)), 0.55 * radius)]
    can = can - union(cylinder(bore, rng.uniform(10, high), at=(0, 0, 0)), *holes)
    return _set_down(can.rotate((180 * int(rng.integers(2)), 0, 0)), rng)


TUBES = (
    _screw_tube,
    _roll,
    _candle,
    _embossed_tin,
    _gas_cartridge,
    _paint_tin,
    _thermos,
    _shaker,
    _pot,
    _filter,
)
"""What draws each kind."""
