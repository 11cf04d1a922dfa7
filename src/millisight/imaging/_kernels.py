"""The imagers' inner loops, compiled by Numba.

Every loop runs in parallel over voxels and serially over channels, so that a voxel's sum has one order and the
image does not depend on the number of threads.
"""

import math

import numpy as np
from numba import prange

from millisight import wave
from millisight.compiled import inline, kernel

_distance = inline(wave.distance)
_distance32 = inline(wave.distance, fastmath=True)
_wrapped = inline(wave.wrapped, fastmath=True)
_cosine = inline(wave.cosine, fastmath=True)
_sine = inline(wave.sine, fastmath=True)

# Voxels that one thread carries through all channels of a block: the scratch rows (nine of 4 bytes) and the range
# profile stay in the first-level cache, and the loops are long enough for vector code.
_TILE = 256


@kernel()
def exact_any(frames, tx, rx, wavenumbers, points, path_offset, sums):
    """sums[v] += sum over channels and samples of S exp(+i 2 pi f d / c), float64; any frequencies."""
    poses, transmitters, receivers, samples = frames.shape
    for v in prange(len(points)):
        total = 0.0 + 0.0j
        for p in range(poses):
            for t in range(transmitters):
                to = _path(points, v, tx, p, t)
                for r in range(receivers):
                    cycles = to + _path(points, v, rx, p, r) + path_offset
                    for j in range(samples):
                        angle = wave.TAU * (wavenumbers[j] * cycles)
                        total += frames[p, t, r, j] * complex(math.cos(angle), math.sin(angle))
        sums[v] += total


@kernel()
def exact_even(frames, tx, rx, wavenumbers, points, path_offset, sums):
    """As `exact_any` for evenly spaced frequencies: Horner's rule in exp(+i 2 pi step d), one sine a channel.

    A product of N unit phasors in float64 is good to N roundings, 1e-13.
    """
    poses, transmitters, receivers, samples = frames.shape
    step = (wavenumbers[samples - 1] - wavenumbers[0]) / max(samples - 1, 1)
    lanes = 64
    for tile in prange((len(points) + lanes - 1) // lanes):
        first = tile * lanes
        count = min(lanes, len(points) - first)
        turn_re, turn_im = np.empty(lanes), np.empty(lanes)
        sum_re, sum_im = np.empty(lanes), np.empty(lanes)
        path = np.empty(lanes)
        for p in range(poses):
            for t in range(transmitters):
                for r in range(receivers):
                    for i in range(count):
                        path[i] = _path(points, first + i, tx, p, t) + _path(points, first + i, rx, p, r) + path_offset
                        angle = wave.TAU * (step * path[i])
                        turn_re[i], turn_im[i] = math.cos(angle), math.sin(angle)
                        sum_re[i] = frames[p, t, r, samples - 1].real
                        sum_im[i] = frames[p, t, r, samples - 1].imag
                    for j in range(samples - 2, -1, -1):
                        sample = frames[p, t, r, j]
                        for i in range(count):
                            real = sum_re[i] * turn_re[i] - sum_im[i] * turn_im[i] + sample.real
                            sum_im[i] = sum_re[i] * turn_im[i] + sum_im[i] * turn_re[i] + sample.imag
                            sum_re[i] = real
                    for i in range(count):
                        angle = wave.TAU * (wavenumbers[0] * path[i])
                        sums[first + i] += complex(sum_re[i], sum_im[i]) * complex(math.cos(angle), math.sin(angle))


@inline
def _path(points, v, antennas, p, a):
    return _distance(
        points[v, 0] - antennas[p, a, 0], points[v, 1] - antennas[p, a, 1], points[v, 2] - antennas[p, a, 2]
    )


@kernel(fastmath=True, error_model="numpy")
def backproject(profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sum_re, sum_im):
    """sum[v] += sum over channels of P_k(d_k(v)) exp(+i 2 pi carrier d_k(v)) (primer 8), all in float32.

    Parameters
    ----------
    profiles : (P, T, R, M) complex64, range profile of each channel less the carrier's phase
    nearest, per_metre : path length of entry 0 [m], entries per metre of path length
    carrier : centre frequency over c [1/m]
    tx, rx : (P, T, 3), (P, R, 3) float32 [m]
    x, y, z : (V,) float32 voxel centres [m]
    sum_re, sum_im : (V,) float32, added to
    """
    poses, transmitters, receivers = profiles.shape[:3]
    for tile in prange((len(x) + _TILE - 1) // _TILE):
        first = tile * _TILE
        count = min(_TILE, len(x) - first)
        vx, vy, vz = x[first : first + count], y[first : first + count], z[first : first + count]
        to, path, part = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        entry = np.empty(_TILE, np.int32)
        low_re, low_im = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        high_re, high_im = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        total_re, total_im = np.zeros(_TILE, np.float32), np.zeros(_TILE, np.float32)
        for p in range(poses):
            for t in range(transmitters):
                ax, ay, az = tx[p, t, 0], tx[p, t, 1], tx[p, t, 2]
                for i in range(count):
                    to[i] = _distance32(vx[i] - ax, vy[i] - ay, vz[i] - az)
                for r in range(receivers):
                    bx, by, bz = rx[p, r, 0], rx[p, r, 1], rx[p, r, 2]
                    # Three loops rather than one: the first and the last become vector code, which the gathers
                    # in the middle would prevent.
                    for i in range(count):
                        d = to[i] + _distance32(vx[i] - bx, vy[i] - by, vz[i] - bz)
                        place = (d - nearest) * per_metre
                        path[i] = d
                        entry[i] = np.int32(place)
                        part[i] = place - np.float32(entry[i])
                    profile = profiles[p, t, r]
                    for i in range(count):
                        low, high = profile[entry[i]], profile[entry[i] + 1]
                        low_re[i], low_im[i] = low.real, low.imag
                        high_re[i], high_im[i] = high.real, high.imag
                    for i in range(count):
                        real = low_re[i] + part[i] * (high_re[i] - low_re[i])
                        imag = low_im[i] + part[i] * (high_im[i] - low_im[i])
                        turn = _wrapped(path[i] * carrier)
                        cosine, sine = _cosine(turn), _sine(turn)
                        total_re[i] += real * cosine - imag * sine
                        total_im[i] += real * sine + imag * cosine
        for i in range(count):
            sum_re[first + i] += total_re[i]
            sum_im[first + i] += total_im[i]
