"""A dataset to object stores and back: the same bytes, resumed, checked, and errors that help.

Stores: fsspec's memory, a folder, and S3 as moto serves it on this machine.
"""

import functools
import http.server
import json
import shutil
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers import small_recipe
from millisight.cli.app import app
from millisight.core import OWN_NAME
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets import Manifest, ManifestEntry, checksum, download, push, read_manifest, verify, write_manifest
from millisight.datasets.generation import Engine, plan_dataset, run_plan
from millisight.io.mito import SPLITS_NAME

fsspec = pytest.importorskip("fsspec", reason='needs fsspec: pip install "millisight[store]"')

MUG, BOX = "025_mug", "004_sugar_box"
IMAGE = "simulation/0_0_0/processed/radars/77_ghz/processed_image_edges.pkl"
PATHS = [f"{MUG}/{IMAGE}", f"{MUG}/nontextured.stl", f"{BOX}/{IMAGE}", f"truth/{MUG}/job.json", f"truth/{BOX}/job.json"]
OTHERS = ["README.md", SPLITS_NAME, "manifest.jsonl"]


@pytest.fixture
def made(tmp_path):
    """A small dataset; nobody opens what its files hold."""
    return write_dataset(
        tmp_path / "made", {path: np.random.default_rng(i).bytes(3000) for i, path in enumerate(PATHS)}
    )


def write_dataset(root, files, **settings):
    for path, content in files.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(content)
    entries = {path: ManifestEntry(path, "any", len(files[path]), checksum(root / path), ()) for path in files}
    write_manifest(root, Manifest(settings={"recipe": "small", **settings}, entries=entries))
    (root / "README.md").write_text("# small\n")
    (root / SPLITS_NAME).write_text("{}\n")
    return root


@pytest.fixture(params=["memory", "file", "s3"])
def url(request, tmp_path):
    if request.param == "s3":
        request.getfixturevalue("s3")
        return "s3://bucket/data/small"
    return f"memory://{tmp_path.name}/small" if request.param == "memory" else f"file://{tmp_path}/store/small"


