"""What the phases of an image need and tell, wherever shapes are found by them."""

from collections.abc import Iterator

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_record
from millisight.core.errors import InputError
from millisight.data import Instances, Mask, SarImage
from millisight.perception import HIGH_BAND, check_mask_of, without_sheets
from millisight.perception.segmentation._heights import pixel_sides, tells_height
from millisight.perception.segmentation._parts import parts_of

_SEEN = 0.3  # sine of the angle from above up to which the pixels must hold the phases
_LEAST_AREA = 5e-5  # of a part that is looked at [m²]
_SIGN = 0.3  # of the power, by which one sign must agree better than the other


def cleaned_under(mask: Mask, image: SarImage, *, covered: bool) -> SarImage | None:
    """An image without sheets; None where the mask is empty, or its echoes tell no heights.

    Raises
    ------
    InputError
        The mask is on other pixels than the image, or those of several objects.
    """
    if isinstance(mask, Instances):
        raise InputError("mask is Instances; expected the Mask of one: pass each of its masks")
    checked_record(mask, Mask, name="mask")
    checked_record(image, SarImage, name="image")
    check_mask_of(mask, image)
    cleaned = without_sheets(image, frequency=HIGH_BAND, covered=covered)
    return cleaned if mask.inside.any() and tells_height(mask.inside, cleaned) else None


def wavenumber_of(image: SarImage) -> float:
    """Of an image, there and back [rad/m]."""
    return 4 * np.pi * (image.frequency or HIGH_BAND) / SPEED_OF_LIGHT


def why_no_forms(image: SarImage) -> str:
    """Why an image tells nothing of what is round or flat, in words; "" where it may.

    It must be complex, and its pixels fine enough for the phases of what is seen up to 17 degrees from above.
    """
    checked_record(image, SarImage, name="image")
    if not np.iscomplexobj(image.values) or not image.values.imag.any():
        return "it has magnitudes alone, and no phases"
    if min(image.values.shape) < 2:
        return "it has a single slice or row"
    if image.seen_from == "beside":
        return "its antennas lie beside it; turn the frame so that the radar looks along z"
    widest, half_turn = max(pixel_sides(image)), np.pi / (wavenumber_of(image) * _SEEN)
    if widest > half_turn:
        return f"its pixels of {1e3 * widest:.2g} mm are too coarse; form it with {1e3 * half_turn:.2g} mm or less"
    return ""


def reaches_edge(inside: np.ndarray) -> bool:
    """Whether an outline (A, B) lies at the picture's edge."""
    return bool(inside[[0, -1]].any() or inside[:, [0, -1]].any())


def parts_to_look_at(mask: np.ndarray, image: SarImage) -> Iterator[np.ndarray]:
    """The parts (A, B) of a mask of at least half a square centimetre."""
    parts, _ = parts_of(mask)
    areas = np.bincount(parts.ravel())[1:] * np.prod(pixel_sides(image))
    yield from (parts == number for number in np.flatnonzero(areas >= _LEAST_AREA) + 1)


def phase_sign(turned: np.ndarray, turns: np.ndarray, image: SarImage) -> int:
    """By which sign of the wave numbers along z one slice's waves become another's: 1, -1, or 0 if neither is clear.

    Slices do not tell it where their distance is a multiple of a quarter of a wavelength: then it is known of images
    that `form_image` made.

    turned : the other slice's waves times the conjugate ones of this; turns : kz times the distance [rad]
    image : with its history
    """
    up, down = (turned * np.exp(-1j * turns)).sum().real, (turned * np.exp(1j * turns)).sum().real
    if abs(up - down) < _SIGN * np.abs(turned).sum():
        return -1 if any(step.get("step") == "form_image" for step in image.metadata.get("history", ())) else 0
    return 1 if up > down else -1
