"""Balls and cylinders: their phases tell their radius, and so where they end, although their sides are dark.

Of what is round only the crest shines, where it is normal to a line of sight. All its echoes seem to come from the centre
of curvature: propagated down to there by the angular spectrum, a slice of the image through a ball's crest becomes a
point, and through a cylinder's a line. The depth is the radius, and so far from the point or the line the outline lies.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, peak_place
from millisight.data import SarImage
from millisight.perception import HIGH_BAND
from millisight.perception.segmentation._parts import parts_of

_DEPTHS = np.arange(-0.006, 0.096, 0.003)  # at which a focus is sought, below where the echo is strongest [m]
_CREST = 0.0045  # lies so far above where the echo is strongest, as the sides are lower: mean of 12 of the rig [m]
_CORE = -20.0  # of a part's brightest pixel, above which the image is looked at [dB]
_TAPER, _BESIDE = 0.02, 0.06  # around that it falls to 0; beyond, room for what spreads on the way [m]
_SEEN = 0.3  # sine of the angle from above up to which the pixels must hold the phases
_SIGN = 1.2  # by which one sign of the phases must agree better than the other

_BALL = 0.4, 1.8  # Strehl ratio and gain at least; balls of the rig have ratios of 0.45 to 0.8, all else below 0.25
_CYLINDER = 1.4, 12.0  # gain at least, and over that of a radius of a wavelength that is seen from all sides
_ACROSS, _ALONG = 0.1, 0.55  # spread of a cylinder's directions at least, and of those along it as a share at most
_LEAST, _MOST = 0.008, 0.09  # of a radius [m]
_ENDS = -8.0  # a cylinder ends where its focus is so much darker than its brightest place [dB]
_AROUND = 0.03  # beyond the outline, or a radius if that is more, nothing else can be told from it [m]


class Round(NamedTuple):
    """Something round, seen along z.

    Attributes
    ----------
    kind : "ball" or "cylinder"
    radius : [m]
    inside : (A, B) bool, the pixels within its outline
    around : (A, B) bool, these and the pixels beside, where nothing else can be told from it
    """

    kind: str
    radius: float
    inside: np.ndarray
    around: np.ndarray


class _Focus(NamedTuple):
    """A part of an image, where it is sharpest.

    Attributes
    ----------
    power : (M, N) there
    radius : depth below the crest [m]
    gain : how much sharper than at the crest, by the sum of the power's square
    strehl : the maximum over that of the same spectrum in phase, from 0 to 1
    spreads : standard deviations of the directions that are seen, along and across, as sines
    along : (2,) unit vector, of the direction in which they spread least
    """

    power: np.ndarray
    radius: float
    gain: float
    strehl: float
    spreads: np.ndarray
    along: np.ndarray


def round_things(mask: np.ndarray, image: SarImage) -> list[Round]:
    """The balls and cylinders among the parts of a mask.

    A part is a ball if its spectrum is in phase at its focus, and a cylinder if it is sharper there, and seen from wide
    directions across and narrow ones along. What is curved otherwise, as a spoon is, has a focus, too, but does not end
    a radius from it, and is left out, as is whatever is less round than 8 or more than 90 mm.

    Parameters
    ----------
    mask : (A, B) bool, on the image's pixels
    image : at 77 GHz, seen along z, sheets taken off, its phases as `form_image` leaves them, or their negatives

    Returns
    -------
    list of Round; none where the image is one of magnitudes, or its pixels are too coarse for its phases: above 3.2 mm
    """
    sides = [float(np.ptp(axis)) / max(len(axis) - 1, 1) for axis in (image.grid.x, image.grid.y)]
    wavelength = SPEED_OF_LIGHT / (image.frequency or HIGH_BAND)
    if not np.iscomplexobj(image.values) or min(image.values.shape) < 2 or max(sides) > wavelength / (4 * _SEEN):
        return []
    parts, count = parts_of(mask)
    found = (_round(parts == part, image, sides, wavelength) for part in range(1, count + 1))
    return [one for one in found if one is not None]


def with_outlines(mask: np.ndarray, things: Sequence[Round]) -> np.ndarray:
    """A mask (A, B) with the outlines of round things instead of what it has around them."""
    for thing in things:
        mask = (mask & ~thing.around) | thing.inside
    return mask


def _round(part: np.ndarray, image: SarImage, sides: Sequence[float], wavelength: float) -> Round | None:
    """What is round in a part of a mask (A, B), if it is."""
    level = np.where(part, image.magnitude.mean(axis=2), 0)
    core = level > level.max() * 10 ** (_CORE / 20)
    margins = [round((_TAPER + _BESIDE) / side) for side in sides]
    spans = [(max(i.min() - n, 0), i.max() + n + 1) for i, n in zip(np.nonzero(core), margins, strict=True)]
    box = slice(*spans[0]), slice(*spans[1])
    focus = _focus(core, image, box, sides, 4 * np.pi / wavelength)
    if focus is None or not _LEAST <= focus.radius <= _MOST:
        return None
    x, y = image.grid.x[:, None], image.grid.y
    if focus.strehl >= _BALL[0] and focus.gain >= _BALL[1]:
        i, j = np.unravel_index(focus.power.argmax(), focus.power.shape)
        kind, away, there = "ball", np.hypot(x - x[box[0]][i], y - y[box[1]][j]), np.ones_like(part)
    else:
        least = max(_CYLINDER[0], _CYLINDER[1] * focus.radius * focus.spreads[1] ** 2 / wavelength)
        if focus.spreads[1] < _ACROSS or focus.spreads[0] > _ALONG * focus.spreads[1] or focus.gain < least:
            return None
        kind, (away, there) = "cylinder", _from_axis(focus, x, y, box, sides)
    beside = focus.radius + max(focus.radius, _AROUND)
    return Round(kind, focus.radius, there & (away <= focus.radius), there & (away <= beside))


def _focus(
    core: np.ndarray, image: SarImage, box: tuple[slice, slice], sides: Sequence[float], wavenumber: float
) -> _Focus | None:
    """Where an image is sharpest around the pixels (A, B) of a core; None where the sign of its phases is not told.

    box : of the pixels that are looked at; wavenumber : there and back [rad/m]
    """
    from scipy import fft
    from scipy.ndimage import distance_transform_edt

    z, power = image.grid.z, np.square(image.magnitude[core], dtype=float).sum(axis=0)
    top = int(power.argmax())
    next_ = max((i for i in (top - 1, top + 1) if 0 <= i < len(z)), key=lambda i: power[i])
    fade = np.clip(1 - distance_transform_edt(~core[box], sampling=sides) / _TAPER, 0, 1)
    values = (image.values[box][..., [top, next_]] * fade[..., None]).astype(np.complex64)
    shape = [fft.next_fast_len(size) for size in fade.shape]
    spectrum, other = np.moveaxis(fft.fft2(values, shape, axes=(0, 1)), 2, 0)
    kx, ky = np.meshgrid(*(2 * np.pi * fft.fftfreq(n, side) for n, side in zip(shape, sides, strict=True)), indexing="ij")
    kz = np.sqrt(np.maximum(wavenumber**2 - kx**2 - ky**2, 0))

    # From one slice to the next a spectrum turns by kz times their distance, one way or the other.
    turned, back = other * np.conj(spectrum), np.exp(1j * kz * (z[next_] - z[top]))
    minus, plus = abs((turned * back).sum()), abs((turned * np.conj(back)).sum())
    if max(minus, plus) < _SIGN * min(minus, plus):
        return None
    sign = 1 if plus > minus else -1

    echo = peak_place(np.log(np.maximum(power, 1e-30 * power.max())), z)
    depths = _DEPTHS + z[top] - echo
    turns = np.exp(-1j * sign * (kz - wavenumber) * depths[:, None, None]).astype(np.complex64)
    powers = np.square(np.abs(fft.ifft2(spectrum * turns, axes=(1, 2))), dtype=float)
    sharpness = np.square(powers).sum(axis=(1, 2)) / np.square(powers.sum(axis=(1, 2)))
    best = int(sharpness.argmax())

    amplitude = np.abs(spectrum).astype(float)
    shares = np.square(amplitude).ravel() / np.square(amplitude).sum()
    spreads, axes = np.linalg.eigh(np.cov(np.stack([kx.ravel(), ky.ravel()]), aweights=shares, ddof=0))
    return _Focus(
        power=powers[best, : fade.shape[0], : fade.shape[1]],
        radius=peak_place(sharpness, _DEPTHS) + _CREST,
        gain=float(sharpness[best] / sharpness[abs(_DEPTHS).argmin()]),
        strehl=float(powers[best].max() / amplitude.mean() ** 2),
        spreads=np.sqrt(np.maximum(spreads, 0)) / wavenumber,
        along=axes[:, 0],
    )


def _from_axis(
    focus: _Focus, x: np.ndarray, y: np.ndarray, box: tuple[slice, slice], sides: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """(A, B) distances of pixels from a cylinder's axis [m], and whether they lie between its ends.

    The axis is the straight line through the brightest places across, weighted with their amplitudes.
    """
    from scipy.ndimage import map_coordinates

    (ax, ay), near = focus.along, (x[box[0], 0], y[box[1]])
    middle = [axis.mean() for axis in near]
    half = 0.5 * float(np.hypot(*(np.ptp(axis) for axis in near)))
    line = np.arange(-half, half, 0.5 * min(sides))
    u, v = np.meshgrid(line, line, indexing="ij")
    places = (
        (m + offset - axis[0]) / side
        for m, offset, axis, side in zip(middle, (u * ax - v * ay, u * ay + v * ax), near, sides, strict=True)
    )
    turned = map_coordinates(focus.power, list(places), order=1)
    ridge, at = turned.max(axis=1), line[turned.argmax(axis=1)]
    lit = np.flatnonzero(ridge >= ridge.max() * 10 ** (_ENDS / 10))
    slope, offset = np.polyfit(line[lit], at[lit], 1, w=np.sqrt(ridge[lit])) if len(lit) > 1 else (0.0, at[lit[0]])
    dx, dy = x - middle[0], y - middle[1]
    u, v = dx * ax + dy * ay, dy * ax - dx * ay
    away = abs(v - (slope * u + offset)) / np.hypot(1, slope)
    return away, (u >= line[lit[0]]) & (u <= line[lit[-1]])
