"""The command line as a user meets it: in a process of its own, or quicker within this one."""

import signal
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import typer
from typer.testing import CliRunner

from millisight.cli import main
from millisight.cli.app import app
from millisight.core.errors import MillisightError


def _commands(name, command):
    yield name, command
    for part, inner in getattr(command, "commands", {}).items():
        yield from _commands(f"{name} {part}", inner)


COMMANDS: dict[str, Any] = dict(_commands("millisight", typer.main.get_command(app)))
"""Each by its words."""


def run(*arguments, cwd, timeout=240, **settings):
    """Run the command in its own process; returns exit code, standard output, standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "millisight.cli.main", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout,
        **settings,
    )
    return done.returncode, done.stdout, done.stderr


def run_inside(*arguments, cwd):
    """As `run`, but within this process, a second quicker: all that the command does, from its first line to its last.

    What only a process has is not tried: its imports, signals from outside, its standard streams.
    """
    out, err, code = StringIO(), StringIO(), 0
    numbers = (signal.SIGINT, signal.SIGTERM)
    handlers, hook = [signal.getsignal(number) for number in numbers], sys.unraisablehook
    try:
        with (
            chdir(cwd), redirect_stdout(out), redirect_stderr(err),
            patch.object(sys, "argv", ["millisight", *map(str, arguments)]),
        ):  # fmt: skip
            main.run()
    except SystemExit as end:
        code = end.code or 0
    finally:
        sys.unraisablehook = hook
        for number, handler in zip(numbers, handlers, strict=True):
            signal.signal(number, handler)
    return code, out.getvalue(), err.getvalue()


def run_here(*arguments, defaults=None):
    """Run it within this process: as `run`, and the error that `millisight` would print.

    `defaults`: of options that are not given, by command and option.
    """
    # Typer would build all commands anew for each run, which takes longer than most of the runs.
    with patch("typer.testing._get_command", lambda _: COMMANDS["millisight"]):
        done = CliRunner().invoke(app, list(map(str, arguments)), default_map=defaults)
    if isinstance(done.exception, MillisightError):
        return 1, done.stdout, done.stderr, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stdout, done.stderr, ""


def refused(*arguments, cwd=".", **settings):
    """The one line on standard error of a command that must fail and write nothing new.

    With settings, such as an environment, it runs in its own process; else within this one.
    """
    before = sorted(p.name for p in Path(cwd).iterdir())
    code, _, err = run(*arguments, cwd=cwd, **settings) if settings else run_inside(*arguments, cwd=cwd)
    lines = [line for line in err.splitlines() if line.startswith("millisight: ")]
    assert code == 1, err
    assert len(lines) == 1, err
    assert "Traceback" not in err
    assert sorted(p.name for p in Path(cwd).iterdir()) == before
    return lines[0]
