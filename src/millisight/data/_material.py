# Callers without types are checked, too.
# pyright: reportUnnecessaryIsInstance=false
"""Materials: permittivity, roughness, and how strongly a surface answers; a table of them, and of layers.

Two users, two views of one table (`materials.toml`, a source for every figure):

- the paper's simulator knows a surface by one complex amplitude (`Material.reflection`) and by how its answer splits
  into specular and edge returns (`Material.alpha`);
- physical optics needs the complex permittivity at the radar's frequency (`Material.permittivity`) and the height
  of the roughness (`Material.roughness`); for what hides an object, a stack of layers (`LAYERED`).

The time convention is exp(+i w t), that of the phase exp(-i 2 pi f d / c): a lossy permittivity is eps' - i eps'',
and its square root, the refractive index, has a negative imaginary part too.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, overload

import numpy as np

from millisight.core import checked_array, checked_number, checked_numbers, checked_record, put, record
from millisight.core.errors import InputError, UnknownNameError

EPSILON_0 = 8.8541878188e-12  # permittivity of free space [F/m], CODATA 2022
REFLECTION_FREQUENCY = 77e9  # where the table's `reflection` is computed [Hz]

_TABLE = Path(__file__).with_name("materials.toml")


@record
class Material:
    """The material of a surface.

    Attributes
    ----------
    name : str
    reflection : complex reflection amplitude at normal incidence, relative to a perfect conductor (1 for metal)
    alpha : default weights (a1, a2) of the specular and the edge image (primer 14)
    frequencies : (K,) where `permittivities` are known, increasing [Hz]; or None
    permittivities : (K,) complex relative permittivities eps' - i eps''; or None
    conductivity : of a metal [S/m]; or None
    roughness : rms height of the surface [m]
    correlation_length : of the height along the surface [m]; None: unknown
    source : of the electric properties, and their reliability (see `materials.toml`)
    """

    name: str
    reflection: complex = 1.0
    alpha: tuple[float, float] = (0.7, 0.3)
    frequencies: np.ndarray | None = None
    permittivities: np.ndarray | None = None
    conductivity: float | None = None
    roughness: float = 0.0
    correlation_length: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        a1, a2 = checked_numbers(self.alpha, name="alpha", count=2, minimum=0)
        if not a1 + a2 > 0:
            raise InputError("alpha is (0, 0); expected at least one weight above zero")
        reflection = complex(checked_array(self.reflection, name="reflection", shape=(), dtype=np.complex128))
        amplitude = checked_number(abs(reflection), name="|reflection|", above=0)
        if amplitude > 1:
            raise InputError(
                f"|reflection| is {amplitude:g}; expected at most 1: a passive surface cannot reflect more than it "
                "receives"
            )
        put(self, reflection=reflection, alpha=(a1, a2))
        self._check_electric_figures()
        put(self, roughness=checked_number(self.roughness, name="roughness", unit="m", minimum=0))
        if self.correlation_length is not None:
            length = checked_number(self.correlation_length, name="correlation_length", unit="m", above=0)
            put(self, correlation_length=length)
        checked_record(self.source, str, name="source")

    def __repr__(self) -> str:
        alpha = ", ".join(f"{weight:g}" for weight in self.alpha)
        return f"Material({self.name}, |reflection| {abs(self.reflection):.3g}, alpha ({alpha}))"

    def _check_electric_figures(self) -> None:
        if (self.frequencies is None) != (self.permittivities is None):
            raise InputError("frequencies and permittivities belong together: give both, or neither")
        if self.conductivity is not None:
            if self.permittivities is not None:
                raise InputError("give a metal's conductivity or a dielectric's permittivities, not both")
            put(self, conductivity=checked_number(self.conductivity, name="conductivity", unit="S/m", above=0))
        if self.frequencies is None or self.permittivities is None:
            return
        frequencies = checked_array(self.frequencies, name="frequencies", shape=("K",), unit="Hz")
        shape = frequencies.shape
        values = checked_array(self.permittivities, name="permittivities", shape=shape, dtype=np.complex128)
        if not (frequencies > 0).all() or not (np.diff(frequencies) > 0).all():
            raise InputError("frequencies must be above zero and increase")
        if not (np.real(values) > 0).all() or (np.imag(values) > 0).any():
            raise InputError(
                "permittivities must have a real part above zero and an imaginary part of at most zero: the "
                "convention is exp(+i w t), in which a lossy permittivity is eps' - i eps''"
            )
        put(self, frequencies=frequencies, permittivities=values)

    @overload
    def permittivity(self, frequency: float) -> complex: ...
    @overload
    def permittivity(self, frequency: np.ndarray) -> np.ndarray: ...
    def permittivity(self, frequency: Any) -> Any:
        """Complex relative permittivity eps' - i eps'' at a frequency, or at an array of them, above zero [Hz].

        A metal's is 1 - i sigma / (2 pi f eps_0). A dielectric's is interpolated in its table, linearly in log f,
        and constant beyond the table's ends.

        Raises
        ------
        InputError
            The frequency is not above zero, or the material is known by its reflection alone.
        """
        given = np.asarray(frequency, dtype=float)
        if not (given > 0).all():
            raise InputError(f"frequency is {frequency!r}; expected above zero, in Hz")
        if self.conductivity is not None:
            values = 1 - 1j * self.conductivity / (2 * np.pi * given * EPSILON_0)
        elif self.frequencies is not None and self.permittivities is not None:
            values = np.interp(np.log(given), np.log(self.frequencies), self.permittivities)
        else:
            raise InputError(
                f"material {self.name!r} has only a reflection amplitude; give it frequencies and permittivities or a "
                "conductivity, or use one of MATERIALS"
            )
        return values if np.ndim(frequency) else complex(values)


class Layer(NamedTuple):
    """One layer of a slab: material and thickness [m]."""

    material: Material
    thickness: float


def _normal_reflection(permittivity: complex) -> complex:
    """Fresnel's reflection at normal incidence over a conductor's -1: (n - 1) / (n + 1), n² the permittivity."""
    index = permittivity**0.5
    return (index - 1) / (index + 1)


def _material(name: str, row: Mapping[str, Any]) -> Material:
    """A material of the table; its reflection is Fresnel's at 77 GHz unless the table states one."""
    correlation = row.get("correlation_mm")
    figures: dict[str, Any] = {"conductivity": row.get("conductivity")}
    if "permittivity" in row:
        eps, loss = np.array(row["permittivity"]), np.array(row["loss_tangent"])
        figures |= {"frequencies": np.array(row["ghz"]) * 1e9, "permittivities": eps * (1 - 1j * loss)}
    figures |= {
        "alpha": tuple(row["alpha"]),
        "roughness": row["roughness_um"] * 1e-6,
        "correlation_length": None if correlation is None else correlation * 1e-3,
        "source": row["source"],
    }
    known = Material(name=name, **figures)
    reflection = row.get("reflection", _normal_reflection(known.permittivity(REFLECTION_FREQUENCY)))
    return Material(name=name, reflection=reflection, **figures)


def _tables() -> tuple[dict[str, Material], dict[str, tuple[Layer, ...]]]:
    """The materials and the stacks of layers of `materials.toml`."""
    table: dict[str, Any] = tomllib.loads(_TABLE.read_text(encoding="utf-8"))
    stacks = table.pop("layers")
    materials = {name: _material(name, row) for name, row in table.items()}
    layers = {
        name: tuple(Layer(materials[material], thickness * 1e-3) for material, thickness in stack)
        for name, stack in stacks.items()
    }
    return materials, layers


_materials, _layers = _tables()

MATERIALS: Mapping[str, Material] = MappingProxyType(_materials)
"""Every material of the table by its name."""

LAYERED: Mapping[str, tuple[Layer, ...]] = MappingProxyType(_layers)
"""Slabs by name, as their layers from one side to the other: "carton", "cloth", "styrofoam", "plasterboard"."""


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
