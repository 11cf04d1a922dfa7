"""The table of materials, and of layers: against the formulas its figures come from, and what is refused."""

import copy
import pickle

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import LAYERED, MATERIALS, Material

EPSILON_0 = 8.8541878128e-12
METALS = ("metal", "steel", "stainless_steel", "aluminium", "copper", "brass")


def relaxing(frequency, high, terms):
    """Debye's relaxations (strength, time [s]) on top of `high`, with the time convention exp(+i w t)."""
    return high + sum(strength / (1 + 2j * np.pi * frequency * time) for strength, time in terms)


def water(frequency):
    """Liebe, Hufford and Manabe 1991, at 20 °C."""
    inverse = 1 - 300 / 293.15
    static = 77.66 - 103.3 * inverse
    first, last = 0.0671 * static, 3.52 + 7.52 * inverse
    slow = (20.20 + 146.4 * inverse + 316 * inverse**2) * 1e9
    steps = [(static - first, 1 / (2 * np.pi * slow)), (first - last, 1 / (2 * np.pi * 39.8 * slow))]
    return relaxing(frequency, last, steps)


def itu(frequency, a, c, d):
    """ITU-R P.2040: eps' = a, conductivity = c f^d with f in GHz."""
    return a - 1j * c * (frequency / 1e9) ** d / (2 * np.pi * frequency * EPSILON_0)


def test_the_table_has_what_a_table_of_things_needs():
    assert {
        "metal", "steel", "aluminium", "plastic", "abs", "polyethylene", "polypropylene", "pmma", "pvc", "pet", "nylon",
        "rubber", "foam", "styrofoam", "polyurethane_foam", "eva_foam", "glass", "ceramic", "wood", "paper",
        "cardboard", "cotton", "leather", "water", "fruit", "skin",
    } <= set(MATERIALS)  # fmt: skip
    assert all(material.name == name for name, material in MATERIALS.items())
    with pytest.raises(TypeError):
        MATERIALS["metal"] = MATERIALS["wood"]  # type: ignore[index]


@pytest.mark.parametrize("name", MATERIALS)
def test_every_material_has_a_source_and_is_passive(name):
    material = MATERIALS[name]
    assert material.source.split(":")[0] in ("cited", "recalled", "derived", "nominal")
    assert len(material.source) > 20
    for frequency in (10e9, 24.125e9, 77e9, 81e9):
        value = material.permittivity(frequency)
        assert isinstance(value, complex)
        assert value.real >= 1
        assert value.imag < 0
    assert 0 <= material.roughness < 3e-4, "no surface here is rough by Rayleigh's criterion at 77 GHz"


@pytest.mark.parametrize("name", [name for name in MATERIALS if name != "metal"])
def test_reflection_is_fresnels_at_77_ghz(name):
    # From admittances, not indices: (1 - Y) / (1 + Y) over a conductor's -1.
    admittance = np.sqrt(MATERIALS[name].permittivity(77e9))
    assert MATERIALS[name].reflection == pytest.approx(-(1 - admittance) / (1 + admittance), rel=1e-12)


def test_metals_reflect_all_but_a_thousandth():
    assert MATERIALS["metal"].reflection == 1
    for name in METALS[1:]:
        assert 0.997 < abs(MATERIALS[name].reflection) < 1
        # The textbook's surface resistance: 1 - |R|² = 4 sqrt(pi f eps_0 / sigma) for a good conductor.
        sigma = MATERIALS[name].conductivity
        assert sigma is not None
        lost = 4 * np.sqrt(np.pi * 77e9 * EPSILON_0 / sigma)
        assert 1 - abs(MATERIALS[name].reflection) ** 2 == pytest.approx(lost, rel=0.01)
    assert [name for name, material in MATERIALS.items() if material.conductivity] == list(METALS)


@pytest.mark.parametrize("frequency", [24.125e9, 36e9, 60e9, 77e9, 79e9])
def test_interpolation_keeps_the_formulas(frequency):
    for name, formula in (
        ("water", water(frequency)),
        ("glass", itu(frequency, 6.31, 0.0036, 1.3394)),
        ("wood", itu(frequency, 1.99, 0.0047, 1.0718)),
        ("plasterboard", itu(frequency, 2.73, 0.0085, 0.9395)),
        ("concrete", itu(frequency, 5.24, 0.0462, 0.7822)),
    ):
        assert MATERIALS[name].permittivity(frequency) == pytest.approx(formula, rel=0.02), name


def test_skin_is_gabriels():
    # The value that the literature quotes for dry skin at 60 GHz.
    assert MATERIALS["skin"].permittivity(60e9) == pytest.approx(7.98 - 10.9j, abs=0.05)


