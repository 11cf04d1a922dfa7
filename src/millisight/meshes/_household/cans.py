"""Closed cans, on their base or on their side with the axis along x."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from millisight.meshes._shapes import (
    curve,
    cylinder,
    disc,
    fillet,
    log_uniform,
    outline,
    plate,
    ring,
    sides,
    strip,
    union,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

TALLEST_STANDING = 130.0  # can [mm]
_LIES = 0.3  # of the cans that could stand as well: with the long ones, half of all lie


def turned(profile: ArrayLike, rounding: float = 0.5) -> "Manifold":
    """The area within (K, 2) points (radius, height), its corners rounded, turned about z."""
    half = outline(profile)
    area = fillet(half + half.mirror((1, 0)), rounding).simplify(0.05)
    return area.revolve(sides(area.bounds()[2]))


def _set_down(can: "Manifold", rng: np.random.Generator) -> "Manifold":
    """The can on its base, or on its side, rolled by any angle."""
    _, _, lowest, _, _, highest = can.bounding_box()
    lies = highest - lowest > TALLEST_STANDING or rng.random() < _LIES
    return can.rotate((0, 0, rng.uniform(0, 360))).rotate((0, 90 if lies else 0, 0))


def grooved(radius: float, rng: np.random.Generator) -> "CrossSection":
    """A disc with grooves all around its rim, as fingers like on a screw cap."""
    area, depth, count = disc(radius), radius * rng.uniform(0.04, 0.08), int(rng.integers(12, 25))
    for x, y in ring(count, radius):
        area = area - disc(depth, (x, y))
    return area


def _drinks_can(rng: np.random.Generator) -> "Manifold":
    """A can drawn in at both ends, often about its middle too, with a hollow base, a sunk lid and its ring."""
    radius = log_uniform(rng, 44, 76) / 2
    high, waist = radius * log_uniform(rng, 3, 5.2), radius * rng.choice([1, rng.uniform(0.85, 0.97)])
    foot, neck = radius * rng.uniform(0.72, 0.88, 2)
    slope, sunk = 1.3 * (radius - neck), rng.uniform(2.5, 6)
    low, up = radius - foot, high - slope - 3
    base = [(0, rng.uniform(3, 8)), (foot - 4, 0.5), (foot - 2, 0), (foot, 0)]
    side = curve([(radius, low), (radius, low + 5), (waist, (low + up) / 2), (radius, up - 5), (radius, up)], along=2)
    rim, lid = [(neck, high - 3), (neck + 1, high - 2), (neck + 1, high), (neck - 1, high)], high - sunk
    can = turned([*base, *side, *rim, (neck - 2.5, lid), (0, lid)])
    tab = strip([(-0.1 * neck, 0), (0.45 * neck, 0)], 0.5 * neck) - disc(0.16 * neck, (0.45 * neck, 0))
    return _set_down(union(can, plate(tab, rng.uniform(2, 3.5), z=lid)), rng)


def _tin(rng: np.random.Generator) -> "Manifold":
    """A tin with raised rims at both ends, and with rings on its sunk lids."""
    rim = rng.uniform(1, 2.2)
    radius = log_uniform(rng, 44, 124) / 2
    high, sunk, bead = radius * log_uniform(rng, 0.8, 3.6), rng.uniform(2, 5), rng.uniform(0.8, 1.6)
    top = [(radius, high / 2 - 3.5), (radius + rim, high / 2 - 3), (radius + rim, high / 2), (radius - 1, high / 2)]
    level = high / 2 - sunk
    top.append((radius - 1.5, level))
    for place in radius * np.linspace(0.85, rng.uniform(0.3, 0.7), int(rng.integers(1, 5))):
        top += [(place, level), (place - 1, level + bead), (place - 2.5, level + bead), (place - 3.5, level)]
    upper = np.array([*top, (0, level)])
    return _set_down(turned([*(upper[::-1] * (1, -1)), *upper], 0.4), rng)


def _flat_tin(rng: np.random.Generator) -> "Manifold":
    """A tin wider than high, its lid pulled down over its rim, a flat step in the lid."""
    radius, over = log_uniform(rng, 36, 126) / 2, rng.uniform(0.7, 1.8)
    high, wide = max(radius * log_uniform(rng, 0.35, 1.2), 15.5), radius + over
    seam, step, inset = high * rng.uniform(0.3, 0.75), rng.choice([-1, 1]) * rng.uniform(0.8, 2), rng.uniform(3, 8)
    crown = high - max(step, 0)
    lid = [(wide, seam), (wide, crown), (wide - inset, crown), (wide - inset - 1, crown + step), (0, crown + step)]
    return _set_down(turned([(0, 1), (radius - 4, 1), (radius - 3, 0), (radius, 0), (radius, seam), *lid]), rng)


def _spray_can(rng: np.random.Generator) -> "Manifold":
    """A slender can with a rim, a domed shoulder, and a wide cap or a narrow spray head."""
    radius = log_uniform(rng, 30, 74) / 2
    high, rim = radius * log_uniform(rng, 2.4, 5.5), rng.uniform(0.8, 1.8)
    cap, dome = radius * rng.choice([rng.uniform(0.65, 0.92), rng.uniform(0.3, 0.45)]), radius * rng.uniform(0.25, 0.6)
    turn = np.linspace(0.1, np.pi / 2, 20)
    shoulder = np.column_stack([radius * np.cos(turn), high + dome * np.sin(turn)])
    shoulder = shoulder[shoulder[:, 0] > cap]
    up = shoulder[-1, 1] + radius * rng.uniform(0.3, 1)
    base = [(0, 4), (radius - 5, 1), (radius - 2, 0), (radius + rim, 0), (radius + rim, 2.5), (radius, 3)]
    collar = [(radius, high - 3), (radius + rim, high - 2.5), (radius + rim, high)]
    top = [(cap, shoulder[-1, 1]), (cap * rng.uniform(0.8, 1), up), (0, up)]
    return _set_down(turned([*base, *collar, *shoulder, *top]), rng)


def _capped_tube(rng: np.random.Generator) -> "Manifold":
    """A straight tube with a cap over, or a plug within, each end."""
    radius = log_uniform(rng, 28, 115) / 2
    high = min(radius * log_uniform(rng, 2.5, 9), 275)
    cap, over = min(rng.uniform(5, 25), 0.3 * high), rng.choice([-1, 1]) * rng.uniform(0.8, 2.5)
    sunk = rng.uniform(1, 6) if rng.random() < 0.5 or over < 0 else 0
    if over < 0:
        end = [(radius, high / 2), (radius + over, high / 2), (radius + over - 1, high / 2 - sunk)]
    else:
        end = [(radius, high / 2 - cap), (radius + over, high / 2 - cap), (radius + over, high / 2)]
        end += [(radius - 2, high / 2), (radius - 3, high / 2 - sunk)]
    upper = np.array([*end, (0, high / 2 - sunk)])
    return _set_down(turned([*(upper[::-1] * (1, -1)), *upper], 0.3), rng)


def _corrugated_tin(rng: np.random.Generator) -> "Manifold":
    """A tin with waves about its middle, a rim at each end, and sunk lids."""
    radius = log_uniform(rng, 46, 122) / 2
    high, rim, sunk = radius * log_uniform(rng, 1.2, 4), rng.uniform(1, 2.5), rng.uniform(2, 5)
    deep, count = rng.uniform(0.8, 2.2), int(rng.integers(3, 11))
    half = min(high * rng.uniform(0.2, 0.42), high / 2 - 5)
    z = np.linspace(-half, half, 12 * count + 1)
    waves = np.column_stack([radius - deep / 2 + deep / 2 * np.cos(np.pi * count * (z / half + 1)), z])
    upper = np.array([(radius, high / 2 - 3.5), (radius + rim, high / 2 - 3), (radius + rim, high / 2),
                      (radius - 1, high / 2), (radius - 1.5, high / 2 - sunk), (0, high / 2 - sunk)])  # fmt: skip
    return _set_down(turned([*(upper[::-1] * (1, -1)), *waves, *upper], 0.3), rng)


def _jar(rng: np.random.Generator) -> "Manifold":
    """A jar with a rounded foot, shoulders and a neck, and a grooved or smooth lid wider than the jar."""
    radius = log_uniform(rng, 34, 112) / 2
    high, foot = radius * log_uniform(rng, 1, 3.6), radius * rng.uniform(0.08, 0.25)
    neck, shoulder = radius * rng.uniform(0.8, 0.95), radius * rng.uniform(0.08, 0.3)
    turn = np.linspace(-np.pi / 2, 0, 10)
    base = np.column_stack([radius - foot + foot * np.cos(turn), foot + foot * np.sin(turn)])
    up = high + rng.uniform(2, 6)
    jar = turned([(0, 0), *base, (radius, high - shoulder), (neck, high), (neck, up + 2), (0, up + 2)], 1)
    lid, thick = radius * rng.uniform(1.03, 1.14), radius * rng.uniform(0.2, 0.55)
    area = grooved(lid, rng) if rng.random() < 0.5 else disc(lid)
    return _set_down(union(jar, plate(area, thick, z=up + thick / 2)), rng)


def _battery(rng: np.random.Generator) -> "Manifold":
    """A cylinder with a nub in the middle of one end, a slight step about it, and a dent in the other end."""
    radius = log_uniform(rng, 25, 60) / 2
    high, nub = radius * log_uniform(rng, 2.2, 5.5), radius * rng.uniform(0.25, 0.4)
    step, dent, rise = radius * rng.uniform(0.7, 0.92), rng.uniform(0.5, 1.5), rng.uniform(1.5, 4)
    base = [(0, dent), (0.6 * radius, dent), (0.65 * radius, 0), (radius, 0)]
    top = [(radius, high), (step, high), (step - 0.5, high - dent), (nub + 1, high - dent)]
    return _set_down(turned([*base, *top, (nub, high + rise), (0, high + rise)], 0.4), rng)


def _domed_can(rng: np.random.Generator) -> "Manifold":
    """A can whose top is a dome, with a rim between them and a knob on the dome now and then."""
    radius = log_uniform(rng, 40, 124) / 2
    high, dome, rim = radius * log_uniform(rng, 0.7, 3.5), radius * rng.uniform(0.25, 1), rng.uniform(0.8, 2.5)
    turn = np.linspace(0, np.pi / 2, 40)
    arc = np.column_stack([radius * np.cos(turn), high + dome * np.sin(turn)])
    arc[-1, 0] = 0
    base = [(0, 2), (radius - 5, 2), (radius - 3, 0), (radius, 0)]
    can = turned([*base, (radius, high - 3), (radius + rim, high - 3), (radius + rim, high), *arc], 0.5)
    if rng.random() < 0.4:
        knob, rise = radius * rng.uniform(0.12, 0.25), rng.uniform(4, 10)
        can = union(can, cylinder(knob, rise + 4, at=(0, 0, high + dome + rise / 2 - 2)))
    return _set_down(can, rng)


CANS = (
    _drinks_can,
    _tin,
    _flat_tin,
    _spray_can,
    _capped_tube,
    _corrugated_tin,
    _jar,
    _battery,
    _domed_can,
)
"""What draws each kind."""
