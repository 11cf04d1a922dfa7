"""What lies over the object in an image, such as the lid of a carton: where it is, and how to look under it."""

import numpy as np

from millisight.core import check_known, checked_array, checked_number, put, record
from millisight.data import SarImage
from millisight.imaging import CLUTTER, DetectedSheet, remove_sheets, sheets_told
from millisight.perception import HIGH_BAND, LOW_BAND
from millisight.viz.viewer._levels import FLOOR_DB, Levels, levels_of

MOST_SEARCHED = 8_000_000
"""Voxels of an image in which a lid is looked for unasked: some seconds."""

_LEAST_DEPTH = 0.005  # under a lid, where the depth range begins [m]


@record
class Cover:
    """A lid over an object.

    Attributes
    ----------
    lid : its height, z [m]
    ceiling : where the depth range begins under it, tilt and slices considered, z [m]
    top_db : the strongest voxel under the ceiling, under the maximum of the image without the lid's echo [dB]
    extent : (2, 2) corners of the box around where it is seen, x and y [m]
    levels : of the image without the lid's echo; None: the image has it no more
    """

    lid: float
    ceiling: float
    top_db: float
    extent: np.ndarray
    levels: Levels | None

    def __post_init__(self) -> None:
        put(
            self,
            lid=checked_number(self.lid, name="lid", unit="m"),
            ceiling=checked_number(self.ceiling, name="ceiling", unit="m"),
            top_db=checked_number(self.top_db, name="top_db", unit="dB", minimum=FLOOR_DB),
            extent=checked_array(self.extent, name="extent", shape=(2, 2), unit="m"),
        )


def cover_of(image: SarImage, clutter: str, *, low_band: bool = False) -> Cover | None:
    """The lid over the object in an image; None where there is none.

    An image whose history tells of sheets that were taken off is believed. In others `remove_sheets` looks for them.
    A sheet is a lid where the strongest of what is left lies under it; a table lies under it, and is none.

    Parameters
    ----------
    image : SarImage
    clutter : "auto": look in images of at most `MOST_SEARCHED` voxels; "lid": in all, and take what is less sure;
        "none": do not look, and do not believe
    low_band : it is of 24 GHz, and not of 77

    Raises
    ------
    UnknownNameError
    """
    check_known("clutter", clutter, CLUTTER)
    if clutter == "none":
        return None
    sheets, cleaned = [*sheets_told(image.metadata)], image
    if not sheets:
        if clutter == "auto" and image.grid.size > MOST_SEARCHED:
            return None
        found = remove_sheets(image, clutter=clutter, frequency=LOW_BAND if low_band else HIGH_BAND)
        sheets, cleaned = [*found.sheets], found.result
    levels = levels_of(cleaned.grid, cleaned.values)
    if not sheets or levels.peak == 0:
        return None
    z = cleaned.grid.z
    object_z = float(z[int(levels.db.max(axis=(0, 1)).argmax())])
    margin = max(_LEAST_DEPTH, float(np.diff(z).mean()) / 2 if len(z) > 1 else 0.0)
    over = [(sheet.height - _rise(sheet) - margin, sheet) for sheet in sheets]
    ceiling, lid = min((one for one in over if one[0] >= object_z), key=lambda one: one[0], default=(0.0, None))
    if lid is None:
        return None
    return Cover(
        lid=lid.height,
        ceiling=ceiling,
        top_db=float(levels.db[:, :, z <= ceiling].max()),
        extent=np.array([lid.lower, lid.upper]),
        levels=None if cleaned is image else levels,
    )


def _rise(sheet: DetectedSheet) -> float:
    """By how much a tilted sheet reaches under its middle [m]."""
    slopes = np.tan(np.radians(sheet.tilt_deg))
    return float(np.abs(slopes) @ (np.array(sheet.upper) - np.array(sheet.lower)) / 2)
