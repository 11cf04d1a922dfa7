"""Compiled loops over single paths: legs through antennas and sheets, edges, and double bounces. See `_kernels`."""

import math

import numpy as np
from numba import prange

from millisight.core import inline, kernel, phase
from millisight.rig.virtual._kernels import FULL, ORDER, form_factor, polynomial

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine)
_sine = inline(phase.sine)

FULL_SLOPE, NO_SLOPE = 0.4, 0.8
"""Slope of the path over the second face up to which a double bounce counts in full, and from which not at all."""

MOST_PHASE = 4.3
"""On a patch, off that of its centroid, for which its series is made; a slant may stretch a tube of rays beyond."""

_PLANE = 1e-6  # nearer to a sheet than this [m], a place lies in it and not behind it


@kernel(error_model="numpy")
def fill_legs(antennas, axes, exponents, centers, own, sheets, tables, legs):
    """legs[a, g] of every antenna and cluster: the antenna's pattern, and the sheets that are crossed.

    axes (A, 3, 3): the radar's x, y and the direction it looks in, as rows, in the world frame; exponents (2,) of its
    pattern, see `antenna`; own (G,): the sheet that a cluster is a part of, which it does not look through, or below 0:
    the middle of a tilted cluster's box lies a little off its plane; sheets (K, 14): corner, unit vectors along both
    sides, normal, and the sides' lengths; tables (K, N, 4) over the cosine of incidence from 0 to 1: logarithm of the
    transmission's amplitude, its delay [cycles], and the slope of the transmission's logarithm in ν (real, imaginary
    part).
    """
    steps = tables.shape[1] - 1
    for a in prange(len(antennas)):
        for g in range(len(centers)):
            x, y, z = _between(antennas[a], centers[g])
            far = _distance(x, y, z)
            level = phase = slope_re = slope_im = 0.0
            gx = gy = gz = kx = ky = kz = 0.0
            open_ = True
            if exponents[0] > 0 or exponents[1] > 0:
                ahead = x * axes[a, 2, 0] + y * axes[a, 2, 1] + z * axes[a, 2, 2]
                open_ = ahead > 1e-3 * far
                if open_:
                    for i in range(2):
                        ux, uy, uz = axes[a, i, 0], axes[a, i, 1], axes[a, i, 2]
                        aside = x * ux + y * uy + z * uz
                        square = ahead * ahead + aside * aside
                        quarter = exponents[i] / 4
                        level += quarter * math.log(ahead * ahead / square)
                        by_ahead, by_aside = quarter * (2 / ahead - 2 * ahead / square), -quarter * 2 * aside / square
                        gx += by_ahead * axes[a, 2, 0] + by_aside * ux
                        gy += by_ahead * axes[a, 2, 1] + by_aside * uy
                        gz += by_ahead * axes[a, 2, 2] + by_aside * uz
            for k in range(len(sheets)):
                if k == own[g]:
                    continue
                s = sheets[k]
                px, py, pz = _between(s, antennas[a])
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
            row = legs[a, g]
            row[0], row[1] = math.exp(level) if open_ else 0.0, phase
            row[2], row[3], row[4] = gx, gy, gz
            row[5], row[6], row[7] = kx, ky, kz
            row[8], row[9] = slope_re, slope_im


@kernel(error_model="numpy")
def edge_echoes(channels, antennas, light, legs, edges, cluster, carrier, half_band, first_bin, width, bins):
    """Add what edges diffract beyond physical optics: see `edges`.

    light (A, E); edges (E, 19): middle; unit vector along; normal of the first face, and direction from the edge into
    it; length; exterior angle over pi; strength (real, imaginary part); and the middle in its cluster (E,), whose legs
    hold.
    """
    for c in prange(len(channels)):
        t, r = channels[c, 0], channels[c, 1]
        for e in range(len(edges)):
            seen = light[t, e] * (light[r, e] / FULL**2)
            if seen == 0:
                continue
            s = edges[e]
            px, py, pz = _between(s, antennas[t])
            qx, qy, qz = _between(s, antennas[r])
            to, back = _distance(px, py, pz), _distance(qx, qy, qz)
            ux, uy, uz = px / to + qx / back, py / to + qy / back, pz / to + qz / back
            angle = math.atan2(_along(s, 6, ux, uy, uz), _along(s, 9, ux, uy, uz))
            fringe = _fringe(angle if angle >= 0 else angle + 2 * math.pi, s[13])
            if fringe == 0:
                continue
            half_turn = math.pi * carrier * s[12] * _along(s, 3, ux, uy, uz)
            if abs(half_turn) > 1e-6:
                fringe *= math.sin(half_turn) / half_turn
            leg_t, leg_r = legs[t, cluster[e]], legs[r, cluster[e]]
            gain = _amplitude_at(leg_t, s[16], s[17], s[18]) * _amplitude_at(leg_r, s[16], s[17], s[18])
            cycles = _cycles_at(leg_t, s[16], s[17], s[18]) + _cycles_at(leg_r, s[16], s[17], s[18])
            size = seen * gain * fringe * s[12] / (2 * math.pi * to * back)
            _deposit(size * complex(s[14], s[15]), to + back, cycles, _tilt(leg_t, leg_r), carrier, half_band,
                     first_bin, width, bins[c])  # fmt: skip


