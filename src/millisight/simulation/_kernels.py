"""The simulator's inner loops, compiled by Numba: the specular test, and the sum over lit vertices."""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange, subroutine

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)


_U = np.uint64  # of indices: Numba lets signed ones count from the end, and LLVM then reads no vectors

_DEEP = 4  # rows of a table that one pass takes

_TURN = 1e-6  # by which float64's rounding may turn a bisector, with much to spare [rad]

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


@kernel(fastmath=True)
def _mark_groups(rows, group, found):
    for v in prange((rows.shape[1] + _MANY - 1) // _MANY):
        for p in range(len(rows)):
            for c in range(v * _MANY, min((v + 1) * _MANY, rows.shape[1])):
                found[group[p], c] |= rows[p, c]


def any_of_groups(rows, group, count):
    """(count, V) bool: whether any row of a group is set; rows (P, V) bool, group (P,) from 0 to count - 1."""
    found = np.zeros((count, rows.shape[1]), dtype=bool)
    _mark_groups(rows.view(np.uint8), group, found.view(np.uint8))
    return found


@subroutine
def may_mirror(tx, rx, around, vertices, normals, tau, two_sided, found):
    """found[v]: may normal v lie within tau [rad] of some bisector, as in `specular`, for antennas no further than
    around[0] from tx (3,) and around[1] from rx (3,)?

    A direction to an antenna that far off, at the distance d, differs by an angle of asin(around / d) at most, and a
    unit vector by its chord; the bisector by the angle whose sine is the sum of both chords over the bisector's length.
    """
    for v in range(len(found)):
        found[v] = True
        ax, ay, az = tx[0] - vertices[v, 0], tx[1] - vertices[v, 1], tx[2] - vertices[v, 2]
        bx, by, bz = rx[0] - vertices[v, 0], rx[1] - vertices[v, 1], rx[2] - vertices[v, 2]
        a, b = _distance(ax, ay, az), _distance(bx, by, bz)
        if a > around[0] and b > around[1]:
            off = _chord(around[0] / a) + _chord(around[1] / b)
            x, y, z = ax / a + bx / b, ay / a + by / b, az / a + bz / b
            length = _distance(x, y, z)
            if off < length:
                along = (x * normals[v, 0] + y * normals[v, 1] + z * normals[v, 2]) / length
                along = abs(along) if two_sided else along
                widest = min(tau + math.asin(off / length) + _TURN, math.pi)
                found[v] = along >= math.cos(widest)


@inline
def _chord(sine):
    """Between unit vectors whose angle has this sine."""
    return math.sqrt(2 - 2 * math.sqrt(1 - sine * sine))


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
    """Even and odd parts of the signals at nodes of the half band: out[c, 0, n] and out[c, 1, n] are the sums over v of
    w_cv a_v exp(-i 2 pi carrier d) times cosine and sine of 2 pi half_band nodes[n] (d - d_c) (primer 13).

    Even less i times odd is the signal at nodes[n], even plus i times odd that at -nodes[n].

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
        for i in range(count):
            cosine, sine = _cosine(base[i]), _sine(base[i])
            # a (cos - i sin): the sign of primer (3)
            real[i], imag[i] = real[i] * cosine + imag[i] * sine, imag[i] * cosine - real[i] * sine
        for n in range(len(nodes)):
            node = np.float32(nodes[n])
            even_real, even_imag = np.float32(0.0), np.float32(0.0)
            odd_real, odd_imag = np.float32(0.0), np.float32(0.0)
            for i in range(count):
                turn = _wrapped(slope[i] * node)
                cosine, sine = _cosine(turn), _sine(turn)
                even_real += real[i] * cosine
                even_imag += imag[i] * cosine
                odd_real += real[i] * sine
                odd_imag += imag[i] * sine
            out[c, 0, n] = complex(even_real, even_imag)
            out[c, 1, n] = complex(odd_real, odd_imag)


def write_frames(signals, interpolation, tx, rx, center, path_offset, offsets, rows, frames):
    """frames[rows[c]]: the samples of channel c from its `signals` (C, 2, n), as `node_signals` gives them.

    `interpolation` (2, n, N / 2) are real numbers by which even and odd parts go from the nodes to samples of the upper
    half of the band, the highest first; `offsets` (N / 2,) their frequencies, less the middle's, over c [1/m]. The
    common delay of d_c and the path offset is put in again. The middle one of an odd number of samples is the last.
    """
    depth = -(-interpolation.shape[1] // _DEEP) * _DEEP
    table = np.zeros((2, depth, interpolation.shape[2]), np.float32)
    table[:, : interpolation.shape[1]] = interpolation
    _write_frames(signals, table, tx, rx, center, path_offset, offsets, rows, frames)


@kernel(fastmath=True, error_model="numpy")
def _write_frames(signals, table, tx, rx, center, path_offset, offsets, rows, frames):
    depth, half = table.shape[1], table.shape[2]
    entries, numbers, samples = table.reshape(-1), frames.reshape(-1).view(np.float32), frames.shape[1]
    for c in prange(len(signals)):
        d_c = _distance(center[0] - tx[c, 0], center[1] - tx[c, 1], center[2] - tx[c, 2])
        d_c += _distance(center[0] - rx[c, 0], center[1] - rx[c, 1], center[2] - rx[c, 2]) + path_offset
        # One array each, whose parts lie a constant apart: LLVM asks less often whether they overlap.
        ends, sums = np.zeros(4 * depth, np.float32), np.zeros(4 * half, np.float32)
        for part in range(2):
            for n in range(signals.shape[2]):
                ends[2 * part * depth + n] = signals[c, part, n].real
                ends[(2 * part + 1) * depth + n] = signals[c, part, n].imag
            for n in range(0, depth, _DEEP):
                _add_rows(ends, 2 * part * depth + n, depth, entries, (part * depth + n) * half, half, sums,
                          2 * part * half)  # fmt: skip
        _restore_delay(sums, half, offsets, d_c)
        _interleave(sums, half, numbers, 2 * rows[c] * samples, samples)


@subroutine
def _add_rows(ends, first, apart, entries, start, half, sums, at):
    """sums[at + j] and sums[at + half + j] += four rows of the table times `ends` from first, first + apart on."""
    a0, a1, a2, a3 = ends[first], ends[first + 1], ends[first + 2], ends[first + 3]
    first += apart
    b0, b1, b2, b3 = ends[first], ends[first + 1], ends[first + 2], ends[first + 3]
    h, p, q = _U(half), _U(start), _U(at)
    for j in range(h):
        w, x, y, z = entries[p + j], entries[p + h + j], entries[p + _U(2) * h + j], entries[p + _U(3) * h + j]
        sums[q + j] += (a0 * w + a1 * x) + (a2 * y + a3 * z)
        sums[q + h + j] += (b0 * w + b1 * x) + (b2 * y + b3 * z)


@subroutine
def _restore_delay(sums, half, offsets, path):
    """Even and odd parts, each complex, of signals that come later by `path` [m]."""
    h, h2, h3 = _U(half), _U(2 * half), _U(3 * half)
    for j in range(h):
        turn = np.float32(_wrapped(offsets[j] * path))
        cosine, sine = _cosine(turn), _sine(turn)
        even_real, even_imag, odd_real, odd_imag = sums[j], sums[h + j], sums[h2 + j], sums[h3 + j]
        sums[j] = even_real * cosine - odd_real * sine
        sums[h + j] = even_imag * cosine - odd_imag * sine
        sums[h2 + j] = even_real * sine + odd_real * cosine
        sums[h3 + j] = even_imag * sine + odd_imag * cosine


@subroutine
def _interleave(sums, half, numbers, start, samples):
    """Write samples from numbers[start] on, real, imaginary: even plus and minus i times odd part."""
    h, h2, h3, at = _U(half), _U(2 * half), _U(3 * half), _U(start)
    for j in range(h):
        numbers[at + j + j], numbers[at + j + j + _U(1)] = sums[j] - sums[h3 + j], sums[h + j] + sums[h2 + j]
    # Upwards, too: memory is written faster.
    at, last = at + _U(2 * half), h - _U(1) - _U(2 * half - samples)
    for k in range(_U(samples - half)):
        j = last - k
        numbers[at + k + k], numbers[at + k + k + _U(1)] = sums[j] + sums[h3 + j], sums[h + j] - sums[h2 + j]
