"""Materials: how strongly a surface answers, and how its answer splits into specular and edge returns."""

from types import MappingProxyType

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.records import checked_array, checked_number, checked_numbers, checked_record, put, record


@record
class Material:
    """A surface, as the paper's simulator knows it.

    Attributes
    ----------
    name : str
    reflection : complex reflection amplitude at normal incidence over a perfect conductor's, so 1 for metal
    alpha : default weights (a1, a2) of the specular and the edge image (primer 14)
    """

    name: str
    reflection: complex = 1.0
    alpha: tuple[float, float] = (0.7, 0.3)

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        a1, a2 = checked_numbers(self.alpha, name="alpha", count=2, minimum=0)
        if not a1 + a2 > 0:
            raise InputError("alpha is (0, 0); expected at least one weight above zero")
        reflection = complex(checked_array(self.reflection, name="reflection", shape=(), dtype=np.complex128))
        amplitude = checked_number(abs(reflection), name="|reflection|", above=0)
        if amplitude > 1:
            raise InputError(
                f"|reflection| is {amplitude:g}; expected at most 1: a passive surface returns no more than it gets"
            )
        put(self, reflection=reflection, alpha=(a1, a2))


def _dielectric(name: str, permittivity: complex, alpha: tuple[float, float]) -> Material:
    """Fresnel's reflection at normal incidence over a conductor's -1: (n - 1) / (n + 1), n² the permittivity."""
    index = permittivity**0.5
    return Material(name=name, reflection=(index - 1) / (index + 1), alpha=alpha)


# Relative permittivities near 77 GHz, rounded, of thick pieces; the sign of the imaginary part is that of
# exp(+i w t). The weights are our own first guess: smooth hard things mirror, soft and rough ones scatter at rims.
# They are to be fitted against measurements.
MATERIALS = MappingProxyType(
    {
        material.name: material
        for material in (
            Material(name="metal", reflection=1.0, alpha=(0.7, 0.3)),
            _dielectric("ceramic", 6.0 - 0.1j, (0.8, 0.2)),
            _dielectric("glass", 6.2 - 0.2j, (0.8, 0.2)),
            _dielectric("plastic", 2.6 - 0.02j, (0.6, 0.4)),
            _dielectric("rubber", 3.0 - 0.1j, (0.5, 0.5)),
            _dielectric("wood", 2.0 - 0.15j, (0.5, 0.5)),
            _dielectric("cardboard", 1.8 - 0.1j, (0.5, 0.5)),
            _dielectric("foam", 1.1 - 0.005j, (0.3, 0.7)),
            _dielectric("fruit", 8.0 - 12.0j, (0.7, 0.3)),
        )
    }
)


def material_named(material: "str | Material") -> Material:
    """A material by its name in `MATERIALS`, or the given one itself.

    Raises
    ------
    UnknownNameError
    """
    if isinstance(material, Material):
        return material
    if not isinstance(material, str) or material not in MATERIALS:
        raise UnknownNameError("material", material, MATERIALS)
    return MATERIALS[material]
