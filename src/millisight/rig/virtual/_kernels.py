"""The inner loops of the rig's optics, compiled by Numba.

Echoes are gathered in *range bins*: bin b stands for the path length D = b `width` and holds a power series in ν, the
frequency from -1 to 1 across the band. An echo of amplitude A at path length d adds the first ORDER terms of
A exp(-i k_c (d - D)) exp(-i q ν), with q = `half_band` (d - D) and k_c the wave number at the band's centre. The
factor exp(-i k D) of every bin comes later, for all samples at once, as a product of matrices.

Arrays that several loops share:

antennas (A, 3) positions [m]; channels (C, 2) which of them send and receive; centers (G, 3) of the clusters [m]
light (A, V) uint8, how much of each target an antenna sees, 255: all of it
legs (A, G, LEG) float32, what happens to a wave between an antenna and a cluster, besides spreading: amplitude;
    phase [cycles]; relative gradient of the amplitude [1/m] (3); gradient of the phase [cycles/m] (3); and the
    logarithm's slope in ν (real and imaginary part). The gradients are over the place in the cluster
bins (C, B, ORDER) complex64
"""

import math

import numpy as np

from millisight.core import inline, kernel, phase, prange

_distance = inline(phase.distance)
_wrapped = inline(phase.wrapped)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)

ORDER = 7
"""Terms of a bin's series: for |q| up to 0.9 they are good to 1e-4."""

LEG = 10
"""Numbers that describe a leg."""

ROWS = 15
"""Rows of the patches' table: place in the cluster, normal, two corners from the centroid (3 each), area over the
wavelength, and the random amplitude's real and imaginary part."""

FULL = 255
"""Of `light`."""

_f32 = np.float32
_ONE, _TWO, _HALF, _ZERO = _f32(1), _f32(2), _f32(0.5), _f32(0)
# 2 h_n / (n + 2)! of the phase on a triangle, see `_form_factor`.
_F2, _F4, _F6, _F8, _F10 = (_f32(2 / math.factorial(n + 2)) for n in (2, 4, 6, 8, 10))
_F3, _F5, _F7, _F9 = (_f32(2 / math.factorial(n + 2)) for n in (3, 5, 7, 9))


def _form_factor(a, b):
    """Mean of exp(i φ) over a triangle on which φ is linear, a and b at two corners and -a - b at the third.

    It is twice the divided difference of exp at the corners' i φ, so 2 sum_n i^n h_n / (n + 2)!, with h_n the complete
    homogeneous symmetric polynomials of the three phases: h_n = p h_(n-2) + q h_(n-3), where p = a² + a b + b² and
    q = -a b (a + b). (The integral as such: Gordon, IEEE Trans. Antennas Propag. 23, 590 (1975).)
    """
    p = a * a + a * b + b * b
    q = -a * b * (a + b)
    qq = q * q
    real = _ONE - p * (_F2 - p * (_F4 - p * (_F6 - p * (_F8 - p * _F10))))
    real += qq * (-_F6 + p * (_f32(3) * _F8 - p * _f32(6) * _F10))
    imag = q * (-_F3 + p * (_TWO * _F5 - p * (_f32(3) * _F7 - p * _f32(4) * _F9)) + qq * _F9)
    return real, imag


