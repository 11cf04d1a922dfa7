"""A catalogue of everyday objects, built in code: no file to find, and every dimension known.

The objects are named after those of the YCB Object and Model Set (Calli et al. 2015, "Benchmarking in
Manipulation Research", IEEE Robotics & Automation Magazine 22(3)) and have their sizes. The meshes are drawn
here, not scanned.

Each lies as it would on a table under a radar that looks down along -z, so that the view from above tells
most:

- tools, cutlery, cans, bottles and the banana lie flat, their long side along x (the drill: its barrel);
- boxes lie on their largest face, the foam brick with its holes up;
- what is open (mug, bowl, cups, plate, skillet) stands, open side up, and so do the tuna can and the apple.

To add an object: measure it, write its line in `_TABLE`, and give it a sketch, an old one or a new one.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from millisight.errors import UnknownNameError
from millisight.records import checked_number, put, record
from millisight.scene import sketches
from millisight.scene.material import MATERIALS
from millisight.scene.mesh import TriangleMesh
from millisight.scene.shapes import mesh_of

if TYPE_CHECKING:
    from manifold3d import Manifold

SHAPE_CLASSES = ("can", "handle", "box", "sphere", "other")
CATEGORIES = ("food", "kitchen", "tool", "shape", "task")


@record
class CatalogueObject:
    """One everyday object.

    Attributes
    ----------
    name : as in `build_object(name)`
    ycb_id : number and name of its namesake in the YCB set
    category : "food", "kitchen", "tool", "shape" or "task", as in the YCB set
    material : what dominates its reflection, a name in `material.MATERIALS`
    shape_class : one of the four classes of the MITO paper ("handle": a tool with a long handle), or "other"
    dimensions : size along x, y and z, as it lies [m]
    build : makes its mesh
    """

    name: str
    ycb_id: str
    category: str
    material: str
    shape_class: str
    dimensions: tuple[float, float, float]
    build: Callable[[], TriangleMesh]

    def __post_init__(self) -> None:
        for kind, value, known in (
            ("category", self.category, CATEGORIES),
            ("material", self.material, MATERIALS),
            ("shape class", self.shape_class, SHAPE_CLASSES),
        ):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        named = f"a dimension of {self.name}"
        x, y, z = (checked_number(size, name=named, unit="m", above=0) for size in self.dimensions)
        put(self, dimensions=(x, y, z))


# YCB id, category, material, shape class, size (x, y, z) as it lies [mm], sketch. The sizes are those of
# bounding boxes around the YCB scans (Calli et al. 2015). "nominal": no scan was measured; a round figure.
_TABLE = (
    ("001_chips_can", "food", "cardboard", "can", (250.0, 75.0, 75.0), sketches.can),  # nominal
    ("002_master_chef_can", "food", "metal", "can", (140.2, 102.4, 102.4), sketches.can),
    ("003_cracker_box", "food", "cardboard", "box", (213.8, 163.6, 71.7), sketches.box),
    ("004_sugar_box", "food", "cardboard", "box", (176.2, 92.1, 45.2), sketches.box),
    ("005_tomato_soup_can", "food", "metal", "can", (101.8, 67.6, 67.6), sketches.can),
    ("006_mustard_bottle", "food", "plastic", "other", (191.4, 95.8, 57.7), sketches.mustard_bottle),
    ("007_tuna_fish_can", "food", "metal", "can", (85.3, 85.3, 33.4), sketches.standing_can),
    ("008_pudding_box", "food", "cardboard", "box", (113.0, 89.7, 38.3), sketches.box),
    ("009_gelatin_box", "food", "cardboard", "box", (89.4, 72.7, 29.8), sketches.box),
    ("010_potted_meat_can", "food", "metal", "can", (101.5, 83.4, 57.3), sketches.meat_can),
    ("011_banana", "food", "fruit", "other", (197.6, 69.2, 36.3), sketches.banana),
    ("013_apple", "food", "fruit", "sphere", (74.7, 74.7, 71.2), sketches.apple),
    ("015_peach", "food", "fruit", "sphere", (63.7, 59.1, 57.4), sketches.ball),
    ("017_orange", "food", "fruit", "sphere", (72.4, 71.7, 71.4), sketches.ball),
    ("021_bleach_cleanser", "kitchen", "plastic", "other", (254.2, 98.3, 67.7), sketches.bleach_bottle),
    ("024_bowl", "kitchen", "metal", "other", (161.0, 160.4, 54.7), sketches.bowl),  # enamelled steel
    ("025_mug", "kitchen", "metal", "other", (117.0, 93.0, 81.3), sketches.mug),  # enamelled steel
    ("026_sponge", "kitchen", "foam", "box", (111.2, 79.3, 18.1), sketches.sponge),
    ("027_skillet", "kitchen", "metal", "handle", (460.0, 270.0, 59.0), sketches.skillet),  # nominal
    ("029_plate", "kitchen", "metal", "other", (258.0, 258.0, 24.0), sketches.dinner_plate),  # nominal
    ("030_fork", "kitchen", "metal", "handle", (197.8, 25.6, 15.5), sketches.fork),
    ("032_knife", "kitchen", "metal", "handle", (214.9, 19.5, 15.3), sketches.knife),
    ("033_spatula", "kitchen", "plastic", "handle", (311.0, 83.6, 32.9), sketches.spatula),
    ("035_power_drill", "tool", "plastic", "other", (184.3, 186.8, 57.2), sketches.power_drill),
    ("036_wood_block", "tool", "wood", "box", (200.0, 85.0, 85.0), sketches.box),  # nominal
    ("037_scissors", "tool", "metal", "handle", (198.5, 87.8, 15.5), sketches.scissors),
    ("038_padlock", "tool", "metal", "other", (70.3, 53.9, 28.8), sketches.padlock),
    ("040_large_marker", "tool", "plastic", "handle", (120.8, 18.8, 18.8), sketches.marker),
    ("042_adjustable_wrench", "tool", "metal", "handle", (202.8, 58.4, 13.7), sketches.adjustable_wrench),
    ("043_phillips_screwdriver", "tool", "metal", "handle", (216.2, 34.1, 33.5), sketches.screwdriver),
    ("048_hammer", "tool", "metal", "handle", (335.5, 126.4, 32.3), sketches.hammer),
    ("050_medium_clamp", "tool", "plastic", "other", (84.6, 77.2, 26.0), sketches.spring_clamp),
    ("052_extra_large_clamp", "tool", "plastic", "other", (202.3, 165.2, 36.2), sketches.spring_clamp),
    ("054_softball", "shape", "rubber", "sphere", (95.6, 95.2, 94.8), sketches.ball),
    ("055_baseball", "shape", "rubber", "sphere", (72.5, 72.5, 72.0), sketches.ball),
    ("056_tennis_ball", "shape", "rubber", "sphere", (64.7, 64.7, 64.7), sketches.ball),  # nominal
    ("058_golf_ball", "shape", "plastic", "sphere", (42.6, 42.6, 42.4), sketches.ball),
    ("061_foam_brick", "shape", "foam", "box", (77.5, 51.9, 51.2), sketches.foam_brick),
    ("065-d_cups", "shape", "plastic", "other", (70.5, 70.5, 68.9), sketches.cup),
    ("065-h_cups", "shape", "plastic", "other", (91.5, 91.5, 74.9), sketches.cup),
    ("077_rubiks_cube", "task", "plastic", "box", (58.8, 58.1, 57.9), sketches.rubiks_cube),
)


def _entry(
    ycb_id: str,
    category: str,
    material: str,
    shape_class: str,
    size_mm: tuple[float, float, float],
    sketch: "Callable[[float, float, float], Manifold]",
) -> CatalogueObject:
    # "065-d_cups" has siblings, so its letter stays in the name: "d_cups".
    name = ycb_id.lstrip("0123456789").lstrip("-_")
    return CatalogueObject(
        name=name,
        ycb_id=ycb_id,
        category=category,
        material=material,
        shape_class=shape_class,
        dimensions=(size_mm[0] / 1000, size_mm[1] / 1000, size_mm[2] / 1000),
        build=lambda: mesh_of(sketch(*size_mm)),
    )


CATALOGUE: Mapping[str, CatalogueObject] = MappingProxyType(
    {entry.name: entry for entry in (_entry(*row) for row in _TABLE)}
)
"""Every object by its name, in the order of the YCB numbers."""


def object_names() -> tuple[str, ...]:
    """The names of all objects in the catalogue, in the order of the YCB numbers."""
    return tuple(CATALOGUE)


def build_object(name: str) -> TriangleMesh:
    """The mesh of one object [m]: closed, outward-wound, its bounding box centred at the origin.

    Raises
    ------
    UnknownNameError
        The catalogue has no object of this name.

    Examples
    --------
    >>> build_object("sugar_box").extent.round(4)
    array([0.1762, 0.0921, 0.0452])
    """
    if name not in CATALOGUE:
        raise UnknownNameError("catalogue object", name, CATALOGUE)
    return CATALOGUE[name].build()
