"""Scenes of one object, from a mesh file, a name of the catalogue or a mesh."""

import os
from pathlib import Path
from typing import Any

from millisight.core import checked_numbers, printable, rotation_from_euler_deg
from millisight.core.errors import UnknownNameError
from millisight.data import Material, Scene, SceneObject, TriangleMesh, material_named
from millisight.meshes._catalogue import CATALOGUE, build_object
from millisight.meshes._load import load_mesh
from millisight.meshes._remesh import resample


def scene_from_mesh(
    source: Any,
    *,
    unit: str | None = None,
    vertices: int | None = 10_000,
    center: bool = True,
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    material: str | Material | None = None,
) -> Scene:
    """A scene of one object: see `Scene.from_mesh`."""
    angles = checked_numbers(rotate_deg, name="rotate_deg", count=3, unit="deg")
    name, mesh, catalogued = _resolve(source, unit)
    if any(angles):
        mesh = mesh.moved(rotation=rotation_from_euler_deg(angles))
    if center:
        mesh = mesh.moved(translation=-mesh.bounds.mean(axis=0))
    if vertices is not None:
        mesh = resample(mesh, vertices)
    return Scene(
        objects=(
            SceneObject(name=name, mesh=mesh, material=material_named(catalogued if material is None else material)),
        )
    )


def _resolve(source: Any, unit: str | None) -> tuple[str, TriangleMesh, str | Material]:
    """Name, mesh and default material of what the user pointed to."""
    if isinstance(source, TriangleMesh):
        return "mesh", source, "metal"
    # What has an object's name in this folder, its scans or its images, is no mesh: a mesh has a suffix.
    if isinstance(source, str) and source in CATALOGUE:
        return source, build_object(source), CATALOGUE[source].material_of_whole
    if isinstance(source, str) and not os.path.exists(source) and not os.path.splitext(source)[1]:
        advice = "A mesh file needs its suffix, such as .stl."
        raise UnknownNameError("catalogue object", source, CATALOGUE, advice=advice)
    name = Path(source).stem if isinstance(source, str | os.PathLike) else "mesh"
    return printable(name), load_mesh(source, unit=unit), "metal"
