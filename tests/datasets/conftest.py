"""What several files of these tests read, made once."""

import pickle

import pytest

from helpers import small_recipe
from helpers.processes import made_once
from helpers.published_mock import make
from millisight.datasets.generation import Engine, plan_dataset, run_plan


@pytest.fixture(scope="session")
def published_root(tmp_path_factory):
    """The published dataset's mock; for reading only."""
    return made_once(tmp_path_factory, "mock", make) / "MITO_Dataset"


@pytest.fixture(scope="session")
def small_dataset(tmp_path_factory):
    """The small recipe's dataset, for reading only, made by one thread; what was said of it; the calls of progress."""

    def make_small(folder):
        calls = []
        plan = plan_dataset(small_recipe.recipe(), folder / "small")
        done = run_plan(plan, Engine("threads", 1, 1), progress=lambda *count: calls.append(count))
        (folder / "told").write_bytes(pickle.dumps((done, calls)))

    folder = made_once(tmp_path_factory, "small-recipe", make_small)
    return folder / "small", *pickle.loads((folder / "told").read_bytes())  # noqa: S301, it is ours


@pytest.fixture(scope="session")
def s3_server(tmp_path_factory):
    """An S3 on this machine, started once: each test that takes `s3` finds it empty."""
    pytest.importorskip("s3fs", reason='needs s3fs: pip install "millisight[store]"')
    pytest.importorskip("moto", reason="needs moto: make setup")
    from botocore.loaders import JSONFileLoader

    from helpers.small_store import SmallStore

    # Every client reads a megabyte of descriptions of services, for half a second: they are the same each time.
    read, held = JSONFileLoader._load_file, {}

    def read_once(loader, path, open_method):
        if path not in held:
            held[path] = read(loader, path, open_method)
        return held[path]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(JSONFileLoader, "_load_file", read_once)
        with SmallStore() as server:
            yield server


@pytest.fixture
def s3(s3_server, monkeypatch, tmp_path):
    """An S3 on this machine with one empty bucket, to which the environment leads."""
    for name, value in {
        "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_CONFIG_FILE": str(tmp_path / "none"), "AWS_SHARED_CREDENTIALS_FILE": str(tmp_path / "none"),
        "AWS_EC2_METADATA_DISABLED": "true", "AWS_MAX_ATTEMPTS": "1", "AWS_ENDPOINT_URL": s3_server.endpoint,
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    monkeypatch.setattr("s3fs.S3FileSystem.retries", 2)
    yield s3_server
    s3_server.empty()
