"""Damaged files against every reader, 2 000 of each format, and all that did harm before.

Of the three formats whose files take longest it is 100 to 250. `make fuzz` tries as many as one likes.
"""

import re
import subprocess
import sys
from pathlib import Path

FUZZ = Path(__file__).parents[1] / "fuzz" / "parsers.py"


def test_no_reader_crashes_hangs_or_takes_all_memory():
    """In processes of their own, which a crash would end."""
    done = subprocess.run(
        [sys.executable, FUZZ, "--each", "2000"], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    told = re.search(r"^(\d+) files of (\d+) formats, (\d+) past the header", done.stdout, re.MULTILINE)
    files, formats, past = map(int, told.groups())
    assert formats >= 49
    assert files >= 2000 * (formats - 3)
    assert past >= files / 2
