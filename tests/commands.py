"""The command line in a process of its own, as a user meets it."""

import subprocess
import sys


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
