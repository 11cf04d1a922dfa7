"""Simulated objects to train on, each stored in parts that whole scenes mix anew (`_whole`).

An object of the catalogue, or a shape drawn at random, is turned and placed at random; a plate that it lies on is as
large as a tripod's or a table's. Each answers alone (the plate in the object's shadow), and since imaging is linear, a
weighted sum of their images is the image of a scene with such weights (primer 14). The physics is `simulate`'s point
reflectors and nothing else.
"""

import dataclasses
import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import (
    SPEED_OF_LIGHT,
    check_known,
    checked_integer,
    checked_number,
    printable,
    put,
    record,
)
from millisight.core.errors import DamagedFileError
from millisight.data import Capture, Material, Scene, Trajectory, TriangleMesh, VoxelGrid
from millisight.imaging import combine, form_image
from millisight.meshes import (
    CATALOGUE,
    PUBLISHED_CLASSES,
    RANDOM_SHAPES,
    build_object,
    load_mesh,
    object_name,
    random_shape,
)
from millisight.perception import SPACING
from millisight.perception.training._bands import (
    BANDS,
    DEPTH,
    check_arrays,
    level_of,
    read_parts,
    simulated_radar,
    strayed,
    write_parts,
)
from millisight.perception.training._sources import meshes_in, simulations_in
from millisight.simulation import simulate

SCENE_PARTS = ("specular", "edge", "plate")
"""Of a scene's image: the object's two answers, and what it lies on."""

_STEPS = {"77_ghz": (0.55, 0.85), "24_ghz": (0.4, 0.7)}  # wavelengths between positions
_POSITIONS = 6000
_TALLEST = 0.13  # object that is stood on another side [m]
_UNSEEN = Material(name="unseen", reflection=1e-9)  # what shadows and does not answer

RANDOM_OBJECTS = {f"any_{shape_class}": shape_class for shape_class in RANDOM_SHAPES}
"""Names that scenes take for an object's, and the class of the shapes that they show, or "odd": each scene another."""

HOUSEHOLD_OBJECTS = {f"household_{shape_class}": shape_class for shape_class in PUBLISHED_CLASSES}
"""Such names for household things."""

DRAWN_OBJECTS = RANDOM_OBJECTS | HOUSEHOLD_OBJECTS
"""Such names for all that is drawn at random."""


@record
class SceneSettings:
    """How scenes are made.

    Attributes
    ----------
    without : objects that no scene shows: those that will test
    validation : objects whose scenes judge the training, and are not trained on
    poses : scenes of each object
    vertices : of an object
    positions : of the antennas over an object, at most; over a large one they are further apart
    widest : of an image, which shows a part of a larger object [m]
    stretch : objects are made longer or shorter along each of their axes, by a factor of exp(stretch) at most
    meshes : folder of mesh files, see `find_meshes`; objects of these names are taken from it, and it adds to the
        catalogue's; "": none
    published : dataset in the published layout whose simulated images are scenes as well, see `simulations_in`; "":
        none
    """

    without: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    poses: int = 6
    vertices: int = 3000
    positions: int = _POSITIONS
    widest: float = 0.22
    stretch: float = 0.0
    meshes: str = ""
    published: str = ""

    def __post_init__(self) -> None:
        known = (*CATALOGUE, *meshes_in(self.meshes), *simulations_in(self.published))
        for name in (*self.without, *self.validation):
            check_known("catalogue object", name if name in known else object_name(name), known)
        put(
            self,
            poses=checked_integer(self.poses, name="poses", minimum=0 if self.published else 1),
            vertices=checked_integer(self.vertices, name="vertices", minimum=100),
            positions=checked_integer(self.positions, name="positions", minimum=4),
            widest=checked_number(self.widest, name="widest", unit="m", above=0.05),
            stretch=checked_number(self.stretch, name="stretch", minimum=0),
        )

    @property
    def objects(self) -> dict[str, tuple[str, ...]]:
        """Names by "training" and "validation", of the mesh files' and the dataset's too, however they spell them."""
        every = dict.fromkeys((*(self.made if self.poses else ()), *simulations_in(self.published)))
        without, held = ({object_name(name) for name in names} for names in (self.without, self.validation))
        seen = [name for name in every if object_name(name) not in without]
        return {
            "training": tuple(name for name in seen if object_name(name) not in held),
            "validation": tuple(name for name in seen if object_name(name) in held),
        }

    @property
    def made(self) -> tuple[str, ...]:
        """Names of objects that there are meshes of, of which scenes are made."""
        return tuple(dict.fromkeys((*CATALOGUE, *meshes_in(self.meshes))))


