"""More box-like things on a large face: chargers, round-edged cases, cartons, radios, crates, gifts."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._household.boxes import bevelled, rectangle, tapered
from millisight.meshes._household.cans import grooved
from millisight.meshes._shapes import (
    block,
    cylinder,
    disc,
    ellipse,
    fillet,
    log_uniform,
    outline,
    plate,
    revolve,
    rounded_block,
    sphere,
    strip,
    tube,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

_HIGHEST = 112.0  # as it lies [mm]


def _pillow(half: np.ndarray, plan: float, side: float) -> "Manifold":
    """What is round all over: a superellipsoid of these half axes, and of these exponents in plan and upright."""

    def swell(points: np.ndarray) -> np.ndarray:
        x, y, z = np.abs(points).T
        return half * points / (((x**plan + y**plan) ** (side / plan) + z**side) ** (1 / side))[:, None]

    return sphere(min(float(half.max()), 45)).warp_batch(swell).simplify(0.03)


def _wall(area: "CrossSection", wide: float, thick: float, *, z: float) -> "Manifold":
    """A band about the rim of an area: from `wide` within it outwards."""
    return plate(area.offset(20) - area.offset(-wide), thick, z=z)


def _grid(count: int, pitch: float) -> np.ndarray:
    """Places in a row about 0."""
    return pitch * (np.arange(count) - (count - 1) / 2)


def _charger(rng: np.random.Generator) -> "Manifold":
    """A charger or a plug, strongly rounded: two or three pins on top or on one end, a socket or a cable opposite."""
    long = log_uniform(rng, 30, 105)
    half = long / 2 * np.array([1, rng.uniform(0.5, 1), rng.uniform(0.3, 0.75)])
    body = _pillow(half, log_uniform(rng, 2.5, 12), log_uniform(rng, 2.6, 12))
    reach, gap, pin = rng.uniform(9, 20), half.min() * rng.uniform(0.4, 0.65), rng.uniform(1.2, 2.4)
    third, on_top = rng.random() < 0.3, rng.random() < 0.5
    blade = rounded_block((1.5 * pin, 4 * pin, 2 * reach), 0.5 * pin)
    shape, deep = cylinder(pin, 2 * reach) if rng.random() < 0.5 else blade, half[2] if on_top else half[0]
    pins = union(*(shape.translate((x, y, deep)) for x, y in [(-gap, 0), (gap, 0), (0, 0.9 * gap)][: 2 + third]))
    pins = union(pins, cylinder(gap * rng.uniform(0.3, 1.8), 6, at=(0, 0, deep)))
    body = union(body, pins if on_top else pins.rotate((0, 0, 90)).rotate((0, 90, 0)))
    if rng.random() < 0.5:
        rods = (rng.uniform(1.5, 3), rng.uniform(30, 80)), (rng.uniform(3.5, 5), rng.uniform(10, 25))
        return union(body, *(cylinder(*rod, axis="x", at=(-half[0], 0, 0)) for rod in rods))
    socket = 8, half[1] * rng.uniform(0.4, 1), half[2] * rng.uniform(0.3, 0.5)
    return body - rounded_block(socket, 1, at=(-half[0], 0, 0))


def _round_case(rng: np.random.Generator) -> "Manifold":
    """A case for jewels, soap or earphones, round all over: a groove or a lip at its seam, a button, a hinge."""
    long = log_uniform(rng, 32, 165)
    x, y, low, up = long / 2 * rng.uniform((1, 0.5, 0.2, 0.2), (1, 1, 0.55, 0.75))
    low, up, plan = min(low, 40), min(up, 65), rng.uniform(2, 6)
    lower = _pillow(np.array([x, y, low]), plan, rng.uniform(2.3, 5)).trim_by_plane((0, 0, -1), 0)
    upper = _pillow(np.array([x, y, up]), plan, rng.uniform(2, 5)).trim_by_plane((0, 0, 1), -0.2)
    case = union(lower, upper).trim_by_plane((0, 0, 1), -low * rng.uniform(0.85, 0.99))
    rim, thick = outline(ellipse(x, y, exponent=plan)), rng.uniform(1, 2.5)
    if rng.random() < 0.5:
        case = union(case, plate(rim.offset(rng.uniform(0.8, 3)), thick))
    else:
        case = case - _wall(rim, rng.uniform(1, 2), thick, z=rng.uniform(0, 0.15) * up)
    parts = [rounded_block((0.25 * x, 6, 0.5 * low), 1, at=(0, -y, 0))]
    parts.append(cylinder(0.12 * low + 1, 0.8 * x, axis="x", at=(0, y, 0)))
    return union(case, *parts[: rng.integers(3)])


def _bail(long: float, out: float, thick: float, rod: float) -> "Manifold":
    """A handle that stands out along y from a side at y = 0."""
    line = [(-long / 2, -0.6 * rod), (-long / 2, out), (long / 2, out), (long / 2, -0.6 * rod)]
    return plate(strip(line, rod), max(thick, 3))


def _ribs(long: float, wide: float, thick: float, rng: np.random.Generator) -> "Manifold":
    """Ribs on a face at z = 0: bars along it, bars across it, or a frame."""
    choice, count, out = rng.integers(3), int(rng.integers(2, 7)), 2 * thick
    if choice == 0:
        frame = rectangle(0.8 * long, 0.75 * wide, 0.08 * wide)
        return plate(frame - frame.offset(-rng.uniform(0.06, 0.25) * wide), out)
    across, along = (wide, long) if choice == 1 else (long, wide)
    bars = [block((0.8 * along, 0.4 * across / count, out), at=(0, y, 0)) for y in _grid(count, 0.85 * across / count)]
    return union(*bars).rotate((0, 0, 90.0 * int(choice - 1)))


def _tool_case(rng: np.random.Generator) -> "Manifold":
    """A lying case of two shells with a gap between them, ribs on top, latches, and a handle in front."""
    long = log_uniform(rng, 50, 200)
    wide, high = long * rng.uniform(0.35, 0.9), min(long * log_uniform(rng, 0.12, 0.55), 105)
    area, split, gap = rectangle(long, wide, rng.uniform(0.03, 0.15) * wide), rng.uniform(-0.1, 0.2) * high, 1.5
    case = bevelled(area, high, rng.uniform(0.08, 0.25) * high) - _wall(area, 1.5, gap, z=split)
    parts = [_ribs(0.85 * long, 0.75 * wide, rng.uniform(0.8, 3), rng).translate((0, 0, high / 2))]
    grip, out, thick = long * rng.uniform(0.2, 0.4), wide * rng.uniform(0.12, 0.25), high * rng.uniform(0.12, 0.3)
    parts.append(_bail(grip, out, thick, max(0.4 * out, 3)).rotate((180, 0, 0)).translate((0, -wide / 2, split)))
    for side in (-1, 1):
        at = side * (grip / 2 + (long - grip) / 4)
        latch = rounded_block((0.1 * long, 7, 0.5 * high), 1, at=(at, -wide / 2, split))
        parts += [latch, cylinder(0.06 * high + 1, 0.2 * long, axis="x", at=(side * 0.28 * long, wide / 2, split))]
    return union(case, *parts)


def _drink_carton(rng: np.random.Generator) -> "Manifold":
    """A carton of milk or juice, mostly lying: a gable with tucked sides, or a slanting top; a screw cap on it."""
    long = log_uniform(rng, 50, 165)
    wide, deep = long * rng.uniform((0.3, 0.22), (0.55, 0.5))
    up, fin = deep * rng.uniform((0.35, 0.12), (0.6, 0.25))
    body, top = block((wide, deep, long), at=(0, 0, long / 2)), plate(rectangle(wide, deep), 0.1, z=long)
    cap, rise = max(min(wide, deep) * rng.uniform(0.13, 0.25), 4), rng.uniform(6, 14)
    if rng.random() < 0.6:
        tuck = outline([(-wide / 2, long + up), (-0.12 * wide, long + 0.3 * up), (-wide / 2 - 1, long + 0.2 * up)])
        tucks = plate(tuck + tuck.mirror((1, 0)), 0.3 * deep).rotate((90, 0, 0))
        roof = body.batch_hull([top, plate(rectangle(wide, 2), 0.1, z=long + up)]) - tucks
        carton = union(body, roof, block((wide, 2.5, fin + 2), at=(0, 0, long + up + fin / 2 - 1)))
        slope, at = float(np.degrees(np.arctan2(up, deep / 2))), (0, -0.27 * deep, long + 0.48 * up + 1)
    else:
        back = plate(rectangle(wide, deep * rng.uniform(0.1, 0.5)), 0.1, z=long + 0.4 * up)
        roof = body.batch_hull([top, back.translate((0, 0.2 * deep, 0))])
        carton = union(body, roof).trim_by_plane((0, -1, 0), -deep / 2)
        slope, at = 0, (0.1 * wide, 0.15 * deep, long + 0.4 * up)
    if rng.random() < 0.7:
        carton = union(carton, cylinder(cap, rise).rotate((slope, 0, 0)).translate(at))
    stands = carton.bounding_box()[5] < _HIGHEST and rng.random() < 0.3
    return carton if stands else carton.rotate((0, 0, 90.0 * int(rng.integers(4)))).rotate((0, 90, 0))


def _egg_carton(rng: np.random.Generator) -> "Manifold":
    """Cups below and bumps or a smooth lid above a rim, in rows; or a blister pack, its bumps up or down."""
    columns, rows = int(rng.integers(2, 7)), int(rng.integers(1, 4))
    pitch = min(log_uniform(rng, 16, 55), 225 / max(columns, rows), 165 / rows)
    low, up = pitch * rng.uniform((0.25, 0.2), (0.9, 0.7))
    flange, cell = rng.uniform(1.5, 4), pitch * rng.uniform(0.36, 0.49)
    area = rectangle(columns * pitch + rng.uniform(2, 12), rows * pitch + rng.uniform(2, 12), 0.12 * pitch)
    places = [(x, y) for x in _grid(columns, pitch) for y in _grid(rows, pitch)]
    parts, end = [plate(area, flange)], rng.uniform(0.5, 0.85)
    cup = revolve([(0, 0), (cell, 0), (cell, -flange), (end * cell, -low), (0, -low)])
    parts += [cup.translate((x, y, 0)) for x, y in places] if rng.random() < 0.6 else []
    square = rectangle(1.9 * cell, 1.9 * cell, 0.3 * cell)
    turn, power = np.linspace(0, np.pi / 2, 16), rng.uniform(0.5, 1)
    arc = np.column_stack([cell * np.cos(turn) ** power, up * np.sin(turn) ** power])[:-1]
    bump = rng.choice([tapered(square, square.scale((end, end)), up), revolve([(0, -0.5), *arc, (0, up)])])
    if rng.random() < 0.65:
        parts += [bump.translate((x, y, flange / 2 - 0.2)) for x, y in places]
    else:
        lid = tapered(area.offset(-2), area.offset(-0.2 * pitch), up + 2)
        notch = block((0.12 * pitch, 3 * rows * pitch, 0.5 * up), at=(0, 0, up))
        parts.append(lid - union(*(notch.translate((x, 0, 0)) for x in _grid(columns - 1, pitch))))
    return union(*parts).rotate((180 * int(rng.random() < 0.2), 0, 0))


def _knob(radius: float, high: float, rng: np.random.Generator) -> "Manifold":
    """A knob to turn, from z = 0 up: smooth or grooved, with a wider foot now and then."""
    area = grooved(radius, rng) if rng.random() < 0.5 else disc(radius)
    foot = cylinder(radius * rng.choice([0.9, 1.2]), 0.3 * high + 2, at=(0, 0, 0.15 * high - 1))
    return union(plate(area, high + 2, z=high / 2 - 1), foot)


def _faced(thing: "Manifold", rng: np.random.Generator) -> "Manifold":
    """A thing whose front is up, left on its back, or stood up where it is low enough."""
    lower, upper = np.reshape(thing.bounding_box(), (2, 3))
    stands = upper[1] - lower[1] < _HIGHEST and rng.random() < 0.5
    return thing.rotate((90, 0, 0)) if stands else thing


def _radio(rng: np.random.Generator) -> "Manifold":
    """A radio: a dial and knobs, a grille of slits, a sunk scale, a handle or an aerial."""
    long = log_uniform(rng, 45, 225)
    tall, deep = long * rng.uniform(0.45, 0.8), min(long * rng.uniform(0.18, 0.45), 85)
    corner = rng.uniform(0.03, 0.25) * tall
    parts = [bevelled(rectangle(long, tall, corner), deep, rng.uniform(0.05, 0.2) * deep)]
    front, side = deep / 2, rng.choice([-1, 1])
    dial, x = tall * rng.uniform(0.1, 0.2), side * long * 0.27
    parts.append(_knob(dial, rng.uniform(3, 10), rng).translate((x, -0.12 * tall, front)))
    for place in _grid(int(rng.integers(0, 4)), 0.13 * long):
        parts.append(_knob(0.045 * long, rng.uniform(2, 6), rng).translate((x + place, -0.33 * tall, front)))
    speaker, sunk, count = tall * rng.uniform(0.26, 0.36), rng.uniform(2, 5), int(rng.integers(5, 10))
    rows = _grid(count, 1.8 * speaker / count)
    slits = [block((2 * np.sqrt(speaker**2 - y**2), speaker / count, 2 * sunk), at=(0, y, 0)) for y in rows]
    scale = block((0.38 * long, 0.16 * tall, 2 * sunk), at=(x, 0.26 * tall, front))
    holes, top = union(*slits).translate((-side * 0.22 * long, 0, front)), tall / 2
    if rng.random() < 0.5:
        reach, rise = rng.uniform(0.6, 0.9) * (long - 2 * corner), tall * rng.uniform(0.12, 0.25)
        parts.append(_bail(reach, rise, rng.uniform(0.15, 0.3) * deep, max(0.2 * rise, 3)).translate((0, top, 0)))
    else:
        rod = rng.uniform(1.5, 3)
        parts.append(cylinder(rod, 0.85 * long, axis="x", at=(0, top + 0.6 * rod, -0.2 * deep)))
        parts.append(block((0.08 * long, 4 * rod, 3 * rod), at=(-0.4 * long, top, -0.2 * deep)))
    return _faced(union(*parts) - union(holes, scale), rng)


def _camera(rng: np.random.Generator) -> "Manifold":
    """A camera: a lens of several rings on its front, a hump and knobs on its top, a grip, a sunk window."""
    long = log_uniform(rng, 32, 150)
    tall, deep = long * rng.uniform(0.5, 0.9), long * rng.uniform(0.22, 0.6)
    area = rectangle(long, tall, rng.uniform(0.05, 0.25) * tall)
    parts, front = [bevelled(area, deep, rng.uniform(0.06, 0.25) * deep)], deep / 2
    lens, x, y = tall * rng.uniform(0.2, 0.42), long * rng.uniform(-0.12, 0.12), -0.04 * tall
    radius, level = lens, front - 0.05 * lens
    profile: list[tuple[float, float]] = [(0.0, level)]
    for _ in range(rng.integers(1, 4)):
        rise = lens * rng.uniform(0.2, 0.6)
        profile += [(radius, level), (radius, level + rise)]
        level, radius = level + rise, radius * rng.choice([1.06, rng.uniform(0.75, 0.93)])
    bowl = profile[-1][0] * rng.uniform(0.55, 0.85)
    profile += [(bowl, level), (0.9 * bowl, level - 0.15 * lens), (0, level - rng.uniform(0, 0.15) * lens)]
    parts.append(revolve(profile).translate((x, y, 0)))
    top, hump, button = tall / 2, long * rng.uniform(0.12, 0.24), 0.05 * long + 1
    line = [(-hump, top - 2), (hump, top - 2), (0.6 * hump, top + 0.13 * tall), (-0.6 * hump, top + 0.13 * tall)]
    extras = [
        plate(fillet(outline(line), 0.02 * tall), 0.7 * deep).translate((x, 0, 0)),
        rounded_block((0.16 * long, 0.85 * tall, 0.6 * deep), 0.04 * long, at=(-0.4 * long, 0, front)),
        cylinder(button, 0.16 * tall, axis="y", at=(0.36 * long, top, 0)),
        cylinder(1.6 * button, 0.12 * tall, axis="y", at=(-0.34 * long, top, 0)),
    ]
    parts += [part for part in extras if rng.random() < 0.6]
    return _faced(union(*parts) - block((0.16 * long, 0.12 * tall, 4), at=(0.34 * long, 0.28 * tall, front)), rng)


def _crate(rng: np.random.Generator) -> "Manifold":
    """A closed crate: planks and corner posts all about it; or of plastic, with rows of pockets in its sides."""
    long = log_uniform(rng, 38, 212)
    wide, high = long * rng.uniform(0.5, 0.95), min(long * rng.uniform(0.2, 0.65), 90)
    thick, rows, columns = max(0.03 * long, 1.5), int(rng.integers(1, 5)), int(rng.integers(2, 7))
    if rng.random() < 0.5:
        x, y, share, tier = long + 2 * thick, wide + 2 * thick, rng.uniform(0.7, 0.93), high / rows
        parts = [block((long, wide, high)), *(block((x, y, share * tier), at=(0, 0, z)) for z in _grid(rows, tier))]
        plank = block((x, share * y / columns, 2 * thick))
        parts += [plank.translate((0, place, high / 2)) for place in _grid(columns, y / columns)]
        post, out = rng.uniform(0.06, 0.12) * long, 2 * thick * rng.uniform(1.5, 2.2)
        at = rng.choice([0.5 * (x - post), rng.uniform(0.25, 0.4) * long])
        batten = union(block((post, y + 2 * thick, high + thick)), block((post, 0.9 * wide, out), at=(0, 0, high / 2)))
        return union(*parts, batten.translate((at, 0, 0)), batten.translate((-at, 0, 0)))
    rim, holes = rectangle(long, wide, 0.05 * wide), []
    for turn, reach, across in ((0, wide, long), (90, long, wide)):
        pitch, tier = 0.85 * across / columns, 0.75 * high / rows
        pocket = block((0.7 * pitch, reach, 0.7 * tier), at=(0, -0.85 * reach, 0.45 * high))
        pockets = union(*(pocket.translate((x, 0, z)) for x in _grid(columns, pitch) for z in _grid(rows, tier)))
        holes += [pockets.rotate((0, 0, turn)), pockets.rotate((0, 0, turn + 180))]
    lid = plate(rim.offset(rng.uniform(2, 4)), 0.12 * high + 2, z=high)
    ribs = _ribs(long, wide, rng.uniform(0.8, 2.5), rng).translate((0, 0, 1.06 * high + 1))
    return union(tapered(rim.offset(-rng.uniform(0, 0.05) * wide), rim, high) - union(*holes), lid, ribs)


def _lidded(long: float, wide: float, high: float, rng: np.random.Generator) -> "Manifold":
    """A box from z = 0 up, rectangular, round-cornered or oval, its lid pulled over it, with a ribbon now and then."""
    area = rectangle(long, wide, 0.2 * wide * int(rng.random() < 0.3))
    if rng.random() < 0.15:
        area = outline(ellipse(long / 2, wide / 2))
    deep, over = max(high * rng.uniform(0.15, 0.95), 1.6), rng.uniform(0.8, 2.5)
    box = union(plate(area, high - 1, z=(high - 1) / 2), plate(area.offset(over), deep, z=high - deep / 2))
    band, thick, shift = rng.uniform(0.06, 0.18) * wide, rng.uniform(0.8, 1.6), rng.uniform(-0.25, 0.25) * long
    stripes = [block((band, 2 * wide, 4 * high), at=(shift, 0, 0)), block((2 * long, band, 4 * high))]
    cover = plate(area.offset(over + thick), high + thick, z=(high + thick) / 2)
    box = union(box, cover ^ union(*stripes[: rng.integers(3)]))
    if rng.random() < 0.6:
        return box
    loop, rise, turn = wide * rng.uniform(0.12, 0.25), min(wide * rng.uniform(0.06, 0.14), 11), rng.uniform(0, 180)
    path = np.insert(ellipse(loop, rise, at=(0.9 * loop, rise), count=40), 1, 0, axis=1)
    bow = tube(path, [(thick, band / 2)], normal=(0, 1, 0), closed=True, around=12).rotate((0, 0, turn))
    knot = rounded_block((band, band, 1.4 * rise), 0.3 * min(band, rise), at=(0, 0, 0.5 * rise))
    return union(box, union(bow, bow.rotate((0, 0, 180)), knot).translate((shift, 0, high + thick - 0.5)))


def _gift(rng: np.random.Generator) -> "Manifold":
    """A box for a game, shoes or a gift with an overlapping lid and a ribbon; or two of them, stacked askew."""
    long = log_uniform(rng, 34, 205)
    wide, high = long * rng.uniform(0.5, 1), float(np.clip(long * log_uniform(rng, 0.12, 0.7), 9, 84))
    if rng.random() < 0.6:
        return _lidded(long, wide, high, rng)
    low, small = high * rng.uniform(0.3, 0.65), rng.uniform(0.55, 1, 2) * (long, wide)
    upper = _lidded(small.max(), small.min(), high - low, rng).rotate((0, 0, rng.normal(0, 12)))
    dx, dy = rng.uniform(-0.12, 0.12, 2) * (long, wide)
    return union(_lidded(long, wide, low, rng), upper.translate((dx, dy, low - 0.3)))


def _battery_pack(rng: np.random.Generator) -> "Manifold":
    """A power tool's battery: bevels and buttons, on top a tower, or a step with two rails, and slots for contacts."""
    long = log_uniform(rng, 34, 160)
    wide, high = long * rng.uniform(0.45, 0.95), min(long * log_uniform(rng, 0.18, 0.7), 80)
    area, top = rectangle(long, wide, rng.uniform(0.05, 0.25) * wide), high / 2
    reach, rise, neck = long * rng.uniform(0.4, 0.9), high * rng.uniform(0.15, 0.4), wide * rng.uniform(0.35, 0.6)
    parts, x = [bevelled(area, high, rng.uniform(0.06, 0.3) * high)], (reach - long) / 2 + 0.04 * long
    if rng.random() < 0.35:
        x, rise = x * rng.uniform(-1, 1), min(rise * rng.uniform(1.5, 4), 28)
        tower = outline(ellipse(0.35 * reach, 0.35 * wide, at=(x, 0), exponent=rng.uniform(2, 5)))
        parts.append(plate(tower, rise + 4, z=top + rise / 2 - 2))
    else:
        rail = rounded_block((reach, neck * rng.uniform(1.3, 1.7), 0.5 * rise), 0.15 * rise)
        post = block((reach, neck, rise + 4), at=(0, 0, rise / 2 - 2))
        parts.append(union(post, rail.translate((0, 0, 0.75 * rise))).translate((x, 0, top)))
    buttons = rng.uniform(0.12, 0.35) * long, wide + 6, rng.uniform(0.2, 0.5) * high
    parts.append(rounded_block(buttons, 0.8, at=(rng.uniform(-0.2, 0.3) * long, 0, 0)))
    count = int(rng.integers(2, 6))
    slot = block((0.35 * reach, 0.34 * neck / count, 3 * rise), at=(x - reach / 2, 0, top + rise))
    slots = [slot.translate((0, y, 0)) for y in _grid(count, 0.85 * neck / count)]
    slots += [_wall(area, 0.04 * wide, 0.06 * high, z=z) for z in _grid(int(rng.integers(0, 4)), 0.15 * high)]
    return union(*parts) - union(*slots)


CASES = (
    _charger,
    _round_case,
    _tool_case,
    _drink_carton,
    _egg_carton,
    _radio,
    _camera,
    _crate,
    _gift,
    _battery_pack,
)
"""What draws each kind."""
