"""Who may ask for a page of this machine, and the browser that shows it."""

import time

import pytest

from millisight.viz.local_page import asked_by_own_page, open_browser

OWN = [
    ("127.0.0.1", "127.0.0.1:8080", None),
    ("127.0.0.1", "localhost:8080", "http://localhost:8080"),
    ("127.0.0.1", "localhost:9000", "http://localhost:9000"),  # through `ssh -L 9000:localhost:8080`
    ("localhost", "[::1]:8080", "http://[::1]:8080"),
    ("0.0.0.0", "lab:8080", "http://lab:8080"),
    ("0.0.0.0", "lab", "https://lab"),  # behind a server that speaks TLS
]
OTHERS = [
    ("127.0.0.1", "localhost:8080", "https://evil.example"),
    ("127.0.0.1", "localhost:8080", "http://localhost:3000"),  # another program's page
    ("127.0.0.1", "localhost:8080", "null"),  # a sandboxed frame, a file
    ("127.0.0.1", "localhost:8080", ""),
    ("127.0.0.1", "evil.example:8080", "http://evil.example:8080"),  # a name that leads here
    ("127.0.0.1", "evil.example:8080", None),
    ("127.0.0.1", "127.0.0.1.evil.example:8080", None),
    ("127.0.0.1", "[", None),
    ("127.0.0.1", "", None),
    ("127.0.0.1", None, None),
    ("0.0.0.0", "lab:8080", "http://evil.example"),
    ("0.0.0.0", "lab:8080", "http://[lab:8080"),
]


@pytest.mark.parametrize(("listening", "host", "origin"), OWN)
def test_the_page_itself_may_ask(listening, host, origin):
    assert asked_by_own_page(listening, host, origin)


@pytest.mark.parametrize(("listening", "host", "origin"), OTHERS)
def test_other_pages_may_not(listening, host, origin):
    assert not asked_by_own_page(listening, host, origin)


def test_a_browser_that_cannot_be_started_or_stays_is_no_hang(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("webbrowser.open", None)  # not to be called
    assert not open_browser("http://127.0.0.1:1/")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("millisight.viz.local_page._PATIENCE", 0.1)
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert not open_browser("http://127.0.0.1:1/")
    monkeypatch.setattr("webbrowser.open", lambda url: time.sleep(0.5))
    before = time.monotonic()
    assert open_browser("http://127.0.0.1:1/")
    assert time.monotonic() - before < 0.4
