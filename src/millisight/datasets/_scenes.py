"""Scenes of a dataset in the published layout, joined for evaluation: images, camera, and true masks."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, record, rotation_from_quaternion
from millisight.core.errors import FileError, InputError
from millisight.data import CameraFrame, CameraMask, Capture, Mask, RawScan, SarImage, SceneObject, TriangleMesh
from millisight.datasets._dataset import Item, expect, read_item
from millisight.datasets._empty import subtract_published_empty
from millisight.datasets._published import (
    PublishedExperiment,
)
from millisight.evaluation import (
    HIGH,
    LOW,
    CameraView,
    LabelledScene,
    SceneSource,
    camera_truth,
    published_radar_from_camera,
    radar_from_camera,
)
from millisight.imaging import crop_slices
from millisight.io import load_extras, mito
from millisight.io.description import files_named

TRUTHS = ("camera", "exact")
TRANSFORMS = ("file", "published")
BANDS = {LOW: "24_ghz", HIGH: "77_ghz"}
"""Of images, and the folders of their radars."""
_SUPPORTS = {"tripod": -0.30}  # height of what the object stands on [m]; of anything else:
_BLOCK = -0.48
_TOP_SLICES = 3  # that 24 GHz and simulated images lose where a 77 GHz image is cropped
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
    turns : what may tell how the tool was held in the 77 GHz scan: the image, raw files, the robot's log
    published : what the table of the published dataset says of the experiment; it holds for measured scenes alone
    empty : the empty scene's image, to be subtracted at 24 GHz as published; None: there is none
    hollow : whether there is no object in it, and its true masks are empty
    """

    images: Mapping[str, Item]
    masks: Mapping[str, Item]
    camera_mask: Item | None
    camera_number: int
    frame: Item | None
    info: Item | None
    turns: tuple[Item, ...] = ()
    published: PublishedExperiment | None = None
    empty: Item | None = None
    hollow: bool = False

    @property
    def bands(self) -> tuple[str, ...]:
        """Of the images."""
        return tuple(self.images)

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of all files."""
        single = [item for item in (self.camera_mask, self.frame, self.info, self.empty) if item is not None]
        every = (*self.images.values(), *self.masks.values(), *self.turns, *single)
        return tuple(dict.fromkeys(item.path for item in every))

    def physics(self) -> str:
        """What made the scene's captures where `experiment_info.json` calls it simulated; "" where it does not.

        Raises
        ------
        FileError, DamagedFileError
        """
        info = self._info()
        return _physics(info) if info.get("simulated") is True else ""

    def shape_class(self) -> str:
        """The object's class where `experiment_info.json` states it, as of a recipe's own mesh files; else "".

        Raises
        ------
        FileError, DamagedFileError
        """
        return "" if self.info is None else self._info().get("class", "")

    @property
    def used(self) -> bool:
        """Whether the authors of the published dataset use the scene; always of simulated scenes, and of others' data.

        Raises
        ------
        FileError, DamagedFileError
        """
        return self.published is None or self.sight in self.published.available or bool(self.physics())

    def read_image(self, band: str, *, crop: tuple[int, int] | None = None) -> tuple[SarImage, str]:
        """The image of a band, and what made it by its own file; "" where that does not call itself simulated.

        Of published scenes, the empty scene is subtracted at 24 GHz where the dataset holds it. `crop` is the number of
        the lowest and of the highest slices that a 77 GHz image loses; None: as published, of which images of fewer
        slices are left whole.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        image, made_by = _read_image(self.images[band])
        published = None if made_by or (self.info is not None and self.physics()) else self.published
        if published is not None and band == LOW and self.empty is not None:
            image = subtract_published_empty(image, read_item(self.empty, SarImage))
        if crop is None:
            return cropped_as_published(image, band, published), made_by
        return crop_slices(image, low=crop[0], high=crop[1]) if band == HIGH else image, made_by

    def shape_paths(self, band: str) -> tuple[Path, ...]:
        """The capture, the world that the virtual rig scanned, and the files that it names."""
        capture, world = self._capture_of(band), self._world_of(band)
        return () if capture is None or world is None else (capture.path, world, *files_named(world))

    def read_capture(self, band: str) -> Capture:
        """The capture of a band.

        Raises
        ------
        FileError, FormatError, DamagedFileError, InputError
        """
        item = self._capture_of(band)
        if item is None:
            return super().read_capture(band)
        held = item.read()
        return held.to_capture() if isinstance(held, RawScan) else held

    def read_shape(self, band: str) -> tuple[TriangleMesh, ...]:
        """Meshes of the objects as the virtual rig placed them.

        Raises
        ------
        FileError, MeshError, InputError
        """
        world = self._world_of(band)
        return super().read_shape(band) if world is None else tuple(part.mesh for part in _parts_of(world))

    def metal(self, band: str) -> bool:
        """Whether most of the object's surface is metal, by the area of its parts.

        Raises
        ------
        FileError, MeshError, InputError
        """
        world = self._world_of(band)
        if world is None:
            return super().metal(band)
        parts = _parts_of(world)
        metallic = sum(part.mesh.area for part in parts if part.material.conductivity is not None)
        return 2 * metallic > sum(part.mesh.area for part in parts)

    def _capture_of(self, band: str) -> Item | None:
        return next((item for item in self.turns if (item.kind, item.radar) == (mito.RAW, BANDS[band])), None)

    def _world_of(self, band: str) -> Path | None:
        """`truth/<experiment>/<radar>/world.toml`, below the folder that holds the objects' folders."""
        if band not in self.images:
            return None
        experiment = self.images[band].path.parents[3]
        for root in experiment.parents:
            folder = root / mito.TRUTH / experiment.relative_to(root) / BANDS[band]
            if (folder / "world.toml").is_file():
                return folder / "world.toml"
        return None

    def published_mask(self, band: str) -> Mask | None:
        """The mask beside an image.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return read_item(self.masks[band], Mask) if band in self.masks else None

    def read(  # ty: ignore[incompatible-method-override]: each source has its own ways of reading
        self,
        *,
        truth: str = "camera",
        transform: str = "file",
        support: float | None = None,
        crop: tuple[int, int] | None = None,
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
        crop : see `read_image`
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
        images = {band: self.read_image(band, crop=crop)[0] for band in self.images}
        turn = self._radar_turn() if transform == "published" and self.number == 1 else None

        def placed(pose: np.ndarray) -> np.ndarray:
            if transform == "published":
                return published_radar_from_camera(self.number, pose, mito.BASE_ORIGIN, turn)
            return radar_from_camera(pose, mito.BASE_ORIGIN)

        if self.hollow:
            grids = {band: image.grid.xy for band, image in images.items()}
            masks = {band: Mask(grid_xy=grid, inside=np.zeros(grid.shape, bool)) for band, grid in grids.items()}
        elif truth == "exact":
            masks = self._exact_masks()
        elif self.camera_mask is None or (self.camera_number != self.number and not self.physics()):
            raise FileError(
                f"{self.name} has no camera mask of its object in line of sight, so the true mask is unknown"
            )
        else:
            camera: CameraMask = read_item(self.camera_mask, CameraMask)
            masks = {band: camera_truth(camera, image.grid.xy, placed(camera.pose)) for band, image in images.items()}
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
        """(3, 3) of the tool at the radar's first place, where the 77 GHz image or the robot's log tells of it."""
        for item in self.turns:
            quaternion = mito.first_turn(_turn_extras(item))
            if quaternion is not None:
                return rotation_from_quaternion(quaternion)
        return None


@record
class SimulationFiles:
    """Simulated images of an object at one set of angles.

    Attributes
    ----------
    items : by band and "specular" or "edges"
    published : what the table of the published dataset says of the object's first experiment
    """

    items: Mapping[tuple[str, str], Item]
    published: PublishedExperiment | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of all files."""
        return tuple(item.path for item in self.items.values())

    def read_image(self, band: str, part: str) -> tuple[SarImage, str]:
        """As `SceneFiles.read_image`; a published image loses its highest slices where measured ones are cropped."""
        image, made_by = _read_image(self.items[band, part])
        return cropped_as_published(image, LOW, None if made_by else self.published), made_by


def cropped_as_published(image: SarImage, band: str, published: PublishedExperiment | None) -> SarImage:
    """The image without the slices that published ones lose; whole where it has no more than these."""
    low, high = (0, 0) if published is None else published.crop
    if band == LOW and (low or high):
        low, high = 0, _TOP_SLICES
    return crop_slices(image, low=low, high=high) if 0 < low + high < len(image.grid.z) else image


def _turn_extras(item: Item) -> Mapping[str, Any]:
    """Extras of an image, or of the robot's log of raw files, published or converted."""
    if item.kind != mito.RAW:
        return item.read_with_extras()[1]
    if not item.converted:
        return mito.read_log(item.path, item.radar).extras
    log = item.path.with_name(mito.RAW_LOG)
    return load_extras(log) if log.is_file() else {}


def _read_image(item: Item) -> tuple[SarImage, str]:
    image, extras = item.read_with_extras()
    made_by = _physics(extras) if extras.get("simulated") else ""
    return expect(image, SarImage, item), made_by


def _physics(held: Mapping[str, Any]) -> str:
    """What a simulated file says of its physics; "simulated" where it says nothing."""
    told = held.get("physics")
    return ("" if told is None else str(told).strip()) or "simulated"


def _parts_of(world: Path) -> tuple[SceneObject, ...]:
    """The parts of the objects of a world of the virtual rig, in their places."""
    from millisight.rig.virtual import World, build_layout

    return tuple(part for thing in build_layout(World.from_toml(world)).objects for part in thing.parts)
