"""Surfaces: roughness takes nothing but what it gives elsewhere, and the kernels' polynomials are true."""

import numpy as np
import pytest

from millisight.rig.virtual._surface import Boundary, fitted

COSINES = np.linspace(0.01, 1, 400)
SURFACES = {
    "metal": Boundary(backing=1 - 1e7j),
    "fruit": Boundary(backing=8 - 12j, roughness=0.3e-3),
    "rough metal": Boundary(backing=1 - 1e7j, roughness=0.8e-3),
    "foam": Boundary(backing=1.03 - 0.001j),
    "bottle": Boundary(backing=1.0, layers=((2.6 - 0.02j, 1.5e-3),)),
    "glass": Boundary(backing=1.0, layers=((6.2 - 0.2j, 3e-3),)),
    "carton": Boundary(backing=1.0, layers=((2.9 - 0.2j, 0.25e-3), (1.15 - 0.01j, 2.5e-3), (2.9 - 0.2j, 0.25e-3))),
}


@pytest.mark.parametrize("roughness", [0.0, 1e-5, 3e-4, 1e-2])
def test_coherent_and_diffuse_power_are_the_smooth_surfaces(roughness):
    surface = Boundary(backing=6 - 0.1j, roughness=roughness)
    power = abs(surface.coherent(79e9, COSINES)) ** 2 + surface.diffuse(79e9, COSINES) ** 2
    assert np.allclose(power, abs(surface.reflection(79e9, COSINES)) ** 2, rtol=1e-12)


def test_roughness_is_aments():
    k = 2 * np.pi * 79e9 / 299_792_458.0
    ratio = SURFACES["fruit"].coherent(79e9, COSINES) / Boundary(backing=8 - 12j).coherent(79e9, COSINES)
    assert np.allclose(ratio, np.exp(-2 * (k * 0.3e-3 * COSINES) ** 2))


def test_polynomials_hold_in_angle_and_band():
    """As weighed in an echo, by the cosine: within a hundredth of what a mirror returns."""
    coherent, terms, diffuse = fitted(list(SURFACES.values()), 79e9, 1.5e9)
    assert coherent.shape == (len(SURFACES), 3, 9)
    assert terms.tolist() == [1, 1, 1, 1, 2, 3, 2]
    assert fitted(list(SURFACES.values()), 79e9, 0.0)[1].tolist() == [1] * 7
    powers = np.vander(2 * COSINES - 1, 9, increasing=True)
    for nu in (-1.0, -0.6, 0.0, 0.3, 1.0):
        for (name, surface), laws, count in zip(SURFACES.items(), coherent, terms, strict=True):
            if nu and count == 1:
                continue  # but for its roughness, it is the same
            got = powers @ (laws.T @ nu ** np.arange(3))
            error = abs(got - surface.coherent(79e9 + nu * 1.5e9, COSINES)) * COSINES
            assert error.max() < 1e-2, name
    for surface, coefficients in zip(SURFACES.values(), diffuse, strict=True):
        assert (abs(powers @ coefficients - surface.diffuse(79e9, COSINES)) * COSINES).max() < 1e-3
