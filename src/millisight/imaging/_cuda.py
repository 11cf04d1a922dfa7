"""The imagers' inner loops on a GPU: the functions of `_kernels` under the same names, for NumPy or device arrays.

One thread has a few voxels and loops over the channels, so that a voxel's sum has one order. All threads of a warp are
at the same channel: the antennas' coordinates are one read for all 32, and good for a thread's voxels; voxels side by
side read entries of the range profile side by side. Both come out of the first-level cache, and nothing is gained by
staging them.

Floor of direct backprojection: PAIR_INSTRUCTIONS for each voxel-channel pair, as counted in the machine code for
compute capability 9.0: 269 for a receiver and four voxels, which is 67 a pair, and 128 for a transmitter with four
receivers, which is 8. A Hopper multiprocessor issues 128 a clock, so that 132 of them at 1.98 GHz come to 4.5e11 pairs
a second. Next are the reads (5.5 of 32 a clock).
"""

import math

import numpy as np

from millisight.core.gpu import (
    cosine,
    cuda,
    distance32,
    empty,
    inline,
    kernel,
    launch,
    product,
    sine,
    to_device,
    to_host,
    wrapped,
    zeros,
)
from millisight.imaging._lengths import EXACT_CYCLES, rows_of_pairs
from millisight.imaging._taps import as_it_is

__all__ = [
    "backproject", "compress", "empty", "leaf_fields", "merge", "steering", "to_device", "to_host", "zeros",
]  # fmt: skip

PAIR_INSTRUCTIONS = 75
"""Instructions that a thread issues for one voxel-channel pair of direct backprojection: see the module's text."""

_STRAIGHT = np.zeros(1, np.float32)  # for the table of paths that are not bent

_VOXELS = 4  # of one thread: what it reads of an antenna, and what it counts, are good for all of them

# Poses that are summed by themselves before they are added to the whole sum, against float32's rounding.
_CHUNK = 64


def steering(turns, matrix):
    """turns[:, None] * matrix, turns (N,), matrix (N, M), as `compress` takes it."""
    return to_device((turns[:, None] * matrix).astype(np.complex64))


def compress(frames, by, out=None):
    """(..., M) complex64 range profiles of frames (..., N), by a `steering`; in `out`, on the host, if given."""
    profiles = product(frames, by)
    if out is None:
        return profiles
    out[...] = to_host(profiles)
    return out


def _beyond(x, y, z, end, exact):
    """|v - e| - |e| for a voxel v and `end`, a row (6,) of `antenna_rows`: see `_kernels`."""
    ex, ey, ez, far = end[0], end[1], end[2], end[3]
    dx, dy, dz = x - ex, y - ey, z - ez
    away = np.float32(distance32(dx, dy, dz))
    if far < exact:
        return away - far
    return (x * (dx - ex) + y * (dy - ey) + z * (dz - ez)) / (away + far)


_beyond = inline(_beyond, fastmath=True)


def _bent(x, y, z, end, table, frame):
    """What refraction adds to the path from a voxel to an antenna, from the table of an `Excess`; float32."""
    dx, dy, dz = x - end[0], y - end[1], z - end[2]
    depth = dx * frame[0] + dy * frame[1] + dz * frame[2]
    zero = np.float32(0.0)
    across = np.float32(math.sqrt(max(dx * dx + dy * dy + dz * dz - depth * depth, zero)))
    row = min(max((depth - frame[3]) * frame[4], zero), np.float32(table.shape[0] - 1))
    column = min(across * frame[5], np.float32(table.shape[1] - 1))
    a, b = min(int(row), table.shape[0] - 2), min(int(column), table.shape[1] - 2)
    down, right = row - np.float32(a), column - np.float32(b)
    upper = table[a, b] + right * (table[a, b + 1] - table[a, b])
    lower = table[a + 1, b] + right * (table[a + 1, b + 1] - table[a + 1, b])
    return upper + down * (lower - upper)


_bent = inline(_bent, fastmath=True)


