"""Where the parts of a mask lie: how high, above what the object stands on and below the lid, and whether under it."""

from dataclasses import replace

import numpy as np

from millisight.core import checked_record, peak_place, with_step
from millisight.data import Mask, SarImage
from millisight.imaging import SheetRemoval, remove_sheets
from millisight.perception import HIGH_BAND, check_mask_of, lids_taken_before, sheets_in, without_sheets
from millisight.perception.segmentation._parts import parts_of

_ABOVE, _BELOW = 0.006, 0.008  # its support, and its lid, an object's echo is at least so far away [m]
_SUPPORT_BELOW, _SUPPORT_ABOVE = 0.01, 0.004  # its height, what is flat is a support [m]
_FALLS, _WITHIN = 0.2, 0.10  # an echo's power falls to this share within so many metres, or its height is unknown
_SEEN = 0.03  # of a side, that tells whether it does [m]
_DISTANCE = 0.25  # of an echo from the antennas above it, where it is not told: that of the published scans [m]
_NEAREST, _LEAST_SHARE = 0.1, 0.2  # that a distance is taken for [m]; of it, that a slice lies from the antennas
_LOBE, _ROUNDS = 0.018, 5  # of an echo's maximum are the heights that tell where it is [m]; in which it settles


def between(
    inside: np.ndarray,
    image: SarImage,
    *,
    support: float | None = None,
    lid: float | None = None,
    surely: bool = False,
) -> np.ndarray:
    """The parts of a mask whose echo lies above the support and below the lid.

    The height of a part is that of the strongest slice of its power, by a parabola through the logarithms of three. Of
    one echo it is right to some millimetres, although the echo is as long as the range resolution. A part whose echo
    does not fall to a fifth of its power within 10 cm, as at 24 GHz, is kept: its height is unknown. Where a lid's
    height is known, the image tells heights.

    Where the support is unknown and nothing would be left below the lid, what was taken for the lid may be a floor, or
    its leftovers outshine what lies below, and all parts are kept, unless the lid is known `surely`.

    Parameters
    ----------
    inside : (X, Y) bool, on the image's pixels
    image : with sheets taken off
    support, lid : their heights z [m]; None: unknown
    surely : whether nothing may be left

    Returns
    -------
    (X, Y) bool
    """
    if (support is None and lid is None) or not inside.any():
        return inside
    parts, count = parts_of(inside)
    numbers, power = parts[inside], np.square(image.magnitude[inside], dtype=float)
    of_parts = np.stack([np.bincount(numbers, weights=one, minlength=count + 1) for one in power.T], axis=1)
    heights, z = [None, *(_height(one, image.grid.z, surely=lid is None) for one in of_parts[1:])], image.grid.z
    high = np.array(
        [
            support is None or h is None or h + _lowered(one, z) >= support + _ABOVE
            for h, one in zip(heights, of_parts, strict=True)
        ]
    )
    # The lid's height is read without regard to the growth, too.
    low = np.array([lid is None or h is None or h <= lid - _BELOW for h in heights])
    if support is None and not surely and not low[1:].any():
        return inside
    return inside & (high & low)[parts]


def beneath(
    inside: np.ndarray, image: SarImage, removal: SheetRemoval[SarImage], *, surely: bool = False
) -> np.ndarray:
    """The parts of a mask whose middle lies under some sheet that was taken off; all where none was.

    Beside a lid lie its edges, the walls below them, and its grating lobes.

    Parameters
    ----------
    inside : (X, Y) bool, on the image's pixels
    image : in which the sheets were found
    removal : of the sheets
    surely : whether nothing may be left; else all parts are kept then: what was taken for the lid may be a floor

    Returns
    -------
    (X, Y) bool
    """
    from scipy.ndimage import center_of_mass

    under = np.zeros_like(inside)
    for sheet in removal.sheets:
        under |= sheet.box_on(image.grid.xy)
    if not inside.any() or not under.any():
        return inside
    parts, count = parts_of(inside)
    middles = np.rint(center_of_mass(inside, parts, np.arange(1, count + 1))).astype(int)
    kept = np.concatenate([[False], under[tuple(middles.T)]])
    return inside & kept[parts] if surely or kept.any() else inside


def tells_height(inside: np.ndarray, image: SarImage) -> bool:
    """Whether the power of what a mask (X, Y) covers falls to a fifth above and below its maximum, as at 77 GHz."""
    power = _power_under(inside, image)
    return bool(power.any()) and _height(power, image.grid.z) is not None


def tells_depths(image: SarImage, cleaned: SarImage) -> bool:
    """Whether the power of a whole image, with its sheets or without them, tells how high what it shows lies."""
    everywhere = np.ones(image.grid.xy.shape, bool)
    return any(tells_height(everywhere, one) for one in (image, cleaned))  # of the lid, most of the time


def height_of(mask: Mask, image: SarImage, *, covered: bool = False) -> float | None:
    """How high the strongest echo under a mask lies.

    Parameters
    ----------
    mask : Mask
    image : in which it was found, on the same pixels; lids and cloths are taken off
    covered : whether a lid is known to lie over the scene

    Returns
    -------
    float or None
        z [m]; None where the mask is empty, or the echo does not fall to a fifth within 10 cm above and below, as at
        24 GHz: its height is unknown then.

    Raises
    ------
    InputError
        The mask is on other pixels than the image.
    """
    check_mask_of(checked_record(mask, Mask, name="mask"), checked_record(image, SarImage, name="image"))
    cleaned, z = without_sheets(image, frequency=HIGH_BAND, covered=covered), image.grid.z
    power = _power_under(mask.inside, cleaned)
    if not power.any() or _height(power, z) is None:
        return None
    about = float(z[power.argmax()])
    return echo_height(power / growth_with_distance(z, about, distance_of(cleaned, about)), z)


