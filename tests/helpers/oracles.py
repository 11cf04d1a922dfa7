"""The physics once more, as plainly as NumPy can say it and by other formulas than the library's: what tests hold
the library to."""

import os
from pathlib import Path

import numpy as np
import pytest

C = 299_792_458.0

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def shared(*parts: str) -> Path:
    """A file of the shared data, or a skip with the reason."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"needs the shared data: {'/'.join(parts)} is not beside the repository")
    return path


def scans() -> list[Path]:
    """The real scans that tests go through: every third of the 38, or all with MILLISIGHT_ALL_SCANS=1; [] without."""
    found = sorted((SHARED / "ycb").glob("*.ply"))
    return found if os.environ.get("MILLISIGHT_ALL_SCANS") else found[::3]


def paths(points, tx, rx, offset=0.0):
    """(P, T, R, V) path lengths of points (V, 3) between tx (P, T, 3) and rx (P, R, 3)."""
    points = np.asarray(points, dtype=float)
    to = np.linalg.norm(points[None, None] - tx[:, :, None], axis=-1)
    back = np.linalg.norm(points[None, None] - rx[:, :, None], axis=-1)
    return to[:, :, None] + back[:, None] + offset


def point_frames(points, amplitudes, tx, rx, frequencies, offset=0.0):
    """(P, T, R, N) complex128 frames of point reflectors: sum of a exp(-i 2 pi f d / c)."""
    d = paths(points, tx, rx, offset)
    frequencies = np.asarray(frequencies, dtype=float)
    steps = np.diff(frequencies)
    if len(steps) < 2 or np.ptp(steps) > 1e-9 * abs(steps[0]):
        return np.stack([(amplitudes * np.exp(-2j * np.pi * f * d / C)).sum(axis=-1) for f in frequencies], axis=-1)
    # Even steps: every sample's wave is the last one's, turned; ten times as quick as one exponential each.
    wave = amplitudes * np.exp(-2j * np.pi * frequencies[0] * d / C)
    turn = np.exp(-2j * np.pi * steps.mean() * d / C)
    frames = np.empty((*d.shape[:3], len(frequencies)), complex)
    for j in range(len(frequencies)):
        frames[..., j] = wave.sum(axis=-1)
        wave *= turn
    return frames


def point_image(points, at, tx, rx, frequencies, offset=0.0):
    """(V,) image at `points` of a unit reflector at `at` (3,), in closed form: a Dirichlet kernel a channel.

    For evenly spaced frequencies the sum over samples is a geometric series.
    """
    difference = paths(points, tx, rx) - paths(np.asarray(at)[None], tx, rx)
    n, step = len(frequencies), frequencies[1] - frequencies[0] if len(frequencies) > 1 else 0.0
    half = np.pi * step * difference / C
    with np.errstate(invalid="ignore", divide="ignore"):
        dirichlet = np.where(np.abs(np.sin(half)) < 1e-14, 1.0, np.sin(n * half) / (n * np.sin(half)))
    carrier = np.exp(2j * np.pi * frequencies.mean() * difference / C)
    return (carrier * dirichlet).mean(axis=(0, 1, 2))


def width_3db(coordinate, values):
    """Full width of |values|² at half its maximum along `coordinate`, by linear interpolation."""
    power = np.abs(values) ** 2
    power = power / power.max()
    top = int(np.argmax(power))
    above = power >= 0.5
    left = top - int(np.argmin(above[top::-1]))
    right = top + int(np.argmin(above[top:]))
    if above[left] or above[right]:
        raise AssertionError("the cut does not fall below half its maximum on both sides")
    return np.interp(0.5, power[right : right - 2 : -1], coordinate[right : right - 2 : -1]) - np.interp(
        0.5, power[left : left + 2], coordinate[left : left + 2]
    )


def relative(actual, expected):
    """Relative L2 distance."""
    return np.linalg.norm(np.ravel(actual) - np.ravel(expected)) / np.linalg.norm(np.ravel(expected))


def fresnel(permittivity, cosine):
    """(2, ...) reflection of a half-space in air, TE and TM: both -1 off a conductor."""
    index = np.sqrt(permittivity - 1 + np.square(cosine) + 0j)
    te = (cosine - index) / (cosine + index)
    return np.stack([te, (index - permittivity * cosine) / (index + permittivity * cosine)])


def snell(points, antennas, layers, index):
    """(P, V) shortest paths from antennas above to points below plane layers, in wavelengths' metres of vacuum.

    By Fermat's principle: the ray parameter for which the sideways steps add up, by bisection.
    """
    across = np.linalg.norm(points[None, :, :2] - antennas[:, None, :2], axis=-1)
    depth = (antennas[:, None, 2] - points[None, :, 2]) - sum(t for t, _ in layers)
    parts = [(depth, index), *((t + 0 * depth, np.sqrt(e)) for t, e in layers)]
    low, high = 0 * across, 0 * across + min(n if np.ndim(n) == 0 else n.min() for _, n in parts) * (1 - 1e-12)
    for _ in range(80):
        p = (low + high) / 2
        reach = sum(t * p / np.sqrt(n**2 - p**2) for t, n in parts)
        low, high = np.where(reach < across, p, low), np.where(reach < across, high, p)
    return sum(t * n**2 / np.sqrt(n**2 - p**2) for t, n in parts)
