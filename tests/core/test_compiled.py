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
COMMAND = """
import numpy as np
import small_kernels
print(small_kernels.total(np.arange(4.0)), sum(small_kernels.total.stats.cache_hits.values()))
"""
SHUT = os.path.join(os.devnull, "home")  # where nobody, not even root, can make a folder


def runner(folder):
    """The kernels' answer in a process of its own, and whether it was kept by an earlier one."""
    (folder / "small_kernels.py").write_text(KERNEL)
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    paths = [str(folder), *sys.path]

    def run(**variables):
        settings = {**environment, "PYTHONPATH": os.pathsep.join(paths), "NUMBA_NUM_THREADS": "1", **variables}
        command = [sys.executable, "-W", "error", "-c", COMMAND]
        done = subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        answer, hits = done.stdout.split()
        assert answer == "10.0"
        return hits == "1"

    return run


@pytest.fixture
def run(tmp_path):
    return runner(tmp_path)


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """Runs the kernels, and a cache that holds them: each run is a process."""
    folder = tmp_path_factory.mktemp("warm")
    run = runner(folder)
    assert [run(NUMBA_CACHE_DIR=str(folder / "cache")) for _ in range(2)] == [False, True]
    return run, folder / "cache"


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


@pytest.mark.parametrize("how", ["empty", "cut", "flipped", "noise", "zeros", "folder"])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_cache_is_made_anew(warm, tmp_path, kind, how):
    run, whole = warm
    shutil.copytree(whole, tmp_path / "cache")
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    files = [path for path in (tmp_path / "cache").rglob(f"*.{kind}") if "total" in path.name]
    assert len(files) == 1
    damaged(files[0], how)
    assert not run(**cache)
    if how != "folder":  # which nothing can replace: it is compiled in every process
        assert run(**cache)


def test_without_a_home_the_second_process_starts_at_once(run, tmp_path):
    (tmp_path / "__pycache__").write_text("no folder")
    (tmp_path / "tmp").mkdir()
    shut = {"HOME": SHUT, "XDG_CACHE_HOME": SHUT, "TMPDIR": str(tmp_path / "tmp"), "PYTHONDONTWRITEBYTECODE": "1"}
    assert [run(**shut), run(**shut)] == [False, True]
    (folder,) = (tmp_path / "tmp").glob("millisight-kernels*")
    assert folder.stat().st_mode & 0o777 == 0o700
    # Not taken from a folder into which others may write: what is in it is run.
    folder.chmod(0o777)
    assert not run(**shut)
    assert not run(**{**shut, "TMPDIR": SHUT})
