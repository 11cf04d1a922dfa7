"""Complex matrix products: the halved one is the plain one, wherever a matrix has the symmetry, and nowhere else."""

import numpy as np
import pytest

from millisight.core import halved, halved_product, product


def symmetric(rows, columns, spread=3.0):
    """w_j exp(i a_j b_m) with an even w and odd a and b, and phases of the rows."""
    a, b = (np.arange(n) - (n - 1) / 2 for n in (rows, columns))
    matrix = (1 + a**2 / max(rows, 2) ** 2)[:, None] * np.exp(1j * spread / rows * np.multiply.outer(a, b))
    return np.exp(0.7j * np.arange(rows) ** 2), matrix


def noise(*shape):
    rng = np.random.default_rng(sum(shape))
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


@pytest.mark.parametrize(
    ("count", "rows", "columns"),
    [(1, 1, 1), (1, 8, 5), (2, 7, 6), (3, 512, 100), (5, 511, 129), (7, 64, 127), (4, 3, 300), (6, 2, 2)],
)
def test_a_halved_product_is_the_plain_one(count, rows, columns):
    turns, matrix = symmetric(rows, columns)
    left = noise(count, 2, rows)
    expected = left.astype(np.complex128) @ (turns[:, None] * matrix)
    halves = halved(turns, matrix)
    assert halves is not None
    assert halves.shape == matrix.shape
    got = halved_product(left, halves)
    assert got.dtype == np.complex64
    scale = np.abs(expected).max()
    assert np.abs(got - expected).max() < 3e-6 * scale
    plain = product(left, (turns[:, None] * matrix).astype(np.complex64))
    assert np.abs(plain - expected).max() < 3e-6 * scale


def test_products_go_where_they_are_wanted():
    turns, matrix = symmetric(16, 9)
    left, out = noise(4, 16), np.zeros((6, 9), dtype=np.complex64)
    halves, whole = halved(turns, matrix), (turns[:, None] * matrix).astype(np.complex64)
    assert halves is not None
    for multiply, right in ((halved_product, halves), (product, whole)):
        out[:] = 0
        assert np.shares_memory(multiply(left, right, out[1:5]), out)
        np.testing.assert_array_equal(out[1:5], multiply(left, right))
        assert not out[[0, 5]].any()
        with pytest.raises(ValueError, match="C's order"):
            multiply(left, right, np.zeros((9, 4), dtype=np.complex64).T)


def test_a_matrix_whose_halves_do_not_mirror_is_not_halved():
    """Uneven frequencies, a window that is not even, or too few digits of either: all of it is needed."""
    turns, matrix = symmetric(16, 9)
    uneven = np.linspace(0.5, 2, 16)
    assert halved(turns, uneven[:, None] * matrix) is None
    assert halved(turns, matrix * np.exp(0.01j * np.arange(9))) is None
    assert halved(turns, matrix * (1 + 1e-4 * (np.arange(16) == 3))[:, None]) is None
    assert halved(turns, matrix * (1 + 1e-9 * (np.arange(16) == 3))[:, None]) is not None
