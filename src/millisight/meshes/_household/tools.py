"""Tools and utensils with a long handle, as they lie on a table: the handle along x, the head at its right end."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    FLAT,
    UPRIGHT,
    bent,
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
    sphere,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold

_OVERLAP = 2.0  # of parts that touch
_ROUND_WIRE = 12  # sides of a thin rod


def grip_of(rng: np.random.Generator, length: float, half_width: float, half_height: float) -> "Manifold":
    """A handle from -length to 0, thicker and thinner along its way, round or nearly rectangular."""
    places, swelling = np.linspace(-length, 0, 5), rng.uniform(0.75, 1, 5)
    stations = [(x, 0, 0, half_width * s, half_height * s) for x, s in zip(places, swelling, strict=True)]
    return body(stations, exponent=rng.uniform(2, 4), rounding=(2, 1))


def _pan(rng: np.random.Generator, length: float, foot: float, radius: float, height: float, rise: float) -> "Manifold":
    """A vessel that widens from the foot to the rim, and a handle below the rim that rises by an angle [degrees]."""
    wall, corner = rng.uniform(1.5, 4), rng.uniform(0.1, 0.3) * min(foot, height)
    side = [(0, wall / 2), (foot - corner, wall / 2), (foot, corner), (radius, height)]
    half_width = rng.uniform(7, 13)
    half_height = half_width * rng.uniform(0.4, 0.8)
    handle = grip_of(rng, (length - 2 * radius) / np.cos(np.radians(rise)), half_width, half_height).rotate(
        (0, rise, 0)
    )
    level = 0.85 * height
    end = np.interp(level, (corner, height), (foot, radius)) - wall / 2
    return union(shell(side, wall), handle.translate((-end, 0, level)))


def _deep_pan(rng: np.random.Generator) -> "Manifold":
    """A saucepan with steep walls."""
    length = log_uniform(rng, 200, 335)
    radius = length * rng.uniform(0.2, 0.28)
    height = min(radius * rng.uniform(0.8, 1.3), 95)
    return _pan(rng, length, radius * rng.uniform(0.85, 0.99), radius, height, rise=rng.uniform(0, 8))


def _flat_pan(rng: np.random.Generator) -> "Manifold":
    """A frying pan with low, slanting walls."""
    length = log_uniform(rng, 200, 335)
    radius = length * rng.uniform(0.26, 0.34)
    height = radius * rng.uniform(0.22, 0.45)
    return _pan(rng, length, radius * rng.uniform(0.65, 0.85), radius, height, rise=rng.uniform(3, 18))


def _ladle(rng: np.random.Generator) -> "Manifold":
    """A round bowl, and a flat rod from its rim that bends down to the table."""
    length = log_uniform(rng, 180, 340)
    radius = np.clip(length * rng.uniform(0.1, 0.16), 20, 50)
    depth, thickness = radius * rng.uniform(0.5, 1), rng.uniform(1.5, 3)
    bowl = shell(curve([(0, 0), (0.7 * radius, 0.3 * depth), (radius, depth)], along=2), thickness)
    bend, end = -radius * rng.uniform(1.3, 2), radius - length
    highest = depth * rng.uniform(1.05, 1.3)
    path = curve([(-radius, 0, depth - 1), (bend, 0, highest), (0.5 * (bend + end), 0, 0.6 * depth), (end, 0, 3)])
    half_width = np.linspace(rng.uniform(4, 7), rng.uniform(5, 11), len(path))
    radii = np.column_stack([np.full(len(path), rng.uniform(1.5, 4)), half_width])
    return union(bowl, tube(path, radii, normal=UPRIGHT))


def _whisk(rng: np.random.Generator) -> "Manifold":
    """A round grip, and loops of wire that cross at the tip."""
    length = log_uniform(rng, 150, 340)
    reach = length * rng.uniform(0.45, 0.65)
    bulge, half_width = reach * rng.uniform(0.15, 0.25), rng.uniform(6, 13)
    wire, count = rng.uniform(1.2, 2.2), int(rng.integers(3, 7))
    widest = reach * rng.uniform(0.6, 0.8)
    half = np.array([(-5, 2, 0), (0.4 * widest, 0.6 * bulge, 0), (widest, bulge, 0)])
    points = np.concatenate([half, [(reach, 0, 0)], half[::-1] * (1, -1, 1)])
    loop = tube(curve(points), wire, normal=FLAT, around=_ROUND_WIRE)
    loops = [loop.rotate((180 * (i + 0.5) / count, 0, 0)) for i in range(count)]
    return union(grip_of(rng, length - reach, half_width, half_width), *loops)


def _pliers(rng: np.random.Generator) -> "Manifold":
    """Closed jaws that taper, a pivot, and two bowed handles."""
    length, thickness = log_uniform(rng, 115, 260), rng.uniform(7, 13)
    jaw, wide = length * rng.uniform(0.2, 0.4), length * rng.uniform(0.05, 0.08)
    tip = wide * rng.uniform(0.15, 0.7)
    corners = [(-wide, wide), (0.3 * jaw, wide), (jaw, tip), (jaw, -tip), (0.3 * jaw, -wide), (-wide, -wide)]
    jaws = plate(fillet(outline(corners), 0.8 * tip), thickness)
    end, bow = jaw - length, length * rng.uniform(0.08, 0.14)
    inward = bow * rng.uniform(0.7, 1.1)
    path = curve([(0, 0.3 * wide, 0), (0.15 * end, 0.8 * wide, 0), (0.5 * end, bow, 0), (end, inward, 0)])
    radii = np.linspace(0.35 * wide, rng.uniform(0.5, 0.8) * wide, len(path))
    lever = tube(path, np.column_stack([radii, np.minimum(radii, 0.6 * thickness)]), normal=FLAT)
    return union(jaws, lever, lever.mirror((0, 1, 0)), cylinder(0.7 * wide, thickness + 3))


def _ratchet(rng: np.random.Generator) -> "Manifold":
    """A grip, a thin shaft, and a thick round head with a square peg or a socket on one side of it."""
    length = log_uniform(rng, 115, 300)
    radius, grip = np.clip(length * rng.uniform(0.06, 0.09), 9, 22), length * rng.uniform(0.35, 0.55)
    reach, high = length - grip - radius, radius * rng.uniform(0.9, 1.4)
    half_width = radius * rng.uniform(0.5, 0.9)
    shaft = cylinder(half_width * rng.uniform(0.4, 0.8), reach + _OVERLAP, axis="x", at=((reach - _OVERLAP) / 2, 0, 0))
    side, peg = 0.7 * radius, radius * rng.uniform(0.6, 0.9)
    drive = block((side, side, peg + _OVERLAP), at=(reach, 0, (high + peg - _OVERLAP) / 2))
    if rng.random() < 0.4:
        socket = rng.uniform(20, 40)
        drive = cylinder(radius * rng.uniform(0.6, 0.95), socket, at=(reach, 0, (high + socket - _OVERLAP) / 2))
    head = cylinder(radius, high, at=(reach, 0, 0))
    handle = grip_of(rng, grip, half_width, half_width * rng.uniform(0.6, 1))
    return union(handle, shaft, head, drive).rotate((rng.choice([0, 90]), 0, 0))


def _mallet(rng: np.random.Generator) -> "Manifold":
    """A handle that goes into the middle of a head, a block or a barrel across it."""
    length = log_uniform(rng, 180, 340)
    wide, deep = length * rng.uniform(0.28, 0.42), length * rng.uniform(0.13, 0.22)
    high, half_width = deep * rng.uniform(0.7, 1.1), rng.uniform(9, 17)
    handle = grip_of(rng, length - deep / 2, half_width, half_width * rng.uniform(0.65, 1))
    if rng.random() < 0.5:
        return union(handle, rounded_block((deep, wide, high), rng.uniform(1, 6)))
    bulge = deep / 2 * rng.uniform(0.75, 1)
    barrel = [(0, -wide / 2), (bulge, -wide / 2), (deep / 2, -wide / 5), (deep / 2, wide / 5), (bulge, wide / 2)]
    return union(handle, revolve([*barrel, (0, wide / 2)], axis="y"))


def _flat_brush(rng: np.random.Generator) -> "Manifold":
    """A paint brush: a handle that widens to a flat metal band, and bristles that taper to an edge."""
    from manifold3d import Manifold

    length = log_uniform(rng, 120, 320)
    wide, high = length * rng.uniform(0.1, 0.38), rng.uniform(8, 22)
    band, bristles = length * rng.uniform(0.12, 0.18), length * rng.uniform(0.18, 0.32)
    slim, grip = rng.uniform(4, 8), length - band - bristles
    belly = rng.uniform(0.8, 1.4) * slim
    end, shoulder = (0, 0, 0.47 * wide, 0.45 * high), (-0.2 * grip, 0, 0, max(0.35 * wide, belly), 0.4 * high)
    handle = body([(-grip, 0, 0, belly, slim), (-0.5 * grip, 0, 0, slim, slim), shoulder, (_OVERLAP, *end)], exponent=3)
    ferrule = rounded_block((band, wide, high), 1.5, at=(band / 2, 0, 0))
    ends = ((band - _OVERLAP, 0.95 * wide, 0.9 * high), (band + bristles, wide, rng.uniform(0.1, 0.5) * high))
    corners = [(x, i * y / 2, j * z / 2) for x, y, z in ends for i in (-1, 1) for j in (-1, 1)]
    return union(handle, ferrule, Manifold.hull_points(np.array(corners)))


def _round_brush(rng: np.random.Generator) -> "Manifold":
    """A grip, and rows of bristles around the shaft, as for hair or bottles."""
    length = log_uniform(rng, 150, 340)
    grip, half_width = length * rng.uniform(0.4, 0.6), rng.uniform(6, 12)
    reach, radius = length - grip, np.clip(length * rng.uniform(0.07, 0.13), 14, 35)
    core, spacing = radius * rng.uniform(0.15, 0.5), rng.uniform(5, 10)
    starts = np.arange(0.12 * reach, reach - spacing, spacing)
    thick = spacing * rng.uniform(0.25, 0.5)
    outer = radius * (1 - rng.uniform(0, 0.5) * np.linspace(0, 1, len(starts)) ** 3)
    row = np.array([(0.0, 0.0), (0.0, 1.0), (thick, 1.0), (thick, 0.0)])
    line = np.concatenate([row * (1, r - core) + (x, core) for x, r in zip(starts, outer, strict=True)])
    profile = np.column_stack([line[:, 1], line[:, 0]])
    bristles = revolve([(0, -3), (core, -3), *profile, (core, reach), (0, reach)], axis="x")
    return union(grip_of(rng, grip, half_width, half_width), bristles)


def _trowel(rng: np.random.Generator) -> "Manifold":
    """A thin pointed blade, flat or hollow, and a grip that a bent neck carries higher."""
    length = log_uniform(rng, 180, 340)
    blade, half_width = length * rng.uniform(0.4, 0.52), length * rng.uniform(0.1, 0.17)
    shoulder, lift = blade * rng.uniform(0.05, 0.5), rng.uniform(12, 40)
    corners = [(0, -0.6), (shoulder, -1), (blade, -0.12), (blade, 0.12), (shoulder, 1), (0, 0.6)]
    sheet = plate(fillet(outline(np.array(corners) * (1, half_width)), 2), rng.uniform(1.5, 3))
    hollow = rng.uniform(0.2, 0.6) / half_width if rng.random() < 0.5 else 0.0
    sheet = bent(sheet, lambda x, y: hollow * y**2)
    neck, rod = length * rng.uniform(0.12, 0.2), rng.uniform(3, 5)
    path = curve([(0.2 * blade, 0, 0.5 * rod), (0, 0, rod), (-0.5 * neck, 0, 0.7 * lift), (-neck - 5, 0, lift)])
    radius = rng.uniform(10, 17)
    grip = grip_of(rng, length - blade - neck, radius, radius).translate((-neck, 0, lift))
    return union(sheet, tube(path, rod, normal=UPRIGHT), grip)


def _scoop(rng: np.random.Generator) -> "Manifold":
    """An ice-cream scoop: a deep hollow half ball at the end of a thick grip, open upwards or sideways."""
    length, radius = log_uniform(rng, 150, 240), rng.uniform(20, 32)
    grip, half_width = length * rng.uniform(0.45, 0.6), rng.uniform(8, 14)
    centre, brim = length - grip - radius, radius * rng.uniform(0, 0.35)
    neck = 0.6 * half_width * rng.uniform(0.6, 1)
    wall = rng.uniform(1.5, 3)
    inside = sphere(radius - wall)
    wide = 4 * radius
    ball = sphere(radius) - inside - block((wide, wide, wide), at=(0, 0, wide / 2 + brim))
    reach = centre - radius + wall
    shaft = cylinder(neck, reach + 5, axis="x", at=(reach / 2 - 2.5, 0, 0))
    cup = ball.rotate((rng.choice([0, 90]) + rng.uniform(-20, 20), 0, 0)).translate((centre, 0, 0))
    return union(grip_of(rng, grip, half_width, half_width * rng.uniform(0.7, 1)), shaft, cup)


def _toothbrush(rng: np.random.Generator) -> "Manifold":
    """A thin stick with a slim neck and a flat head, tufts in rows on one side of it, turned any way up."""
    length = log_uniform(rng, 130, 220)
    head, neck, bristles = length * rng.uniform(0.12, 0.22), length * rng.uniform(0.15, 0.3), rng.uniform(7, 14)
    wide, thin, thick = rng.uniform(4.5, 8), rng.uniform(2, 3), rng.uniform(3, 6)
    grip = length - head
    sections = [(-grip, 0.7, thick), (-0.6 * grip, 1, thick), (-neck, 0.7, thick), (-0.3 * neck, 0.45, thin + 0.3)]
    sections += [(0.3 * head, 1, thin), (0.8 * head, 1, thin), (head, 0.7, thin)]
    stick = body([(x, 0, 0, wide * y, z) for x, y, z in sections], exponent=2.5, rounding=(2, 2))
    count = int(rng.integers(4, 8))
    pitch = 0.8 * head / count
    tuft = block((0.7 * pitch, 1.5 * wide, bristles), at=(0.15 * head + pitch / 2, 0, bristles / 2))
    tufts = [tuft.translate((i * pitch, 0, 0)) for i in range(count)]
    return union(stick, *tufts).rotate((rng.choice([0, 90, 180]), 0, 0))


def _rolling_pin(rng: np.random.Generator) -> "Manifold":
    """A thick roller with a slim handle at each end, or one that only tapers to its ends."""
    length = log_uniform(rng, 200, 340)
    radius, handle = length * rng.uniform(0.06, 0.12), length * rng.uniform(0.17, 0.27)
    slim = radius * rng.uniform(0.3, 0.55)
    if rng.random() < 0.25:
        line = curve([(slim, 0), (0.9 * radius, handle), (radius, length / 2)], along=2)
    else:
        neck = 0.6 * slim
        knob = [(0.7 * slim, 0), (slim, 0.15 * handle), (0.9 * slim, 0.7 * handle), (neck, handle)]
        line = np.array([*knob, (0.95 * radius, handle), (radius, handle + 3), (radius, length / 2)])
    other = line[-2::-1] * (1, -1) + (0, length)
    return revolve([(0, 0), *line, *other, (0, length)], axis="x")


def _peeler(rng: np.random.Generator) -> "Manifold":
    """A peeler or a razor: a grip, a fork of two arms, and a bar across their ends."""
    length = log_uniform(rng, 112, 180)
    half, reach = rng.uniform(18, 34), length * rng.uniform(0.2, 0.35)
    rod, half_width = rng.uniform(2, 4), rng.uniform(5, 12)
    bar = rng.uniform(4, 14)
    x = reach - bar / 2
    points = [(x, -half, 0), (0.5 * x, -0.85 * half, 0), (0, 0, 0), (0.5 * x, 0.85 * half, 0), (x, half, 0)]
    fork = tube(curve(points), [(rod, rod * rng.uniform(0.7, 1.2))], normal=FLAT)
    across = rounded_block((bar, 2 * (half + rod), rng.uniform(2.5, 9)), 1, at=(x, 0, 0))
    grip = grip_of(rng, length - reach, half_width, half_width * rng.uniform(0.4, 0.8)).translate((_OVERLAP, 0, 0))
    return union(grip, fork, across)


def _tongs(rng: np.random.Generator) -> "Manifold":
    """Two long springy arms, joined at one end and closed at the other, side by side or one above the other."""
    length, high = log_uniform(rng, 150, 340), rng.uniform(10, 24)
    thick, bow = rng.uniform(1.5, 4), length * rng.uniform(0.035, 0.08)
    tip, end = length * rng.uniform(0.12, 0.2), 0.5 * thick - length
    line = [(end, 0.3 * bow), (0.7 * end, bow), (-tip, 0.7 * bow), (-0.1 * tip, thick)]
    arm = plate(strip(curve(line, along=2), thick), high)
    bridge = plate(strip([(end, -0.3 * bow), (end, 0.3 * bow)], thick), high)
    wide = high * rng.uniform(1, 2.1) + thick
    paw = block((tip, 2.4 * thick, wide), at=(-tip / 2, thick, 0))  # the two overlap
    half = union(arm, paw)
    return union(half, half.mirror((0, 1, 0)), bridge).rotate((rng.choice([0, 90]), 0, 0))


def _key(rng: np.random.Generator) -> "Manifold":
    """An old door's key: a ring to turn it by, a collar, a round shaft, and a notched bit beside its end."""
    length = log_uniform(rng, 110, 180)
    along, across, rod = length * rng.uniform(0.1, 0.15), length * rng.uniform(0.1, 0.19), rng.uniform(2.5, 4.5)
    bow = tube(np.pad(ellipse(along, across, count=60), ((0, 0), (0, 1))), rod, normal=FLAT,
               closed=True)  # fmt: skip
    reach = length - along - rod
    shaft = cylinder(rod, reach - along, axis="x", at=((reach + along) / 2, 0, 0))
    collar = cylinder(1.5 * rod, rng.uniform(3, 8), axis="x", at=(along + rng.uniform(0.1, 0.3) * reach, 0, 0))
    deep, wide, gap = length * rng.uniform(0.12, 0.2), length * rng.uniform(0.12, 0.2), rng.uniform(2, 4)
    bit = block((wide, deep + rod, rng.uniform(2.5, 4)), at=(reach - 0.6 * wide, (deep + rod) / 2, 0))
    notch = block((gap, deep, 10), at=(reach - rng.uniform(0.4, 0.8) * wide, rod + deep, 0))
    return union(bow, shaft, collar, bit - notch)


TOOLS = (
    _deep_pan,
    _flat_pan,
    _ladle,
    _whisk,
    _pliers,
    _ratchet,
    _mallet,
    _flat_brush,
    _round_brush,
    _trowel,
    _scoop,
    _toothbrush,
    _rolling_pin,
    _peeler,
    _tongs,
    _key,
)
"""What draws each kind."""
