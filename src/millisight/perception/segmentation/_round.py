"""Balls and cylinders: their phases tell their radius, and so where they end, although their sides are dark.

Of what is round only the crest shines, where it is normal to a line of sight. All its echoes seem to come from the
centre of curvature: propagated down to there by the angular spectrum, a slice of the image through a ball's crest
becomes a point, and through a cylinder's a line. The depth is the radius, and so far from the point or the line the
outline lies.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from millisight.core import checked_array, peak_place, put, record
from millisight.data import Mask, SarImage
from millisight.perception.segmentation._heights import (
    distance_of,
    echo_height,
    growth_with_distance,
    peak_height,
    pixel_sides,
)
from millisight.perception.segmentation._phases import (
    cleaned_under,
    parts_to_look_at,
    phase_sign,
    reaches_edge,
    wavenumber_of,
    why_no_forms,
)

_DEPTHS = np.arange(-0.006, 0.096, 0.003)  # at which a focus is sought, below where the echo is strongest [m]
_RINGS = np.append(np.linspace(0.9, 1, 9)[:-1], 1.01)  # cosines between which the echo's height is measured
_AGREEING = 0.002  # so far apart, radii that are seen from two angles agree [m]
_LID = 0.0006  # that a carton's lid, 2.5 to 4 mm thick, delays an echo [m]
_CORE = -20.0  # of a part's brightest pixel, above which the image is looked at [dB]
_TAPER, _BESIDE = 0.02, 0.06  # around that it falls to 0; beyond, room for what spreads on the way [m]
_NEAR = 0.035  # of the slice in which the echo is strongest are those that are looked at [m]

# A ball's spectrum is as wide along as across, and in phase at its focus. Strehl ratios of balls are 0.45 to 0.8 by the
# rig, and from 0.24 on by `simulate`, whose points are coarse. Of what is curved otherwise they reach 0.22, of bricks,
# which are seen from no more than a few directions, 0.24.
_BALL, _BALL_GAIN, _BALL_SHAPE = 0.4, 1.8, 0.6
_BALL_WIDE, _WIDE = 0.23, 0.12  # enough where directions spread so far
# A cylinder's is wide across and narrow along. It becomes the sharper, the more wavelengths its radius has.
_GAIN, _GAIN_FOR_SIZE, _ACROSS, _ALONG = 1.4, 8.0, 0.1, 0.55
_LEAST, _MOST = 0.008, 0.09  # of a radius [m]
_ENDS = -8.0  # a cylinder ends where its focus is so much darker than its brightest place [dB]
_AROUND = 0.03  # beyond the outline, or a radius if that is more, nothing else can be told from it [m]


CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]])
"""Of a rectangle in units of half its sides, closed."""


CUT = "; it reaches the picture's edge, and may go on beyond"
"""What is said of a form that may be seen in part."""


@record
class Round:
    """A ball or a cylinder, seen along z.

    Attributes
    ----------
    kind : "ball" or "cylinder"
    radius : [m]
    centre : (3,) of the ball, or of the cylinder's axis [m]
    axis : (3,) unit vector along a cylinder's axis, x + y positive; None for a ball
    length : of a cylinder, between the ends that are seen; of a ball its diameter [m]
    cut : whether its outline reaches the picture's edge: of what lies beyond, a part is not seen
    inside : (A, B) bool, the pixels within its outline
    around : (A, B) bool, these and the pixels beside, where nothing else can be told from it
    """

    kind: str
    radius: float
    centre: np.ndarray
    axis: np.ndarray | None
    length: float
    cut: bool
    inside: np.ndarray
    around: np.ndarray

    def __post_init__(self) -> None:
        put(self, centre=checked_array(self.centre, name="centre", shape=(3,)))
        if self.axis is not None:
            put(self, axis=checked_array(self.axis, name="axis", shape=(3,)))
        for name in ("inside", "around"):
            put(self, **{name: checked_array(getattr(self, name), name=name, shape=("A", "B"), dtype=bool)})

    def __repr__(self) -> str:
        return f"Round({self})"

    def __str__(self) -> str:
        x, y, z = self.centre
        place = f"{self.kind} of {1e3 * self.radius:.0f} mm radius around ({x:.3f}, {y:.3f}, {z:.3f}) m"
        form = place if self.axis is None else f"{place}, {1e3 * self.length:.0f} mm long"
        return f"{form}{CUT if self.cut else ''}"

    @property
    def short(self) -> str:
        """Its size in few letters, for pictures."""
        return f"r {1e3 * self.radius:.0f} mm"

    @property
    def outline(self) -> np.ndarray:
        """(N, 2) x and y of its outline, seen along z, closed [m]."""
        if self.axis is None:
            angle = np.linspace(0, 2 * np.pi, 73)
            return self.centre[:2] + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across = np.array([-self.axis[1], self.axis[0]]) / np.hypot(*self.axis[:2])
        return self.centre[:2] + CORNERS @ np.stack([self.length / 2 * self.axis[:2], self.radius * across])

    @property
    def plain(self) -> dict[str, Any]:
        """All but the pixels, as JSON has it."""
        axis = None if self.axis is None else [float(one) for one in self.axis]
        centre = [float(one) for one in self.centre]
        form = {"kind": self.kind, "radius": self.radius, "centre": centre, "axis": axis, "length": self.length}
        return {**form, "cut": self.cut}

    @property
    def turned_over(self) -> "Round":
        """Mirrored in z."""
        up = np.array([1, 1, -1])
        return replace(self, centre=self.centre * up, axis=None if self.axis is None else self.axis * up)


class _Focus(NamedTuple):
    """A part of an image, where it is sharpest.

    Attributes
    ----------
    power : (M, N) there
    height : z there [m]
    radius : depth below the crest [m]
    gain : how much sharper than at the crest, by the sum of the power's square
    strehl : the maximum over that of the same spectrum in phase, from 0 to 1
    mean, spreads : (2,) of the directions in which it is seen, as sines; along and across the cylinder that it may be
    along : (2,) unit vector, of the direction in which they spread least
    """

    power: np.ndarray
    height: float
    radius: float
    gain: float
    strehl: float
    mean: np.ndarray
    spreads: np.ndarray
    along: np.ndarray


def find_round(mask: Mask, image: SarImage, *, covered: bool = False) -> tuple[Round, ...]:
    """The balls and cylinders among the parts of a mask: radius, centre and axis, by the image's phases.

    A part is a ball if its spectrum is in phase at its focus, and a cylinder if it is sharper there, and seen from wide
    directions across and narrow ones along. What is curved otherwise, as a spoon is, has a focus, too, but does not end
    a radius from it, and is left out, as is whatever has a radius of less than 8 or more than 90 mm.

    Parameters
    ----------
    mask : Mask
    image : in which it was found, on the same pixels: at 77 GHz, its phases as `form_image` leaves them, or their
        negatives; lids and cloths are taken off
    covered : whether a lid is known to lie over the scene

    Returns
    -------
    tuple of Round; empty where the image is one of magnitudes, its pixels are too coarse for its phases, above 3.1 mm,
    or its echoes do not fall to a fifth above and below the object, as at 24 GHz

    Raises
    ------
    InputError
        The mask is on other pixels than the image.
    """
    cleaned = cleaned_under(mask, image, covered=covered)
    return () if cleaned is None else tuple(round_things(mask.inside, cleaned, covered=covered))


def round_things(mask: np.ndarray, image: SarImage, *, covered: bool = False) -> list[Round]:
    """The balls and cylinders among the parts of a mask (A, B) on an image's pixels; see `find_round`.

    image : its sheets taken off; its echoes tell heights
    covered : whether there was a lid, which delays the echoes
    """
    if why_no_forms(image):
        return []
    if image.seen_from == "below":
        return [one.turned_over for one in round_things(mask, image.turned_over, covered=covered)]
    level, sides = image.magnitude.mean(axis=2), pixel_sides(image)
    delay = _LID if covered else 0.0
    found = (_round(np.where(part, level, 0), image, sides, delay) for part in parts_to_look_at(mask, image))
    return [one for one in found if one is not None]


def with_outlines(mask: np.ndarray, things: Sequence[Round]) -> np.ndarray:
    """A mask (A, B) with the outlines of round things instead of what it has around them."""
    for thing in things:
        mask = (mask & ~thing.around) | thing.inside
    return mask


def _round(level: np.ndarray, image: SarImage, sides: Sequence[float], delay: float) -> Round | None:
    """What is round in a part of a mask, if it is.

    level : (A, B) mean magnitude along z, 0 outside of the part
    delay : by which echoes seem to lie too low [m]
    """
    if not level.any():
        return None
    core = level > level.max() * 10 ** (_CORE / 20)
    margins = [round((_TAPER + _BESIDE) / side) for side in sides]
    spans = [(max(i.min() - n, 0), i.max() + n + 1) for i, n in zip(np.nonzero(core), margins, strict=True)]
    box = slice(*spans[0]), slice(*spans[1])
    power = np.square(np.abs(image.values[core]), dtype=float).sum(axis=0)
    wavenumber = wavenumber_of(image)
    focus = _focus(core, image, power, box, sides, wavenumber)
    if focus is None:
        return None
    focus = focus._replace(radius=focus.radius + delay)
    if not _LEAST <= focus.radius <= _MOST:
        return None
    x, y = image.grid.x[:, None], image.grid.y
    beside = focus.radius + max(focus.radius, _AROUND)
    along, across = focus.spreads
    least = _BALL_WIDE if along >= _WIDE else _BALL
    if focus.strehl >= least and focus.gain >= _BALL_GAIN and along >= _BALL_SHAPE * across:
        i, j = np.unravel_index(focus.power.argmax(), focus.power.shape)
        lines = ((focus.power[:, j], image.grid.x[box[0]]), (focus.power[i], image.grid.y[box[1]]))
        centre = np.array([*(peak_height(*line) for line in lines), focus.height])
        away = np.hypot(x - centre[0], y - centre[1])
        inside, around = away <= focus.radius, away <= beside
        return Round(
            kind="ball", radius=focus.radius, centre=centre, axis=None, length=2 * focus.radius,
            cut=reaches_edge(inside), inside=inside, around=around,
        )  # fmt: skip
    if across < _ACROSS or along > _ALONG * across:
        return None
    if focus.gain < max(_GAIN, _GAIN_FOR_SIZE * focus.radius * across**2 * wavenumber / (4 * np.pi)):
        return None
    middle, direction, length = _axis(focus, image.grid.x[box[0]], image.grid.y[box[1]], min(sides))
    dx, dy = x - middle[0], y - middle[1]
    there = abs(dx * direction[0] + dy * direction[1]) <= length / 2
    away = abs(dy * direction[0] - dx * direction[1])
    # What is seen lies square to the axis: it is as steep along as the directions are oblique on average.
    steep = focus.mean[0] / np.sqrt(1 - focus.mean[0] ** 2)
    axis = np.array([*direction, steep * float(direction @ focus.along)]) / np.hypot(1, steep)
    inside = there & (away <= focus.radius)
    return Round(
        kind="cylinder", radius=focus.radius, centre=np.array([*middle, focus.height]), axis=axis,
        length=length * float(np.hypot(1, steep)), cut=reaches_edge(inside), inside=inside,
        around=there & (away <= beside),
    )  # fmt: skip


def _focus(
    core: np.ndarray,
    image: SarImage,
    power: np.ndarray,
    box: tuple[slice, slice],
    sides: Sequence[float],
    wavenumber: float,
) -> _Focus | None:
    """Where an image is sharpest around the pixels (A, B) of a core; None where the sign of its phases is not told.

    power : (Z,) of the core, not 0; box : of the pixels that are looked at; wavenumber : there and back [rad/m]
    """
    from scipy import fft
    from scipy.ndimage import distance_transform_edt

    z, top = image.grid.z, int(power.argmax())
    near = np.flatnonzero(abs(z - z[top]) <= max(_NEAR, np.diff(z).min()))
    fade = np.clip(1 - distance_transform_edt(~core[box], sampling=sides) / _TAPER, 0, 1)
    values = (image.values[box][..., near] * (fade[..., None] / np.sqrt(power.max()))).astype(np.complex64)
    shape = [fft.next_fast_len(size) for size in fade.shape]
    spectra = np.moveaxis(fft.fft2(values, shape, axes=(0, 1)), 2, 0)
    spectrum = spectra[int(np.searchsorted(near, top))]
    wavenumbers = (2 * np.pi * fft.fftfreq(n, side) for n, side in zip(shape, sides, strict=True))
    kx, ky = np.meshgrid(*wavenumbers, indexing="ij")
    kz = np.sqrt(np.maximum(wavenumber**2 - kx**2 - ky**2, 0))

    # From one slice to another a spectrum turns by kz times their distance, one way or the other: the slice is taken
    # where the two differ most.
    other = int((power[near] * (1 - np.cos(2 * wavenumber * (z[near] - z[top])))).argmax())
    sign = phase_sign(spectra[other] * np.conj(spectrum), kz * (z[near[other]] - z[top]), image)
    if not sign:
        return None

    echo = echo_height(power, z)
    first, step = (
        np.exp(-1j * sign * (kz - wavenumber) * depth).astype(np.complex64)
        for depth in (_DEPTHS[0] + z[top] - echo, _DEPTHS[1] - _DEPTHS[0])
    )
    fields = np.empty((len(_DEPTHS), *shape), np.complex64)
    fields[0] = spectrum * first
    for above, below in pairwise(fields):
        np.multiply(above, step, out=below)
    fields = fft.ifft2(fields, axes=(1, 2), overwrite_x=True)
    powers = np.square(fields.real) + np.square(fields.imag)
    sharpness = np.square(powers).sum(axis=(1, 2), dtype=float) / np.square(powers.sum(axis=(1, 2), dtype=float))
    best = int(sharpness.argmax())

    amplitude = np.abs(spectrum).astype(float)
    seen, shares = -sign / wavenumber * np.stack([kx.ravel(), ky.ravel()]), np.square(amplitude).ravel()
    spreads, axes = np.linalg.eigh(np.cov(seen, aweights=shares, ddof=0))
    height = echo - peak_place(sharpness, _DEPTHS)
    return _Focus(
        power=powers[best, : fade.shape[0], : fade.shape[1]],
        height=height,
        radius=_from_centre(np.square(np.abs(spectra)), z[near], height, kz / wavenumber, distance_of(image, height)),
        gain=float(sharpness[best] / sharpness[abs(_DEPTHS).argmin()]),
        strehl=float(powers[best].max() / amplitude.mean() ** 2),
        mean=axes.T @ np.average(seen, axis=1, weights=shares),
        spreads=np.sqrt(np.maximum(spreads, 0)),
        along=axes[:, 0],
    )


def _from_centre(power: np.ndarray, z: np.ndarray, height: float, cosines: np.ndarray, distance: float) -> float:
    """How far from a centre of curvature at a height the echo lies, by its delay [m].

    Waves at an angle to z show it at radius times cosine above the centre.

    power : (K, M, N) of the spectra of slices at z (K,); cosines : (M, N) of the angles; distance : of the antennas
    """
    rings, told = np.digitize(cosines, _RINGS), []
    power = power / growth_with_distance(z, height, distance)[:, None, None]
    for ring in range(1, len(_RINGS)):
        some = rings == ring
        profile = power[:, some].sum(axis=1, dtype=float)
        if profile.any():
            above = echo_height(profile, z) - height
            told.append((above / np.average(cosines[some], weights=power[:, some].sum(axis=0) + 1e-30), profile.max()))
    # What is left of a lid is seen from above, and may outshine a ball there: most angles agree, if not most power.
    radii, powers = np.array(told).T
    agreeing = np.exp(-np.square((radii - radii[:, None]) / _AGREEING)) * np.sqrt(powers)
    return float(np.average(radii, weights=agreeing[agreeing.sum(axis=1).argmax()]))


def _axis(focus: _Focus, x: np.ndarray, y: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Middle (2,), direction (2,) and length [m] of a cylinder's axis, seen along z.

    It is the straight line through the brightest places across, weighted with their amplitudes.

    x, y : of the focus's pixels; side : of the smaller one's sides [m]
    """
    from scipy.ndimage import map_coordinates

    along = focus.along
    across = np.array([-along[1], along[0]])
    half = 0.5 * float(np.hypot(np.ptp(x), np.ptp(y)))
    line = np.arange(-half, half, 0.5 * side)
    centre = np.array([x.mean(), y.mean()])
    places = centre + line[:, None, None] * along + line[:, None] * across
    steps = np.array([np.diff(x).mean(), np.diff(y).mean()])
    turned = map_coordinates(focus.power, np.moveaxis((places - [x[0], y[0]]) / steps, 2, 0), order=1)
    ridge, at = turned.max(axis=1), line[turned.argmax(axis=1)]
    lit = np.flatnonzero(ridge >= ridge.max() * 10 ** (_ENDS / 10))
    slope, offset = np.polyfit(line[lit], at[lit], 1, w=np.sqrt(ridge[lit])) if len(lit) > 1 else (0.0, at[lit[0]])
    ends = [centre + u * along + (slope * u + offset) * across for u in line[lit[[0, -1]]]]
    length = float(np.hypot(*(ends[1] - ends[0])))
    direction = (along + slope * across) / np.hypot(1, slope)
    return (ends[0] + ends[1]) / 2, direction if direction.sum() > 0 else -direction, length
