"""Compiled loops over single paths: legs through antennas and sheets, edges, and double bounces. See `_kernels`."""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange
from millisight.rig.virtual._kernels import BLOCK, FULL, LEG, ORDER, faces, form_factor, polynomial

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

_SQUARE_ON = 1e-4  # [rad]
_FLATTEST = 0.02  # cosine of incidence at which a wave still meets the second face

_PLANE = 1e-6  # nearer to a sheet than this [m], a place lies in it and not behind it


@kernel(error_model="numpy")
def fill_legs(transmitters, nodes, between, shares, antennas, axes, exponents, centers, cones, edged, own, sheets,
              tables, legs):  # fmt: skip
    """legs[a, g] of every antenna and cluster: the antenna's pattern, and the sheets that are crossed.

    Of receivers between two nodes, what lies between the nodes'. Where a cluster faces away from an antenna all is 0,
    unless it has edges, `edged` (G,), which may not.

    axes (P, 3, 3): of each pose the radar's x, y and the direction it looks in, as rows, in the world frame;
    exponents (2,) of its pattern, see `antenna`; own (G,): the sheet that a cluster is a part of, which it does not
    look through, or below 0: the middle of a tilted cluster's box lies a little off its plane; sheets (K, 14): corner,
    unit vectors along both sides, normal, and the sides' lengths; tables (K, N, 4) over the cosine of incidence from 0
    to 1: logarithm of the transmission's amplitude, its delay [cycles], and the slope of the transmission's logarithm
    in ν (real, imaginary part).
    """
    receivers = len(between)
    each = transmitters + receivers
    for pose in prange(len(axes)):
        first = pose * each + transmitters
        for n in range(transmitters + len(nodes)):
            a = pose * each + n if n < transmitters else first + nodes[n - transmitters]
            for g in range(len(centers)):
                x, y, z = _between(centers[g], antennas[a])
                if edged[g] or faces(cones, g, x, y, z, _distance(x, y, z)):
                    _fill_leg(antennas[a], axes[pose], exponents, centers[g], own[g], sheets, tables, legs[a, g])
                else:
                    legs[a, g, :] = _ZERO
        for i in range(receivers):
            one, other, share = first + nodes[between[i, 0]], first + nodes[between[i, 1]], shares[i]
            if first + i != one and first + i != other:
                for g in range(len(centers)):
                    for k in range(LEG):
                        legs[first + i, g, k] = legs[one, g, k] + share * (legs[other, g, k] - legs[one, g, k])


@inline
def _fill_leg(antenna, axes, exponents, center, own, sheets, tables, row):
    """See `fill_legs`: one antenna, one cluster."""
    steps = tables.shape[1] - 1
    x, y, z = _between(antenna, center)
    far = _distance(x, y, z)
    level = phase = slope_re = slope_im = 0.0
    gx = gy = gz = kx = ky = kz = 0.0
    open_ = True
    if exponents[0] > 0 or exponents[1] > 0:
        ahead = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
        open_ = ahead > 1e-3 * far
        if open_:
            for i in range(2):
                ux, uy, uz = axes[i, 0], axes[i, 1], axes[i, 2]
                aside = x * ux + y * uy + z * uz
                square = ahead * ahead + aside * aside
                quarter = exponents[i] / 4
                level += quarter * math.log(ahead * ahead / square)
                by_ahead, by_aside = quarter * (2 / ahead - 2 * ahead / square), -quarter * 2 * aside / square
                gx += by_ahead * axes[2, 0] + by_aside * ux
                gy += by_ahead * axes[2, 1] + by_aside * uy
                gz += by_ahead * axes[2, 2] + by_aside * uz
    for k in range(len(sheets)):
        if k == own:
            continue
        s = sheets[k]
        px, py, pz = _between(s, antenna)
        above = _along(s, 9, px, py, pz)
        below = above + _along(s, 9, x, y, z)
        if above * below >= 0 or abs(below) < _PLANE:
            continue
        part = above / (above - below)
        px, py, pz = px + part * x, py + part * y, pz + part * z
        u, v = _along(s, 3, px, py, pz), _along(s, 6, px, py, pz)
        if u < 0 or u > s[12] or v < 0 or v > s[13]:
            continue
        side = -1.0 if below < 0 else 1.0
        cosine = abs(above - below) / far
        at = min(cosine * steps, steps - 1e-9)
        i = int(at)
        low, high = tables[k, i], tables[k, i + 1]
        level += low[0] + (at - i) * (high[0] - low[0])
        phase += low[1] + (at - i) * (high[1] - low[1])
        slope_re += low[2] + (at - i) * (high[2] - low[2])
        slope_im += low[3] + (at - i) * (high[3] - low[3])
        # The cosine's gradient, from the place in the cluster.
        cx = (side * s[9] - cosine * x / far) / far
        cy = (side * s[10] - cosine * y / far) / far
        cz = (side * s[11] - cosine * z / far) / far
        by_level, by_phase = (high[0] - low[0]) * steps, (high[1] - low[1]) * steps
        gx, gy, gz = gx + by_level * cx, gy + by_level * cy, gz + by_level * cz
        kx, ky, kz = kx + by_phase * cx, ky + by_phase * cy, kz + by_phase * cz
    row[0], row[1] = math.exp(level) if open_ else 0.0, phase
    row[2], row[3], row[4] = gx, gy, gz
    row[5], row[6], row[7] = kx, ky, kz
    row[8], row[9] = slope_re, slope_im


