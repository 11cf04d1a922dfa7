"""What is taken off a finished image: slices that show something else, and the empty scene. Each is image -> image."""

import numpy as np

from millisight.core import checked_integer, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import SarImage, VoxelGrid, grid_difference


def crop_slices(image: SarImage, *, low: int = 0, high: int = 0) -> SarImage:
    """The image without its lowest and highest slices along z: for example the table under the object or the arm above
    it.

    The published evaluation takes off the lowest 12 and the highest 7 of 77 GHz images, or 17 and 3, in experiment 1.

    Raises
    ------
    InputError
        No slice would be left.
    """
    checked_record(image, SarImage, name="image")
    low = checked_integer(low, name="low", minimum=0)
    high = checked_integer(high, name="high", minimum=0)
    count = len(image.grid.z)
    if low + high >= count:
        raise InputError(f"{low} slices below and {high} above are to go, of {count}; expected at least one to stay")
    kept = slice(low, count - high)
    return SarImage(
        grid=VoxelGrid(x=image.grid.x, y=image.grid.y, z=image.grid.z[kept]),
        values=image.values[:, :, kept],
        metadata=with_step(image.metadata, "crop_slices", low=low, high=high),
    )


def subtract_empty(image: SarImage, empty: SarImage) -> SarImage:
    """The image less the magnitude of the empty scene's, phases kept: max(|I| - |E|, 0) exp(i arg I).

    Subtracted frames do better (`subtract_background`); this is for scenes whose frames are not at hand, or whose
    positions do not repeat. The published code keeps negative differences, which a magnitude shows as bright.

    Raises
    ------
    InputError
        The two grids differ.
    """
    checked_record(image, SarImage, name="image")
    checked_record(empty, SarImage, name="empty")
    if differs := grid_difference(image.grid, empty.grid, within=0):
        raise InputError(f"the two images' grids differ along {differs}; image both on one grid, or crop them alike")
    magnitude = image.magnitude
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(magnitude > 0, np.maximum(1 - empty.magnitude / magnitude, 0), 0)
    return SarImage(
        grid=image.grid,
        values=(image.values * share).astype(image.values.dtype),
        metadata=with_step(image.metadata, "subtract_empty", empty=dict(empty.metadata)),
    )
