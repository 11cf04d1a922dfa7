"""The viewer's web server, which answers its own page alone; and browsers without a window.

viser opens its own port and answers the page of any site that a browser shows; it has no setting for either. Both are
properties of one server here: `_guarded` subclasses viser's two classes, gives the server's event loop a socket of ours
to serve, and puts `_Gate` before viser on every connection. No other package's module is changed.

Every address begins with a secret that is printed once: whoever does not know it is answered nothing, whatever machine,
user or page it is.
"""

import asyncio
import functools
import logging
import os
import secrets
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from millisight.core.errors import DeviceError
from millisight.viz import MOST_WAITING, asked_by_own_page, listen

HOST = "127.0.0.1"
_PORTS = (*range(8080, 8100), 0)  # tried where none was asked for
_LONGEST_HEAD = 1 << 16  # of a request [bytes]
_LONGEST_PATH = 2000  # of what is asked for [bytes]
_HEAD_SECONDS = 10.0
_SPARE_FILES = 16  # besides those of the event loop
# viser's page is one file with its scripts in it, and runs those that it is sent.
_POLICY = (
    b"Content-Security-Policy: default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; base-uri 'none'; "
    b"form-action 'none'; frame-ancestors 'none'\r\n"
    b"Referrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n"
    b"Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n"
)
_UNTOLD = logging.getLogger(f"{__name__}.untold")
_UNTOLD.setLevel(logging.CRITICAL)
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
        viser is not installed, or a version that is not known here; or the process may open no more files.
    InputError
        The port cannot be bound, or there is no such host here.
    """
    try:
        import viser
    except ImportError as error:
        raise DeviceError('the viewer needs viser: pip install "millisight[viewer]"') from error
    listener = listen(host, _PORTS if port is None else [port])
    try:
        _check_spare_files()
    except DeviceError:
        listener.close()
        raise
    found = listener.getsockname()[1]
    secret = secrets.token_urlsafe(16)
    server = _guarded(listener, host, secret)(host=host, port=found, label="millisight", verbose=False)
    server.secret = secret
    if server.get_port() != found:  # it opened a port of its own
        server.stop()
        listener.close()
        raise DeviceError(f"viser {viser.__version__} is not known here; install viser 1.0 or 1.1")
    return server


def _check_spare_files() -> None:
    """Refuse where the process may not open what a server needs: viser would wait for its thread without end."""
    try:
        with ExitStack() as opened:
            for _ in range(_SPARE_FILES):
                opened.enter_context(open(os.devnull, "rb"))
            asyncio.new_event_loop().close()
    except OSError as error:
        raise DeviceError(
            f"the viewer cannot start: {error.strerror}; allow more open files, as by ulimit -n 256"
        ) from error


def _guarded(listener: socket.socket, host: str, secret: str) -> Any:
    """The class of viser's server that serves `listener` alone, behind a `_Gate`."""
    import viser
    import viser.infra

    waiting: dict[_Gate, None] = {}  # for the head of their request, the oldest first

    class Sockets(viser.infra.WebsockServer):
        """What viser's server talks through. Its event loop is its own, made when it starts."""

        def __setattr__(self, name: str, value: Any) -> None:
            if name == "_background_event_loop":
                value.create_server = functools.partial(self.serve, value.create_server)
            super().__setattr__(name, value)

        async def serve(self, create: Any, factory: Callable[[], Any], *_: Any, **settings: Any) -> Any:
            return await create(lambda: _Gate(host, secret, factory, waiting), sock=listener, **settings)

        def stop(self) -> None:
            loop: Any = self._background_event_loop
            loop.call_soon_threadsafe(lambda: [gate.hang_up() for gate in [*waiting]])
            super().stop()

    class Server(viser.ViserServer):
        secret: str

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

    The secret is taken off the path. `waiting` holds the gates whose connections have not been judged.
    """

    def __init__(self, listening: str, secret: str, factory: Callable[[], Any], waiting: "dict[_Gate, None]"):
        self._listening, self._secret = listening, secret.encode()
        self._factory, self._waiting, self._head = factory, waiting, b""

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        self._limit = asyncio.get_running_loop().call_later(_HEAD_SECONDS, self.hang_up)
        self._waiting[self] = None
        if len(self._waiting) > MOST_WAITING:
            next(iter(self._waiting)).hang_up()

    def connection_lost(self, exc: Exception | None) -> None:
        self._judged()

    def hang_up(self) -> None:
        """Close the connection without an answer."""
        self._judged()
        self._transport.abort()

    def _judged(self) -> None:
        self._waiting.pop(self, None)
        self._limit.cancel()

    def data_received(self, data: bytes) -> None:
        self._head += data
        head, complete, _ = self._head.partition(b"\r\n\r\n")
        if not complete and len(head) <= _LONGEST_HEAD:
            return
        self._judged()
        path = _path_behind(self._secret, head)
        if not complete or path is None or not asked_by_own_page(self._listening, *_host_and_origin(head)):
            self._answer(b"403 Forbidden", b"", b"open the address that millisight view printed\n")
        elif not path.startswith(b"/") and b"\r\nupgrade:" not in head.lower():
            # Without the slash the page would look for its parts beside the secret, not behind it.
            self._answer(b"308 Permanent Redirect", b"Location: /%b/%b\r\n" % (self._secret, path), b"")
        else:
            protocol = self._factory()
            protocol.logger = logging.LoggerAdapter(_UNTOLD, {})  # of messages that cannot be read
            self._transport.set_protocol(protocol)
            protocol.connection_made(_Policed(self._transport))
            method, _, rest = self._head.partition(b" ")
            target = path if path.startswith(b"/") else b"/" + path
            protocol.data_received(b" ".join((method, target, rest.partition(b" ")[2])))

    def _answer(self, status: bytes, header: bytes, text: bytes) -> None:
        self._transport.write(
            b"HTTP/1.1 %b\r\n%bConnection: close\r\nContent-Type: text/plain; charset=utf-8\r\n"
            b"Content-Length: %d\r\n\r\n%b" % (status, header, len(text), text)
        )
        self._transport.close()


class _Policed:
    """A transport that adds the page's policy to the head of the answer."""

    def __init__(self, transport: Any):
        self._transport, self._told = transport, False

    def write(self, data: Any) -> None:
        if not self._told:
            self._told = True
            status, end, rest = bytes(data).partition(b"\r\n")
            data = status + end + _POLICY + rest if end else data
        self._transport.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)


def _path_behind(secret: bytes, head: bytes) -> bytes | None:
    """What a request asks for, behind the secret; None where it asks for anything else.

    It begins with a slash or a question mark, or is empty.
    """
    words = head.partition(b"\r\n")[0].split(b" ")
    if len(words) != 3 or not words[1].startswith(b"/"):
        return None
    given, path = words[1][1 : 1 + len(secret)], words[1][1 + len(secret) :]
    if not secrets.compare_digest(given, secret) or path[:1] not in (b"", b"/", b"?") or len(path) > _LONGEST_PATH:
        return None
    return path


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
    """Where a browser on this machine finds the server, the secret with it."""
    host = server.get_host()
    host = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{host}:{server.get_port()}/{server.secret}"


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
        settings = {**os.environ, "TMPDIR": profile}  # where it leaves a folder each time
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=settings)
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
