"""What the kernels of all layers need on a GPU: to be compiled and launched, arrays there, and a matrix product.

Imports numba-cuda: only modules that run on a GPU import this one, after `device.check_device`.
"""

import importlib
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from millisight.core import phase

# An optional package, of which type checkers know nothing where it is missing and the wrong things where it is there.
cuda: Any = importlib.import_module("numba.cuda")

THREADS = 256
"""Threads a block: eight warps, of which an H100's multiprocessor holds four to eight blocks at our registers."""

_HIGHEST_Y = 65535  # blocks of a grid along y; kernels stride over what is beyond


def kernel(**options: Any) -> Callable[[Callable], Any]:
    """Compile a function for one thread of many, and keep the machine code for the next process."""

    def compile_lazily(function: Callable) -> Any:
        try:
            return cuda.jit(cache=True, **options)(function)
        except RuntimeError:
            # Neither the package's folder nor the user's cache can be written to: compile in every process.
            return cuda.jit(**options)(function)

    return compile_lazily


def inline(function: Callable, **options: Any) -> Any:
    """Compile a scalar function into its callers, as small device functions always are."""
    return cuda.jit(device=True, **options)(function)


def _wrapped(cycles: Any) -> Any:
    """As `phase.wrapped`, which uses np.rint: numba-cuda has none, but its math.floor stays in float32."""
    return cycles - math.floor(cycles + np.float32(0.5))


distance: Any = inline(phase.distance)
distance32: Any = inline(phase.distance, fastmath=True)
wrapped: Any = inline(_wrapped, fastmath=True)
cosine: Any = inline(phase.cosine, fastmath=True)
sine: Any = inline(phase.sine, fastmath=True)


def to_device(array: Any) -> Any:
    """The array on the GPU: copied there from NumPy, or as it is where it lies there already."""
    return cuda.to_device(np.ascontiguousarray(array)) if isinstance(array, np.ndarray) else array


def to_host(array: Any) -> np.ndarray:
    """The array in NumPy, once all kernels are done with it."""
    return array if isinstance(array, np.ndarray) else array.copy_to_host()


def empty(shape: tuple[int, ...], dtype: Any = np.float32) -> Any:
    """An array on the GPU, of whatever was there."""
    return cuda.device_array(shape, dtype=dtype)


def zeros(shape: tuple[int, ...]) -> Any:
    """A float32 array of zeros on the GPU, written there."""
    array = cuda.device_array(shape, dtype=np.float32)
    launch(_clear, (math.prod(shape), 1), array.reshape(math.prod(shape)))
    return array


def launch(function: Any, size: tuple[int, int], *args: Any, out: tuple[Any, ...] = (), threads: int = THREADS) -> None:
    """Start a kernel on `size` = (x, y) threads at least, with `args`, then `out`, moving NumPy arrays over.

    Kernels run one after the other; what is in `out` and lies in NumPy is waited for and copied back. A kernel
    learns its x from `cuda.grid(1)`, must check it, and strides over y by `cuda.gridDim.y`.
    """
    width, height = map(int, size)
    if width == 0 or height == 0:
        return
    results = [to_device(array) for array in out]
    with warnings.catch_warnings():
        # A small problem fills no GPU: true, and no fault.
        warnings.filterwarnings("ignore", message=".*Grid size .* will likely result in GPU under-utilization")
        configured = function[((width + threads - 1) // threads, min(height, _HIGHEST_Y)), threads]
    configured(*map(to_device, args), *results)
    for array, result in zip(out, results, strict=True):
        if isinstance(array, np.ndarray):
            array[...] = to_host(result)


def product(left: Any, right: Any, out: Any = None) -> Any:
    """(..., N) times (N, M), both complex64, as a (..., M) complex64 array on the GPU; summed first to last."""
    *outer, inner = tuple(left.shape)
    rows, columns = math.prod(outer), right.shape[1]
    out = empty((*outer, columns), np.complex64) if out is None else out
    launch(_product, (rows * columns, 1), to_device(left).reshape(rows, inner), right, out.reshape(rows, columns))
    return out


@kernel()
def _clear(array):
    i = cuda.grid(1)
    if i < array.shape[0]:
        array[i] = np.float32(0.0)


@kernel(fastmath=True)
def _product(left, right, out):
    q = cuda.grid(1)
    columns = out.shape[1]
    if q >= out.shape[0] * columns:
        return
    row, m = q // columns, q % columns
    re, im = np.float32(0.0), np.float32(0.0)
    for j in range(left.shape[1]):
        a, b = left[row, j], right[j, m]
        re += a.real * b.real - a.imag * b.imag
        im += a.real * b.imag + a.imag * b.real
    out[row, m] = complex(re, im)
