"""Flat layered slabs: what they reflect and what they let through, at any angle.

The field in a stack is the product of its layers' transfer matrices (Born & Wolf, "Principles of Optics", section
1.6). Written as such it overflows in thick lossy layers. The same product is therefore taken from the far side
inwards, as a recursion over reflections (Parratt, Phys. Rev. 95, 359 (1954)): every exponential in it decays.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_number
from millisight.core.errors import InputError
from millisight.rig.virtual._fresnel import (
    admittances,
    boundary,
    checked_cosine,
    checked_frequency,
    checked_permittivity,
    normal_index,
)

Layers = tuple[tuple[complex, float], ...]
"""Relative permittivity ε' - i ε'' and thickness [m] of each layer, from the side where the wave comes in."""


def slab_coefficients(
    layers: Sequence[tuple[complex, float]], frequency: Any, cosine: Any, *, backing: complex = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Reflection and transmission of a stack in air, TE and TM on the first axis.

    Parameters
    ----------
    layers : (relative permittivity, thickness [m]) of each, in the order the wave meets them; () for none
    frequency : [Hz]; broadcast with
    cosine : of the angle of incidence
    backing : relative permittivity of what lies behind the last layer: 1 for a slab in air

    Returns
    -------
    reflection : (2, ...) complex, of the field along the boundary, at the stack's front
    transmission : (2, ...) complex, over free space of the stack's thickness: multiply the wave on the straight path
        through the stack by it, and loss and delay are in. Between air and air |transmission|² is a power.

    Raises
    ------
    InputError
        A permittivity, thickness, frequency or angle cannot be right.

    Examples
    --------
    Half a wave of glass is invisible to its frequency:

    >>> r, t = slab_coefficients([(6.25, 299792458.0 / 77e9 / 5)], 77e9, 1.0)
    >>> bool(abs(r).max() < 1e-12)
    True
    """
    layers = checked_layers(layers)
    frequency, cosine = np.broadcast_arrays(checked_frequency(frequency), checked_cosine(cosine))
    wave_number = 2 * np.pi * frequency / SPEED_OF_LIGHT
    media = [1.0, *(permittivity for permittivity, _ in layers), checked_permittivity(backing, "backing")]
    sides = [admittances(medium, cosine) for medium in media]

    reflection = boundary(sides[-2], sides[-1])
    transmission = 1 + reflection
    for i in range(len(layers) - 1, -1, -1):
        permittivity, thickness = layers[i]
        through = np.exp(-1j * wave_number * thickness * normal_index(permittivity, cosine))
        front = boundary(sides[i], sides[i + 1])
        echo = reflection * through**2
        transmission = transmission * (1 + front) * through / (1 + front * echo)
        reflection = (front + echo) / (1 + front * echo)
    return reflection, transmission * np.exp(1j * wave_number * thickness_of(layers) * cosine)


def thickness_of(layers: Layers) -> float:
    """Of the whole stack [m]."""
    return float(sum(thickness for _, thickness in layers))


def checked_layers(layers: Any) -> Layers:
    """`layers` as a tuple of (complex permittivity, thickness [m])."""
    try:
        pairs = [(permittivity, thickness) for permittivity, thickness in layers]
    except (TypeError, ValueError) as error:
        raise InputError(f"layers are {layers!r}; expected pairs of a permittivity and a thickness [m]") from error
    return tuple(
        (
            checked_permittivity(permittivity, f"permittivity of layer {i}"),
            checked_number(thickness, name=f"thickness of layer {i}", unit="m", above=0),
        )
        for i, (permittivity, thickness) in enumerate(pairs)
    )
