"""A recipe: what a generated dataset is to hold, as records that check every value, and RECIPE.toml.

Lengths in metres, in the radar frame: antennas move about z = 0, what they look at lies below.
"""

import os
from collections.abc import Collection, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import (
    check_known,
    checked_integer,
    checked_number,
    checked_numbers,
    checked_record,
    printable,
    put,
    read_toml,
    record,
    record_from_table,
)
from millisight.core import record_from_file as record_from_file
from millisight.core.errors import InputError, UnknownNameError, quoted
from millisight.data import material_named
from millisight.datasets.generation._covers import Covers
from millisight.io.mito import RADARS
from millisight.meshes import CATALOGUE, CATEGORIES, PUBLISHED_CLASSES, SHAPE_CLASSES, catalogue_name
from millisight.simulation import SCATTERING_MODELS

KEEPS = ("raw", "captures", "images")
BACKGROUNDS = ("tripod", "styrofoam")
CONDITIONS = ("los", "carton", "cloth", "carton+cloth")
_FINEST, _LONGEST_NAME = 1e-5, 200  # voxels [m]; characters, as of a folder's name
_MOST_POSES, _MOST_OBJECTS = 10_000, 100  # of an object; of a scene


@record
class Objects:
    """Which objects of the catalogue: all that any of these names; each once, in the order of the YCB numbers."""

    names: tuple[str, ...] = ()  # "mug" or "025_mug"
    categories: tuple[str, ...] = ()  # "food", "kitchen", "tool", "shape", "task"
    classes: tuple[str, ...] = ()  # "can", "handle", "box", "sphere", "other"
    all: bool = False  # every one
    without: tuple[str, ...] = ()  # names of those that are left out after all

    def __post_init__(self) -> None:
        put(
            self,
            names=tuple(catalogue_name(name) for name in self.names),
            without=tuple(catalogue_name(name) for name in self.without),
        )
        _check_all("category", self.categories, CATEGORIES)
        _check_all("class", self.classes, SHAPE_CLASSES)
        checked_record(self.all, bool, name="all")
        if not self.chosen and (self.all or self.names or self.categories or self.classes):
            raise InputError("without removes every object; keep at least one")

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the catalogue."""
        return tuple(
            name
            for name, entry in CATALOGUE.items()
            if (
                self.all or name in self.names or entry.category in self.categories or entry.shape_class in self.classes
            )
            and name not in self.without
        )


@record
class MeshFile:
    """A mesh file as an object.

    Attributes
    ----------
    path : of the mesh file, relative to the recipe; its name without suffix is the object's
    material : a name of `MATERIALS`
    unit : "m", "cm", "mm" or "in"; None: see `load_mesh`
    shape_class : "can", "handle", "box", "sphere" or "other"
    """

    path: str
    material: str = "metal"
    unit: str | None = None
    shape_class: str = field(default="other", metadata={"key": "class"})

    def __post_init__(self) -> None:
        checked_record(self.path, str, name="path")
        material_named(self.material)
        check_known("class", self.shape_class, PUBLISHED_CLASSES)

    @property
    def name(self) -> str:
        return Path(self.path).stem


@record
class Placed:
    """An object of a scene of several."""

    object: str  # a name of the catalogue, or of one of the recipe's files
    offset: tuple[float, float] = (0.0, 0.0)  # x and y of its middle from the aperture's middle [m]
    angles_deg: tuple[int, int, int] = (0, 0, 0)  # about the fixed x, y, then z axis, whole

    def __post_init__(self) -> None:
        checked_record(self.object, str, name="object")
        put(
            self,
            offset=checked_numbers(self.offset, name="offset", count=2, unit="m"),
            angles_deg=_angles(self.angles_deg, "angles_deg"),
        )


@record
class SceneRecipe:
    """A scene of several objects, which stand as they are stated: the recipe's poses are not theirs."""

    objects: tuple[Placed, ...]

    def __post_init__(self) -> None:
        if len(self.objects) < 2:
            raise InputError(
                f"objects has {len(self.objects)} entries; expected at least two; for a single one use object"
            )
        if len(self.objects) > _MOST_OBJECTS:
            raise InputError(f"objects has {len(self.objects)} entries; expected {_MOST_OBJECTS} at most")


