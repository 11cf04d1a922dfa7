"""Scenes of a dataset in the published layout, joined for judging segmenters: images, camera, and the truth."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.capture.camera import CameraFrame, CameraMask
from millisight.datasets.inventory import Dataset, Experiment, Item
from millisight.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.evaluation.segmentation import HIGH, LOW, Scene, View
from millisight.evaluation.truth import camera_truth, published_radar_from_camera, radar_from_camera
from millisight.geometry import rotation_from_quaternion
from millisight.imaging.cleanup import crop_slices
from millisight.imaging.image import SarImage
from millisight.io.hdf5 import load
from millisight.io.mito_layout import read_info, read_published
from millisight.io.mito_names import CAMERA_FRAME, CAMERA_MASK, IMAGE, INFO, RADAR_MASK
from millisight.io.mito_setup import BASE_ORIGIN
from millisight.perception.segmentation import Mask
from millisight.records import record
from millisight.scene.objects import CATALOGUE

TRUTHS = ("camera", "exact")
TRANSFORMS = ("file", "published")
_RADARS = {LOW: "24_ghz", HIGH: "77_ghz"}
_SUPPORTS = {"tripod": -0.30}  # height of what the object stands on [m]; of anything else:
_BLOCK = -0.48
_MARGIN = 0.004  # above the support, what belongs to the object [m]


@record
class SceneFiles:
    """The files of a scene.

    Attributes
    ----------
    name : `<id>_<name>/<angles>/exp<N>/<sight>`
    object : name of the object, in the catalogue where it is of it, by which networks tell what they saw
    number : N of `exp<N>`
    sight : "los" or "nlos"
    images : by "24 GHz" and "77 GHz"
    masks : likewise, the masks on the images' pixels
    camera_mask : of the same object in line of sight; None: there is none
    camera_number : N of the experiment that it comes from
    frame : of this very scene; None: there is none
    info : `experiment_info.json`
    """

    name: str
    object: str
    number: int
    sight: str
    images: Mapping[str, Item]
    masks: Mapping[str, Item]
    camera_mask: Item | None
    camera_number: int
    frame: Item | None
    info: Item | None

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of all files."""
        single = [item for item in (self.camera_mask, self.frame, self.info) if item is not None]
        return tuple(item.path for item in (*self.images.values(), *self.masks.values(), *single))


def find_scenes(dataset: Dataset, *, sight: str | None = None) -> tuple[SceneFiles, ...]:
    """The scenes of a dataset that have radar images, by names alone; with a `sight`, those of it.

    Out of sight the camera's mask is that of the same experiment in line of sight; of simulated ones, where the object
    was not moved between experiments, also that of the first of the object so turned.
    """
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
    masks = [(item, e.number) for e in open_view for item in e.items if item.kind == CAMERA_MASK]
    camera_mask, camera_number = masks[0] if masks else (None, experiment.number)

    def by_radar(kind: str) -> dict[str, Item]:
        items = {item.radar: item for item in experiment.items if item.kind == kind and item.ext == ""}
        return {given: items[radar] for given, radar in _RADARS.items() if radar in items}

    def first(kind: str) -> Item | None:
        return next((item for item in experiment.items if item.kind == kind), None)

    return SceneFiles(
        name=f"{experiment.object}/{angles}/exp{experiment.number}/{experiment.sight}",
        object=name,
        number=experiment.number,
        sight=experiment.sight,
        images=by_radar(IMAGE),
        masks=by_radar(RADAR_MASK),
        camera_mask=camera_mask,
        camera_number=camera_number,
        frame=first(CAMERA_FRAME),
        info=first(INFO),
    )


def physics_of(files: SceneFiles) -> str:
    """What made the scene's captures where `experiment_info.json` calls it simulated; "" where it does not.

    Raises
    ------
    FileError, DamagedFileError
    """
    info = _info(files)
    return str(info.get("physics", "simulated")) if info.get("simulated") is True else ""