def lid_height(image: SarImage, removal: SheetRemoval[SarImage], *, before: bool = False) -> float | None:
    """z of the highest sheet that was taken off an image [m]; None where none was, or its height is unknown.

    It is known where the power falls to a fifth below it, by the median where the sheet is seen. Above it lie its
    grating lobes, which may be as bright. Of sheets that were taken off `before`, it is known where the image tells
    heights.
    """
    if before:
        known = tells_height(np.ones(image.grid.xy.shape, bool), image)
        return max((sheet.height for sheet in removal.sheets), default=None) if known else None
    heights, z = [], image.grid.z
    for sheet in removal.sheets:
        box = sheet.box_on(image.grid.xy)
        below = (z < sheet.height) & (z >= sheet.height - _WITHIN)
        if box.any() and below.any() and np.ptp(z[below]) >= _SEEN:
            power = np.median(np.square(image.magnitude[box], dtype=float), axis=0)
            if power[below].min() < _FALLS * power[abs(z - sheet.height).argmin()]:
                heights.append(sheet.height)
    return max(heights, default=None)


def lid_over(image: SarImage, cleaned: SarImage) -> tuple[SheetRemoval[SarImage], float | None]:
    """The sheets of a covered scene that were taken off now or before, and the lid's height z [m], if it is known.

    Parameters
    ----------
    image : as it was given
    cleaned : by `without_sheets`
    """
    before = cleaned is image
    taken = lids_taken_before(image) if before else sheets_in(image, frequency=HIGH_BAND, covered=True)
    return taken, lid_height(image, taken, before=before)


def without_support(image: SarImage, support: float) -> SarImage:
    """An image in sight without the echo of what the objects stand on, at a known height z [m].

    What is flat and largest is taken off, where it lies there, as a table or a plate does; else the image is as it was.
    """
    removal = remove_sheets(image, frequency=image.frequency or HIGH_BAND, clutter="lid", most=1)
    height = lid_height(image, removal)
    if height is None or not -_SUPPORT_BELOW <= height - support <= _SUPPORT_ABOVE:
        return image
    return replace(removal.result, metadata=with_step(image.metadata, "remove_support", support=support, height=height))


def pixel_sides(image: SarImage) -> list[float]:
    """Sides of a pixel of an image seen along z [m]."""
    return [float(np.ptp(axis)) / max(len(axis) - 1, 1) for axis in (image.grid.x, image.grid.y)]


def peak_height(power: np.ndarray, z: np.ndarray) -> float:
    """Of the maximum of power (Z,), not 0, over z, by a parabola through the logarithms of three [m]."""
    return peak_place(np.log(np.maximum(power, 1e-30 * power.max())), z)


def echo_height(power: np.ndarray, z: np.ndarray) -> float:
    """Of the maximum of an echo's power (Z,), not 0, over z, by a parabola through all logarithms near it [m].

    An echo is as long as the range resolution, some centimetres, and so flat at its maximum that an image's error of
    0.3 % moves that of three slices by a millimetre.
    """
    heights = np.log(np.maximum(power, 1e-30 * power.max()))
    found = start = peak_place(heights, z)
    reach = max(_LOBE, 1.5 * float(np.diff(z).min())) if len(z) > 1 else _LOBE
    for _ in range(_ROUNDS):
        away = (z - found) / reach
        weights = np.maximum(1 - np.square(away), 0) * power
        if np.count_nonzero(weights) < 3:
            return start
        terms = away[:, None] ** np.arange(3)
        _, slope, bend = np.linalg.lstsq(terms.T @ (terms * weights[:, None]), terms.T @ (weights * heights))[0]
        step = -0.5 * slope / bend * reach if bend < 0 else np.inf
        if abs(found + step - start) > _LOBE / 2:  # of two echoes
            return start
        found += step
    return found


def distance_of(image: SarImage, height: float) -> float:
    """From the antennas of an image, above it, down to a height [m]."""
    return _DISTANCE if image.antennas is None else max(float(image.antennas[:, 2].mean()) - height, _NEAREST)


def growth_with_distance(z: np.ndarray, about: float, distance: float = _DISTANCE) -> np.ndarray:
    """(Z,) power in slices at z over that at a height, which is so far from the antennas above, of the same waves [m].

    Antennas weigh alike in an image, and so waves of one direction get stronger with the distance from them, in
    proportion. It would show an echo as long as 5 cm some 3 mm too low.
    """
    return np.square(np.maximum(1 - (z - about) / distance, _LEAST_SHARE))


def _power_under(inside: np.ndarray, image: SarImage) -> np.ndarray:
    """(Z,) power of what a mask (X, Y) covers."""
    return np.square(image.magnitude[inside], dtype=float).sum(axis=0)


def _lowered(power: np.ndarray, z: np.ndarray) -> float:
    """By how much a maximum of power (Z,) lies too low for the growth with the distance [m]."""
    even = power / growth_with_distance(z, z[power.argmax()])
    return peak_height(even, z) - peak_height(power, z)


def _height(power: np.ndarray, z: np.ndarray, *, surely: bool = True) -> float | None:
    """Of the maximum of power (Z,) over z [m]; None where it falls too little, and it must be sure."""
    top = int(power.argmax())
    near = abs(z - z[top]) <= _WITHIN + 1e-9
    sides = near & (z < z[top]), near & (z > z[top])
    told = [power[side].min() < _FALLS * power[top] for side in sides if side.any() and np.ptp(z[side]) >= _SEEN]
    if surely and not (told and all(told)):
        return None
    return peak_height(power, z)
