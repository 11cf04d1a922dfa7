"""The simulator's inner loops on a GPU: the functions of `_kernels` under the same names, for NumPy or device arrays.

The CPU finds the vertices' weights, with rays; the GPU sums their signals and writes frames. A thread has one channel
and node of the half band: it counts phases in float64, wraps them and adds up in float32. A warp is at a few channels,
so vertices in the dark cost it one read. Each of some 13 nodes counts the same phases: that is less than to write them
to memory, and nothing beside the memory's allocation.
"""

import numpy as np

from millisight.core.gpu import (
    cosine,
    cuda,
    distance,
    empty,
    kernel,
    launch,
    product,
    sine,
    to_device,
    to_host,
    wrapped,
)

__all__ = ["node_signals", "write_frames"]


@kernel(fastmath=True)
def _node_sums(weights, tx, rx, vertices, reflections, spread, center, path_offset, carrier, half_band, nodes, out):
    q = cuda.grid(1)
    count = nodes.shape[0]
    if q >= weights.shape[0] * count:
        return
    c, n = q // count, q % count
    node = nodes[n]
    tx0, tx1, tx2 = tx[c, 0], tx[c, 1], tx[c, 2]
    rx0, rx1, rx2 = rx[c, 0], rx[c, 1], rx[c, 2]
    d_c = distance(center[0] - tx0, center[1] - tx1, center[2] - tx2)
    d_c += distance(center[0] - rx0, center[1] - rx1, center[2] - rx2)
    even_re, even_im, odd_re, odd_im = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for v in range(weights.shape[1]):
        if weights[c, v]:
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            d = distance(x - tx0, y - tx1, z - tx2) + distance(x - rx0, y - rx1, z - rx2)
            amplitude = np.float32(weights[c, v] / d if spread else weights[c, v] * 1.0)
            turn = np.float32(wrapped(carrier * (d + path_offset)))
            cos, sin = cosine(turn), sine(turn)
            a, b = amplitude * reflections[v].real, amplitude * reflections[v].imag
            # a (cos - i sin): the sign of primer (3)
            re, im = a * cos + b * sin, b * cos - a * sin
            turn = wrapped(np.float32(half_band * (d - d_c)) * node)
            cos, sin = cosine(turn), sine(turn)
            even_re += re * cos
            even_im += im * cos
            odd_re += re * sin
            odd_im += im * sin
    out[c, 0, n] = complex(even_re, even_im)
    out[c, 1, n] = complex(odd_re, odd_im)


@kernel(fastmath=True)
def _samples(parts, tx, rx, center, path_offset, offsets, out):
    j = cuda.grid(1)
    if j >= offsets.shape[0]:
        return
    for c in range(cuda.blockIdx.y, out.shape[0], cuda.gridDim.y):
        d_c = distance(center[0] - tx[c, 0], center[1] - tx[c, 1], center[2] - tx[c, 2])
        d_c += distance(center[0] - rx[c, 0], center[1] - rx[c, 1], center[2] - rx[c, 2])
        turn = np.float32(wrapped(offsets[j] * (d_c + path_offset)))
        cos, sin = cosine(turn), sine(turn)
        a, b = parts[c, 0, j], parts[c, 1, offsets.shape[0] + j]
        even_re, even_im = a.real * cos - b.real * sin, a.imag * cos - b.imag * sin
        odd_re, odd_im = a.real * sin + b.real * cos, a.imag * sin + b.imag * cos
        out[c, j] = complex(even_re - odd_im, even_im + odd_re)
        out[c, out.shape[1] - 1 - j] = complex(even_re + odd_im, even_im - odd_re)


def node_signals(weights, tx, rx, vertices, reflections, spread, center, path_offset, carrier, half_band, nodes, out):
    """See `_kernels.node_signals`."""
    # Small blocks, for all multiprocessors to have some.
    launch(
        _node_sums, (weights.shape[0] * nodes.shape[0], 1), weights, tx, rx, vertices,
        np.asarray(reflections, np.complex64), bool(spread), center, float(path_offset), float(carrier),
        float(half_band), np.asarray(nodes, np.float32), out=(out,), threads=64,
    )  # fmt: skip


def write_frames(signals, interpolation, tx, rx, center, path_offset, offsets, rows, frames):
    """See `_kernels.write_frames`; `signals` may lie on the GPU, `frames` is a NumPy array."""
    channels, _, count = signals.shape
    # One product of both parts with both matrices, of which half is used, spares copies of either part.
    parts = product(to_device(signals).reshape(2 * channels, count), np.hstack(interpolation).astype(np.complex64))
    samples = empty((channels, frames.shape[1]), np.complex64)
    launch(
        _samples, (len(offsets), channels), parts.reshape(channels, 2, 2 * len(offsets)), tx, rx, center,
        float(path_offset), offsets, out=(samples,),
    )  # fmt: skip
    frames[rows] = to_host(samples)
