"""The download, from a hub on this machine: chosen objects, what is there kept, breaks taken up, errors that help."""

import socket
import sys

import numpy as np
import pytest

from helpers.miniature import BOX, MUG
from helpers.small_hub import COMMIT, REPOSITORY, Hub
from millisight import datasets
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets import _download as module
from millisight.datasets import download

LARGE = f"{MUG}/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image.pkl"


@pytest.fixture
def hub(monkeypatch):
    pytest.importorskip("huggingface_hub")
    rng = np.random.default_rng(0)
    files = {
        "README.md": b"# MITO\n",
        f"{BOX}/nontextured.stl": b"solid\n",
        f"{BOX}/simulation/0_0_0/processed/radars/77_ghz/processed_image_edges.pkl": rng.bytes(4000),
        LARGE: rng.bytes(300_000),
        f"{MUG}/robot_collected/0_0_0/exp1/experiment_info.json": b"{}",
    }
    with Hub(files) as server:
        monkeypatch.setenv("HF_ENDPOINT", server.endpoint)
        yield server


def fetched(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and ".cache" not in p.parts
    }


def test_everything_is_downloaded_and_is_a_dataset(hub, tmp_path):
    seen = []
    done = download(tmp_path / "new" / "MITO", workers=1, progress=lambda *count: seen.append(count))
    assert (done.commit, done.there, done.failures) == (COMMIT, 0, ())
    assert fetched(tmp_path / "new" / "MITO") == hub.files
    total = sum(map(len, hub.files.values()))
    assert done.size == total == seen[-1][0] == seen[-1][1]
    assert [count for count, _ in seen] == sorted(count for count, _ in seen)
    assert [one.folder.name for one in datasets.open(tmp_path / "new" / "MITO").objects] == [BOX, MUG]


@pytest.mark.parametrize("name", ["025", "mug", MUG])
def test_objects_are_chosen_by_id_name_or_folder(name, hub, tmp_path):
    done = download(tmp_path, [name], workers=1)
    assert len(done.files) == 2
    assert set(fetched(tmp_path)) == {path for path in hub.files if path.startswith(MUG)}


def test_unknown_objects_are_refused_with_the_likely_one(hub, tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown object '025_mugg'. Did you mean '025_mug'\?"):
        download(tmp_path / "out", ["025_mugg"])
    assert not (tmp_path / "out").exists()


def test_what_there_is_is_said_without_fetching_it(hub, tmp_path):
    done = download(tmp_path / "out", ["sugar_box"], dry_run=True)
    assert {file.path: file.size for file in done.files} == {
        path: len(content) for path, content in hub.files.items() if path.startswith(BOX)
    }
    assert done.size == 4006
    assert not (tmp_path / "out").exists()
    assert hub.asked == []


def test_what_is_there_is_not_fetched_again(hub, tmp_path):
    download(tmp_path, ["mug"], workers=1)
    hub.asked.clear()
    done = download(tmp_path, workers=1)
    assert done.there == 2
    assert fetched(tmp_path) == hub.files
    assert {path for _, path, _ in hub.asked} == {path for path in hub.files if not path.startswith(MUG)}


def test_a_connection_that_breaks_is_taken_up_where_it_broke(hub, monkeypatch, tmp_path):
    monkeypatch.setattr("huggingface_hub.constants.DOWNLOAD_CHUNK_SIZE", 10_000)  # whole ones count; 10 MB otherwise
    hub.broken[LARGE] = 100_000
    done = download(tmp_path, ["mug"], workers=1)
    assert done.failures == ()
    assert (tmp_path / LARGE).read_bytes() == hub.files[LARGE]
    ranges = [asked for method, path, asked in hub.asked if method == "GET" and path == LARGE]
    assert len(ranges) == 2
    assert ranges[0] is None
    assert ranges[1] == "bytes=100000-"


@pytest.mark.slow
def test_a_file_that_cannot_be_fetched_stops_no_other_and_comes_later(hub, tmp_path):
    hub.refused[LARGE] = 500
    done = download(tmp_path, workers=2)
    ((path, reason),) = done.failures
    assert path == LARGE
    assert "the hub answers 500" in reason
    assert set(fetched(tmp_path)) == set(hub.files) - {LARGE}
    hub.refused.clear()
    done = download(tmp_path, workers=1)
    assert (done.there, done.failures) == (4, ())
    assert fetched(tmp_path) == hub.files
    assert not list(tmp_path.rglob("*.incomplete"))


@pytest.mark.parametrize(
    ("gate", "message"),
    [
        ((401, "RepoNotFound"), "no such dataset, or it is private: .* `hf auth login`"),
        ((401, ""), "no such dataset, or it is private: .* `hf auth login`"),
        ((403, "GatedRepo"), "you may not read it yet: ask for access on its page"),
        ((403, ""), "you may not read it yet: ask for access on its page"),
        ((404, "RepoNotFound"), "no such dataset, or it is private"),
        ((418, ""), "the hub answers 418"),
    ],
)
def test_a_hub_that_refuses_is_explained(gate, message, hub, tmp_path):
    hub.gate = gate
    with pytest.raises(FileError, match=f"{REPOSITORY}: .*{message}"):
        download(tmp_path)


def test_names_that_the_hub_does_not_have_are_explained(hub, tmp_path):
    with pytest.raises(FileError, match="it has no revision 'v9'"):
        download(tmp_path, revision="v9")
    with pytest.raises(FileError, match="nobody/nothing: there is no such dataset"):
        download(tmp_path, repository="nobody/nothing")
    with pytest.raises(FileError, match="not the name of a repository"):
        download(tmp_path, repository="a b/c")


def test_no_network_is_explained(monkeypatch, tmp_path):
    pytest.importorskip("huggingface_hub")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{unused.getsockname()[1]}")
        with pytest.raises(FileError, match="the hub cannot be reached, or the connection broke .* check the network"):
            download(tmp_path)


def test_files_outside_the_folder_are_not_fetched(hub, tmp_path):
    hub.files["../evil.txt"] = b"x"
    with pytest.raises(FileError, match="would lie outside the folder"):
        download(tmp_path / "out")


def test_a_disk_without_room_is_refused_before_the_download(hub, monkeypatch, tmp_path):
    from collections import namedtuple

    usage = namedtuple("usage", "total used free")(10, 9, 1)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    with pytest.raises(InputError, match="is 0.0 GB"):
        download(tmp_path)
    assert not [asked for asked in hub.asked if asked[0] == "GET"]


def test_without_the_hubs_library_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ImportError, match=r'pip install "millisight\[hub\]"'):
        module.download(tmp_path)
