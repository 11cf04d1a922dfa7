"""Damaged files against every reader: 100 000 of them with `make fuzz`, 2 000 in the test suite.

    python tests/fuzz/parsers.py --count 100000
    python tests/fuzz/parsers.py --count 1000000 --plain      other damage, faster

A small valid file of each format is damaged by Hypothesis: bytes changed, cut out, doubled, moved, the end cut off,
numbers in text replaced by extreme ones, brackets opened without end. Whatever comes, a reader returns or raises one of
millisight's own errors, in bounded time and memory. Most damage falls behind the header, so that it is not refused at
the door. Files that did harm once are read first. With `--plain` a plain generator of random numbers damages them in
other ways, several times as many a second: numbers in binary become a little larger or smaller, parts of a file are
exchanged, overwritten by others, or joined anew, lines and words change places. What fails is kept in build/fuzz.
"""

import argparse
import gc
import hashlib
import json
import logging
import os
import random
import re
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from formats import Format, formats
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from millisight.core.errors import MillisightError

SECONDS, WAIT = 10, 90  # of processor time for one file; and until whatever it waits for is a hang
MEMORY = 256 << 20  # that the process may grow by in all
KEPT = Path(__file__).parents[2] / "build" / "fuzz"

EXTREME = (
    "0",
    "-1",
    "1e308",
    "-1e400",
    "nan",
    "inf",
    "99999999999999999999",
    "1e-320",
    "9" * 4301,
    '"',
    "",
    "[",
    "{",
    "true",
    "x",
)


def damaged(form: Format) -> st.SearchStrategy[bytes]:
    """The valid file with one to four pieces of damage, one in four of which may touch the header."""
    size = len(form.valid)
    anywhere = st.integers(0, max(size - 1, 0))
    behind = st.integers(min(form.header, size - 1), size - 1)
    place = st.one_of(behind, behind, behind, anywhere)
    edits = [
        st.tuples(st.just("set"), place, st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("flip"), place, st.integers(0, 7)),
        st.tuples(st.just("cut"), place, st.integers(1, 64)),
        st.tuples(st.just("insert"), place, st.binary(min_size=1, max_size=32)),
        st.tuples(st.just("double"), place, st.integers(1, 200)),
        st.tuples(st.just("end"), place, st.none()),
        st.tuples(st.just("nest"), place, st.sampled_from([b"[", b'{"a":', b"a.", b"("])),
        st.tuples(st.just("large"), place, st.sampled_from([b"\xff" * 4, b"\xff" * 8, b"\x7f\xff\xff\xff", bytes(8)])),
    ]
    if form.text:
        edits += [st.tuples(st.just("number"), place, st.sampled_from(EXTREME))] * 4
    return st.lists(st.one_of(edits), min_size=1, max_size=4).map(lambda chosen: apply(form.valid, chosen))


def apply(data: bytes, edits: list[tuple]) -> bytes:
    """`data` after the edits (kind, place, what)."""
    for kind, place, what in edits:
        at = min(place, len(data))
        if kind in ("set", "large"):
            data = data[:at] + what + data[at + len(what) :]
        elif kind == "flip" and at < len(data):
            data = data[:at] + bytes([data[at] ^ 1 << what]) + data[at + 1 :]
        elif kind == "cut":
            data = data[:at] + data[at + what :]
        elif kind == "insert":
            data = data[:at] + what + data[at:]
        elif kind == "double":
            data = data[: at + what] + data[at:]
        elif kind == "nest":
            data = data[:at] + 20_000 * what + data[at:]
        elif kind == "end":
            data = data[:at]
        elif kind == "number" and (found := re.compile(rb"[-+]?\d[\d.e+]*").search(data, at)):
            data = data[: found.start()] + what.encode() + data[found.end() :]
    return data


def mutated(form: Format, rng: random.Random) -> bytes:
    """The valid file after one to five other pieces of damage, three in four of them behind the header."""
    data = bytearray(form.valid)
    kinds = [_counted, _exchanged, _overwritten, _filled, _joined] + ([_words, _lines] * 2 if form.text else [])
    for _ in range(rng.choice((1, 1, 2, 5))):
        first = min(form.header, len(data) - 1) if rng.random() < 0.75 else 0
        if len(data) - first > 1:
            rng.choice(kinds)(data, first, rng)
    return bytes(data)


