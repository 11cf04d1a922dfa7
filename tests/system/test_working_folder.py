"""A folder with files from strangers: nothing in it is obeyed, whatever it is called."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import millisight as ms
from helpers.small_records import small_capture

SOURCES = Path(ms.__file__).parent
COMMAND = [sys.executable, "-P", "-m", "millisight.cli.main"]


@pytest.mark.slow
@pytest.mark.parametrize("config", ["cache_dir: kept\nnum_threads: 99999\ndisable_jit: 1\n", "{"])
def test_settings_of_libraries_there_are_not_obeyed(config, tmp_path):
    """Numba would run the compiled code that it finds in a folder named there."""
    (tmp_path / ".numba_config.yaml").write_text(config)
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nimage.cmap: nope\npath.effects: x\n")
    for name in ("numpy.py", "millisight.py", "yaml.py", "sitecustomize.py"):
        (tmp_path / name).write_text("raise SystemExit('code was run')")
    ms.save(tmp_path / "c.capture.h5", small_capture())
    options = ("--grid", "0cm:3cm:1cm,0cm:3cm:1cm,-21cm:-20cm:1cm", "-o", "i.image.h5", "--plot", "p.png")
    done = subprocess.run(
        [*COMMAND, "image", "c.capture.h5", *options], cwd=tmp_path, capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    assert not re.search("Traceback|Warning", done.stderr)
    assert (tmp_path / "p.png").stat().st_size > 10_000
    assert not (tmp_path / "kept").exists()


@pytest.mark.slow
def test_settings_that_come_later_are_not_obeyed_either(tmp_path):
    """Numba reads them anew whenever it compiles."""
    program = (
        "import os, sys; from millisight.core import numba, product; os.chdir(sys.argv[1]);"
        "f = numba.njit(lambda x: x + 1); assert f(1) == 2; print(repr(numba.config.CACHE_DIR))"
    )
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: kept\n")
    done = subprocess.run([sys.executable, "-c", program, tmp_path], capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stdout) == (0, "''\n"), done.stderr


def test_numba_is_imported_in_one_place():
    """Elsewhere it would be imported first, with the file."""
    own = SOURCES / "core" / "_numba.py"
    pattern = re.compile(r"^(?:import numba|from numba)\b", re.MULTILINE)
    assert [path for path in SOURCES.rglob("*.py") if path != own and pattern.search(path.read_text())] == []
