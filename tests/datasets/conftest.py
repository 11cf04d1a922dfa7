"""What several files of these tests read, made once."""

import pytest

from helpers.published_mock import make


@pytest.fixture(scope="session")
def published_root(tmp_path_factory):
    """The published dataset's mock; for reading only."""
    return make(tmp_path_factory.mktemp("mock"))