def _add_pose(profiles, p, per_metre, carrier, exact, tx, rx, table, frame, x, y, z, removed, to, re, im):
    """Add to each of _VOXELS voxels the sum over the antennas of pose p of P(d) exp(+i 2 pi carrier (d - removed)).

    All arrays of voxels are a thread's own, of float32; `to` is overwritten.
    """
    zero, last = np.float32(0.0), np.float32(profiles.shape[3] - 2)
    # Unsigned: a signed index would be checked for counting from the end, at every read.
    for t in range(np.uint64(tx.shape[1])):
        begin = tx[p, t]
        for i in range(_VOXELS):
            to[i] = _beyond(x[i], y[i], z[i], begin, exact)
            if table.ndim == 2:
                to[i] += _bent(x[i], y[i], z[i], begin, table, frame)
        for r in range(np.uint64(rx.shape[1])):
            profile, end = profiles[p, t, r], rx[p, r]
            start, turns = begin[4] + end[4], begin[5] + end[5]
            for i in range(_VOXELS):
                d = to[i] + _beyond(x[i], y[i], z[i], end, exact)
                if table.ndim == 2:
                    d += _bent(x[i], y[i], z[i], end, table, frame)
                place = start + d * per_metre
                # Nothing outside of a profile is read, whatever the rounding.
                entry = np.uint32(min(max(place, zero), last))
                part = place - np.float32(entry)
                low, high = profile[entry], profile[entry + np.uint32(1)]
                real = low.real + part * (high.real - low.real)
                imag = low.imag + part * (high.imag - low.imag)
                turn = wrapped(turns + (d - removed[i]) * carrier)
                cos, sin = cosine(turn), sine(turn)
                re[i] = re[i] + real * cos - imag * sin
                im[i] = im[i] + real * sin + imag * cos


_add_pose = inline(_add_pose, fastmath=True)


@kernel(fastmath=True)
def _backproject(profiles, per_metre, carrier, exact, tx, rx, table, frame, x, y, z, sum_re, sum_im):
    v, step = np.uint32(cuda.grid(1)), np.uint32((x.shape[0] + _VOXELS - 1) // _VOXELS)
    if v >= step:
        return
    vx, vy, vz = (cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32),
                  cuda.local.array(_VOXELS, np.float32))  # fmt: skip
    removed, to = cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32)
    part_re, part_im = cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32)
    total_re, total_im = cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32)
    zero = np.float32(0.0)
    for i in range(_VOXELS):
        # Voxels beyond the last are the last once more, and not kept.
        u = min(v + np.uint32(i) * step, np.uint32(x.shape[0] - 1))
        vx[i], vy[i], vz[i] = x[u], y[u], z[u]
        removed[i] = total_re[i] = total_im[i] = zero
    poses, chunk = np.uint64(profiles.shape[0]), np.uint64(_CHUNK)
    for first in range(np.uint64(0), poses, chunk):
        for i in range(_VOXELS):
            part_re[i] = part_im[i] = zero
        for p in range(first, min(first + chunk, poses)):
            _add_pose(
                profiles, p, per_metre, carrier, exact, tx, rx, table, frame, vx, vy, vz, removed, to, part_re, part_im
            )  # fmt: skip
        for i in range(_VOXELS):
            total_re[i] += part_re[i]
            total_im[i] += part_im[i]
    for i in range(_VOXELS):
        u = v + np.uint32(i) * step
        if u < x.shape[0]:
            sum_re[u] += total_re[i]
            sum_im[u] += total_im[i]


@kernel(fastmath=True)
def _leaf_fields(
    profiles, per_metre, carrier, exact, tx, rx, table, frame, members, starts, centers, x, y, z, out_re, out_im
):
    v, step = np.uint32(cuda.grid(1)), np.uint32((x.shape[0] + _VOXELS - 1) // _VOXELS)
    if v >= step:
        return
    vx, vy, vz = (cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32),
                  cuda.local.array(_VOXELS, np.float32))  # fmt: skip
    removed, to = cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32)
    total_re, total_im = cuda.local.array(_VOXELS, np.float32), cuda.local.array(_VOXELS, np.float32)
    for i in range(_VOXELS):
        u = min(v + np.uint32(i) * step, np.uint32(x.shape[0] - 1))
        vx[i], vy[i], vz[i] = x[u], y[u], z[u]
    for s in range(cuda.blockIdx.y, starts.shape[0] - 1, cuda.gridDim.y):
        for i in range(_VOXELS):
            removed[i] = np.float32(2.0) * _beyond(vx[i], vy[i], vz[i], centers[s], exact)
            total_re[i] = total_im[i] = np.float32(0.0)
        for n in range(np.uint64(starts[s]), np.uint64(starts[s + 1])):
            _add_pose(
                profiles, np.uint64(members[n]), per_metre, carrier, exact, tx, rx, table, frame,
                vx, vy, vz, removed, to, total_re, total_im,
            )  # fmt: skip
        for i in range(_VOXELS):
            u = v + np.uint32(i) * step
            if u < x.shape[0]:
                out_re[s, u] = total_re[i]
                out_im[s, u] = total_im[i]