@record
class PoseSettings:
    """How every object lies: the stated angles, then drawn ones, other ones for each object."""

    angles_deg: tuple[tuple[int, int, int], ...] | None = None  # about the fixed x, y, then z axis, whole
    count: int = 0  # how many more are drawn, no two alike
    x_deg: tuple[int, int] = (0, 0)  # from which range, ends included
    y_deg: tuple[int, int] = (0, 0)
    z_deg: tuple[int, int] = (0, 359)
    shift: float = 0.0  # how far from the aperture's middle each lies, along x and along y, at most [m]

    def __post_init__(self) -> None:
        count = checked_integer(self.count, name="count", minimum=0)
        stated = self.angles_deg if self.angles_deg is not None else () if count else ((0, 0, 0),)
        angles = tuple(_angles(value, f"angles_deg[{i}]") for i, value in enumerate(stated))
        if not angles and not count:
            raise InputError("angles_deg is empty and count 0; expected at least one pose")
        if len(set(angles)) < len(angles):
            raise InputError(f"angles_deg states a pose twice: {list(angles)}; leave one out")
        ranges = {name: _range(getattr(self, name), name) for name in ("x_deg", "y_deg", "z_deg")}
        room = int(np.prod([high - low + 1 for low, high in ranges.values()])) - len(angles)
        if count > room:
            raise InputError(f"count is {count}, but the ranges hold only {max(room, 0)} other whole angles")
        if count + len(angles) > _MOST_POSES:
            raise InputError(f"{count + len(angles)} poses; expected {_MOST_POSES} at most of an object")
        shift = checked_number(self.shift, name="shift", unit="m", minimum=0)
        put(self, angles_deg=angles, count=count, shift=shift, **ranges)

    @property
    def stated(self) -> tuple[tuple[int, int, int], ...]:
        return self.angles_deg or ()


@record
class Voxels:
    """The voxels of the images: the box that is published of this kind of image, finer, coarser, or a part of it."""

    spacing: tuple[float, float, float] = (0.0025, 0.0025, 0.01)  # along x, y and z [m]
    margin: float | None = None  # how much is kept around the objects [m]; None: the whole box
    beyond: float = 0.0  # how much more, at most, drawn for each side along x and y: the objects lie off the middle [m]

    def __post_init__(self) -> None:
        spacing = checked_numbers(self.spacing, name="spacing", count=3, unit="m", minimum=_FINEST)
        beyond = checked_number(self.beyond, name="beyond", unit="m", minimum=0)
        if beyond and self.margin is None:
            raise InputError(f"beyond is {beyond:g} m, but the whole box is kept; state a margin, too")
        put(self, spacing=spacing, margin=_margin(self.margin), beyond=beyond)


@record
class Rig:
    """Captures like real ones, made by the virtual rig.

    The conditions behind "los" hide the objects, and are paired with the line of sight of the same object, unmoved. A
    `margin` lets the aperture reach this far beyond the objects and no further than the world's scan, its default. The
    `scans` are tables that take the place of the world's, one for each scan of an experiment.
    """

    conditions: tuple[str, ...] = ("los",)  # of `CONDITIONS`, "los" first
    backgrounds: tuple[str, ...] = ("tripod",)
    keep: str = "raw"  # the published raw files; "captures": frames and poses in HDF5 in their place; "images": neither
    empty: tuple[str, ...] = ("24_ghz",)  # radars of which the empty scene is captured; of "24_ghz" it is subtracted
    margin: float | None = None  # [m]
    image: Voxels = field(default_factory=Voxels)
    covers: Covers | None = None  # None: the world's carton and cloth, the same for all
    world: Mapping[str, Any] = field(default_factory=dict)  # tables of WORLD.toml; the cloth has four layers by default
    scans: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        if not self.conditions or self.conditions[0] != "los":
            raise InputError(f"conditions are {list(self.conditions)}; expected the line of sight, 'los', as the first")
        _check_all("condition", self.conditions, CONDITIONS)
        for name in ("conditions", "backgrounds", "empty"):
            _check_once(getattr(self, name), name)
        _check_names(self.backgrounds, "background", BACKGROUNDS)
        _check_all("radar", self.empty, RADARS)
        check_known("keep", self.keep, KEEPS)
        put(self, margin=_margin(self.margin))

    @property
    def hidden(self) -> tuple[str, ...]:
        """The conditions of one object in one pose that hide it, each as often as it is made."""
        return tuple(c for c in self.conditions[1:] for _ in range(self._made(c)))

    @property
    def hidden_count(self) -> int:
        """How many these are."""
        return sum(self._made(c) for c in self.conditions[1:])

    def _made(self, condition: str) -> int:
        return self.covers.cartons if self.covers is not None and "carton" in condition else 1


@record
class Simulator:
    """Images by the paper's simulator, for training."""

    radars: tuple[str, ...] = RADARS
    models: tuple[str, ...] = ("specular", "edge")  # of `SCATTERING_MODELS`
    vertices: int = 10_000  # to which the meshes are resampled
    size: tuple[float, float] = (0.222, 0.55)  # of the aperture along x and y [m]
    margin: float | None = None  # as of `Rig`; None: the aperture is of `size` [m]
    step: float = 0.25  # between positions [wavelengths at the start of the band]
    height: float = 0.2  # of the aperture over the object's middle [m]
    tau_deg: float = 5.0  # of "specular", see `simulate`
    edge_deg: float = 20.0  # of "edge"; other models have their defaults
    image: Voxels = field(default_factory=Voxels)

    def __post_init__(self) -> None:
        for kind, name, known in (("radar", "radars", RADARS), ("model", "models", SCATTERING_MODELS.names())):
            _check_names(getattr(self, name), kind, known)
            _check_once(getattr(self, name), name)
        put(
            self,
            vertices=checked_integer(self.vertices, name="vertices", minimum=4),
            size=checked_numbers(self.size, name="size", count=2, unit="m", above=0),
            step=checked_number(self.step, name="step", unit="wavelengths", above=0),
            height=checked_number(self.height, name="height", unit="m", above=0),
            tau_deg=checked_number(self.tau_deg, name="tau_deg", unit="deg", above=0),
            edge_deg=checked_number(self.edge_deg, name="edge_deg", unit="deg", above=0),
            margin=_margin(self.margin),
        )


