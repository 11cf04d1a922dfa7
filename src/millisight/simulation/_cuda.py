"""The simulator's inner loops on a GPU: the functions of `_kernels` under the same names, for NumPy or device arrays.

The CPU finds the vertices' weights, with rays; the GPU sums their signals and restores their delay. A thread has one
channel and node of the band: it counts phases in float64, wraps them and adds up in float32. A warp is at one or two
channels, so vertices in the dark cost it one read. Each of some 25 nodes counts the same phases: that is less than to
write them to memory, and nothing beside the memory's allocation.
"""

import numpy as np

from millisight.core.gpu import (
    cosine,
    cuda,
    distance,
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
    total_re, total_im = np.float32(0.0), np.float32(0.0)
    for v in range(weights.shape[1]):
        if weights[c, v]:
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            d = distance(x - tx0, y - tx1, z - tx2) + distance(x - rx0, y - rx1, z - rx2)
            amplitude = np.float32(weights[c, v] / d if spread else weights[c, v] * 1.0)
            base, slope = np.float32(wrapped(carrier * (d + path_offset))), np.float32(half_band * (d - d_c))
            turn = wrapped(base + slope * node)
            cos, sin = cosine(turn), sine(turn)
            re, im = amplitude * reflections[v].real, amplitude * reflections[v].imag
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
    """See `_kernels.node_signals`."""
    # Small blocks, for all multiprocessors to have some.
    launch(
        _node_sums, (weights.shape[0] * nodes.shape[0], 1), weights, tx, rx, vertices,
        np.asarray(reflections, np.complex64), bool(spread), center, float(path_offset), float(carrier),
        float(half_band), np.asarray(nodes, np.float32), out=(out,), threads=64,
    )  # fmt: skip


def restore_delay(signals, tx, rx, center, path_offset, start, step, rows, frames):
    """See `_kernels.restore_delay`; `signals` may lie on the GPU, and is then written to, `frames` is a NumPy array."""
    signals = to_device(signals)
    launch(
        _restore_delay, (signals.shape[1], signals.shape[0]), tx, rx, center, float(path_offset), float(start),
        float(step), out=(signals,),
    )  # fmt: skip
    frames[rows] = to_host(signals)
