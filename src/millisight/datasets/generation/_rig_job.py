"""One scan by the virtual rig, as a job: raw files, captures, images, masks and truth, of one seed the same bytes."""

import dataclasses
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from millisight.calibration import subtract_background
from millisight.core import make_folder, record
from millisight.data import Capture, PixelGrid, VoxelGrid
from millisight.datasets.generation._cost import Cost, rig_cost
from millisight.datasets.generation._recipe import Voxels
from millisight.imaging import form_image
from millisight.io import mito, open_capture, save
from millisight.rig import CAPTURE_NAME, PublishedWriter, record_scan
from millisight.rig.virtual import (
    VirtualRig,
    World,
    WorldLayout,
    build_layout,
    camera_mask,
    footprint,
    visible_pixels,
    write_object_masks,
)

PHYSICS = "virtual rig: physical optics"


@record
class RigJob:
    """A scan of one world.

    Attributes
    ----------
    folder : of the experiment, relative to the dataset
    world : paths of its mesh files are relative to the dataset
    info : for `experiment_info.json`
    voxels : of the images
    keep : "raw", "captures" or "images"
    camera : whether the picture is taken in this scan
    first : whether it tells of what several scans of an experiment share
    sources : checksums of the mesh files, by their paths relative to the dataset
    empty : folder of the empty scene's experiment that is subtracted before imaging, by radar
    image_folder : of the experiment where images go; None: `folder`
    beyond : (4,) by how much the images reach further than the margin, to lower and higher x, lower and higher y [m]
    """

    folder: str
    world: World
    info: Mapping[str, Any]
    voxels: Voxels
    keep: str
    camera: bool
    first: bool
    sources: Mapping[str, str]
    empty: Mapping[str, str]
    image_folder: str | None = None
    beyond: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def radars(self) -> tuple[str, ...]:
        return tuple(settings.name for settings in self.world.radars)

    @property
    def key(self) -> str:
        """A name of its own among the jobs of a recipe."""
        return f"{self.folder}/{'+'.join(self.radars)}"

    @property
    def truth(self) -> str:
        """Where what only the rig knows goes, relative to the dataset."""
        return f"{mito.TRUTH}/{self.key}"

    @property
    def folders(self) -> tuple[str, ...]:
        """Where all that this job makes lies, relative to the dataset."""
        return self.folder, self.image_folder or self.folder, self.truth

    @property
    def inputs(self) -> tuple[str, ...]:
        """The files of the dataset that it reads, relative to it: meshes, and captures of empty scenes."""
        return (*self.sources, *(self._empty_capture(radar) for radar in self.empty))

    def description(self) -> dict[str, Any]:
        """All that the job's files follow from, as JSON holds it."""
        return {
            "folder": self.folder,
            "image_folder": self.image_folder,
            "world": _plain_world(self.world),
            "info": dict(self.info),
            "image": _plain(self.voxels),
            "beyond": list(self.beyond),
            "keep": self.keep,
            "camera": self.camera,
            "first": self.first,
            "meshes": dict(self.sources),
        }

    def stage(self, root: Path) -> WorldLayout:
        """What stands where, once the meshes are in the dataset `root`."""
        return build_layout(self._world(root))

    def check(self, root: Path) -> Cost:
        """What it will cost.

        Raises
        ------
        InputError, CoverageError, MeshError, FileError
            The world is impossible.
        """
        stage = self.stage(root)
        grids = {radar: self._grid(stage, radar) for radar in self.radars}
        return rig_cost(stage, grids, keep=self.keep, camera=self.camera)

    def make(self, root: Path, to: Path, made_by: Mapping[str, Any]) -> None:
        """Write its files under `to`, each at its place relative to the dataset `root`.

        Parameters
        ----------
        made_by : provenance, told in every file that has room for it
        """
        stage = build_layout(self._world(root))
        rig = VirtualRig(stage.world, layout=stage)
        scanned = record_scan(
            rig.arm, rig.radars, rig.camera if self.camera else None, rig.plan,
            PublishedWriter(to / self.folder, info=self.info, hdf5=False, fill=self.keep == "raw"),
        )  # fmt: skip
        for radar in self.radars:
            self._image(root, to, stage, radar, made_by)
        if self.camera:
            _finish_camera(scanned, stage, rig.camera.pose, made_by)
        self._write_truth(rig, to, made_by)

    def _world(self, root: Path) -> World:
        return dataclasses.replace(self.world, folder=str(root))

    def _grid(self, stage: WorldLayout, radar: str) -> VoxelGrid:
        box = mito.published_box(radar, self.world.support.kind)
        bounds = [thing.bounds for thing in stage.objects] or [panel.mesh.bounds for panel in stage.panels]
        around = None
        if bounds:
            left, right, near, far = self.beyond
            around = np.min(bounds, axis=0)[0] - [left, near, 0], np.max(bounds, axis=0)[1] + [right, far, 0]
        return cut_grid(box["lower"], box["upper"], self.voxels, around)

    def _image(self, root: Path, to: Path, stage: WorldLayout, radar: str, made_by: Mapping[str, Any]) -> None:
        scan = mito.read_experiment(to / self.folder, radar)
        capture = with_provenance(scan.to_capture(), made_by)
        image = form_image(self._without_empty(capture, root, radar), self._grid(stage, radar))
        folder = make_folder(mito.radar_folder(to / (self.image_folder or self.folder), radar, processed=True))
        mito.write_published(folder / "processed_image.pkl", image, made_by)
        if self.image_folder is not None:
            shutil.copyfile(
                (to / self.folder).parent / mito.INFO_NAME,
                make_folder((to / self.image_folder).parent) / mito.INFO_NAME,
            )
        if stage.objects:
            write_masks(folder, "", stage, image.grid.xy, made_by)
        raw = mito.radar_folder(to / self.folder, radar, processed=False)
        if self.keep != "raw":
            shutil.rmtree(raw)
        if self.keep == "captures":
            save(make_folder(raw) / mito.RAW_CAPTURE, capture, reproducible=True)
            save(raw / mito.RAW_LOG, scan.log, extras=made_by, reproducible=True)
        if not stage.objects and not stage.panels:
            save(raw / CAPTURE_NAME, capture, reproducible=True)

    def _without_empty(self, capture: Capture, root: Path, radar: str) -> Capture:
        """The capture less the first frame of the empty scene's, as the published 24 GHz images were made."""
        if radar not in self.empty:
            return capture
        with open_capture(root / self._empty_capture(radar)) as empty:
            return subtract_background(capture, empty, frame="first")

    def _empty_capture(self, radar: str) -> str:
        return (mito.radar_folder(Path(self.empty[radar]), radar, processed=False) / CAPTURE_NAME).as_posix()

    def _write_truth(self, rig: VirtualRig, to: Path, made_by: Mapping[str, Any]) -> None:
        """The true path of each radar, each object's pixels in the picture, and the world."""
        folder = make_folder(to / self.truth)
        for radar in self.radars:
            save(folder / f"{radar}.path.h5", rig.truth(radar), extras=made_by, reproducible=True)
        if self.camera and rig.layout.objects:
            write_object_masks(rig, folder)
        # As if the mesh files were under `to`: so are they called from the world's place in the dataset.
        dataclasses.replace(self.world, folder=str(to)).seen_from(folder).to_toml(folder / "world.toml")


