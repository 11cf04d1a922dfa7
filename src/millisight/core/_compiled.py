"""How kernels are compiled: by Numba, in parallel, and cached on disk wherever a disk lets us.

One compilation leaves two machine codes of a parallel loop: LLVM optimises it by itself, and once more as a part of the
function around it. Numba runs the first in the process that compiles, but keeps the second, which later processes run;
with `fastmath` their sums differ in the last digits. Here every process runs the second, so that results do not depend
on which process compiled.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function's loops over `prange` for all cores, and keep the machine code for the next process."""
    return serial(parallel=True, **options)


def serial(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function for one core, and keep the machine code for the next process."""

    def compile_lazily(function: Callable[..., Any]) -> Any:
        try:
            return _as_kept(njit(cache=True, **options)(function))
        except RuntimeError:
            # Neither the package's folder nor the user's cache can be written to: compile in every process.
            return _as_kept(njit(**options)(function))

    return compile_lazily


def _as_kept(function: Any) -> Any:
    """The same function, which runs the code that it keeps, and also works where none can be kept: on a full disk, say.

    What is compiled is taken apart and put together again as if it came from the disk.
    """
    compile_here, store = function._compiler.compile, function._cache
    load, save = store.load_overload, store.save_overload
    compiled: dict[Any, Any] = {}

    def compile_and_reload(arguments: Any, return_type: Any) -> Any:
        made = compile_here(arguments, return_type)
        kept = type(made)._rebuild(_apart(), *made._reduce())
        # Functions that call this one find it by the address that is called.
        function.targetctx.insert_user_function(kept.entry_point, made.fndesc, [made.library])
        compiled[kept.entry_point] = made
        return kept

    def try_to_keep(signature: Any, code: Any) -> None:
        made = compiled.pop(code.entry_point)  # what was put together again cannot be taken apart
        with suppress(OSError):
            save(signature, made)

    function._compiler.compile = compile_and_reload
    store.load_overload = lambda signature, _: load(signature, _apart())
    store.save_overload = try_to_keep
    return function


def _apart() -> Any:
    """Where code is loaded alone: beside other code, LLVM links parts of the same name to those that came first."""
    from numba.core.cpu import CPUContext
    from numba.core.registry import cpu_target

    return CPUContext(cpu_target.typing_context)


def is_kept(function: Any) -> bool:
    """Whether an earlier process has left machine code of a `kernel` or `serial` function where Numba keeps it."""
    folder = function.stats.cache_path
    name = Path(function.py_func.__code__.co_filename).stem
    return folder is not None and any(Path(folder).glob(f"{name}.{function.py_func.__qualname__}-*.nbi"))


def inline(function: Callable, **options: Any) -> Any:
    """Compile a scalar function into its callers."""
    return njit(inline="always", **options)(function)


subroutine: Any = njit(fastmath=True, error_model="numpy")
"""Compile a serial function that kernels call on arrays."""