@kernel(error_model="numpy")
def edge_echoes(transmitters, nodes, between, shares, antennas, light, legs, edges, cluster, carrier, half_band,
                first_bin, width, bins):  # fmt: skip
    """Add what edges diffract beyond physical optics: see `edges`.

    light (P (T + M), E); edges (E, 23): middle; unit vector along; normal of the first face, and direction from the
    edge into it; length; exterior angle n pi, as n; strength (real, imaginary part); the middle in its cluster (E,),
    whose legs hold; cos(pi / n), sin(pi / n) / n, cos(n pi), sin(n pi).
    """
    receivers = len(between)
    for c in prange(len(bins)):
        sender, i = c // receivers, c % receivers
        pose, number = sender // transmitters, sender % transmitters
        t, r = pose * (transmitters + receivers) + number, pose * (transmitters + receivers) + transmitters + i
        eye_t, eye_r = pose * (transmitters + len(nodes)) + number, pose * (transmitters + len(nodes)) + transmitters
        one, other = eye_r + between[i, 0], eye_r + between[i, 1]
        for e in range(len(edges)):
            seen = light[eye_t, e] * ((1 - shares[i]) * light[one, e] + shares[i] * light[other, e]) / FULL**2
            if seen == 0:
                continue
            s = edges[e]
            px, py, pz = _between(s, antennas[t])
            qx, qy, qz = _between(s, antennas[r])
            to, back = _distance(px, py, pz), _distance(qx, qy, qz)
            ux, uy, uz = px / to + qx / back, py / to + qy / back, pz / to + qz / back
            fringe = _fringe(_along(s, 9, ux, uy, uz), _along(s, 6, ux, uy, uz), s[13], s[19], s[20], s[21], s[22])
            if fringe == 0:
                continue
            turns = carrier * s[12] * _along(s, 3, ux, uy, uz) / 2
            if abs(turns) > 1e-6:
                fringe *= _sine(_wrapped(turns)) / (2 * math.pi * turns)
            leg_t, leg_r = legs[t, cluster[e]], legs[r, cluster[e]]
            gain = _amplitude_at(leg_t, s[16], s[17], s[18]) * _amplitude_at(leg_r, s[16], s[17], s[18])
            cycles = _cycles_at(leg_t, s[16], s[17], s[18]) + _cycles_at(leg_r, s[16], s[17], s[18])
            size = seen * gain * fringe * s[12] / (2 * math.pi * to * back)
            _deposit(size * complex(s[14], s[15]), to + back, cycles, _tilt(leg_t, leg_r), carrier, half_band,
                     first_bin, width, bins, c)  # fmt: skip


