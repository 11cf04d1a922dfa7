"""Sheets of layers between radar and objects: cardboard, cloth, boards. They let through, delay, and reflect."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from millisight.core import checked_array, put, record
from millisight.core.errors import InputError
from millisight.rig.virtual._slabs import slab_coefficients, thickness_of
from millisight.rig.virtual._surface import Boundary, layers_at

_COSINES = 512  # entries of a table, from the horizon to straight on


@record
class Sheet:
    """A flat rectangle of layers, whose middle is the plane given.

    Attributes
    ----------
    corner, u, v : (3,) one of its corners, and its two sides from there [m]
    layers : (material or relative permittivity, thickness [m]) of each, the first on the side of u x v
    """

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    layers: tuple[tuple[Any, float], ...]

    def __post_init__(self) -> None:
        for name in ("corner", "u", "v"):
            put(self, **{name: checked_array(getattr(self, name), name=f"a sheet's {name}", shape=(3,), unit="m")})
        long, wide = np.linalg.norm(self.u), np.linalg.norm(self.v)
        if not long * wide > 0 or abs(self.u @ self.v) > 1e-6 * long * wide:
            raise InputError(f"a sheet's sides are {self.u} and {self.v} m; expected two at a right angle")
        layers = tuple((material, float(thickness)) for material, thickness in self.layers)
        if not layers:
            raise InputError("a sheet has no layers; expected (material or permittivity, thickness) of at least one")
        put(self, layers=layers)

    @property
    def triangles(self) -> np.ndarray:
        """(2, 3, 3) that face along u x v [m]."""
        a, b, c, d = self.corner, self.corner + self.u, self.corner + self.u + self.v, self.corner + self.v
        return np.array([[a, b, c], [a, c, d]])

    def faces(self, frequency: float) -> tuple[tuple[np.ndarray, Boundary], ...]:
        """What reflects, of both sides: triangles (F, 3, 3) and their surface."""
        layers = layers_at(self.layers, frequency)
        setback = thickness_of(layers) / 2
        return (
            (self.triangles, Boundary(backing=1.0, layers=layers, setback=setback)),
            (self.triangles[:, ::-1], Boundary(backing=1.0, layers=layers[::-1], setback=setback)),
        )


def box_sheets(lower: Any, upper: Any, layers: tuple[tuple[Any, float], ...]) -> tuple[Sheet, ...]:
    """The six sides of a box from `lower` (3,) to `upper` (3,) [m], the first layer outside."""
    lower = checked_array(lower, name="lower", shape=(3,), unit="m")
    upper = checked_array(upper, name="upper", shape=(3,), unit="m")
    x, y, z = np.diag(upper - lower)
    sides = [(lower, y, x), (lower, z, y), (lower, x, z), (upper, -x, -y), (upper, -y, -z), (upper, -z, -x)]
    return tuple(Sheet(corner=corner, u=u, v=v, layers=layers) for corner, u, v in sides)


def sheet_tables(sheets: Sequence[Sheet], center: float, half_band: float) -> tuple[np.ndarray, np.ndarray]:
    """The sheets as `_path_kernels.fill_legs` takes them: (K, 14) their places, (K, N, 4) their transmission.

    The transmission is the mean of TE and TM, taken along the straight path: by Fermat's principle its phase is right
    to the first order in the displacement by refraction, which is left out (under a millimetre for carton).
    """
    places = np.zeros((len(sheets), 14))
    tables = np.zeros((len(sheets), _COSINES + 1, 4))
    # The logarithm has no end at the horizon, where nothing goes through.
    cosines = np.maximum(np.linspace(0, 1, _COSINES + 1), 1e-3)
    for k, sheet in enumerate(sheets):
        long, wide = np.linalg.norm(sheet.u), np.linalg.norm(sheet.v)
        u, v = sheet.u / long, sheet.v / wide
        places[k] = *sheet.corner, *u, *v, *np.cross(u, v), long, wide
        layers = layers_at(sheet.layers, center)
        band = center + half_band * np.array([[-1.0], [0.0], [1.0]])
        low, middle, high = slab_coefficients(layers, band, cosines)[1].mean(axis=0)
        tables[k, :, 0] = np.log(np.maximum(abs(middle), 1e-30))
        tables[k, :, 1] = -np.unwrap(np.angle(middle)) / (2 * np.pi)
        slope = np.log(high / low) / 2
        tables[k, :, 2], tables[k, :, 3] = slope.real, slope.imag
    return places, tables
