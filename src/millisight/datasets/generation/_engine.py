"""Where jobs run: in this process, in several, or on a Dask cluster; what they make is the same.

Engines: "processes", one a core; "threads", one job after the other in this process, its kernels on several cores, for
machines with many cores and little memory; and an address such as "tcp://host:8786", the scheduler of a Dask cluster,
whose workers see the dataset's folder under the same path, or share an object store with the run. It repeats what a
lost worker was at, and nothing else; a worker runs one job at a time, its kernels on as many cores as the worker has
threads.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from typing import Any, NamedTuple, TypeVar

from millisight.core import Outcome, attempt, checked_integer, default_workers, each, on_threads
from millisight.core.errors import DeviceError, InputError, UnknownNameError

T = TypeVar("T")

LOCAL = ("processes", "threads")
ADDRESSES = ("tcp://", "tls://", "ucx://", "ws://", "wss://", "inproc://")

_CONNECT = 20.0  # to a cluster's scheduler [s]
_LOOK = 5.0  # between looks at how large the cluster is [s]
_AHEAD = 64  # jobs at least that the scheduler knows of, so that a cluster that grows with its work grows
_BUSY = threading.Lock()  # of a worker


class Engine(NamedTuple):
    """Where jobs run.

    Attributes
    ----------
    scheduler : "processes", "threads", or the address of a Dask scheduler
    workers : how many jobs run at a time; of a cluster as many as it has workers
    threads : cores for each
    """

    scheduler: str
    workers: int
    threads: int

    @property
    def cores(self) -> int:
        return self.workers * self.threads

    def run(self, function: Callable[[T], Any], things: Sequence[T]) -> Generator[Outcome, None, None]:
        """`function` of every one of `things`, as they are done; the order is nobody's.

        An error is that thing's failure and stops no other. Closed before its end, what still runs is given up.
        """
        if self.scheduler not in LOCAL:
            yield from _on_cluster(self.scheduler, function, things)
            return
        limited = partial(on_threads, function, self.threads)
        with _one_blas_thread(), closing(each(limited, things, workers=self.workers)) as outcomes:
            yield from outcomes


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Processes started in this block leave the other cores to their siblings, where nobody has said otherwise."""
    names = [name for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS") if name not in os.environ]
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]


def engine_of(scheduler: str = "processes", workers: int | None = None) -> Engine:
    """The engine with a name or at an address.

    Parameters
    ----------
    scheduler : "processes", "threads", or an address such as "tcp://host:8786"
    workers : processes, or threads; None: as many as cores, eight at most; not for a cluster, which has its own

    Raises
    ------
    UnknownNameError, InputError
        There is no such engine, or a cluster's workers are to be counted here.
    FileError
        There is no scheduler at the address, or it has no workers.
    """
    if workers is not None:
        workers = checked_integer(workers, name="workers")
    if scheduler == "threads":
        return Engine(scheduler, 1, workers or default_workers())
    if scheduler == "processes":
        workers = workers or default_workers()
        return Engine(scheduler, workers, max(1, default_workers() // workers))
    if not scheduler.startswith(ADDRESSES):
        raise UnknownNameError("scheduler", scheduler, (*LOCAL, "tcp://host:8786"))
    if workers is not None:
        raise InputError(
            "workers applies to this machine only; a cluster uses all workers connected to it: leave workers out"
        )
    return Engine(scheduler, *_cluster_size(scheduler))


def _cluster_size(address: str) -> tuple[int, int]:
    """How many workers a cluster has now, and how many cores each; 1 and 1 of one that has none yet."""
    with _client(address) as client:
        threads = client.nthreads().values()
    return max(1, len(threads)), max(1, min(threads, default=1))


def _on_cluster(address: str, function: Callable[[T], Any], things: Sequence[T]) -> Generator[Outcome, None, None]:
    """`function` of every one of `things` on a cluster, as they are done; see `Engine.run`.

    What a worker was at when it was lost is done again by another; a thing that takes several workers down with it
    is given up.
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
                if future.status in ("lost", "pending") and client.status == "running":
                    done.add(future)  # its worker was lost with the result: the scheduler has it made again
                    continue
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
        from distributed.security import Security
    except ImportError as error:
        raise DeviceError('a Dask cluster needs Dask: pip install "millisight[cluster]"') from error
    # Dask would fail here as well, and leave a client behind whose end blocks the next one's start for ever.
    if address.startswith(("tls://", "wss://")) and Security().get_connection_args("client")["ssl_context"] is None:
        raise DeviceError(
            f"{address} asks for certificates, and Dask's settings name none: set "
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, __CLIENT__CERT and __CLIENT__KEY as the page on scaling out shows"
        )
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError, TimeoutError) as error:
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