@record
class Shares:
    """Shares of objects, and of their poses, for training, validation and test."""

    train: float = 0.7
    val: float = 0.15
    test: float = 0.15

    def __post_init__(self) -> None:
        for name in ("train", "val", "test"):
            put(self, **{name: checked_number(getattr(self, name), name=name, minimum=0)})
        if not abs(self.train + self.val + self.test - 1) < 1e-9:
            raise InputError(
                f"train, val and test are {self.train:g}, {self.val:g}, {self.test:g}; expected a sum of 1"
            )


@record
class Recipe:
    """Contents of a dataset to generate.

    Attributes
    ----------
    name : of the dataset
    about : what it is for
    seed : of everything random; the same gives the same bytes
    objects, files, scenes : what is looked at
    poses : how objects lie
    rig, simulator : captures like real ones, images for training; one of them, or both
    splits : shares of training, validation and test
    folder : where relative paths start
    source : what messages call the recipe
    """

    name: str
    about: str = ""
    seed: int = 0
    objects: Objects = field(default_factory=Objects)
    files: tuple[MeshFile, ...] = ()
    scenes: tuple[SceneRecipe, ...] = ()
    poses: PoseSettings = field(default_factory=PoseSettings)
    rig: Rig | None = None
    simulator: Simulator | None = None
    splits: Shares = field(default_factory=Shares)
    folder: str = field(default=".", metadata={"key": None})
    source: str = field(default="recipe", metadata={"key": None})

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip() or len(self.name) > _LONGEST_NAME:
            raise InputError(
                f"name is {quoted(self.name)}; expected a name for the dataset, of {_LONGEST_NAME} characters at most"
            )
        if self.name.startswith(".") or any(mark in self.name for mark in "/\\\0"):
            raise InputError(
                f"name is {quoted(self.name)}; expected the name of a folder, without slashes and no dot first"
            )
        put(self, seed=checked_integer(self.seed, name="seed", minimum=0))
        if not self.objects.chosen and not self.files and not self.scenes:
            raise InputError(
                "the recipe has no object; list some in [objects], by names, categories or classes, or all = true; or "
                "add [[files]] or [[scenes]]"
            )
        if self.rig is None and self.simulator is None:
            raise InputError("nothing to generate; add [rig] for realistic captures, [simulator] for training images")
        own = [file.name for file in self.files]
        for name in own:
            if own.count(name) > 1 or name in CATALOGUE:
                raise InputError(f"files: two objects would be called {name!r}; rename one of the mesh files")
        for i, scene in enumerate(self.scenes):
            for j, placed in enumerate(scene.objects):
                if placed.object not in own:
                    try:
                        catalogue_name(placed.object)
                    except UnknownNameError as error:
                        raise InputError(f"scenes[{i}].objects[{j}]: {error}") from error


def read_recipe(path: str | os.PathLike[str]) -> Recipe:
    """Read a recipe from a TOML file; relative paths in it start at its folder.

    Raises
    ------
    FormatError
        The file is no TOML, or holds a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    table = read_toml(path, "a recipe")
    return recipe_from_table(table, folder=str(Path(path).parent), source=printable(path))


def recipe_from_table(table: Mapping[str, Any], *, folder: str = ".", source: str = "recipe") -> Recipe:
    """The recipe that a table describes, as RECIPE.toml does.

    Parameters
    ----------
    table : keys as in RECIPE.toml
    folder : where relative paths start
    source : name of the table for messages

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    return record_from_table(Recipe, table, source, folder=folder, source=source)


def _margin(value: float | None) -> float | None:
    return None if value is None else checked_number(value, name="margin", unit="m", minimum=0)


def _angles(value: Any, name: str) -> tuple[int, int, int]:
    x, y, z = (checked_integer(angle, name=name, minimum=-360) for angle in checked_numbers(value, name=name, count=3))
    return x, y, z


def _range(value: Any, name: str) -> tuple[int, int]:
    low, high = (checked_integer(end, name=name, minimum=-360) for end in checked_numbers(value, name=name, count=2))
    if high < low or high > 360:
        raise InputError(f"{name} is [{low}, {high}]; expected a range of whole degrees, the smaller first, up to 360")
    return low, high


def _check_names(names: tuple[str, ...], kind: str, known: tuple[str, ...]) -> None:
    if not names:
        raise InputError(f"no {kind} is named; expected at least one of {', '.join(known)}")
    _check_all(kind, names, known)


def _check_all(kind: str, names: tuple[str, ...], known: Collection[str]) -> None:
    for name in names:
        check_known(kind, name, known)


def _check_once(names: tuple[str, ...], name: str) -> None:
    if len(set(names)) < len(names):
        raise InputError(f"{name} are {list(names)}; name each once")
