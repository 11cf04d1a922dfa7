"""The objects of a recipe: drawn by the catalogue, scanned, or one's own; each with its mesh in the dataset."""

import hashlib
import logging
import os
from collections.abc import Collection
from itertools import permutations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from millisight.core import atomic_path, check_free, make_folder, printable
from millisight.core.errors import MillisightError
from millisight.data import TriangleMesh
from millisight.datasets._manifest import checksum
from millisight.datasets.generation import MeshFile, Recipe
from millisight.meshes import CATALOGUE, build_object, catalogue_name, find_scans, load_mesh, mesh_of_table

logger = logging.getLogger(__name__)

MESH_NAME = "nontextured.stl"
"""Of an object's mesh in the published layout; here in metres, turned as at the angles 0, 0, 0, its middle at 0."""

_COMPARED = 1500  # points on either surface
_ONE_SIZE = 0.1
"""Share of the longest edge. Of 38 real scans the catalogue's shapes differ by 0.04 and less, the toy airplane by most;
unlike bricks of the set differ from each other by 0.13 and more."""

_ALIKE = 1e-9  # squared distances that differ by less are the same [m²]


class DatasetObject(NamedTuple):
    """An object of a generated dataset.

    Attributes
    ----------
    name : of the catalogue, or of its file
    folder : `<id>_<name>` in the dataset
    shape_class, category : of the catalogue; "other", "own" of a file
    source : "built" by the catalogue, "scan" of the real one, or "file"
    material : all of it; "" for a built one, whose parts have theirs
    mesh : [m]
    sha256 : of its mesh file
    """

    name: str
    folder: str
    shape_class: str
    category: str
    source: str
    material: str
    mesh: TriangleMesh
    sha256: str

    @property
    def path(self) -> str:
        """Of its mesh file, relative to the dataset."""
        return f"{self.folder}/{MESH_NAME}"

    def write(self, root: Path, known: Collection[str] = ()) -> None:
        """Its mesh file into a dataset's folder, where it is not there already.

        Parameters
        ----------
        known : files of the dataset that an earlier run made, which may be overwritten

        Raises
        ------
        FileError
            Somebody else's file is in its place, or it cannot be written.
        """
        path = make_folder(root / self.folder) / MESH_NAME
        if not path.is_file() or checksum(path) != self.sha256:
            if self.path not in known:
                check_free(path)
            with atomic_path(path) as temporary:
                temporary.write_bytes(_stl(self.mesh))


def prepare_objects(recipe: Recipe, *, meshes: str | os.PathLike[str] | None = None) -> dict[str, DatasetObject]:
    """All objects of a recipe, by name.

    Parameters
    ----------
    meshes : folder of real scans, which take the places of the shapes that the catalogue builds

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
    return {
        name: _own(files[name], recipe.folder) if name in files else _catalogued(name, scans.get(name))
        for name in names
    }


def _catalogued(name: str, scan: Path | None) -> DatasetObject:
    entry = CATALOGUE[name]
    mesh = build_object(name)
    if scan is not None:
        mesh = _placed_scan(load_mesh(scan, unit="m"), mesh, f"{printable(scan)}, taken for {entry.ycb_id}")
    source, material = ("built", "") if scan is None else ("scan", entry.material)
    return DatasetObject(name, entry.ycb_id, entry.shape_class, entry.category, source, material, mesh, _sha256(mesh))


def _placed_scan(scan: TriangleMesh, shape: TriangleMesh, name: str) -> TriangleMesh:
    """A scan turned to lie as the catalogue's shape does; one of another size as it stood on the scanner, centred."""
    sizes = [box_of(mesh)[1] for mesh in (scan, shape)]
    if differ_in_size(*sizes):
        measured, expected = (" x ".join(f"{1000 * edge:.1f}" for edge in size) for size in sizes)
        logger.warning(
            "%s, measures %s mm and the catalogue's object %s mm: it may be another object. It is left as it stood on "
            "the scanner, and not turned to lie as the catalogue's does; check the file",
            name, measured, expected,
        )  # fmt: skip
        return scan.moved(translation=-scan.bounds.mean(axis=0))
    return lying_like(scan, shape)


def _own(file: MeshFile, folder: str) -> DatasetObject:
    try:
        mesh = mesh_of_table(Path(folder) / file.path, unit=file.unit)
    except MillisightError as error:
        raise error.at("files") from error
    mesh = mesh.moved(translation=-mesh.bounds.mean(axis=0))
    folder = f"000_{file.name}"
    return DatasetObject(file.name, folder, file.shape_class, "own", "file", file.material, mesh, _sha256(mesh))


def _sha256(mesh: TriangleMesh) -> str:
    return hashlib.sha256(_stl(mesh)).hexdigest()


def _stl(mesh: TriangleMesh) -> bytes:
    """The mesh as binary STL [m]."""
    from trimesh import Trimesh
    from trimesh.exchange.stl import export_stl

    return export_stl(Trimesh(mesh.vertices, mesh.faces, process=False))


def box_of(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """The smallest box around a mesh: the turn (3, 3) that makes its edges parallel to the axes, and their lengths.

    The lengths (3,) [m] are sorted, the shortest first.
    """
    from trimesh.bounds import oriented_bounds

    turn, extent = oriented_bounds(mesh.vertices, angle_digits=2)
    return np.asarray(turn)[:3, :3], np.sort(extent)


def differ_in_size(size: np.ndarray, other: np.ndarray) -> bool:
    """Whether the edges (3,) of two smallest boxes differ by more than `_ONE_SIZE` of the longest edge of both."""
    return bool(np.abs(size - other).max() > _ONE_SIZE * max(size.max(), other.max()))


def lying_like(scan: TriangleMesh, shape: TriangleMesh) -> TriangleMesh:
    """A scan turned to lie as the catalogue's shape does, the middle of its bounding box at the origin.

    Scans stand as they stood on the scanner. Of the turns that make the edges of the scan's smallest box parallel to
    the axes, that one is taken whose surface is nearest to the shape's: by the mean squared distance of points of
    either from the other. Of a scan of another size this says nothing: see `differ_in_size`.
    """
    from scipy.spatial import KDTree

    boxed, _ = box_of(scan)
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
    turns = [np.eye(3)[list(axes)] * signs for axes in permutations(range(3)) for signs in product((1, -1), repeat=3)]
    return [turn for turn in turns if np.linalg.det(turn) > 0]


def _spread(mesh: TriangleMesh) -> np.ndarray:
    """(n, 3) points all over a mesh, the same ones every time."""
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(mesh.face_crosses, axis=1)
    faces = rng.choice(len(areas), _COMPARED, p=areas / areas.sum())
    u, v = rng.random((2, _COMPARED, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = mesh.vertices[mesh.faces[faces]].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a)
