"""A catalogue of everyday objects, built in code: no file to find, and every dimension known.

The objects are 76 of the YCB Object and Model Set (Calli et al. 2015, "Benchmarking in Manipulation Research", IEEE
Robotics & Automation Magazine 22(3)), with its names and sizes; `catalogue.toml` says of each where its size is
from. The meshes are drawn here, not scanned.

Which 76: the MITO paper took 76 of 80 YCB objects and prints no list of them, nor of the four. 80 is what the set
has as laser scans (79) and the chips can, which the paper's dataset holds. Left out here, by our own choice, are the
loose parts of the toy airplane (072-b to 072-e): nobody states their size, and the airplane itself is in.

Each lies as it would on a table under a radar that looks down along -z, so that the view from above tells most:

- tools, cutlery, cans, bottles, the banana and the pear lie flat, their long side along x (the drill: its barrel);
- boxes lie on their largest face, the foam brick and the peg test with their holes up;
- what is open (mug, bowl, cups, plate, skillet) stands, open side up, and so do the tuna can, the apple, toy
  bricks, stacked blocks and the airplane; only the pitcher, too tall to stand under a radar, lies like a bottle.

To add an object: measure it, write its entry in `catalogue.toml`, and give it a sketch, an old one or a new one.
"""

import dataclasses
import importlib
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from millisight.core import check_known, checked_number, printable, put, record
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.data import MATERIALS, Material, SceneObject, TriangleMesh
from millisight.meshes._shape_classes import SHAPE_CLASSES

if TYPE_CHECKING:
    from manifold3d import Manifold

CATEGORIES = ("food", "kitchen", "tool", "shape", "task")
SOURCES = ("scan", "reported", "table", "nominal")

_WHOLE = "whole"  # the one part of an object of one material
_TABLE = Path(__file__).with_name("catalogue.toml")


@record
class ObjectPart(SceneObject):
    """A part of one material, in the frame of its whole object [m]; what touches it was cut from it.

    Attributes
    ----------
    name : as in the catalogue; "whole" for an object of one material
    mesh : closed and outward-wound, perhaps of several pieces
    material : what it is made of
    """

    def __repr__(self) -> str:  # a record would make its own
        return SceneObject.__repr__(self)


@record
class CatalogueObject:
    """One everyday object.

    Attributes
    ----------
    name : as in `build_object(name)`; of siblings like "065-d_cups" the letter stays: "d_cups"
    ycb_id : number and name in the YCB set, "025_mug": also the name of its folder there
    category : "food", "kitchen", "tool", "shape" or "task", as in the YCB set
    parts : name and material of each part, the material a name in `material.MATERIALS`; the one part of an object of
        one material is its "whole"
    shape_class : one of the four classes of the MITO paper ("handle": a tool with a long handle), or "other"
    dimensions : size along x, y and z, as it lies [m]
    source : of the dimensions: "scan", "reported", "table" or "nominal", see `catalogue.toml`
    sketch : module and function in `millisight.meshes._sketches` that draw it
    alpha : weights (a1, a2) of the specular and the edge image that were fitted to it; None: those of its material
    published : name of its folder in the published dataset; "": `ycb_id`, if it is there
    """

    name: str
    ycb_id: str
    category: str
    parts: tuple[tuple[str, str], ...]
    shape_class: str
    dimensions: tuple[float, float, float]
    source: str
    sketch: str
    alpha: tuple[float, float] | None = None
    published: str = ""

    def __post_init__(self) -> None:
        parts = tuple((str(part), str(material)) for part, material in self.parts)
        if not parts:
            raise InputError(f"{self.name} has no parts; expected at least one with its material")
        for kind, values, known in (
            ("category", (self.category,), CATEGORIES),
            ("material", (material for _, material in parts), MATERIALS),
            ("shape class", (self.shape_class,), SHAPE_CLASSES),
            ("source of dimensions", (self.source,), SOURCES),
        ):
            for value in values:
                check_known(kind, value, known)
        named = f"a dimension of {self.name}"
        x, y, z = (checked_number(size, name=named, unit="m", above=0) for size in self.dimensions)
        put(self, parts=parts, dimensions=(x, y, z))
        if self.alpha is not None:
            put(self, alpha=self.material_of_whole.alpha)

    @property
    def number(self) -> str:
        """The number in the YCB set: "025", "065-d"."""
        return self.ycb_id.partition("_")[0]

    @property
    def material(self) -> str:
        """What dominates the reflection: the material of the part named first."""
        return self.parts[0][1]

    @property
    def material_of_whole(self) -> Material:
        """That material for the object as one mesh: with the weights fitted to the object, where there are any."""
        material = MATERIALS[self.material]
        return material if self.alpha is None else dataclasses.replace(material, alpha=self.alpha)

    def build(self) -> TriangleMesh:
        """The whole as one mesh [m]."""
        from millisight.meshes._shapes import mesh_of, union

        return mesh_of(union(*self._solids().values()))

    def build_parts(self) -> tuple[ObjectPart, ...]:
        """The parts as meshes of their own [m], each with its material."""
        from millisight.meshes._shapes import apart, mesh_of, middle_of, union

        solids = self._solids()
        centre = middle_of(union(*solids.values()))
        meshes = {name: mesh_of(solid, centre=centre, pieces=True) for name, solid in apart(solids).items()}
        return tuple(
            ObjectPart(name=name, mesh=meshes[name], material=MATERIALS[material]) for name, material in self.parts
        )

    def _solids(self) -> "dict[str, Manifold]":
        """What the sketch draws: the parts by name [mm]; they may overlap, and then the first keeps the place."""
        module, _, function = self.sketch.partition(".")
        draw = getattr(importlib.import_module(f"millisight.meshes._sketches.{module}"), function)
        drawn = draw(*(1000 * size for size in self.dimensions))
        return drawn if isinstance(drawn, dict) else {_WHOLE: drawn}


