"""Shared by the commands: lengths with units, checks of outputs, progress, and how a command ends."""

import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from millisight.cli import interrupts
from millisight.core import FIGURE_SUFFIXES, check_writable, printable, same_file
from millisight.core.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from millisight.imaging import Sampling

_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "": 1.0}
_METRES = 2.0  # a bare number of this size is likely to mean something else
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

Progress = Callable[[int, int], None]


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


def check_outputs(*paths: Path | None, figures: tuple[Path | None, ...] = (), source: Path | None = None) -> None:
    """Check before the work that its outputs can be written.

    Refused are: the `source` itself, one file twice, a missing folder, an unknown figure format.

    Raises
    ------
    FileError, InputError, UnknownNameError
    """
    outputs = [path for path in (*paths, *figures) if path is not None]
    for path in outputs:
        if source is not None and os.path.exists(source) and same_file(path, source):
            raise InputError(f"{path} is the input and would be overwritten; choose another name for the output")
    for one, other in combinations(outputs, 2):
        if same_file(one, other):
            raise InputError(f"{one} is given for two outputs; choose two names")
    for path in (*paths, *figures):
        if path is not None:
            check_writable(path)
    for figure in figures:
        if figure is not None and figure.suffix.lower() not in FIGURE_SUFFIXES:
            raise UnknownNameError("figure format", figure.suffix or figure.name, FIGURE_SUFFIXES)


def say(line: str) -> None:
    """Print one line, never wrapped."""
    typer.echo(printable(line))


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
            typer.echo(f"  {line}", err=True)
        raise typer.Exit(1)


def in_options(message: str) -> str:
    """A message of the library with argument names replaced by option names."""
    return re.sub(r"\b(unit)=(?:'(\w+)'|\.\.\.)", lambda m: f"--{m[1]} {m[2] or m[1].upper()}", message)


@contextmanager
def progress(label: str, *, compiles: bool = True) -> Iterator[Progress]:
    """A call-back that shows progress: a bar with the time left on a terminal, else a plain line every 10 s.

    `compiles`: whether the work runs kernels, which are compiled at their first use.
    """
    started = time.monotonic()
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
        spoken = started

        def report(done: int, total: int) -> None:
            nonlocal spoken
            interrupts.check()
            now = time.monotonic()
            if done < total and now - spoken > 10:
                spoken = now
                left = (now - started) * (total - done) / done
                typer.echo(f"{label}: {100 * done // total} %, about {left:.0f} s left", err=True)

        yield report
    interrupts.check()
    typer.echo(f"{label}: {time.monotonic() - started:.1f} s", err=True)


def kernels_cached() -> bool:
    """Whether the compiled kernels are in Numba's cache."""
    from millisight.core import is_kept
    from millisight.simulation import node_signals

    return is_kept(node_signals)
