"""How materials look to the virtual camera: colour, gloss, and whether a stereo pair can measure them.

Rough values, for pictures that tell things apart; nothing here reaches the radar.
"""

from typing import NamedTuple
from zlib import crc32

MATT, SHINY, CLEAR = "matt", "shiny", "clear"


class Look(NamedTuple):
    """Colour (red, green, blue from 0 to 1), strength of the lamp's glint, and kind: MATT, SHINY or CLEAR."""

    colour: tuple[float, float, float]
    gloss: float
    kind: str


_LOOKS = {
    "metal": Look((0.72, 0.74, 0.77), 0.6, SHINY),
    "steel": Look((0.66, 0.68, 0.71), 0.5, SHINY),
    "stainless_steel": Look((0.76, 0.78, 0.80), 0.7, SHINY),
    "aluminium": Look((0.80, 0.81, 0.83), 0.6, SHINY),
    "copper": Look((0.80, 0.50, 0.36), 0.6, SHINY),
    "brass": Look((0.78, 0.66, 0.36), 0.6, SHINY),
    "glass": Look((0.70, 0.82, 0.84), 0.7, CLEAR),
    "pet": Look((0.76, 0.86, 0.88), 0.6, CLEAR),
    "pmma": Look((0.82, 0.88, 0.90), 0.6, CLEAR),
    "ceramic": Look((0.86, 0.86, 0.82), 0.35, MATT),
    "plastic": Look((0.80, 0.25, 0.22), 0.25, MATT),
    "abs": Look((0.20, 0.42, 0.75), 0.25, MATT),
    "polyethylene": Look((0.85, 0.80, 0.62), 0.15, MATT),
    "polypropylene": Look((0.90, 0.72, 0.15), 0.2, MATT),
    "polystyrene": Look((0.25, 0.60, 0.40), 0.25, MATT),
    "pvc": Look((0.55, 0.56, 0.60), 0.2, MATT),
    "nylon": Look((0.88, 0.88, 0.84), 0.1, MATT),
    "rubber": Look((0.62, 0.72, 0.18), 0.05, MATT),
    "foam": Look((0.75, 0.35, 0.30), 0.0, MATT),
    "styrofoam": Look((0.93, 0.94, 0.95), 0.0, MATT),
    "polyurethane_foam": Look((0.90, 0.78, 0.25), 0.0, MATT),
    "polyethylene_foam": Look((0.72, 0.20, 0.18), 0.0, MATT),
    "eva_foam": Look((0.30, 0.45, 0.75), 0.0, MATT),
    "plasterboard": Look((0.85, 0.84, 0.80), 0.0, MATT),
    "concrete": Look((0.55, 0.55, 0.54), 0.0, MATT),
    "wood": Look((0.72, 0.53, 0.33), 0.05, MATT),
    "paper": Look((0.90, 0.89, 0.85), 0.0, MATT),
    "cardboard": Look((0.74, 0.30, 0.20), 0.05, MATT),  # a printed box
    "carton": Look((0.70, 0.55, 0.38), 0.0, MATT),
    "cotton": Look((0.80, 0.78, 0.72), 0.0, MATT),
    "cloth": Look((0.36, 0.45, 0.62), 0.0, MATT),
    "leather": Look((0.45, 0.28, 0.18), 0.1, MATT),
    "fruit": Look((0.88, 0.66, 0.16), 0.15, MATT),
    "floor": Look((0.34, 0.35, 0.37), 0.0, MATT),
}
_UNKNOWN = Look((0.6, 0.6, 0.6), 0.1, MATT)


def look_of(material: str, name: str = "") -> Look:
    """The look of a material, of a shade that differs from name to name by a few per cent."""
    look = _LOOKS.get(material, _UNKNOWN)
    shade = 0.9 + 0.2 * (crc32(name.encode()) % 256) / 255
    red, green, blue = (min(1.0, c * shade) for c in look.colour)
    return Look((red, green, blue), look.gloss, look.kind)
