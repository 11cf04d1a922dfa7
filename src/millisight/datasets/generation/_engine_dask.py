"""Jobs on a Dask cluster: its scheduler repeats what a lost worker was at, and nothing else.

A worker runs one job at a time, its kernels on as many cores as the worker has threads.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from millisight.core.errors import DeviceError
from millisight.datasets._workers import Outcome, attempt, on_threads

T = TypeVar("T")

_CONNECT = 20.0  # s
_LOOK = 5.0  # s between looks at how large the cluster is
_AHEAD = 64  # jobs at least that the scheduler knows of, so that a cluster that grows with its work grows
_BUSY = threading.Lock()


def cluster_size(address: str) -> tuple[int, int]:
    """How many workers a cluster has now, and how many cores each; 1 and 1 of one that has none yet.

    Raises
    ------
    DeviceError
        There is no scheduler at the address.
    """
    with _client(address) as client:
        threads = client.nthreads().values()
    return max(1, len(threads)), max(1, min(threads, default=1))


def on_cluster(address: str, function: Callable[[T], Any], things: Sequence[T]) -> Generator[Outcome, None, None]:
    """`function` of every one of `things` on a cluster, as they are done; see `Engine.run`.

    What a worker was at when it was lost is done again by another; a thing that takes several workers down with it
    is given up.

    Raises
    ------
    DeviceError
        There is no scheduler at the address, or it has gone.
    """
    from distributed import as_completed

    with _client(address) as client:
        waiting = deque(enumerate(things))
        numbers: dict[Any, int] = {}
        done = as_completed(loop=client.loop)
        ahead, looked = 0, -_LOOK
        try:
            while waiting or numbers:
                if time.monotonic() - looked > _LOOK:
                    ahead, looked = max(_AHEAD, 4 * sum(client.nthreads().values())), time.monotonic()
                while waiting and len(numbers) < ahead:
                    number, thing = waiting.popleft()
                    future = client.submit(_on_worker, function, thing, pure=False)
                    numbers[future] = number
                    done.add(future)
                future = next(done)
                number = numbers.pop(future)
                if future.status == "finished":
                    yield Outcome(number, *future.result())
                elif client.status != "running":
                    raise DeviceError(f"lost the scheduler at {address}; start it again, then run the same command")
                else:
                    yield Outcome(number, None, _reason(future))
        finally:
            client.cancel(list(numbers))


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise DeviceError('a Dask cluster needs Dask: pip install "millisight[cluster]"') from error
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise DeviceError(
            f"no Dask scheduler answers at {address}: {error}; start one, or check the address"
        ) from error
    try:
        yield client
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=5)


def _on_worker(function: Callable[[T], Any], thing: T) -> tuple[Any, str]:
    from distributed import get_worker

    with _BUSY:
        return attempt(lambda one: on_threads(function, get_worker().state.nthreads, one), thing)


def _reason(future: Any) -> str:
    """Why there is no outcome, though an error of the job's own would be one."""
    error = future.exception() if future.status == "error" else None
    return "Dask gave up: " + " ".join(f"{type(error).__name__} {error}".split() if error else [future.status])