def files_of(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stored(url):
    """Path and content of everything in a store."""
    files, root = fsspec.core.url_to_fs(url, use_listings_cache=False, skip_instance_cache=True)
    return {path.removeprefix(root).removeprefix("/"): files.cat_file(path) for path in files.find(root)}


def in_store(url, path):
    return fsspec.open(f"{url}/{path}", "wb", skip_instance_cache=True)


def test_what_is_pushed_comes_back_byte_for_byte(url, made, tmp_path):
    (made / "notes.txt").write_text("mine")
    calls = []
    done = push(made, url, progress=lambda *count: calls.append(count))
    assert (done.files, done.there, done.left_out) == (8, 0, ("notes.txt",))
    assert done.address == url
    assert calls[-1] == (done.size, done.size)
    assert [count for count, _ in calls] == sorted(count for count, _ in calls)
    assert set(stored(url)) == {*PATHS, *OTHERS}
    calls.clear()
    fetched = download(tmp_path / "again", repository=url, progress=lambda *count: calls.append(count))
    assert (len(fetched.files), fetched.there, fetched.failures) == (7, 0, ())
    assert fetched.commit == checksum(made / "manifest.jsonl")
    assert calls[-1] == (fetched.size, fetched.size)
    (made / "notes.txt").unlink()
    assert files_of(tmp_path / "again") == files_of(made)
    assert download(tmp_path / "again", repository=url).there == len(PATHS)


def test_what_is_there_is_not_sent_again_and_what_changed_is(url, made, tmp_path):
    push(made, url)
    again = push(made, url)
    assert (again.there, again.sent) == (8, ())
    changed = {path: (made / path).read_bytes() for path in PATHS}
    changed[PATHS[0]] = changed[PATHS[0]][::-1]  # of the same size
    done = push(write_dataset(made, changed), url)
    assert [file.path for file in done.sent] == [PATHS[0], "manifest.jsonl"]
    download(tmp_path / "again", repository=url)
    assert files_of(tmp_path / "again") == files_of(made)


@pytest.mark.slow
def test_an_interrupted_push_continues_and_is_no_dataset_before(s3, made, tmp_path):
    s3.most_sent = 3
    with pytest.raises(FileError, match="the connection broke .*try again; what was transferred is kept"):
        push(made, "s3://bucket/small")
    assert len(s3.names()) == 3
    assert "small/manifest.jsonl" not in s3.names()
    with pytest.raises(FileError, match=r"holds 3 files and no manifest.jsonl; .* push again"):
        download(tmp_path / "again", repository="s3://bucket/small")
    s3.most_sent = 10**6
    done = push(made, "s3://bucket/small")
    assert done.there == 2
    assert len(s3.sent) == len(set(s3.sent)) == 9  # with the note that a push has begun
    assert done.files == 8
    assert s3.sent[-1] == "small/manifest.jsonl"
    download(tmp_path / "again", repository="s3://bucket/small")
    assert files_of(tmp_path / "again") == files_of(made)


def test_a_copy_that_broke_leaves_no_half_of_a_file(made, monkeypatch, tmp_path):
    place = type(fsspec.filesystem("file"))

    def broken(_, here, there, **options):
        with open(there, "wb") as file:
            file.write(b"half")
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(place, "put_file", broken)
        with pytest.raises(FileError, match="the store answers with an error .*Input/output"):
            push(made, f"file://{tmp_path}/store")
    assert all(path.endswith(".partial") for path in files_of(tmp_path / "store"))
    push(made, f"file://{tmp_path}/store")
    assert files_of(tmp_path / "store") == files_of(made)


@pytest.mark.slow
def test_large_objects_are_read_back_since_their_parts_have_no_checksum_of_the_whole(s3, monkeypatch, tmp_path):
    monkeypatch.setattr("s3fs.core.calculate_chunksize", lambda *_, **__: 5 * 2**20)
    large = {f"{MUG}/raw.bin": np.random.default_rng(0).bytes(11 * 2**20)}
    made = write_dataset(tmp_path / "made", large)
    push(made, "s3://bucket/small")
    assert "-" in s3.client.head_object(Bucket="bucket", Key=f"small/{MUG}/raw.bin")["ETag"]
    s3.fetched.clear()
    assert push(made, "s3://bucket/small").there == 4
    assert set(s3.fetched) == {f"small/{MUG}/raw.bin", "small/manifest.jsonl"}
    assert download(tmp_path / "again", repository="s3://bucket/small").failures == ()
    assert files_of(tmp_path / "again") == files_of(made)


def test_files_that_do_not_arrive_whole_keep_the_manifest_back(made, monkeypatch):
    files = type(fsspec.filesystem("memory"))
    send = files.mv

    def lossy(self, here, there, **options):
        send(self, here, there, **options)
        if there.endswith("nontextured.stl"):
            self.pipe_file(there, b"half")

    with monkeypatch.context() as patch:
        patch.setattr(files, "mv", lossy)
        with pytest.raises(FileError, match=rf"1 of 7 files did not arrive whole, the first {MUG}/nontextured.stl"):
            push(made, "memory://lossy/small")
    assert "manifest.jsonl" not in stored("memory://lossy/small")
    assert push(made, "memory://lossy/small").there == 6


def test_damaged_objects_are_named_and_stop_no_others(url, made, tmp_path):
    push(made, url)
    other = (made / PATHS[0]).read_bytes()[::-1]
    with in_store(url, PATHS[0]) as file:
        file.write(other)
    with in_store(url, PATHS[1]) as file:
        file.write(b"half")
    (tmp_path / "again" / MUG).mkdir(parents=True)
    (tmp_path / "again" / OWN_NAME).touch()  # as a download leaves it that is broken off
    (tmp_path / "again" / PATHS[1]).write_text("what was here before")
    done = download(tmp_path / "again", repository=url)
    reasons = dict(done.failures)
    assert set(reasons) == set(PATHS[:2])
    assert "came with other bytes; expected 3000 with sha256" in reasons[PATHS[0]]
    assert "came with 4 bytes; expected 3000" in reasons[PATHS[1]]
    assert all("try again" in reason for reason in reasons.values())
    assert (tmp_path / "again" / PATHS[1]).read_text() == "what was here before"
    assert set(files_of(tmp_path / "again")) == {*PATHS, *OTHERS} - {PATHS[0]}
    assert push(made, url).there == 6
    done = download(tmp_path / "again", repository=url)
    assert (done.there, done.failures) == (3, ())
    assert files_of(tmp_path / "again") == files_of(made)


@pytest.mark.slow
def test_files_damaged_on_the_way_are_refused(s3, made, tmp_path):
    push(made, "s3://bucket/small")
    s3.damaged = {f"small/{PATHS[2]}", "small/README.md"}
    done = download(tmp_path / "again", repository="s3://bucket/small")
    assert [path for path, _ in done.failures] == [PATHS[2], "README.md"]
    assert all("damaged on the way" in reason for _, reason in done.failures)
    assert not (tmp_path / "again" / PATHS[2]).exists()
    assert "manifest.jsonl" in files_of(tmp_path / "again")
    assert PATHS[2] not in read_manifest(tmp_path / "again").entries
    s3.damaged = {"small/manifest.jsonl"}
    with pytest.raises(FileError, match=r"s3://bucket/small/manifest.jsonl: it was damaged on the way .*: try again"):
        download(tmp_path / "again", repository="s3://bucket/small")
    s3.damaged = set()
    assert download(tmp_path / "again", repository="s3://bucket/small").there == len(PATHS) - 1
    assert files_of(tmp_path / "again") == files_of(made)


def test_an_object_that_is_missing_is_named(url, made, tmp_path):
    push(made, url)
    files, root = fsspec.core.url_to_fs(url, skip_instance_cache=True)
    files.rm_file(f"{root}/{PATHS[0]}")
    ((path, reason),) = download(tmp_path / "again", repository=url).failures
    assert path == PATHS[0]
    assert "there is no such file" in reason
    assert reason.endswith("send it again")


def test_a_file_damaged_here_is_not_sent(url, made):
    (made / PATHS[0]).write_bytes(b"?" * 3000)
    with pytest.raises(FileError, match=rf"{PATHS[0]} has another SHA-256 than manifest.jsonl says, and was not sent"):
        push(made, url)
    assert not {PATHS[0], "manifest.jsonl"} & set(stored(url))


@pytest.mark.parametrize("name", ["025", "mug", MUG])
def test_objects_are_chosen_with_their_truth(name, made, tmp_path):
    url = f"memory://{tmp_path.name}"
    push(made, url)
    out = tmp_path / "again"
    done = download(out, [name], repository=url)
    mine = {path for path in PATHS if MUG in path}
    assert {file.path for file in done.files} == mine
    assert set(files_of(out)) == {*mine, "manifest.jsonl"}
    assert set(read_manifest(out).entries) == mine
    assert len(download(out, ["sugar_box"], repository=url).files) == 2
    assert set(read_manifest(out).entries) == set(PATHS)
    assert download(out, repository=url).there == len(PATHS)
    assert files_of(out) == files_of(made)


def test_unknown_objects_are_refused_with_the_likely_one(made, tmp_path):
    push(made, f"memory://{tmp_path.name}")
    with pytest.raises(UnknownNameError, match=r"unknown object '025_mugg'. Did you mean '025_mug'\?"):
        download(tmp_path / "again", ["025_mugg"], repository=f"memory://{tmp_path.name}")
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize(
    "name",
    ["../evil", f"{MUG}/../../evil", "/tmp/evil", "..\\evil", f"{MUG}\\evil", "C:/evil", "C:evil", "a//b", "./a", ""],
)
def test_names_that_lead_out_of_the_folder_are_refused(name, made, tmp_path):
    url = f"memory://{tmp_path.name}/small"
    push(made, url)
    first, *lines = (made / "manifest.jsonl").read_text().splitlines(keepends=True)
    evil = json.dumps({**json.loads(lines[0]), "path": name})
    with in_store(url, "manifest.jsonl") as file:
        head = {**json.loads(first), "files": len(lines) + 1, "sha256": None}
        file.write((json.dumps(head) + "\n" + "".join(lines) + evil + "\n").encode())
    before = set(tmp_path.rglob("*"))
    with pytest.raises(FileError, match="would lie outside the folder; refused") as error:
        download(tmp_path / "out" / "again", repository=url)
    assert repr(name) in str(error.value)
    assert set(tmp_path.rglob("*")) == before


def test_another_dataset_is_not_overwritten(url, made, tmp_path):
    push(made, url)
    other = write_dataset(tmp_path / "other", {PATHS[0]: b"0"}, seed=4)
    with pytest.raises(FileError, match="holds another dataset: .*choose another place"):
        push(other, url)
    before = files_of(other)
    with pytest.raises(FileError, match="holds another dataset: .*choose another folder"):
        download(other, repository=url)
    assert files_of(other) == before
    download(tmp_path / "again", repository=url)
    assert files_of(tmp_path / "again") == files_of(made)


def test_a_dataset_that_has_more_there_is_not_orphaned(url, made, tmp_path):
    """Two conversions of other data say the same of themselves."""
    push(made, url)
    fewer = write_dataset(tmp_path / "fewer", {PATHS[0]: b"other"})
    before = stored(url)
    with pytest.raises(FileError, match=rf"holds {len(PATHS) - 1} files of a dataset that this one has not, the first"):
        push(fewer, url)
    assert stored(url) == before


@pytest.mark.slow
def test_a_damaged_manifest_is_sent_again_and_one_of_something_else_is_not_overwritten(url, made):
    push(made, url)
    with in_store(url, "manifest.jsonl") as file:
        file.write(b"{")
    assert [file.path for file in push(made, url).sent] == ["manifest.jsonl"]
    assert stored(url)["manifest.jsonl"] == (made / "manifest.jsonl").read_bytes()
    with in_store(url, "manifest.jsonl") as file:
        file.write(b'{"format": "other"}')
    with pytest.raises(FileError, match="is not a manifest of millisight"):
        push(made, url)


@pytest.mark.slow
def test_a_store_that_refuses_is_explained(s3, made, tmp_path, monkeypatch):
    place = "s3://nosuchbucket/small"
    with pytest.raises(FileError, match=f"{place}: there is no such bucket .*buckets are not made here"):
        push(made, place)
    with pytest.raises(FileError, match=f"{place}: there is no such bucket .*check its name"):
        download(tmp_path / "again", repository=place)
    with pytest.raises(FileError, match=r"s3://bucket/empty holds 0 files and no manifest.jsonl"):
        download(tmp_path / "again", repository="s3://bucket/empty")
    s3.denied = "AccessDenied", "Access Denied"
    with pytest.raises(FileError, match="does not let you write there .*Access Denied.*: check your credentials"):
        push(made, "s3://bucket/small")
    with pytest.raises(FileError, match="does not let you read there"):
        download(tmp_path / "again", repository="s3://bucket/small")
    s3.denied = "InvalidAccessKeyId", "The AWS Access Key Id you provided does not exist in our records."
    with pytest.raises(FileError, match="does not let you write there .*does not exist in our records"):
        push(made, "s3://bucket/small")
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    with pytest.raises(FileError, match="no credentials were found .*AWS_PROFILE"):
        push(made, "s3://bucket/small")
    assert not (tmp_path / "again").exists()


def test_no_server_is_explained(s3, made, monkeypatch):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{unused.getsockname()[1]}")
        with pytest.raises(FileError, match="the store cannot be reached, .* check the network and the address"):
            push(made, "s3://bucket/small")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nowhere://bucket/small", "no protocol nowhere:// is known; expected one such as s3"),
        ("memory://", "names no place in the store; expected a URL such as s3://bucket/prefix"),
        ("nowhere://me:secret@host/small", r"nowhere://\*\*\*@host/small: no protocol"),
    ],
)
def test_urls_that_name_no_store_are_refused(url, message, made):
    with pytest.raises(InputError, match=message) as error:
        push(made, url)
    assert "secret" not in str(error.value)


