"""Projection: an image seen along z as a coloured picture, which is what segmenters look at.

A picture's first two axes are an image's x and y, in this order and direction: pixel [i, j] lies at (x_i, y_j). Nothing
is transposed for display, so that a mask on the picture is a mask on the image's grid. Of a photo they are row and
column.
"""

import numpy as np

from millisight.errors import InputError, UnknownNameError
from millisight.imaging.grid import PixelGrid
from millisight.imaging.image import SarImage
from millisight.records import as_array, checked_array, checked_record, put, record

VALUES = ("mean", "max", "rms")
"""What becomes of |I| along z."""


@record
class Picture:
    """A picture to segment: of a radar image, or a photo.

    Attributes
    ----------
    rgb : (A, B, 3) uint8
    power : (A, B) float32 in [0, 1], what was coloured: |I| seen along z over its maximum; None: a photo
    grid_xy : PixelGrid, where the pixels are; None: a photo
    image : what was projected; None: a photo
    other_band : the same scene at the radar's other frequency, on a grid of its own; None: there is none
    """

    rgb: np.ndarray
    power: np.ndarray | None = None
    grid_xy: PixelGrid | None = None
    image: SarImage | None = None
    other_band: SarImage | None = None

    def __post_init__(self) -> None:
        rgb = checked_array(self.rgb, name="rgb", shape=("A", "B", 3), dtype=np.uint8)
        put(self, rgb=rgb)
        if self.power is not None:
            power = checked_array(self.power, name="power", shape=rgb.shape[:2], dtype=np.float32)
            if power.min() < 0 or power.max() > 1:
                raise InputError(f"power runs from {power.min():g} to {power.max():g}; expected 0 to 1")
            put(self, power=power)
        if self.grid_xy is not None and checked_record(self.grid_xy, PixelGrid, name="grid_xy").shape != rgb.shape[:2]:
            raise InputError(f"grid_xy has {self.grid_xy.shape} pixels, rgb {rgb.shape[:2]}; expected the same")
        for name in ("image", "other_band"):
            if getattr(self, name) is not None:
                checked_record(getattr(self, name), SarImage, name=name)

    @property
    def shape(self) -> tuple[int, int]:
        """(A, B) pixels along each of its first two axes."""
        return self.rgb.shape[0], self.rgb.shape[1]


def project(
    image: SarImage, *, other_band: SarImage | None = None, values: str = "mean", colours: str = "jet"
) -> Picture:
    """An image seen along z, coloured; as published, the mean of |I| in the colours of the rainbow (paper section 6.1).

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
    if values not in VALUES:
        raise UnknownNameError("projection", values, VALUES)
    magnitude = image.magnitude
    seen = np.sqrt((magnitude**2).mean(axis=2)) if values == "rms" else image.project(reduce=values)
    peak = float(seen.max())
    power = np.zeros(seen.shape, np.float32) if peak == 0 else (seen / seen.dtype.type(peak)).astype(np.float32)
    return Picture(rgb=coloured(power, colours), power=power, grid_xy=image.grid.xy, image=image, other_band=other_band)


def coloured(values: np.ndarray, colours: str = "jet") -> np.ndarray:
    """(A, B, 3) uint8 colours of (A, B) values from 0 to 1.

    Raises
    ------
    InputError
        No colour map goes by that name, or `values` is not (A, B).
    """
    import matplotlib

    shares = as_array(values, name="values", shape=("A", "B"), dtype=np.float32)
    try:
        colour_map = matplotlib.colormaps.get_cmap(colours)
    except (ValueError, TypeError) as error:
        raise InputError(f"no colour map goes by {colours!r}; try 'jet', 'inferno' or 'gray'") from error
    return np.ascontiguousarray(colour_map(shares, bytes=True)[..., :3])


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
            f"the pictures have no place in common: x {wanted.x[0]:.4g} to {wanted.x[-1]:.4g} m and y "
            f"{wanted.y[0]:.4g} to {wanted.y[-1]:.4g} m here, x {grid.x[0]:.4g} to {grid.x[-1]:.4g} m and y "
            f"{grid.y[0]:.4g} to {grid.y[-1]:.4g} m in the other; image both bands on one grid"
        )
    return np.clip(along_x @ power @ along_y.T, 0, 1)


def _interpolation(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(w, k) float32 weights of linear interpolation from `known` to `wanted` coordinates; rows of 0 outside."""
    unit = np.eye(len(known))
    return np.stack([np.interp(wanted, known, row, left=0, right=0) for row in unit], axis=1).astype(np.float32)
