"""The wave that a smooth top has in a slice of an image: its direction, and how it turns from place to place.

The echo of a plane is a plane wave, whose direction is the plane's normal. That of a surface that bends a little is a
wave about its centre of curvature, or about two of them: its direction follows the normal.
"""

from typing import NamedTuple

import numpy as np

from millisight.data import SarImage, VoxelGrid
from millisight.perception.segmentation._heights import pixel_sides
from millisight.perception.segmentation._parts import parts_of

AGREEING = 0.7
"""Share of the amplitudes that remains at least when they are added in phase with a top's wave."""

_WINDOW = 0.015  # in which waves are compared [m]
_BRIGHT = -12.0  # of the brightest window, below which no top is looked for [dB]
_LIT = -15.0  # of the brightest slice of a part, in which no wave is looked for [dB]
_ROUNDS = 4  # in which a direction and its place settle
_BENT_ROUNDS = 6  # in which a bend does, and its place grows
_SETTLED = 0.01  # phase by which a round changes it at most [rad]
_MOST_BENT = 8.0  # [1/m]; what bends more is round
_AT_THE_LIMIT = 0.98  # of it, a fit would go on


class WavePhase(NamedTuple):
    """Phases over x and y, of the second degree: slopes . p + p . bends . p / 2, with p the place from `about`.

    Attributes
    ----------
    about : (2,) [m]
    slopes : (2,) [rad/m]
    bends : (2, 2) symmetric [rad/m²]
    """

    about: np.ndarray
    slopes: np.ndarray
    bends: np.ndarray

    def on(self, grid: VoxelGrid) -> np.ndarray:
        """(A, B) over a grid's pixels [rad]."""
        x, y = grid.x[:, None] - self.about[0], grid.y - self.about[1]
        (xx, xy), (_, yy) = self.bends
        return self.slopes[0] * x + self.slopes[1] * y + xx * x * x / 2 + xy * x * y + yy * y * y / 2

    def slopes_at(self, place: np.ndarray) -> np.ndarray:
        """(2,) at a place (2,) [rad/m]."""
        return self.slopes + self.bends @ (place - self.about)


class TopWave(NamedTuple):
    """A top's wave in a slice of an image.

    Attributes
    ----------
    phase : WavePhase
    height : of the slice [m]
    values : (A, B) of the slice less these phases, real and positive where the top is
    inside : (A, B) bool, where it is, a window from the edge or nearer
    """

    phase: WavePhase
    height: float
    values: np.ndarray
    inside: np.ndarray


def top_wave(part: np.ndarray, image: SarImage, wavenumber: float) -> TopWave | None:
    """The wave that most of a part (A, B) of a mask has, a plane one where it would bend too much; None if none fills a
    window of it.

    wavenumber : there and back [rad/m]
    """
    found = _strongest(part, image)
    if found is None:
        return None
    (k, start), most = found, _MOST_BENT * wavenumber
    whole = image.values[..., k]
    alone, nowhere = np.where(part, whole, 0), np.zeros(part.shape, bool)
    plane = _settled(start, nowhere, alone, part, image, rounds=_ROUNDS, most=0.0)
    bent = plane and _settled(*plane, alone, part, image, rounds=_BENT_ROUNDS, most=most)
    if plane is None or bent is None:
        return None
    # What is small tells no bend, and of what bends more a narrow strip is left.
    too_much = np.abs(np.linalg.eigvalsh(bent[0].bends)).max() >= _AT_THE_LIMIT * most
    phase, inside = plane if too_much else bent
    turned = whole * np.exp(-1j * phase.on(image.grid))
    return TopWave(phase, float(image.grid.z[k]), turned * np.exp(-1j * np.angle(turned[inside].sum())), inside)


