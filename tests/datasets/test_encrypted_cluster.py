"""A Dask cluster with TLS, by the lines that docs/how-to/scale-out.md prints: who has no certificate stays outside."""

import json
import re
import shutil
import socket
import subprocess
import sys

import pytest

from helpers.printed import ROOT
from helpers.small_cluster import Cluster
from millisight.core.errors import DeviceError
from millisight.datasets.generation import engine_of

PAGE = ROOT / "docs/how-to/scale-out.md"
JOBS = """
import json, sys
from helpers.small_jobs import failing
from millisight.datasets.generation import engine_of
done = engine_of(sys.argv[1]).run(failing, range(4))
print(json.dumps([[outcome.number, outcome.result] for outcome in sorted(done)]))
"""


@pytest.mark.slow
def test_who_has_no_certificate_of_ones_own_authority_gets_no_answer(cluster, environment, tmp_path, monkeypatch):
    done = subprocess.run(
        [sys.executable, "-c", JOBS, cluster.address],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT / "tests")},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [[0, 0], [1, 1], [2, None], [3, 3]]
    assert cluster.address.startswith("tls://")
    # This process has none: neither encrypted nor in the clear, by Dask or by hand.
    monkeypatch.setattr("millisight.datasets.generation._engine._CONNECT", 2.0)
    with pytest.raises(DeviceError, match="asks for certificates"):
        engine_of(cluster.address)
    with pytest.raises(DeviceError, match="no Dask scheduler answers at tcp://"):
        engine_of(cluster.address.replace("tls://", "tcp://"))
    host, port = cluster.address.removeprefix("tls://").rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=5) as stranger:
        stranger.sendall(bytes(64))
        try:
            answer = stranger.recv(64)
        except ConnectionResetError:
            answer = b""
    assert answer[:1] in (b"", b"\x15")  # nothing, or TLS's alert: never Dask's greeting


@pytest.fixture
def environment(tmp_path):
    """What the page's lines make of the environment, in a folder with the page's certificates."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl, as the page does")
    blocks = re.findall(r"^```console\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    (certificates,) = (block for block in blocks if "openssl req" in block)
    (exports,) = (block for block in blocks if "REQUIRE_ENCRYPTION" in block)
    lines = re.sub(r"^[$>] ", "", certificates + exports.split("$ dask scheduler")[0], flags=re.MULTILINE)
    told = subprocess.run(["bash", "-ec", f"{lines}\nenv -0"], cwd=tmp_path, capture_output=True, text=True, check=True)
    return dict(entry.split("=", 1) for entry in told.stdout.split("\0") if "=" in entry)


@pytest.fixture
def cluster(environment, tmp_path):
    pytest.importorskip("distributed", reason='needs Dask: pip install "millisight[cluster]"')
    made = Cluster(tmp_path, options=("--protocol", "tls"), environment=environment)
    made.start_worker()
    yield made
    made.end()
