"""`millisight view` as a user meets it, but for the browser."""

import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest

import millisight as ms
from helpers.commands import refused, run_inside


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A folder with one small image."""
    folder = tmp_path_factory.mktemp("view")
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.05, 0.04, 0.03), 0.01)
    values = np.exp(1j * np.arange(grid.size)).reshape(grid.shape) * np.linspace(0.1, 1, grid.size).reshape(grid.shape)
    ms.save(folder / "a.image.h5", ms.SarImage(grid=grid, values=values.astype(np.complex64)))
    return folder


def started(folder, *arguments):
    command = [sys.executable, "-m", "millisight.cli.main", "view", "a.image.h5", "--no-browser", *arguments]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = []
    while not lines or "Ctrl-C" not in lines[-1]:
        lines.append(process.stdout.readline())
        assert lines[-1], process.communicate()[1]
    return process, re.search(r"viewer: (http://\S+)", "".join(lines))[1]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code", "last"), [(signal.SIGINT, 0, "viewer closed"), (signal.SIGTERM, 143, "")])
def test_it_serves_on_this_machine_alone_until_it_is_asked_to_end(shown, number, code, last):
    process, url = started(shown)
    try:
        assert url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(url, timeout=10) as answer:
            assert b"Viser" in answer.read()
        process.send_signal(number)
        before = time.monotonic()
        out, err = process.communicate(timeout=15)
        assert time.monotonic() - before < 10
        assert process.returncode == code
        assert out.strip() == last
        assert "Traceback" not in err
    finally:
        process.kill()


@pytest.mark.slow
def test_a_taken_port_is_one_line_and_no_hang(shown):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        line = refused("view", "a.image.h5", "--port", port, cwd=shown, timeout=60)
    assert f"cannot bind port {port}" in line
    assert "choose another --port" in line


def test_what_cannot_be_shown_or_written_is_one_line(shown):
    (shown / "notes.txt").write_text("nothing")
    assert "cannot be shown" in refused("view", "notes.txt", cwd=shown)
    assert "--alpha weights" in refused("view", "a.image.h5", "--alpha", "1", "0", "--html", "a.html", cwd=shown)
    assert "ends in .png" in refused("view", "a.image.h5", "--screenshot", "a.gif", cwd=shown)


def test_a_page_is_written_without_a_display(shown):
    code, out, err = run_inside("view", "a.image.h5", "--html", "a.html", cwd=shown)
    assert code == 0, err
    assert "wrote a.html" in out
    page = (shown / "a.html").read_text()
    assert "<title>a</title>" in page
    assert not re.search(r'(src|href)="https?:', page)
