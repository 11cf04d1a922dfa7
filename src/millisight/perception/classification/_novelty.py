"""How unlike an image is to those that the classifier learned from: one score of all that is known, and reasons.

The score is the largest of these, each from 0 to 1 and so scaled that each alone refuses an answer at the same limit:

- the network's own, the probability of the class of what is of no class, from the pixels under the mask;
- of the scan, as far as the image tells it: its widest step in wavelengths;
- of the picture, where the image tells no steps: how bright it is beside the mask, which a sparse scan's ghosts fill;
- of the mask: whether it covers what a lid would be, if one were known to be there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.data import Mask, SarImage
from millisight.perception import HIGH_BAND, LOW_BAND, sheets_in

# Of each: what counts for nothing, what is at the limit, what is surely novel.
_STEPS = 0.85, 1.1, 2.0  # wavelengths; training has 0.55 to 0.85
_BESIDE = -20.0, -12.0, -4.0  # median beside the mask over the mean under it [dB]
_LID = 0.0, 0.5, 1.0

_ALIKE = 0.5, 0.8  # intersection over union of a mask with a sheet's box
_LARGE = 0.01, 0.03  # of a sheet [m²]
_BELOW = 0.08, 0.25  # share of the echo under the mask that lies lower than the sheet
_DEEP = 0.03  # below a sheet: not its own echo any more [m]
_LEAST = 0.004  # of a mask that may be a lid's [m²]
_AROUND = 0.01  # beside the mask belongs to it [m]
_LEAST_BESIDE = 0.2  # of a picture


class Evidence(NamedTuple):
    """That an image is novel.

    Attributes
    ----------
    score : 0 to 1
    reason : in words
    """

    score: float
    reason: str


def novelty(
    image: SarImage,
    mask: Mask,
    *,
    other_band: SarImage | None,
    cleaned: SarImage,
    by_network: float,
    limit: float,
) -> tuple[float, tuple[str, ...]]:
    """The score, 0 to 1, and in words what is above the limit, the strongest first.

    Parameters
    ----------
    image : of 77 GHz
    mask : on the image's pixels, not empty
    other_band : an image of the same place by the other radar, or None
    cleaned : the image without its sheets
    by_network : the network's own score
    limit : of the score, above which an answer is not sure
    """
    found = [Evidence(by_network, "unlike anything it was trained on")]
    steps = _steps_of(((image, HIGH_BAND), (other_band, LOW_BAND)))
    if image.steps:
        reason = f"the scan is too sparse: steps of {steps:.1f} wavelengths"
        found.append(Evidence(_scaled(steps, _STEPS, limit), reason))
    else:
        beside = beside_db(cleaned, mask)
        reason = "the picture is bright beside the mask, as of a scan too sparse"
        found.append(Evidence(_scaled(beside, _BESIDE, limit), reason))
    reason = "the mask looks like a lid, or like the flat top of something large"
    found.append(Evidence(_scaled(lid_likeness(image, mask), _LID, limit), reason))
    found.sort(key=lambda one: -one.score)
    return found[0].score, tuple(one.reason for one in found if one.score > limit)


def _scaled(value: float, marks: tuple[float, float, float], limit: float) -> float:
    """0 at the first mark, the limit at the second, 1 at the third."""
    return float(np.interp(value, marks, (0.0, limit, 1.0)))


def _steps_of(images: Sequence[tuple[SarImage | None, float]]) -> float:
    """The widest step of scans in wavelengths; 0 where no image tells it."""
    ratios = [
        step * (image.frequency or band) / SPEED_OF_LIGHT
        for image, band in images
        if image is not None
        for step in image.steps
    ]
    return max(ratios, default=0.0)


def beside_db(image: SarImage, mask: Mask) -> float:
    """The median power of the pixels beside a mask over the mean under it [dB]; -inf where too little lies beside.

    A sparse scan's ghosts fill a picture. In a full one most pixels beside an object hold next to nothing.

    Parameters
    ----------
    image : without its sheets
    mask : on the image's pixels
    """
    from scipy.ndimage import binary_dilation

    inside = mask.inside
    steps = [float(np.diff(axis).mean()) if len(axis) > 1 else np.inf for axis in (mask.grid_xy.x, mask.grid_xy.y)]
    around = max(1, round(_AROUND / min(steps)))
    beside = ~np.asarray(binary_dilation(inside, iterations=around), dtype=bool)
    if beside.mean() < _LEAST_BESIDE:
        return -np.inf
    power = (image.magnitude.astype(np.float64) ** 2).sum(axis=2)
    under = power[inside].mean()
    ratio = np.median(power[beside]) / under if under > 0 else 0.0
    return 10 * float(np.log10(ratio)) if ratio > 0 else -np.inf


def lid_likeness(image: SarImage, mask: Mask) -> float:
    """How much a mask covers what a lid would be, if one were known to be there: 0 to 1.

    What is flat and alike the mask is a lid rather than an object's top where it is large, or where there are echoes
    below it. 0 where a lid was known to be there, and taken off.

    Parameters
    ----------
    image : as it was formed
    mask : on the image's pixels
    """
    inside = mask.inside
    if 1 in inside.shape or _lid_was_known(image):
        return 0.0
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    pixel = float(np.diff(mask.grid_xy.x).mean() * np.diff(mask.grid_xy.y).mean())
    box = (np.ptp(rows) + 1) * (np.ptp(columns) + 1)
    if inside.sum() * pixel < _LEAST or inside.sum() < _ALIKE[0] * box:
        return 0.0
    power = (image.magnitude[inside].astype(np.float64) ** 2).sum(axis=0)
    most = 0.0
    for sheet in sheets_in(image, frequency=HIGH_BAND, covered=True).sheets:
        over = sheet.box_on(mask.grid_xy)
        alike = np.interp((inside & over).sum() / (inside | over).sum(), _ALIKE, (0, 1))
        below = power[image.grid.z < sheet.height - _DEEP].sum() / max(power.sum(), 1e-300)
        most = max(most, float(alike * max(np.interp(sheet.area, _LARGE, (0, 1)), np.interp(below, _BELOW, (0, 1)))))
    return most


def _lid_was_known(image: SarImage) -> bool:
    steps = image.metadata.get("history", ())
    return any(step.get("step") == "remove_sheets" and step.get("clutter") == "lid" for step in steps)
