"""What flat boundaries and layered slabs reflect and let through, at any angle: dielectrics with loss, and conductors.

Permittivities are relative, ε' - i ε'', as belongs to exp(+i ω t); a conductor of conductivity σ has ε'' = σ / (ω ε_0).
Fresnel's coefficients are ratios of the electric field *along the boundary*, for TE (the electric field across the
plane of incidence) and TM (in it), in this order on the first axis. So both are -1 for a perfect conductor, and equal
at normal incidence, where a polarisation has no plane to be told by (Balanis, "Advanced Engineering Electromagnetics"
(2012), Eq. 5-17a and 5-24c, there for fields as a whole).

The field in a stack is the product of its layers' transfer matrices (Born & Wolf, "Principles of Optics", section
1.6). Written as such it overflows in thick lossy layers. The same product is therefore taken from the far side
inwards, as a recursion over reflections (Parratt, Phys. Rev. 95, 359 (1954)): every exponential in it decays.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_array, checked_number
from millisight.core.errors import InputError

# Just above the horizon, where an admittance would be infinite.
_LEAST_COSINE = 1e-9


def admittances(permittivity: complex, cosine: np.ndarray) -> np.ndarray:
    """(2, ...) of a medium, over that of air: magnetic over electric field along the boundary, TE and TM."""
    across = normal_index(permittivity, cosine)
    return np.stack([across, permittivity / across])


def normal_index(permittivity: complex, cosine: np.ndarray) -> np.ndarray:
    """(...) wave number across the boundary over that of air, sqrt(ε - sin²θ): the root that decays inwards.

    `cosine` is that of the angle of incidence in air.
    """
    root = np.sqrt(np.asarray((permittivity - 1) + cosine**2, dtype=complex))
    root = np.where(np.imag(root) > 0, -root, root)
    return np.where(root == 0, _LEAST_COSINE, root)


def boundary(before: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Reflection between media of these admittances, for a wave that comes from `before`."""
    return (before - behind) / (before + behind)


def checked_permittivity(value: Any, name: str = "permittivity") -> complex:
    """`value` as a complex number that no passive medium contradicts."""
    permittivity = complex(checked_array(value, name=name, shape=(), dtype=np.complex128))
    if permittivity.imag > 0:
        raise InputError(
            f"{name} is {permittivity:g}; expected an imaginary part of 0 or below: a loss is ε' - i ε'' here, with "
            "exp(+i ω t); conjugate values of the other convention"
        )
    if not abs(permittivity) > 0:
        raise InputError(f"{name} is 0; expected another number, such as 1 for air")
    return permittivity


def checked_cosine(value: Any) -> np.ndarray:
    """`value` as cosines of angles of incidence, held just above the horizon."""
    cosine = np.asarray(value, dtype=float)
    if cosine.size and not (cosine.min() >= 0 and cosine.max() <= 1 + 1e-12):
        raise InputError(f"cosines of incidence run from {cosine.min():g} to {cosine.max():g}; expected 0 to 1")
    return np.clip(cosine, _LEAST_COSINE, 1.0)


def checked_frequency(value: Any) -> np.ndarray:
    """`value` as frequencies above zero [Hz]."""
    frequency = np.asarray(value, dtype=float)
    checked_number(frequency.min(), name="frequency", unit="Hz", above=0)
    checked_number(frequency.max(), name="frequency", unit="Hz", above=0)
    return frequency


Layers = tuple[tuple[complex, float], ...]
"""Relative permittivity ε' - i ε'' and thickness [m] of each layer, from the side where the wave comes in."""


def slab_coefficients(
    layers: Sequence[tuple[complex, float]], frequency: Any, cosine: Any, *, backing: complex = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Reflection and transmission of a stack in air, TE and TM on the first axis.

    Both are (2, ...) complex and of the field along the boundary. `frequency` [Hz] and `cosine` of incidence are
    broadcast; `backing` is the relative permittivity behind the last layer. The transmission is over free space of
    the stack's thickness: multiply the wave on the straight path through the stack by it, and loss and delay are in.
    Between air and air |transmission|² is a power. Half a wave of glass is invisible to its frequency:

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