@kernel(fastmath=True)
def _interpolate_middle(field, base, weights, out):
    q = cuda.grid(1)
    rows, columns, depth = out.shape[1], out.shape[2], out.shape[3]
    if q >= columns * depth:
        return
    j, k = q // depth, q % depth
    first = base[j]
    for job in range(cuda.blockIdx.y, out.shape[0] * rows, cuda.gridDim.y):
        f, i = job // rows, job % rows
        total = np.float32(0.0)
        for tap in range(8):
            total += weights[j, tap] * field[f, i, first + tap, k]
        out[f, i, j, k] = total


@kernel(fastmath=True)
def _merge(
    field_re,
    field_im,
    children,
    starts,
    centers,
    parents,
    has_parents,
    carrier,
    exact,
    base,
    weights,
    x,
    y,
    z,
    out_re,
    out_im,
):
    q = cuda.grid(1)
    rows, depth = x.shape[0], z.shape[0]
    if q >= y.shape[0] * depth:
        return
    j, k = q // depth, q % depth
    vy, vz = y[j], z[k]
    twice = np.float32(2.0) * carrier
    for job in range(cuda.blockIdx.y, (starts.shape[0] - 1) * rows, cuda.gridDim.y):
        s, i = job // rows, job % rows
        vx, first = x[i], base[i]
        removed = np.float32(0.0)
        if has_parents:
            removed = _beyond(vx, vy, vz, parents[s], exact)
        total_re, total_im = np.float32(0.0), np.float32(0.0)
        for n in range(starts[s], starts[s + 1]):
            child = children[n]
            re, im = np.float32(0.0), np.float32(0.0)
            for tap in range(8):
                re += weights[i, tap] * field_re[child, first + tap, j, k]
                im += weights[i, tap] * field_im[child, first + tap, j, k]
            turn = wrapped((_beyond(vx, vy, vz, centers[child], exact) - removed) * twice)
            cos, sin = cosine(turn), sine(turn)
            total_re += re * cos - im * sin
            total_im += re * sin + im * cos
        if has_parents:
            out_re[s, i, j, k] = total_re
            out_im[s, i, j, k] = total_im
        else:
            out_re[s, i, j, k] += total_re
            out_im[s, i, j, k] += total_im


def _threads_for(voxels):
    return -(-voxels.shape[0] // _VOXELS)


def _exact_within(carrier):
    """Distance [m] up to which the difference of two float32 lengths keeps the phase."""
    return np.float32(EXACT_CYCLES / float(carrier))


def backproject(profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sum_re, sum_im, excess=None):
    """See `_kernels.backproject`."""
    tx, rx = rows_of_pairs(tx, rx, nearest, per_metre, carrier)
    launch(
        _backproject, (_threads_for(x), 1), profiles, np.float32(per_metre), np.float32(carrier),
        _exact_within(carrier), tx, rx, *_tables(excess), x, y, z, out=(sum_re, sum_im),
    )  # fmt: skip


def leaf_fields(profiles, per_metre, carrier, tx, rx, members, starts, centers, x, y, z, out_re, out_im, excess=None):
    """See `_kernels.leaf_fields`."""
    launch(
        _leaf_fields, (_threads_for(x), starts.shape[0] - 1), profiles, per_metre, carrier, _exact_within(carrier), tx,
        rx, *_tables(excess), members, starts, centers, x, y, z, out=(out_re, out_im),
    )  # fmt: skip


def _tables(excess):
    """The arrays of an `Excess`; without one, others of a number of axes for which a kernel of its own is compiled.

    Kernels take no None. What depends on a number of axes is decided as they are compiled.
    """
    return (_STRAIGHT, _STRAIGHT) if excess is None else tuple(excess[:2])


def merge(fields, children, starts, centers, parents, has_parents, carrier, along, across, x, y, z, out):
    """See `_kernels.merge`."""
    wide, (_, count, rows, _, depth), columns = fields, fields.shape, y.shape[0]
    if across is not None:
        wide = empty((2, count, rows, columns, depth))
        for part in (0, 1):
            launch(_interpolate_middle, (columns * depth, count * rows), fields[part], *across, out=(wide[part],))
    base, weights = along or as_it_is(x.shape[0])
    launch(
        _merge, (columns * depth, (starts.shape[0] - 1) * x.shape[0]),
        wide[0], wide[1], children, starts, centers, parents, has_parents, carrier, _exact_within(carrier),
        base, weights, x, y, z, out=(out[0], out[1]),
    )  # fmt: skip
