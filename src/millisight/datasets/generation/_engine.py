"""Where jobs run: in this process, in several, or on a Dask cluster; what they make is the same.

Engines: "processes", one a core; "threads", one job after the other in this process, its kernels on several cores, for
machines with many cores and little memory; and an address such as "tcp://host:8786", the scheduler of a Dask cluster,
whose workers see the dataset's folder under the same path.
"""

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, NamedTuple, TypeVar

from millisight.core import checked_integer
from millisight.core.errors import InputError, UnknownNameError
from millisight.datasets._workers import Outcome, default_workers, each, on_threads

T = TypeVar("T")

LOCAL = ("processes", "threads")
ADDRESSES = ("tcp://", "tls://", "ucx://", "ws://", "wss://", "inproc://")


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
            from millisight.datasets.generation._engine_dask import on_cluster

            yield from on_cluster(self.scheduler, function, things)
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
    """The engine that goes by a name or an address.

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
    from millisight.datasets.generation._engine_dask import cluster_size

    return Engine(scheduler, *cluster_size(scheduler))
