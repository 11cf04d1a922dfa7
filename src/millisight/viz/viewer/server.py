"""The viewer's web server: found a port, started without chatter, kept to its page; and browsers without a window."""

import logging
import os
import shutil
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from millisight.errors import DeviceError, InputError
from millisight.viz.local_page import asked_by_own_page

HOST, PORT = "127.0.0.1", 8080
_MORE_PORTS = 20  # tried where none was asked for
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
        viser is not installed.
    InputError
        The port is taken or not allowed, or there is no such host here.
    """
    try:
        import rich
        import viser
    except ImportError as error:
        raise DeviceError('the viewer needs viser: pip install "millisight[viewer]"') from error
    # viser would try a thousand other ports, and wait for ever where there is no such host.
    found = _free_port(host, port)
    rich.get_console().quiet = True  # viser prints boxes to it, from several threads
    # A browser that opens a connection ahead and does not use it is no error to tell of.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with _own_pages_alone(host):
        server = viser.ViserServer(host=host, port=found, label="millisight", verbose=False)
    if server.get_port() != found:
        server.stop()
        raise InputError(f"port {found} of {host} was taken this very moment; try again")
    return server


_guarding = threading.Lock()


@contextmanager
def _own_pages_alone(host: str) -> Iterator[None]:
    """A server that viser starts in the `with` block answers its own page alone.

    viser answers every page that a browser shows, and has no setting for it. It has websockets call `process_request`
    before it accepts a connection, so here that asks first.
    """
    from websockets.asyncio import server as sockets

    plain, guarded = sockets.serve, False

    def serve(*args: Any, process_request: Any, **settings: Any) -> Any:
        def ask(connection: Any, request: Any) -> Any:
            headers = [request.headers.get_all(name) for name in ("Host", "Origin")]
            if all(len(values) <= 1 for values in headers):
                host_header, origin = (values[0] if values else None for values in headers)
                if asked_by_own_page(host, host_header, origin):
                    return process_request(connection, request)
            return connection.respond(403, "open the address that millisight view printed\n")

        nonlocal guarded
        guarded = True
        return plain(*args, process_request=ask, **settings)

    with _guarding:
        sockets.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            sockets.serve = plain
    if not guarded:
        logging.getLogger(__name__).warning("this version of viser lets other sites' pages look at what is shown")


def _free_port(host: str, port: int | None) -> int:
    wanted = [port] if port is not None else [*range(PORT, PORT + _MORE_PORTS), 0]
    for number in wanted:
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind) as probe:
                if os.name == "posix":  # a port that was left a moment ago is free, as the server sees it
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return int(probe.getsockname()[1])
        except (socket.gaierror, UnicodeError, OverflowError) as error:
            raise InputError(
                f"--host {host}, --port {number}: {error.args[-1]}; expected an address of this machine"
            ) from error
        except OSError as error:
            if port is not None or (not isinstance(error, PermissionError) and error.errno not in _TAKEN):
                raise InputError(
                    f"cannot listen at port {number} of {host}: {error.strerror}; choose another --port, or leave it "
                    "out to have a free one found"
                ) from error
    raise InputError(f"no free port was found at {host}; pass --port")


_TAKEN = (98, 48, 10048)  # EADDRINUSE of Linux, macOS, Windows


def url_of(server: Any) -> str:
    """Where a browser on this machine finds the server."""
    host = server.get_host()
    host = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{host}:{server.get_port()}"


@contextmanager
def headless_browser(url: str, width: int, height: int) -> Iterator[None]:
    """A browser without a window that shows `url` while the `with` block runs.

    Raises
    ------
    DeviceError
        There is none.
    """
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
    """The first browser that shows the server's page.

    Raises
    ------
    DeviceError
        None comes within `seconds`.
    """
    end = time.monotonic() + seconds
    while not (clients := server.get_clients()):
        if time.monotonic() > end:
            raise DeviceError(f"the browser did not show the page within {seconds:.0f} s; is WebGL switched off in it?")
        time.sleep(0.05)
    return next(iter(clients.values()))
