"""A virtual world as a record: what stands where, and how well the devices work. `build_layout` builds and checks it.

All places are in the radar frame: the arm moves at about z = 0, what it looks at lies below. The published files
speak the robot's base frame, of which `BASE_ORIGIN` is the origin of the radar frame.
"""

import os
from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import (
    check_known,
    checked_integer,
    checked_items,
    checked_number,
    checked_numbers,
    checked_record,
    printable,
    put,
    quoted,
    read_toml,
    record,
    record_from_table,
    toml_of,
    write_text,
)
from millisight.core.errors import InputError
from millisight.data import LAYERED, Layer, material_named
from millisight.meshes import CATALOGUE
from millisight.rig import ScanSettings as ScanSettings
from millisight.rig.virtual._settings import ArmSettings, CameraSettings, RadarSettings

_TOPS = {"tripod": -0.30, "styrofoam": -0.48}
_MOST = 100  # objects, walls, layers of cloth
_STEEPEST = 20.0  # lid [degrees]
_THICKEST = 0.05  # wall of a carton [m]


@record
class WorldObject:
    """An object of the scene.

    Attributes
    ----------
    object : a name of the catalogue; or None, with
    mesh : a mesh file
    at : x and y of the middle of its bounding box, and it stands on the support; or x, y and z of the middle [m]
    rotate_deg : about the fixed axes, x first, then y, then z [degrees]
    material : all of it, a name of `MATERIALS`; None: as the catalogue says, of a mesh file metal
    unit : of the mesh file: "m", "cm", "mm" or "in"; None: see `load_mesh`
    """

    object: str | None = None
    mesh: str | None = None
    at: tuple[float, ...] | None = None
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    material: str | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        if (self.object is None) == (self.mesh is None):
            raise InputError("expected either object = a name of the catalogue, or mesh = a file")
        if self.object is not None:
            check_known("catalogue object", self.object, CATALOGUE)
        if self.material is not None:
            material_named(self.material)
        if self.at is not None:
            count = 3 if np.size(self.at) == 3 else 2
            put(self, at=checked_numbers(self.at, name="at", count=count, unit="m"))
        put(self, rotate_deg=checked_numbers(self.rotate_deg, name="rotate_deg", count=3, unit="deg"))

    @property
    def name(self) -> str:
        """Of the catalogue, or of the mesh file without its suffix."""
        return self.object if self.object is not None else Path(str(self.mesh)).stem


@record
class Support:
    """The support under the objects.

    Attributes
    ----------
    kind : "tripod", a nut of plastic on its pole, glued to the object, nothing else below it (the legs stand in
        absorber); "styrofoam", a block of it
    top : height of its upper face [m]; None: -0.30 for the tripod, -0.48 for the styrofoam
    size : of the nut or the block along x and y [m]; None: 0.02 m for the tripod, 0.30 m for the styrofoam
    at : x and y of its middle [m]; None: under the middle of the objects
    """

    kind: str = "tripod"
    top: float | None = None
    size: tuple[float, float] | None = None
    at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_known("support", self.kind, _TOPS)
        size = (0.02, 0.02) if self.kind == "tripod" else (0.30, 0.30)
        put(
            self,
            top=checked_number(self.height, name="top", unit="m"),
            size=checked_numbers(self.size or size, name="size", count=2, unit="m", above=0),
            at=None if self.at is None else checked_numbers(self.at, name="at", count=2, unit="m"),
        )

    @property
    def height(self) -> float:
        """Of its upper face [m]."""
        return float(_TOPS[self.kind] if self.top is None else self.top)


