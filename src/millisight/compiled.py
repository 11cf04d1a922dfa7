"""How kernels are compiled: by Numba, in parallel, and cached on disk wherever a disk lets us."""

from collections.abc import Callable
from typing import Any

from numba import njit


def kernel(**options: Any) -> Callable[[Callable], Any]:
    """Compile a function's loops over `prange` for all cores, and keep the machine code for the next process."""

    def compile_lazily(function: Callable) -> Any:
        try:
            return njit(parallel=True, cache=True, **options)(function)
        except RuntimeError:
            # Neither the package's folder nor the user's cache can be written to: compile in every process.
            return njit(parallel=True, **options)(function)

    return compile_lazily


def inline(function: Callable, **options: Any) -> Any:
    """Compile a scalar function into its callers."""
    return njit(inline="always", **options)(function)


subroutine = njit(fastmath=True, error_model="numpy")
"""Compile a serial function that kernels call on arrays."""