@inline
def _fringe(angle, n):
    """Half the sum of both polarisations' fringe coefficients, in backscatter, at `angle` from the first face.

    n pi is the exterior angle. 0 where neither face is seen.
    """
    other = n * math.pi - angle
    if other <= 0 or (n > 1.999 and angle >= math.pi):
        return 0.0
    # Both terms are infinite where a face is seen square on, and their difference is not.
    for side in (angle, other):
        if abs(side - math.pi / 2) < 1e-4:
            angle += 2e-4
            other -= 2e-4
    whole = -math.sin(math.pi / n) / n / (math.cos(math.pi / n) - math.cos(2 * angle / n))
    if angle < math.pi:
        whole -= math.tan(angle) / 2
    if other < math.pi:
        whole -= math.tan(other) / 2
    return whole


@kernel(error_model="numpy")
def bounce_echoes(channels, antennas, legs, pairs, clusters, centers, surface, coherent, carrier, half_band, first_bin,
                  width, bins):  # fmt: skip
    """Add echoes of waves that one patch mirrors onto another's plane: see `bounce`.

    pairs (M, 20): centroid of the first patch; its normal; normal of the second; from the first's centroid to two of
    its corners; its area; its height over the second's plane; its place in its cluster. clusters (M, 2): of both.
    """
    for c in prange(len(channels)):
        t, r = channels[c, 0], channels[c, 1]
        for i in range(len(pairs)):
            s = pairs[i]
            # From the transmitter to the first patch, and on in the mirrored direction w.
            x, y, z = _between(antennas[t], s)
            one = _distance(x, y, z)
            over = 1 / one
            cos_a = -over * _along(s, 3, x, y, z)
            if cos_a <= 0:
                continue
            wx, wy, wz = x * over + 2 * cos_a * s[3], y * over + 2 * cos_a * s[4], z * over + 2 * cos_a * s[5]
            cos_b = -_along(s, 6, wx, wy, wz)
            if cos_b < 0.02 or s[16] <= 0:
                continue
            slant = 1 / cos_b
            two = s[16] * slant
            # Where it meets the second plane, and from there to the receiver, in direction v.
            hit = s[0] + two * wx, s[1] + two * wy, s[2] + two * wz
            vx, vy, vz = _between(hit, antennas[r])
            three = _distance(vx, vy, vz)
            back = 1 / three
            vx, vy, vz = vx * back, vy * back, vz * back
            cos_s = _along(s, 6, vx, vy, vz)
            if cos_s <= 0:
                continue
            # How fast the path changes over the second plane.
            onto = cos_b + cos_s
            gx, gy, gz = wx - vx + onto * s[6], wy - vy + onto * s[7], wz - vz + onto * s[8]
            slope = _distance(gx, gy, gz)
            if slope >= NO_SLOPE:
                continue
            # The tube of rays has grown on its way, and falls on the second face at a slant.
            growth = 1 + two * over
            area = s[15] * cos_a * growth * growth * slant
            # Displaced by e on the first face, a ray falls e + w (e m) / cos_b aside on the second, times its growth.
            turn = -2 * math.pi * carrier * growth
            along_w = _dot(gx, gy, gz, wx, wy, wz) * slant
            p = turn * (_along(s, 9, gx, gy, gz) + along_w * _along(s, 9, s[6], s[7], s[8]))
            q = turn * (_along(s, 12, gx, gy, gz) + along_w * _along(s, 12, s[6], s[7], s[8]))
            if max(abs(p), abs(q), abs(p + q)) > MOST_PHASE:
                continue
            form_re, form_im = form_factor(np.float32(p), np.float32(q))
            obliquity = onto / 2
            law_a, law_b = coherent[surface[clusters[i, 0]], 0], coherent[surface[clusters[i, 1]], 0]
            at_a, at_b = np.float32(2 * cos_a - 1), np.float32(2 * obliquity - 1)
            mirror = complex(polynomial(law_a[0], at_a), polynomial(law_a[1], at_a))
            mirror *= complex(polynomial(law_b[0], at_b), polynomial(law_b[1], at_b)) * complex(form_re, form_im)
            leg_t, leg_r = legs[t, clusters[i, 0]], legs[r, clusters[i, 1]]
            ex, ey, ez = _between(centers[clusters[i, 1]], hit)
            gain = _amplitude_at(leg_t, s[17], s[18], s[19]) * _amplitude_at(leg_r, ex, ey, ez)
            if slope > FULL_SLOPE:
                gain *= (1 + math.cos(math.pi * (slope - FULL_SLOPE) / (NO_SLOPE - FULL_SLOPE))) / 2
            size = gain * carrier * area * obliquity * back / (one + two)
            cycles = _cycles_at(leg_t, s[17], s[18], s[19]) + _cycles_at(leg_r, ex, ey, ez)
            _deposit(complex(-size * mirror.imag, size * mirror.real), one + two + three, cycles, _tilt(leg_t, leg_r),
                     carrier, half_band, first_bin, width, bins[c])  # fmt: skip


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
def _deposit(value, path, cycles, tilt, carrier, half_band, first_bin, width, bins):
    """Add an echo of complex amplitude `value` at path length `path`, and `cycles` later, to a channel's bins."""
    b = int(np.rint(path / width))
    over = path - b * width
    late = _wrapped(carrier * over + cycles)
    value = value * complex(_cosine(late), -_sine(late))
    re, im, slope_re, slope_im = value.real, value.imag, tilt.real, tilt.imag - half_band * over
    for m in range(ORDER):
        bins[b - first_bin, m] += complex(re, im)
        share = 1.0 / (m + 1)
        re, im = share * (re * slope_re - im * slope_im), share * (re * slope_im + im * slope_re)