@record
class Carton:
    """A box around everything on the support, open at the bottom.

    Attributes
    ----------
    stack : layers of its walls, a name of `LAYERED`
    thickness : of its walls, 0.05 at most [m], the middle one of an odd number of layers thicker or thinner; None: as
        the stack
    clearance : between the objects and its walls, and its lid [m]
    size : along x, y and z, around the objects' middle [m]; None: so that it fits
    at : x and y of its middle [m]; None: the objects' middle, in an empty scene the aperture's
    lid : whether it is closed above
    turn_deg : by how much it is turned about z, counterclockwise as seen from above; its `size` and the tilt of its lid
        are along its own x and y [degrees]
    tilt_deg : how far the lid rises along x and along y, about its middle; it never gets closer than `clearance`
        [degrees]
    """

    stack: str = "carton"
    thickness: float | None = None
    clearance: float = 0.02
    size: tuple[float, float, float] | None = None
    at: tuple[float, float] | None = None
    lid: bool = True
    turn_deg: float = 0.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        _check_stack(self.stack)
        checked_record(self.lid, bool, name="lid")
        tilt = checked_numbers(self.tilt_deg, name="tilt_deg", count=2, unit="degrees")
        if not max(abs(tilt[0]), abs(tilt[1])) <= _STEEPEST:
            raise InputError(f"tilt_deg is {list(tilt)}; expected {_STEEPEST:g} degrees at most")
        put(
            self,
            clearance=checked_number(self.clearance, name="clearance", unit="m", minimum=0),
            turn_deg=checked_number(self.turn_deg, name="turn_deg", unit="degrees"),
            tilt_deg=tilt,
        )
        if self.size is not None:
            put(self, size=checked_numbers(self.size, name="size", count=3, unit="m", above=0))
        if self.at is not None:
            put(self, at=checked_numbers(self.at, name="at", count=2, unit="m"))
        if self.thickness is not None:
            put(self, thickness=checked_number(self.thickness, name="thickness", unit="m", above=0))
            if self.thickness > _THICKEST:
                raise InputError(
                    f"thickness is {self.thickness:g} m; expected {_THICKEST:g} m at most: carton is 0.003"
                )
        _ = self.layers

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Of its walls, from outside to inside.

        Raises
        ------
        InputError
            There is no single middle layer, or the outer ones are thicker than the walls.
        """
        layers = LAYERED[self.stack]
        if self.thickness is None:
            return layers
        middle = len(layers) // 2
        rest = sum(layer.thickness for layer in layers) - layers[middle].thickness
        if len(layers) % 2 == 0 or not self.thickness > rest:
            raise InputError(
                f"thickness is {self.thickness:g} m; expected more than {rest:g} m, which the outer layers of "
                f"{self.stack!r} have, and a stack of an odd number of layers"
            )
        return (*layers[:middle], Layer(layers[middle].material, self.thickness - rest), *layers[middle + 1 :])


@record
class Cloth:
    """Flat layers of cloth over everything else.

    Attributes
    ----------
    stack : one layer of it, a name of `LAYERED`
    layers : how many, one above the other
    gap : from what lies below to the first layer, and from layer to layer [m]
    overhang : how far it reaches over the sides of what it covers [m]
    """

    stack: str = "cloth"
    layers: int = 1
    gap: float = 0.002
    overhang: float = 0.02

    def __post_init__(self) -> None:
        _check_stack(self.stack)
        if checked_integer(self.layers, name="layers") > _MOST:
            raise InputError(f"layers is {self.layers}; expected {_MOST} at most")
        put(
            self,
            layers=int(self.layers),
            gap=checked_number(self.gap, name="gap", unit="m", above=0),
            overhang=checked_number(self.overhang, name="overhang", unit="m", minimum=0),
        )


@record
class Wall:
    """A block, such as a wall, a board or a table.

    Attributes
    ----------
    lower, upper : its corners [m]
    material : a name of `MATERIALS`
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    material: str = "wood"

    def __post_init__(self) -> None:
        lower = checked_numbers(self.lower, name="lower", count=3, unit="m")
        upper = checked_numbers(self.upper, name="upper", count=3, unit="m")
        if not (np.subtract(upper, lower) > 0).all():
            raise InputError(f"the wall runs from {lower} to {upper} m; expected upper > lower in x, y and z")
        material_named(self.material)
        put(self, lower=lower, upper=upper)


@record
class OpticsSettings:
    """Which parts of the radar's physics are computed besides single reflections: see `optics`.

    Attributes
    ----------
    edges : diffraction at edges
    bounces : 2 with double reflections, or 1, which is two to four times as fast
    """

    edges: bool = True
    bounces: int = 2

    def __post_init__(self) -> None:
        checked_record(self.edges, bool, name="edges")
        put(self, bounces=checked_integer(self.bounces, name="bounces"))
        if self.bounces > 2:
            raise InputError(f"bounces is {self.bounces}; expected 1 or 2")


