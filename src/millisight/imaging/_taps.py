"""How fields are carried from a coarse axis to a finer one: eight taps, and their weights."""

import numpy as np

TAPS = 8


def axis_weights(coarse: np.ndarray, fine: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray] | None:
    """First tap (n,) and float32 weights (n, taps) that carry a field from one axis to another; None where the two are
    one."""
    if np.array_equal(coarse, fine):
        return None
    base, weights = taps_at(coarse, fine, band)
    return base, np.ascontiguousarray(weights, dtype=np.float32)


def as_it_is(count: int) -> tuple[np.ndarray, np.ndarray]:
    """First tap (n,) and weights (n, taps) that leave an axis of `count` points as it is."""
    base = np.maximum(np.minimum(np.arange(count), count - TAPS), 0)
    return base, np.eye(TAPS, dtype=np.float32)[np.arange(count) - base]


def taps_at(coarse: np.ndarray, places: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray]:
    """First tap (n,) and weights (n, taps) that interpolate at `places` (n,) [m]: the least mean squared error over all
    waves below the fraction `band` of the Nyquist frequency."""
    places = (places - coarse[0]) * ((len(coarse) - 1) / (coarse[-1] - coarse[0]))
    base = np.clip(np.floor(places).astype(np.int64) - TAPS // 2 + 1, 0, len(coarse) - TAPS)
    taps = np.arange(TAPS)
    normal = np.sinc(band * (taps[:, None] - taps)) + 1e-9 * np.eye(TAPS)
    return base, np.sinc(band * ((places - base)[:, None] - taps)) @ np.linalg.inv(normal)