def test_options_of_the_hub_are_refused(made, tmp_path):
    for options in ({"licence": "cc-by-4.0"}, {"public": True}, {"revision": "v1"}):
        with pytest.raises(InputError, match="apply to the hub"):
            push(made, "memory://small", **options)
    with pytest.raises(InputError, match="revision applies to the hub"):
        download(tmp_path, repository="memory://small", revision="v1")


@pytest.mark.slow
def test_nothing_of_stores_is_loaded_before_one_is_named():
    code = (
        "import sys, millisight.cli.dataset, millisight.cli.generate; from millisight.datasets import download, push;"
        "from millisight.datasets.generation import run_plan; print({'fsspec', 's3fs', 'botocore'} & set(sys.modules))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout == "set()\n"


@pytest.mark.parametrize("package", ["fsspec", "s3fs"])
def test_packages_that_are_missing_are_named(package, made, monkeypatch):
    monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3", raising=False)  # of what it loaded before
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=r'pip install "millisight\[store\]"'):
        push(made, "s3://bucket/small")


def test_a_package_of_another_protocol_is_named(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(ImportError, match="gs:// needs a package that is not installed .*gcsfs"):
        push(made, "gs://bucket/small")


def test_a_website_is_downloaded_from_and_not_written_to(made, tmp_path):
    pytest.importorskip("aiohttp", reason='needs aiohttp: pip install "millisight[store]"')
    handler = functools.partial(_Quiet, directory=str(made))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_address[1]}"
        assert download(tmp_path / "again", repository=url).failures == ()
        assert files_of(tmp_path / "again") == files_of(made)
        with pytest.raises(FileError, match="answers with an error|can only be read"):
            push(made, url + "/other")
        server.shutdown()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


