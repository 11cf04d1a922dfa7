"""Compiled loops over single paths: legs through antennas and sheets, and edges. See `_kernels`."""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange
from millisight.rig.virtual._kernels import BLOCK, FULL, LEG, ORDER, faces

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine)
_sine = inline(phase.sine)

_f32 = np.float32
_ONE, _ZERO = _f32(1), _f32(0)

_SQUARE_ON = 1e-4  # [rad]

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


@kernel(fastmath={"contract", "reassoc", "arcp", "nsz"}, error_model="numpy")
def edge_echoes(transmitters, nodes, between, shares, antennas, light, legs, edges, cluster, carrier, half_band,
                first_bin, width, bins):  # fmt: skip
    """Add what edges diffract beyond physical optics: see `edges`.

    light (P (T + M), E); edges (E, 23): middle; unit vector along; normal of the first face, and direction from the
    edge into it; length; exterior angle n pi, as n; strength (real, imaginary part); the middle in its cluster (E,),
    whose legs hold; cos(pi / n), sin(pi / n) / n, cos(n pi), sin(n pi).
    """
    receivers, columns = len(between), edges.shape[1]
    for sender in prange(len(bins) // receivers):
        pose, number = sender // transmitters, sender % transmitters
        t, r0 = pose * (transmitters + receivers) + number, pose * (transmitters + receivers) + transmitters
        eye_t, eye_r = pose * (transmitters + len(nodes)) + number, pose * (transmitters + len(nodes)) + transmitters
        # Of some edges that are seen: their clusters and columns, and the legs of one antenna; what is sent to them:
        # direction back, path, amplitude, cycles, slope; what returns to each node, but its phase; then echoes of one
        # channel, and their bins.
        chosen, groups, own = np.empty(BLOCK, np.int64), np.empty((BLOCK, 1), np.int64), np.empty((columns, BLOCK))
        leg, sent, seen = np.empty((LEG, BLOCK), np.float32), np.empty((8, BLOCK)), np.empty((len(nodes), BLOCK))
        returned = np.empty((len(nodes), BLOCK))
        echo, place = np.empty((4, BLOCK), np.float32), np.empty(BLOCK, np.int32)
        e = 0
        while e < len(edges):
            found = 0
            while e < len(edges) and found < BLOCK:
                shown = 0
                for m in range(len(nodes)):
                    shown += light[eye_r + m, e]
                if light[eye_t, e] and shown:
                    chosen[found], groups[found, 0] = e, cluster[e]
                    found += 1
                e += 1
            count = np.uint64(found)
            for n in range(found):
                for k in range(columns):
                    own[k, n] = edges[chosen[n], k]
                sent[4, n] = light[eye_t, chosen[n]] / FULL**2
                for m in range(len(nodes)):
                    seen[m, n] = light[eye_r + m, chosen[n]]
            gather(legs[t], groups, 0, 0, count, leg)
            _sent_to(antennas[t], own, leg, count, sent)
            for m in range(len(nodes)):
                gather(legs[r0 + nodes[m]], groups, 0, 0, count, leg)
                _returned(antennas[r0 + nodes[m]], own, leg, sent, carrier, count, returned[m])
            for i in range(receivers):
                one, other = between[i, 0], between[i, 1]
                gather(legs[r0 + i], groups, 0, 0, count, leg)
                _echoes(antennas[r0 + i], own, leg, sent, seen[one], seen[other], returned[one], returned[other],
                        shares[i], carrier, half_band, first_bin, width, count, echo, place)  # fmt: skip
                for n in range(count):
                    if echo[0, n] != 0 or echo[1, n] != 0:
                        add_series(complex(echo[0, n], echo[1, n]), echo[2, n], echo[3, n], bins,
                                   sender * receivers + i, np.uint64(place[n]))  # fmt: skip


@inline
def _sent_to(antenna, own, leg, count, sent):
    """See `edge_echoes`: what an antenna sends to edges; sent[4] is how much of them it sees."""
    ax, ay, az = antenna[0], antenna[1], antenna[2]
    for n in range(count):
        x, y, z = ax - own[0, n], ay - own[1, n], az - own[2, n]
        far = _distance(x, y, z)
        sent[0, n], sent[1, n], sent[2, n], sent[3, n] = x / far, y / far, z / far, far
        px, py, pz = own[16, n], own[17, n], own[18, n]
        gain = leg[0, n] * (_ONE + leg[2, n] * px + leg[3, n] * py + leg[4, n] * pz)
        sent[4, n] *= gain * own[12, n] / (2 * math.pi * far)
        sent[5, n] = leg[1, n] + leg[5, n] * px + leg[6, n] * py + leg[7, n] * pz
        sent[6, n], sent[7, n] = leg[8, n], leg[9, n]


@inline
def _returned(antenna, own, leg, sent, carrier, count, returned):
    """See `edge_echoes`: what edges return to an antenna."""
    ax, ay, az = antenna[0], antenna[1], antenna[2]
    for n in range(count):
        x, y, z = ax - own[0, n], ay - own[1, n], az - own[2, n]
        far = _distance(x, y, z)
        ux, uy, uz = sent[0, n] + x / far, sent[1, n] + y / far, sent[2, n] + z / far
        fringe = _fringe(
            own[9, n] * ux + own[10, n] * uy + own[11, n] * uz, own[6, n] * ux + own[7, n] * uy + own[8, n] * uz,
            own[13, n], own[19, n], own[20, n], own[21, n], own[22, n],
        )  # fmt: skip
        turns = carrier * own[12, n] * (own[3, n] * ux + own[4, n] * uy + own[5, n] * uz) / 2
        turns = turns if abs(turns) > 1e-6 else 1e-6
        gain = leg[0, n] * (_ONE + leg[2, n] * own[16, n] + leg[3, n] * own[17, n] + leg[4, n] * own[18, n])
        returned[n] = fringe * _sine(_wrapped(turns)) / (2 * math.pi * turns) * gain / far


@inline
def _echoes(antenna, own, leg, sent, shown, other_shown, first, second, share, carrier, half_band, first_bin, width,
            count, echo, place):  # fmt: skip
    """See `edge_echoes`: the echoes at a receiver between two nodes, and their bins."""
    ax, ay, az = antenna[0], antenna[1], antenna[2]
    for n in range(count):
        path = sent[3, n] + _distance(ax - own[0, n], ay - own[1, n], az - own[2, n])
        cycles = sent[5, n] + leg[1, n] + leg[5, n] * own[16, n] + leg[6, n] * own[17, n] + leg[7, n] * own[18, n]
        value = sent[4, n] * (shown[n] + share * (other_shown[n] - shown[n]))
        value *= first[n] + share * (second[n] - first[n])
        whole = np.rint(path / width)
        over = path - whole * width
        late = _wrapped(carrier * over + cycles)
        re, im, cosine, sine = value * own[14, n], value * own[15, n], _cosine(late), _sine(late)
        echo[0, n], echo[1, n] = re * cosine + im * sine, im * cosine - re * sine
        echo[2, n], echo[3, n] = sent[6, n] + leg[8, n], sent[7, n] + leg[9, n] - half_band * over
        place[n] = np.int32(whole) - np.int32(first_bin)


@inline
def _fringe(x, y, n, cos_over, sin_over, cos_open, sin_open):
    """Half the sum of both polarisations' fringe coefficients, in backscatter from where (x, y) points.

    x along the first face, y off it; n pi is the exterior angle; then cos(pi / n), sin(pi / n) / n, cos(n pi) and
    sin(n pi). 0 where neither face is seen. Nothing branches: vector code has no way to.
    """
    angle = _angle(x, y)
    other = n * math.pi - angle
    hidden = (other <= 0) | ((n > 1.999) & (angle >= math.pi))
    # Both terms are infinite where a face is seen square on, and their difference is not.
    square = (abs(angle - math.pi / 2) < _SQUARE_ON) | (abs(other - math.pi / 2) < _SQUARE_ON)
    shift = 2 * _SQUARE_ON if square else 0.0
    angle, other, x, y = angle + shift, other - shift, x - shift * y, y + shift * x
    whole = -sin_over / (cos_over - _cosine_of(2 * angle / n))
    whole -= y / x / 2 if angle < math.pi else 0.0  # tan(angle)
    second = (sin_open * x - cos_open * y) / (cos_open * x + sin_open * y) / 2  # tan(n pi - angle)
    whole -= second if other < math.pi else 0.0
    return 0.0 if hidden else whole


# Least errors over their ranges, by interpolation at Chebyshev's nodes: atan(√t) / √t up to tan²(π / 8), and cos(√t) up
# to π²; good to 1e-16 and 1e-15, which the difference of two large terms in `_fringe` needs.
_ATAN = (
    1.0, -0.3333333333332844, 0.1999999999885511, -0.14285714180976467, 0.11111106180455946, -0.09090773074808414,
    0.07689953496306857, -0.06640233930429408, 0.056883492268090106, -0.04348052215716462, 0.021135373157693246,
)  # fmt: skip
_COS = (
    1.0, -0.5, 0.041666666666666664, -0.0013888888888888887, 2.4801587301587014e-05, -2.7557319223966073e-07,
    2.087675698699106e-09, -1.1470745571715717e-11, 4.779476804132112e-14, -1.561913328266812e-16,
    4.109622823389878e-19, -8.854403697931455e-22, 1.4599701429343213e-24,
)  # fmt: skip


@inline
def _angle(x, y):
    """Of (x, y), from 0 to 2 pi."""
    across, up = abs(x), abs(y)
    large, small = max(across, up), min(across, up)
    ratio = small / max(large, 1e-300)
    steep = ratio > 0.41421356237309503  # tan(pi / 8)
    ratio = (ratio - 1) / (ratio + 1) if steep else ratio
    t, sum_ = ratio * ratio, _ATAN[10]
    for k in range(9, -1, -1):
        sum_ = _ATAN[k] + t * sum_
    angle = ratio * sum_ + (math.pi / 4 if steep else 0.0)
    angle = math.pi / 2 - angle if up > across else angle
    angle = math.pi - angle if x < 0 else angle
    return 2 * math.pi - angle if y < 0 else angle


@inline
def _cosine_of(angle):
    """In double precision, of an angle of some turns."""
    over = angle - 2 * math.pi * np.rint(angle / (2 * math.pi))
    t, sum_ = over * over, _COS[12]
    for k in range(11, -1, -1):
        sum_ = _COS[k] + t * sum_
    return sum_


@inline
def gather(legs, clusters, which, start, count, leg):
    """The legs to clusters (M, 2) of pairs, or (M, 1) of edges, in a row for each number: vector code needs them so."""
    for n in range(count):
        g = clusters[start + n, which]
        for k in range(LEG):
            leg[k, n] = legs[g, k]


@inline
def _between(start, stop):
    """The way from one place to another, of which the first three numbers count."""
    return stop[0] - start[0], stop[1] - start[1], stop[2] - start[2]


@inline
def _along(s, k, x, y, z):
    """(x, y, z) along the vector that starts at s[k]."""
    return s[k] * x + s[k + 1] * y + s[k + 2] * z


@inline
def add_series(value, slope_re, slope_im, bins, c, b):
    """Add value times exp(slope ν) to the series of a bin."""
    re, im = value.real, value.imag
    for m in range(ORDER):
        bins[c, b, m] += complex(re, im)
        share = _f32(1 / (m + 1))
        re, im = share * (re * slope_re - im * slope_im), share * (re * slope_im + im * slope_re)
