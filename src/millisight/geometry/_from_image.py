"""Normals and places from a formed image alone, for data whose frames are not there (primer 23)."""

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_number
from millisight.core.errors import InputError
from millisight.data import SarImage
from millisight.geometry._moments import Moments, noise_of

_FAR = 1.0  # of the stand-in for the antennas' mean place, along the normal [m]


def moments_of_image(image: SarImage, frequency: float | None) -> Moments:
    """What an image tells of the moments: the normal by its phase's gradient, the place by the maximum of |I| along z.

    `antenna` stands 1 m away along the normal, and `ahead` leads to the tangent plane through the maximum.

    Raises
    ------
    InputError
        The image is real, has fewer than 3 voxels along an axis, or its frequency is not known.
    """
    if image.seen_from == "beside":
        raise InputError(
            "the antennas lie beside the image, and surfaces are looked for along z: turn the frame so that the radar "
            "looks along z, or pass the capture"
        )
    centre = image.frequency if frequency is None else checked_number(frequency, name="frequency", unit="Hz", above=0)
    if centre is None:
        raise InputError("this image does not state its frequency; pass frequency=79e9, for example [Hz]")
    if min(image.grid.shape) < 3:
        shape = " x ".join(map(str, image.grid.shape))
        raise InputError(f"the image has {shape} voxels; expected at least 3 along each axis")
    if not np.imag(image.values).any():
        raise InputError("the image is real; expected complex values, whose phase tells the normals")
    wave_number = 4 * np.pi * centre / SPEED_OF_LIGHT  # of the round trip
    slopes = [_phase_slope(image.values, axis, k) / wave_number for k, axis in enumerate((image.grid.x, image.grid.y))]
    across = np.minimum(slopes[0] ** 2 + slopes[1] ** 2, 0.98)
    shrunk = np.sqrt(across / np.maximum(slopes[0] ** 2 + slopes[1] ** 2, 1e-12))
    normals = np.stack([-slopes[0] * shrunk, -slopes[1] * shrunk, np.sqrt(1 - across)], axis=-1)
    voxels = np.stack(np.meshgrid(image.grid.x, image.grid.y, image.grid.z, indexing="ij"), axis=-1)
    power = np.abs(image.values) ** 2
    # The phase is known to noise / |I|, its slope over two voxels; the place to about that share of half a cell.
    step = float(min(np.diff(image.grid.x).mean(), np.diff(image.grid.y).mean()))
    shift, alone = _to_maximum(np.abs(image.values), image.grid.z)
    return Moments(
        grid=image.grid,
        values=image.values,
        antenna=voxels + _FAR * normals,
        ahead=shift * normals[..., 2],  # to the tangent plane through the maximum
        alone=alone,
        noise=noise_of(power, 2),
        spread=_FAR * np.sqrt(2) / (wave_number * 2 * step) * np.sqrt(2),
        delay_spread=float(np.diff(image.grid.z).mean()),
    )


def _phase_slope(values: np.ndarray, axis: np.ndarray, k: int) -> np.ndarray:
    """(X, Y, Z) slope of the phase along x or y [rad/m], by the turns to both neighbours together."""
    turns = np.moveaxis(values, k, 0)
    turns = turns[1:] * turns[:-1].conj()
    padded = np.pad(turns, ((1, 1), (0, 0), (0, 0)))
    both = padded[1:] + padded[:-1]
    return np.moveaxis(np.angle(both), 0, k) / float(np.diff(axis).mean())


def _to_maximum(magnitude: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(X, Y, Z) distance up along z to the top of the parabola through three voxels [m], and where there is one."""
    step = float(np.diff(z).mean())
    before, here, after = magnitude[..., :-2], magnitude[..., 1:-1], magnitude[..., 2:]
    highest = (here > before) & (here >= after)
    bend = np.where(highest, before - 2 * here + after, -1.0)
    ends = (0, 0), (0, 0), (1, 1)
    return np.pad(0.5 * step * (before - after) / bend, ends), np.pad(highest, ends)
