"""The imagers' inner loops, compiled by Numba.

Every loop runs in parallel over voxels and serially over channels, so that a voxel's sum has one order and the
image does not depend on the number of threads.
"""

import math
from functools import partial

import numpy as np

from millisight.core import Halved, halved, halved_product, inline, kernel, phase, prange, product, serial, subroutine
from millisight.imaging._lengths import EXACT_CYCLES, rows_of_pairs
from millisight.imaging._merge_kernels import merge as merge

_distance = inline(phase.distance)
_distance32 = inline(phase.distance, fastmath=True)
_refracted = inline(phase.refracted)
_wrapped = inline(phase.wrapped, fastmath=True)
_cosine = inline(phase.cosine, fastmath=True)
_sine = inline(phase.sine, fastmath=True)

# What the drivers do with arrays, under the names that `_cuda` has for it: here all lie in NumPy.
empty = partial(np.empty, dtype=np.float32)
zeros = partial(np.zeros, dtype=np.float32)
to_device = to_host = np.asarray


def steering(turns: np.ndarray, matrix: np.ndarray) -> Halved | np.ndarray:
    """turns[:, None] * matrix, turns (N,), matrix (N, M), as `compress` takes it."""
    halves = halved(turns, matrix)
    return (turns[:, None] * matrix).astype(np.complex64) if halves is None else halves


