"""The compiled loop over double bounces. See `_kernels`."""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange
from millisight.rig.virtual._kernels import BLOCK, LEG, form_factor, polynomial
from millisight.rig.virtual._path_kernels import add_series, gather

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine)
_sine = inline(phase.sine)

_f32 = np.float32
_ONE = _f32(1)

FULL_SLOPE, NO_SLOPE = 0.4, 0.8
"""Slope of the path over the second face up to which a double bounce counts in full, and from which not at all."""

MOST_PHASE = 4.3
"""On a patch, off that of its centroid, for which its series is made; a slant may stretch a tube of rays beyond."""

_FLATTEST = 0.02  # cosine of incidence at which a wave still meets the second face


@kernel(fastmath=True, error_model="numpy")
def bounce_echoes(transmitters, nodes, between, shares, antennas, legs, pairs, clusters, starts, faces, centers,
                  coherent, carrier, half_band, first_bin, width, bins):  # fmt: skip
    """Add echoes of waves that one patch mirrors onto another's plane: see `bounce`.

    pairs (20, M): centroid of the first patch; its normal; normal of the second; from the first's centroid to two of
    its corners; its area; its height over the second's plane; its place in its cluster. clusters (M, 2): of both.
    starts (K + 1,) and faces (K, 2): where pairs of the same two surfaces begin, and which these are.
    """
    receivers = len(between)
    for sender in prange(len(bins) // receivers):
        pose, number = sender // transmitters, sender % transmitters
        t, r0 = pose * (transmitters + receivers) + number, pose * (transmitters + receivers) + transmitters
        # Of some pairs: the path to the second plane and where it meets that; by node the amplitude (real, imaginary
        # part); amplitude, cycles and slope by the transmitter's leg; the legs of one antenna, and where in their
        # clusters; then echoes of one channel, and their bins.
        met, value, sent = np.empty((4, BLOCK)), np.empty((len(nodes), 2, BLOCK)), np.empty((4, BLOCK), np.float32)
        leg = np.empty((LEG, BLOCK), np.float32)
        inner, beyond = np.empty((3, BLOCK), np.float32), np.empty((3, BLOCK), np.float32)
        echo, place = np.empty((4, BLOCK), np.float32), np.empty(BLOCK, np.int32)
        for f in range(len(faces)):
            for start in range(starts[f], starts[f + 1], BLOCK):
                count = np.uint64(min(starts[f + 1] - start, BLOCK))
                for m in range(len(nodes)):
                    r = r0 + nodes[m]
                    _bounced(antennas[t], antennas[r], pairs, start, count, coherent[faces[f, 0], 0],
                             coherent[faces[f, 1], 0], carrier, met, value[m])  # fmt: skip
                gather(legs[t], clusters, 0, start, count, leg)
                for n in range(count):
                    p, b = np.uint64(start) + n, clusters[start + n, 1]
                    for k in range(3):
                        inner[k, n], beyond[k, n] = pairs[17 + k, p], met[1 + k, n] - centers[b, k]
                _sent(leg, inner, count, sent)
                for i in range(receivers):
                    one, other = value[between[i, 0]], value[between[i, 1]]
                    gather(legs[r0 + i], clusters, 1, start, count, leg)
                    _received(antennas[r0 + i], leg, beyond, count, met, sent, one, other, shares[i], carrier,
                              half_band, first_bin, width, echo, place)  # fmt: skip
                    for n in range(count):
                        if one[0, n] == 0 and one[1, n] == 0 and other[0, n] == 0 and other[1, n] == 0:
                            continue  # its place is anywhere
                        at = np.uint64(place[n])
                        add_series(
                            complex(echo[0, n], echo[1, n]), echo[2, n], echo[3, n], bins, sender * receivers + i, at
                        )


@inline
def _bounced(a, b, pairs, start, count, law_a, law_b, carrier, met, value):
    """What double bounces return, but their phase, from the antenna at a to that at b. What does not count is 0."""
    turning = -2 * math.pi * carrier
    ax, ay, az, bx, by, bz = a[0], a[1], a[2], b[0], b[1], b[2]
    a_re, a_im, b_re, b_im = law_a[0], law_a[1], law_b[0], law_b[1]
    for n in range(np.uint64(0), count):
        i = np.uint64(start) + n
        nx, ny, nz = pairs[3, i], pairs[4, i], pairs[5, i]
        mx, my, mz = pairs[6, i], pairs[7, i], pairs[8, i]
        # From the transmitter to the first patch, and on in the mirrored direction w.
        x, y, z = pairs[0, i] - ax, pairs[1, i] - ay, pairs[2, i] - az
        one = _distance(x, y, z)
        over = 1 / one
        cos_a = -over * _dot(x, y, z, nx, ny, nz)
        twice = 2 * cos_a
        wx, wy, wz = x * over + twice * nx, y * over + twice * ny, z * over + twice * nz
        cos_b = -_dot(wx, wy, wz, mx, my, mz)
        height = pairs[16, i]
        counts = (cos_a > 0) & (cos_b >= _FLATTEST) & (height > 0)
        slant = 1 / max(cos_b, _FLATTEST)
        two = height * slant
        # Where it meets the second plane, and from there to the receiver, in direction v.
        hx, hy, hz = pairs[0, i] + two * wx, pairs[1, i] + two * wy, pairs[2, i] + two * wz
        vx, vy, vz = bx - hx, by - hy, bz - hz
        back = 1 / _distance(vx, vy, vz)
        vx, vy, vz = vx * back, vy * back, vz * back
        cos_s = _dot(vx, vy, vz, mx, my, mz)
        # How fast the path changes over the second plane.
        onto = cos_b + cos_s
        gx, gy, gz = wx - vx + onto * mx, wy - vy + onto * my, wz - vz + onto * mz
        slope = _distance(gx, gy, gz)
        # The tube of rays has grown on its way, and falls on the second face at a slant.
        growth = 1 + two * over
        area = pairs[15, i] * cos_a * growth * growth * slant
        # Displaced by e on the first face, a ray falls e + w (e m) / cos_b aside on the second, times its growth.
        along_w = _dot(gx, gy, gz, wx, wy, wz) * slant
        ex, ey, ez = gx + along_w * mx, gy + along_w * my, gz + along_w * mz
        p = turning * growth * _dot(pairs[9, i], pairs[10, i], pairs[11, i], ex, ey, ez)
        q = turning * growth * _dot(pairs[12, i], pairs[13, i], pairs[14, i], ex, ey, ez)
        counts &= (cos_s > 0) & (slope < NO_SLOPE) & (max(abs(p), abs(q), abs(p + q)) <= MOST_PHASE)
        form_re, form_im = form_factor(np.float32(p), np.float32(q))
        at_a, at_b = np.float32(twice - 1), np.float32(onto - 1)
        re_a, im_a = polynomial(a_re, at_a), polynomial(a_im, at_a)
        re_b, im_b = polynomial(b_re, at_b), polynomial(b_im, at_b)
        re, im = re_a * re_b - im_a * im_b, re_a * im_b + im_a * re_b
        fading = min(max((slope - FULL_SLOPE) / (NO_SLOPE - FULL_SLOPE), 0.0), 1.0)
        size = (1 + _cosine(fading / 2)) / 2 * carrier * area * onto / 2 * back / (one + two)
        size = size if counts else 0.0
        value[0, n], value[1, n] = -size * (re * form_im + im * form_re), size * (re * form_re - im * form_im)
        met[0, n], met[1, n], met[2, n], met[3, n] = one + two, hx, hy, hz


@inline
def _sent(leg, place, count, sent):
    """What the transmitter's legs do to double bounces: amplitude, cycles, slope."""
    for n in range(np.uint64(0), count):
        x, y, z = place[0, n], place[1, n], place[2, n]
        sent[0, n] = leg[0, n] * (_ONE + leg[2, n] * x + leg[3, n] * y + leg[4, n] * z)
        sent[1, n] = leg[1, n] + leg[5, n] * x + leg[6, n] * y + leg[7, n] * z
        sent[2, n], sent[3, n] = leg[8, n], leg[9, n]


@inline
def _received(b, leg, place, count, met, sent, first, second, share, carrier, half_band, first_bin, width, echo, bin_):
    """Echoes at the receiver at b, whose amplitudes lie between the `first` and the `second`, and their bins."""
    bx, by, bz = b[0], b[1], b[2]
    for n in range(np.uint64(0), count):
        path = met[0, n] + _distance(bx - met[1, n], by - met[2, n], bz - met[3, n])
        x, y, z = place[0, n], place[1, n], place[2, n]
        gain = sent[0, n] * leg[0, n] * (_ONE + leg[2, n] * x + leg[3, n] * y + leg[4, n] * z)
        cycles = sent[1, n] + leg[1, n] + leg[5, n] * x + leg[6, n] * y + leg[7, n] * z
        whole = np.rint(path / width)
        over = path - whole * width
        late = _f32(_wrapped(carrier * over + cycles))
        re = gain * _f32(first[0, n] + share * (second[0, n] - first[0, n]))
        im = gain * _f32(first[1, n] + share * (second[1, n] - first[1, n]))
        cosine, sine = _cosine(late), _sine(late)
        echo[0, n], echo[1, n] = re * cosine + im * sine, im * cosine - re * sine
        echo[2, n], echo[3, n] = sent[2, n] + leg[8, n], sent[3, n] + leg[9, n] - _f32(half_band * over)
        bin_[n] = np.int32(whole) - np.int32(first_bin)


@inline
def _dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz
