"""What is kept of compiled kernels: taken where it is sound, made anew where it is not."""

import os
import shutil
import subprocess
import sys

import pytest

KERNEL = """
from millisight.core import kernel, serial
from numba import prange


@serial()
def one_more(x):
    return x + 1.0


@kernel()
def total(x):
    held = 0.0
    for i in prange(len(x)):
        held += one_more(x[i])
    return held
"""
SERIAL = """
from millisight.core import serial


@serial()
def total(x):
    return x + 6.0
"""
"""Its files are kept and looked at alike, and it is compiled in a fraction of the time, without an array even."""
COMMAND = """
import sys
import numpy as np
for folder in sys.argv[1:]:
    sys.path.insert(0, folder)
    import small_kernels
    given = np.arange(4.0) if hasattr(small_kernels, "one_more") else 4.0
    print(small_kernels.total(given), sum(small_kernels.total.stats.cache_hits.values()))
    sys.path.remove(folder)
    del sys.modules["small_kernels"]
"""
SHUT = os.path.join(os.devnull, "home")  # where nobody, not even root, can make a folder


def run(*folders, **variables):
    """The answers of the kernels in these folders in a process of its own, and which were kept by an earlier one."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    settings = {**environment, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_NUM_THREADS": "1", **variables}
    command = [sys.executable, "-W", "error", "-c", COMMAND, *map(str, folders)]
    done = subprocess.run(command, cwd=folders[0], env=settings, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    answers, hits = zip(*map(str.split, done.stdout.splitlines()), strict=True)
    assert answers == ("10.0",) * len(folders)
    return [hit == "1" for hit in hits]


def damaged(path, how):
    held = path.read_bytes()
    if how == "folder":
        path.unlink()
        path.mkdir()
        return
    middle = len(held) // 2
    content = {
        "empty": b"",
        "cut": held[:middle],
        "flipped": held[:middle] + bytes([held[middle] ^ 1]) + held[middle + 1 :],
        "noise": bytes(range(256)) * 8,
        "zeros": bytes(len(held)),
    }[how]
    path.write_bytes(content)


@pytest.mark.slow
def test_a_damaged_cache_is_made_anew(tmp_path):
    """The kernels lie in a folder for each damage, so that three processes see all of them."""
    whole = tmp_path / "whole"
    whole.mkdir()
    (whole / "small_kernels.py").write_text(SERIAL)
    assert run(whole) == [False]
    folders = {}
    for kind in ("nbi", "nbc"):
        for how in ("empty", "cut", "flipped", "noise", "zeros", "folder"):
            folders[kind, how] = shutil.copytree(whole, tmp_path / f"{kind} {how}")
            files = [path for path in folders[kind, how].rglob(f"*.{kind}") if "total" in path.name]
            assert len(files) == 1
            damaged(files[0], how)
    assert dict(zip([None, *folders], run(whole, *folders.values()), strict=True)) == {
        None: True, **dict.fromkeys(folders, False)
    }  # fmt: skip
    # What is a folder now can be replaced by nothing: it is compiled in every process.
    kept = [folder for (_, how), folder in folders.items() if how != "folder"]
    assert run(*kept) == [True] * 10


@pytest.mark.slow
def test_without_a_home_the_second_process_starts_at_once(tmp_path):
    (tmp_path / "small_kernels.py").write_text(KERNEL)
    (tmp_path / "__pycache__").write_text("no folder")
    (tmp_path / "tmp").mkdir()
    shut = {"HOME": SHUT, "XDG_CACHE_HOME": SHUT, "TMPDIR": str(tmp_path / "tmp"), "PYTHONDONTWRITEBYTECODE": "1"}
    assert [*run(tmp_path, **shut), *run(tmp_path, **shut)] == [False, True]
    (folder,) = (tmp_path / "tmp").glob("millisight-kernels*")
    assert folder.stat().st_mode & 0o777 == 0o700
    # Not taken from a folder into which others may write: what is in it is run.
    folder.chmod(0o777)
    assert run(tmp_path, **shut) == [False]
    assert run(tmp_path, **{**shut, "TMPDIR": SHUT}) == [False]


TOGETHER = """
import pathlib, sys, time
import numpy as np
from numba.core.event import install_recorder
sys.path.insert(0, ".")
import small_kernels

pathlib.Path(sys.argv[1]).touch()
while len(list(pathlib.Path().glob("ready*"))) < 2:
    time.sleep(0.01)
with install_recorder("numba:run_pass") as passes:
    print(small_kernels.total(np.arange(4.0)), len(passes.buffer) > 0)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_of_two_processes_that_start_together_one_compiles(tmp_path):
    (tmp_path / "small_kernels.py").write_text(KERNEL)
    settings = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    settings.pop("NUMBA_CACHE_DIR", None)
    both = [
        subprocess.Popen(
            [sys.executable, "-c", TOGETHER, f"ready{i}"], cwd=tmp_path, env=settings, stdout=subprocess.PIPE, text=True
        )
        for i in range(2)
    ]
    assert sorted(one.communicate(timeout=300)[0] for one in both) == ["10.0 False\n", "10.0 True\n"]
    assert list(tmp_path.glob("millisight-locks*/*")) == []  # no lock is left


FORKED = """
import multiprocessing, sys
import millisight as ms

def name_of_error(_):
    try:
        ms.form_image(CAPTURE, GRID, method="backprojection")
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "an image"

if __name__ == "__main__":
    scene = ms.Scene.from_mesh("golf_ball", vertices=200)
    CAPTURE = ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.02, 0.02), step=0.01))
    GRID = ms.VoxelGrid.regular((-0.01, -0.01, -0.3), (0.01, 0.01, -0.3), 0.01)
    name_of_error(None)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        print(*{*pool.map(name_of_error, range(4))})
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere processes are not forked")
def test_a_process_that_is_forked_after_work_says_so(tmp_path):
    """OpenMP ended it, and a pool made new ones for ever."""
    (tmp_path / "forked.py").write_text(FORKED)
    done = subprocess.run([sys.executable, "forked.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    told = "DeviceError: this process was forked from one that had computed already"
    assert done.stdout.startswith(told) or done.stdout == "an image\n", done.stderr  # with threads that bear it
    assert done.returncode == 0
