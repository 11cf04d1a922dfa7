"""What only a virtual rig can tell of a scan: the true path and exact masks, in files of their own."""

import os
from pathlib import Path

import numpy as np

from millisight.core import atomic_path, make_folder
from millisight.data import CameraMask
from millisight.io import save
from millisight.rig.virtual._camera import camera_mask, footprint, object_pixels, render, visible_pixels
from millisight.rig.virtual._published import image_grid
from millisight.rig.virtual._rig import VirtualRig


def line_of_sight_mask(rig: VirtualRig) -> CameraMask:
    """The objects' pixels in the picture of the same scene with noitem before it, as the published masks are made."""
    layout, pose = rig.layout.uncovered(), rig.camera.pose
    frame = render(layout, pose, rig.world.camera, np.random.default_rng(rig.world.seed))
    return camera_mask(frame, visible_pixels(layout, pose))


def write_truth(rig: VirtualRig, folder: str | os.PathLike[str]) -> Path:
    """Write the truth of a scan into `folder`, made where it is missing; the same scan gives the same bytes.

    - `<radar>.path.h5`, a Trajectory: where the radar was when it took each frame, radar frame, times of its own clock;
    - `<radar>.footprint.h5`, a Mask: the pixels of the published image grid over which objects lie; with several also
      `<radar>.<number>_<name>.footprint.h5` of each;
    - `camera.mask.h5`, a CameraMask: the objects in the picture as if noitem hid them;
    - `camera.masks.npz`: of each object `<number>_<name>.amodal`, (480, 640) bool, its pixels if it were alone, and
      `.visible`, those on which it is seen;
    - `world.toml`.

    Raises
    ------
    FileError
    """
    folder = make_folder(folder)
    layout = rig.layout
    several = layout.objects if len(layout.objects) > 1 else ()
    for radar in rig.radars:
        save(folder / f"{radar.name}.path.h5", rig.truth(radar.name), reproducible=True)
        grid = image_grid(rig.world, radar.name).xy
        for number, name in [(None, ""), *((item.number, f".{item.number}_{item.name}") for item in several)]:
            mask = footprint(layout, grid, number)
            save(folder / f"{radar.name}{name}.footprint.h5", mask, reproducible=True)
    if layout.objects:
        save(folder / "camera.mask.h5", line_of_sight_mask(rig), reproducible=True)
        masks = {}
        for item in layout.objects:
            masks[f"{item.number}_{item.name}.amodal"] = object_pixels(layout, rig.camera.pose, item.number)
            masks[f"{item.number}_{item.name}.visible"] = visible_pixels(layout, rig.camera.pose, item.number)
        with atomic_path(folder / "camera.masks.npz") as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, **masks)
    rig.world.seen_from(folder).to_toml(folder / "world.toml")
    return folder