def test_permittivity_takes_arrays_and_is_constant_beyond_its_table():
    glass = MATERIALS["glass"]
    frequencies = np.array([[1e9, 10e9], [77e9, 300e9]])
    values = glass.permittivity(frequencies)
    assert values.shape == (2, 2)
    assert values[0, 0] == values[0, 1]
    assert values[1, 1] == glass.permittivity(100e9)
    assert values[1, 0] == glass.permittivity(77e9)


@pytest.mark.parametrize("frequency", [0.0, -1e9, np.array([1e9, 0.0]), np.nan])
def test_frequencies_that_cannot_be_are_refused(frequency):
    with pytest.raises(InputError, match=r"expected above zero, in Hz"):
        MATERIALS["wood"].permittivity(frequency)


def test_a_material_known_by_its_reflection_alone_has_no_permittivity():
    with pytest.raises(InputError, match="'odd' has only a reflection amplitude"):
        Material(name="odd", reflection=0.2 - 0.1j).permittivity(77e9)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"frequencies": [1e9]}, "belong together"),
        ({"permittivities": [2.0]}, "belong together"),
        ({"frequencies": [1e9], "permittivities": [2.0], "conductivity": 1e6}, "not both"),
        ({"frequencies": [2e9, 1e9], "permittivities": [2.0, 2.0]}, "increase"),
        ({"frequencies": [0.0], "permittivities": [2.0]}, "above zero and increase"),
        ({"frequencies": [1e9], "permittivities": [2.0 + 0.1j]}, r"convention is exp\(\+i w t\)"),
        ({"frequencies": [1e9], "permittivities": [-2.0]}, "real part above zero"),
        ({"frequencies": [1e9, 2e9], "permittivities": [2.0]}, r"permittivities has shape \(1,\)"),
        ({"conductivity": 0.0}, "conductivity is 0 S/m"),
        ({"roughness": -1e-6}, "roughness is -1e-06 m"),
        ({"correlation_length": 0.0}, "correlation_length is 0 m"),
        ({"source": None}, "source is of type NoneType"),
    ],
)
def test_what_cannot_be_is_refused(fields, message):
    with pytest.raises(InputError, match=message):
        Material(name="odd", **fields)


def test_materials_copy_pickle_and_are_stored(tmp_path):
    glass = MATERIALS["glass"]
    ms.save(tmp_path / "glass.h5", glass)
    for twin in (copy.deepcopy(glass), pickle.loads(pickle.dumps(glass)), ms.load(tmp_path / "glass.h5")):  # noqa: S301
        assert twin.reflection == glass.reflection
        assert twin.permittivity(24e9) == glass.permittivity(24e9)
        assert (twin.roughness, twin.correlation_length, twin.source) == (
            glass.roughness, glass.correlation_length, glass.source,
        )  # fmt: skip
    with pytest.raises(ValueError, match="read-only"):
        glass.permittivities[0] = 1  # type: ignore[index]


def test_layers():
    assert set(LAYERED) == {"carton", "cloth", "styrofoam", "plasterboard"}
    carton = LAYERED["carton"]
    assert [layer.material.name for layer in carton] == ["paper", "flute", "paper"]
    assert sum(thickness for _, thickness in carton) == pytest.approx(3.0e-3)
    for layers in LAYERED.values():
        assert all(MATERIALS[material.name] is material and thickness > 0 for material, thickness in layers)


def slab_reflection(layers, frequency, scale=1.0):
    """|R| of a stack in air at normal incidence, from the last face forwards (the recursion of stacked interfaces)."""
    indices = [1, *(np.sqrt(material.permittivity(frequency)) for material, _ in layers), 1]
    total = (indices[-2] - indices[-1]) / (indices[-2] + indices[-1])
    for i in range(len(layers), 0, -1):
        turn = np.exp(-4j * np.pi * frequency / 299_792_458.0 * indices[i] * layers[i - 1].thickness * scale)
        face = (indices[i - 1] - indices[i]) / (indices[i - 1] + indices[i])
        total = (face + total * turn) / (1 + face * total * turn)
    return abs(total)


def test_carton_shows_at_77_ghz_and_hardly_at_24():
    low, high = (20 * np.log10(slab_reflection(LAYERED["carton"], f)) for f in (24.125e9, 79e9))
    assert low < -20
    assert high > low + 6
    # A homogeneous slab of the same paper is wrong: it reflects far more at 24 GHz.
    solid = [type(LAYERED["carton"][0])(MATERIALS["paper"], 3e-3)]
    assert 20 * np.log10(slab_reflection(solid, 24.125e9)) > low + 10