def _strongest(part: np.ndarray, image: SarImage) -> tuple[int, WavePhase] | None:
    """The slice in which one plane wave of a part (A, B) is strongest, and its phases; None where the part is dark."""
    from scipy import fft

    grid, power = image.grid, np.square(np.abs(image.values[part]), dtype=float).sum(axis=0)
    lit = np.flatnonzero(power >= max(power.max() * 10 ** (_LIT / 10), 1e-300))
    if not len(lit):
        return None
    shape = [fft.next_fast_len(2 * size) for size in part.shape]
    spectra = np.abs(fft.fft2(np.moveaxis(image.values[..., lit] * part[..., None], 2, 0), shape))
    k, i, j = np.unravel_index(int(spectra.argmax()), spectra.shape)
    waves = [fft.fftfreq(n, side)[m] for n, side, m in zip(shape, pixel_sides(image), (i, j), strict=True)]
    about = np.array([grid.x.mean(), grid.y.mean()])
    return int(lit[k]), WavePhase(about, 2 * np.pi * np.array(waves), np.zeros((2, 2)))


def _settled(
    phase: WavePhase,
    inside: np.ndarray,
    alone: np.ndarray,
    part: np.ndarray,
    image: SarImage,
    *,
    rounds: int,
    most: float,
) -> tuple[WavePhase, np.ndarray] | None:
    """Phases that fit a slice (A, B), 0 beside its part, and where they do, (A, B) bool; None if nowhere.

    phase, inside : to begin with; most : that the phases bend by, 0: not at all
    """
    from scipy.ndimage import uniform_filter

    grid, windows = image.grid, [max(1, round(_WINDOW / side)) for side in pixel_sides(image)]
    level = uniform_filter(np.abs(alone), windows, mode="constant")
    bright = part & (level >= level.max() * 10 ** (_BRIGHT / 20))
    turns = phase.on(grid)
    for _ in range(rounds):
        turned = alone * np.exp(-1j * turns)
        mean = uniform_filter(turned.real, windows, mode="constant") + 1j * uniform_filter(
            turned.imag, windows, mode="constant"
        )
        agreeing = bright & (np.abs(mean) >= AGREEING * level)
        if not agreeing.any():
            return None
        parts, _ = parts_of(agreeing)
        before, inside = (inside, turns), parts == np.bincount(parts.ravel())[1:].argmax() + 1
        phase = _refined(phase, mean, inside, grid, most=most)
        turns = phase.on(grid)
        if (inside == before[0]).all() and abs(turns - before[1])[inside].max() < _SETTLED:
            break
    return phase, inside


def _refined(phase: WavePhase, mean: np.ndarray, inside: np.ndarray, grid: VoxelGrid, *, most: float) -> WavePhase:
    """Phases and what a mean (A, B) still turns by from one of the pixels inside to the next, by least squares.

    most : that they bend by; 0: slopes alone change
    """
    rows, slopes, weights = [], [], []
    x, y = grid.x - phase.about[0], grid.y - phase.about[1]
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    for axis in (0, 1):
        one, there, at = (np.moveaxis(array, axis, 0) for array in (mean, inside, places))
        both = there[1:] & there[:-1]
        products = (one[1:] * np.conj(one[:-1]))[both]
        u, v = ((at[1:] + at[:-1]) / 2)[both].T
        full, none = np.ones(len(u)), np.zeros(len(u))
        rows.append(np.stack([full, none, u, v, none] if axis == 0 else [none, full, none, u, v], axis=1))
        slopes.append(np.angle(products) / (at[1, 0, axis] - at[0, 0, axis]))
        weights.append(np.sqrt(np.abs(products)))
    terms = 5 if most else 2
    weight = np.concatenate(weights)
    by = np.concatenate(rows)[:, :terms] * weight[:, None]
    scale = np.maximum(np.linalg.norm(by, axis=0), 1e-30)
    change = np.zeros(5)
    by /= scale
    change[:terms] = np.linalg.lstsq(by.T @ by, by.T @ (np.concatenate(slopes) * weight), rcond=1e-10)[0] / scale
    bends = phase.bends + change[[[2, 3], [3, 4]]]
    strongest = float(np.abs(np.linalg.eigvalsh(bends)).max())
    return phase._replace(slopes=phase.slopes + change[:2], bends=bends * min(1.0, most / max(strongest, 1e-30)))