@record
class World:
    """A virtual world; one seed gives the same bytes.

    Attributes
    ----------
    seed : of everything random
    objects : what is looked at; none: the empty scene, as background subtraction needs it
    support, carton, cloth, walls : what stands around them; no carton and no cloth: line of sight
    scan, arm, radars, camera, optics : how it is looked at
    folder : where relative paths of mesh files start

    Raises
    ------
    InputError, UnknownNameError
        A value cannot be right. Whether things fit each other is found by `build_layout`.
    """

    seed: int = 0
    objects: tuple[WorldObject, ...] = ()
    support: Support = field(default_factory=Support)
    carton: Carton | None = None
    cloth: Cloth | None = None
    walls: tuple[Wall, ...] = ()
    scan: ScanSettings = field(default_factory=ScanSettings)
    arm: ArmSettings = field(default_factory=ArmSettings)
    radars: tuple[RadarSettings, ...] = (RadarSettings(),)
    camera: CameraSettings = field(default_factory=CameraSettings)
    optics: OpticsSettings = field(default_factory=OpticsSettings)
    folder: str = field(default=".", metadata={"key": None})

    def __post_init__(self) -> None:
        radars = checked_items(self.radars, RadarSettings, name="a radar")
        for name in ("objects", "walls"):
            if len(getattr(self, name)) > _MOST:
                raise InputError(f"{name} has {len(getattr(self, name))} entries; expected {_MOST} at most")
        names = [radar.name for radar in radars]
        if not radars or len(set(names)) < len(names):
            raise InputError(f"the radars' files go to {quoted(names)}; expected one radar, or one of each band")
        put(
            self,
            seed=checked_integer(self.seed, name="seed", minimum=0),
            objects=checked_items(self.objects, WorldObject, name="an object"),
            walls=checked_items(self.walls, Wall, name="a wall"),
            radars=radars,
        )
        for name, kind in (
            ("support", Support),
            ("scan", ScanSettings),
            ("arm", ArmSettings),
            ("camera", CameraSettings),
        ):
            checked_record(getattr(self, name), kind, name=name)

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> "World":
        """The world that a TOML file describes.

        Raises
        ------
        FormatError
            The file is no TOML, or holds a key or a value that cannot be right; the message names the place.
        FileError
            It cannot be read.
        """
        table = read_toml(path, "a world")
        return cls.from_table(table, folder=str(Path(path).parent), source=printable(path))

    @classmethod
    def from_table(cls, table: Mapping[str, Any], *, folder: str = ".", source: str = "world") -> "World":
        """The world that a TOML table describes, such as one within a recipe.

        Parameters
        ----------
        table : keys as in WORLD.toml
        folder : where relative paths of mesh files start
        source : name of the table for messages

        Raises
        ------
        FormatError
            A key or a value cannot be right; the message names the place.
        """
        return record_from_table(cls, table, source, folder=folder)

    def to_toml(self, path: str | os.PathLike[str]) -> None:
        """Write the TOML file from which `from_toml` reads this world; mesh files are called as they are here.

        Raises
        ------
        FileError
        """
        write_text(path, toml_of(self))

    def seen_from(self, folder: str | os.PathLike[str]) -> "World":
        """The same world with its mesh files called as from another folder, for a file of it there."""
        objects = tuple(
            replace(item, mesh=os.path.relpath(os.path.join(self.folder, item.mesh), folder)) if item.mesh else item
            for item in self.objects
        )
        return replace(self, objects=objects, folder=os.fspath(folder))

    @property
    def sight(self) -> str:
        """ "los", or "nlos" where something hides the objects."""
        return "los" if self.carton is None and self.cloth is None else "nlos"

    def rng(self, *key: int) -> np.random.Generator:
        """The generator of one device, by a key of its own."""
        return np.random.default_rng([self.seed, *key])


def _check_stack(name: Any) -> None:
    check_known("stack of layers", name, LAYERED)
