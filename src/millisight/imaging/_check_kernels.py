"""The inner loop of a check: the sums of a few voxels over all channels, far better than an image's (primer 8)."""

import numpy as np

from millisight.core import inline, kernel, phase, prange
from millisight.imaging._kernels import bend

TAPS = 8

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)

_TILE = 38  # voxels of one thread: 304 are all there are, in eight tiles

_U, _TWO = np.uint64, np.uint64(2)


@kernel(fastmath=True, error_model="numpy")
def sums_at(profiles, to_start, back_start, per_metre, carrier, tx, rx, table, frame, weights, points, taps, linear):
    """sums[v] += sum over channels of P_k(d_k(v)) exp(+i 2 pi carrier d_k(v)), with path lengths in float64.

    Into `taps`, the profiles are interpolated by eight taps; into `linear`, as `backproject` does.

    Parameters
    ----------
    profiles : (P, T, R, M) complex64, M of at least eight
    to_start, back_start : (P, T), (P, R) the transmitters' and the receivers' parts of the path length of entry 0 [m]
    per_metre, carrier : entries per metre of path length; centre frequency over c [1/m]
    tx, rx : (P, T, 3), (P, R, 3) [m]
    table, frame : of an `Excess`; None: straight paths
    weights : (n, 8) float32 of the taps, at even steps from the first of them to the last
    points : (3, V) [m]
    taps, linear : (V,) complex128
    """
    steps = (len(weights) - 1) / (TAPS - 1)
    last = profiles.shape[3] - TAPS
    values, weight = profiles.reshape(-1).view(np.float32), weights.reshape(-1)
    for tile in prange((points.shape[1] + _TILE - 1) // _TILE):
        first = tile * _TILE
        count = min(_TILE, points.shape[1] - first)
        x, y, z = points[0, first : first + count], points[1, first : first + count], points[2, first : first + count]
        x32, y32, z32 = x.astype(np.float32), y.astype(np.float32), z.astype(np.float32)
        to, path, place = np.empty(count), np.empty(count), np.empty(count)
        bent = np.zeros(count, np.float32)
        base, row, entry = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.int32)
        re, im = np.empty(count, np.float32), np.empty(count, np.float32)
        near_re, near_im = np.empty(count, np.float32), np.empty(count, np.float32)
        sum_re, sum_im, plain_re, plain_im = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
        for p in range(len(profiles)):
            for t in range(tx.shape[1]):
                ax, ay, az = tx[p, t, 0], tx[p, t, 1], tx[p, t, 2]
                if table is not None:
                    bent[:] = np.float32(0)
                    bend(x32, y32, z32, tx[p, t].astype(np.float32), table, frame, bent)
                for i in range(count):
                    to[i] = _distance(x[i] - ax, y[i] - ay, z[i] - az) + bent[i]
                for r in range(rx.shape[1]):
                    bx, by, bz = rx[p, r, 0], rx[p, r, 1], rx[p, r, 2]
                    if table is not None:
                        bent[:] = np.float32(0)
                        bend(x32, y32, z32, rx[p, r].astype(np.float32), table, frame, bent)
                    start = to_start[p, t] + back_start[p, r]
                    channel = _TWO * _U(((p * tx.shape[1] + t) * rx.shape[1] + r) * profiles.shape[3])
                    for i in range(count):
                        path[i] = to[i] + _distance(x[i] - bx, y[i] - by, z[i] - bz) + bent[i]
                        place[i] = max((path[i] - start) * per_metre, 0.0)
                        entry[i] = min(np.int32(place[i]), np.int32(profiles.shape[3] - 2))
                        base[i] = min(max(entry[i] - np.int32(TAPS // 2 - 1), np.int32(0)), np.int32(last))
                        row[i] = min(np.int32((place[i] - base[i]) * steps + 0.5), np.int32(len(weights) - 1))
                    for i in range(count):
                        # Slices count references, for which cores wait, and signed indices are slow.
                        q, w = channel + _TWO * _U(base[i]), _U(TAPS) * _U(row[i])
                        a, b = np.float32(0), np.float32(0)
                        for n in range(_U(TAPS)):
                            a += weight[w + n] * values[q + _TWO * n]
                            b += weight[w + n] * values[q + _TWO * n + _U(1)]
                        re[i], im[i] = a, b
                        part = np.float32(place[i] - entry[i])
                        q = channel + _TWO * _U(entry[i])
                        near_re[i] = values[q] + part * (values[q + _TWO] - values[q])
                        near_im[i] = values[q + _U(1)] + part * (values[q + _U(3)] - values[q + _U(1)])
                    for i in range(count):
                        turn = np.float32(_wrapped(path[i] * carrier))
                        cosine, sine = _cosine(turn), _sine(turn)
                        sum_re[i] += re[i] * cosine - im[i] * sine
                        sum_im[i] += re[i] * sine + im[i] * cosine
                        plain_re[i] += near_re[i] * cosine - near_im[i] * sine
                        plain_im[i] += near_re[i] * sine + near_im[i] * cosine
        for i in range(count):
            taps[first + i] += complex(sum_re[i], sum_im[i])
            linear[first + i] += complex(plain_re[i], plain_im[i])