@inline
def _fringe(x, y, n, cos_over, sin_over, cos_open, sin_open):
    """Half the sum of both polarisations' fringe coefficients, in backscatter from where (x, y) points.

    x along the first face, y off it; n pi is the exterior angle; then cos(pi / n), sin(pi / n) / n, cos(n pi) and
    sin(n pi). 0 where neither face is seen.
    """
    angle = math.atan2(y, x)
    angle = angle if angle >= 0 else angle + 2 * math.pi
    other = n * math.pi - angle
    if other <= 0 or (n > 1.999 and angle >= math.pi):
        return 0.0
    # Both terms are infinite where a face is seen square on, and their difference is not.
    if abs(angle - math.pi / 2) < _SQUARE_ON or abs(other - math.pi / 2) < _SQUARE_ON:
        angle, other = angle + 2 * _SQUARE_ON, other - 2 * _SQUARE_ON
        x, y = x - 2 * _SQUARE_ON * y, y + 2 * _SQUARE_ON * x
    whole = -sin_over / (cos_over - math.cos(2 * angle / n))
    if angle < math.pi:
        whole -= y / x / 2  # tan(angle)
    if other < math.pi:
        whole -= (sin_open * x - cos_open * y) / (cos_open * x + sin_open * y) / 2  # tan(n pi - angle)
    return whole


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
                _gather(legs[t], clusters, 0, start, count, leg)
                for n in range(count):
                    p, b = np.uint64(start) + n, clusters[start + n, 1]
                    for k in range(3):
                        inner[k, n], beyond[k, n] = pairs[17 + k, p], met[1 + k, n] - centers[b, k]
                _sent(leg, inner, count, sent)
                for i in range(receivers):
                    one, other = value[between[i, 0]], value[between[i, 1]]
                    _gather(legs[r0 + i], clusters, 1, start, count, leg)
                    _received(antennas[r0 + i], leg, beyond, count, met, sent, one, other, shares[i], carrier,
                              half_band, first_bin, width, echo, place)  # fmt: skip
                    for n in range(count):
                        if one[0, n] == 0 and one[1, n] == 0 and other[0, n] == 0 and other[1, n] == 0:
                            continue  # its place is anywhere
                        at = np.uint64(place[n])
                        _add_series(
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
def _gather(legs, clusters, which, start, count, leg):
    """The legs to the first or the second patches' clusters, in a row for each number: vector code needs them so."""
    for n in range(count):
        g = clusters[start + n, which]
        for k in range(LEG):
            leg[k, n] = legs[g, k]


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
def _between(start, stop):
    """The way from one place to another, of which the first three numbers count."""
    return stop[0] - start[0], stop[1] - start[1], stop[2] - start[2]


@inline
def _along(s, k, x, y, z):
    """(x, y, z) along the vector that starts at s[k]."""
    return s[k] * x + s[k + 1] * y + s[k + 2] * z


@inline
def _dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz


@inline
def _amplitude_at(leg, x, y, z):
    return leg[0] * (1 + leg[2] * x + leg[3] * y + leg[4] * z)


@inline
def _cycles_at(leg, x, y, z):
    return leg[1] + leg[5] * x + leg[6] * y + leg[7] * z


@inline
def _tilt(leg_t, leg_r):
    return complex(leg_t[8] + leg_r[8], leg_t[9] + leg_r[9])


@inline
def _deposit(value, path, cycles, tilt, carrier, half_band, first_bin, width, bins, c):
    """Add an echo of complex amplitude `value` at path length `path`, and `cycles` later, to the bins of channel c."""
    b = int(np.rint(path / width))
    over = path - b * width
    late = _wrapped(carrier * over + cycles)
    value = value * complex(_cosine(late), -_sine(late))
    _add_series(value, tilt.real, tilt.imag - half_band * over, bins, c, np.uint64(b - first_bin))


@inline
def _add_series(value, slope_re, slope_im, bins, c, b):
    """Add value times exp(slope ν) to the series of a bin."""
    re, im = value.real, value.imag
    for m in range(ORDER):
        bins[c, b, m] += complex(re, im)
        share = _f32(1 / (m + 1))
        re, im = share * (re * slope_re - im * slope_im), share * (re * slope_im + im * slope_re)
