"""The inner loops of the rig's optics, compiled by Numba.

Echoes are gathered in *range bins*: bin b stands for the path length D = b `width` and holds a power series in ν, the
frequency from -1 to 1 across the band. An echo of amplitude A at path length d adds the first ORDER terms of
A exp(-i k_c (d - D)) exp(-i q ν), with q = `half_band` (d - D) and k_c the wave number at the band's centre. The
factor exp(-i k D) of every bin comes later, for all samples at once, as a product of matrices.

Arrays that several loops share:

antennas (P (T + R), 3) of each pose the positions [m] of its T transmitters and R receivers; channels C = P T R
nodes (M,), between (R, 2), shares (R,): receivers that stand for the others, see `Nodes`
light (P (T + M), V) uint8, how much of each target transmitters and nodes see, 255: all of it
centers (G, 3) of the clusters [m]
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

BLOCK = 256
"""Targets that are computed together, in vector code."""

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
def surface_echoes(transmitters, nodes, between, shares, antennas, light, legs, table, starts, centers, cones, surface,
                   coherent, terms, diffuse, carrier, half_band, first_bin, width, bins):  # fmt: skip
    """Add the echoes of all patches: Kirchhoff's integral over what both antennas see (see `optics`).

    cones (G, 5): mean normal of a cluster, sine of the largest angle to it, radius [m]; clusters that face away are
    passed over. coherent (S, 3, 2, 9), terms (S,), diffuse (S, 9): see `surface.fitted`.
    """
    carrier32, slope32 = _f32(carrier), _f32(half_band)
    wave_number = _f32(2 * math.pi * carrier)
    receivers = len(between)
    for sender in prange(len(bins) // receivers):
        # Of some patches: what they return without their surface's law, and 2 cos θ - 1; by node and power of ν the
        # amplitude (real, imaginary part); by how much the transmitter's leg is longer than to the centre; and of one
        # channel cosine, sine, and q. Vector code, as their sizes are known and none overlaps another.
        shape, amplitudes = np.empty((3, BLOCK), np.float32), np.empty((len(nodes), 3, 2, BLOCK), np.float32)
        longer, waves = np.empty(BLOCK, np.float32), np.empty((3, BLOCK), np.float32)
        backs, series = np.empty(receivers), np.empty(ORDER, np.complex64)
        pose, number = sender // transmitters, sender % transmitters
        t, r0 = pose * (transmitters + receivers) + number, pose * (transmitters + receivers) + transmitters
        eye_t, eye_r = pose * (transmitters + len(nodes)) + number, pose * (transmitters + len(nodes)) + transmitters
        for g in range(len(starts) - 1):
            # The cluster's common distance in float64; what is left is small enough for float32.
            ox, oy, oz = centers[g, 0], centers[g, 1], centers[g, 2]
            tx, ty, tz = antennas[t, 0] - ox, antennas[t, 1] - oy, antennas[t, 2] - oz
            to = _distance(tx, ty, tz)
            if legs[t, g, 0] == 0 or not faces(cones, g, tx, ty, tz, to):
                continue
            faced = False
            for i in range(receivers):
                rx, ry, rz = antennas[r0 + i, 0] - ox, antennas[r0 + i, 1] - oy, antennas[r0 + i, 2] - oz
                back = _distance(rx, ry, rz)
                backs[i] = back if legs[r0 + i, g, 0] != 0 and faces(cones, g, rx, ry, rz, back) else 0.0
                faced = faced or backs[i] > 0
            if not faced:
                continue
            s = surface[g]
            for start in range(starts[g], starts[g + 1], BLOCK):
                count = np.uint64(min(starts[g + 1] - start, BLOCK))
                for m in range(len(nodes)):
                    r = r0 + nodes[m]
                    _amplitudes(_f32(tx), _f32(ty), _f32(tz), _f32(to), _f32(antennas[r, 0] - ox),
                                _f32(antennas[r, 1] - oy), _f32(antennas[r, 2] - oz), legs[t, g], legs[r, g],
                                light[eye_t], light[eye_r + m], wave_number, table, start, count, coherent[s, 0],
                                diffuse[s], shape, amplitudes[m, 0], longer)  # fmt: skip
                    for j in range(1, terms[s]):
                        _by_another_law(shape, coherent[s, j], count, amplitudes[m, j])
                for i in range(receivers):
                    if backs[i] == 0:
                        continue
                    r, back = r0 + i, backs[i]
                    b = int(np.rint((to + back) / width))
                    over = to + back - b * width
                    base = _f32(_wrapped(carrier * over + legs[t, g, 1] + legs[r, g, 1]))
                    _phases(_f32(antennas[r, 0] - ox), _f32(antennas[r, 1] - oy), _f32(antennas[r, 2] - oz), _f32(back),
                            legs[t, g], legs[r, g], base, carrier32, slope32, _f32(over), table, start, count, longer,
                            waves)  # fmt: skip
                    gain = legs[t, g, 0] * legs[r, g, 0] * _f32(1 / FULL**2)
                    tilt = complex(legs[t, g, 8] + legs[r, g, 8], legs[t, g, 9] + legs[r, g, 9])
                    one, other = between[i, 0], between[i, 1]
                    for j in range(terms[s]):
                        _moments(amplitudes[one, j], amplitudes[other, j], shares[i], waves, count, gain, series)
                        _add_tilted(series, tilt, j, bins[sender * receivers + i, b - first_bin])


@inline
def _amplitudes(ax, ay, az, to, bx, by, bz, leg_t, leg_r, light_t, light_r, wave_number, table, start, count, law,
                diffuse, shape, amplitude, longer):  # fmt: skip
    """What each patch returns, but its phase, between antennas at a and b from the cluster's centre."""
    gx, gy, gz = leg_t[2] + leg_r[2], leg_t[3] + leg_r[3], leg_t[4] + leg_r[4]
    law_re, law_im = law[0], law[1]
    for n in range(np.uint64(0), count):  # unsigned, as such an index cannot count from an array's end
        p = np.uint64(start) + n
        x, y, z = table[0, p], table[1, p], table[2, p]
        nx, ny, nz = table[3, p], table[4, p], table[5, p]
        px, py, pz, qx, qy, qz = ax - x, ay - y, az - z, bx - x, by - y, bz - z
        p_square, q_square = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz
        p_over, q_over = _ONE / math.sqrt(p_square), _ONE / math.sqrt(q_square)
        cos_t, cos_r = (px * nx + py * ny + pz * nz) * p_over, (qx * nx + qy * ny + qz * nz) * q_over
        # |a - x| - |a| = (x² - 2 a x) / (|a - x| + |a|), without cancellation.
        square = x * x + y * y + z * z
        longer[n] = (square - _TWO * (ax * x + ay * y + az * z)) / (p_square * p_over + to)
        # From a patch's centroid to its corners the path grows against the sum of both directions.
        ux, uy, uz = px * p_over + qx * q_over, py * p_over + qy * q_over, pz * p_over + qz * q_over
        form_re, form_im = form_factor(
            wave_number * (ux * table[6, p] + uy * table[7, p] + uz * table[8, p]),
            wave_number * (ux * table[9, p] + uy * table[10, p] + uz * table[11, p]),
        )
        obliquity, lower = _HALF * (cos_t + cos_r), min(cos_t, cos_r)
        at = _TWO * obliquity - _ONE
        weight = p_over * q_over * (_ONE + gx * x + gy * y + gz * z) * _f32(light_t[p]) * _f32(light_r[p])
        weight = weight if lower > _ZERO else _ZERO
        mirror, spread = weight * table[12, p] * obliquity, weight * lower * polynomial(diffuse, _TWO * lower - _ONE)
        re, im = mirror * form_re, mirror * form_im
        law_r, law_i = polynomial(law_re, at), polynomial(law_im, at)
        amplitude[0, n] = spread * table[13, p] - (law_r * im + law_i * re)
        amplitude[1, n] = spread * table[14, p] + (law_r * re - law_i * im)
        shape[0, n], shape[1, n], shape[2, n] = re, im, at


