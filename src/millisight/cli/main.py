"""The command `millisight`: where it starts and how it ends; errors become one line. The commands are in `app`."""

import io
import os
import re
import sys
import threading

from millisight.cli import interrupts

GO_ON = (
    "dataset convert", "dataset download", "dataset push", "evaluate classification", "evaluate pose",
    "evaluate segmentation", "evaluate simulator", "evaluate surface", "generate", "train classifier", "train released",
    "train segmenter",
)  # fmt: skip
"""Commands whose next run continues where this one stopped."""

_MANY_PROCESSES, _THREADS = 1000, 40  # a limit that need not be tried; what workers and libraries take
_LAYERS = ("default", "safe", "forksafe", "threadsafe", "tbb", "omp", "workqueue")
_LEAST_ADDRESSES = 1_000_000_000  # [bytes] with fewer, libraries cannot be opened, or end the process
_LEAST_DATA = 600_000_000  # [bytes] of these that are written to
_MOST_THREADS = 1024  # more than machines have cores; with some ten thousand, Numba ends the process


def run() -> None:
    """Run the command line. Exit codes: 1 for an error, printed on one line; 130 for Ctrl-C; 143 for SIGTERM."""
    try:
        interrupts.listen()  # before anything else, since imports take half a second
        _open_streams()
        _check_environment()
        _check_threads()
        _check_limits()
        from millisight.cli.commands import application

        application(*sys.argv[1:])()
    except BaseException as error:
        interrupts.stop_listening()
        line, code = _ending(error)
        if not line:
            raise
        from millisight.core import printable

        print("millisight: " + printable(" ".join(line.split())), file=sys.stderr)  # noqa: T201
        sys.exit(code)


def _open_streams() -> None:
    """Let the standard streams that the shell closed, as `2>&-` does, lead nowhere.

    Else the next file that is opened takes the number of one, and what a library prints goes into it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            place = os.open(os.devnull, os.O_RDWR)
            if place != number:
                os.dup2(place, number)
                os.close(place)
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):  # what an encoding has no letter for is written as an escape
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _check_environment() -> None:
    """Refuse settings of Numba that it cannot be imported with, and put aside those of Matplotlib that no figure needs.

    Raises
    ------
    InputError
    """
    for name, allowed in (("NUMBA_DISABLE_JIT", ("0",)), ("NUMBA_THREADING_LAYER", _LAYERS)):
        if os.environ.get(name, allowed[0]).strip() not in allowed:
            from millisight.core import printable
            from millisight.core.errors import InputError

            raise InputError(
                f"{name} is {printable(os.environ[name]) or 'empty'}; expected {' or '.join(allowed)}, or none at all"
            )
    os.environ["MPLBACKEND"] = "agg"  # no window is opened
    os.environ.pop("SOURCE_DATE_EPOCH", None)  # no date is written


def _check_threads() -> None:
    """Refuse a number of threads at which Numba cannot be imported, ends the process, or warns at length.

    Raises
    ------
    InputError
    """
    given = os.environ.get("NUMBA_NUM_THREADS", "1").strip()
    number = int(given) if re.fullmatch(r"[+]?[0-9]{1,9}", given) else 0
    if not 1 <= number <= _MOST_THREADS:
        from millisight.core import printable
        from millisight.core.errors import InputError

        shown = printable(given if len(given) <= 20 else f"{given[:20]}...") or "empty"
        raise InputError(
            f"NUMBA_NUM_THREADS is {shown}; expected a whole number of at least 1, and at most {_MOST_THREADS}: set it "
            "to the number of cores to use, or remove it from the environment"
        )


def _check_limits() -> None:
    """Refuse limits of this process under which libraries fail to open, end the process, or wait without end.

    Raises
    ------
    InputError
    """
    try:
        import resource
    except ImportError:  # not on Windows
        return
    from millisight.core.errors import InputError

    for what, least, letter in (
        (resource.RLIMIT_AS, _LEAST_ADDRESSES, "v"),
        (resource.RLIMIT_DATA, _LEAST_DATA, "d"),
    ):
        memory = resource.getrlimit(what)[0]
        if memory != resource.RLIM_INFINITY and memory < least:
            raise InputError(
                f"this process may have {memory / 1e6:.0f} MB of memory; expected {least / 1e6:.0f} MB or more: "
                f"raise the limit, as by ulimit -{letter} unlimited"
            )
    processes = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    if processes != resource.RLIM_INFINITY and processes < _MANY_PROCESSES and not _threads_start(_THREADS):
        raise InputError(
            f"this process may not start {_THREADS} threads more: its user may have {processes} processes; raise the "
            "limit, as by ulimit -u 4096, or end other programs"
        )


def _threads_start(count: int) -> bool:
    """Whether so many threads can be started; they end at once."""
    end, started = threading.Event(), []
    try:
        for _ in range(count):
            one = threading.Thread(target=end.wait)
            one.start()
            started.append(one)
    except RuntimeError:
        return False
    finally:
        end.set()
        for one in started:
            one.join()
    return True


def _ending(error: BaseException) -> tuple[str, int]:
    """The line to print for an exception, and the exit code; an empty line: raise it."""
    if interrupts.received() and not isinstance(error, SystemExit):
        # Whatever was raised: an interrupted import, for one, may end in an ImportError.
        line = "interrupted; unfinished files were discarded, earlier files are unchanged"
        if " ".join(sys.argv[1:3]).startswith(GO_ON):
            line += "; run the same command again to continue"
        return line, 128 + interrupts.received()
    from millisight.cli.console import in_options
    from millisight.core.errors import MillisightError

    if isinstance(error, MillisightError):
        return in_options(str(error)), 1
    if isinstance(error, ImportError) and "pip install" in str(error):  # an extra that is missing
        return str(error), 1
    unmapped = isinstance(error, ImportError) and re.search("failed to map|annot allocate memory", str(error))
    if isinstance(error, MemoryError) or unmapped:
        reason = f": {error}" if str(error) else ""
        return f"not enough memory{reason}; use a coarser grid, fewer positions, or a larger machine", 1
    if isinstance(error, FileNotFoundError) and not error.filename:
        return "the folder that this command was started in is no longer there; change to another one", 1
    if isinstance(error, OSError):
        return f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}", 1
    return "", 1


if __name__ == "__main__":
    run()