class SceneParts(NamedTuple):
    """A scene's images, in parts.

    Attributes
    ----------
    x, y : pixel centres [m]
    inside : (X, Y) bool, where the object lies, seen along z
    angles_deg : (3,) how it lies: turned about the fixed x, then y, then z axis [degrees]
    images : by band the complex64 images (3, X, Y, Z) of `SCENE_PARTS`, each relative to its own maximum, voxels
        `SPACING` apart along x and y and `DEPTH` along z
    scales : by band these maxima (3,)
    level : index along z of the voxels next to the object's top
    """

    x: np.ndarray
    y: np.ndarray
    inside: np.ndarray
    angles_deg: np.ndarray
    images: dict[str, np.ndarray]
    scales: dict[str, np.ndarray]
    level: int


def cached_scene(
    name: str, number: int, settings: SceneSettings, *, seed: int, folder: str | os.PathLike[str]
) -> SceneParts:
    """The scene of this number with this object: read from `folder`, or made and written there.

    It is drawn from the seed, the object's name and the number, and from nothing else.
    """
    path = Path(folder) / f"{name}-{number}-{scene_digest(name, settings, seed)}.npz"
    if not path.exists():
        _write(path, make_scene(name, settings, rng=np.random.default_rng([seed, number, *name.encode()])))
    return _read(path)


def make_scene(name: str, settings: SceneSettings, *, rng: np.random.Generator) -> SceneParts:
    """One scene with this object, drawn from `rng`.

    Raises
    ------
    UnknownNameError, InputError
        No such object, or the settings cannot be right.
    """
    target, angles_deg = _object(name, settings, rng)
    bounds = target.mesh.bounds
    plate = _plate(bounds, rng) if rng.random() < 0.65 else None
    lower, upper = _window(bounds, settings.widest, rng)
    middle = (lower + upper)[:2] / 2 + rng.uniform(-0.015, 0.015, 2)
    size = (upper - lower)[:2] + rng.uniform(-0.01, 0.05, 2)
    grid = VoxelGrid.regular(lower, upper, (SPACING, SPACING, DEPTH))
    stray = rng.uniform(0, 0.00015)  # of a row of the arm's, unknown to the imager [m]
    images, scales = {}, {}
    for band in BANDS:
        radar = simulated_radar(band)
        step = rng.uniform(*_STEPS[band]) * SPEED_OF_LIGHT / radar.waveform.start_frequency
        step = max(step, float(np.sqrt(size.prod() / settings.positions)))
        trajectory = Trajectory.raster(size=(size[0], size[1]), step=step, center=(middle[0], middle[1], 0.0))
        believed = strayed(trajectory, stray, rng)
        captures: list[Capture | None] = [
            simulate(target, radar, trajectory, model=model) for model in ("specular", "edge")
        ]
        if plate is None:
            captures.append(None)
        else:
            seen = _answering(target, _UNSEEN) + plate
            specular, edge = (simulate(seen, radar, trajectory, model=model) for model in ("specular", "edge"))
            captures.append(combine(specular, edge, (1.0, rng.uniform(0.1, 0.5))))
        values = np.stack([_image(capture, believed, grid) for capture in captures])
        peaks = abs(values).max(axis=(1, 2, 3))
        images[band], scales[band] = values / np.where(peaks > 0, peaks, 1)[:, None, None, None], peaks
    inside, level = footprint(target.mesh, grid.x, grid.y), int(abs(grid.z - bounds[1, 2]).argmin())
    return SceneParts(grid.x, grid.y, inside, np.array(angles_deg), images, scales, level)


