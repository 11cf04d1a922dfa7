"""The error of a whole image, measured with every channel (primer 8).

A few poses tell what range profiles err by, as long as the image is as large beside its error as theirs are. It is not
where the channels cancel: in the dark, or all over a grid that is smaller than the resolution. So the image is compared
with the sum over all of its channels at some voxels. `image_at` would take a second for each; but range profiles are
oversampled, and eight taps in place of two find what lies between their entries to some 1e-5.

The random voxels are stratified (`_near`): what interpolated fields err by may sit in the hundredth of the voxels next
to the antennas, where a scan passes through its grid, or at the ends of axes, where no taps lie on one side.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from millisight.core import for_kernel
from millisight.imaging._near import distances, evenly, some_ends
from millisight.imaging._refraction import Excess
from millisight.imaging._taps import TAPS as FIELD_TAPS

_NEAREST, _AT_ENDS, _BEYOND, _BRIGHTEST = 48, 48, 144, 64  # voxels: next to the antennas, at ends of axes, elsewhere
_POOL = 2048  # uniformly random voxels of which the former are taken

_PARTS = 1024  # of an entry, for which weights are kept: 1e-4 of error, whose sign is any


class Deviation(NamedTuple):
    """How far an image lies from the truth at random voxels and at the brightest: sums of squares (2,), weighted so
    that the random voxels stand for all of them.

    Attributes
    ----------
    whole : of what the image errs by
    profiles : of what linear interpolation of its range profiles errs by
    truth : of the truth; for the random voxels, of the whole image
    """

    whole: np.ndarray
    profiles: np.ndarray
    truth: np.ndarray

    @property
    def error(self) -> float:
        """Relative L2 error, at random voxels or at the brightest, whichever is more."""
        return self._relative(self.whole)

    @property
    def profile_error(self) -> float:
        """What of it is the range profiles'."""
        return self._relative(self.profiles)

    @property
    def by_profiles(self) -> bool:
        """Whether finer range profiles would help: they make half of the error or more."""
        return self.profile_error >= self.error / 2

    def _relative(self, squares: np.ndarray) -> float:
        shown = self.truth > 0
        return float(np.sqrt(np.divide(squares, self.truth, where=shown, out=(squares > 0).astype(float))).max())


def of_whole(parts: list[Deviation]) -> Deviation:
    """The deviation of an image from those of its parts."""
    return Deviation(*(np.sum(squares, axis=0) for squares in zip(*parts, strict=True)))


