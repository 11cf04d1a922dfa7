"""Shared by the commands: lengths with units, checks of outputs, progress, and how a command ends."""

import functools
import inspect
import json
import os
import re
import select
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from millisight.cli import interrupts
from millisight.core import printable
from millisight.core.errors import DeviceError, InputError

if TYPE_CHECKING:
    from millisight.imaging import Sampling

_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "": 1.0}
WARNING = "warning: "

_METRES = 2.0  # a bare number of this size is likely to mean something else
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

Progress = Callable[[int, int], None]


@dataclass
class _Talk:
    """What the command that runs now prints besides what it was asked for."""

    quiet: bool = False  # nothing but warnings and errors
    aside: bool = False  # on standard error: standard output holds a JSON document
    counted: dict[str, int] | None = None  # warnings that are summed up, and how often each came
    given: list[Any] = field(default_factory=list)  # arguments of it that may be read
    read: list[tuple[str, Path]] | None = None  # what those have it read: what it is, the file; None: not yet known
    written: set[str] = field(default_factory=set)  # what it has been to write so far
    claims: ExitStack = field(default_factory=ExitStack)  # on what it writes: another run may not write that as well


_talk = _Talk()
OUTPUTS = ("depth", "fit", "html", "output", "placed", "plot", "points", "screenshot", "slices")
"""Parameters of commands that name what is written; all others may name what is read."""


class Commands(typer.Typer):
    """A Typer application whose commands each have one option more: -q, --quiet."""

    def command(self, *names: Any, **settings: Any) -> Callable[[Any], Any]:
        register = super().command(*names, **settings)

        def added(function: Any) -> Any:
            register(_with_quiet(function))
            return function

        return added


def _with_quiet(function: Any) -> Any:
    """The function of a command, with the option; Typer reads its signature."""
    about = "Print no progress and no information: only results asked for, warnings and errors."
    kind = Annotated[bool, typer.Option("-q", "--quiet", help=about)]

    @functools.wraps(function)
    def run(*arguments: Any, quiet: bool = False, **options: Any) -> Any:
        _talk.quiet = quiet
        _talk.given = [value for name, value in options.items() if name not in OUTPUTS]
        try:
            return function(*arguments, **options)
        except BrokenPipeError as error:
            if not _unread():
                raise DeviceError("a pipe or a connection to another process broke; run the command again") from error
            raise  # whoever read what is printed has ended, which is no error
        finally:
            _talk.claims.close()
            _talk.quiet, _talk.given, _talk.read = False, [], None
            _talk.written.clear()

    signature, command = inspect.signature(function), cast("Any", run)
    added = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), added])
    command.__annotations__ = {**function.__annotations__, "quiet": kind}
    return command


def files_given(read_with: Callable[[Path], Sequence[Path]]) -> Sequence[tuple[str, Path]]:
    """What the command that runs now reads, but for its outputs: what it is, and the file or folder.

    Parameters
    ----------
    read_with : of a file among the arguments, what is read along with it; asked once a command
    """
    if _talk.read is None:
        _talk.read = []
        for value in _talk.given:
            for one in value if isinstance(value, list | tuple) else (value,):
                if isinstance(one, str | Path) and os.path.exists(one):
                    _talk.read.append(("an input, too,", Path(one)))
                    _talk.read.extend((f"read with {one}", path) for path in read_with(Path(one)))
    return _talk.read


def claims() -> ExitStack:
    """Claims of the command that runs now on what it writes; they end with it."""
    return _talk.claims


def written_before(path: Path) -> bool:
    """Whether the command that runs now was to write this file already; it is now."""
    place = os.path.realpath(path)
    before = place in _talk.written
    _talk.written.add(place)
    return before


def _unread() -> bool:
    """Whether nobody reads what this process prints any more."""
    if not hasattr(select, "poll"):  # as on Windows
        return True
    streams = select.poll()
    for number in (1, 2):
        streams.register(number, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in streams.poll(0))


@contextmanager
def json_only(active: bool) -> Iterator[None]:
    """While it lasts, standard output is for the JSON document: `say` prints on standard error."""
    _talk.aside = active
    try:
        yield
    finally:
        _talk.aside = False


def answer(line: str) -> None:
    """Print a line that the user asked for, with --quiet, too."""
    typer.echo(_one_line(line))


def complain(line: str) -> None:
    """Print an error on standard error while the work goes on."""
    typer.echo(f"millisight: {_one_line(line)}", err=True)


def _one_line(text: str) -> str:
    """A text as any terminal can hold it, on one line whatever the names of files in it are."""
    return printable(text).replace("\n", "\\n")


