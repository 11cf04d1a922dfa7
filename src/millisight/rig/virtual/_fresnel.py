"""What one flat boundary reflects, by Fresnel's equations: dielectrics with loss, and conductors as their limit.

Permittivities are relative, ε' - i ε'', as belongs to exp(+i ω t); a conductor of conductivity σ has ε'' = σ / (ω ε_0).
Coefficients are ratios of the electric field *along the boundary*, for TE (the electric field across the plane of
incidence) and TM (in it), in this order on the first axis. So both are -1 for a perfect conductor, and equal at
normal incidence, where a polarisation has no plane to be told by.
"""

from typing import Any

import numpy as np

from millisight.core import checked_array, checked_number
from millisight.core.errors import InputError

# Just above the horizon, where an admittance would be infinite.
_LEAST_COSINE = 1e-9


def fresnel(permittivity: complex, cosine: Any) -> np.ndarray:
    """(2, ...) reflection of a half-space in air, TE and TM, at angles of incidence of `cosine` (...).

    Balanis, "Advanced Engineering Electromagnetics" (2012), Eq. 5-17a and 5-24c, there for fields as a whole.
    """
    cosine = checked_cosine(cosine)
    air = admittances(1.0, cosine)
    inside = admittances(checked_permittivity(permittivity), cosine)
    return boundary(air, inside)


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