def read_scene(
    files: SceneFiles,
    *,
    truth: str = "camera",
    transform: str = "file",
    support: float | None = None,
    crop: tuple[int, int] = (0, 0),
) -> Scene:
    """A scene, read and joined.

    Parameters
    ----------
    truth : "camera", the camera's mask moved to the images' grids; or "exact", the masks that lie beside simulated
        images (those beside published ones were drawn by a network)
    transform : camera to radar by the pose in the "file", or by the constants of the "published" evaluation
    support : height of what the object stands on [m], above which the camera's prompts lie; None: -0.30 on a tripod,
        -0.48 otherwise
    crop : so many of the lowest and of the highest slices of 77 GHz images are left out

    Raises
    ------
    FileError, FormatError, DamagedFileError
        A file is missing or damaged.
    InputError
        The truth lies off an image's grid, or there is none of that kind.
    UnknownNameError
    """
    if truth not in TRUTHS:
        raise UnknownNameError("truth", truth, TRUTHS)
    if transform not in TRANSFORMS:
        raise UnknownNameError("camera-to-radar transform", transform, TRANSFORMS)
    images = {given: _read(item, SarImage) for given, item in files.images.items()}
    turn = _radar_turn(files) if transform == "published" and files.number == 1 else None

    def placed(pose: np.ndarray) -> np.ndarray:
        if transform == "published":
            return published_radar_from_camera(files.number, pose, BASE_ORIGIN, turn)
        return radar_from_camera(pose, BASE_ORIGIN)

    if truth == "exact":
        masks = _exact(files)
    elif files.camera_mask is None or (files.camera_number != files.number and not physics_of(files)):
        raise FileError(f"{files.name} has no camera mask of its object in line of sight, and so no truth")
    else:
        camera: CameraMask = _read(files.camera_mask, CameraMask)
        masks = {given: camera_truth(camera, image.grid.xy, placed(camera.pose)) for given, image in images.items()}
    return Scene(
        name=files.name,
        object=files.object,
        sight=files.sight,
        images={
            given: crop_slices(image, low=crop[0], high=crop[1]) if given == HIGH else image
            for given, image in images.items()
        },
        truth=masks,
        view=_view(files, placed, support),
    )


def _view(files: SceneFiles, placed: Callable[[np.ndarray], np.ndarray], support: float | None) -> View | None:
    """The camera's picture, prompts to be drawn on what rises above the support."""
    if files.frame is None:
        return None
    frame: CameraFrame = _read(files.frame, CameraFrame)
    matrix = placed(frame.pose)
    if support is None:
        support = _SUPPORTS.get(_info(files)["background"], _BLOCK)
    # At the depth d along the axis the height is T[2, 3] + d T[2, 2].
    if not matrix[2, 2] < 0:
        raise InputError(f"{files.name}: the camera does not look down, by its pose; expected it above the object")
    return View(frame=frame, T_radar_camera=matrix, farthest=(support + _MARGIN - matrix[2, 3]) / matrix[2, 2])


def _exact(files: SceneFiles) -> dict[str, Mask]:
    if not physics_of(files):
        raise InputError(f"{files.name} is not marked as simulated: its radar masks are no truth; use the camera's")
    missing = [given for given in files.images if given not in files.masks]
    if missing:
        raise FileError(f"{files.name} has no radar mask at {missing[0]}; expected radar_masks.pkl beside the image")
    return {given: _read(files.masks[given], Mask) for given in files.images}


def _read(item: Item, kind: type) -> Any:
    found = load(item.path) if item.converted else read_published(item.path).record
    if not isinstance(found, kind):
        raise FormatError(f"{item.path} holds a {type(found).__name__}; expected a {kind.__name__}")
    return found


def _info(files: SceneFiles) -> dict[str, Any]:
    if files.info is None:
        raise FileError(f"{files.name} has no experiment_info.json, which says how it was made")
    return read_info(files.info.path)


def _radar_turn(files: SceneFiles) -> np.ndarray | None:
    """(3, 3) of the tool at the radar's first place, where the 77 GHz image tells of it."""
    item = files.images.get(HIGH)
    if item is None or item.converted:
        return None
    poses = read_published(item.path).extras.get("antenna_locs.tx_77_locs")
    if poses is None or np.ndim(poses) != 2 or np.shape(poses)[1] != 7:
        return None
    return rotation_from_quaternion(np.asarray(poses)[0, 3:])
