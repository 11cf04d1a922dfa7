"""Scenes of a dataset in the published layout, joined for evaluation: images, camera, and true masks."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, read_toml, record, rotation_from_quaternion
from millisight.core.errors import FileError, InputError
from millisight.data import CameraFrame, CameraMask, Mask, SarImage
from millisight.datasets._dataset import Dataset, Experiment, Item, expect, read_item
from millisight.datasets._manifest import read_manifest
from millisight.evaluation import (
    HIGH,
    LOW,
    CameraView,
    LabelledScene,
    Origin,
    SceneSource,
    camera_truth,
    published_radar_from_camera,
    radar_from_camera,
)
from millisight.imaging import crop_slices
from millisight.io import load, load_extras, mito
from millisight.meshes import CATALOGUE

TRUTHS = ("camera", "exact")
TRANSFORMS = ("file", "published")
_RADARS = {LOW: "24_ghz", HIGH: "77_ghz"}
_SUPPORTS = {"tripod": -0.30}  # height of what the object stands on [m]; of anything else:
_BLOCK = -0.48
_MARGIN = 0.004  # above the support, what belongs to the object [m]


@record
class SceneFiles(SceneSource):
    """The files of a scene; they are read when asked for. What `SceneSource` has, and

    Attributes
    ----------
    images : by "24 GHz" and "77 GHz"
    masks : likewise, the masks on the images' pixels
    camera_mask : of the same object in line of sight; None: there is none
    camera_number : N of the experiment that it comes from
    frame : of this very scene; None: there is none
    info : `experiment_info.json`
    """

    images: Mapping[str, Item]
    masks: Mapping[str, Item]
    camera_mask: Item | None
    camera_number: int
    frame: Item | None
    info: Item | None

    @property
    def bands(self) -> tuple[str, ...]:
        """Of the images."""
        return tuple(self.images)

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of all files."""
        single = [item for item in (self.camera_mask, self.frame, self.info) if item is not None]
        return tuple(item.path for item in (*self.images.values(), *self.masks.values(), *single))

    def physics(self) -> str:
        """What made the scene's captures where `experiment_info.json` calls it simulated; "" where it does not.

        Raises
        ------
        FileError, DamagedFileError
        """
        info = self._info()
        return str(info.get("physics", "simulated")) if info.get("simulated") is True else ""

    def read_image(self, band: str) -> tuple[SarImage, str]:
        """The image of a band, and what made it by its own file; "" where that does not call itself simulated.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return _read_image(self.images[band])

    def read(
        self,
        *,
        truth: str = "camera",
        transform: str = "file",
        support: float | None = None,
        crop: tuple[int, int] = (0, 0),
        view: bool = True,
    ) -> LabelledScene:
        """The scene with its true masks.

        Parameters
        ----------
        truth : "camera", the camera's mask moved to the images' grids; or "exact", the masks that lie beside simulated
            images (those beside published ones were drawn by a network)
        transform : camera to radar by the pose in the "file", or by the constants of the "published" evaluation
        support : height of what the object stands on [m], above which the camera's prompts lie; None: -0.30 on a
            tripod, -0.48 otherwise
        crop : number of the lowest and of the highest slices of 77 GHz images to leave out
        view : whether to read the camera's picture of this very scene

        Raises
        ------
        FileError, FormatError, DamagedFileError
            A file is missing or damaged.
        InputError
            The truth lies off an image's grid, or there is none of that kind.
        UnknownNameError
        """
        check_known("truth", truth, TRUTHS)
        check_known("camera-to-radar transform", transform, TRANSFORMS)
        images = {band: read_item(item, SarImage) for band, item in self.images.items()}
        turn = self._radar_turn() if transform == "published" and self.number == 1 else None

        def placed(pose: np.ndarray) -> np.ndarray:
            if transform == "published":
                return published_radar_from_camera(self.number, pose, mito.BASE_ORIGIN, turn)
            return radar_from_camera(pose, mito.BASE_ORIGIN)

        if truth == "exact":
            masks = self._exact_masks()
        elif self.camera_mask is None or (self.camera_number != self.number and not self.physics()):
            raise FileError(
                f"{self.name} has no camera mask of its object in line of sight, so the true mask is unknown"
            )
        else:
            camera: CameraMask = read_item(self.camera_mask, CameraMask)
            masks = {band: camera_truth(camera, image.grid.xy, placed(camera.pose)) for band, image in images.items()}
        if HIGH in images:
            images[HIGH] = crop_slices(images[HIGH], low=crop[0], high=crop[1])
        return LabelledScene(
            name=self.name,
            object=self.object,
            sight=self.sight,
            images=images,
            truth=masks,
            view=self._view(placed, support) if view else None,
        )

    def _view(self, placed: Callable[[np.ndarray], np.ndarray], support: float | None) -> CameraView | None:
        """The camera's picture, prompts to be drawn on what rises above the support."""
        if self.frame is None:
            return None
        frame: CameraFrame = read_item(self.frame, CameraFrame)
        matrix = placed(frame.pose)
        if support is None:
            support = _SUPPORTS.get(self._info()["background"], _BLOCK)
        # At the depth d along the axis the height is T[2, 3] + d T[2, 2].
        if not matrix[2, 2] < 0:
            raise InputError(f"{self.name}: by its pose the camera does not look down; expected it above the object")
        farthest = (support + _MARGIN - matrix[2, 3]) / matrix[2, 2]
        return CameraView(frame=frame, T_radar_camera=matrix, farthest=farthest)

    def _exact_masks(self) -> dict[str, Mask]:
        if not self.physics():
            raise InputError(f"{self.name} is not marked as simulated: its radar masks are not exact; use the camera's")
        missing = [band for band in self.images if band not in self.masks]
        if missing:
            raise FileError(f"{self.name} has no radar mask at {missing[0]}; expected radar_masks.pkl beside the image")
        return {band: read_item(self.masks[band], Mask) for band in self.images}

    def _info(self) -> dict[str, Any]:
        if self.info is None:
            raise FileError(f"{self.name} has no experiment_info.json, which describes how it was made")
        return mito.read_info(self.info.path)

    def _radar_turn(self) -> np.ndarray | None:
        """(3, 3) of the tool at the radar's first place, where the 77 GHz image tells of it."""
        item = self.images.get(HIGH)
        if item is None or item.converted:
            return None
        poses = mito.read_published(item.path).extras.get("antenna_locs.tx_77_locs")
        if poses is None or np.ndim(poses) != 2 or np.shape(poses)[1] != 7:
            return None
        return rotation_from_quaternion(np.asarray(poses)[0, 3:])