def _entries() -> Iterator[CatalogueObject]:
    table: dict[str, dict[str, Any]] = tomllib.loads(_TABLE.read_text(encoding="utf-8"))
    for ycb_id, row in table.items():
        x, y, z = row["size_mm"]
        material = row["material"] if isinstance(row["material"], dict) else {_WHOLE: row["material"]}
        yield CatalogueObject(
            name=ycb_id.lstrip("0123456789").lstrip("-_"),
            ycb_id=ycb_id,
            category=row["category"],
            parts=tuple(material.items()),
            shape_class=row["class"],
            dimensions=(x / 1000, y / 1000, z / 1000),
            source=row["source"],
            sketch=row["sketch"],
            alpha=row.get("alpha"),
            published=row.get("published", ""),
        )


CATALOGUE: Mapping[str, CatalogueObject] = MappingProxyType({entry.name: entry for entry in _entries()})
"""Every object by its name, in the order of the YCB numbers."""


# Where the YCB downloads and the datasets made of them keep a mesh below the object's own folder; the best first.
_FOLDERS = ("google_16k", "google_64k", "google_512k", "", "poisson", "tsdf")
_FILES = ("nontextured.stl", "nontextured.ply", "textured.obj", "textured_simple.obj", "uniform.stl")
_SUFFIXES = (".ply", ".stl", ".obj", ".off", ".glb")

_NUMBER = re.compile(r"\d+(-?[a-z])?[-_ ](?=.)", re.IGNORECASE)


def _key(spelled: str) -> str:
    """Letters and digits alone, without case and leading zeros: "057_racquetball" and "57-Racquetball" are the same."""
    return re.sub(r"[\W_]+", "", spelled.casefold()).lstrip("0")


def _spellings(entry: CatalogueObject) -> Iterator[str]:
    yield from (entry.name, entry.ycb_id, entry.published)
    number, letter = entry.number.partition("-")[::2]
    if letter:  # as the published dataset spells those of a set: 065b_cups_b
        of_set = f"{entry.ycb_id.partition('_')[2]}_{letter}"
        yield from (of_set, f"{number}_{of_set}", f"{number}{letter}_{of_set}")
    yield _NUMBER.sub("", entry.published, count=1)


_NAMES = {_key(known): name for name, entry in CATALOGUE.items() for known in _spellings(entry) if known}


_YCB = {entry.ycb_id: name for name, entry in CATALOGUE.items()}


def catalogue_name(name: str) -> str:
    """The catalogue's name of an object, given as that or as in the YCB set: "mug" of "025_mug".

    Raises
    ------
    UnknownNameError
    """
    if name not in CATALOGUE and name not in _YCB:
        raise UnknownNameError("catalogue object", name, CATALOGUE)
    return _YCB.get(name, name)


