"""Layered slabs against textbook formulas and against what every passive stack must obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.oracles import C
from millisight.core.errors import InputError
from millisight.rig.virtual._slabs import slab_coefficients

COSINES = np.linspace(0.02, 1, 50)
FREQUENCIES = np.linspace(20e9, 90e9, 71)[:, None]

permittivities = st.builds(
    complex, st.floats(1.0, 12.0), st.one_of(st.just(0.0), st.floats(-8.0, -1e-6))
)  # fmt: skip
stacks = st.lists(st.tuples(permittivities, st.floats(1e-5, 2e-2)), min_size=1, max_size=6)
angles = st.floats(0.01, 1.0)
bands = st.sampled_from([24.125e9, 79e9])


def airy(permittivity, thickness, frequency, cosine, tm):
    """Reflection and transmission of one slab in air: the sum of all internal echoes in closed form (Airy).

    Angles by Snell's law and whole-field coefficients by Fresnel's, TM then turned to the field along the boundary.
    """
    index = np.sqrt(permittivity)
    inner = np.sqrt(1 - (1 - cosine**2) / permittivity)
    if tm:
        first = -(index * cosine - inner) / (index * cosine + inner)
    else:
        first = (cosine - index * inner) / (cosine + index * inner)
    beta = 2 * np.pi * frequency * thickness / C * index * inner
    turn = np.exp(-2j * beta)
    below = 1 - first**2 * turn
    reflection = first * (1 - turn) / below
    transmission = (1 - first**2) * np.exp(-1j * beta) / below
    return reflection, transmission * np.exp(2j * np.pi * frequency * thickness / C * cosine)


@pytest.mark.parametrize("permittivity", [2.6 - 0.02j, 6.0, 8.0 - 12.0j, 1.03 - 0.001j])
@pytest.mark.parametrize("thickness", [0.25e-3, 3e-3, 12e-3])
def test_one_slab_is_airys_formula(permittivity, thickness):
    reflection, transmission = slab_coefficients([(permittivity, thickness)], FREQUENCIES, COSINES)
    assert reflection.shape == transmission.shape == (2, 71, 50)
    for tm in (False, True):
        r, t = airy(permittivity, thickness, FREQUENCIES, COSINES, tm)
        assert abs(reflection[int(tm)] - r).max() < 1e-12
        assert abs(transmission[int(tm)] - t).max() < 1e-12


def test_a_quarter_wave_matches():
    """Between air and ε, a quarter wave of sqrt(ε) reflects nothing, and at other frequencies it does."""
    coating = [(2.0, C / 77e9 / 4 / np.sqrt(2.0))]
    assert abs(slab_coefficients(coating, 77e9, 1.0, backing=4.0)[0]).max() < 1e-12
    assert abs(slab_coefficients(coating, 60e9, 1.0, backing=4.0)[0]).min() > 0.05


def half_space(permittivity, cosine):
    return slab_coefficients((), 77e9, cosine, backing=permittivity)[0]


def test_brewsters_angle():
    """tan θ = n: TM passes into the half-space and through any slab of it; TE does not."""
    permittivity = 2.56
    cosine = np.cos(np.arctan(np.sqrt(permittivity)))
    te, tm = half_space(permittivity, cosine)
    assert abs(tm) < 1e-12
    assert abs(te) > 0.3
    r, t = slab_coefficients([(permittivity, 2.2e-3)], 77e9, cosine)
    assert abs(r[1]) < 1e-12
    assert abs(abs(t[1]) - 1) < 1e-12


def test_a_conductor_is_the_limit():
    assert abs(half_space(1 - 1e18j, COSINES) + 1).max() < 1e-7
    # Copper at 77 GHz, by its conductivity.
    assert abs(half_space(1 - 1j * 5.8e7 / (2 * np.pi * 77e9 * 8.8541878e-12), 1.0) + 1).max() < 1e-3


def test_normal_incidence_knows_no_polarisation_and_the_horizon_is_finite():
    te, tm = half_space(6 - 0.1j, 1.0)
    assert te == pytest.approx(tm)
    index = np.sqrt(6 - 0.1j)
    assert te == pytest.approx((1 - index) / (1 + index))
    for permittivity in (1.0, 6 - 0.1j, 0.75):
        r, t = slab_coefficients([(permittivity, 1e-3)], 77e9, [0.0, 0.5, 1.0])
        assert np.isfinite(r).all()
        assert np.isfinite(t).all()


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(stacks, bands, angles)
def test_energy_is_never_created(layers, frequency, cosine):
    r, t = slab_coefficients(layers, frequency, cosine)
    assert (abs(r) ** 2 + abs(t) ** 2 <= 1 + 1e-12).all()
    lossless = [(permittivity.real, thickness) for permittivity, thickness in layers]
    r, t = slab_coefficients(lossless, frequency, cosine)
    assert abs(abs(r) ** 2 + abs(t) ** 2 - 1).max() < 1e-9


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(stacks, bands, angles)
def test_transmission_is_reciprocal(layers, frequency, cosine):
    """Forwards as backwards, whatever the order of layers; of a lossless stack the reflections are equally strong."""
    assert np.allclose(
        slab_coefficients(layers, frequency, cosine)[1],
        slab_coefficients(layers[::-1], frequency, cosine)[1],
        rtol=1e-9, atol=1e-15,
    )  # fmt: skip
    lossless = [(permittivity.real, thickness) for permittivity, thickness in layers]
    forth, back = (slab_coefficients(stack, frequency, cosine)[0] for stack in (lossless, lossless[::-1]))
    assert abs(abs(forth) - abs(back)).max() < 1e-9


@settings(max_examples=100, deadline=None)
@given(stacks, bands, angles, st.integers(0, 5), st.floats(0.05, 0.95))
def test_splitting_a_layer_changes_nothing(layers, frequency, cosine, which, share):
    which %= len(layers)
    permittivity, thickness = layers[which]
    parts = [(permittivity, share * thickness), (permittivity, (1 - share) * thickness)]
    whole = slab_coefficients(layers, frequency, cosine)
    split = slab_coefficients([*layers[:which], *parts, *layers[which + 1 :]], frequency, cosine)
    assert np.allclose(whole, split, rtol=1e-9, atol=1e-12)


def test_no_layers_or_layers_of_air_are_nothing():
    for layers in ([], [(1.0, 0.3)]):
        r, t = slab_coefficients(layers, FREQUENCIES, COSINES)
        assert abs(r).max() < 1e-12
        assert abs(t - 1).max() < 1e-9


def test_thick_lossy_slabs_are_half_spaces():
    """A metre of wet matter: e^-10000, where a plain product of matrices overflows."""
    r, t = slab_coefficients([(8 - 12j, 1.0), (2.0, 0.01), (8 - 12j, 3.0)], FREQUENCIES, COSINES)
    assert abs(r - half_space(8 - 12j, COSINES)[:, None]).max() < 1e-12
    assert (t == 0).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([(2 + 0.1j, 1e-3)], 77e9, 1.0), "conjugate"),
        (([(2, -1e-3)], 77e9, 1.0), "thickness of layer 0"),
        (([2.0], 77e9, 1.0), "pairs"),
        (([(2, 1e-3)], 0.0, 1.0), "frequency"),
        (([(2, 1e-3)], 77e9, 1.5), "cosines"),
    ],
)
def test_what_cannot_be_right_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        slab_coefficients(*arguments)
