"""A dataset pushed to a hub on this machine: what arrives, what its card says, and how a push that broke goes on."""

import json
import re
import shutil

import pytest
from typer.testing import CliRunner

from helpers import small_recipe
from helpers.miniature import MUG
from helpers.small_hub import Hub
from millisight.cli.app import app
from millisight.core.errors import FileError
from millisight.datasets import (
    ManifestEntry,
    checksum,
    convert,
    download,
    push,
    read_manifest,
    verify,
    write_manifest,
)
from millisight.datasets import _push as module
from millisight.datasets import open as open_dataset
from millisight.datasets.generation import Engine, plan_dataset, run_plan
from millisight.io.mito import INFO

# huggingface_hub's own, as it sends a file to the older of the hub's stores.
pytestmark = pytest.mark.filterwarnings("ignore:Use 'content:DeprecationWarning")

NAME = "someone/small"
RIG = "virtual rig: physical optics"
TOKEN = "hf_abcdefghijklmnopqrstuvwxyz0123456789"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The small recipe's simulated images, and an experiment of the virtual rig that is told of alone."""
    out = tmp_path_factory.mktemp("made") / "small"
    manifest = run_plan(plan_dataset(small_recipe.recipe(rig=None), out), Engine("threads", 1, 1)).manifest
    path = "058_golf_ball/robot_collected/0_0_0/exp1/experiment_info.json"
    (out / path).parent.mkdir(parents=True)
    (out / path).write_text(json.dumps({"simulated": True, "physics": RIG}), encoding="utf-8")
    info = ManifestEntry(
        path=path, kind=INFO, size=(out / path).stat().st_size, sha256=checksum(out / path), sources=()
    )
    write_manifest(out, manifest.updated([info]))
    return out


@pytest.fixture
def hub(monkeypatch):
    pytest.importorskip("huggingface_hub", reason='needs huggingface_hub: pip install "millisight[hub]"')
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_DISABLE_XET", True)  # a store that this hub has not
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    with Hub({".gitattributes": b"*.pkl filter=lfs\n"}, repository=NAME) as server:
        monkeypatch.setenv("HF_ENDPOINT", server.endpoint)
        yield server


def visibility(hub):
    """Of the new repository, as newer and older versions of huggingface_hub ask for it."""
    return hub.made.get("visibility") or ("private" if hub.made["private"] else "public")


def front_of(card):
    """What the hub reads of a card."""
    lines = re.fullmatch(r"---\n(.*?)---\n.*", card, flags=re.DOTALL)[1].splitlines()
    return {key: json.loads(value) for key, value in (line.split(": ", 1) for line in lines)}


def test_what_is_pushed_can_be_downloaded_and_verified(hub, made, tmp_path):
    calls = []
    done = push(made, NAME, licence="cc-by-4.0", progress=lambda *count: calls.append(count))
    assert (done.there, done.left_out) == (0, ())
    assert calls[-1] == (done.size, done.size)
    assert done.address.endswith(NAME)
    assert visibility(hub) == "private"
    assert hub.tokens == {f"Bearer {TOKEN}"}
    assert len(hub.files) == done.files + 1
    fetched = download(tmp_path / "again", repository=NAME, workers=1)
    assert fetched.failures == ()
    for path in read_manifest(made).entries:
        assert (tmp_path / "again" / path).read_bytes() == (made / path).read_bytes()
    assert all(one.ok for one in verify(tmp_path / "again", workers=1))
    assert open_dataset(tmp_path / "again").stray == ()