@record
class SimulationFiles:
    """Simulated images of an object at one set of angles.

    Attributes
    ----------
    items : by band and "specular" or "edges"
    """

    items: Mapping[tuple[str, str], Item]

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of all files."""
        return tuple(item.path for item in self.items.values())

    def read_image(self, band: str, part: str) -> tuple[SarImage, str]:
        """As `SceneFiles.read_image`."""
        return _read_image(self.items[band, part])


@record
class DatasetFiles:
    """A dataset as tasks of `ms.evaluate` see it.

    Attributes
    ----------
    dataset : Dataset
    scenes : those to be evaluated
    """

    dataset: Dataset
    scenes: tuple[SceneFiles, ...]

    @property
    def path(self) -> Path:
        """Of the dataset."""
        return self.dataset.root

    def origins(self) -> dict[str, Origin]:
        """Where the scenes come from."""
        return origins(self.dataset, self.scenes)

    def simulations(self, band: str) -> dict[tuple[str, tuple[int, int, int]], SimulationFiles]:
        """Simulated images of a band, by folder and angles of the object; where there are both parts."""
        found = {}
        for one in (part for entry in self.dataset.objects for part in entry.simulations):
            images = [item for item in one.items if (item.kind, item.radar) == (mito.IMAGE, _RADARS[band])]
            items = {(band, item.ext[1:]): item for item in images if item.ext in ("_specular", "_edges")}
            if len(items) == 2:
                found[one.object, one.angles] = SimulationFiles(items=items)
        return found


def find_scenes(dataset: Dataset, *, sight: str | None = None) -> tuple[SceneFiles, ...]:
    """The scenes of a dataset that have radar images, by names alone; with a `sight`, those of it.

    Out of sight the camera's mask is that of the same experiment in line of sight; of simulated ones, where the object
    was not moved between experiments, also that of the first of the object so turned.

    Raises
    ------
    UnknownNameError
        No such sight.
    """
    if sight is not None:
        check_known("sight", sight, mito.SIGHTS)
    found = []
    catalogued = {entry.ycb_id: name for name, entry in CATALOGUE.items()}
    for one in dataset.objects:
        if one.role == "object":
            name = catalogued.get(one.folder.name, one.name)
            found += [_files(experiment, name, one.experiments) for experiment in one.experiments]
    return tuple(files for files in found if files.images and sight in (None, files.sight))


def _files(experiment: Experiment, name: str, others: tuple[Experiment, ...]) -> SceneFiles:
    angles = "_".join(map(str, experiment.angles))
    open_view = [e for e in others if e.sight == "los" and e.angles == experiment.angles]
    open_view.sort(key=lambda e: (e.number != experiment.number, e.number))
    masks = [(item, e.number) for e in open_view for item in e.items if item.kind == mito.CAMERA_MASK]
    camera_mask, camera_number = masks[0] if masks else (None, experiment.number)

    def by_band(kind: str) -> dict[str, Item]:
        items = {item.radar: item for item in experiment.items if item.kind == kind and item.ext == ""}
        return {band: items[radar] for band, radar in _RADARS.items() if radar in items}

    def first(kind: str) -> Item | None:
        return next((item for item in experiment.items if item.kind == kind), None)

    return SceneFiles(
        name=f"{experiment.object}/{angles}/exp{experiment.number}/{experiment.sight}",
        object=name,
        folder=experiment.object,
        angles=experiment.angles,
        number=experiment.number,
        sight=experiment.sight,
        images=by_band(mito.IMAGE),
        masks=by_band(mito.RADAR_MASK),
        camera_mask=camera_mask,
        camera_number=camera_number,
        frame=first(mito.CAMERA_FRAME),
        info=first(mito.INFO),
    )


def origins(dataset: Dataset, scenes: Sequence[SceneFiles]) -> dict[str, Origin]:
    """Where each scene comes from, by its name: of generated ones, by `truth` and the manifest.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    manifest = read_manifest(dataset.root)
    seed = None if manifest is None else manifest.settings.get("seed")
    common = {seed} if isinstance(seed, int) else set()
    found = {}
    for files in scenes:
        folder, turned, rest = files.name.split("/", 2)
        places = sorted((dataset.root / mito.TRUTH / folder / "robot_collected" / turned / rest).glob("*/world.toml"))
        worlds = [read_toml(path, "world") for path in places]
        found[files.name] = Origin(
            shape=_shape(worlds[0], files.object) if worlds else "unknown",
            seeds=frozenset(common | {world["seed"] for world in worlds if isinstance(world.get("seed"), int)}),
        )
    return found


def _shape(world: Mapping[str, Any], name: str) -> str:
    objects = world.get("objects") or [{}]
    if not (isinstance(objects, list) and isinstance(objects[0], dict)):
        return "unknown"
    if objects[0].get("object"):
        return "built"
    return "scan" if name in CATALOGUE else "file"  # a mesh of what the catalogue would have drawn


def _read_image(item: Item) -> tuple[SarImage, str]:
    if item.converted:
        image, extras = load(item.path), load_extras(item.path)
    else:
        image, extras = mito.read_published(item.path)
    made_by = str(extras.get("physics", "simulated")) if extras.get("simulated") else ""
    return expect(image, SarImage, item), made_by
