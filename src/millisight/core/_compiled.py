"""How kernels are compiled: by Numba, in parallel, and cached on disk wherever a disk lets us.

One compilation leaves two machine codes of a parallel loop: LLVM optimises it by itself, and once more as a part of the
function around it. Numba runs the first in the process that compiles, but keeps the second, which later processes run;
with `fastmath` their sums differ in the last digits. Here every process runs the second, so that results do not depend
on which process compiled.

What is kept carries a checksum: a damaged file is compiled anew, and no damaged code is run. Where neither the
package's folder nor the user's cache can be written to, a temporary folder of the user's own is used.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

from millisight.core._locks import one_at_a_time, private_folder
from millisight.core._numba import caching, numba
from millisight.core.errors import DeviceError

_KERNELS: list[Any] = []
_PATIENCE = 120.0  # longest that a process waits for what another one compiles [s]


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function's loops over `prange` for all cores, and keep the machine code for the next process."""

    def compile_lazily(function: Callable[..., Any]) -> Any:
        compiled = serial(parallel=True, **options)(function)
        _KERNELS.append(compiled)
        return compiled

    return compile_lazily


def _refuse_after_fork() -> None:
    """In a process that was forked from one whose threads have run: OpenMP would end it at its first loop."""
    from numba import threading_layer
    from numba.np.ufunc import parallel

    if parallel._is_initialized and threading_layer() == "omp":
        for one in _KERNELS:
            one.__class__ = _forked(type(one))


@cache
def _forked(kind: type) -> type:
    """Of kernels that raise an error where they are called."""

    def refuse(self: Any, *arguments: Any, **named: Any) -> None:
        raise DeviceError(
            "this process was forked from one that had computed already, which OpenMP's threads do not survive; start "
            'processes by multiprocessing.get_context("spawn") or "forkserver", or compute in them alone'
        )

    return type("ForkedKernel", (kind,), {"__call__": refuse})


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_refuse_after_fork)


def serial(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function for one core, and keep the machine code for the next process."""

    def compile_lazily(function: Callable[..., Any]) -> Any:
        try:
            return _as_kept(numba.njit(cache=True, **options)(function))
        except RuntimeError:  # neither the package's folder nor the user's cache can be written to
            pass
        try:
            with _cache_in(str(private_folder("millisight-kernels"))):
                return _as_kept(numba.njit(cache=True, **options)(function))
        except (RuntimeError, OSError):  # nor a temporary one: compile in every process
            return _as_kept(numba.njit(**options)(function))

    return compile_lazily


@contextmanager
def _cache_in(folder: str) -> Iterator[None]:
    """Within the block, functions are given this cache."""
    settings: Any = numba.config  # whose names are made while it is imported
    before, settings.CACHE_DIR = settings.CACHE_DIR, folder
    try:
        yield
    finally:
        settings.CACHE_DIR = before


class _CheckedFiles(caching.IndexDataCacheFile):
    """Numba's files of a cache, each with a checksum behind it, where unpickling does not look.

    A file without the right one is as if it were not there: it is compiled and written anew.
    """

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        with super()._open_for_write(filepath) as file:
            content = BytesIO()
            yield content
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _is_whole(path):
            raise OSError(f"{path} is damaged")  # which Numba takes for a file that was removed
        return super()._load_data(name)


def _is_whole(path: str) -> bool:
    """Whether a file of a cache can be read, and is what was written."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-32]).digest() == content[-32:]


def _as_kept(function: Any) -> Any:
    """The same function, which runs the code that it keeps, and also works where none can be kept: on a full disk, say.

    What is compiled is taken apart and put together again as if it came from the disk.
    """
    compile_here, store = function._compiler.compile, function._cache
    load, save = store.load_overload, store.save_overload
    where = ""
    if hasattr(store, "_cache_file"):
        store._cache_file.__class__ = _CheckedFiles
        where = store._cache_file._index_path

    def compile_and_reload(arguments: Any, return_type: Any) -> Any:
        if not where:
            return put_together(compile_here(arguments, return_type))
        # Of processes that start together one compiles, and the others wait for what it keeps. Of the threads of a
        # process one comes here at a time: Numba holds its own lock.
        with one_at_a_time(f"{where}: {arguments}", seconds=_PATIENCE):
            kept = load(arguments, _apart())
            if kept is not None:
                function.targetctx.insert_user_function(kept.entry_point, kept.fndesc, [kept.library])
                return kept
            made = compile_here(arguments, return_type)
            with suppress(OSError):
                save(arguments, made)  # what was put together again cannot be taken apart
        return put_together(made)

    def put_together(made: Any) -> Any:
        kept = type(made)._rebuild(_apart(), *made._reduce())
        # Functions that call this one find it by the address that is called.
        function.targetctx.insert_user_function(kept.entry_point, made.fndesc, [made.library])
        return kept

    function._compiler.compile = compile_and_reload
    store.load_overload = lambda signature, _: load(signature, _apart())
    store.save_overload = lambda *_: None  # it was kept before
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
    return numba.njit(inline="always", **options)(function)


subroutine: Any = numba.njit(fastmath=True, error_model="numpy")
"""Compile a serial function that kernels call on arrays."""

part: Any = numba.njit
"""Compile the body of a kernel's loop by itself, to the same arithmetic: within a loop that runs in parallel, Numba
takes several times as long over it."""
