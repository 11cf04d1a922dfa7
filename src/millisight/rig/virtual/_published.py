"""What a virtual rig takes over from the published set-up: its frame, image grids, folders, and how it is told of."""

import os
from pathlib import Path
from typing import Any

from millisight.data import VoxelGrid
from millisight.io.mito import BASE_ORIGIN as BASE_ORIGIN
from millisight.io.mito import experiment_folder, published_grid
from millisight.meshes import CATALOGUE
from millisight.rig import scan_info
from millisight.rig.virtual._world import World


def image_grid(world: World, radar: str = "77_ghz") -> VoxelGrid:
    """The published image grid over a world's support, of the radar of that name."""
    return published_grid(radar, world.support.kind)


def experiment_folder_of(world: World, root: str | os.PathLike[str], number: int) -> Path:
    """Where a world's experiment goes in a dataset: under its first object's name and angles.

    What is not of the catalogue has the number 000; several objects stand in the name one after the other, and the
    empty scene is 000_background.
    """
    names = [CATALOGUE[o.object].ycb_id if o.object else f"000_{o.name}" for o in world.objects] or ["000_background"]
    angles = world.objects[0].rotate_deg if world.objects else (0.0, 0.0, 0.0)
    x, y, z = (round(angle) for angle in angles)
    return experiment_folder(root, "+".join(names), (x, y, z), number, world.sight)


def experiment_info(world: World) -> dict[str, Any]:
    """What `experiment_info.json` says of a world's scan: see `scan_info`."""
    return scan_info(world.radars, world.support.kind)
