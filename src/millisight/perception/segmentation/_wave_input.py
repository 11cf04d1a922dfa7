"""What the `wave` network sees of a picture: levels of both bands, of slices along z, and prompts, as channels."""

from collections.abc import Sequence

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.perception import (
    FLOOR_DB,
    HIGH_BAND,
    LOW_BAND,
    canvas_axes,
    canvas_power,
    power_levels,
    projected_levels,
    taken_db,
    without_sheets,
)

WAVE_SLICES = 8
"""Into which an image is cut along z, each seen by its brightest voxel."""
WAVE_CHANNELS = (
    "mean", *(f"slice {i}" for i in range(WAVE_SLICES)), "other", "has other", "image", "positive", "negative",
    "before", "taken",
)  # fmt: skip

WAVE_SIDE = 80
"""Pixels of a training example along x and y; smaller inputs are filled up with 0, as examples are.

The network normalises by means over its whole input (GroupNorm), so how much of it holds no image is part of what it
learned: without this, masks in images that show 2 cm around a thin tool are twice as wide as the tool.
"""

_MULTIPLE = 8  # of the input's sides: the network halves them three times
_NO_POINTS = np.zeros((0, 2), int)


def wave_input(
    power: np.ndarray,
    other: np.ndarray | None,
    points: Sequence[np.ndarray] = (_NO_POINTS, _NO_POINTS),
    *,
    before: np.ndarray | None = None,
    taken_db: float = 0.0,
) -> np.ndarray:
    """The network's input for one image.

    Parameters
    ----------
    power : (A, B, Z) on the canvas's pixels, sheets taken off
    other : (A, B, Z') of the other band on the same pixels, sheets taken off; None: there is none
    points : positive and negative prompts (n, 2), indices into A and B
    before : (A, B) levels of the projection with sheets; None: there were none
    taken_db : the maximum without sheets over that with them [dB]

    Returns
    -------
    (C, A', B') float32, channels as `WAVE_CHANNELS`; A' and B' are the next multiples of 8, `WAVE_SIDE` at least,
    filled up with 0
    """
    across, along = power.shape[:2]
    sides = (max(-(-size // _MULTIPLE) * _MULTIPLE, WAVE_SIDE) for size in (across, along))
    shape = len(WAVE_CHANNELS), *sides
    channels = np.zeros(shape, np.float32)
    inner = channels[:, :across, :along]
    inner[0] = projected_levels(power)
    inner[1 : 1 + WAVE_SLICES] = _slice_levels(power)
    if other is not None:
        inner[1 + WAVE_SLICES] = projected_levels(other)
        inner[2 + WAVE_SLICES] = 1
    inner[3 + WAVE_SLICES] = 1
    inner[6 + WAVE_SLICES] = inner[0] if before is None else before
    inner[7 + WAVE_SLICES] = np.clip(1 + taken_db / FLOOR_DB, 0, 1)
    for channel, marked in zip((4 + WAVE_SLICES, 5 + WAVE_SLICES), points, strict=True):
        for i, j in marked:
            inner[channel, max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = 1
    return channels


def channels_of(picture: Picture, prompts: Prompts | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The network's input, see `wave_input`, and the pixels' places along both axes [m].

    Raises
    ------
    InputError
        The picture is a photo or blank, or the other band has no place in common with it.
    """
    image = picture.image
    if image is None or picture.grid_xy is None:
        raise InputError("wave needs a radar image, and this picture is a photo; use another method")
    if not np.any(image.values):
        raise InputError("the image is 0 everywhere, and there is nothing to segment; check how it was formed")
    x, y = canvas_axes(picture.grid_xy)
    cleaned = without_sheets(image, frequency=HIGH_BAND, covered=picture.covered)
    power = canvas_power(cleaned, x, y)
    before = None if cleaned is image else projected_levels(canvas_power(image, x, y))
    other = None
    if picture.other_band is not None:
        second = without_sheets(picture.other_band, frequency=LOW_BAND, covered=picture.covered)
        other = canvas_power(second, x, y)
    if other is not None and not other.any():
        raise InputError(
            "the other band is 0 wherever the image is, or on another grid; image both bands over the same area, "
            "or leave it out"
        )
    points = _canvas_points(prompts, picture, x, y)
    taken = 0.0 if cleaned is image else taken_db(cleaned)
    return wave_input(power, other, points, before=before, taken_db=taken), x, y


def _canvas_points(
    prompts: Prompts | None, picture: Picture, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positive and negative points (n, 2) as indices into the canvas's pixels."""
    if prompts is None or picture.grid_xy is None:
        return np.zeros((0, 2), int), np.zeros((0, 2), int)
    prompts.check_on(picture)
    places = picture.grid_xy.x[prompts.points[:, 0]], picture.grid_xy.y[prompts.points[:, 1]]
    points = np.column_stack(
        [abs(axis - place[:, None]).argmin(axis=1) for axis, place in zip((x, y), places, strict=True)]
    )
    return points[prompts.positive], points[~prompts.positive]


def _slice_levels(power: np.ndarray) -> np.ndarray:
    """(WAVE_SLICES, A, B) levels of a power (A, B, Z): z in slices of one thickness, each by its maximum."""
    depth = power.shape[2]
    edges = np.arange(WAVE_SLICES) * depth / WAVE_SLICES
    parts = [power[:, :, int(a) : max(int(np.ceil(a + depth / WAVE_SLICES)), int(a) + 1)].max(axis=2) for a in edges]
    return power_levels(np.stack(parts))
