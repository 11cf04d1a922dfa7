"""Flat tops: their phases tell the plane that they lie in, and where on it they end.

The echo of a plane is a plane wave: within its outline a slice of the image has one direction, the plane's normal. Less
that wave's phases the slice is real and positive there, and half as high at the edges.
"""

from typing import Any, NamedTuple

import numpy as np

from millisight.data import Mask, SarImage, VoxelGrid
from millisight.perception.segmentation._heights import growth_with_distance, peak_height, pixel_sides
from millisight.perception.segmentation._parts import parts_of
from millisight.perception.segmentation._phases import (
    cleaned_under,
    has_phases,
    parts_to_look_at,
    phase_sign,
    wavenumber_of,
)

_WINDOW = 0.015  # in which waves are compared with the plane's [m]
_AGREEING = 0.7  # share of the amplitudes that remains when they are added in phase with the plane's wave
_BRIGHT = -12.0  # of the brightest window, below which no plane is looked for [dB]
_ROUNDS = 4  # in which a plane's direction and its place settle
_EDGE = 0.5  # of the amplitude on the plane, where it ends
_BEYOND = 0.008  # of the mask, the edge may lie [m]
_MOST_OF_IT = 0.45  # of a part, that a plane covers
_NARROWEST = 0.015  # of a plane: a cylinder's crest seems to be one [m]
_OUTLINED = 0.8  # intersection over union with a rectangle or an ellipse


class Flat(NamedTuple):
    """A flat top, seen along z.

    Attributes
    ----------
    kind : "rectangle" or "ellipse"
    centre : (3,) of the outline [m]
    normal : (3,) unit vector, z positive
    axis : (3,) unit vector in the plane along the longer side, x + y positive
    sides : (2,) length and width, or diameters [m]
    share : of the mask's part that it covers
    inside : (A, B) bool, its pixels
    """

    kind: str
    centre: np.ndarray
    normal: np.ndarray
    axis: np.ndarray
    sides: np.ndarray
    share: float
    inside: np.ndarray

    def __repr__(self) -> str:
        return f"Flat({self})"

    def __str__(self) -> str:
        (x, y, z), (length, width) = self.centre, 1e3 * self.sides
        size = f"{length:.0f} x {width:.0f} mm around ({x:.3f}, {y:.3f}, {z:.3f}) m"
        return f"flat {self.kind} of {size}, {self.tilt_deg:.1f} degrees from level"

    @property
    def tilt_deg(self) -> float:
        """Between the normal and z."""
        return float(np.degrees(np.arccos(min(self.normal[2], 1.0))))

    @property
    def plain(self) -> dict[str, Any]:
        """All but the pixels, as JSON has it."""
        vectors = {name: [float(one) for one in getattr(self, name)] for name in ("centre", "normal", "axis", "sides")}
        return {"kind": self.kind, **vectors, "share": self.share}


def find_flat(mask: Mask, image: SarImage, *, covered: bool = False) -> tuple[Flat, ...]:
    """The flat tops of the parts of a mask: place, normal, axis and sides, by the image's phases.

    A part has one if most of it has the phases of one plane wave. Steps and holes are no hindrance, where the waves on
    both sides have the same direction. What bends by more than 3 degrees, is narrower than 15 mm, covers less than 45 %
    of its part, or is neither a rectangle nor an ellipse is left out.

    Parameters
    ----------
    mask : Mask
    image : in which it was found, on the same pixels: at 77 GHz, its phases as `form_image` leaves them, or their
        negatives; lids and cloths are taken off
    covered : whether a lid is known to lie over the scene

    Returns
    -------
    tuple of Flat, at most one of each part; empty where the image is one of magnitudes, its pixels are too coarse for
        its phases, above 3.2 mm, or its echoes do not fall to a fifth above and below the object, as at 24 GHz

    Raises
    ------
    InputError
        The mask is on other pixels than the image.
    """
    cleaned = cleaned_under(mask, image, covered=covered)
    return () if cleaned is None else tuple(flat_things(mask.inside, cleaned))


def flat_things(mask: np.ndarray, image: SarImage) -> list[Flat]:
    """The flat tops of the parts of a mask (A, B) on an image's pixels; see `find_flat`.

    image : its sheets taken off; its echoes tell heights
    """
    if not has_phases(image):
        return []
    found = (_flat(part, image) for part in parts_to_look_at(mask, image))
    return [one for one in found if one is not None]


class _Wave(NamedTuple):
    """A plane wave in a slice of an image.

    Attributes
    ----------
    slopes : (2,) of its phase along x and y [rad/m]
    values : (A, B) of the slice less these phases, real and positive where it is
    inside : (A, B) bool, where it is, a window from the edge or nearer
    """

    slopes: np.ndarray
    values: np.ndarray
    inside: np.ndarray


def _flat(whole: np.ndarray, image: SarImage) -> Flat | None:
    """What is flat in a part (A, B) of a mask, if most of it is."""
    margins = [round(_BEYOND / side) + 1 for side in pixel_sides(image)]
    box = tuple(slice(max(i.min() - n, 0), i.max() + n + 1) for i, n in zip(np.nonzero(whole), margins, strict=True))
    grid = VoxelGrid(x=image.grid.x[box[0]], y=image.grid.y[box[1]], z=image.grid.z)
    near, part, wavenumber = SarImage(grid=grid, values=image.values[box]), whole[box], wavenumber_of(image)
    wave = _wave(part, near)
    if wave is None:
        return None
    inside = _extent(wave, part, near)
    share = float((inside & part).sum() / part.sum())
    if share < _MOST_OF_IT or abs(wave.values[inside].sum()) < _AGREEING * np.abs(wave.values[inside]).sum():
        return None
    # What of each slice has the phases of the wave: leftovers of a lid have not.
    sums = np.tensordot(_turned(np.ones(part.shape), wave.slopes, grid)[inside], near.values[inside], axes=1)
    power, z = np.square(np.abs(sums), dtype=float), grid.z
    top, upright = int(power.argmax()), np.sqrt(1 - np.square(wave.slopes / wavenumber).sum())
    turns = wavenumber * upright * (z - z[top])
    other = int((power * (1 - np.cos(2 * turns))).argmax())
    sign = phase_sign(sums[other] * np.conj(sums[top]), turns[other])
    outline = _outline(inside, grid, normal := np.array([*(sign * wave.slopes / wavenumber), upright]))
    if not sign or outline.alike < _OUTLINED or outline.sides[1] < _NARROWEST:
        return None
    height = peak_height(power / growth_with_distance(z, z[top]), z)
    rise = -normal[:2] / normal[2]
    axis = np.array([*outline.along, rise @ outline.along])
    everywhere = np.zeros(whole.shape, bool)
    everywhere[box] = inside
    return Flat(
        outline.kind, np.array([*outline.centre, height]), normal,
        axis / np.linalg.norm(axis) * (1 if outline.along.sum() > 0 else -1), outline.sides, share, everywhere,
    )  # fmt: skip


def _wave(part: np.ndarray, image: SarImage) -> _Wave | None:
    """The plane wave that most of a part (A, B) of a mask has; None if none fills a window of it."""
    from scipy import fft
    from scipy.ndimage import uniform_filter

    grid, values = image.grid, image.values
    sides, shape = pixel_sides(image), [fft.next_fast_len(2 * size) for size in part.shape]
    spectra = np.abs(fft.fft2(np.moveaxis(values * part[..., None], 2, 0), shape))
    k, i, j = np.unravel_index(int(spectra.argmax()), spectra.shape)
    if not spectra[k, i, j]:
        return None
    turns = [fft.fftfreq(n, side)[m] for n, side, m in zip(shape, sides, (i, j), strict=True)]
    slopes = 2 * np.pi * np.array(turns)
    windows = [max(1, round(_WINDOW / side)) for side in sides]
    alone = np.where(part, values[..., k], 0)
    level = uniform_filter(np.abs(alone), windows, mode="constant")
    for _ in range(_ROUNDS):
        turned = _turned(alone, slopes, grid)
        mean = uniform_filter(turned.real, windows, mode="constant") + 1j * uniform_filter(
            turned.imag, windows, mode="constant"
        )
        agreeing = part & (np.abs(mean) >= _AGREEING * level) & (level >= level.max() * 10 ** (_BRIGHT / 20))
        if not agreeing.any():
            return None
        parts, _ = parts_of(agreeing)
        inside = parts == np.bincount(parts.ravel())[1:].argmax() + 1
        slopes = slopes + [_slope(mean, inside, axis) / side for axis, side in enumerate(sides)]
    turned = _turned(values[..., k], slopes, grid)
    return _Wave(slopes, turned * np.exp(-1j * np.angle(turned[inside].sum())), inside)