def answer_table(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of cells in columns; the first row is the header."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        answer("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def answer_json(document: Any) -> None:
    """Print the one JSON document of a command."""
    typer.echo(json.dumps(document, indent=2, default=_plain))


def _plain(value: Any) -> Any:
    """What JSON has no type for: paths, and numbers and arrays of NumPy."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


SMALL = 0.1
"""Steps, spacings and distances between points are no larger than this [m]: a bare 2 does not mean metres."""


def length(text: str, *, option: str, metres: float = _METRES) -> float:
    """Parse a length such as 2mm, 1.5cm, 0.3m or 0.3; returns metres.

    Parameters
    ----------
    text : length
    option : its option, for messages
    metres : of this size or more, a number without a unit is refused

    Raises
    ------
    InputError
        It is not a length, or it is large and has no unit.
    """
    match = re.fullmatch(rf"({_NUMBER})\s*(m|cm|mm|)", text.strip())
    if not match:
        raise InputError(f"{option} is {text!r}; expected a length such as 2mm, 30cm or 0.3 (metres)")
    return _metres(match[1], match[2], option, metres)


def optional_length(text: str | None, *, option: str, metres: float = _METRES) -> float | None:
    """As `length`; None where the option is not given."""
    return None if text is None else length(text, option=option, metres=metres)


def _metres(number: str, unit: str, option: str, metres: float = _METRES) -> float:
    if not unit and abs(float(number)) >= metres:
        raise InputError(f"{option} is {number} without a unit; which is meant: {number}mm, {number}cm or {number}m?")
    return float(number) * _UNITS[unit]


def size(text: str, *, option: str) -> tuple[float, float]:
    """Parse a size along x and y such as 30x22cm or 0.3x0.22; returns metres.

    Raises
    ------
    InputError
        As `length`.
    """
    match = re.fullmatch(rf"({_NUMBER})\s*[x×]\s*({_NUMBER})\s*(m|cm|mm|)", text.strip())
    if not match:
        raise InputError(f"{option} is {text!r}; expected a size along x and y such as 30x22cm or 0.3x0.22 (metres)")
    return _metres(match[1], match[3], option), _metres(match[2], match[3], option)


def slices(text: str, *, option: str) -> tuple[int, int]:
    """Parse `12,7`: the number of lowest and of highest slices to drop.

    Raises
    ------
    InputError
    """
    parts = text.split(",")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise InputError(f"{option} is {text!r}; expected two whole numbers such as 12,7")
    return int(parts[0]), int(parts[1])


def say(line: str) -> None:
    """Print one line of information, never wrapped; not with --quiet. A line with "warning: " is a warning."""
    if line.startswith(WARNING):
        warn(line.removeprefix(WARNING))
    elif not _talk.quiet:
        typer.echo(_one_line(line), err=_talk.aside)


def warn(text: str) -> None:
    """Print a warning, with --quiet on standard error; within `summed_up` once, and how often it came at the end."""
    if _talk.counted is not None:
        _talk.counted[text] = _talk.counted.get(text, 0) + 1
        if _talk.counted[text] > 1:
            return
    typer.echo(_one_line(WARNING + text), err=_talk.quiet or _talk.aside)


@contextmanager
def summed_up(what: str) -> Iterator[None]:
    """While it lasts, equal warnings are printed once; at the end a line says how many of `what` gave each."""
    _talk.counted = counted = {}
    try:
        yield
    finally:
        _talk.counted = None
        for text, count in counted.items():
            if count > 1:
                warn(f"{text} ({count} {what})")


def say_sampling(sampled: "Sampling", of: str = "sampling") -> None:
    """Print the steps of a scan, and the ghosts that they give."""
    say(f"{of}: {sampled.text}")
    for warning in sampled.warnings:
        say(f"warning: {warning}")


def duration(seconds: float) -> str:
    """A time in seconds, minutes or hours."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def end_with_failures(lines: Sequence[str]) -> None:
    """Print each failure on a line and exit with code 1; do nothing without failures."""
    if lines:
        typer.echo(f"failed: {len(lines)}", err=True)
        for line in lines:
            typer.echo(f"  {_one_line(line)}", err=True)
        raise typer.Exit(1)


def in_options(message: str) -> str:
    """A message of the library with argument names replaced by option names."""
    named = r"""\b(unit|condition|device|method)=(?:['"](\w+)['"]|\.\.\.)"""
    return re.sub(named, lambda m: f"--{m[1]} {m[2] or m[1].upper()}", message)


@contextmanager
def progress(label: str, *, compiles: bool = True) -> Iterator[Progress]:
    """A call-back that shows progress: a bar with the time left on a terminal, else a plain line every 10 s.

    `compiles`: whether the work runs kernels, which are compiled at their first use.
    """
    started = time.monotonic()
    if _talk.quiet:
        yield lambda done, total: interrupts.check()
        interrupts.check()
        return
    label_now = label if not compiles or kernels_cached() else f"{label} (first use: compiling, about half a minute)"
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label_now, total=None)

            def show(done: int, total: int) -> None:
                interrupts.check()
                bar.update(task, completed=done, total=total, description=label)

            yield show
    else:
        if label_now != label:
            typer.echo(label_now, err=True)
        spoken, first = started, None

        def report(done: int, total: int) -> None:
            nonlocal spoken, first
            interrupts.check()
            now = time.monotonic()
            first = first or (now, done)  # what came before may be the kernels' compilation
            if done < total and now - spoken > 10:
                spoken = now
                pace = (now - first[0]) / (done - first[1]) if done > first[1] else None
                left = "" if pace is None else f", about {pace * (total - done):.0f} s left"
                typer.echo(f"{label}: {100 * done // total} %{left}", err=True)

        yield report
    interrupts.check()
    typer.echo(f"{label}: {time.monotonic() - started:.1f} s", err=True)


def kernels_cached() -> bool:
    """Whether the compiled kernels are in Numba's cache."""
    from millisight.core import is_kept
    from millisight.simulation import node_signals

    return is_kept(node_signals)