def _counted(data: bytearray, first: int, rng: random.Random) -> None:
    """A number in binary, a little larger or smaller, or at the edge of what it holds."""
    size = min(rng.choice((1, 2, 4, 8)), len(data) - first)
    at, order, most = rng.randint(first, len(data) - size), rng.choice(("little", "big")), 1 << 8 * size
    held = int.from_bytes(data[at : at + size], order) + rng.randint(-35, 35)
    held = rng.choice((held, held, held, most // 2, most // 2 - 1, most - 1))
    data[at : at + size] = (held % most).to_bytes(size, order)


def _exchanged(data: bytearray, first: int, rng: random.Random) -> None:
    size = rng.randint(1, min(64, (len(data) - first) // 2))
    one, other = (rng.randint(first, len(data) - size) for _ in range(2))
    data[one : one + size], data[other : other + size] = data[other : other + size], data[one : one + size]


def _overwritten(data: bytearray, first: int, rng: random.Random) -> None:
    """A part by another part of the file, which stays where it is as well."""
    size = rng.randint(1, min(256, len(data) - first))
    to, taken = rng.randint(first, len(data) - size), rng.randint(0, len(data) - size)
    data[to : to + size] = data[taken : taken + size]


def _filled(data: bytearray, first: int, rng: random.Random) -> None:
    size = rng.randint(1, min(rng.choice((8, 512)), len(data) - first))
    at = rng.randint(first, len(data) - size)
    data[at : at + size] = bytes([rng.choice((0, 1, 0x20, 0x7F, 0x80, 0xFF))]) * size


def _joined(data: bytearray, first: int, rng: random.Random) -> None:
    """The file up to a place, and from another place on."""
    end, start = rng.randint(first, len(data)), rng.randint(0, len(data))
    data[end:] = data[start:] or b"\0"


def _lines(data: bytearray, first: int, rng: random.Random) -> None:
    """A line gone, doubled, or in another's place."""
    lines = bytes(data).split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [lines[other]], [lines[at] + lines[other]]))
    data[:] = b"\n".join(lines) or b"\n"


def _words(data: bytearray, first: int, rng: random.Random) -> None:
    """A word or a number in another's place."""
    words = list(re.finditer(rb"[\w.+-]+", data))
    if words:
        one, other = rng.choice(words), rng.choice(words).group()
        data[one.start() : one.end()] = rng.choice((other, other, other, other * 40, rng.choice(EXTREME).encode()))


class Result(NamedTuple):
    """What came of the files of one format."""

    name: str
    files: int = 0
    past_header: int = 0
    read: int = 0  # without an error
    slowest: float = 0.0  # [s of processor time]
    memory: float = 0.0  # that the process took more than before [MB]
    failure: str = ""  # the crash, the hang, or the error that is none of ours

    def __str__(self) -> str:
        return (
            f"{self.name:20} {self.files:8} files, {self.past_header:8} with a whole header, {self.read:8} read, "
            f"slowest {self.slowest:5.2f} s, {self.memory:4.0f} MB{'  FAILED' if self.failure else ''}"
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


def run(count: int, number: int, only: str | None = None, *, plain: bool = False) -> Iterator[Result]:
    """Read `count` damaged files in all, and those that did harm before; each format in a process of its own.

    They are damaged by Hypothesis, or by `mutated` where `plain`.
    """
    with tempfile.TemporaryDirectory() as text:
        every = formats(Path(text))
        share = count / sum(1 / form.rarely for form in every)
        gc.freeze()  # no process collects, and so copies, what all were started with
        for form in every:
            if only in (None, form.name):
                wanted = count if only else int(share / form.rarely) + 1
                yield _in_child(form, wanted, number, Path(text), plain)


def _in_child(form: Format, count: int, number: int, folder: Path, plain: bool) -> Result:
    """What a process finds that may crash."""
    ours, its = os.pipe()
    process = os.fork()
    if not process:
        try:
            told = _tried(form, count, number, folder, plain)
            os.write(its, json.dumps(told).encode())
        finally:
            os._exit(0)
    os.close(its)
    with open(ours, "rb") as pipe:
        told = pipe.read()
    _, status = os.waitpid(process, 0)
    if told:
        return Result(*json.loads(told))
    return Result(form.name, failure=f"its process ended with {os.waitstatus_to_exitcode(status)}: a crash")


def _tried(form: Format, count: int, number: int, folder: Path, plain: bool) -> Result:
    def too_long(*_: object) -> None:
        raise TimeoutError(f"a reader took more than {SECONDS} s, or waited for {WAIT} s")

    for kind in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(kind, too_long)
    tried, failure = Tried(form, folder), ""
    try:
        tried(form.valid)  # what is loaded with the first file is not the file's doing
        if not tried.read:
            raise RuntimeError("the valid file is refused")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_AS, (_address_space() + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
        for data in form.found:
            tried(data)
        (_check_plain if plain else _check)(form, count, number, tried)
    except BaseException:
        failure = traceback.format_exc()[-4000:]
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return Result(form.name, tried.files, tried.past_header, tried.read, tried.slowest, grown, failure)


def _check(form: Format, count: int, number: int, tried: Tried) -> None:
    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged(form))
    def read(data: bytes) -> None:
        tried(data)

    read()


def _check_plain(form: Format, count: int, number: int, tried: Tried) -> None:
    rng = random.Random(f"{number} {form.name}")
    for _ in range(count):
        data = mutated(form, rng)
        try:
            tried(data)
        except BaseException as error:
            kept = KEPT / f"{hashlib.sha256(data).hexdigest()[:12]}{form.suffix}"
            KEPT.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(data)
            raise RuntimeError(f"it failed on {kept}") from error


def _processor_seconds() -> float:
    """That this process and those that it started took so far."""
    return sum(os.times()[:4])


def _address_space() -> int:
    """Bytes of address space that the process has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="the name of one format, which gets all files")
    parser.add_argument("--plain", action="store_true", help="other damage, without Hypothesis: faster")
    arguments = parser.parse_args()
    logging.disable()  # what was repaired
    results = []
    for result in run(arguments.count, arguments.seed, arguments.only, plain=arguments.plain):
        results.append(result)
        sys.stdout.write(f"{result}\n{result.failure}")
        sys.stdout.flush()
    files, past = sum(r.files for r in results), sum(r.past_header for r in results)
    failed = [result.name for result in results if result.failure]
    sys.stdout.write(
        f"{files} files of {len(results)} formats, {past} past the header ({100 * past / max(files, 1):.0f} %), "
        f"{len(failed)} crashes, hangs or other errors; slowest {max((r.slowest for r in results), default=0):.2f} s, "
        f"most memory {max((r.memory for r in results), default=0):.0f} MB\n"
    )
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
