"""The compiled loop over double bounces. See `_kernels`."""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange
from millisight.rig.virtual._kernels import BLOCK, LEG, ORDER, form_factor, polynomial
from millisight.rig.virtual._path_kernels import gather

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine)
_sine = inline(phase.sine)

_f32 = np.float32
_ONE, _ZERO = _f32(1), _f32(0)

FULL_SLOPE, NO_SLOPE = 0.4, 0.8
"""Slope of the path over the second face up to which a double bounce counts in full, and from which not at all."""

MOST_PHASE = 4.3
"""On a patch, off that of its centroid, for which its series is made; a slant may stretch a tube of rays beyond."""

_FULL_SLOPE, _NO_SLOPE, _FADING = _f32(FULL_SLOPE), _f32(NO_SLOPE), _f32(1 / (NO_SLOPE - FULL_SLOPE))
_MOST_PHASE, _HALF, _QUARTER = _f32(MOST_PHASE), _f32(0.5), _f32(0.25)
_FLATTEST = 0.02  # cosine of incidence at which a wave still meets the second face


@kernel(fastmath=True, error_model="numpy")
def bounce_echoes(transmitters, nodes, between, shares, antennas, legs, places, pairs, clusters, starts, faces, centers,
                  coherent, carrier, half_band, first_bin, width, bins):  # fmt: skip
    """Add echoes of waves that one patch mirrors onto another's plane: see `_multipath`.

    places (4, M): centroid of the first patch, its height over the second's plane. pairs (16, M) float32: the first 13
    of `ROWS` of the first patch, and the second's normal. clusters (M, 2): of both. starts (K + 1,) and faces (K, 2):
    where pairs of the same two surfaces begin, and which these are. Pairs of about one path that follow each other
    share a bin, and are added together.
    """
    receivers, wave_number = len(between), _f32(2 * math.pi * carrier)
    for sender in prange(len(bins) // receivers):
        pose, number = sender // transmitters, sender % transmitters
        t, r0 = pose * (transmitters + receivers) + number, pose * (transmitters + receivers) + transmitters
        # Of some pairs: the path to the second plane and where it meets that; the tube of rays that does; the legs of
        # one antenna, and where in their clusters; amplitude, cycles and slope by the transmitter's leg; by node
        # amplitude (real, imaginary part), cycles and slope by all; then the paths and echoes of one channel, and the
        # series of those of one bin.
        met, tube, leg = np.empty((4, BLOCK)), np.empty((9, BLOCK), np.float32), np.empty((LEG, BLOCK), np.float32)
        inner, beyond = np.empty((3, BLOCK), np.float32), np.empty((3, BLOCK), np.float32)
        sent, value = np.empty((4, BLOCK), np.float32), np.empty((len(nodes), 5, BLOCK), np.float32)
        paths, echo, series = np.empty(BLOCK), np.empty((4, BLOCK), np.float32), np.empty((2, ORDER), np.float32)
        for f in range(len(faces)):
            for start in range(starts[f], starts[f + 1], BLOCK):
                count = np.uint64(min(starts[f + 1] - start, BLOCK))
                _mirrored(antennas[t], places, pairs, start, count, coherent[faces[f, 0], 0], met, tube)
                gather(legs[t], clusters, 0, start, count, leg)
                for n in range(count):
                    p, b = np.uint64(start) + n, clusters[start + n, 1]
                    for k in range(3):
                        inner[k, n], beyond[k, n] = pairs[k, p], met[1 + k, n] - centers[b, k]
                _sent(leg, inner, count, sent)
                for m in range(len(nodes)):
                    r = r0 + nodes[m]
                    gather(legs[r], clusters, 1, start, count, leg)
                    _returned(antennas[r], pairs, start, count, coherent[faces[f, 1], 0], met, tube, wave_number,
                              value[m])  # fmt: skip
                    _through(leg, beyond, sent, count, value[m])
                for i in range(receivers):
                    one, other = value[between[i, 0]], value[between[i, 1]]
                    _lengths(antennas[r0 + i], met, one, other, count, paths)
                    before = np.uint64(0)
                    while before < count:
                        after, middle = _of_one_bin(paths, before, count, 2 * width)
                        if not middle > 0:
                            break
                        whole = np.rint(middle / width)
                        _received(one, other, shares[i], carrier, half_band, whole * width, before, after, paths, echo)
                        _summed(echo, before, after, series)
                        total = bins[sender * receivers + i, np.uint64(int(whole) - first_bin)]
                        for m in range(ORDER):
                            total[m] += complex(series[0, m], series[1, m])
                        before = after


@inline
def _mirrored(a, places, pairs, start, count, law, met, tube):
    """What first patches mirror of the transmitter at a onto the second's planes: where it meets these, and the tube of
    rays, its direction, cosine of incidence and its inverse, growth, size, and the reflection (real, imaginary part).
    """
    ax, ay, az = a[0], a[1], a[2]
    law_re, law_im = law[0], law[1]
    for n in range(np.uint64(0), count):
        i = np.uint64(start) + n
        nx, ny, nz = pairs[3, i], pairs[4, i], pairs[5, i]
        mx, my, mz = pairs[13, i], pairs[14, i], pairs[15, i]
        # From the transmitter to the first patch, and on in the mirrored direction w.
        x, y, z = places[0, i] - ax, places[1, i] - ay, places[2, i] - az
        one = _distance(x, y, z)
        over = 1 / one
        cos_a = -over * _dot(x, y, z, nx, ny, nz)
        twice = 2 * cos_a
        wx, wy, wz = x * over + twice * nx, y * over + twice * ny, z * over + twice * nz
        cos_b = -_dot(wx, wy, wz, mx, my, mz)
        height = places[3, i]
        slant = 1 / max(cos_b, _FLATTEST)
        two = height * slant
        met[0, n] = one + two
        met[1, n], met[2, n], met[3, n] = places[0, i] + two * wx, places[1, i] + two * wy, places[2, i] + two * wz
        # The tube has grown on its way, and falls on the second face at a slant.
        growth = 1 + two * over
        size = pairs[12, i] * cos_a * growth * growth * slant / (one + two)
        at = _f32(twice - 1)
        tube[0, n], tube[1, n], tube[2, n], tube[3, n], tube[4, n] = wx, wy, wz, cos_b, slant
        tube[5, n] = growth
        tube[6, n] = size if (cos_a > 0) & (cos_b >= _FLATTEST) & (height > 0) else 0.0
        tube[7, n], tube[8, n] = polynomial(law_re, at), polynomial(law_im, at)


@inline
def _returned(b, pairs, start, count, law, met, tube, wave_number, value):
    """What second planes return of it to the receiver at b, but its phase. What does not count is 0."""
    bx, by, bz = b[0], b[1], b[2]
    law_re, law_im = law[0], law[1]
    for n in range(np.uint64(0), count):
        i = np.uint64(start) + n
        mx, my, mz = pairs[13, i], pairs[14, i], pairs[15, i]
        wx, wy, wz, cos_b, slant = tube[0, n], tube[1, n], tube[2, n], tube[3, n], tube[4, n]
        # From where it meets the second plane to the receiver, in direction v.
        vx, vy, vz = _f32(bx - met[1, n]), _f32(by - met[2, n]), _f32(bz - met[3, n])
        back = _ONE / math.sqrt(_dot(vx, vy, vz, vx, vy, vz))
        vx, vy, vz = vx * back, vy * back, vz * back
        cos_s = _dot(vx, vy, vz, mx, my, mz)
        # How fast the path changes over the second plane.
        onto = cos_b + cos_s
        gx, gy, gz = wx - vx + onto * mx, wy - vy + onto * my, wz - vz + onto * mz
        slope = math.sqrt(_dot(gx, gy, gz, gx, gy, gz))
        # Displaced by e on the first face, a ray falls e + w (e m) / cos_b aside on the second, times its growth.
        along_w = _dot(gx, gy, gz, wx, wy, wz) * slant
        ex, ey, ez = gx + along_w * mx, gy + along_w * my, gz + along_w * mz
        turning = -wave_number * tube[5, n]
        p = turning * _dot(pairs[6, i], pairs[7, i], pairs[8, i], ex, ey, ez)
        q = turning * _dot(pairs[9, i], pairs[10, i], pairs[11, i], ex, ey, ez)
        counts = (cos_s > _ZERO) & (slope < _NO_SLOPE) & (max(abs(p), abs(q), abs(p + q)) <= _MOST_PHASE)
        form_re, form_im = form_factor(p, q)
        at = onto - _ONE
        re_a, im_a, re_b, im_b = tube[7, n], tube[8, n], polynomial(law_re, at), polynomial(law_im, at)
        re, im = re_a * re_b - im_a * im_b, re_a * im_b + im_a * re_b
        fading = min(max((slope - _FULL_SLOPE) * _FADING, _ZERO), _ONE)
        size = (_ONE + _cosine(_HALF * fading)) * _QUARTER * tube[6, n] * onto * back
        size = size if counts else _ZERO
        value[0, n], value[1, n] = -size * (re * form_im + im * form_re), size * (re * form_re - im * form_im)


@inline
def _sent(leg, place, count, sent):
    """What the transmitter's legs do to double bounces: amplitude, cycles, slope."""
    for n in range(np.uint64(0), count):
        x, y, z = place[0, n], place[1, n], place[2, n]
        sent[0, n] = leg[0, n] * (_ONE + leg[2, n] * x + leg[3, n] * y + leg[4, n] * z)
        sent[1, n] = leg[1, n] + leg[5, n] * x + leg[6, n] * y + leg[7, n] * z
        sent[2, n], sent[3, n] = leg[8, n], leg[9, n]


@inline
def _through(leg, place, sent, count, value):
    """What both legs do to what returns to a node: amplitude, cycles, slope."""
    for n in range(np.uint64(0), count):
        x, y, z = place[0, n], place[1, n], place[2, n]
        gain = sent[0, n] * leg[0, n] * (_ONE + leg[2, n] * x + leg[3, n] * y + leg[4, n] * z)
        value[0, n], value[1, n] = gain * value[0, n], gain * value[1, n]
        value[2, n] = sent[1, n] + leg[1, n] + leg[5, n] * x + leg[6, n] * y + leg[7, n] * z
        value[3, n], value[4, n] = sent[2, n] + leg[8, n], sent[3, n] + leg[9, n]


@inline
def _lengths(b, met, first, second, count, paths):
    """Paths to the receiver at b; -1 where no node has an echo."""
    bx, by, bz = b[0], b[1], b[2]
    for n in range(np.uint64(0), count):
        path = met[0, n] + _distance(bx - met[1, n], by - met[2, n], bz - met[3, n])
        dark = (first[0, n] == 0) & (first[1, n] == 0) & (second[0, n] == 0) & (second[1, n] == 0)
        paths[n] = -1.0 if dark else path


@inline
def _of_one_bin(paths, start, count, most):
    """Up to which number from `start` on paths differ by `most` at most, and the middle of them; -1: there are none."""
    least, longest = 1e30, 0.0
    for n in range(start, count):
        if paths[n] > 0:
            low, high = min(least, paths[n]), max(longest, paths[n])
            if high - low > most:
                return np.uint64(n), (least + longest) / 2
            least, longest = low, high
    return np.uint64(count), (least + longest) / 2 if longest > 0 else -1.0


@inline
def _received(first, second, share, carrier, half_band, of_bin, start, stop, paths, echo):
    """Echoes at a receiver between two nodes of the pairs from `start` to `stop`, in the bin of the path `of_bin`."""
    for n in range(start, stop):
        over = paths[n] - of_bin
        cycles = first[2, n] + share * (second[2, n] - first[2, n])
        late = _f32(_wrapped(carrier * over + cycles))
        re, im = first[0, n] + share * (second[0, n] - first[0, n]), first[1, n] + share * (second[1, n] - first[1, n])
        cosine, sine = _cosine(late), _sine(late)
        echo[0, n], echo[1, n] = re * cosine + im * sine, im * cosine - re * sine
        echo[2, n] = first[3, n] + share * (second[3, n] - first[3, n])
        echo[3, n] = first[4, n] + share * (second[4, n] - first[4, n]) - _f32(half_band * over)


@inline
def _summed(echo, start, stop, series):
    """The series in ν of the sum of echoes times exp(slope ν)."""
    r0 = r1 = r2 = r3 = r4 = r5 = r6 = _ZERO
    i0 = i1 = i2 = i3 = i4 = i5 = i6 = _ZERO
    for n in range(start, stop):
        re, im, a, b = echo[0, n], echo[1, n], echo[2, n], echo[3, n]
        r0 += re
        i0 += im
        re, im = re * a - im * b, re * b + im * a
        r1 += re
        i1 += im
        re, im = re * a - im * b, re * b + im * a
        r2 += re
        i2 += im
        re, im = re * a - im * b, re * b + im * a
        r3 += re
        i3 += im
        re, im = re * a - im * b, re * b + im * a
        r4 += re
        i4 += im
        re, im = re * a - im * b, re * b + im * a
        r5 += re
        i5 += im
        re, im = re * a - im * b, re * b + im * a
        r6 += re
        i6 += im
    series[0, 0], series[0, 1], series[0, 2], series[0, 3] = r0, r1, r2 / 2, r3 / 6
    series[0, 4], series[0, 5], series[0, 6] = r4 / 24, r5 / 120, r6 / 720
    series[1, 0], series[1, 1], series[1, 2], series[1, 3] = i0, i1, i2 / 2, i3 / 6
    series[1, 4], series[1, 5], series[1, 6] = i4 / 24, i5 / 120, i6 / 720


@inline
def _dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz
