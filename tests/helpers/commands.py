"""The command line as a user meets it: in a process of its own, or quicker within this one."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import typer
from typer.testing import CliRunner

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


def run_here(*arguments):
    """Run it within this process: as `run`, and the error that `millisight` would print."""
    done = CliRunner().invoke(app, list(map(str, arguments)))
    if isinstance(done.exception, MillisightError):
        return 1, done.stdout, done.stderr, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stdout, done.stderr, ""


def refused(*arguments, cwd, **settings):
    """The one line on standard error of a command that must fail and write nothing new."""
    before = sorted(p.name for p in cwd.iterdir())
    code, _, err = run(*arguments, cwd=cwd, **settings)
    lines = [line for line in err.splitlines() if line.startswith("millisight: ")]
    assert code == 1, err
    assert len(lines) == 1, err
    assert "Traceback" not in err
    assert sorted(p.name for p in cwd.iterdir()) == before
    return lines[0]


def refused_here(*arguments):
    """As `refused`, within this process and the folder that it is in."""
    before = sorted(p.name for p in Path.cwd().iterdir())
    code, out, err, error = run_here(*arguments)
    assert code == 1, out + err
    assert error
    assert "\n" not in error
    assert sorted(p.name for p in Path.cwd().iterdir()) == before
    return error
