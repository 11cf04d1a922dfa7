"""Damaged files against every reader, 2 000 of each format, and all that did harm before.

Of the formats whose files take longest it is 100 to 1000. `make fuzz` tries as many as one likes.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).parents[1] / "fuzz" / "parsers.py"


def tried(*arguments):
    """How many files of how many formats were read, and how many had a whole header; none did harm."""
    done = subprocess.run([sys.executable, FUZZ, *arguments], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = re.search(r"^(\d+) files of (\d+) formats, (\d+) past the header", done.stdout, re.MULTILINE)
    return tuple(map(int, told.groups()))


@pytest.mark.first
def test_no_reader_crashes_hangs_or_takes_all_memory():
    """In processes of their own, which a crash would end."""
    files, formats, past = tried("--each", "2000")
    assert formats >= 49
    assert files >= 2000 * (formats - 4)
    assert past >= files / 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["network", "checkpoint", "released", "released before"])
def test_no_reader_of_weights_does(name):
    """Those formats need onnx and torch, without which the test above leaves them out."""
    pytest.importorskip("onnx", reason="onnx is not installed: make setup-train")
    pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    files, formats, _ = tried("--each", "300", "--only", name)
    assert formats == 1
    assert files >= 75