def run(*words):
    return CliRunner().invoke(app, ["dataset", *map(str, words)])


@pytest.mark.slow
def test_the_commands_push_and_download(s3, tmp_path):
    made = tmp_path / "made"
    run_plan(plan_dataset(small_recipe.recipe(rig=None), made), Engine("threads", 1, 1))
    planned = run("push", made, "s3://bucket/data/small", "--dry-run")
    assert planned.exit_code == 0, planned.output
    *folders, told = planned.stdout.splitlines()
    assert len(folders) == 3
    assert told.startswith("s3://bucket/data/small: ")
    assert told.endswith("; nothing was sent")
    assert s3.names() == []
    done = run("push", made, "s3://bucket/data/small")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[-1] == "pushed to s3://bucket/data/small"
    assert "licence" not in done.stdout
    planned = run("push", made, "s3://bucket/data/small", "--dry-run")
    assert f"; {len(s3.names())} files existed already; nothing was sent" in planned.stdout
    listed = run("download", tmp_path / "again", "--repo", "s3://bucket/data/small", "--dry-run")
    assert listed.exit_code == 0
    assert not (tmp_path / "again").exists()
    fetched = run("download", tmp_path / "again", "--repo", "s3://bucket/data/small")
    assert (fetched.exit_code, fetched.stdout.splitlines()[-1]) == (0, f"wrote {tmp_path / 'again'}")
    assert files_of(tmp_path / "again") == files_of(made)
    assert all(one.ok for one in verify(tmp_path / "again", workers=1))
    s3.damaged = set(s3.names())
    shutil.rmtree(tmp_path / "again")
    failed = run("download", tmp_path / "again", "--repo", "s3://bucket/data/small")
    assert failed.exit_code == 1


