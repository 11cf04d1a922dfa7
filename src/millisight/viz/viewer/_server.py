"""The viewer's web server, which answers its own page alone; and browsers without a window.

viser opens its own port and answers the page of any site that a browser shows; it has no setting for either. Both are
properties of one server here: `_guarded` subclasses viser's two classes, gives the server's event loop a socket of ours
to serve, and puts `_Gate` before viser on every connection. No other package's module is changed.
"""

import asyncio
import functools
import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from millisight.core.errors import DeviceError
from millisight.viz import asked_by_own_page, listen

HOST = "127.0.0.1"
_PORTS = (*range(8080, 8100), 0)  # tried where none was asked for
_LONGEST_HEAD = 1 << 16  # of a request [bytes]
_HEAD_SECONDS = 10.0
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_FLAGS = (
    "--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage", "--hide-scrollbars",
)  # fmt: skip


def start(host: str = HOST, port: int | None = None) -> Any:
    """A `viser.ViserServer` that listens at `host`; without `port` at 8080, or the next free one.

    Raises
    ------
    DeviceError
        viser is not installed, or a version that is not known here.
    InputError
        The port cannot be bound, or there is no such host here.
    """
    try:
        import viser
    except ImportError as error:
        raise DeviceError('the viewer needs viser: pip install "millisight[viewer]"') from error
    listener = listen(host, _PORTS if port is None else [port])
    found = listener.getsockname()[1]
    server = _guarded(listener, host)(host=host, port=found, label="millisight", verbose=False)
    if server.get_port() != found:  # it opened a port of its own
        server.stop()
        listener.close()
        raise DeviceError(f"viser {viser.__version__} is not known here; install viser 1.0 or 1.1")
    return server


def _guarded(listener: socket.socket, host: str) -> Any:
    """The class of viser's server that serves `listener` alone, behind a `_Gate`."""
    import viser
    import viser.infra

    waiting: set[_Gate] = set()  # for the head of their request

    class Sockets(viser.infra.WebsockServer):
        """What viser's server talks through. Its event loop is its own, made when it starts."""

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "_background_event_loop":
                value.create_server = functools.partial(self.serve, value.create_server)
            super().__setattr__(name, value)

        async def serve(self, create: Any, factory: Callable[[], Any], *_: Any, **settings: Any) -> Any:
            return await create(lambda: _Gate(host, factory, waiting), sock=listener, **settings)

        def stop(self) -> None:
            loop: Any = self._background_event_loop
            loop.call_soon_threadsafe(lambda: [gate.hang_up() for gate in [*waiting]])
            super().stop()

    class Server(viser.ViserServer):
        def __init__(self, **settings: Any) -> None:
            with _rich_quiet():
                super().__init__(**settings)

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "_websock_server":  # before it is started
                value.__class__ = Sockets
            super().__setattr__(name, value)

        def stop(self) -> None:
            with _rich_quiet():
                super().stop()

    return Server


@contextmanager
def _rich_quiet() -> Iterator[None]:
    """No boxes of viser's on the terminal."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


class _Gate(asyncio.Protocol):
    """Reads the head of a connection's request; hands the connection on if it comes from the served page.

    `waiting` holds the gates whose connections have not been judged.
    """

    def __init__(self, listening: str, factory: Callable[[], Any], waiting: "set[_Gate]"):
        self._listening, self._factory, self._waiting, self._head = listening, factory, waiting, b""

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        self._limit = asyncio.get_running_loop().call_later(_HEAD_SECONDS, self.hang_up)
        self._waiting.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._judged()

    def hang_up(self) -> None:
        """Close the connection without an answer."""
        self._transport.abort()

    def _judged(self) -> None:
        self._waiting.discard(self)
        self._limit.cancel()

    def data_received(self, data: bytes) -> None:
        self._head += data
        head, complete, _ = self._head.partition(b"\r\n\r\n")
        if not complete and len(head) <= _LONGEST_HEAD:
            return
        self._judged()
        if complete and _names_a_path(head) and asked_by_own_page(self._listening, *_host_and_origin(head)):
            protocol = self._factory()
            self._transport.set_protocol(protocol)
            protocol.connection_made(self._transport)
            protocol.data_received(self._head)
        else:
            text = b"open the address that millisight view printed\n"
            self._transport.write(
                b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Type: text/plain; charset=utf-8\r\n"
                b"Content-Length: %d\r\n\r\n%b" % (len(text), text)
            )
            self._transport.close()


def _names_a_path(head: bytes) -> bool:
    """Whether a request is for a path of this server, as browsers send it, and not for an address or nonsense."""
    target = head.partition(b"\r\n")[0].split(b" ")[1:2]
    return bool(target) and target[0].startswith(b"/") and not target[0].startswith(b"//")


def _host_and_origin(head: bytes) -> tuple[str | None, str | None]:
    """The headers `Host` and `Origin` of a request; no host where one of them comes twice."""
    lines = (line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:])
    values = {"host": [], "origin": []}
    for name, _, value in lines:
        values.get(name.strip().lower(), []).append(value.strip())
    host, origin = values["host"], values["origin"]
    if len(host) != 1 or len(origin) > 1:
        return None, None
    return host[0], (origin or [None])[0]


def url_of(server: Any) -> str:
    """Where a browser on this machine finds the server."""
    host = server.get_host()
    host = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{host}:{server.get_port()}"


@contextmanager
def headless_browser(url: str, width: int, height: int) -> Iterator[None]:
    """A browser without a window that shows `url` while the `with` block runs; DeviceError if there is none."""
    program = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if program is None:
        raise DeviceError(
            f"a screenshot without a window needs Chromium or Chrome, and none of {', '.join(_BROWSERS)} is on the "
            "PATH; install one, or use the viewer's own button"
        )
    sandbox = ("--no-sandbox",) if getattr(os, "geteuid", lambda: 1)() == 0 else ()  # root has none
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [program, *_FLAGS, *sandbox, f"--window-size={width},{height}", f"--user-data-dir={profile}", url]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield
        finally:
            browser.terminate()
            try:
                browser.wait(timeout=5)
            except subprocess.TimeoutExpired:
                browser.kill()
                browser.wait()


def first_client(server: Any, seconds: float) -> Any:
    """The first browser that shows the server's page; DeviceError if none comes within `seconds`."""
    end = time.monotonic() + seconds
    while not (clients := server.get_clients()):
        if time.monotonic() > end:
            raise DeviceError(f"the browser did not show the page within {seconds:.0f} s; is WebGL switched off in it?")
        time.sleep(0.05)
    return next(iter(clients.values()))
