"""What a virtual rig takes over from the published set-up: its frame, image grids, folders, and how it is told of."""

import os
from pathlib import Path
from typing import Any

from millisight.data import VoxelGrid
from millisight.io.mito import BASE_ORIGIN as BASE_ORIGIN
from millisight.io.mito import FRAME_PERIODS, experiment_folder, published_grid
from millisight.meshes import CATALOGUE
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
    """What `experiment_info.json` says of a world's scan.

    "aperture size" stands for the published pace of the frames and, at 24 GHz, for both receivers; "frame period" [s]
    says what the pace is where it is neither.
    """
    periods = {radar.name: radar.frame_period for radar in world.radars}
    normal = all(period == FRAME_PERIODS[radar, "normal"] for radar, period in periods.items())
    size = "normal" if normal and "77_ghz" in periods else "almost-square"
    axes = [radar.rx_axis for radar in world.radars if radar.name == "77_ghz"]
    info = {"aperture size": size, "rx offset": (axes and axes[0]) or "x", "background": world.support.kind}
    other = {radar: period for radar, period in periods.items() if period != FRAME_PERIODS[radar, size]}
    return info | ({"frame period": other} if other else {})
