"""The inner loops of autofocus: the image of short pieces of the path when these are displaced, and its gradient.

A piece is a few neighbouring poses. Its field A_s at some points is backprojected once. While the pieces move by a few
wavelengths their envelope hardly changes, and only the phase of the carrier is followed:

    I(x) = sum_s A_s(x) exp(i k (|x - p_s - u_s| - |x - p_s|)),  k = 4 pi f_c / c.

All loops work in the precision of their arguments: float32 for speed, float64 to check the gradient.
"""

import math

import numpy as np

from millisight.core import inline, kernel, numba, overload, phase, prange

_distance = inline(phase.distance, fastmath=True)
_wrapped = inline(phase.wrapped, fastmath=True)
_cosine32 = inline(phase.cosine, fastmath=True)
_sine32 = inline(phase.sine, fastmath=True)
_TILE = 256


def _cosine(turns):
    """cos(2 pi turns), |turns| <= 1/2, in the precision of its argument."""
    return math.cos(phase.TAU * turns)


def _sine(turns):
    """sin(2 pi turns), |turns| <= 1/2, in the precision of its argument."""
    return math.sin(phase.TAU * turns)


@overload(_cosine, inline="always")
def _cosine_typed(turns):
    if turns == numba.types.float32:
        return lambda turns: _cosine32(turns)
    return lambda turns: math.cos(phase.TAU * turns)


@overload(_sine, inline="always")
def _sine_typed(turns):
    if turns == numba.types.float32:
        return lambda turns: _sine32(turns)
    return lambda turns: math.sin(phase.TAU * turns)


@kernel(fastmath=True, error_model="numpy")
def displaced_images(real, imag, places, pieces, moves, points, per_metre, image_re, image_im):
    """image[c, v] = sum over `pieces` (n,) of the fields real + i imag (S, V) of pieces at `places` (S, 3), moved by
    moves[c, n], for each of C trials.

    per_metre : turns of the phase per metre of distance, 2 f_c / c
    points : (3, V); image_re, image_im : (C, V), overwritten
    """
    tiles = (points.shape[1] + _TILE - 1) // _TILE
    for job in prange(len(moves) * tiles):
        c, first = job // tiles, (job % tiles) * _TILE
        last = min(first + _TILE, points.shape[1])
        x, y, z = points[0, first:last], points[1, first:last], points[2, first:last]
        sum_re, sum_im = image_re[c, first:last], image_im[c, first:last]
        cosine, sine = np.empty(_TILE, points.dtype), np.empty(_TILE, points.dtype)
        for i in range(last - first):
            sum_re[i] = 0
            sum_im[i] = 0
        for n in range(len(pieces)):
            s = pieces[n]
            px, py, pz = places[s, 0], places[s, 1], places[s, 2]
            qx, qy, qz = px + moves[c, n, 0], py + moves[c, n, 1], pz + moves[c, n, 2]
            re, im = real[s, first:last], imag[s, first:last]
            for i in range(last - first):
                away = _distance(x[i] - qx, y[i] - qy, z[i] - qz)
                turn = _wrapped(per_metre * (away - _distance(x[i] - px, y[i] - py, z[i] - pz)))
                cosine[i] = _cosine(turn)
                sine[i] = _sine(turn)
            for i in range(last - first):
                sum_re[i] += re[i] * cosine[i] - im[i] * sine[i]
            for i in range(last - first):
                sum_im[i] += re[i] * sine[i] + im[i] * cosine[i]


@kernel(fastmath=True, error_model="numpy")
def displaced_gradient(real, imag, places, moves, points, per_metre, weights_re, weights_im, gradient):
    """gradient[s] = d / d moves[s] of Re sum_v conj(weights[v]) I(v): the adjoint of `displaced_images`' derivative.

    d I / d moves[s] = -i k (unit vector from the piece to the point) times the piece's share of I.
    """
    x, y, z = points[0], points[1], points[2]
    for s in prange(len(places)):
        px, py, pz = places[s, 0], places[s, 1], places[s, 2]
        qx, qy, qz = px + moves[s, 0], py + moves[s, 1], pz + moves[s, 2]
        re, im = real[s], imag[s]
        gx, gy, gz = px - px, px - px, px - px
        for i in range(len(x)):
            dx, dy, dz = x[i] - qx, y[i] - qy, z[i] - qz
            away = _distance(dx, dy, dz)
            turn = _wrapped(per_metre * (away - _distance(x[i] - px, y[i] - py, z[i] - pz)))
            cosine, sine = _cosine(turn), _sine(turn)
            slope = (re[i] * sine + im[i] * cosine) * weights_re[i] - (re[i] * cosine - im[i] * sine) * weights_im[i]
            slope = slope / away
            gx += slope * dx
            gy += slope * dy
            gz += slope * dz
        k = per_metre * phase.TAU
        gradient[s, 0], gradient[s, 1], gradient[s, 2] = k * gx, k * gy, k * gz
