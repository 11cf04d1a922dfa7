"""The imagers' inner loops on a GPU: the functions of `_kernels` under the same names, for NumPy or device arrays.

One thread has one voxel and loops over the channels, so that a voxel's sum has one order. All threads of a warp are
at the same channel: the antennas' coordinates are one read for all 32, and voxels side by side read entries of the
range profile side by side; both come out of the first-level cache, and nothing is gained by staging them.

Floor of direct backprojection, per voxel-channel pair with 4 RX a TX, in instructions of a thread:

    to TX        a quarter of 6 reads, 7 arithmetic, 1 square root, 1 comparison
    to RX        6 reads, 7 arithmetic, 1 square root, 1 comparison, 1 sum
    profile      2 place, 2 kept inside, 1 entry and 1 back to float, 1 part, 1 address, 4 reads, 4 interpolation
    phase        1 sum, 1 product and sum, 1 floor, 1 difference, 12 sine and cosine
    sum          4 products and sums fused

that is 56: PAIR_INSTRUCTIONS. A Hopper multiprocessor issues 128 a clock, so that 132 of them at 1.755 GHz come to
5.3e11 pairs a second. Next are the reads (11.5 of 32 a clock: 6.4e11), then the conversions and roots (4 1/4 of 16 a
clock: 8.7e11). Sine and cosine by the special-function units would spare 9 instructions and cost 2 more of these 16.
Antennas more than EXACT_CYCLES waves off cost six instructions and a division more each.
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
    "backproject", "empty", "leaf_fields", "merge", "product", "to_device", "to_host", "zeros",
]  # fmt: skip

PAIR_INSTRUCTIONS = 56
"""Instructions a thread must issue for one voxel-channel pair of direct backprojection: see the module's text."""

# Poses that are summed by themselves before they are added to the whole sum, against float32's rounding.
_CHUNK = 64


def _beyond(x, y, z, ends, i, exact):
    """|v - e| - |e| for a voxel v and row i of `ends`, (n, 6) rows of `antenna_rows`: see `_kernels`."""
    ex, ey, ez, far = ends[i, 0], ends[i, 1], ends[i, 2], ends[i, 3]
    dx, dy, dz = x - ex, y - ey, z - ez
    away = np.float32(distance32(dx, dy, dz))
    if far < exact:
        return away - far
    return (x * (dx - ex) + y * (dy - ey) + z * (dz - ez)) / (away + far)


_beyond = inline(_beyond, fastmath=True)


def _bent(x, y, z, ends, i, table, frame):
    """What refraction adds to the path from a voxel to an antenna, from the table of an `Excess`; float32."""
    dx, dy, dz = x - ends[i, 0], y - ends[i, 1], z - ends[i, 2]
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


def _pose(profiles, p, per_metre, carrier, exact, tx, rx, table, frame, x, y, z, removed):
    """Sum over the antennas of pose p of P(d) exp(+i 2 pi carrier (d - removed)) at one voxel; float32."""
    total_re, total_im = np.float32(0.0), np.float32(0.0)
    last = np.float32(profiles.shape[3] - 2)
    for t in range(tx.shape[1]):
        to = _beyond(x, y, z, tx[p], t, exact)
        if table is not None:
            to += _bent(x, y, z, tx[p], t, table, frame)
        for r in range(rx.shape[1]):
            d = to + _beyond(x, y, z, rx[p], r, exact)
            if table is not None:
                d += _bent(x, y, z, rx[p], r, table, frame)
            place = tx[p, t, 4] + rx[p, r, 4] + d * per_metre
            # Nothing outside of a profile is read, whatever the rounding. Unsigned: a signed index would be checked
            # for counting from the end, at every read.
            entry = np.uint32(min(max(place, np.float32(0.0)), last))
            part = place - np.float32(entry)
            low, high = profiles[p, t, r, entry], profiles[p, t, r, entry + np.uint32(1)]
            real = low.real + part * (high.real - low.real)
            imag = low.imag + part * (high.imag - low.imag)
            turn = wrapped(tx[p, t, 5] + rx[p, r, 5] + (d - removed) * carrier)
            cos, sin = cosine(turn), sine(turn)
            total_re = total_re + real * cos - imag * sin
            total_im = total_im + real * sin + imag * cos
    return total_re, total_im


