"""The objects of a world, each in its place: turned, stood on the support or hung, and at rest."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from millisight.core import rotation_from_euler_deg
from millisight.core.errors import MillisightError
from millisight.data import TriangleMesh, material_named
from millisight.meshes import ObjectPart, build_parts, load_mesh
from millisight.rig.virtual._world import World, WorldObject


class PlacedObject(NamedTuple):
    """An object in its place: its number in the world, its name, and its parts; it does not move."""

    number: int
    name: str
    parts: tuple[ObjectPart, ...]

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) [m]"""
        return bounds_of(self.parts)


def place_name(world: World, number: int) -> str:
    """How messages call an object: by its place in the file and its name."""
    return f"objects[{number}] ({world.objects[number].name})"


def bounds_of(parts: tuple[ObjectPart, ...]) -> np.ndarray:
    bounds = np.array([part.mesh.bounds for part in parts])
    return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


def place_object(world: World, number: int) -> PlacedObject:
    item = world.objects[number]
    try:
        parts = _parts(item, world.folder)
    except MillisightError as error:
        raise type(error)(f"{place_name(world, number)}: {error}") from error
    if any(item.rotate_deg):
        parts = _moved(parts, rotation=rotation_from_euler_deg(item.rotate_deg))
    lower, upper = bounds_of(parts)
    middle = (lower + upper) / 2
    at = world.scan.middle if item.at is None else item.at
    top = world.support.height
    height = at[2] if len(at) == 3 else top + (upper[2] - lower[2]) / 2
    shift = np.array([at[0], at[1], height]) - middle
    return PlacedObject(number, item.name, _moved(parts, translation=shift))


def _parts(item: WorldObject, folder: str) -> tuple[ObjectPart, ...]:
    """An object's parts as the catalogue or its file gives them."""
    if item.object is not None:
        parts = build_parts(item.object)
    else:
        mesh = load_mesh(Path(folder) / str(item.mesh), unit=item.unit)
        parts = (part_of(item.name, mesh, "metal"),)
    if item.material is None:
        return parts
    return tuple(part_of(part.name, part.mesh, item.material) for part in parts)


def part_of(name: str, mesh: TriangleMesh, material: str) -> ObjectPart:
    return ObjectPart(name=name, mesh=mesh, material=material_named(material))


def _moved(parts: tuple[ObjectPart, ...], **motion: np.ndarray) -> tuple[ObjectPart, ...]:
    return tuple(ObjectPart(name=p.name, mesh=p.mesh.moved(**motion), material=p.material) for p in parts)