@pytest.mark.slow
def test_files_of_others_stay_on_both_sides(url, made, tmp_path):
    """They were overwritten where no manifest said whose they were."""
    with in_store(url, "README.md") as file:
        file.write(b"mine")
    with pytest.raises(FileError, match=r"holds README.md, which is another file and would be overwritten, and no"):
        push(made, url)
    with pytest.raises(FileError, match="which is another file"):
        push(made, url, dry_run=True)
    store, path = fsspec.core.url_to_fs(f"{url}/README.md")
    store.rm(path)
    push(made, url)
    out = tmp_path / "mine"
    out.mkdir()
    (out / "README.md").write_text("mine")
    with pytest.raises(FileError, match=r"README.md is there already, is another file, and would be overwritten"):
        download(out, repository=url)
    assert [path.name for path in out.iterdir()] == ["README.md"]
    (out / "README.md").unlink()
    (out / "notes.txt").write_text("mine")
    assert download(out, repository=url).failures == ()
    assert (out / "notes.txt").read_text() == "mine"


def test_a_dataset_that_has_more_here_is_not_overwritten(made, tmp_path):
    url = f"file://{tmp_path}/store"
    push(made, url)
    out = tmp_path / "more"
    shutil.copytree(made, out)
    (out / "mine.txt").write_text("mine")
    entry = ManifestEntry("mine.txt", "raw", 4, checksum(out / "mine.txt"), ())
    write_manifest(out, read_manifest(out).updated([entry]))
    before = files_of(out)
    with pytest.raises(FileError, match=r"holds 1 files that .* has not, the first mine.txt; push them, or choose"):
        download(out, repository=url)
    assert files_of(out) == before
