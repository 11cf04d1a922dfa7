"""The simulator's inner loops, compiled by Numba: the specular test, and the sum over lit vertices."""

import numpy as np

from millisight.core import inline, kernel, phase, prange, subroutine
from millisight.core import product as product  # here for whoever asks the kernels of a device

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)


_MANY = 64  # entries of a row that are asked together whether any of them is set


@subroutine
def _some(octets, start, stop):
    """Whether some byte of `octets` from start to stop is not zero: vector code, with which long empty stretches are
    passed over."""
    found = np.uint8(0)
    for i in range(np.uint64(start), np.uint64(stop)):
        found |= octets[i]
    return found != 0


def set_places(rows):
    """(n,) row and (n,) column of what is set in bool `rows` (R, C), in their order."""
    octets = np.ascontiguousarray(rows).reshape(-1).view(np.uint8)
    counts = np.empty(len(rows), np.int64)
    _count(octets, counts)
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    row, column = np.empty(starts[-1], np.int64), np.empty(starts[-1], np.int64)
    _place(octets, starts, row, column)
    return row, column


@kernel(fastmath=True, error_model="numpy")
def _count(octets, counts):
    columns = len(octets) // max(len(counts), 1)
    for r in prange(len(counts)):
        count = 0
        for first in range(r * columns, (r + 1) * columns, _MANY):
            last = min(first + _MANY, (r + 1) * columns)
            if _some(octets, first, last):
                for i in range(first, last):
                    count += octets[i]
        counts[r] = count


@kernel(fastmath=True, error_model="numpy")
def _place(octets, starts, row, column):
    columns = len(octets) // max(len(starts) - 1, 1)
    for r in prange(len(starts) - 1):
        at = starts[r]
        for first in range(0, columns, _MANY):
            last = min(first + _MANY, columns)
            if at < starts[r + 1] and _some(octets, r * columns + first, r * columns + last):
                for c in range(first, last):
                    if octets[r * columns + c]:
                        row[at], column[at] = r, c
                        at += 1


@kernel(fastmath=True, error_model="numpy")
def specular(tx, rx, vertices, normals, cos_tau, two_sided, lit):
    """lit[c, v]: is normal v within tau of the bisector of the directions to tx[c] and rx[c]? (primer 11)

    vertices and normals are (3, V), so that the loop over v becomes vector code; squares spare it the roots.
    """
    for c in prange(len(tx)):
        together = tx[c, 0] == rx[c, 0] and tx[c, 1] == rx[c, 1] and tx[c, 2] == rx[c, 2]
        tx0, tx1, tx2 = tx[c, 0], tx[c, 1], tx[c, 2]
        rx0, rx1, rx2 = rx[c, 0], rx[c, 1], rx[c, 2]
        bound = cos_tau * abs(cos_tau)
        if together:
            for v in range(lit.shape[1]):
                x, y, z = tx0 - vertices[0, v], tx1 - vertices[1, v], tx2 - vertices[2, v]
                along = x * normals[0, v] + y * normals[1, v] + z * normals[2, v]
                along = abs(along) if two_sided else along
                lit[c, v] = along * abs(along) > bound * (x * x + y * y + z * z)
        else:
            for v in range(lit.shape[1]):
                ax, ay, az = tx0 - vertices[0, v], tx1 - vertices[1, v], tx2 - vertices[2, v]
                bx, by, bz = rx0 - vertices[0, v], rx1 - vertices[1, v], rx2 - vertices[2, v]
                a, b = _distance(ax, ay, az), _distance(bx, by, bz)
                # The bisector of unit vectors, times a b, which spares the divisions.
                x, y, z = ax * b + bx * a, ay * b + by * a, az * b + bz * a
                along = x * normals[0, v] + y * normals[1, v] + z * normals[2, v]
                along = abs(along) if two_sided else along
                lit[c, v] = along * abs(along) > bound * (x * x + y * y + z * z)


@kernel(fastmath=True)
def node_signals(weights, tx, rx, vertices, reflections, spread, center, path_offset, carrier, half_band, nodes, out):
    """out[c, n] = sum over v of w_cv a_v exp(-i 2 pi (carrier d + half_band nodes[n] (d - d_c))) (primer 13).

    `weights` w (C, V) are bool or float32; nothing is computed where they are 0. `carrier` and `half_band` are
    frequencies over c [1/m]; d is the path length of channel c over vertex v with the path offset, d_c that over the
    scene's `center`. Phases at the carrier are counted in float64 and wrapped, the rest is small enough for float32.
    """
    channels, points = weights.shape
    octets, size = weights.reshape(-1).view(np.uint8), weights.itemsize
    for c in prange(channels):
        base = np.empty(points, np.float32)
        slope = np.empty(points, np.float32)
        real = np.empty(points, np.float32)
        imag = np.empty(points, np.float32)
        tx0, tx1, tx2 = tx[c, 0], tx[c, 1], tx[c, 2]
        rx0, rx1, rx2 = rx[c, 0], rx[c, 1], rx[c, 2]
        d_c = _distance(center[0] - tx0, center[1] - tx1, center[2] - tx2)
        d_c += _distance(center[0] - rx0, center[1] - rx1, center[2] - rx2)
        count = 0
        for first in range(0, points, _MANY):
            last = min(first + _MANY, points)
            if _some(octets, size * (c * points + first), size * (c * points + last)):
                for v in range(first, last):
                    if weights[c, v]:
                        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                        d = _distance(x - tx0, y - tx1, z - tx2) + _distance(x - rx0, y - rx1, z - rx2)
                        amplitude = weights[c, v] / d if spread else weights[c, v] * 1.0
                        base[count] = _wrapped(carrier * (d + path_offset))
                        slope[count] = half_band * (d - d_c)
                        real[count] = amplitude * reflections[v].real
                        imag[count] = amplitude * reflections[v].imag
                        count += 1
        for n in range(len(nodes)):
            node = np.float32(nodes[n])
            total_real = np.float32(0.0)
            total_imag = np.float32(0.0)
            for i in range(count):
                turn = _wrapped(base[i] + slope[i] * node)
                cosine, sine = _cosine(turn), _sine(turn)
                # a (cos - i sin): the sign of primer (3)
                total_real += real[i] * cosine + imag[i] * sine
                total_imag += imag[i] * cosine - real[i] * sine
            out[c, n] = complex(total_real, total_imag)


@kernel(fastmath=True)
def restore_delay(signals, tx, rx, center, path_offset, start, step, rows, frames):
    """frames[rows[c], j] = signals[c, j] exp(-i 2 pi (start + j step) (d_c + path_offset)): the common delay again."""
    for c in prange(len(signals)):
        d_c = _distance(center[0] - tx[c, 0], center[1] - tx[c, 1], center[2] - tx[c, 2])
        d_c += _distance(center[0] - rx[c, 0], center[1] - rx[c, 1], center[2] - rx[c, 2]) + path_offset
        for j in range(signals.shape[1]):
            turn = np.float32(_wrapped((start + j * step) * d_c))
            frames[rows[c], j] = signals[c, j] * complex(_cosine(turn), -_sine(turn))
