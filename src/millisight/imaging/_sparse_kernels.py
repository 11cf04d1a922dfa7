"""Backprojection piece by piece, and its adjoint, compiled: from range profiles to points and back."""

import numpy as np

from millisight.core import inline, kernel, phase, prange

_distance = inline(phase.distance, fastmath=True)
_wrapped = inline(phase.wrapped, fastmath=True)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)
_TILE = 256


@kernel(fastmath=True, error_model="numpy")
def gather(profiles, nearest, per_metre, carrier, tx, rx, poses, starts, points, fields):
    """fields[s, v] = sum over the channels of poses[starts[s]:starts[s + 1]] of P(d) exp(+i 2 pi carrier d).

    Parameters
    ----------
    profiles : (P, T, R, M) complex64, range profile of each channel less the carrier's phase
    nearest, per_metre : path length of entry 0 [m], entries per metre of path length
    carrier : centre frequency over c [1/m]
    tx, rx : (P, T, 3), (P, R, 3) float32 [m]
    poses, starts : (n,), (S + 1,) which poses each of S sums is over
    points : (3, V) float32 [m]
    fields : (S, V) complex64, overwritten
    """
    tiles = (points.shape[1] + _TILE - 1) // _TILE
    for job in prange((len(starts) - 1) * tiles):
        s, first = job // tiles, (job % tiles) * _TILE
        count = min(_TILE, points.shape[1] - first)
        x, y, z = (
            points[0, first : first + count],
            points[1, first : first + count],
            points[2, first : first + count],
        )
        to, path = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        entry, part = np.empty(_TILE, np.int32), np.empty(_TILE, np.float32)
        low_re, low_im = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        high_re, high_im = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        total_re, total_im = np.zeros(_TILE, np.float32), np.zeros(_TILE, np.float32)
        for n in range(starts[s], starts[s + 1]):
            p = poses[n]
            for t in range(tx.shape[1]):
                ax, ay, az = tx[p, t, 0], tx[p, t, 1], tx[p, t, 2]
                for i in range(count):
                    to[i] = _distance(x[i] - ax, y[i] - ay, z[i] - az)
                for r in range(rx.shape[1]):
                    bx, by, bz = rx[p, r, 0], rx[p, r, 1], rx[p, r, 2]
                    for i in range(count):
                        path[i] = to[i] + _distance(x[i] - bx, y[i] - by, z[i] - bz)
                        place = (path[i] - nearest) * per_metre
                        entry[i] = np.int32(place)
                        part[i] = place - np.float32(entry[i])
                    for i in range(count):
                        low, high = profiles[p, t, r, entry[i]], profiles[p, t, r, entry[i] + 1]
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
            fields[s, first + i] = complex(total_re[i], total_im[i])


@kernel(fastmath=True, error_model="numpy")
def project(real, imag, nearest, per_metre, carrier, tx, rx, x, y, z, profiles):
    """profiles[p, t, r] = sum over voxels of their values exp(-i 2 pi carrier d), shared by two entries around d.

    The adjoint of `gather`: each gather of two entries of a profile becomes a scatter to the same two with
    the same weights. Runs in parallel over poses, so that no two threads write to one profile.

    Parameters
    ----------
    real, imag : (V,) float32 values of the voxels
    nearest, per_metre, carrier, tx, rx, x, y, z : as of `gather`
    profiles : (P, T, R, M) complex64, overwritten
    """
    for p in prange(len(profiles)):
        to, path = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        entry, part = np.empty(_TILE, np.int32), np.empty(_TILE, np.float32)
        re, im = np.empty(_TILE, np.float32), np.empty(_TILE, np.float32)
        profiles[p] = 0
        for first in range(0, len(x), _TILE):
            count = min(_TILE, len(x) - first)
            vx, vy, vz = x[first : first + count], y[first : first + count], z[first : first + count]
            vre, vim = real[first : first + count], imag[first : first + count]
            for t in range(tx.shape[1]):
                ax, ay, az = tx[p, t, 0], tx[p, t, 1], tx[p, t, 2]
                for i in range(count):
                    to[i] = _distance(vx[i] - ax, vy[i] - ay, vz[i] - az)
                for r in range(rx.shape[1]):
                    bx, by, bz = rx[p, r, 0], rx[p, r, 1], rx[p, r, 2]
                    profile = profiles[p, t, r]
                    for i in range(count):
                        path[i] = to[i] + _distance(vx[i] - bx, vy[i] - by, vz[i] - bz)
                        place = (path[i] - nearest) * per_metre
                        entry[i] = np.int32(place)
                        part[i] = place - np.float32(entry[i])
                    for i in range(count):
                        turn = _wrapped(path[i] * carrier)
                        cosine, sine = _cosine(turn), _sine(turn)
                        re[i] = vre[i] * cosine + vim[i] * sine
                        im[i] = vim[i] * cosine - vre[i] * sine
                    for i in range(count):
                        e, w = entry[i], part[i]
                        profile[e] += complex(re[i] * (np.float32(1) - w), im[i] * (np.float32(1) - w))
                        profile[e + 1] += complex(re[i] * w, im[i] * w)
