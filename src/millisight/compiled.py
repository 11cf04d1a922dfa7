"""How kernels are compiled: by Numba, in parallel, and cached on disk wherever a disk lets us."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit


def kernel(**options: Any) -> Callable[[Callable], Any]:
    """Compile a function's loops over `prange` for all cores, and keep the machine code for the next process."""
    return serial(parallel=True, **options)


def serial(**options: Any) -> Callable[[Callable], Any]:
    """Compile a function for one core, and keep the machine code for the next process."""

    def compile_lazily(function: Callable) -> Any:
        try:
            return _forgiving(njit(cache=True, **options)(function))
        except RuntimeError:
            # Neither the package's folder nor the user's cache can be written to: compile in every process.
            return njit(**options)(function)

    return compile_lazily


def _forgiving(function: Any) -> Any:
    """The same function, which works as well where its machine code cannot be kept: on a full disk, say."""
    keep = function._cache.save_overload

    def try_to_keep(signature: Any, code: Any) -> None:
        with suppress(OSError):
            keep(signature, code)

    function._cache.save_overload = try_to_keep
    return function


def is_kept(function: Any) -> bool:
    """Whether an earlier process has left machine code of a `kernel` or `serial` function where Numba keeps it."""
    folder = function.stats.cache_path
    name = Path(function.py_func.__code__.co_filename).stem
    return folder is not None and any(Path(folder).glob(f"{name}.{function.py_func.__qualname__}-*.nbi"))


def inline(function: Callable, **options: Any) -> Any:
    """Compile a scalar function into its callers."""
    return njit(inline="always", **options)(function)


subroutine = njit(fastmath=True, error_model="numpy")
"""Compile a serial function that kernels call on arrays."""
