"""How fields of sub-apertures are carried to a finer grid and added up, compiled by Numba (primer 16).

A job is a block of the finer grid: some rows along x, a stretch of y, and all of z or a part of it. A *lane* is a row
and a z; all lanes of one y are side by side in memory, `_LANES` apart from the next, so that vector code runs over them
whatever the length of z. Of each child, rows are interpolated along x at the coarse grid's y; their lanes are spread
out; then each y of the block is interpolated, its phase turned, and added, in one loop. What a job needs at a time
stays in the caches next to its core.

Within a job nothing is sliced: each slice of an array counts references to it, and two cores that count references to
one array wait for each other. Indices are unsigned: Numba lets signed ones count from the end, and the choice between
the two keeps LLVM from reading vectors.
"""

import numpy as np

from millisight.core import inline, kernel, phase, prange, subroutine
from millisight.imaging._lengths import EXACT_CYCLES
from millisight.imaging._taps import TAPS, as_it_is

_wrapped = inline(phase.wrapped, fastmath=True)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)

_LANES, _STRETCH = 128, 64  # of a job, at most: lanes, and points along y

_U = np.uint64
_ONE, _TWO, _EIGHT = _U(1), _U(2), _U(8)
_LANE, _PAIR, _TRIPLE = _U(_LANES), _U(2 * _LANES), _U(3 * _LANES)


def merge(fields, children, starts, centers, parents, has_parents, carrier, along, across, x, y, z, out):
    """Carry the fields of sub-apertures over to a finer grid and the phase of their parents' centres, and add them up.

    out[:, s] = sum over c in children[starts[s]:starts[s + 1]] of the field of c, interpolated by eight taps along
    its first two axes, times exp(+i 2 pi carrier 2 (b_c(v) - b_s(v))), b_c(v) = |v - c| - |c| of the centres, which are
    rows of `antenna_rows`. Without parents, in the last step, all of b_c is put back, and the sum added to the image.

    Parameters
    ----------
    fields : (2, C, X', Y', Z) float32, real and imaginary parts
    children, starts : (C,), (S + 1,)
    centers, parents : (C, 6), (S, 6)
    has_parents : bool
    carrier : centre frequency over c [1/m]
    along, across : first tap (n,) and weights (n, 8) of the first and of the second axis; None: the axis stays
    x, y, z : (X,), (Y,), (Z,) float32 coordinates of the finer grid [m]
    out : (2, S, X, Y, Z) float32, written to; the image: added to
    """
    _merge(
        fields, children, starts, centers, parents, has_parents, np.float32(carrier),
        *(along or as_it_is(len(x))), *(across or as_it_is(len(y))), x, y, z, out,
    )  # fmt: skip


