"""Pictures for segmenters: an image projected along z and coloured, or a photo.

A picture's first two axes are an image's x and y, in this order and direction: pixel [i, j] lies at (x_i, y_j). Nothing
is transposed for display, so that a mask on the picture is a mask on the image's grid. Of a photo they are row and
column.
"""

from typing import Literal

import numpy as np

from millisight.core import PUBLISHED_COLORMAP, as_array, check_known, checked_colormap, checked_record
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Mask, Picture, SarImage, grid_difference

VALUES = ("mean", "max", "rms")
"""Projections of |I| along z."""


def project(
    image: SarImage,
    *,
    other_band: SarImage | None = None,
    values: Literal["mean", "max", "rms"] | str = "mean",
    colours: str = PUBLISHED_COLORMAP,
) -> Picture:
    """An image projected along z and coloured; as published, the mean of |I| with "jet" (paper section 6.1).

    Parameters
    ----------
    image : SarImage
    other_band : the same scene at the radar's other frequency; it goes with the picture as it is
    values : along z the "mean" of |I|, its "max", or its "rms"
    colours : name of Matplotlib's colour map, such as "jet", "inferno" or "gray"

    Returns
    -------
    Picture
        Its power is relative to its own maximum; of an image that is 0 everywhere it is 0.

    Raises
    ------
    InputError
        A record of another kind, or no colour map of that name.
    UnknownNameError
        No such `values`.
    """
    checked_record(image, SarImage, name="image")
    check_known("projection", values, VALUES)
    magnitude = image.magnitude
    seen = np.sqrt((magnitude**2).mean(axis=2)) if values == "rms" else image.project(reduce=values)
    peak = float(seen.max())
    power = np.zeros(seen.shape, np.float32) if peak == 0 else (seen / seen.dtype.type(peak)).astype(np.float32)
    return Picture(rgb=coloured(power, colours), power=power, grid_xy=image.grid.xy, image=image, other_band=other_band)


def photo(frame: CameraFrame) -> Picture:
    """The picture of a camera, to be segmented: its pixels are [row, column]."""
    return Picture(rgb=checked_record(frame, CameraFrame, name="frame").rgb)


def coloured(values: np.ndarray, colours: str = PUBLISHED_COLORMAP) -> np.ndarray:
    """(A, B, 3) uint8 colours of (A, B) values from 0 to 1.

    Raises
    ------
    InputError
        No colour map goes by that name, or `values` is not (A, B).
    """
    shares = as_array(values, name="values", shape=("A", "B"), dtype=np.float32)
    return np.ascontiguousarray(checked_colormap(colours)(shares, bytes=True)[..., :3])


def power_on(other: Picture, picture: Picture) -> np.ndarray:
    """(A, B) float32, the power of `other` at the pixels of `picture`: interpolated, and 0 where it does not reach.

    Raises
    ------
    InputError
        One of them is a photo, or they have no place in common.
    """
    grid, power, wanted = other.grid_xy, other.power, picture.grid_xy
    if grid is None or power is None or wanted is None:
        raise InputError("one of the two pictures is a photo; expected projections of radar images, with their grids")
    along_x, along_y = _interpolation(grid.x, wanted.x), _interpolation(grid.y, wanted.y)
    if not (along_x.any() and along_y.any()):
        raise InputError(
            f"the pictures do not overlap: x {wanted.x[0]:.4g} to {wanted.x[-1]:.4g} m and y "
            f"{wanted.y[0]:.4g} to {wanted.y[-1]:.4g} m here, x {grid.x[0]:.4g} to {grid.x[-1]:.4g} m and y "
            f"{grid.y[0]:.4g} to {grid.y[-1]:.4g} m in the other; image both bands on one grid"
        )
    return np.clip(along_x @ power @ along_y.T, 0, 1)


def _interpolation(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(w, k) float32 weights of linear interpolation from `known` to `wanted` coordinates; rows of 0 outside."""
    unit = np.eye(len(known))
    return np.stack([np.interp(wanted, known, row, left=0, right=0) for row in unit], axis=1).astype(np.float32)


def check_mask_of(mask: Mask, image: SarImage) -> None:
    """The mask must lie on the image's pixels; `InputError` otherwise, which tells the axis that differs."""
    differs = grid_difference(mask.grid_xy, image.grid.xy)
    if differs:
        raise InputError(
            f"the mask's pixels and the image's differ along {differs}; expected one grid: make the mask of this image"
        )