def _turned(values: np.ndarray, slopes: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    """Values (A, B) less the phases of a wave."""
    return values * (np.exp(-1j * slopes[0] * grid.x)[:, None] * np.exp(-1j * slopes[1] * grid.y))


def _slope(mean: np.ndarray, inside: np.ndarray, axis: int) -> float:
    """By how much the phase of a mean (A, B) turns from one of the pixels inside to the next along an axis [rad]."""
    one, other = (np.moveaxis(array, axis, 0) for array in (mean, inside))
    return float(np.angle((one[1:] * np.conj(one[:-1]))[other[1:] & other[:-1]].sum()))


def _extent(wave: _Wave, part: np.ndarray, image: SarImage) -> np.ndarray:
    """(A, B) where a wave is at least half as high as on its plane, holes filled, near the part of its mask."""
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    near = distance_transform_edt(~part, sampling=pixel_sides(image)) <= _BEYOND
    high = near & (wave.values.real >= _EDGE * np.median(wave.values.real[wave.inside]))
    parts, _ = parts_of(high)
    shares = np.bincount(parts[wave.inside], minlength=2)
    shares[0] = 0
    return binary_fill_holes(parts == shares.argmax()) if shares.any() else wave.inside


class _Outline(NamedTuple):
    """What an outline is like; see `Flat`. Centre and direction along its longer side are seen along z, (2,).

    alike : its intersection with this over their union
    """

    alike: float
    kind: str
    centre: np.ndarray
    along: np.ndarray
    sides: np.ndarray


def _outline(inside: np.ndarray, grid: VoxelGrid, normal: np.ndarray) -> _Outline:
    """Rectangle or ellipse of the same moments as the pixels (A, B) of a plane, whichever is more like them."""
    places = np.stack(np.meshgrid(grid.x, grid.y, indexing="ij"), axis=-1)
    centre = places[inside].mean(axis=0)
    # Down its slope a plane is longer than it is seen.
    slope = normal[:2] / max(float(np.hypot(*normal[:2])), 1e-12)
    longer = np.eye(2) + (1 / normal[2] - 1) * np.outer(slope, slope)
    flat = (places - centre) @ longer @ [1, 1j]
    # Of a square the second moments do not tell how it is turned, of others the fourth may not.
    angles = np.angle((flat[inside] ** 2).sum()) / 2, (np.angle((flat[inside] ** 4).sum()) + np.pi) / 4
    found = []
    for angle in angles:
        turned = flat * np.exp(-1j * angle)
        spreads = turned.real[inside].std(), turned.imag[inside].std()
        u, v = abs(turned.real) / spreads[0], abs(turned.imag) / spreads[1]
        for kind, size, filled in (
            ("rectangle", np.sqrt(12), np.maximum(u, v) <= np.sqrt(3)), ("ellipse", 4.0, np.hypot(u, v) <= 2)
        ):  # fmt: skip
            found.append((float((filled & inside).sum() / (filled | inside).sum()), kind, angle, size, spreads))
    alike, kind, angle, size, spreads = max(found)
    if spreads[1] > spreads[0]:
        angle, spreads = angle + np.pi / 2, spreads[::-1]
    along = np.linalg.solve(longer, [np.cos(angle), np.sin(angle)])
    return _Outline(alike, kind, centre, along / np.linalg.norm(along), size * np.array(spreads))