def object_name(spelled: str) -> str:
    """One name for one object, however a folder or a file spells it: the catalogue's, else that without its number.

    Case, and what stands between words, do not matter. Of a path counts the last part that the catalogue knows, of
    folders by their number and name; the suffix of a mesh file is left out. Several objects are joined by "+".

    Examples
    --------
    >>> [object_name(folder) for folder in ("025_mug", "057-racquetball", "042_wrench", "074-x_wide", "thing")]
    ['mug', 'racquetball', 'adjustable_wrench', 'wide', 'thing']
    >>> [object_name(path) for path in ("057_Racquetball.PLY", "025_mug/google_16k/nontextured.stl", "My Gear.stl")]
    ['racquetball', 'mug', 'my_gear']
    """
    if "+" in spelled:
        return "+".join(object_name(one) for one in spelled.split("+") if one)
    parts = re.split(r"[/\\]", spelled)
    *folders, last = [one for one in parts if one.lower() not in (*_FOLDERS, *_FILES)] or [spelled]
    stem = last[: last.rindex(".")] if last.lower().endswith(_SUFFIXES) else last
    for one in (stem, *(folder for folder in reversed(folders) if folder[:1].isdigit())):
        if _key(one) in _NAMES:
            return _NAMES[_key(one)]
    number = _NUMBER.match(stem)
    if number and not number[1]:  # with a letter it is another one of a set than what has none
        return object_name(stem[number.end() :])
    rest = stem[number.end() :] if number else stem
    return re.sub(r"[\W_]+", "_", rest.casefold()).strip("_") or spelled


def build_object(name: str) -> TriangleMesh:
    """Build the mesh of one object [m]: closed, outward-wound, with its bounding box centred at the origin.

    Raises
    ------
    UnknownNameError
        The catalogue has no object of this name.

    Examples
    --------
    >>> build_object("sugar_box").extent.round(4)
    array([0.1762, 0.0921, 0.0452])
    """
    return _entry(name).build()


def build_parts(name: str) -> tuple[ObjectPart, ...]:
    """The parts of one object, each closed and of one material: together they fill what `build_object` fills.

    No two of them overlap; where they touch, each has a face of its own. The part that dominates the reflection
    comes first.

    Raises
    ------
    UnknownNameError
        The catalogue has no object of this name.

    Examples
    --------
    >>> [(part.name, part.material.name) for part in build_parts("phillips_screwdriver")]
    [('shaft', 'steel'), ('handle', 'plastic')]
    """
    return _entry(name).build_parts()


def _entry(name: str) -> CatalogueObject:
    check_known("catalogue object", name, CATALOGUE)
    return CATALOGUE[name]


def find_scans(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """Real scans of catalogue objects in a folder, by the catalogue's names, in the order of the YCB numbers.

    A scan is named as the YCB set names it: a mesh file `025_mug.ply` (or .stl, .obj, .off, .glb), or a folder
    `025_mug` with a mesh as the set's downloads hold it, `google_16k/nontextured.stl` for one. `027-skillet` is
    taken for `027_skillet`, as the set itself writes both. What has other names is passed over.

    Raises
    ------
    FileError
        There is no such folder, it cannot be read, or it holds no scan of a catalogue object.
    """
    folder = Path(folder)
    try:
        places = {entry.name: entry for entry in sorted(folder.iterdir())}
    except OSError as error:
        raise FileError(
            f"cannot read the folder of scans {printable(folder)}: {error.strerror or error}; check --meshes"
        ) from error
    found = {name: scan for name, entry in CATALOGUE.items() if (scan := _scan_of(entry, places))}
    if not found:
        raise FileError(
            f"{printable(folder)} holds no scan of a catalogue object; expected files like 025_mug.ply, or folders "
            "like 025_mug/google_16k with nontextured.stl in them, as the YCB set names them"
        )
    return found


def find_meshes(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """All meshes in a folder by name: files `NAME.ply` (or .stl, .obj, .off, .glb), and folders `NAME` with a mesh as
    the YCB set's downloads and the published dataset hold it, such as `NAME/nontextured.stl`.

    Raises
    ------
    FileError
        There is no such folder, it cannot be read, or it holds no mesh.
    """
    folder = Path(folder)
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise FileError(f"cannot read the folder of meshes {printable(folder)}: {error.strerror or error}") from error
    found = {entry.stem: entry for entry in entries if entry.suffix.lower() in _SUFFIXES and entry.is_file()}
    for entry in entries:
        below = (entry / inner / file for inner in _FOLDERS for file in _FILES)
        mesh = next((path for path in below if path.is_file()), None) if entry.is_dir() else None
        if mesh is not None:
            found.setdefault(entry.name, mesh)
    if not found:
        raise FileError(
            f"{printable(folder)} holds no mesh; expected files like mug.stl, or folders with nontextured.stl"
        )
    return found


def _scan_of(entry: CatalogueObject, places: Mapping[str, Path]) -> Path | None:
    """The best mesh of one object among the files and folders of one folder."""
    for stem in (entry.ycb_id, f"{entry.number}-{entry.ycb_id.partition('_')[2]}"):
        below = [places[stem] / inner / file for inner in _FOLDERS for file in _FILES] if stem in places else []
        beside = [places[stem + suffix] for suffix in _SUFFIXES if stem + suffix in places]
        for path in (*beside, *below):
            if path.is_file():
                return path
    return None
