"""Complex matrix products whose bytes do not depend on the number of threads, compiled by Numba.

BLAS splits sums as its thread count suits it; here every row's sum has one order. `product` reaches 60 to 80 % of
BLAS's speed on range compression's shapes; `halved_product` needs a quarter of its operations, where a matrix's halves
mirror each other.
"""

from typing import NamedTuple

import numpy as np

from millisight.core._compiled import kernel, subroutine
from millisight.core._numba import prange
from millisight.core._records import for_kernel

# Rows of the left matrix that share one pass over the right one.
_ROWS = 4

# Of `_halved_product`: columns at a time, whose sums lie this far apart; rows of the table that one pass takes.
_WIDE, _DEEP = 64, 4

_SYMMETRIC = 1e-6  # largest difference of what is to be equal, of the largest entry: float32 tells no less

_U = np.uint64  # of indices: Numba lets signed ones count from the end, and LLVM then reads no vectors
_W = _U(_WIDE)


def product(left: np.ndarray, right: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """(..., N) times (N, M), both complex64, as a (..., M) complex64 array, `out` if given; summed in float32, first to
    last."""
    rows, out = for_kernel(left.reshape(-1, left.shape[-1])), _room(left, right.shape[1], out)
    _product(rows, np.ascontiguousarray(np.real(right)), np.ascontiguousarray(np.imag(right)), _as_rows(out))
    return out


def _room(left: np.ndarray, columns: int, out: np.ndarray | None) -> np.ndarray:
    return np.empty((*left.shape[:-1], columns), dtype=np.complex64) if out is None else out


def _as_rows(out: np.ndarray) -> np.ndarray:
    if not out.flags.c_contiguous:
        raise ValueError(f"out {out.shape} does not lie in C's order: its rows would be a copy")
    return out.reshape(-1, out.shape[-1])


@kernel(fastmath=True)
def _product(left, right_re, right_im, out):
    rows, inner = left.shape
    columns = right_re.shape[1]
    for tile in prange((rows + _ROWS - 1) // _ROWS):
        first = min(tile * _ROWS, max(rows - _ROWS, 0))  # the last tile overlaps rather than being short
        if rows >= _ROWS:
            sums = np.zeros((2 * _ROWS, columns), np.float32)
            for j in range(inner):
                a, b, c, d = left[first, j], left[first + 1, j], left[first + 2, j], left[first + 3, j]
                for m in range(columns):
                    re, im = right_re[j, m], right_im[j, m]
                    sums[0, m] += a.real * re - a.imag * im
                    sums[1, m] += a.real * im + a.imag * re
                    sums[2, m] += b.real * re - b.imag * im
                    sums[3, m] += b.real * im + b.imag * re
                    sums[4, m] += c.real * re - c.imag * im
                    sums[5, m] += c.real * im + c.imag * re
                    sums[6, m] += d.real * re - d.imag * im
                    sums[7, m] += d.real * im + d.imag * re
            # Only the tile's own rows: an overlapping neighbour writes the same bytes, but at another time.
            for i in range(tile * _ROWS - first, _ROWS):
                for m in range(columns):
                    out[first + i, m] = complex(sums[2 * i, m], sums[2 * i + 1, m])
        else:
            for i in range(rows):
                for m in range(columns):
                    re, im = np.float32(0.0), np.float32(0.0)
                    for j in range(inner):
                        a = left[i, j]
                        re += a.real * right_re[j, m] - a.imag * right_im[j, m]
                        im += a.real * right_im[j, m] + a.imag * right_re[j, m]
                    out[i, m] = complex(re, im)


class Halved(NamedTuple):
    """An (N, M) matrix of which a quarter is held: see `halved`.

    Attributes
    ----------
    turns : (2, N) float32, real and imaginary parts
    table : (blocks of columns, half of N, 2, `_WIDE`) float32, real and imaginary parts of a quarter of the matrix
    shape : (N, M)
    """

    turns: np.ndarray
    table: np.ndarray
    shape: tuple[int, int]


def halved(turns: np.ndarray, matrix: np.ndarray) -> Halved | None:
    """turns[:, None] * matrix, turns (N,), matrix (N, M), for `halved_product`; None where its halves do not mirror.

    They do in w_j exp(i a_j b_m) if w_j is even, and a_j and b_m are odd, each about its middle: the real part is the
    same at (j, m), (N - 1 - j, m), and (j, M - 1 - m), the imaginary part changes its sign there.
    """
    rows, columns = matrix.shape
    for mirrored in (matrix[::-1], matrix[:, ::-1]):
        if np.abs(matrix - mirrored.conj()).max() > _SYMMETRIC * np.abs(matrix).max():
            return None
    half, wide = (rows + 1) // 2, (columns + 1) // 2
    blocks = (wide + _WIDE - 1) // _WIDE
    table = np.zeros((blocks, (half + _DEEP - 1) // _DEEP * _DEEP, 2, _WIDE), np.float32)
    for block in range(blocks):
        part = matrix[:half, block * _WIDE : min((block + 1) * _WIDE, wide)]
        table[block, :half, 0, : part.shape[1]] = part.real
        table[block, :half, 1, : part.shape[1]] = part.imag
    return Halved(np.stack([turns.real, turns.imag]).astype(np.float32), table, (rows, columns))


def halved_product(left: np.ndarray, right: Halved, out: np.ndarray | None = None) -> np.ndarray:
    """(..., N) complex64 times a `Halved` (N, M), as a (..., M) complex64 array, `out` if given; summed in float32, in
    one order.

    With s_j and t_j, sum and difference of what lies at j and N - 1 - j, columns m and M - 1 - m are
    sum s_j Re K_jm +- i sum t_j Im K_jm over half of the rows: a quarter of the operations of `product`.
    """
    rows, out = for_kernel(left.reshape(-1, left.shape[-1])), _room(left, right.shape[1], out)
    _halved_product(rows, right.turns, right.table, _as_rows(out))
    return out


@kernel(fastmath=True, error_model="numpy")
def _halved_product(left, turns, table, out):
    rows, inner = left.shape
    numbers, entries = left.reshape(-1).view(np.float32), table.reshape(-1)
    blocks, half = table.shape[:2]
    columns = out.shape[1]
    for tile in prange((rows + 1) // 2):
        first, count = max(min(2 * tile, rows - 2), 0), min(rows, 2)
        re, im = np.empty(inner, np.float32), np.empty(inner, np.float32)
        both = np.zeros((8, half), np.float32)  # of each row: s and t, real and imaginary parts
        for i in range(count):
            at, last = _U(2 * (first + i) * inner), _U(inner - 1)
            for j in range(_U(inner)):
                x, y = numbers[at + _U(2) * j], numbers[at + _U(2) * j + _U(1)]
                re[j] = x * turns[0, j] - y * turns[1, j]
                im[j] = x * turns[1, j] + y * turns[0, j]
            if inner % 2:  # the middle one meets itself
                re[inner // 2] *= np.float32(0.5)
                im[inner // 2] *= np.float32(0.5)
            for j in range(_U((inner + 1) // 2)):
                both[4 * i, j], both[4 * i + 1, j] = re[j] + re[last - j], im[j] + im[last - j]
                both[4 * i + 2, j], both[4 * i + 3, j] = re[j] - re[last - j], im[j] - im[last - j]
        for block in range(blocks):
            here = min((columns + 1) // 2 - block * _WIDE, _WIDE)
            # One array, whose rows lie a constant apart: LLVM then asks once, and not for every pair, whether two
            # arrays overlap.
            sums = np.zeros(8 * _WIDE, np.float32)
            for j in range(0, half, _DEEP):
                _add_products(both, j, entries, _U((block * half + j) * 2 * _WIDE), sums, _U((here + 7) // 8 * 8))
            # Only the tile's own rows: an overlapping neighbour writes the same bytes, but at another time.
            for i in range(2 * tile - first, count):
                for m in range(here):
                    q = _U(4 * i * _WIDE + m)
                    a, b, c, d = sums[q], sums[q + _W], sums[q + _U(2) * _W], sums[q + _U(3) * _W]
                    column = block * _WIDE + m
                    out[first + i, column] = complex(a - d, b + c)
                    out[first + i, columns - 1 - column] = complex(a + d, b - c)


@subroutine
def _add_products(both, j, entries, at, sums, columns):
    """sums[r * _WIDE + m] += both[r, j:j + 4] times four rows of the table, which begin at entries[at]: real parts for
    s, imaginary parts for t."""
    a0, a1, a2, a3 = both[0, j], both[0, j + 1], both[0, j + 2], both[0, j + 3]
    b0, b1, b2, b3 = both[1, j], both[1, j + 1], both[1, j + 2], both[1, j + 3]
    c0, c1, c2, c3 = both[2, j], both[2, j + 1], both[2, j + 2], both[2, j + 3]
    d0, d1, d2, d3 = both[3, j], both[3, j + 1], both[3, j + 2], both[3, j + 3]
    e0, e1, e2, e3 = both[4, j], both[4, j + 1], both[4, j + 2], both[4, j + 3]
    f0, f1, f2, f3 = both[5, j], both[5, j + 1], both[5, j + 2], both[5, j + 3]
    g0, g1, g2, g3 = both[6, j], both[6, j + 1], both[6, j + 2], both[6, j + 3]
    h0, h1, h2, h3 = both[7, j], both[7, j + 1], both[7, j + 2], both[7, j + 3]
    for m in range(columns):
        q = at + m
        w, x, y, z = entries[q], entries[q + _U(2) * _W], entries[q + _U(4) * _W], entries[q + _U(6) * _W]
        sums[m + _U(0) * _W] += (a0 * w + a1 * x) + (a2 * y + a3 * z)
        sums[m + _U(1) * _W] += (b0 * w + b1 * x) + (b2 * y + b3 * z)
        sums[m + _U(4) * _W] += (e0 * w + e1 * x) + (e2 * y + e3 * z)
        sums[m + _U(5) * _W] += (f0 * w + f1 * x) + (f2 * y + f3 * z)
        q += _W
        w, x, y, z = entries[q], entries[q + _U(2) * _W], entries[q + _U(4) * _W], entries[q + _U(6) * _W]
        sums[m + _U(2) * _W] += (c0 * w + c1 * x) + (c2 * y + c3 * z)
        sums[m + _U(3) * _W] += (d0 * w + d1 * x) + (d2 * y + d3 * z)
        sums[m + _U(6) * _W] += (g0 * w + g1 * x) + (g2 * y + g3 * z)
        sums[m + _U(7) * _W] += (h0 * w + h1 * x) + (h2 * y + h3 * z)
