"""How materials look to the virtual camera: colour, gloss, and whether a stereo pair can measure them.

Rough values, for pictures that tell things apart; nothing here reaches the radar.
"""

from typing import NamedTuple
from zlib import crc32

MATT, SHINY, CLEAR = "matt", "shiny", "clear"


class Appearance(NamedTuple):
    """Colour (red, green, blue from 0 to 1), strength of the lamp's glint, and kind: MATT, SHINY or CLEAR."""

    colour: tuple[float, float, float]
    gloss: float
    kind: str


_APPEARANCES = {
    "metal": Appearance((0.72, 0.74, 0.77), 0.6, SHINY),
    "steel": Appearance((0.66, 0.68, 0.71), 0.5, SHINY),
    "stainless_steel": Appearance((0.76, 0.78, 0.80), 0.7, SHINY),
    "aluminium": Appearance((0.80, 0.81, 0.83), 0.6, SHINY),
    "copper": Appearance((0.80, 0.50, 0.36), 0.6, SHINY),
    "brass": Appearance((0.78, 0.66, 0.36), 0.6, SHINY),
    "glass": Appearance((0.70, 0.82, 0.84), 0.7, CLEAR),
    "pet": Appearance((0.76, 0.86, 0.88), 0.6, CLEAR),
    "pmma": Appearance((0.82, 0.88, 0.90), 0.6, CLEAR),
    "ceramic": Appearance((0.86, 0.86, 0.82), 0.35, MATT),
    "plastic": Appearance((0.80, 0.25, 0.22), 0.25, MATT),
    "abs": Appearance((0.20, 0.42, 0.75), 0.25, MATT),
    "polyethylene": Appearance((0.85, 0.80, 0.62), 0.15, MATT),
    "polypropylene": Appearance((0.90, 0.72, 0.15), 0.2, MATT),
    "polystyrene": Appearance((0.25, 0.60, 0.40), 0.25, MATT),
    "pvc": Appearance((0.55, 0.56, 0.60), 0.2, MATT),
    "nylon": Appearance((0.88, 0.88, 0.84), 0.1, MATT),
    "rubber": Appearance((0.62, 0.72, 0.18), 0.05, MATT),
    "foam": Appearance((0.75, 0.35, 0.30), 0.0, MATT),
    "styrofoam": Appearance((0.93, 0.94, 0.95), 0.0, MATT),
    "polyurethane_foam": Appearance((0.90, 0.78, 0.25), 0.0, MATT),
    "polyethylene_foam": Appearance((0.72, 0.20, 0.18), 0.0, MATT),
    "eva_foam": Appearance((0.30, 0.45, 0.75), 0.0, MATT),
    "plasterboard": Appearance((0.85, 0.84, 0.80), 0.0, MATT),
    "concrete": Appearance((0.55, 0.55, 0.54), 0.0, MATT),
    "wood": Appearance((0.72, 0.53, 0.33), 0.05, MATT),
    "paper": Appearance((0.90, 0.89, 0.85), 0.0, MATT),
    "cardboard": Appearance((0.74, 0.30, 0.20), 0.05, MATT),  # a printed box
    "carton": Appearance((0.70, 0.55, 0.38), 0.0, MATT),
    "cotton": Appearance((0.80, 0.78, 0.72), 0.0, MATT),
    "cloth": Appearance((0.36, 0.45, 0.62), 0.0, MATT),
    "leather": Appearance((0.45, 0.28, 0.18), 0.1, MATT),
    "fruit": Appearance((0.88, 0.66, 0.16), 0.15, MATT),
    "floor": Appearance((0.34, 0.35, 0.37), 0.0, MATT),
}
_UNKNOWN = Appearance((0.6, 0.6, 0.6), 0.1, MATT)


def appearance_of(material: str, name: str = "") -> Appearance:
    """The appearance of a material, of a shade that differs from name to name by a few per cent."""
    known = _APPEARANCES.get(material, _UNKNOWN)
    shade = 0.9 + 0.2 * (crc32(name.encode()) % 256) / 255
    red, green, blue = (min(1.0, c * shade) for c in known.colour)
    return Appearance((red, green, blue), known.gloss, known.kind)