def write_masks(folder: Path, suffix: str, stage: WorldLayout, grid: PixelGrid, made_by: Mapping[str, Any]) -> None:
    """The mask of all objects together and, where there are several, of each."""
    several = stage.objects if len(stage.objects) > 1 else ()
    for number, ext in [(None, ""), *((thing.number, f"_{thing.number}_{thing.name}") for thing in several)]:
        mito.write_published(folder / f"radar_masks{suffix}{ext}.pkl", footprint(stage, grid, number), made_by)


def _finish_camera(folder: Path, stage: WorldLayout, pose: np.ndarray, made_by: Mapping[str, Any]) -> None:
    """Provenance into the picture's file, and in line of sight the objects' mask beside it."""
    picture = folder / "unprocessed" / "camera" / "continuous.pkl"
    frame, extras = mito.read_published(picture)
    mito.write_published(picture, frame, {**extras, **made_by})
    if stage.objects and not stage.panels:
        mask = camera_mask(frame, visible_pixels(stage, pose))
        mito.write_published(make_folder(folder / "processed" / "camera") / "camera_masks.pkl", mask, made_by)


def with_provenance(capture: Capture, made_by: Mapping[str, Any]) -> Capture:
    """The capture, which now says in its metadata what it is."""
    return dataclasses.replace(capture, metadata={**capture.metadata, **made_by})


def cut_grid(
    lower: Sequence[float], upper: Sequence[float], voxels: Voxels, around: tuple[np.ndarray, np.ndarray] | None
) -> VoxelGrid:
    """The voxels of a box from `lower` to `upper` (3,) [m] at a spacing, those within the margin of a box `around`.

    What is cut out of one box lies on one lattice, so that images over different objects, or of the empty scene,
    have voxels in common.
    """
    spacing = np.array(voxels.spacing)
    start, counts = np.zeros(3), np.floor(np.subtract(upper, lower) / spacing * (1 + 1e-9)) + 1
    stop = counts - 1
    if voxels.margin is not None and around is not None:
        start = np.clip(np.floor((around[0] - voxels.margin - lower) / spacing + 1e-9), 0, stop)
        stop = np.clip(np.ceil((around[1] + voxels.margin - lower) / spacing - 1e-9), start, stop)
    axes = (low + step * np.arange(a, b + 1) for low, step, a, b in zip(lower, spacing, start, stop, strict=True))
    x, y, z = axes
    return VoxelGrid(x=x, y=y, z=z)


def _plain_world(world: World) -> dict[str, Any]:
    """A world as JSON holds it; without what an older version did not know, where it changes nothing."""
    plain = _plain(dataclasses.replace(world, folder="."))
    if plain["carton"] and not plain["carton"]["turn_deg"]:
        del plain["carton"]["turn_deg"]
    return plain


def _plain(value: Any) -> Any:
    """A record as JSON holds it."""
    return json.loads(json.dumps(dataclasses.asdict(value)))
