"""Pictures for segmenters: a coloured projection of an image, or a photo."""

import numpy as np

from millisight.core import checked_array, checked_record, put, record
from millisight.core.errors import InputError
from millisight.data._grid import PixelGrid
from millisight.data._image import SarImage


@record
class Picture:
    """A picture to segment: of a radar image, or a photo.

    Attributes
    ----------
    rgb : (A, B, 3) uint8
    power : (A, B) float32 in [0, 1], the projection of |I| along z, relative to its maximum; None: a photo
    grid_xy : PixelGrid, positions of the pixels; None: a photo
    image : the projected image; None: a photo
    other_band : the same scene at the radar's other frequency, on its own grid, or None
    covered : whether a lid or a cloth is known to lie over the scene
    support : height of what the objects stand on [m]; None: unknown
    """

    rgb: np.ndarray
    power: np.ndarray | None = None
    grid_xy: PixelGrid | None = None
    image: SarImage | None = None
    other_band: SarImage | None = None
    covered: bool = False
    support: float | None = None

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

    def __repr__(self) -> str:
        kind = (
            "photo" if self.grid_xy is None else "radar image" if self.other_band is None else "radar image, two bands"
        )
        return f"Picture({self.shape[0]} x {self.shape[1]} pixels, {kind})"

    @property
    def shape(self) -> tuple[int, int]:
        """(A, B) pixels along each of its first two axes."""
        return self.rgb.shape[0], self.rgb.shape[1]
