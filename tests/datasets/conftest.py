"""What several files of these tests read, made once."""

import pytest

from helpers.processes import made_once
from helpers.published_mock import make


@pytest.fixture(scope="session")
def published_root(tmp_path_factory):
    """The published dataset's mock; for reading only."""
    return made_once(tmp_path_factory, "mock", make) / "MITO_Dataset"


@pytest.fixture
def s3(monkeypatch, tmp_path):
    """An S3 on this machine with one bucket, to which the environment leads."""
    pytest.importorskip("s3fs", reason='needs s3fs: pip install "millisight[store]"')
    pytest.importorskip("moto", reason="needs moto: make setup")
    from helpers.small_store import SmallStore

    for name, value in {
        "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_CONFIG_FILE": str(tmp_path / "none"), "AWS_SHARED_CREDENTIALS_FILE": str(tmp_path / "none"),
        "AWS_EC2_METADATA_DISABLED": "true", "AWS_MAX_ATTEMPTS": "1",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    monkeypatch.setattr("s3fs.S3FileSystem.retries", 2)
    with SmallStore() as server:
        monkeypatch.setenv("AWS_ENDPOINT_URL", server.endpoint)
        yield server
