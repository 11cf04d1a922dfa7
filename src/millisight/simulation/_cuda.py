"""The simulator's inner loops on a GPU: the functions of `_kernels` under the same names, for NumPy or device arrays.

The CPU finds the vertices' weights, with rays; the GPU sums their signals and restores their delay. The sum has
two steps: a thread a vertex and channel counts phases in float64 and wraps them, then a thread a channel and node of
the band adds up in float32. A warp is at one or two channels, so vertices in the dark cost it one read.
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

__all__ = ["node_signals", "product", "restore_delay"]


@kernel(fastmath=True)
def _phases(weights, tx, rx, vertices, center, path_offset, carrier, half_band, spread, base, slope, gain):
    v = cuda.grid(1)
    if v >= vertices.shape[0]:
        return
    x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
    for c in range(cuda.blockIdx.y, tx.shape[0], cuda.gridDim.y):
        if weights[c, v]:
            d = distance(x - tx[c, 0], y - tx[c, 1], z - tx[c, 2])
            d += distance(x - rx[c, 0], y - rx[c, 1], z - rx[c, 2])
            d_c = distance(center[0] - tx[c, 0], center[1] - tx[c, 1], center[2] - tx[c, 2])
            d_c += distance(center[0] - rx[c, 0], center[1] - rx[c, 1], center[2] - rx[c, 2])
            base[c, v] = wrapped(carrier * (d + path_offset))
            slope[c, v] = half_band * (d - d_c)
            gain[c, v] = weights[c, v] / d if spread else weights[c, v] * 1.0


@kernel(fastmath=True)
def _node_sums(weights, reflections, nodes, base, slope, gain, out):
    q = cuda.grid(1)
    count = nodes.shape[0]
    if q >= weights.shape[0] * count:
        return
    c, n = q // count, q % count
    node = nodes[n]
    total_re, total_im = np.float32(0.0), np.float32(0.0)
    for v in range(weights.shape[1]):
        if weights[c, v]:
            turn = wrapped(base[c, v] + slope[c, v] * node)
            cos, sin = cosine(turn), sine(turn)
            re, im = gain[c, v] * reflections[v].real, gain[c, v] * reflections[v].imag
            # a (cos - i sin): the sign of primer (3)
            total_re += re * cos + im * sin
            total_im += im * cos - re * sin
    out[c, n] = complex(total_re, total_im)


@kernel(fastmath=True)
def _restore_delay(tx, rx, center, path_offset, start, step, signals):
    j = cuda.grid(1)
    if j >= signals.shape[1]:
        return
    for c in range(cuda.blockIdx.y, signals.shape[0], cuda.gridDim.y):
        d_c = distance(center[0] - tx[c, 0], center[1] - tx[c, 1], center[2] - tx[c, 2])
        d_c += distance(center[0] - rx[c, 0], center[1] - rx[c, 1], center[2] - rx[c, 2])
        turn = np.float32(wrapped((start + j * step) * (d_c + path_offset)))
        cos, sin = cosine(turn), sine(turn)
        re, im = signals[c, j].real, signals[c, j].imag
        signals[c, j] = complex(re * cos + im * sin, im * cos - re * sin)


def node_signals(weights, tx, rx, vertices, reflections, spread, center, path_offset, carrier, half_band, nodes, out):
    """See `_kernels.node_signals`. Device memory: 12 bytes a vertex and channel, besides the arguments."""
    weights, tx, rx, vertices = to_device(weights), to_device(tx), to_device(rx), to_device(vertices)
    reflections, nodes = to_device(np.asarray(reflections, np.complex64)), to_device(np.asarray(nodes, np.float32))
    base, slope, gain = empty(weights.shape), empty(weights.shape), empty(weights.shape)
    launch(
        _phases, (weights.shape[1], weights.shape[0]), weights, tx, rx, vertices, center, float(path_offset),
        float(carrier), float(half_band), bool(spread), base, slope, gain,
    )  # fmt: skip
    # Small blocks, for all multiprocessors to have some.
    size = (weights.shape[0] * nodes.shape[0], 1)
    launch(_node_sums, size, weights, reflections, nodes, base, slope, gain, out=(out,), threads=64)


def restore_delay(signals, tx, rx, center, path_offset, start, step, rows, frames):
    """See `_kernels.restore_delay`; `signals` may lie on the GPU, and is then written to, `frames` is a NumPy array."""
    signals = to_device(signals)
    launch(
        _restore_delay, (signals.shape[1], signals.shape[0]), tx, rx, center, float(path_offset), float(start),
        float(step), out=(signals,),
    )  # fmt: skip
    frames[rows] = to_host(signals)