def footprint(mesh: TriangleMesh, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(X, Y) bool, over which pixels centred at x (X,) and y (Y,) [m] a mesh lies, seen along z."""
    from trimesh import Trimesh

    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    # A ray along an edge of two faces may miss both: few lie so once they are a little off round numbers.
    above = np.column_stack([places + np.array([1.3e-6, 0.7e-6]), np.full(len(places), mesh.bounds[1, 2] + 0.1)])
    down = np.broadcast_to([0.0, 0.0, -1.0], above.shape)
    return Trimesh(mesh.vertices, mesh.faces, process=False).ray.intersects_any(above, down).reshape(len(x), len(y))


def _object(name: str, settings: SceneSettings, rng: np.random.Generator) -> tuple[Scene, tuple[float, float, float]]:
    """The object, mostly as it lies in the catalogue and a little tilted, sometimes on another side; and its angles."""
    source: str | TriangleMesh = name
    if name in DRAWN_OBJECTS:
        source = random_shape(DRAWN_OBJECTS[name], rng, household=name in HOUSEHOLD_OBJECTS)
    elif settings.stretch or name in meshes_in(settings.meshes):
        held = meshes_in(settings.meshes).get(name)
        mesh = build_object(name) if held is None else load_mesh(held)
        factors = np.exp(rng.uniform(-settings.stretch, settings.stretch, 3))
        source = dataclasses.replace(mesh, vertices=mesh.vertices * factors)
    tilt, turn, side = rng.uniform(-12, 12, 2), rng.uniform(0, 360), 90 * rng.integers(0, 4, 2)
    angles = float(tilt[0]), float(tilt[1]), float(turn)
    target = Scene.from_mesh(source, vertices=settings.vertices, rotate_deg=angles)
    if rng.random() < 0.25:
        turned = angles[0] + int(side[0]), angles[1] + int(side[1]), angles[2]
        other = Scene.from_mesh(source, vertices=settings.vertices, rotate_deg=turned)
        if other.mesh.extent[2] < _TALLEST:
            target, angles = other, turned
    half = target.mesh.extent[2] / 2
    return target.moved((0.0, 0.0, -max(rng.uniform(0.20, 0.33), half + 0.12))), angles


def _window(bounds: np.ndarray, widest: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,) of the image of an object with these bounds (2, 3)."""
    reach = rng.uniform((0.03, 0.03, 0.03), (0.07, 0.07, 0.06))
    lower, upper = bounds[0] - reach, bounds[1] + reach
    beyond = np.maximum(upper - lower - (widest, widest, 1.0), 0)
    cut = rng.random(3) * beyond
    return lower + cut, upper - (beyond - cut)


def _plate(bounds: np.ndarray, rng: np.random.Generator) -> Scene:
    """The plate under an object with these bounds (2, 3): smaller than it, or larger."""
    lower, upper = bounds
    sides = rng.uniform(0.05, 0.14, 2) if rng.random() < 0.6 else rng.uniform(0.12, 0.4, 2)
    if rng.random() < 0.5:
        sides[1] = sides[0]
    thick = rng.uniform(0.003, 0.02)
    place = (*(lower + upper)[:2] / 2 + rng.normal(0, 0.015, 2), lower[2] - thick / 2 - rng.uniform(0.0005, 0.006))
    return _slab((*sides, thick), place, (0.0, 0.0, rng.choice([0.0, rng.uniform(0, 90)])))


def _slab(extents: Sequence[float], place: Sequence[float], turned_deg: Sequence[float]) -> Scene:
    """A slab, its vertices close enough that only its specular answer, within 5 degrees, is smooth."""
    from trimesh.creation import box

    mesh: Any = box(extents).subdivide_to_size(0.009)
    angles = (turned_deg[0], turned_deg[1], turned_deg[2])
    return Scene.from_mesh(
        TriangleMesh(vertices=mesh.vertices, faces=mesh.faces), vertices=None, rotate_deg=angles, material="metal"
    ).moved(place)


def _answering(scene: Scene, material: Material) -> Scene:
    return Scene(objects=tuple(dataclasses.replace(target, material=material) for target in scene.objects))


def _image(capture: Capture | None, believed: Trajectory, grid: VoxelGrid) -> np.ndarray:
    if capture is None:
        return np.zeros(grid.shape, np.complex64)
    return form_image(dataclasses.replace(capture, trajectory=believed), grid, method="backprojection").values


def scene_digest(name: str, settings: SceneSettings, seed: int) -> str:
    """What a simulated object is made of, as 12 hexadecimal digits."""
    made_by = {"seed": seed} | {name: getattr(settings, name) for name in ("vertices", "widest", "stretch")}
    if settings.positions != _POSITIONS:
        made_by["positions"] = settings.positions
    mesh = meshes_in(settings.meshes).get(name)
    if mesh is not None:
        made_by["mesh"] = hashlib.sha256(mesh.read_bytes()).hexdigest()
    return hashlib.sha256(json.dumps(made_by, sort_keys=True).encode()).hexdigest()[:12]


def _write(path: Path, scene: SceneParts) -> None:
    scales = {f"{band}_scales": scene.scales[band] for band in BANDS}
    write_parts(
        path, scene.images, x=scene.x, y=scene.y, inside=scene.inside, angles_deg=scene.angles_deg,
        level=np.array(scene.level), **scales,
    )  # fmt: skip


def _read(path: Path) -> SceneParts:
    of_bands = [f"{band}_scales" for band in BANDS]
    images, held = read_parts(path, "x", "y", "inside", "angles_deg", "level", *of_bands)
    scales = {band: held[f"{band}_scales"] for band in BANDS}
    inside, shape, parts = held["inside"], images[BANDS[0]].shape, len(SCENE_PARTS)
    if len(shape) != 4 or any(values.shape != (parts, *inside.shape, shape[3]) for values in images.values()):
        raise DamagedFileError(f"{printable(path)}: its images and its mask differ in size; delete it")
    expected: dict[str, tuple[type, tuple[int, ...]]]
    expected = {"x": (np.floating, shape[1:2]), "y": (np.floating, shape[2:3]), "inside": (np.bool_, shape[1:3])}
    expected |= {"angles_deg": (np.floating, (3,)), **dict.fromkeys(of_bands, (np.floating, (parts,)))}
    check_arrays(path, held, expected)
    return SceneParts(held["x"], held["y"], inside, held["angles_deg"], images, scales, level_of(path, held, images))
