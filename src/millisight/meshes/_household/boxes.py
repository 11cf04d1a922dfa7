"""Box-like things on a large face: packages, cases, devices, bricks."""

from typing import TYPE_CHECKING

import numpy as np

from millisight.meshes._shapes import (
    block,
    cylinder,
    disc,
    fillet,
    log_uniform,
    outline,
    plate,
    rounded_block,
    sphere,
    strip,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

_OVERLAP = 0.5  # of parts that touch [mm]


def rectangle(long: float, wide: float, corner: float = 0.0) -> "CrossSection":
    """A rectangle about the origin, its corners rounded now and then."""
    x, y = long / 2, wide / 2
    area = outline([(-x, -y), (x, -y), (x, y), (-x, y)])
    return fillet(area, corner) if corner else area


def tapered(lower: "CrossSection", upper: "CrossSection", high: float) -> "Manifold":
    """What spans two convex areas, the upper one `high` above the lower one, which lies at z = 0."""
    from manifold3d import Manifold

    return Manifold.batch_hull([plate(lower, 0.1, z=0.05), plate(upper, 0.1, z=high - 0.05)])


def bevelled(area: "CrossSection", high: float, bevel: float) -> "Manifold":
    """A convex area, made `high` thick about z = 0, its upper and lower edges bevelled."""
    core = plate(area, high - 2 * bevel)
    return core.batch_hull([core, plate(area.offset(-bevel), high)])


def _carton(rng: np.random.Generator) -> "Manifold":
    """A carton: closed, with a window sunk into its top; or open, with flaps about its rim."""
    long, wall = log_uniform(rng, 40, 150), rng.uniform(1.2, 3)
    wide, high = long * rng.uniform(0.4, 1), min(long * log_uniform(rng, 0.25, 1.2), 80)
    carton = block((long, wide, high))
    if rng.random() < 0.4:
        window = rectangle(long * rng.uniform(0.4, 0.8), wide * rng.uniform(0.4, 0.75), rng.uniform(0, 0.1) * wide)
        return carton - plate(window, rng.uniform(0.08, 0.5) * high, z=high / 2)
    carton = carton - block((long - 2 * wall, wide - 2 * wall, high), at=(0, 0, wall))
    deep = wide * rng.uniform(0.25, 0.5)
    for side in rng.permutation(4)[: rng.integers(1, 5)]:
        reach, across = (wide, long) if side % 2 else (long, wide)
        flap = block((deep, across, wall), at=(deep / 2, 0, 0)).rotate((0, rng.uniform(-100, 30), 0))
        carton = union(carton, flap.translate((reach / 2 - wall, 0, high / 2 - wall / 2)).rotate((0, 0, 90 * side)))
    return carton


def _book(rng: np.random.Generator) -> "Manifold":
    """A lying book: two covers that stand out over the pages, and a flat or round spine."""
    long, thick = log_uniform(rng, 70, 255), log_uniform(rng, 9, 55)
    wide, cover, over = long * rng.uniform(0.6, 0.85), rng.uniform(1.5, 3.5), long * rng.uniform(0.012, 0.03)
    turn, bulge = np.linspace(np.pi / 2, 3 * np.pi / 2, 30), rng.choice([0.02, rng.uniform(0.1, 0.35)]) * thick
    spine = np.column_stack([bulge * np.cos(turn), thick / 2 * np.sin(turn)])
    section = outline([*spine, (wide, -thick / 2), (wide, thick / 2)])
    inner = thick / 2 - cover
    between_covers = outline([(cover, -inner), (wide + 1, -inner), (wide + 1, inner), (cover, inner)])
    pages = block((long - 2 * over, wide - over - cover + _OVERLAP, thick - cover))
    covers = plate(section - between_covers, long).rotate((90, 0, 0)).rotate((0, 0, 90))
    return union(covers, pages.translate((0, (wide - over + cover - _OVERLAP) / 2, 0)))


def _case(rng: np.random.Generator) -> "Manifold":
    """A case with a domed or bevelled lid, a seam about it, and a clasp in front."""
    long = log_uniform(rng, 45, 240)
    wide, low = long * rng.uniform(0.4, 0.9), min(long * rng.uniform(0.1, 0.35), 60)
    arch, corner = min(wide * rng.uniform(0.15, 0.5), 60), rng.uniform(0.03, 0.2) * wide
    foot = rectangle(long, wide, corner)
    if rng.random() < 0.5:
        turn = np.linspace(0, np.pi, 50)
        arc = outline(np.column_stack([wide / 2 * np.cos(turn), arch * np.sin(turn)]))
        lid = plate(arc, long).rotate((90, 0, 0)).rotate((0, 0, 90)) ^ plate(foot, 4 * arch)
    else:
        lid = tapered(foot, foot.offset(-rng.uniform(0.08, 0.25) * wide), arch)
    clasp = rounded_block((long * rng.uniform(0.08, 0.25), 6, rng.uniform(0.5, 1) * low), 1, at=(0, -wide / 2, 0))
    seam = plate(foot.offset(rng.uniform(0.8, 2.5)), rng.uniform(1.5, 4))
    return union(tapered(foot.offset(-0.02 * wide), foot, low).translate((0, 0, -low)), lid, clasp, seam)


def _soap(rng: np.random.Generator) -> "Manifold":
    """A bar of soap, rounded all over, with a dent in its top now and then."""
    half = log_uniform(rng, 40, 120) / 2 * np.array([1, rng.uniform(0.5, 0.85), rng.uniform(0.25, 0.45)])
    exponent = rng.uniform(2.3, 5)
    soap = sphere(half[0]).warp_batch(
        lambda points: half * points / (np.abs(points) ** exponent).sum(axis=1, keepdims=True) ** (1 / exponent)
    )
    soap = soap.simplify(0.03)
    if rng.random() < 0.5:
        dent = plate(disc(1.0).scale(half[:2] * rng.uniform(0.4, 0.7)), half[2] * rng.uniform(0.15, 0.4), z=half[2])
        return soap - dent
    return soap


def _phone(rng: np.random.Generator) -> "Manifold":
    """A phone or a tablet on its face, a bump with lenses in one corner of its back."""
    long, thick = log_uniform(rng, 100, 260), rng.uniform(6, 14)
    wide = long * (rng.uniform(0.44, 0.56) if long < 175 else rng.uniform(0.6, 0.78))
    bevel = rng.uniform(0.1, 0.4) * thick
    phone = bevelled(rectangle(long, wide, rng.uniform(4, 13)), thick, bevel)
    lenses, lens, rise = int(rng.integers(1, 4)), rng.uniform(4.5, 8), rng.uniform(1, 3)
    x, y = long / 2 - lens - bevel - 5, wide / 2 - lens - bevel - 5
    row = [(x - 2.3 * lens * place, y) for place in range(lenses)]
    bump = plate(strip([row[0], (row[-1][0] - 0.1, y)], 2 * lens + 6), 2 * rise, z=thick / 2)
    return union(phone, bump, *(cylinder(lens, 2, at=(*place, thick / 2 + rise)) for place in row))


def _device(rng: np.random.Generator) -> "Manifold":
    """A housing on four feet, slits in its top, and two short antennas or the stub of a cable at its back."""
    long = log_uniform(rng, 55, 220)
    wide, high = long * rng.uniform(0.4, 0.95), min(long * log_uniform(rng, 0.15, 0.5), 70)
    bevel, foot = rng.uniform(0.05, 0.2) * min(high, 0.5 * wide), rng.uniform((0.04 * wide, 3), (0.09 * wide, 9))
    housing = bevelled(rectangle(long, wide, rng.uniform(0.02, 0.12) * wide), high, bevel)
    count, pitch = int(rng.integers(4, 11)), rng.uniform(0.04, 0.08) * long
    corners = [(0.36 * long * i, 0.36 * wide * j, -high / 2) for i in (-1, 1) for j in (-1, 1)]
    feet = [cylinder(*foot, at=corner) for corner in corners]
    start, slit = rng.uniform(-0.2, 0.2) * long - pitch * count / 2, (0.45 * pitch, wide * rng.uniform(0.2, 0.6), 8)
    slits = [block(slit, at=(x, 0, high / 2)) for x in start + pitch * np.arange(count) if abs(x) < 0.4 * long]
    rod, reach = rng.uniform(2.5, 5), rng.uniform(20, 55)
    cable = [cylinder(rod, reach, axis="y", at=(0.2 * long, (wide + reach) / 2 - 3, 0))]
    masts = [cylinder(rod, reach, at=(0.35 * long * i, wide / 2 + rod - 2, reach / 2)) for i in (-1, 1)]
    return union(housing, *feet, *(cable if rng.random() < 0.5 else masts)) - union(*slits)


def _lunch_box(rng: np.random.Generator) -> "Manifold":
    """A box that widens upwards, a wider lid with a raised middle, and a clip at two or four sides."""
    long = log_uniform(rng, 90, 235)
    wide, high, over = long * rng.uniform(0.5, 1), min(long * rng.uniform(0.2, 0.6), 100), rng.uniform(2, 5)
    rim, lid = rectangle(long, wide, rng.uniform(0.06, 0.25) * wide), rng.uniform(5, 14)
    tub = tapered(rim.offset(-rng.uniform(0.01, 0.09) * wide), rim, high)
    top = union(plate(rim.offset(over), lid, z=high), plate(rim.offset(-0.08 * wide), lid + 5, z=high))
    clips, across = [], wide * rng.uniform(0.2, 0.45)
    for side in range(0, 4, int(rng.integers(1, 3))):
        reach = (wide if side % 2 else long) / 2 + over
        clip = rounded_block((5, across, lid + rng.uniform(10, 12)), 1.5, at=(reach, 0, high - 4))
        hinge = block((over + 2, 0.8 * across, 4), at=(reach - over / 2, 0, high - lid / 2 - 2))
        clips.append(union(clip, hinge).rotate((0, 0, 90 * side)))
    return union(tub, top, *clips)


def _matchbox(rng: np.random.Generator) -> "Manifold":
    """A sleeve, and an open tray that is drawn out of it by a third or more."""
    long, wall = log_uniform(rng, 35, 145), rng.uniform(0.8, 1.8)
    wide, high = long * rng.uniform(0.5, 0.8), max(long * rng.uniform(0.2, 0.4), 10)
    sleeve = block((long, wide, high)) - block((long + 2, wide - 2 * wall, high - 2 * wall))
    tray_wide, tray_high = wide - 2 * wall + 0.2, high - 2 * wall + 0.2
    tray = block((long, tray_wide, tray_high))
    tray = tray - block((long - 2 * wall, tray_wide - 2 * wall, tray_high), at=(0, 0, wall))
    return union(sleeve, tray.translate((long * rng.uniform(0.3, 0.75), 0, 0)))


def _tissue_box(rng: np.random.Generator) -> "Manifold":
    """A hollow box with a slot in its top, straight or oval, a tissue standing out of it now and then."""
    long, wall = log_uniform(rng, 75, 250), rng.uniform(1, 2.5)
    wide = long * rng.uniform(0.42, 1)
    high = min(wide * rng.uniform(0.4, 1.1), 95)
    box = block((long, wide, high)) - block((long - 2 * wall, wide - 2 * wall, high - 2 * wall))
    slot, open_by = long * rng.uniform(0.4, 0.75), wide * rng.uniform(0.12, 0.5)
    oval = disc(1).scale((slot / 2, open_by / 2))
    straight = strip([((open_by - slot) / 2, 0), ((slot - open_by) / 2, 0)], 0.7 * open_by)
    box = box - plate(oval if rng.random() < 0.5 else straight, 3 * wall, z=high / 2)
    if rng.random() < 0.6:
        return box
    x, up = 0.35 * slot, high / 2 + min(wide * rng.uniform(0.15, 0.35), 34)
    sheet = outline([(-0.6 * x, -high / 2), (0.6 * x, -high / 2), (0.6 * x, high / 2), (x, up), (-x, 0.9 * up)])
    return union(box, plate(sheet, 1.5).rotate((90, 0, 0)))


def _brick(rng: np.random.Generator) -> "Manifold":
    """A brick with rows of round dimples in its top, or with ribs across it."""
    long = log_uniform(rng, 40, 255)
    wide, high = long * rng.uniform(0.4, 0.65), min(long * rng.uniform(0.2, 0.45), 100)
    brick, count = rounded_block((long, wide, high), 0.02 * long), int(rng.integers(2, 8))
    pitch = 0.9 * long / count
    x = pitch * (np.arange(count) - (count - 1) / 2)
    if rng.random() < 0.5:
        rows = max(1, int(0.95 * wide / pitch))
        y, radius = pitch * (np.arange(rows) - (rows - 1) / 2), min(pitch, wide) * rng.uniform(0.25, 0.42)
        dimples = [sphere(radius).scale((1, 1, 0.6)).translate((i, j, high / 2)) for i in x for j in y]
        return brick - union(*dimples)
    rib = pitch * rng.uniform(0.3, 0.6), wide * rng.uniform(0.7, 0.95), 2 * rng.uniform(0.03, 0.07) * long
    return union(brick, *(rounded_block(rib, 0.2 * min(rib), at=(float(i), 0, high / 2)) for i in x))


BOXES = (
    _carton,
    _book,
    _case,
    _soap,
    _phone,
    _device,
    _lunch_box,
    _matchbox,
    _tissue_box,
    _brick,
)
"""What draws each kind."""
