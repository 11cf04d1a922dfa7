"""The port of a page of this machine, who may ask for it, and the browser that shows it."""

import socket
import time

import pytest

from millisight.core.errors import InputError
from millisight.viz import asked_by_own_page, listen, open_browser

OWN = [
    ("127.0.0.1", "127.0.0.1:8080", None),
    ("127.0.0.1", "localhost:8080", "http://localhost:8080"),
    ("127.0.0.1", "localhost:9000", "http://localhost:9000"),  # through `ssh -L 9000:localhost:8080`
    ("localhost", "[::1]:8080", "http://[::1]:8080"),
    ("0.0.0.0", "192.0.2.1:8080", "http://192.0.2.1:8080"),  # no name, so nobody else's
    ("0.0.0.0", f"{socket.gethostname().lower()}:8080", None),
    ("lab", "lab:8080", "http://lab:8080"),
    ("lab", "lab", "https://lab"),  # behind a server that speaks TLS
]
OTHERS = [
    ("127.0.0.1", "localhost:8080", "https://evil.example"),
    ("127.0.0.1", "localhost:8080", "http://localhost:3000"),  # another program's page
    ("127.0.0.1", "localhost:8080", "null"),  # a sandboxed frame, a file
    ("127.0.0.1", "localhost:8080", ""),
    ("127.0.0.1", "evil.example:8080", "http://evil.example:8080"),  # a name that leads here
    ("127.0.0.1", "evil.example:8080", None),
    ("127.0.0.1", "127.0.0.1.evil.example:8080", None),
    ("127.0.0.1", "127.0.0.1:8080.evil.example", None),
    ("127.0.0.1", "evil@127.0.0.1:8080", None),
    ("127.0.0.1", "[::1].evil.example", None),
    ("127.0.0.1", "[::1].evil.example:8080", None),
    ("127.0.0.1", "127.0.0.1:8080/evil", None),
    ("127.0.0.1", "[", None),
    ("127.0.0.1", "", None),
    ("127.0.0.1", None, None),
    ("0.0.0.0", "evil.example:8080", "http://evil.example:8080"),
    ("0.0.0.0", "evil.example:8080", None),
    ("192.0.2.1", "evil.example:8080", None),
    ("127.0.0.1", "192.0.2.1:8080", None),
    ("lab", "lab:8080", "http://evil.example"),
    ("lab", "lab:8080", "http://[lab:8080"),
]


def test_the_first_free_port_is_bound_and_kept():
    with listen("127.0.0.1", [0]) as first:
        taken = first.getsockname()[1]
        with listen("127.0.0.1", [taken, 0]) as second:
            assert second.getsockname()[1] != taken
            with socket.create_connection(second.getsockname()):  # it listens
                pass
        with pytest.raises(InputError, match=f"cannot bind port {taken} of 127.0.0.1: .*; choose another --port"):
            listen("127.0.0.1", [taken])


@pytest.mark.parametrize(("host", "port"), [("no.such.host.invalid", 0), ("a" * 70, 0)])
def test_what_is_no_address_is_said(host, port):
    with pytest.raises(InputError, match="expected an address of this machine"):
        listen(host, [port])


@pytest.mark.parametrize("ports", [[70_000], [-1], []])
def test_what_is_no_port_is_said(ports):
    with pytest.raises(InputError, match="port"):
        listen("127.0.0.1", ports)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(InputError, match="cannot bind port 0 of 192.0.2.1"):  # RFC 5737: for documents
        listen("192.0.2.1", [0])


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
    monkeypatch.setattr("millisight.viz._local_page._PATIENCE", 0.1)
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert not open_browser("http://127.0.0.1:1/")
    monkeypatch.setattr("webbrowser.open", lambda url: time.sleep(4))
    before = time.monotonic()
    assert open_browser("http://127.0.0.1:1/")
    assert time.monotonic() - before < 3
