"""From which side a scene is seen: sheets lie below antennas that look down along z, or are found mirrored in z."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from millisight.core import with_step
from millisight.data import Capture, SarImage, Trajectory, VoxelGrid

NOT_LOOKED_AT: Mapping[Any, str] = {
    "still": "the radar did not move",
    "beside": "the antennas lie beside the scene, and sheets are looked for along z: turn the frame",
}
"""Why sheets are not looked for."""

_OVER = np.array([1.0, 1.0, -1.0])


def antennas_of(capture: Capture) -> np.ndarray:
    """(2, 3) smallest and largest coordinates of a capture's antennas [m]. Images keep them as `SarImage.antennas`."""
    tx, rx = capture.tx_positions, capture.rx_positions
    lower = np.minimum(tx.min(axis=(0, 1)), rx.min(axis=(0, 1)))
    return np.stack([lower, np.maximum(tx.max(axis=(0, 1)), rx.max(axis=(0, 1)))])


def side_of(scene: SarImage | Capture, grid: VoxelGrid | None) -> str | None:
    """As `SarImage.seen_from`, of an image or of what a grid will hold; "still" where the radar did not move."""
    if isinstance(scene, SarImage):
        return scene.seen_from
    if not any(np.ptp(places, axis=0).any() for places in (scene.tx_positions, scene.rx_positions)):
        return "still"
    return None if grid is None else grid.side_of(antennas_of(scene))


def mirrored(search: Callable[..., Any], scene: Any, grid: VoxelGrid | None, **settings: Any) -> Any:
    """What `search` finds in an image, or in a capture and what a grid will hold of it, that is seen from below.

    It is mirrored in z, as if it was seen from above, and what was found is turned back.
    """
    if isinstance(scene, SarImage):
        found = search(scene.turned_over, **settings)
    else:
        path = Trajectory(times=scene.trajectory.times, positions=scene.trajectory.positions * _OVER)
        points = {"tx_points": scene.tx_positions * _OVER, "rx_points": scene.rx_positions * _OVER}
        over = grid and VoxelGrid(x=grid.x, y=grid.y, z=-grid.z[::-1])
        found = search(replace(scene, trajectory=path, **points), grid=over, **settings)
    sheets, left = (tuple(map(_turned_back, some)) for some in (found.sheets, found.left))
    if not sheets:
        return replace(found, result=scene, left=left)
    told = {name: value for name, value in found.result.metadata["history"][-1].items() if name != "step"}
    metadata = with_step(scene.metadata, "remove_sheets", **{**told, "sheets": [asdict(one) for one in sheets]})
    cleaned = found.result
    data = {"values": cleaned.values[..., ::-1]} if isinstance(scene, SarImage) else {"frames": cleaned.frames}
    return replace(found, result=replace(scene, metadata=metadata, **data), sheets=sheets, left=left)


def _turned_back(sheet: Any) -> Any:
    """A `DetectedSheet` at its height in the scene as it is."""
    along_x, along_y = sheet.tilt_deg
    return replace(sheet, height=-sheet.height, tilt_deg=(-along_x, -along_y))
