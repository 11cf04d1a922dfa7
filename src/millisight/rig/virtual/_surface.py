"""What a surface returns: Fresnel's reflection of a solid or of a thin wall, split by its roughness."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_number, put, record
from millisight.data import Material
from millisight.rig.virtual._slabs import (
    Layers,
    checked_cosine,
    checked_frequency,
    checked_layers,
    checked_permittivity,
    slab_coefficients,
)

DEGREE = 8
"""Of the polynomials in the cosine of incidence that stand for a surface in the kernels."""

_LINEAR_FROM, _SQUARE_FROM = 0.02, 0.3


@record
class Boundary:
    """A boundary as the wave meets it: layers, what lies behind them, and roughness.

    Attributes
    ----------
    backing : relative permittivity ε' - i ε'' of what lies behind the layers: a solid's own, or 1 for a wall in air
    layers : (relative permittivity, thickness [m]) of each, from the outside in; () for a solid
    roughness : standard deviation of the height over the smooth shape [m]
    setback : how far the mesh, to which distances are counted, lies behind the layers' front [m]

    The reflection is the mean of TE and TM: what antennas receive that are polarised at 45 degrees to the plane of
    incidence, and the mean over all orientations of that plane. Near normal incidence, where mirrors flash, there is
    no difference. The wave turned into the other polarisation is not followed.
    """

    backing: complex
    layers: Layers = ()
    roughness: float = 0.0
    setback: float = 0.0

    def __post_init__(self) -> None:
        put(
            self,
            backing=checked_permittivity(self.backing, "backing"),
            layers=checked_layers(self.layers),
            roughness=checked_number(self.roughness, name="roughness", unit="m", minimum=0),
            setback=checked_number(self.setback, name="setback", unit="m", minimum=0),
        )

    def reflection(self, frequency: Any, cosine: Any) -> np.ndarray:
        """(...) complex, of the surface without its roughness: -1 for a perfect conductor."""
        smooth = slab_coefficients(self.layers, frequency, cosine, backing=self.backing)[0].mean(axis=0)
        return smooth * np.exp(2j * _wave_number(frequency) * self.setback * checked_cosine(cosine))

    def coherent(self, frequency: Any, cosine: Any) -> np.ndarray:
        """(...) complex reflection of the mean wave: `reflection` times exp(-2 (k σ cos θ)²).

        Ament, "Toward a theory of reflection by a rough surface", Proc. IRE 41, 142 (1953).
        """
        return self.reflection(frequency, cosine) * np.exp(-self._rayleigh(frequency, cosine) / 2)

    def diffuse(self, frequency: Any, cosine: Any) -> np.ndarray:
        """(...) root of the share of power that leaves in all directions: what `coherent` lost, no more."""
        lost = -np.expm1(-self._rayleigh(frequency, cosine))
        return abs(self.reflection(frequency, cosine)) * np.sqrt(lost)

    def _rayleigh(self, frequency: Any, cosine: Any) -> np.ndarray:
        """(2 k σ cos θ)², the variance of the phase that heights give the reflected wave."""
        return (2 * _wave_number(frequency) * self.roughness * checked_cosine(cosine)) ** 2

    def terms(self, half_band: float) -> int:
        """How many powers of the frequency, from -1 to 1 over `half_band` [Hz] to either side, tell the reflection.

        It changes as waves run to and fro in the layers; in proportion to their phase, then to its square.
        """
        to_and_fro = 2 * sum(abs(permittivity) ** 0.5 * thickness for permittivity, thickness in self.layers)
        phase = 2 * np.pi * half_band / SPEED_OF_LIGHT * to_and_fro
        return 1 + int(phase > _LINEAR_FROM) + int(phase > _SQUARE_FROM)


def permittivity_at(material: Any, frequency: float) -> complex:
    """Relative permittivity ε' - i ε'' of a `Material` at `frequency` [Hz], or the number given in its place."""
    if isinstance(material, Material):
        return material.permittivity(frequency)
    return checked_permittivity(material, "the permittivity given instead of a Material")


def layers_at(layers: Sequence[tuple[Any, float]], frequency: float) -> Layers:
    """Layers of materials, or of permittivities, with their permittivities at `frequency` [Hz]."""
    return tuple((permittivity_at(material, frequency), thickness) for material, thickness in layers)


def _wave_number(frequency: Any) -> np.ndarray:
    return 2 * np.pi * checked_frequency(frequency) / SPEED_OF_LIGHT


def polynomials(values: np.ndarray, cosines: np.ndarray) -> np.ndarray:
    """(DEGREE + 1, ...) coefficients in powers of 2 cos θ - 1, the lowest first, that fit `values` (n, ...).

    Errors count as much as what is seen at an angle does in an echo, in proportion to the cosine.
    """
    powers = np.vander(2 * cosines - 1, DEGREE + 1, increasing=True)
    weights = cosines[:, None]
    flat = values.reshape(len(cosines), -1)
    coefficients = np.linalg.lstsq(powers * weights, flat * weights, rcond=None)[0]
    return coefficients.reshape(DEGREE + 1, *values.shape[1:])


def fitted(surfaces: Sequence[Boundary], center: float, half_band: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The S surfaces as the kernels take them: what they return at every angle and frequency of a band.

    coherent (S, 3, DEGREE + 1) complex64: the sum over j of polynomial j in 2 cos θ - 1 times ν^j, with ν the frequency
    from -1 to 1 across the band; terms (S,): how many j count; diffuse (S, DEGREE + 1) float32, at the band's center.
    """
    cosines = (1 + np.cos(np.pi * (np.arange(64) + 0.5) / 64)) / 2
    terms = np.array([surface.terms(half_band) for surface in surfaces])
    coherent = np.zeros((len(surfaces), 3, DEGREE + 1), dtype=np.complex64)
    diffuse = np.zeros((len(surfaces), DEGREE + 1), dtype=np.float32)
    for i, surface in enumerate(surfaces):
        nodes = np.linspace(-1, 1, terms[i]) if terms[i] > 1 else np.array([0.0])
        in_powers = np.linalg.inv(np.vander(nodes, terms[i], increasing=True))
        band = surface.coherent(center + half_band * nodes, cosines[:, None])
        coherent[i, : terms[i]] = polynomials(band @ in_powers.T, cosines).T
        diffuse[i] = polynomials(surface.diffuse(center, cosines), cosines)
    return coherent, terms, diffuse