@kernel(fastmath=True, error_model="numpy")
def _merge(
    fields, children, starts, centers, parents, has_parents, carrier, x_base, x_weights, y_base, y_weights, x, y, z, out
):
    _, count, rows, columns, depth = fields.shape
    many = min(depth, _LANES)  # z of a job
    at_once = max(1, _LANES // depth)  # rows along x of a job
    deep = (depth + many - 1) // many
    long, wide = (len(x) + at_once - 1) // at_once, (len(y) + _STRETCH - 1) // _STRETCH
    twice = np.float32(2.0) * carrier
    exact = np.float32(EXACT_CYCLES) / carrier
    given, made, half = fields.reshape(-1), out.reshape(-1), _U(out.size // 2)
    for job in prange((len(starts) - 1) * long * wide * deep):
        s, rest = job // (long * wide * deep), job % (long * wide * deep)
        i0, j0, k0 = rest // (wide * deep) * at_once, rest // deep % wide * _STRETCH, rest % deep * many
        ni, nj, nk = min(at_once, len(x) - i0), min(_STRETCH, len(y) - j0), min(many, depth - k0)
        c0 = y_base[j0]
        taken = y_base[j0 + nj - 1] + TAPS - c0  # coarse y
        there = min(taken, columns - c0)
        lanes = _U((ni * nk + 15) // 16 * 16)
        spread = np.zeros(taken * 2 * _LANES, np.float32)  # by coarse y: real parts, imaginary parts
        row = np.empty(2 * ni * there * nk, np.float32)
        total = np.zeros(nj * 3 * _LANES, np.float32)  # by y: real parts, imaginary parts, b_s
        flat, away = np.zeros(2 * _LANES, np.float32), np.empty(_LANES, np.float32)
        if has_parents:
            _squares(x, i0, ni, z, k0, nk, parents[s, 0], parents[s, 2], flat)
            for j in range(nj):
                _beyond(flat, lanes, y[j0 + j], parents[s, 1], parents[s, 3], exact, away)
                for q in range(lanes):
                    total[_U(j) * _TRIPLE + _PAIR + q] = away[q]
        for n in range(starts[s], starts[s + 1]):
            c = children[n]
            length = _U(there * nk)
            for i in range(ni):
                w = i0 + i
                for part in range(2):
                    first = (((part * count + c) * rows + x_base[w]) * columns + c0) * depth + k0
                    at = _U(2 * i + part) * length
                    if nk == depth:
                        _taps(
                            given, _U(first), _U(columns * depth), row, at, length,
                            x_weights[w, 0], x_weights[w, 1], x_weights[w, 2], x_weights[w, 3],
                            x_weights[w, 4], x_weights[w, 5], x_weights[w, 6], x_weights[w, 7],
                        )  # fmt: skip
                    else:
                        for b in range(there):
                            _taps(
                                given, _U(first + b * depth), _U(columns * depth), row, at + _U(b * nk), _U(nk),
                                x_weights[w, 0], x_weights[w, 1], x_weights[w, 2], x_weights[w, 3],
                                x_weights[w, 4], x_weights[w, 5], x_weights[w, 6], x_weights[w, 7],
                            )  # fmt: skip
            # Only once all rows are there: what was just stored is slow to be loaded in other pieces.
            for i in range(ni):
                for part in range(2):
                    _spread(row, _U(2 * i + part) * length, spread, _U(part * _LANES + i * nk), _U(there), _U(nk))
            _squares(x, i0, ni, z, k0, nk, centers[c, 0], centers[c, 2], flat)
            for j in range(nj):
                w = j0 + j
                _beyond(flat, lanes, y[w], centers[c, 1], centers[c, 3], exact, away)
                _turned(
                    spread, _U(y_base[w] - c0) * _PAIR, total, _U(j) * _TRIPLE, away, lanes, twice,
                    y_weights[w, 0], y_weights[w, 1], y_weights[w, 2], y_weights[w, 3],
                    y_weights[w, 4], y_weights[w, 5], y_weights[w, 6], y_weights[w, 7],
                )  # fmt: skip
        for i in range(ni):
            for j in range(nj):
                at = _U(j) * _TRIPLE + _U(i * nk)
                to = _U(((s * len(x) + i0 + i) * len(y) + j0 + j) * depth + k0)
                if has_parents:
                    for q in range(_U(nk)):
                        made[to + q] = total[at + q]
                    for q in range(_U(nk)):
                        made[half + to + q] = total[at + _LANE + q]
                else:
                    for q in range(_U(nk)):
                        made[to + q] += total[at + q]
                    for q in range(_U(nk)):
                        made[half + to + q] += total[at + _LANE + q]


@subroutine
def _taps(given, first, step, row, at, count, a, b, c, d, e, f, g, h):
    """row[at + q] = the sum of eight values of `given`, `step` apart from first + q on, by their weights."""
    second = first + step
    third, fourth = second + step, second + _TWO * step
    fifth, sixth = fourth + step, fourth + _TWO * step
    seventh, eighth = sixth + step, sixth + _TWO * step
    for q in range(count):
        row[at + q] = (a * given[first + q] + b * given[second + q] + c * given[third + q] + d * given[fourth + q]) + (
            e * given[fifth + q] + f * given[sixth + q] + g * given[seventh + q] + h * given[eighth + q]
        )


@subroutine
def _spread(row, first, spread, to, count, length):
    """Copy `count` pieces of `length` values, which lie end to end from row[first] on, to every second lane's row."""
    if length >= _EIGHT:
        for _ in range(count):
            q = _U(0)
            while q + _EIGHT <= length:
                _copy_eight(row, first + q, spread, to + q)
                q += _EIGHT
            if q < length:  # the last eight, some of them twice
                _copy_eight(row, first + length - _EIGHT, spread, to + length - _EIGHT)
            first += length
            to += _PAIR
    else:
        for q in range(length):
            for n in range(count):
                spread[to + n * _PAIR + q] = row[first + n * length + q]


@subroutine
def _copy_eight(given, i, out, j):
    """Eight values, all read before any is written: one vector."""
    a, b, c, d = given[i], given[i + _ONE], given[i + _TWO], given[i + _U(3)]
    e, f, g, h = given[i + _U(4)], given[i + _U(5)], given[i + _U(6)], given[i + _U(7)]
    out[j], out[j + _ONE], out[j + _TWO], out[j + _U(3)] = a, b, c, d
    out[j + _U(4)], out[j + _U(5)], out[j + _U(6)], out[j + _U(7)] = e, f, g, h


@subroutine
def _squares(x, i0, ni, z, k0, nk, end_x, end_z, flat):
    """Of each lane v, as far as x and z go: |v - e|^2, and v . (v - 2 e) from `_LANES` on."""
    for i in range(ni):
        across = x[i0 + i] - end_x
        for k in range(nk):
            deep = z[k0 + k] - end_z
            q = i * nk + k
            flat[q] = across * across + deep * deep
            flat[_LANES + q] = x[i0 + i] * (across - end_x) + z[k0 + k] * (deep - end_z)


@subroutine
def _beyond(flat, lanes, y, end_y, far, exact, away):
    """away = |v - e| - |e| of each lane at one y, |e| = far; see `_kernels._beyond`."""
    dy = y - end_y
    if far < exact:
        for q in range(lanes):
            away[q] = np.sqrt(flat[q] + dy * dy) - far
    else:
        dot = y * (dy - end_y)
        for q in range(lanes):
            away[q] = (flat[_LANE + q] + dot) / (np.sqrt(flat[q] + dy * dy) + far)


@subroutine
def _turned(spread, first, total, at, away, lanes, twice, a, b, c, d, e, f, g, h):
    """Interpolate the lanes along y, turn them by what their centre's phase is beyond the parent's, and add them."""
    for q in range(lanes):
        u, v = first + q, at + q
        real = (
            a * spread[u] + b * spread[u + _PAIR] + c * spread[u + _TWO * _PAIR] + d * spread[u + _U(3) * _PAIR]
        ) + (
            e * spread[u + _U(4) * _PAIR] + f * spread[u + _U(5) * _PAIR]
            + g * spread[u + _U(6) * _PAIR] + h * spread[u + _U(7) * _PAIR]
        )  # fmt: skip
        u += _LANE
        imag = (
            a * spread[u] + b * spread[u + _PAIR] + c * spread[u + _TWO * _PAIR] + d * spread[u + _U(3) * _PAIR]
        ) + (
            e * spread[u + _U(4) * _PAIR] + f * spread[u + _U(5) * _PAIR]
            + g * spread[u + _U(6) * _PAIR] + h * spread[u + _U(7) * _PAIR]
        )  # fmt: skip
        turn = _wrapped((away[q] - total[v + _PAIR]) * twice)
        cosine, sine = _cosine(turn), _sine(turn)
        total[v] += real * cosine - imag * sine
        total[v + _LANE] += real * sine + imag * cosine
