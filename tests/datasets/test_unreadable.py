"""Folders within a dataset that may not be listed: told, never dropped without a word."""

import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

import millisight as ms
from millisight.cli.app import app
from millisight.core import files_under
from millisight.core.errors import FileError
from millisight.datasets import convert, verify

HIDDEN = ("025_mug/robot_collected", "004_sugar_box/simulation")
WORDS = "the folder cannot be listed, so what is in it is left out; check its permissions"


@contextmanager
def hidden(root: Path, *folders: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Folders as they are to somebody without the right to read them; root has every right, so it is pretended."""
    shut, scandir = {os.fspath(root / folder) for folder in folders}, os.scandir
    assert all(os.path.isdir(folder) for folder in shut)

    def refused(path="."):
        if not isinstance(path, int) and os.fspath(path) in shut:
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return scandir(path)

    with monkeypatch.context() as patch:
        patch.setattr(os, "scandir", refused)
        yield


@pytest.fixture
def shut(miniature, monkeypatch):
    """The healthy miniature, two of whose folders may not be listed."""
    with hidden(miniature.healthy, *HIDDEN, monkeypatch=monkeypatch):
        yield miniature.healthy


def run(*arguments):
    """(exit code, standard output and error) of the command `dataset`."""
    result = CliRunner().invoke(app, ["dataset", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.exit_code, result.output


def test_an_open_dataset_names_them(shut, caplog):
    with caplog.at_level(logging.WARNING):
        dataset = ms.datasets.open(shut)
    assert sorted(dataset.unreadable) == sorted(HIDDEN)
    assert [record.getMessage() for record in caplog.records] == [f"{shut / p}: {WORDS}" for p in dataset.unreadable]
    assert not any("robot_collected" in path for one in dataset.objects for path in one.stray)
    assert dataset.filter(objects="mug", sight="los").unreadable == HIDDEN[:1]


@pytest.mark.slow
def test_verify_finds_them(shut):
    found = {one.path: one for one in verify(shut, workers=1)}
    assert len(found) > 2
    assert {path for path, one in found.items() if not one.ok} == set(HIDDEN)
    assert all(found[path].problems == (WORDS,) and found[path].kind == "folder" for path in HIDDEN)
    code, told = run("verify", shut, "--workers", 1)
    assert code == 1
    assert f"{len(found)} items: 2 with problems" in told
    for path in HIDDEN:
        assert f"problem: {path}: {WORDS}" in told


def test_convert_fails_for_them(shut, tmp_path):
    dataset = ms.datasets.open(shut).only(["mug"])
    done = convert(dataset, tmp_path / "mug", workers=1)
    items = [item for item in dataset.items if not item.converted]
    assert done.failures == ((HIDDEN[0], WORDS),)
    assert (done.made, done.kept) == (len(items), 0)
    code, told = run("convert", shut, "-o", tmp_path / "mug", "--object", "mug", "--workers", 1)
    assert code == 1
    assert "failed: 1" in told
    assert f"{HIDDEN[0]}: {WORDS}" in told


def test_an_object_of_which_nothing_is_seen_is_told(miniature, monkeypatch, tmp_path):
    with hidden(miniature.healthy, "025_mug", monkeypatch=monkeypatch):
        assert ms.datasets.open(miniature.healthy).unreadable == ("025_mug",)
        assert run("convert", miniature.healthy, "-o", tmp_path, "--object", "025_mug", "--workers", 1)[0] == 1
        code, told = run("list", miniature.healthy)
    assert code == 0
    assert f"problem: 025_mug: {WORDS}" in told
    names = [path.name for path in miniature.healthy.iterdir() if path.is_dir()]
    with hidden(miniature.healthy, *names, monkeypatch=monkeypatch), pytest.raises(FileError, match="that may be read"):
        ms.datasets.open(miniature.healthy)


def test_info_fails_for_them(shut):
    for place in ("025_mug", HIDDEN[0]):
        code, told = run("info", shut / place)
        assert code == 1
        assert f"failed: robot_collected: {WORDS}" in told


@pytest.mark.parametrize("command", ["image", "view", "segment", "classify"])
def test_commands_on_folders_refuse_what_cannot_be_listed(shut, command, tmp_path):
    result = CliRunner().invoke(
        app, [command, str(shut / HIDDEN[0]), "-o", str(tmp_path / "out")][: 2 if command == "view" else 4]
    )
    said = f"{result.output} {result.exception}"
    assert result.exit_code == 1
    assert re.search(r"cannot (list|read) .*robot_collected: Permission denied", said), said


def test_files_under_a_folder_are_all_of_them_or_an_error(tmp_path, monkeypatch):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "x").touch()
    (tmp_path / ".cache").mkdir()
    (tmp_path / ".cache" / "y").touch()
    assert files_under(tmp_path) == [tmp_path / "a" / "b" / "x"]
    told = r"cannot list the folder .*a/b: Permission denied; change its permissions"
    with hidden(tmp_path, "a/b", monkeypatch=monkeypatch), pytest.raises(FileError, match=told):
        files_under(tmp_path)
