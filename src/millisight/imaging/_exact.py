"""Eq. 1 as it stands, in float64, at any points: the yardstick for every other imager."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex
from numpy.typing import ArrayLike, DTypeLike

from millisight.core import SPEED_OF_LIGHT, as_array, checked_number, checked_record, for_kernel
from millisight.data import Layers
from millisight.imaging._refraction import exact_layers


def image_at(
    frames: ArrayLike,
    tx_positions: ArrayLike,
    rx_positions: ArrayLike,
    frequencies: ArrayLike,
    points: ArrayLike,
    path_offset: float = 0.0,
    *,
    layers: Layers | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Complex[np.ndarray, " V"]:
    """Compute the image at any points, in float64 (paper Eq. 1, primer 4).

    I(x) = 1 / (K N) sum_k sum_j S_kj exp(+i 2 pi f_j d_k(x) / c),  d = |x - p_t| + |x - p_r| + path_offset.

    Parameters
    ----------
    frames : (P, T, R, N) pose x transmitter x receiver x sample
    tx_positions, rx_positions : (P, T, 3), (P, R, 3) [m]
    frequencies : (N,) of the samples [Hz]; they need not be evenly spaced
    points : (V, 3) [m]
    path_offset : constant extra path [m]
    layers : layers of the capture (`Capture.layers`); None: straight paths
    progress : called with (poses done, poses in all)

    Returns
    -------
    (V,) complex128

    Raises
    ------
    InputError
        The shapes do not match, or a value is not a finite number.

    Examples
    --------
    >>> point = np.array([[0.01, 0.02, -0.3]])
    >>> antenna = np.zeros((1, 1, 3))
    >>> frequencies = np.array([77e9, 78e9])
    >>> d = 2 * np.linalg.norm(point)
    >>> frames = np.exp(-2j * np.pi * frequencies * d / 299792458.0).reshape(1, 1, 1, 2)
    >>> print(f"{abs(image_at(frames, antenna, antenna, frequencies, point)[0]):.10f}")
    1.0000000000
    """
    from millisight.imaging import _kernels as _kernels

    # Whatever does not fit would be read from beyond the arrays' ends.
    frames = _ready(frames, "frames", ("P", "T", "R", "N"), dtype=np.complex128)
    poses, transmitters, receivers, samples = frames.shape
    tx_positions = _ready(tx_positions, "tx_positions", (poses, transmitters, 3), unit="m")
    rx_positions = _ready(rx_positions, "rx_positions", (poses, receivers, 3), unit="m")
    wavenumbers = _ready(frequencies, "frequencies", (samples,), unit="Hz") / SPEED_OF_LIGHT
    points = _ready(points, "points", ("V", 3), unit="m")
    path_offset = checked_number(path_offset, name="path_offset", unit="m")
    bent = None if layers is None else tuple(exact_layers(checked_record(layers, Layers, name="layers")))
    even = np.ptp(np.diff(wavenumbers)) <= 1e-12 * wavenumbers[-1] if len(wavenumbers) > 2 else True
    sums = np.zeros(len(points), dtype=np.complex128)
    # So many poses at a time that progress shows and Ctrl-C is heard within about a second.
    step = max(1, int(2e9 / (max(len(points), 64) * frames[0].size)))
    for start in range(0, len(frames), step):
        block = slice(start, min(start + step, len(frames)))
        kernel = _kernels.exact_even if even else _kernels.exact_any
        kernel(frames[block], tx_positions[block], rx_positions[block], wavenumbers, points, path_offset, bent, sums)
        if progress is not None:
            progress(block.stop, len(frames))
    return sums / frames.size


def _ready(
    value: ArrayLike, name: str, shape: tuple[int | str, ...], *, dtype: DTypeLike = np.float64, unit: str = ""
) -> np.ndarray:
    """`value` as the kernels need it, checked; not copied where it already is so."""
    return for_kernel(as_array(value, name=name, shape=shape, dtype=dtype, unit=unit))