def test_the_card_says_what_is_simulated_how_and_by_what(hub, made):
    card = push(made, NAME, licence="cc-by-4.0", dry_run=True).card
    assert hub.commits == []
    front = front_of(card)
    assert front["license"] == "cc-by-4.0"
    assert front["size_categories"] == ["n<1K"]
    assert front["simulated"] is True
    assert "simulated" in front["tags"]
    (told,) = {json.loads(path.read_text())["made_by"]["physics"] for path in made.rglob("job.json")}
    assert front["physics"] == [told, RIG]
    assert front["made_by"].startswith("millisight generate, recipe 'small', seed 3")
    assert "**Everything here is simulated. Nothing was measured.**" in card
    assert f"millisight dataset download small --repo {NAME}" in card
    assert (made / "README.md").read_text() in card  # its own card, which is left as it is


@pytest.mark.slow
def test_measured_data_are_not_called_simulated(hub, miniature, tmp_path):
    convert(open_dataset(miniature.healthy).only([MUG]), tmp_path / "mito", workers=1)
    done = push(tmp_path / "mito", "someone/mito", dry_run=True)
    front = front_of(done.card)
    assert front["license"] == "unknown"
    assert front["simulated"] == "partly"
    assert "| measured, or made by others | " in done.card
    assert "Nothing was measured" not in done.card


def test_a_push_that_broke_goes_on_where_it_stopped(hub, made, monkeypatch):
    monkeypatch.setattr(module, "_BATCH_FILES", 4)
    hub.most_commits = 1
    with pytest.raises(FileError, match="the hub answers 500 .*what was uploaded is kept"):
        push(made, NAME)
    assert len(hub.commits) == 1
    assert "manifest.jsonl" not in hub.files  # it comes last, when all that it lists is there
    hub.most_commits = 1000
    done = push(made, NAME)
    assert done.there == 4
    assert len(hub.commits) > 2
    sent = [path for paths in hub.commits for path in paths]
    assert len(sent) == len(set(sent)) == done.files
    commits = len(hub.commits)
    assert push(made, NAME).there == done.files
    assert len(hub.commits) == commits


@pytest.mark.parametrize(
    ("gate", "message"),
    [
        ((401, ""), "the hub does not know you: log in with `hf auth login`, with a token that may write"),
        ((403, ""), "you may not write there"),
        ((418, ""), "the hub answers 418"),
    ],
)
def test_refusals_are_explained_without_the_token(gate, message, hub, made):
    hub.gate = gate
    with pytest.raises(FileError, match=f"{NAME}: {message}") as error:
        push(made, NAME)
    assert TOKEN not in str(error.value)
    assert hub.commits == []


def test_folders_that_are_no_whole_dataset_are_refused(hub, made, tmp_path):
    with pytest.raises(FileError, match=r"holds no manifest.jsonl; expected a dataset that `millisight generate`"):
        push(tmp_path, NAME)
    shutil.copytree(made, tmp_path / "less")
    path = sorted(read_manifest(made).entries)[0]
    (tmp_path / "less" / path).unlink()
    with pytest.raises(FileError, match=rf"1 of \d+ files are missing .*the first {path}"):
        push(tmp_path / "less", NAME)
    assert hub.made is None
    with pytest.raises(FileError, match="not the name of a repository"):
        push(made, "no name at all")


def test_the_command_pushes_and_says_where_to(hub, made, tmp_path):
    shutil.copytree(made, tmp_path / "small")
    (tmp_path / "small" / "notes.txt").write_text("mine")
    planned = CliRunner().invoke(app, ["dataset", "push", str(tmp_path / "small"), NAME, "--dry-run"])
    assert planned.exit_code == 0
    assert planned.stdout.startswith("---\nlicense: ")
    assert "nothing was sent" in planned.stdout
    assert hub.made is None
    done = CliRunner().invoke(app, ["dataset", "push", str(tmp_path / "small"), NAME, "--public"])
    assert done.exit_code == 0
    assert "not pushed, since the manifest does not list it: notes.txt" in done.stdout
    assert "choose one with --license" in done.stdout
    assert f"pushed to {hub.endpoint}/datasets/{NAME}" in done.stdout
    assert TOKEN not in done.output
    assert "notes.txt" not in hub.files
    assert visibility(hub) == "public"
