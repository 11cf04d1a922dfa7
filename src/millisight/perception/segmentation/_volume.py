"""From a mask on the image seen along z to its voxels: at each pixel the depths at which the echo stands out.

A point reflector has about half its power half a range resolution away, so an echo is given the depths around its
maximum with half its power at least, as the width of a peak is measured. A lid above or a support below is as bright
beside the mask as within it: at each depth the median of the power beside the mask is subtracted, which is that of what
covers most of the picture. Range side lobes and stray echoes that remain are not connected with the object, or hold
little of its power.
"""

import numpy as np

from millisight.core import checked_number, checked_record, put, record, widths_in_samples
from millisight.core.errors import InputError
from millisight.data import Mask, SarImage, VolumeMask, grid_difference
from millisight.perception import HIGH_BAND, without_sheets


@record
class VolumeSettings:
    """How deep an object reaches in an image; the defaults suit 77 GHz images of the virtual rig.

    Attributes
    ----------
    smoothing : standard deviation of the Gaussian by which power is averaged along x and y first [m]; and the distance
        from the mask from which on pixels are beside it
    beside : percentile of the power beside the mask that is subtracted at each depth
    drop_db : below a pixel's maximum, to which its depths reach
    dimmest_db : below the mean of the pixels' maximal power, of a pixel with depths
    smallest : of a connected part, as a share of the power of the strongest one
    """

    smoothing: float = 0.0075
    beside: float = 50.0
    drop_db: float = 3.0
    dimmest_db: float = 6.0
    smallest: float = 0.1

    def __post_init__(self) -> None:
        put(
            self,
            smoothing=checked_number(self.smoothing, name="smoothing", unit="m", minimum=0),
            drop_db=checked_number(self.drop_db, name="drop_db", unit="dB", minimum=0),
            dimmest_db=checked_number(self.dimmest_db, name="dimmest_db", unit="dB", minimum=0),
            beside=checked_number(self.beside, name="beside", minimum=0),
            smallest=checked_number(self.smallest, name="smallest", minimum=0),
        )
        if self.beside > 100:
            raise InputError(f"beside is {self.beside:g}; expected a percentile, from 0 to 100")
        if self.smallest > 1:
            raise InputError(f"smallest is {self.smallest:g}; expected a share, from 0 to 1")


def extend_mask(mask: Mask, image: SarImage, *, settings: VolumeSettings | None = None) -> VolumeMask:
    """Give a mask seen along z its depths: the voxels of the object.

    1. Sheets are taken off the image (`remove_sheets`), and its power is averaged along x and y.
    2. At each depth the median of the power beside the mask is subtracted.
    3. Each pixel of the mask gets the depths around its strongest voxel with half its power at least. Pixels more
       than 6 dB dimmer than the mean get none.
    4. Of the parts connected in three dimensions, by faces, edges or corners, the strongest is kept, and others with at
       least a tenth of its power.

    The voxels are those whose echo is seen: the front of the object, about a range resolution thick. What lies below it
    returns no echo of its own.

    Parameters
    ----------
    mask : Mask, as of `segment`
    image : on the same pixels
    settings : VolumeSettings; None: the defaults

    Returns
    -------
    VolumeMask
        On the image's grid; empty where the mask is, or where nothing in it stands out.

    Raises
    ------
    InputError
        The mask lies on other pixels than the image.
    """
    from scipy.ndimage import label

    inside = checked_record(mask, Mask, name="mask").inside
    grid = checked_record(image, SarImage, name="image").grid
    settings = VolumeSettings() if settings is None else checked_record(settings, VolumeSettings, name="settings")
    differs = grid_difference(grid, mask.grid_xy)
    if differs:
        raise InputError(f"the image and the mask have different pixels, along {differs}; segment this image")
    power = _power_above_beside(image, inside, settings)
    strongest = power.max(axis=2)
    if not strongest.any():
        return VolumeMask(grid=grid, inside=np.zeros(grid.shape, bool))
    seen = (strongest > 0) & (strongest >= strongest[inside].mean() * 10 ** (-settings.dimmest_db / 10))
    found = seen[..., None] & _around_maximum(power, strongest * 10 ** (-settings.drop_db / 10))
    parts, count = label(found, structure=np.ones((3, 3, 3)))
    held = np.bincount(parts.ravel(), weights=(power * found).ravel(), minlength=count + 1)
    kept = held >= settings.smallest * held.max()
    return VolumeMask(grid=grid, inside=found & kept[parts])


def _power_above_beside(image: SarImage, inside: np.ndarray, settings: VolumeSettings) -> np.ndarray:
    """(X, Y, Z) averaged power within the mask over that beside it at the same depth; 0 elsewhere."""
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    grid = image.grid
    steps = [float(np.diff(axis).mean()) if len(axis) > 1 else np.inf for axis in (grid.x, grid.y)]
    cleaned = without_sheets(image, frequency=HIGH_BAND)  # as "wave" does, whose result is kept
    power = np.square(cleaned.magnitude, dtype=float)
    power = np.asarray(gaussian_filter(power, [*widths_in_samples(settings.smoothing, grid.x, grid.y), 0]))
    if inside.any():
        sampling = [step if np.isfinite(step) else 1.0 for step in steps]
        beside = np.asarray(distance_transform_edt(~inside, sampling=sampling)) > settings.smoothing
        if beside.any():
            power = np.maximum(power - np.percentile(power[beside], settings.beside, axis=0), 0)
    return power * inside[..., None]


def _around_maximum(values: np.ndarray, lowest: np.ndarray) -> np.ndarray:
    """(X, Y, Z) bool: connected along z with each pixel's maximum by values of at least `lowest` (X, Y)."""
    depths = np.arange(values.shape[2])
    top = values.argmax(axis=2)[..., None]
    low = values < lowest[..., None]
    before = np.where(low & (depths < top), depths, -1).max(axis=2)[..., None]
    behind = np.where(low & (depths > top), depths, len(depths)).min(axis=2)[..., None]
    return (depths > before) & (depths < behind)
