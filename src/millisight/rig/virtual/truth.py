"""What only a virtual rig can tell of a scan: the true path and exact masks, in files of their own."""

import os
from pathlib import Path

import numpy as np

from millisight.capture.camera import CameraMask
from millisight.files import atomic_path, make_folder
from millisight.io.hdf5 import save
from millisight.rig.virtual.camera import camera_mask, footprint, object_pixels, render, visible_pixels
from millisight.rig.virtual.rig import VirtualRig


def line_of_sight_mask(rig: VirtualRig) -> CameraMask:
    """The objects' pixels in the picture of the same scene with nothing before it, as the published masks are made."""
    stage, pose = rig.stage.uncovered(), rig.camera.pose
    frame = render(stage, pose, rig.world.camera, np.random.default_rng(rig.world.seed))
    return camera_mask(frame, visible_pixels(stage, pose))


def write_truth(rig: VirtualRig, folder: str | os.PathLike[str]) -> Path:
    """Write the truth of a scan into `folder`, made where it is missing; the same scan gives the same bytes.

    - `<radar>.path.h5`, a Trajectory: where the radar was when it took each frame, radar frame, times of its own clock;
    - `<radar>.footprint.h5`, a Mask: the pixels of the published image grid over which objects lie; with several also
      `<radar>.<number>_<name>.footprint.h5` of each;
    - `camera.mask.h5`, a CameraMask: the objects in the picture as if nothing hid them;
    - `camera.masks.npz`: of each object `<number>_<name>.amodal`, (480, 640) bool, its pixels if it were alone, and
      `.visible`, those on which it is seen;
    - `world.toml`.

    Raises
    ------
    FileError
    """
    folder = make_folder(folder)
    stage = rig.stage
    several = stage.objects if len(stage.objects) > 1 else ()
    for radar in rig.radars:
        save(folder / f"{radar.folder}.path.h5", rig.truth(radar.folder), reproducible=True)
        grid = rig.world.image_grid(radar.folder).xy
        for number, name in [(None, ""), *((thing.number, f".{thing.number}_{thing.name}") for thing in several)]:
            mask = footprint(stage, grid, number)
            save(folder / f"{radar.folder}{name}.footprint.h5", mask, reproducible=True)
    if stage.objects:
        save(folder / "camera.mask.h5", line_of_sight_mask(rig), reproducible=True)
        masks = {}
        for thing in stage.objects:
            masks[f"{thing.number}_{thing.name}.amodal"] = object_pixels(stage, rig.camera.pose, thing.number)
            masks[f"{thing.number}_{thing.name}.visible"] = visible_pixels(stage, rig.camera.pose, thing.number)
        with atomic_path(folder / "camera.masks.npz") as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, **masks)
    rig.world.seen_from(folder).to_toml(folder / "world.toml")
    return folder
