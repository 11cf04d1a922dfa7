"""Images of one object by the paper's simulator, as a job."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, make_folder, record
from millisight.core.errors import CoverageError, InputError
from millisight.data import Radar, Scene, Trajectory, VoxelGrid
from millisight.datasets.generation._cost import Cost, simulator_cost
from millisight.datasets.generation._recipe import Simulator
from millisight.datasets.generation._rig_job import cut_grid, with_provenance, write_masks
from millisight.imaging import form_image
from millisight.io.mito import TRUTH, radar_folder, write_published
from millisight.meshes import ObjectPart
from millisight.rig.virtual import PlacedObject, World, WorldLayout
from millisight.simulation import simulate

PHYSICS = "simulator of the paper: point reflectors"

_PRESETS = {"77_ghz": "mito-sim-77ghz", "24_ghz": "mito-sim-24ghz"}
_ENDS = 0.05  # of the aperture along y that the published simulated images leave out [m]
_BELOW, _ABOVE = 0.17, 0.05  # the published images reach so far under and over the object's middle [m]


class Seen(NamedTuple):
    """An object before the simulator."""

    name: str  # of the catalogue, or of its file
    mesh: str  # its file, relative to the dataset; "" for the catalogue's shape
    material: str  # of a mesh file
    angles_deg: tuple[int, int, int]  # about the fixed x, then y, then z axis
    offset: tuple[float, float]  # x and y of its middle from the aperture's [m]


def image_suffix(model: str) -> str:
    """What the names of the images by a scattering model end with, as published: "_specular", "_edges"."""
    return "_edges" if model == "edge" else f"_{model}"


@record
class SimulatorJob:
    """Simulated images of a scene by one radar, one image a model."""

    folder: str  # of the simulation, relative to the dataset
    radar: str  # "77_ghz" or "24_ghz"
    objects: tuple[Seen, ...]
    settings: Simulator
    sources: Mapping[str, str]  # checksums of the mesh files, by their paths relative to the dataset

    @property
    def key(self) -> str:
        """A name of its own among the jobs of a recipe."""
        return f"{self.folder}/{self.radar}"

    @property
    def truth(self) -> str:
        """Where the job's description goes, relative to the dataset."""
        return f"{TRUTH}/{self.key}"

    @property
    def folders(self) -> tuple[str, ...]:
        """Where all that this job makes lies, relative to the dataset."""
        return self.folder, self.truth

    @property
    def inputs(self) -> tuple[str, ...]:
        """The files of the dataset that it reads, relative to it: meshes."""
        return tuple(self.sources)

    def description(self) -> dict[str, Any]:
        """All that the job's files follow from, as JSON holds it."""
        settings = dataclasses.asdict(self.settings)
        del settings["radars"]
        return {
            "folder": self.folder,
            "radar": self.radar,
            "objects": [seen._asdict() for seen in self.objects],
            "settings": json.loads(json.dumps(settings)),
            "meshes": dict(self.sources),
        }

    def check(self, root: Path) -> Cost:
        """What it will cost; an error if the aperture does not cover the objects, or these reach up to it."""
        scene = self._scene(root, vertices=None)
        lower, upper = scene.mesh.bounds
        trajectory = self._trajectory(scene)
        names = ", ".join(seen.name for seen in self.objects)
        for axis, wide, covered in zip("xy", upper - lower, self.settings.size, strict=False):
            if wide > covered:
                raise CoverageError(
                    f"{names}: {wide * 100:.1f} cm wide along {axis}, the aperture only {covered * 100:.1f} cm; "
                    "enlarge simulator.size, or rotate it with angles_deg"
                )
        if upper[2] > -0.01:
            raise InputError(
                f"{names}: reaches {(upper[2] - lower[2]) * 50:.1f} cm above its middle, the aperture hangs "
                f"{self.settings.height * 100:.1f} cm above that; raise simulator.height, or rotate it with angles_deg"
            )
        return simulator_cost(scene, trajectory, self._grid(scene), self.settings)

    def make(self, root: Path, to: Path, made_by: Mapping[str, Any]) -> None:
        """Write its files under `to`, each at its place relative to the dataset `root`."""
        settings = self.settings
        scene = self._scene(root, vertices=settings.vertices)
        radar, trajectory, grid = Radar.preset(_PRESETS[self.radar]), self._trajectory(scene), self._grid(scene)
        stage = _staged(scene)
        folder = make_folder(radar_folder(to / self.folder, self.radar, processed=True))
        for model in settings.models:
            capture = simulate(
                scene, radar, trajectory, model=model, tau_deg=settings.tau_deg, edge_deg=settings.edge_deg
            )
            image = form_image(with_provenance(capture, made_by), grid)
            write_published(folder / f"processed_image{image_suffix(model)}.pkl", image, made_by)
            write_masks(folder, image_suffix(model), stage, grid.xy, made_by)

    @property
    def _middle(self) -> np.ndarray:
        """(3,) of the objects [m]; the aperture lies at z = 0 and begins at x = y = 0, as the published one."""
        return np.array([*np.divide(self.settings.size, 2), -self.settings.height])

    def _scene(self, root: Path, *, vertices: int | None) -> Scene:
        scenes = []
        for seen in self.objects:
            scene = Scene.from_mesh(
                root / seen.mesh if seen.mesh else seen.name, unit="m" if seen.mesh else None,
                rotate_deg=seen.angles_deg, vertices=vertices, material=seen.material or None,
            )  # fmt: skip
            scenes.append(scene.moved(self._middle + np.array([*seen.offset, 0.0])))
        return Scene(objects=tuple(thing for scene in scenes for thing in scene.objects))

    def _trajectory(self, scene: Scene) -> Trajectory:
        size = np.array(self.settings.size)
        if self.settings.margin is not None:
            size = np.minimum(size, cover(scene.mesh.bounds[:, :2], self._middle[:2], self.settings.margin))
        step = self.settings.step * SPEED_OF_LIGHT / Radar.preset(_PRESETS[self.radar]).waveform.start_frequency
        return Trajectory.raster(size=(size[0], size[1]), step=step, center=(*self._middle[:2], 0.0))

    def _grid(self, scene: Scene) -> VoxelGrid:
        x, y = self.settings.size
        depth = self._middle[2]
        lower, upper = (0.0, _ENDS, depth - _BELOW), (x, y - _ENDS, depth + _ABOVE)
        bounds = scene.mesh.bounds
        return cut_grid(lower, upper, self.settings.image, (bounds[0], bounds[1]))


def cover(bounds: np.ndarray, middle: np.ndarray, margin: float) -> np.ndarray:
    """(2,) size of an aperture about `middle` that reaches `margin` beyond `bounds` (2, 2), in whole 5 mm [m]."""
    reach = np.abs(bounds - middle).max(axis=0) + margin
    return np.ceil(2 * reach / 0.005 - 1e-6) * 0.005


def _staged(scene: Scene) -> WorldLayout:
    """The scene's objects as a stage, for their footprints."""
    things = [
        PlacedObject(i, thing.name, (ObjectPart(name="whole", mesh=thing.mesh, material=thing.material),))
        for i, thing in enumerate(scene.objects)
    ]
    return WorldLayout(World(), tuple(things), (), ())