def compress(frames: np.ndarray, by: Halved | np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """(..., M) complex64 range profiles of frames (..., N), by a `steering`; in `out`, on the host, if given."""
    return halved_product(frames, by, out) if isinstance(by, Halved) else product(frames, by, out)


# Voxels that one thread carries through all channels of a block: the scratch rows (nine of 4 bytes) and the range
# profile stay in the first-level cache, and the loops are long enough for vector code.
_TILE = 256

_U = np.uint64  # of indices: Numba lets signed ones count from the end, and LLVM then reads no vectors


@kernel()
def exact_any(frames, tx, rx, wavenumbers, points, path_offset, layers, sums):
    """sums[v] += sum over channels and samples of S exp(+i 2 pi f d / c), float64; any frequencies.

    layers : None, or the fields of `ExactLayers`
    """
    poses, transmitters, receivers, samples = frames.shape
    for v in prange(len(points)):
        total = 0.0 + 0.0j
        for p in range(poses):
            for t in range(transmitters):
                to = _path(points, v, tx, p, t, layers)
                for r in range(receivers):
                    cycles = to + _path(points, v, rx, p, r, layers) + path_offset
                    for j in range(samples):
                        angle = phase.TAU * (wavenumbers[j] * cycles)
                        total += frames[p, t, r, j] * complex(math.cos(angle), math.sin(angle))
        sums[v] += total


@kernel()
def exact_even(frames, tx, rx, wavenumbers, points, path_offset, layers, sums):
    """As `exact_any` for evenly spaced frequencies: Horner's rule in exp(+i 2 pi step d), one sine a channel.

    A product of N unit phasors in float64 is good to N roundings, 1e-13.
    """
    poses, transmitters, receivers, samples = frames.shape
    step = (wavenumbers[samples - 1] - wavenumbers[0]) / max(samples - 1, 1)
    lanes = 64
    for tile in prange((len(points) + lanes - 1) // lanes):
        first = tile * lanes
        count = min(lanes, len(points) - first)
        turn_re, turn_im = np.empty(lanes), np.empty(lanes)
        sum_re, sum_im = np.empty(lanes), np.empty(lanes)
        path = np.empty(lanes)
        for p in range(poses):
            for t in range(transmitters):
                for r in range(receivers):
                    for i in range(count):
                        path[i] = _path(points, first + i, tx, p, t, layers) + path_offset
                        path[i] += _path(points, first + i, rx, p, r, layers)
                        angle = phase.TAU * (step * path[i])
                        turn_re[i], turn_im[i] = math.cos(angle), math.sin(angle)
                        sum_re[i] = frames[p, t, r, samples - 1].real
                        sum_im[i] = frames[p, t, r, samples - 1].imag
                    for j in range(samples - 2, -1, -1):
                        sample = frames[p, t, r, j]
                        for i in range(count):
                            real = sum_re[i] * turn_re[i] - sum_im[i] * turn_im[i] + sample.real
                            sum_im[i] = sum_re[i] * turn_im[i] + sum_im[i] * turn_re[i] + sample.imag
                            sum_re[i] = real
                    for i in range(count):
                        angle = phase.TAU * (wavenumbers[0] * path[i])
                        sums[first + i] += complex(sum_re[i], sum_im[i]) * complex(math.cos(angle), math.sin(angle))


@serial()
def refraction_table(across, depths, thicknesses, indices, frame, out):
    """out[i, j] = what refraction adds to a path of depths[i] along the normal and across[j] along layers [m]."""
    for i in range(len(depths)):
        for j in range(len(across)):
            out[i, j] = _excess(across[j], depths[i], thicknesses, indices, frame)


@inline
def _excess(across, depth, thicknesses, indices, frame):
    bent = _refracted(across, depth + frame[3], thicknesses, indices)
    return bent - math.sqrt(across * across + depth * depth) - frame[4]


@inline
def _path(points, v, antennas, p, a, layers):
    dx, dy, dz = points[v, 0] - antennas[p, a, 0], points[v, 1] - antennas[p, a, 1], points[v, 2] - antennas[p, a, 2]
    way = _distance(dx, dy, dz)
    if layers is not None:
        thicknesses, indices, frame = layers
        depth = dx * frame[0] + dy * frame[1] + dz * frame[2]
        across = math.sqrt(max(way * way - depth * depth, 0.0))
        depth = max(depth, thicknesses.sum() - frame[3])
        way += _excess(across, depth, thicknesses, indices, frame)
    return way


@subroutine
def _beyond(x, y, z, ex, ey, ez, far, exact, out):
    """out[i] = |v_i - e| - |e| for voxels v and an antenna, or a sub-aperture's centre, e = (ex, ey, ez), |e| = far.

    All is float32. Further than `exact` off, the difference of two lengths would lose the phase: there it is
    v . (v - 2 e) / (|v - e| + |e|), whose error grows with |v| alone.
    """
    if far < exact:
        for i in range(len(x)):
            out[i] = _distance32(x[i] - ex, y[i] - ey, z[i] - ez) - far
    else:
        for i in range(len(x)):
            dx, dy, dz = x[i] - ex, y[i] - ey, z[i] - ez
            dot = x[i] * (dx - ex) + y[i] * (dy - ey) + z[i] * (dz - ez)
            out[i] = dot / (_distance32(dx, dy, dz) + far)


@subroutine
def bend(x, y, z, end, table, frame, out):
    """out[i] += what refraction adds to the path from voxel i to an antenna, from the table of an `Excess`; float32."""
    rows, columns = np.float32(table.shape[0] - 1), np.float32(table.shape[1] - 1)
    zero = np.float32(0)
    for i in range(len(x)):
        dx, dy, dz = x[i] - end[0], y[i] - end[1], z[i] - end[2]
        depth = dx * frame[0] + dy * frame[1] + dz * frame[2]
        across = np.sqrt(max(dx * dx + dy * dy + dz * dz - depth * depth, zero))
        row = min(max((depth - frame[3]) * frame[4], zero), rows)
        column = min(across * frame[5], columns)
        a, b = min(np.int32(row), table.shape[0] - 2), min(np.int32(column), table.shape[1] - 2)
        down, right = row - np.float32(a), column - np.float32(b)
        upper = table[a, b] + right * (table[a, b + 1] - table[a, b])
        lower = table[a + 1, b] + right * (table[a + 1, b + 1] - table[a + 1, b])
        out[i] += upper + down * (lower - upper)


@subroutine
def _gather(profiles, per_metre, carrier, tx, rx, table, frame, poses, x, y, z, removed, total_re, total_im):
    """total[v] += sum over `poses` and antennas of P(d) exp(+i 2 pi carrier (d - removed[v])), for one tile.

    Everything is float32; d counts from the path over the origin, whose place in the profile and whose phase the
    antennas' rows bring along. Three loops a channel rather than one: the first and the last become vector code,
    which the gathers in the middle would prevent. Those copy the real and imaginary parts of two entries at a time,
    which lie side by side. Rows of antennas are read number by number: slices count references, for which cores wait.
    """
    count = len(x)
    exact = np.float32(EXACT_CYCLES) / carrier
    to, back, path = np.empty(count, np.float32), np.empty(count, np.float32), np.empty(count, np.float32)
    part, entry = np.empty(count, np.float32), np.empty(count, np.int32)
    ends = np.empty(4 * count, np.float32)
    _, transmitters, receivers, entries = profiles.shape
    flat, last = profiles.reshape(-1), np.int32(entries // 2 - 2)
    for p in poses:
        for t in range(transmitters):
            _beyond(x, y, z, tx[p, t, 0], tx[p, t, 1], tx[p, t, 2], tx[p, t, 3], exact, to)
            if table is not None:
                bend(x, y, z, tx[p, t], table, frame, to)
            for r in range(receivers):
                _beyond(x, y, z, rx[p, r, 0], rx[p, r, 1], rx[p, r, 2], rx[p, r, 3], exact, back)
                if table is not None:
                    bend(x, y, z, rx[p, r], table, frame, back)
                start, turned = tx[p, t, 4] + rx[p, r, 4], tx[p, t, 5] + rx[p, r, 5]
                for i in range(count):
                    d = to[i] + back[i]
                    place = start + d * per_metre
                    path[i] = d - removed[i]
                    # Nothing outside of a profile is read, whatever the rounding.
                    entry[i] = min(max(np.int32(place), np.int32(0)), last)
                    part[i] = place - np.float32(entry[i])
                first = _U(((p * transmitters + t) * receivers + r) * entries)
                for i in range(count):
                    e, j = first + _U(2) * _U(entry[i]), _U(4) * _U(i)
                    low_re, low_im, high_re, high_im = flat[e], flat[e + _U(1)], flat[e + _U(2)], flat[e + _U(3)]
                    ends[j], ends[j + _U(1)], ends[j + _U(2)], ends[j + _U(3)] = low_re, low_im, high_re, high_im
                for i in range(count):
                    real = ends[4 * i] + part[i] * (ends[4 * i + 2] - ends[4 * i])
                    imag = ends[4 * i + 1] + part[i] * (ends[4 * i + 3] - ends[4 * i + 1])
                    turn = _wrapped(turned + path[i] * carrier)
                    cosine, sine = _cosine(turn), _sine(turn)
                    total_re[i] += real * cosine - imag * sine
                    total_im[i] += real * sine + imag * cosine


def _parts(profiles):
    """(P, T, R, 2 M) float32 of (P, T, R, M) complex64: real and imaginary parts in turn."""
    return np.ascontiguousarray(profiles).view(np.float32)


def backproject(profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sum_re, sum_im, excess=None):
    """sum[v] += sum over channels of P_k(d_k(v)) exp(+i 2 pi carrier d_k(v)) (primer 8).

    Parameters
    ----------
    profiles : (P, T, R, M) complex64, range profile of each channel less the carrier's phase
    nearest, per_metre : path length of entry 0 [m], one for all, or the parts of it that are the transmitters' (P, T)
        and the receivers' (P, R); entries per metre of path length
    carrier : centre frequency over c [1/m]
    tx, rx : (P, T, 3), (P, R, 3) [m]; as float64 where they are far off
    x, y, z : (V,) float32 voxel centres [m], counted from near their middle: lengths beyond it are float32
    sum_re, sum_im : (V,) float32, added to
    excess : what refraction adds, an `Excess` in the frame of the voxels; None: nothing
    """
    tx, rx = rows_of_pairs(tx, rx, nearest, per_metre, carrier)
    table, frame = (None, None) if excess is None else excess[:2]
    _backproject(
        _parts(profiles), np.float32(per_metre), np.float32(carrier), tx, rx, table, frame, x, y, z, sum_re, sum_im
    )


@kernel(fastmath=True, error_model="numpy")
def _backproject(profiles, per_metre, carrier, tx, rx, table, frame, x, y, z, sum_re, sum_im):
    poses = np.arange(len(profiles))
    for tile in prange((len(x) + _TILE - 1) // _TILE):
        first = tile * _TILE
        last = min(first + _TILE, len(x))
        total_re, total_im = np.zeros(_TILE, np.float32), np.zeros(_TILE, np.float32)
        _gather(
            profiles, per_metre, carrier, tx, rx, table, frame, poses, x[first:last], y[first:last], z[first:last],
            np.zeros(_TILE, np.float32), total_re, total_im,
        )  # fmt: skip
        for i in range(last - first):
            sum_re[first + i] += total_re[i]
            sum_im[first + i] += total_im[i]


def leaf_fields(profiles, per_metre, carrier, tx, rx, members, starts, centers, x, y, z, out_re, out_im, excess=None):
    """The field of each smallest sub-aperture on its coarse grid, less the phase of its centre (primer 16).

    out[s, v] = sum over the channels of poses members[starts[s]:starts[s + 1]] of
    P(d) exp(+i 2 pi carrier (d - 2 (|v - c_s| - |c_s|))), over the grid's points v = (x, y, z)[v], as they lie in
    memory. tx, rx and the centres (S, 6) are rows of `antenna_rows`; `excess` as of `backproject`.
    """
    bent = (None, None) if excess is None else excess[:2]
    _leaf_fields(_parts(profiles), per_metre, carrier, tx, rx, *bent, members, starts, centers, x, y, z, out_re, out_im)


@kernel(fastmath=True, error_model="numpy")
def _leaf_fields(profiles, per_metre, carrier, tx, rx, table, frame, members, starts, centers, x, y, z, out_re, out_im):
    tiles = (len(x) + _TILE - 1) // _TILE
    exact = np.float32(EXACT_CYCLES) / carrier
    for job in prange((len(starts) - 1) * tiles):
        s, first = job // tiles, (job % tiles) * _TILE
        last = min(first + _TILE, len(x))
        vx, vy, vz = x[first:last], y[first:last], z[first:last]
        removed = np.empty(_TILE, np.float32)
        _beyond(vx, vy, vz, centers[s, 0], centers[s, 1], centers[s, 2], centers[s, 3], exact, removed)
        for i in range(last - first):
            removed[i] *= np.float32(2.0)
        total_re, total_im = np.zeros(_TILE, np.float32), np.zeros(_TILE, np.float32)
        _gather(
            profiles, per_metre, carrier, tx, rx, table, frame, members[starts[s] : starts[s + 1]], vx, vy, vz,
            removed, total_re, total_im,
        )  # fmt: skip
        out_re[s, first:last] = total_re[: last - first]
        out_im[s, first:last] = total_im[: last - first]


@serial()
def interpolation_errors(points, tx, rx, centers, waves, carrier, axis, coarse, base, weights, squares):
    """squares[i] = |sum over eight taps of weights[i, t] w(x_t) / w(x) - 1|^2 in float64 for the field of one channel,
    w(x) = exp(+i 2 pi (waves[i] (|x - tx[i]| + |x - rx[i]|) - carrier 2 |x - centers[i]|)), at x = points[i].

    The taps lie on the line through points[i] along `axis`, at coarse[base[i]:base[i] + 8]. It is too little work for
    threads to meet over.
    """
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        here = _turns(x, y, z, tx[i], rx[i], centers[i], waves[i], carrier)
        re, im = -1.0, 0.0
        for t in range(8):
            place = coarse[base[i] + t]
            if axis == 0:
                turns = _turns(place, y, z, tx[i], rx[i], centers[i], waves[i], carrier)
            else:
                turns = _turns(x, place, z, tx[i], rx[i], centers[i], waves[i], carrier)
            angle = phase.TAU * (turns - here)
            re += weights[i, t] * math.cos(angle)
            im += weights[i, t] * math.sin(angle)
        squares[i] = re * re + im * im


@inline
def _turns(x, y, z, tx, rx, center, cycles, carrier):
    path = _distance(x - tx[0], y - tx[1], z - tx[2]) + _distance(x - rx[0], y - rx[1], z - rx[2])
    return cycles * path - 2.0 * carrier * _distance(x - center[0], y - center[1], z - center[2])
