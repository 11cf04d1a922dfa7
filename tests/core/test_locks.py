"""One run at a time on a folder, and nothing left behind by one that was killed."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from helpers.processes import wait_for
from millisight.core import alone, atomic_path, claimed, write_text
from millisight.core.errors import FileError

HOLD = """
import sys, time, pathlib
from millisight.core import alone
with alone(pathlib.Path(sys.argv[1]), 'it'):
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds the folder."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path])
    wait_for(lambda: (tmp_path / ".millisight.lock").exists() and (tmp_path / ".millisight.lock").read_text())
    yield process
    process.kill()
    process.wait()


def test_a_second_run_is_told_whose_the_folder_is(holder, tmp_path):
    told = rf"another run \(process {holder.pid}\) is using it; wait for it, or stop it"
    with pytest.raises(FileError, match=told), alone(tmp_path, "it"):
        pass


def test_the_lock_of_a_killed_run_is_none(holder, tmp_path):
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    assert (tmp_path / ".millisight.lock").exists()
    with alone(tmp_path, "it"):
        assert (tmp_path / ".millisight.lock").read_text() == f"{os.getpid()}\n"
    assert not list(tmp_path.iterdir())


def test_a_lock_goes_with_its_block(tmp_path):
    for _ in range(2):
        with pytest.raises(KeyError), alone(tmp_path, "it"):
            raise KeyError
        assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_cannot_be_held(tmp_path):
    with pytest.raises(FileError, match="cannot write to it: No such file"), alone(tmp_path / "none", "it"):
        pass


def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path):
    """That of others stays: of other files, and what is still being written."""
    old = time.time() - 3600
    left = [".notes.0123abcd.part.txt", ".notes.99999999.part.txt"]
    others = [".notes.0123abcd.part.csv", ".note.0123abcd.part.txt", ".notes.mine.part.txt", "notes.0123abcd.part.txt"]
    for name in (*left, *others, ".notes.aaaaaaaa.part.txt"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (old, old))
    os.utime(tmp_path / ".notes.aaaaaaaa.part.txt")  # just now
    with atomic_path(tmp_path / "notes.txt") as written:
        os.utime(written, (old, old))
        write_text(tmp_path / "notes.txt", "another writer")
        assert written.exists()
        written.write_text("this one")
    assert (tmp_path / "notes.txt").read_text() == "this one"
    assert {path.name for path in tmp_path.iterdir()} == {*others, ".notes.aaaaaaaa.part.txt", "notes.txt"}


def test_a_name_that_another_run_is_to_write_is_refused_and_free_again(tmp_path):
    path = tmp_path / "out.h5"
    for _ in range(2):
        with claimed(path):
            told = rf"another run \(process {os.getpid()}\) is using out.h5; wait for it, or stop it"
            with pytest.raises(FileError, match=told), claimed(tmp_path / "." / "out.h5"):
                pass
            with claimed(tmp_path / "other.h5"):
                pass
    assert not list(tmp_path.iterdir())
    with claimed(Path(os.devnull)), claimed(Path(os.devnull)):  # which many may write
        pass


def test_where_the_temporary_folder_is_somebody_elses_nobody_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with claimed(tmp_path / "a"):
        pass
    (folder,) = tmp_path.glob("millisight-locks*")
    folder.chmod(0o777)
    with claimed(tmp_path / "a"), claimed(tmp_path / "a"):
        assert not list(folder.iterdir())


def test_a_full_temporary_disk_stops_no_command(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with monkeypatch.context() as patch, claimed(tmp_path / "a"):
        (lock,) = next(tmp_path.glob("millisight-locks*")).iterdir()
        patch.setattr(os, "write", full)  # a name takes space
        told = r"another run( \(process \d+\))? is using a; wait"
        with pytest.raises(FileError, match=told), claimed(tmp_path / "a"):
            pass
        with claimed(tmp_path / "b"), pytest.raises(FileError, match="another run is using b"), claimed(tmp_path / "b"):
            pass
    lock.mkdir()  # nor can a lock be made
    with claimed(tmp_path / "a"), claimed(tmp_path / "a"):
        pass