_pose = inline(_pose, fastmath=True)


@kernel(fastmath=True)
def _backproject(profiles, per_metre, carrier, exact, tx, rx, table, frame, x, y, z, sum_re, sum_im):
    v = cuda.grid(1)
    if v >= x.shape[0]:
        return
    vx, vy, vz = x[v], y[v], z[v]
    total_re, total_im = np.float32(0.0), np.float32(0.0)
    for first in range(0, profiles.shape[0], _CHUNK):
        part_re, part_im = np.float32(0.0), np.float32(0.0)
        for p in range(first, min(first + _CHUNK, profiles.shape[0])):
            re, im = _pose(profiles, p, per_metre, carrier, exact, tx, rx, table, frame, vx, vy, vz, np.float32(0.0))
            part_re += re
            part_im += im
        total_re += part_re
        total_im += part_im
    sum_re[v] += total_re
    sum_im[v] += total_im


@kernel(fastmath=True)
def _leaf_fields(
    profiles, per_metre, carrier, exact, tx, rx, table, frame, members, starts, centers, x, y, z, out_re, out_im
):
    v = cuda.grid(1)
    if v >= x.shape[0]:
        return
    vx, vy, vz = x[v], y[v], z[v]
    for s in range(cuda.blockIdx.y, starts.shape[0] - 1, cuda.gridDim.y):
        removed = np.float32(2.0) * _beyond(vx, vy, vz, centers, s, exact)
        total_re, total_im = np.float32(0.0), np.float32(0.0)
        for n in range(starts[s], starts[s + 1]):
            re, im = _pose(profiles, members[n], per_metre, carrier, exact, tx, rx, table, frame, vx, vy, vz, removed)
            total_re += re
            total_im += im
        out_re[s, v] = total_re
        out_im[s, v] = total_im


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
            removed = _beyond(vx, vy, vz, parents, s, exact)
        total_re, total_im = np.float32(0.0), np.float32(0.0)
        for n in range(starts[s], starts[s + 1]):
            child = children[n]
            re, im = np.float32(0.0), np.float32(0.0)
            for tap in range(8):
                re += weights[i, tap] * field_re[child, first + tap, j, k]
                im += weights[i, tap] * field_im[child, first + tap, j, k]
            turn = wrapped((_beyond(vx, vy, vz, centers, child, exact) - removed) * twice)
            cos, sin = cosine(turn), sine(turn)
            total_re += re * cos - im * sin
            total_im += re * sin + im * cos
        if has_parents:
            out_re[s, i, j, k] = total_re
            out_im[s, i, j, k] = total_im
        else:
            out_re[s, i, j, k] += total_re
            out_im[s, i, j, k] += total_im


def _exact_within(carrier):
    """Distance [m] up to which the difference of two float32 lengths keeps the phase."""
    return np.float32(EXACT_CYCLES / float(carrier))


def backproject(profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sum_re, sum_im, excess=None):
    """See `_kernels.backproject`."""
    tx, rx = rows_of_pairs(tx, rx, nearest, per_metre, carrier)
    launch(
        _backproject, (x.shape[0], 1), profiles, np.float32(per_metre), np.float32(carrier), _exact_within(carrier),
        tx, rx, *_tables(excess), x, y, z, out=(sum_re, sum_im),
    )  # fmt: skip


def leaf_fields(profiles, per_metre, carrier, tx, rx, members, starts, centers, x, y, z, out_re, out_im, excess=None):
    """See `_kernels.leaf_fields`."""
    launch(
        _leaf_fields, (x.shape[0], starts.shape[0] - 1), profiles, per_metre, carrier, _exact_within(carrier),
        tx, rx, *_tables(excess), members, starts, centers, x, y, z, out=(out_re, out_im),
    )  # fmt: skip


def _tables(excess):
    """The arrays of an `Excess`; None twice, for which a kernel of its own is compiled, without refraction."""
    return (None, None) if excess is None else tuple(excess[:2])


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