def _polynomial(c, x):
    """Of degree 8, coefficients (9,) the lowest first, by Horner's rule."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * (c[5] + x * (c[6] + x * (c[7] + x * c[8])))))))


form_factor = inline(_form_factor, fastmath=True)
polynomial = inline(_polynomial, fastmath=True)


@kernel(fastmath=True, error_model="numpy")
def surface_echoes(channels, antennas, light, legs, table, starts, centers, cones, surface, coherent, terms,
                   diffuse, carrier, half_band, first_bin, width, bins):  # fmt: skip
    """Add the echoes of all patches: Kirchhoff's integral over what both antennas see (see `optics`).

    cones (G, 5): mean normal of a cluster, sine of the largest angle to it, radius [m]; clusters that face away are
    passed over. coherent (S, 3, 2, 9), terms (S,), diffuse (S, 9): see `surface.fitted`.
    """
    carrier32, slope32 = _f32(carrier), _f32(half_band)
    wave_number = _f32(2 * math.pi * carrier)
    for c in prange(len(channels)):
        t, r = channels[c, 0], channels[c, 1]
        light_t, light_r = light[t], light[r]
        series = np.empty(ORDER, np.complex64)
        for g in range(len(starts) - 1):
            # The cluster's common distance in float64; what is left is small enough for float32.
            tx, ty, tz = antennas[t, 0] - centers[g, 0], antennas[t, 1] - centers[g, 1], antennas[t, 2] - centers[g, 2]
            rx, ry, rz = antennas[r, 0] - centers[g, 0], antennas[r, 1] - centers[g, 1], antennas[r, 2] - centers[g, 2]
            to, back = _distance(tx, ty, tz), _distance(rx, ry, rz)
            if not _faces(cones, g, tx, ty, tz, to) or not _faces(cones, g, rx, ry, rz, back):
                continue
            gain = legs[t, g, 0] * legs[r, g, 0] * _f32(1 / FULL**2)
            if gain == 0:
                continue
            b = int(np.rint((to + back) / width))
            over = to + back - b * width
            base = _f32(_wrapped(carrier * over + legs[t, g, 1] + legs[r, g, 1]))
            over32, to32, back32 = _f32(over), _f32(to), _f32(back)
            ax, ay, az, bx, by, bz = _f32(tx), _f32(ty), _f32(tz), _f32(rx), _f32(ry), _f32(rz)
            gx, gy, gz = legs[t, g, 2] + legs[r, g, 2], legs[t, g, 3] + legs[r, g, 3], legs[t, g, 4] + legs[r, g, 4]
            kx, ky, kz = legs[t, g, 5] + legs[r, g, 5], legs[t, g, 6] + legs[r, g, 6], legs[t, g, 7] + legs[r, g, 7]
            tilt = complex(legs[t, g, 8] + legs[r, g, 8], legs[t, g, 9] + legs[r, g, 9])
            for j in range(terms[surface[g]]):
                law_re, law_im, rough = coherent[surface[g], j, 0], coherent[surface[g], j, 1], diffuse[surface[g]]
                random = _ONE if j == 0 else _ZERO
                r0 = r1 = r2 = r3 = r4 = r5 = r6 = _ZERO
                i0 = i1 = i2 = i3 = i4 = i5 = i6 = _ZERO
                # Vector code, since nothing is stored, and since unsigned indices cannot count from an array's end.
                for p in range(np.uint64(starts[g]), np.uint64(starts[g + 1])):
                    x, y, z = table[0, p], table[1, p], table[2, p]
                    nx, ny, nz = table[3, p], table[4, p], table[5, p]
                    px, py, pz, qx, qy, qz = ax - x, ay - y, az - z, bx - x, by - y, bz - z
                    p_square, q_square = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz
                    p_over, q_over = _ONE / math.sqrt(p_square), _ONE / math.sqrt(q_square)
                    p_long, q_long = p_square * p_over, q_square * q_over
                    cos_t, cos_r = (px * nx + py * ny + pz * nz) * p_over, (qx * nx + qy * ny + qz * nz) * q_over
                    # |a - x| - |a| = (x² - 2 a x) / (|a - x| + |a|), without cancellation.
                    square = x * x + y * y + z * z
                    longer = (square - _TWO * (ax * x + ay * y + az * z)) / (p_long + to32)
                    longer += (square - _TWO * (bx * x + by * y + bz * z)) / (q_long + back32)
                    # From a patch's centroid to its corners the path grows against the sum of both directions.
                    ux, uy, uz = px * p_over + qx * q_over, py * p_over + qy * q_over, pz * p_over + qz * q_over
                    form_re, form_im = form_factor(
                        wave_number * (ux * table[6, p] + uy * table[7, p] + uz * table[8, p]),
                        wave_number * (ux * table[9, p] + uy * table[10, p] + uz * table[11, p]),
                    )
                    obliquity, lower = _HALF * (cos_t + cos_r), min(cos_t, cos_r)
                    at = _TWO * obliquity - _ONE
                    mirror = table[12, p] * obliquity
                    law_r, law_i = mirror * polynomial(law_re, at), mirror * polynomial(law_im, at)
                    spread = random * lower * polynomial(rough, _TWO * lower - _ONE)
                    value_re = spread * table[13, p] - (law_r * form_im + law_i * form_re)
                    value_im = spread * table[14, p] + (law_r * form_re - law_i * form_im)
                    weight = p_over * q_over * (_ONE + gx * x + gy * y + gz * z)
                    weight *= _f32(light_t[p]) * _f32(light_r[p])
                    weight = weight if lower > _ZERO else _ZERO
                    cycles = _wrapped(base + carrier32 * longer + kx * x + ky * y + kz * z)
                    cosine, sine = weight * _cosine(cycles), weight * _sine(cycles)
                    re, im = value_re * cosine + value_im * sine, value_im * cosine - value_re * sine
                    q = slope32 * (over32 + longer)
                    r0 += re
                    i0 += im
                    re, im = re * q, im * q
                    r1 += re
                    i1 += im
                    re, im = re * q, im * q
                    r2 += re
                    i2 += im
                    re, im = re * q, im * q
                    r3 += re
                    i3 += im
                    re, im = re * q, im * q
                    r4 += re
                    i4 += im
                    re, im = re * q, im * q
                    r5 += re
                    i5 += im
                    re, im = re * q, im * q
                    r6 += re
                    i6 += im
                # Terms of exp(-i q ν): (-i)^m / m! times the moments.
                series[0] = gain * complex(r0, i0)
                series[1] = gain * complex(i1, -r1)
                series[2] = gain * complex(-r2, -i2) / 2
                series[3] = gain * complex(-i3, r3) / 6
                series[4] = gain * complex(r4, i4) / 24
                series[5] = gain * complex(i5, -r5) / 120
                series[6] = gain * complex(-r6, -i6) / 720
                _add_tilted(series, tilt, j, bins[c, b - first_bin])


@inline
def _faces(cones, g, x, y, z, distance):
    """Whether some patch of cluster g may face an antenna at (x, y, z) from its centre."""
    along = cones[g, 0] * x + cones[g, 1] * y + cones[g, 2] * z
    return along > -(cones[g, 3] * distance + cones[g, 4])


@inline
def _add_tilted(series, tilt, power, total):
    """Add series times exp(tilt ν) ν^power to the series `total`."""
    factor = complex(1.0, 0.0)
    for k in range(ORDER - power):
        for m in range(ORDER - power - k):
            total[m + k + power] += series[m] * factor
        factor = factor * (tilt * (1.0 / (k + 1)))
