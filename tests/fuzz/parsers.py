"""Damaged files against every reader: 100 000 of them with `make fuzz`, 2 000 of each format in the test suite.

    python tests/fuzz/parsers.py --count 100000     so many in all
    python tests/fuzz/parsers.py --each 2000        so many of each format
    python tests/fuzz/parsers.py --minutes 30       the same processor time for each format

A small valid file of each format is damaged (`damage.py`) and read. Whatever comes, a reader returns or raises one of
millisight's own errors, in bounded time and memory. Most damage falls behind the header, so that it is not refused at
the door. Files that did harm once are read first. Readers that start a process fork here, and get fewer files than
others. Files lie in memory where the system has such a place. What fails is kept in build/fuzz.
"""

import argparse
import gc
import hashlib
import json
import logging
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from damage import damaged
from forks import forked
from formats import Format, formats

from millisight.core.errors import MillisightError

SECONDS, WAIT = 10, 90  # of processor time for one file; and until whatever it waits for is a hang
MEMORY = 256 << 20  # that the process may grow by in all
KEPT = Path(__file__).parents[2] / "build" / "fuzz"
IN_MEMORY = Path("/dev/shm")


class Result(NamedTuple):
    """What came of the files of one format."""

    name: str
    files: int = 0
    past_header: int = 0
    read: int = 0  # without an error
    seconds: float = 0.0  # of processor time
    slowest: float = 0.0  # [s of processor time]
    memory: float = 0.0  # that the process took more than before [MB]
    failures: Sequence[str] = ()  # crashes, hangs, and errors that are none of ours

    def __str__(self) -> str:
        return (
            f"{self.name:20} {self.files:8} files, {self.past_header:8} with a whole header, {self.read:8} read, "
            f"{self.files / max(self.seconds, 0.01):6.0f} a second, slowest {self.slowest:5.2f} s, "
            f"{self.memory:4.0f} MB{'  FAILED' if self.failures else ''}"
        )


class Tried:
    """Reads files of one format, and counts."""

    def __init__(self, form: Format, folder: Path):
        self.form, self.path = form, folder / f"damaged{form.suffix}"
        self.files = self.past_header = self.read = 0
        self.slowest = 0.0

    def __call__(self, data: bytes) -> None:
        """Read a file; anything but a result or an error of ours is a failure."""
        self.path.write_bytes(data)
        self.files += 1
        header = self.form.header
        self.past_header += len(data) > header and data[:header] == self.form.valid[:header]
        began = _processor_seconds()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.setitimer(signal.ITIMER_REAL, WAIT)
        try:
            self.form.parse(self.path)
            self.read += 1
        except MillisightError:
            pass
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
        self.slowest = max(self.slowest, took := _processor_seconds() - began)
        if took > SECONDS:
            raise TimeoutError(f"a process that a reader started took {took:.0f} s")


def run(count: int, number: int, only: str | None = None, *, each: int = 0, minutes: float = 0) -> Iterator[Result]:
    """Read `count` damaged files in all, or `each` of every format, or for so many minutes of processor time that all
    formats share equally.

    Those that did harm before come first. Each format is read in a process of its own.
    """
    place = IN_MEMORY if os.access(IN_MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as text:
        every: Iterable[Format] = formats(Path(text))
        if only:
            every = islice((form for form in every if form.name == only), 1)
        share, seconds = each, float("inf")
        if not each:  # then all have to be known first
            every = list(every)
            share = sys.maxsize if minutes else count / sum(1 / form.rarely for form in every)
            seconds = 60 * minutes / len(every) if minutes else seconds
        for form in every:
            gc.freeze()  # no process collects, and so copies, what all were started with
            yield _in_child(form, int(share / form.rarely) + 1, seconds, number, Path(text))


def _in_child(form: Format, count: int, seconds: float, number: int, folder: Path) -> Result:
    """What a process finds that may crash."""
    ours, its = os.pipe()
    process = os.fork()
    if not process:
        try:
            with forked():
                told = _tried(form, count, seconds, number, folder)
            os.write(its, json.dumps(told).encode())
        finally:
            os._exit(0)
    os.close(its)
    with open(ours, "rb") as pipe:
        told = pipe.read()
    _, status = os.waitpid(process, 0)
    if told:
        return Result(*json.loads(told))
    return Result(form.name, failures=[f"its process ended with {os.waitstatus_to_exitcode(status)}: a crash"])


def _tried(form: Format, count: int, seconds: float, number: int, folder: Path) -> Result:
    def too_long(*_: object) -> None:
        raise TimeoutError(f"a reader took more than {SECONDS} s, or waited for {WAIT} s")

    for kind in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(kind, too_long)
    warnings.simplefilter("error", RuntimeWarning)  # NumPy's, of a reader that goes on with nonsense
    tried, began = Tried(form, folder), _processor_seconds()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        tried(form.valid)  # what is loaded with the first file is not the file's doing
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_AS, (_address_space() + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        failures = _check(form, count, began + seconds, number, tried) if tried.read else ["the valid file is refused"]
    except BaseException:
        failures = [traceback.format_exc()[-4000:]]
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    took = _processor_seconds() - began
    return Result(form.name, tried.files, tried.past_header, tried.read, took, tried.slowest, grown, failures)


def _check(form: Format, count: int, until: float, number: int, tried: Tried) -> list[str]:
    """What fails of `count` damaged files, or of as many as are read until the process has taken so many seconds.

    An error is told once for each line of code that raises it, and ten ends it.
    """
    rng, failures, where = random.Random(f"{number} {form.name}"), [], set()
    for place in range(len(form.found) + count):
        old = place < len(form.found)
        data = form.found[place] if old else damaged(form.valid, form.header, text=form.text, rng=rng)
        try:
            tried(data)
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            if (line := (type(error), last.filename, last.lineno)) in where:
                continue
            where.add(line)
            kept = KEPT / f"{hashlib.sha256(data).hexdigest()[:12]}{form.suffix}"
            KEPT.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(data)
            failures.append(f"it failed on {kept}: {traceback.format_exc()[-4000:]}")
            if len(failures) == 10:
                break
        if not old and _processor_seconds() > until:
            break
    return failures


def _processor_seconds() -> float:
    """That this process and those that it started, and that have ended, took so far."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _address_space() -> int:
    """Bytes of address space that the process has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--each", type=int, default=0, help="instead: of each format, of slow ones fewer")
    parser.add_argument("--minutes", type=float, default=0, help="instead: of processor time, shared by all formats")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="the name of one format, which gets all files")
    arguments = parser.parse_args()
    logging.disable()  # what was repaired
    results = []
    for result in run(arguments.count, arguments.seed, arguments.only, each=arguments.each, minutes=arguments.minutes):
        results.append(result)
        sys.stdout.write("\n".join([str(result), *result.failures]) + "\n")
        sys.stdout.flush()
    files, past, took = (sum(result[i] for result in results) for i in (1, 2, 4))
    failed = sum(len(result.failures) for result in results)
    sys.stdout.write(
        f"{files} files of {len(results)} formats, {past} past the header ({100 * past / max(files, 1):.0f} %), "
        f"{failed} crashes, hangs or other errors; {took:.0f} s of processor time, "
        f"slowest {max((r.slowest for r in results), default=0):.2f} s, "
        f"most memory {max((r.memory for r in results), default=0):.0f} MB\n"
    )
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
