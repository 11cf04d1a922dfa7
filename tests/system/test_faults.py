"""A command that is broken off as it writes, at some of its steps; `make faults` tries all commands at every step."""

import re
import subprocess
import sys
from pathlib import Path

FAULTS = Path(__file__).parents[1] / "faults.py"


def test_what_is_broken_off_leaves_nothing_and_is_gone_on_with():
    done = subprocess.run(
        [sys.executable, FAULTS, "segment", "--every", "3"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"\d+ steps, \d+ runs broken off, all gone on with, same outputs", done.stdout)) == 1
    assert int(re.search(r"^(\d+) runs broken off", done.stdout, re.MULTILINE)[1]) >= 12
