"""Things of no class: bottles, devices, toys, a shoe, a teapot."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.profiles import round_profile
from millisight.meshes._shapes import (
    UPRIGHT,
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
    smooth_outline,
    sphere,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import Manifold


def _pump_bottle(rng: np.random.Generator) -> "Manifold":
    """A bottle of soap on its side: shoulders, a collar, and a pump whose spout points to the side."""
    length, exponent = log_uniform(rng, 120, 235), rng.uniform(2, 4)
    half, flat, long = length * rng.uniform(0.15, 0.22), rng.uniform(0.6, 1), length * rng.uniform(0.58, 0.7)
    neck, head = half * rng.uniform(0.35, 0.5), half * rng.uniform(0.3, 0.5)
    rows = [(x * long, 0, 0, half * s, half * flat * s) for x, s in ((0, 1), (0.45, 1), (0.8, 0.98), (0.9, 0.85))]
    rows += [(x * long, 0, 0, 0.8 * neck, 0.8 * neck) for x in (1, 1.03, 1.06)]
    reach, thick, end = half * rng.uniform(1, 1.8), head * rng.uniform(0.4, 0.65), length - head
    return union(
        body(rows, exponent=exponent, rounding=(0.15 * half, 0)),
        cylinder(neck, 0.09 * length, axis="x", at=(1.06 * long, 0, 0)),
        cylinder(0.35 * neck, end - long, axis="x", at=((end + long) / 2, 0, 0)),
        cylinder(head, head, axis="x", at=(end, 0, 0)),
        rounded_block((thick, reach, 1.2 * thick), 0.3 * thick, at=(end, reach / 2, 0)),
    )


def _hair_dryer(rng: np.random.Generator) -> "Manifold":
    """On its side: a barrel, a nozzle flat or round, and a grip to one side."""
    length = log_uniform(rng, 120, 215)
    half, grip, nozzle = length * rng.uniform((0.16, 0.45, 0.4), (0.22, 0.65, 0.6))
    throat, thick, wide = half * rng.uniform(0.65, 0.85), half * rng.uniform(0.3, 0.45), half * rng.uniform(0.4, 0.55)
    radii = [(-0.4, 0.8 * half), (-0.25, half), (0.05, 0.97 * half), (0.28, throat)]
    barrel = body([(x * length, 0, 0, r, r) for x, r in radii], rounding=(0.25 * half, 1))
    tip = throat * rng.uniform(0.8, 1.4), throat * rng.uniform(0.25, 0.8)
    mouth = body([(0.24 * length, 0, 0, 0.9 * throat, 0.9 * throat), (nozzle, 0, 0, *tip)], exponent=2.5)
    stations = [(0, 0, 0, wide, thick), (0.5 * half + 0.5 * grip, 0, 0, 0.8 * wide, thick),
                (0.8 * half + grip, 0, 0, 0.9 * wide, 0.9 * thick)]  # fmt: skip
    handle = body(stations, exponent=2.4, rounding=(0, 4)).rotate((0, 0, rng.uniform(-110, -75)))
    return union(barrel, mouth, handle.translate((-0.15 * length, 0, 0)))


def _game_controller(rng: np.random.Generator) -> "Manifold":
    """A flat middle between two grips; on top of it two sticks and four buttons."""
    wide, thick = log_uniform(rng, 95, 165), rng.uniform(20, 34)
    deep, long, toe = wide * rng.uniform(0.34, 0.44), wide * rng.uniform(0.4, 0.52), rng.uniform(8, 28)
    grip = [(-0.13 * wide, 0, 0, 0.14 * wide, 0.46 * thick), (0.1 * wide, 0, 0, 0.15 * wide, 0.52 * thick),
            (long, 0, -0.1 * thick, 0.085 * wide, 0.38 * thick)]  # fmt: skip
    right = body(grip, exponent=2.2, rounding=(0.4 * thick, 0.35 * thick)).rotate((0, 0, toe - 90))
    parts = [rounded_block((0.76 * wide, deep, 0.9 * thick), 0.3 * thick)]
    parts += [s.translate((x * wide, 0.02 * wide, 0)) for s, x in ((right, 0.34), (right.mirror((1, 0, 0)), -0.34))]
    stick, rise, low = wide * rng.uniform(0.045, 0.065), thick * rng.uniform(0.25, 0.4), -0.22 * deep
    for x in (-0.16 * wide, 0.16 * wide):
        parts.append(cylinder(0.6 * stick, thick / 2 + rise, at=(x, low, (thick / 2 + rise) / 2)))
        parts.append(cylinder(stick, 0.3 * rise, at=(x, low, thick / 2 + rise)))
    buttons = wide * np.array([(0.28, 0.1), (0.28, 0), (0.33, 0.05), (0.23, 0.05)])
    return union(*parts, *(cylinder(0.022 * wide, 0.6 * thick, at=(x, y, 0.3 * thick)) for x, y in buttons))


def _toy_car(rng: np.random.Generator) -> "Manifold":
    """A low body, a cabin with slanting windows, and four wheels."""
    length = log_uniform(rng, 55, 200)
    wide, high, wheel = length * rng.uniform((0.38, 0.13, 0.08), (0.5, 0.22, 0.13))
    roof, back, front = length * rng.uniform((0.12, -0.48, 0.1), (0.22, -0.2, 0.35))
    slant, base = roof * rng.uniform(0.2, 1), wheel * rng.uniform(0.7, 1.1) + high
    cabin = [(back, base - 2), (front, base - 2), (front - slant, base + roof), (back + 0.6 * slant, base + roof)]
    cabin = plate(fillet(outline(cabin), 0.08 * roof), wide * rng.uniform(0.75, 0.95)).rotate((90, 0, 0))
    chassis = rounded_block((length, wide, high), high * rng.uniform(0.1, 0.35), at=(0, 0, base - high / 2))
    tyre, axles = wide * rng.uniform(0.15, 0.25), length * rng.uniform(0.26, 0.34, 2)
    places = [(x, y, wheel) for x in (-axles[0], axles[1]) for y in (-0.47 * wide, 0.47 * wide)]
    return union(chassis, cabin, *(cylinder(wheel, tyre, axis="y", at=at) for at in places))


def _spectacles(rng: np.random.Generator) -> "Manifold":
    """Standing with open arms: two lenses in a frame, a bridge, and arms bent at their ends."""
    half, gap, rim = rng.uniform(20, 28), rng.uniform(12, 20), rng.uniform(1.5, 5)
    tall, exponent, thick = half * rng.uniform(0.6, 1), rng.uniform(2, 4), rng.uniform(2.5, 5)
    middle, hinge = half + gap / 2, rng.uniform(0.2, 0.7) * tall
    lens = outline(ellipse(half, tall, at=(middle, 0), exponent=exponent))
    end, reach = middle + half + rim, rng.uniform(100, 140)
    ring = lens.offset(rim) + strip([(middle + 0.5 * half, hinge), (end, hinge)], 2 * rim + 2)
    bridge = strip(curve([(-gap, 0.2 * tall), (0, 0.45 * tall), (gap, 0.2 * tall)], along=2), 2 * rim)
    frame = ring + ring.mirror((1, 0)) + bridge - lens - lens.mirror((1, 0))
    front = union(plate(frame, thick), plate((lens + lens.mirror((1, 0))).offset(0.5), rng.uniform(1.5, 2.5)))
    line = curve([(-1, hinge), (0.7 * reach, hinge), (0.85 * reach, hinge - 4), (reach, hinge - 22)], along=2)
    arm = plate(strip(line, rng.uniform(3, 8)), rng.uniform(2, 4)).rotate((90, 0, 90))
    return union(front.rotate((90, 0, 0)), arm.translate((end, 0, 0)), arm.translate((-end, 0, 0)))


def _shoe(rng: np.random.Generator) -> "Manifold":
    """A sole, and an upper that rises from the toe to the opening for the foot."""
    length = log_uniform(rng, 115, 285)
    half, sole, ankle = length * rng.uniform((0.16, 0.04, 0.26), (0.2, 0.1, 0.42))
    ankle, toe = min(ankle, 98), length * rng.uniform(0.1, 0.16)
    rows = [(-0.47, 0.65, 0.9 * ankle), (-0.3, 0.75, ankle), (-0.08, 0.78, 0.85 * ankle),
            (0.2, 0.95, 0.5 * (ankle + toe)), (0.36, 0.88, toe), (0.47, 0.5, 0.7 * toe)]  # fmt: skip
    stations = [(x * length, 0, 0, w * half, h) for x, w, h in rows]
    upper = body(stations, exponent=2.4, rounding=(0.08 * length, 0.06 * length)).trim_by_plane((0, 0, 1), 0)
    rim = [(-0.5, 0), (-0.42, 0.65), (-0.1, 0.75), (0.22, 1), (0.42, 0.7), (0.5, 0)]
    rim += [(x, -y) for x, y in rim[-2:0:-1]]
    bottom = plate(smooth_outline(np.array(rim) * (length, half)), sole, z=0.5 - sole / 2)
    opening = plate(outline(ellipse(0.17 * length, 0.57 * half, at=(-0.26 * length, 0))), ankle, z=0.9 * ankle)
    return union(upper - opening, bottom)


def _drill(rng: np.random.Generator) -> "Manifold":
    """On its side: a motor, a chuck with a bit, a slanting grip, and a battery below it now and then."""
    length = log_uniform(rng, 110, 215)
    half, chuck, long = length * rng.uniform((0.13, 0.07, 0.62), (0.18, 0.1, 0.75))
    rows = [(x * long, 0, 0, r * half, r * half) for x, r in ((0, 0.9), (0.3, 1), (0.75, 0.95), (1, 0.75))]
    motor = body(rows, exponent=2.4, rounding=(0.2 * half, 2))
    cone = [(0, long - 3), (chuck, long - 3), (chuck, 0.85 * length), (0.4 * chuck, length), (0, length)]
    grip, wide, thick = length * rng.uniform(0.5, 0.7), half * rng.uniform(0.6, 0.85), half * rng.uniform(0.5, 0.75)
    handle = body([(0, 0, 0, wide, thick), (grip, 0, 0, wide, thick)], exponent=2.4, rounding=(0, 3))
    if rng.random() < 0.7:
        size = half * rng.uniform(0.6, 1.2), length * rng.uniform(0.3, 0.45), 2 * thick * rng.uniform(1, 1.5)
        handle = union(handle, rounded_block(size, 3, at=(grip, 0.4 * wide, 0)))
    handle = handle.rotate((0, 0, rng.uniform(-110, -85))).translate((rng.uniform(0.15, 0.4) * long, 0, 0))
    bit = cylinder(0.25 * chuck, length * rng.choice([0.1, rng.uniform(0.2, 0.5)]), axis="x", at=(length, 0, 0))
    return union(motor, revolve(cone, axis="x"), handle, bit)


def _teapot(rng: np.random.Generator) -> "Manifold":
    """A round body with a spout, a handle across from it, and a lid with a knob."""
    radius = log_uniform(rng, 36, 58)
    half, rod, knob = radius * rng.uniform(0.65, 0.9), radius * rng.uniform(0.07, 0.12), radius * rng.uniform(0.12, 0.2)
    pot = revolve(round_profile(radius, half, taper=rng.uniform(-0.15, 0.1))).trim_by_plane((0, 0, 1), -0.85 * half)
    tip = radius * rng.uniform(1.4, 1.75), half * rng.uniform(0.5, 0.9)
    path = curve([(0.6 * radius, 0, -0.35 * half), (1.15 * radius, 0, -0.05 * half), (tip[0], 0, tip[1])])
    spout = tube(path, radius * np.linspace(rng.uniform(0.24, 0.32), 0.11, len(path)), normal=UPRIGHT)
    loop = [(-0.75, 0.5), (-1.4, 0.55), (-1.4 - rng.uniform(0.05, 0.25), 0.1), (-1.35, -0.3), (-0.8, -0.4)]
    handle = tube(curve([(x * radius, 0, z * half) for x, z in loop]), [(rod, 1.3 * rod)], normal=UPRIGHT)
    lid = cylinder(radius * rng.uniform(0.4, 0.6), 0.3 * half, at=(0, 0, 0.85 * half))
    return union(pot, spout, handle, lid, sphere(knob, at=(0, 0, half + 0.7 * knob)))


OTHERS = (
    _pump_bottle,
    _hair_dryer,
    _game_controller,
    _toy_car,
    _spectacles,
    _shoe,
    _drill,
    _teapot,
)
"""What draws each kind."""
