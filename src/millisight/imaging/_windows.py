"""Windows over range and aperture: lower sidelobes for a wider main lobe (primer 9)."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from millisight.core import Registry
from millisight.core.errors import InputError

WINDOWS: Registry[Callable[[np.ndarray], np.ndarray]] = Registry("window", "millisight.windows")
"""Windows by name: functions of (n,) places from -1 to 1, the ends, that return (n,) weights."""

WindowName = Literal["hann", "taylor"] | str
Window = WindowName | tuple[WindowName | None, WindowName | None] | None


def window_pair(window: Window) -> tuple[str | None, str | None]:
    """The window over range and the window over the aperture; a single name stands for both.

    Raises
    ------
    UnknownNameError
        No window goes by that name.
    InputError
        It is no name and no pair of names.
    """
    pair = (window, window) if window is None or isinstance(window, str) else window
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"window is {window!r}; expected a name, or a pair of names (range, aperture)")
    for name in pair:
        if name is not None:
            _ = WINDOWS[name]  # refuses a name that is not known, before any work
    return pair[0], pair[1]


def range_weights(name: str | None, samples: int) -> np.ndarray:
    """(N,) weights of the samples of a chirp, of mean 1, so that a unit reflector still images to 1."""
    return _mean_one(_taper(name, np.linspace(-1, 1, samples) * (samples - 1) / samples))


def aperture_weights(name: str | None, positions: np.ndarray) -> np.ndarray:
    """(P,) weights of the poses, of mean 1: the product of tapers along the two widest axes of the aperture.

    The taper depends on where a pose lies between the ends of the aperture, so any positions will do, not
    only rasters; an axis along which the radar did not move has no taper.
    """
    weights = np.ones(len(positions))
    if name is None:
        return weights
    extents = np.ptp(positions, axis=0)
    for axis in np.argsort(extents)[1:]:
        if extents[axis] > 0:
            middle = (positions[:, axis].min() + positions[:, axis].max()) / 2
            # Slightly inside the ends, so that the outermost poses are not measured in vain.
            weights *= _taper(name, (positions[:, axis] - middle) / (extents[axis] / 2) * (1 - 1e-3))
    return _mean_one(weights)


@WINDOWS.add("hann")
def hann(u: np.ndarray) -> np.ndarray:
    """Hann: cos²(pi u / 2), 0 at the ends."""
    return np.cos(np.pi / 2 * u) ** 2


@WINDOWS.add("taylor")
def taylor(u: np.ndarray) -> np.ndarray:
    """Taylor with nbar = 4 and sidelobes at -30 dB, in closed form: 1 + 2 sum F_m cos(m pi u).

    After Carrara, Goodman, Majewski, Spotlight Synthetic Aperture Radar, appendix D.
    """
    nbar = 4
    a = np.arccosh(10 ** (30 / 20)) / np.pi
    sigma2 = nbar**2 / (a**2 + (nbar - 0.5) ** 2)
    orders = np.arange(1, nbar)
    taper = np.ones_like(u)
    for m in orders:
        numerator = np.prod(1 - m**2 / sigma2 / (a**2 + (orders - 0.5) ** 2))
        denominator = np.prod([1 - m**2 / n**2 for n in orders if n != m])
        taper = taper - (-1.0) ** m * numerator / denominator * np.cos(m * np.pi * u)
    return taper


def _taper(name: str | None, u: np.ndarray) -> np.ndarray:
    """(n,) the window at u (n,); of ones without a name."""
    return np.ones_like(u) if name is None else WINDOWS[name](u)


def _mean_one(weights: np.ndarray) -> np.ndarray:
    return weights / weights.mean()
