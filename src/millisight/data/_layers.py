"""Plane layers between the antennas of a capture and its scene."""

import math

import numpy as np

from millisight.core import checked_array, checked_number, put, record
from millisight.core.errors import InputError


@record
class Layers:
    """Plane layers between antennas and scene, which the waves cross both ways (primer 2).

    The antennas of the capture are shifted by `moved` towards the scene, and its path offset includes `offset`, so that
    straight paths are nearly as long as the refracted ones. The imagers add the difference by Snell's law.

    Attributes
    ----------
    thicknesses : (L,) of each layer [m]
    indices : (L,) refractive index of each over that of the medium of the scene
    normal : (3,) unit vector from the antennas to the scene
    moved : along the normal [m]
    offset : of both ways together [m]
    error : largest error of straight paths alone, both ways, up to the widest given angle [m]
    """

    thicknesses: np.ndarray
    indices: np.ndarray
    normal: np.ndarray
    moved: float
    offset: float
    error: float

    def __post_init__(self) -> None:
        thicknesses = checked_array(self.thicknesses, name="thicknesses", shape=("L",), unit="m")
        indices = checked_array(self.indices, name="indices", shape=(len(thicknesses),))
        normal = checked_array(self.normal, name="normal", shape=(3,))
        if not len(thicknesses) or not (thicknesses > 0).all() or not (indices > 0).all():
            raise InputError("a layer has a thickness or a refractive index that is not above 0; expected both above 0")
        if abs(math.hypot(*normal) - 1) > 1e-9:
            raise InputError(f"normal has length {math.hypot(*normal):.6g}; expected 1")
        put(
            self,
            thicknesses=thicknesses,
            indices=indices,
            normal=normal,
            moved=checked_number(self.moved, name="moved", unit="m"),
            offset=checked_number(self.offset, name="offset", unit="m"),
            error=checked_number(self.error, name="error", unit="m", minimum=0),
        )

    def __repr__(self) -> str:
        thickness = 1e3 * float(self.thicknesses.sum())
        indices = f"indices {self.indices.min():.4g} to {self.indices.max():.4g}"
        return f"Layers({len(self.thicknesses)} of {thickness:.4g} mm together, {indices})"

    @property
    def nearest(self) -> float:
        """How far along the normal a scene behind the layers is from the moved antennas, at least [m]."""
        return float(self.thicknesses.sum()) - self.moved
