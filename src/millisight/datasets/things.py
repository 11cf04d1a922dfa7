"""The objects of a recipe: built by the catalogue, scanned, or one's own; each with its mesh in the dataset's folder."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from millisight.datasets.manifest import checksum
from millisight.datasets.recipe import MeshFile, Recipe, catalogue_name
from millisight.errors import FileError, MillisightError
from millisight.files import atomic_path, make_folder, printable
from millisight.scene.load import load_mesh
from millisight.scene.mesh import TriangleMesh
from millisight.scene.objects import CATALOGUE, build_object, find_scans

MESH_NAME = "nontextured.stl"
"""Of an object's mesh in the published layout; here in metres, turned as at the angles 0, 0, 0, its middle at 0."""

_COMPARED = 1500  # points on either surface
_ALIKE = 1e-9  # squared distances that differ by less are the same [m²]


class Thing(NamedTuple):
    """An object as a dataset holds it.

    Attributes
    ----------
    name : of the catalogue, or of its file
    folder : `<id>_<name>` in the dataset
    shape_class, category : of the catalogue; "other", "own" of a file
    source : "built" by the catalogue, "scan" of the real one, or "file"
    sha256 : of its mesh file `folder`/nontextured.stl
    material : all of it; "" for a built one, whose parts have theirs
    vertices : (V, 3) of that mesh [m]
    """

    name: str
    folder: str
    shape_class: str
    category: str
    source: str
    sha256: str
    material: str
    vertices: np.ndarray

    @property
    def mesh(self) -> str:
        """Of its mesh file, relative to the dataset."""
        return f"{self.folder}/{MESH_NAME}"


def prepare(
    recipe: Recipe,
    out: Path,
    *,
    meshes: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Thing]:
    """Write the meshes of all objects of a recipe into the dataset `out`; by name.

    Parameters
    ----------
    meshes : folder of real scans, which take the places of the shapes that the catalogue builds
    progress : called with (objects done, objects in all)

    Raises
    ------
    FileError, MeshError
        A mesh cannot be read, or the folder holds no scan; the message names it.
    """
    scans = find_scans(meshes) if meshes is not None else {}
    files = {file.name: file for file in recipe.files}
    in_scenes = [placed.object for scene in recipe.scenes for placed in scene.objects]
    wanted = {*recipe.objects.chosen, *(catalogue_name(name) for name in in_scenes if name not in files)}
    names = [*(name for name in CATALOGUE if name in wanted), *files]
    things = {}
    for count, name in enumerate(names, 1):
        if name in files:
            things[name] = _own(files[name], recipe.folder, out)
        else:
            things[name] = _catalogued(name, scans.get(name), out)
        if progress is not None:
            progress(count, len(names))
    return things


def _catalogued(name: str, scan: Path | None, out: Path) -> Thing:
    entry = CATALOGUE[name]
    mesh = build_object(name)
    if scan is not None:
        mesh = lying_like(load_mesh(scan, unit="m"), mesh)
    sha256 = _write(out / entry.ycb_id / MESH_NAME, mesh)
    source, material = ("built", "") if scan is None else ("scan", entry.material)
    return Thing(name, entry.ycb_id, entry.shape_class, entry.category, source, sha256, material, mesh.vertices)


def _own(file: MeshFile, folder: str, out: Path) -> Thing:
    try:
        mesh = load_mesh(Path(folder) / file.path, unit=file.unit)
    except MillisightError as error:
        raise type(error)(f"files: {error}") from error
    mesh = mesh.moved(translation=-mesh.bounds.mean(axis=0))
    name = f"000_{file.name}"
    sha256 = _write(out / name / MESH_NAME, mesh)
    return Thing(file.name, name, file.shape_class, "own", "file", sha256, file.material, mesh.vertices)


def _write(path: Path, mesh: TriangleMesh) -> str:
    """The mesh as binary STL [m]; returns its checksum."""
    from trimesh import Trimesh

    make_folder(path.parent)
    content = Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type="stl")
    if not isinstance(content, bytes):
        raise FileError(f"{printable(path)}: the mesh cannot be written as STL")
    if not path.exists() or path.read_bytes() != content:
        with atomic_path(path) as temporary:
            temporary.write_bytes(content)
    return checksum(path)


def lying_like(scan: TriangleMesh, shape: TriangleMesh) -> TriangleMesh:
    """A scan turned to lie as the catalogue's shape does, the middle of its bounding box at the origin.

    Scans stand as they stood on the scanner. Of the turns that make the edges of the scan's smallest box parallel to
    the axes, that one is taken whose surface is nearest to the shape's: by the mean squared distance of points of
    either from the other.
    """
    from scipy.spatial import KDTree
    from trimesh.bounds import oriented_bounds

    boxed = np.asarray(oriented_bounds(scan.vertices, angle_digits=2)[0])[:3, :3]
    ours = _spread(shape)
    tree = KDTree(ours)
    best, nearest = scan, np.inf
    for turn in _right_angled_turns():
        turned = scan.moved(rotation=turn @ boxed)
        turned = turned.moved(translation=-turned.bounds.mean(axis=0))
        theirs = _spread(turned)
        far = (tree.query(theirs)[0] ** 2).mean() + (KDTree(theirs).query(ours)[0] ** 2).mean()
        if far < nearest - _ALIKE:  # of turns that fit alike, the first
            best, nearest = turned, far
    return best


def _right_angled_turns() -> list[np.ndarray]:
    """The 24 rotations (3, 3) that map the axes onto each other."""
    turns = [
        np.array([[sign * (column == axis) for column in range(3)] for axis, sign in zip(axes, signs, strict=True)])
        for axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2))
        for signs in (
            (1, 1, 1),
            (1, 1, -1),
            (1, -1, 1),
            (1, -1, -1),
            (-1, 1, 1),
            (-1, 1, -1),
            (-1, -1, 1),
            (-1, -1, -1),
        )
    ]
    return [turn.astype(float) for turn in turns if np.linalg.det(turn) > 0]


def _spread(mesh: TriangleMesh) -> np.ndarray:
    """(n, 3) points all over a mesh, the same ones every time."""
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(mesh.face_crosses, axis=1)
    faces = rng.choice(len(areas), _COMPARED, p=areas / areas.sum())
    u, v = rng.random((2, _COMPARED, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = mesh.vertices[mesh.faces[faces]].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a)