@inline
def _by_another_law(shape, law, count, amplitude):
    """Amplitudes by the reflection's change with another power of ν."""
    law_re, law_im = law[0], law[1]
    for n in range(np.uint64(0), count):
        re, im, at = shape[0, n], shape[1, n], shape[2, n]
        law_r, law_i = polynomial(law_re, at), polynomial(law_im, at)
        amplitude[0, n], amplitude[1, n] = -(law_r * im + law_i * re), law_r * re - law_i * im


@inline
def _phases(bx, by, bz, back, leg_t, leg_r, base, carrier, slope, over, table, start, count, longer, waves):
    """Cosine and sine of each patch's phase, and q."""
    kx, ky, kz = leg_t[5] + leg_r[5], leg_t[6] + leg_r[6], leg_t[7] + leg_r[7]
    for n in range(np.uint64(0), count):
        p = np.uint64(start) + n
        x, y, z = table[0, p], table[1, p], table[2, p]
        qx, qy, qz = bx - x, by - y, bz - z
        far = math.sqrt(qx * qx + qy * qy + qz * qz)
        both = longer[n] + (x * x + y * y + z * z - _TWO * (bx * x + by * y + bz * z)) / (far + back)
        cycles = _wrapped(base + carrier * both + kx * x + ky * y + kz * z)
        waves[0, n], waves[1, n], waves[2, n] = _cosine(cycles), _sine(cycles), slope * (over + both)


@inline
def _moments(first, second, share, waves, count, gain, series):
    """The series in ν of all patches' echoes, whose amplitudes lie between the `first` and the `second`."""
    r0 = r1 = r2 = r3 = r4 = r5 = r6 = _ZERO
    i0 = i1 = i2 = i3 = i4 = i5 = i6 = _ZERO
    for n in range(np.uint64(0), count):
        cosine, sine, q = waves[0, n], waves[1, n], waves[2, n]
        value_re = first[0, n] + share * (second[0, n] - first[0, n])
        value_im = first[1, n] + share * (second[1, n] - first[1, n])
        re, im = value_re * cosine + value_im * sine, value_im * cosine - value_re * sine
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


@inline
def faces(cones, g, x, y, z, distance):
    """Whether some patch of cluster g may face an antenna at (x, y, z) from its centre."""
    along = cones[g, 0] * x + cones[g, 1] * y + cones[g, 2] * z
    return along > -(cones[g, 3] * distance + cones[g, 4])


@inline
def _add_tilted(series, tilt, power, total):
    """Add series times exp(tilt ν) ν^power to the series `total`."""
    factor = complex(_ONE, _ZERO)
    for k in range(ORDER - power):
        for m in range(ORDER - power - k):
            total[m + k + power] += series[m] * factor
        factor = factor * tilt * (_ONE / _f32(k + 1))
        if factor == 0:  # nothing is crossed
            break
