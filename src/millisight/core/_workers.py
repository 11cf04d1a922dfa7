"""One function over many things, in several processes: a failure is the thing's own, and none is left behind."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

from millisight.core._records import checked_integer
from millisight.core.errors import MillisightError

T = TypeVar("T")

_DIED = (
    "the process that worked on it died, for lack of memory, or because a script calls this outside of "
    '`if __name__ == "__main__":`; workers=1 starts no processes'
)

_HOPELESS = 3  # things whose own processes died, before any process has done anything


class Outcome(NamedTuple):
    """What came of one thing: its number, and the function's result or why there is none."""

    number: int
    result: Any
    failure: str


def default_workers() -> int:
    """As many as the processor cores that this process may use, eight at most."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, 8)


def on_threads(function: Callable[[T], Any], threads: int, thing: T) -> Any:
    """`function` of `thing`, its kernels on so many cores."""
    from millisight.core._numba import numba

    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))  # ty: ignore[missing-attribute]: set as numba loads
    try:
        return function(thing)
    finally:
        numba.set_num_threads(before)


def each(
    function: Callable[[T], Any], things: Sequence[T], *, workers: int | None = None
) -> Generator[Outcome, None, None]:
    """`function` of every one of `things`, as they are done; the order is nobody's.

    An error is that thing's failure and stops no other; so is the death of the process that worked on it. When
    the generator is closed before its end, as `contextlib.closing` does after Ctrl-C, the processes are ended with it.

    Parameters
    ----------
    function, things : what a new process can import and unpickle
    workers : processes; 1 works in this one; None: `default_workers()`

    Raises
    ------
    InputError
        `workers` is no whole number from 1 on.
    """
    workers = default_workers() if workers is None else checked_integer(workers, name="workers")
    numbered = list(enumerate(things))
    if workers == 1 or len(numbered) < 2:
        for number, thing in numbered:
            yield Outcome(number, *attempt(function, thing))
        return
    unsure: list[tuple[int, T]] = []
    done = 0
    for outcome in _pooled(function, numbered, workers, unsure):
        done += 1
        yield outcome
    # A process died. Each thing that may have been the cause has one of its own, as long as any process lives: where a
    # script's fault ends them all, each would tell of it.
    died: list[tuple[int, T]] = []
    while unsure and (done or len(died) < _HOPELESS):
        for outcome in _pooled(function, [unsure.pop(0)], 1, died):
            done += 1
            yield outcome
    for number, _ in [*died, *unsure]:
        yield Outcome(number, None, _DIED)


def _pooled(
    function: Callable[[T], Any], things: list[tuple[int, T]], workers: int, unsure: list[tuple[int, T]]
) -> Iterator[Outcome]:
    """The outcomes of a pool of processes; if it breaks, what has none goes to `unsure`."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(things)), mp_context=context, initializer=_watch_parent)
    waiting = deque(things)
    running: dict[Future, tuple[int, T]] = {}
    try:
        while waiting or running:
            with _ctrl_c_held():  # the processes are started here
                # Two things for each: enough that none waits, few to repeat if the pool breaks.
                while waiting and len(running) < 2 * workers:
                    running[pool.submit(attempt, function, waiting[0][1])] = waiting[0]
                    waiting.popleft()
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield Outcome(running[future][0], *future.result())
                del running[future]
    except BrokenProcessPool:
        unsure += [*running.values(), *waiting]
    finally:
        # Of a pool that is done the processes end by themselves; otherwise nobody wants what they are at.
        for process in list((pool._processes or {}).values()) if running else []:
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def beside(function: Callable[[T], Any], thing: T) -> Iterator[Callable[[], Any]]:
    """Within the block, `function` of `thing` is at work in a process of its own.

    A block that is left before, by Ctrl-C perhaps, ends the process.

    Parameters
    ----------
    function, thing : what a new process can import and unpickle

    Yields
    ------
    callable
        Waits for the result and returns it, or raises what the function raised. If the process died, it does the work
        here.
    """
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_watch_parent)
    with _ctrl_c_held():
        future = pool.submit(function, thing)

    def result() -> Any:
        try:
            return future.result()
        except BrokenProcessPool:
            return function(thing)

    try:
        yield result
    finally:
        for process in [] if future.done() else list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _ctrl_c_held() -> Iterator[None]:
    """Ctrl-C comes after this block, and never to a process started in it: it is the caller's to handle."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def attempt(function: Callable[[T], Any], thing: T) -> tuple[Any, str]:
    """The function's result, or else why there is none."""
    try:
        return function(thing), ""
    except MillisightError as error:
        return None, " ".join(str(error).split())
    except MemoryError as error:
        return None, f"not enough memory: {error}; use fewer workers"
    except Exception as error:  # whatever it is, it must not stop the rest
        return None, f"{type(error).__name__}: {' '.join(str(error).split())}"


def _watch_parent() -> None:
    """In a new process: without a parent, killed perhaps, there is nothing to do."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