class Check:
    """An image beside the sum over all its channels, at random voxels and at the brightest that its first part shows.

    Parameters
    ----------
    axes : of the grid, in the order of the antennas' coordinates [m]
    tx, rx : of the whole scan, (P, T, 3) and (P, R, 3) [m]
    oversampling : of the range profiles
    """

    def __init__(self, axes: tuple[np.ndarray, ...], tx: np.ndarray, rx: np.ndarray, oversampling: int) -> None:
        self.axes, self.oversampling = axes, oversampling
        self.shape = tuple(map(len, axes))
        size = int(np.prod(self.shape))
        self.brightest = min(_BRIGHTEST, size)
        rng = np.random.default_rng(0)
        pool = rng.choice(size, _POOL) if size > _POOL else np.arange(size)
        away = distances(self._points(pool).T, *some_ends(tx, rx, rng)[1:]).min(axis=1)
        pool = pool[np.argsort(away)]
        ends, near = self._at_ends(pool), np.arange(len(pool)) < len(pool) // 16
        numbers, weights = evenly([(near, _NEAREST), (ends & ~near, _AT_ENDS), (~(ends | near), _BEYOND)])
        self.random = pool[numbers]
        self.weights = np.concatenate([weights * len(weights), np.ones(self.brightest)])
        self.picks: np.ndarray | None = None
        self.points = np.empty((3, 0))
        self.sums = np.zeros((2, len(self.weights)), dtype=np.complex128)

    def add(
        self,
        profiles: np.ndarray,
        nearest: tuple[np.ndarray, np.ndarray],
        per_metre: float,
        carrier: float,
        tx: np.ndarray,
        rx: np.ndarray,
        excess: Excess | None,
        image: Callable[[], np.ndarray],
    ) -> None:
        """Add range profiles (P, T, R, M), which `image`, called for real and imaginary part (2, X, Y, Z), holds."""
        from millisight.imaging._check_kernels import TAPS, sums_at

        if self.picks is None:
            magnitude = np.hypot(*image()).ravel()
            self.picks = np.concatenate([self.random, np.argpartition(magnitude, -self.brightest)[-self.brightest :]])
            self.points = self._points(self.picks)
        entries = profiles.shape[3]
        if entries < TAPS:
            profiles = np.pad(profiles, [(0, 0)] * 3 + [(0, TAPS - entries)])
        table, frame = (None, None) if excess is None else excess[:2]
        sums_at(
            profiles, *nearest, float(per_metre), float(carrier), for_kernel(tx), for_kernel(rx), table, frame,
            _weights(self.oversampling, min(entries, TAPS)), self.points, *self.sums,
        )  # fmt: skip

    def deviation(self, image: np.ndarray) -> Deviation:
        """Of the whole image (2, X, Y, Z) from the sums."""
        real, imag = image.reshape(2, -1)[:, self.picks].astype(np.float64)
        truth, linear = self.sums
        parts = real + 1j * imag - truth, linear - truth, truth
        starts = [0, len(self.random)]
        whole, profiles, energy = (np.add.reduceat(np.square(np.abs(p)) * self.weights, starts) for p in parts)
        # Of a few bright voxels a sample may hold too many or none: what all hold is known from the image itself.
        energy[0] = len(self.random) * float(np.square(image, dtype=np.float64).sum()) / (image.size / 2)
        return Deviation(whole, profiles, energy)

    def _at_ends(self, numbers: np.ndarray) -> np.ndarray:
        """(V,) bool: which of the voxels (V,) are the first or last of an axis on which fields are interpolated."""
        places = np.unravel_index(numbers, self.shape)
        long = [(place, size) for place, size in zip(places, self.shape, strict=True) if size > FIELD_TAPS]
        return np.any([np.zeros(len(numbers), bool), *((p == 0) | (p == size - 1) for p, size in long)], axis=0)

    def _points(self, numbers: np.ndarray) -> np.ndarray:
        """(3, V) places of voxels (V,) [m]."""
        places = np.unravel_index(numbers, self.shape)
        return np.stack([axis[place] for axis, place in zip(self.axes, places, strict=True)])


@cache
def _weights(oversampling: int, taps: int) -> Any:
    """(n, TAPS) float32 weights of the first `taps` entries, for places 0 to TAPS - 1 among them: the least mean
    squared error over the profiles' band, whose ends `range_steering` raised by 1 / sinc²."""
    from millisight.imaging._check_kernels import TAPS

    # Gauss' rule over half of the band, in cycles an entry; the other half is its mirror image.
    nodes, parts = np.polynomial.legendre.leggauss(32)
    waves = (nodes + 1) / 4 / oversampling
    entries = np.arange(taps)

    def over_the_band(away: np.ndarray, response: np.ndarray) -> np.ndarray:
        return np.cos(2 * np.pi * np.multiply.outer(away, waves)) @ (response * parts / 2)

    normal = over_the_band(entries[:, None] - entries, np.ones_like(waves)) + 1e-9 * np.eye(taps)
    places = np.arange((TAPS - 1) * _PARTS + 1) / _PARTS
    wanted = over_the_band(places[:, None] - entries, np.sinc(waves) ** 2)
    weights = np.zeros((len(places), TAPS), dtype=np.float32)
    weights[:, :taps] = np.linalg.solve(normal, wanted.T).T
    return weights
