"""A web server for pages of this machine alone, such as the annotator's and the live image's.

It listens on 127.0.0.1. Every address begins with a secret that only the page knows, requests must come from the page
itself, and the page may fetch nothing from anywhere else.
"""

import json
import secrets
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from io import BufferedReader, RawIOBase
from typing import Any, Self
from urllib.parse import urlsplit

from millisight.core.errors import MillisightError
from millisight.viz._local_page import MOST_WAITING, asked_by_own_page, listen

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_LARGEST_BODY = 1 << 20
_HOST = "127.0.0.1"
_KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
}


class PageServer(ThreadingHTTPServer):
    """Serves a page until it is closed; to be used in a `with` block.

    Parameters
    ----------
    room : package that holds the page's files
    static : names of these files; the first is served at the address itself
    port : 0 for any free one

    Raises
    ------
    InputError
        The port cannot be bound.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, room: str, static: tuple[str, ...], port: int = 0) -> None:
        self.secret: str = secrets.token_urlsafe(16)
        self.ending: threading.Event = threading.Event()
        self.room: str = room
        self.static: dict[str, str] = {"": static[0], **{name: name for name in static[1:]}}
        self._waiting: dict[socket.socket, None] = {}  # not known to be of the page, the oldest first
        self._pages = 0
        self._left: float | None = None
        self._counting = threading.Lock()
        listener = listen(_HOST, [port])
        super().__init__(listener.getsockname(), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self._thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)

    def get_request(self) -> tuple[socket.socket, Any]:
        """Accept a connection; where too many wait to be judged, the oldest of them ends."""
        try:
            connection, address = super().get_request()
        except OSError:
            time.sleep(0.05)  # it would be tried again at once, without end
            raise
        with self._counting:
            self._waiting[connection] = None
            oldest = next(iter(self._waiting)) if len(self._waiting) > MOST_WAITING else None
        if oldest is not None:
            self.judged(oldest)
            with suppress(OSError):
                oldest.shutdown(socket.SHUT_RDWR)  # its thread closes it
        return connection, address

    def judged(self, connection: socket.socket) -> None:
        """The connection is the page's own, or has ended."""
        with self._counting:
            self._waiting.pop(connection, None)

    def shutdown_request(self, request: Any) -> None:
        self.judged(request)
        super().shutdown_request(request)

    def json_at(self, path: str) -> Callable[[], Any] | None:
        """What answers a GET of the path with what JSON can hold; None: there is nothing."""
        return None

    def picture_at(self, path: str) -> Callable[[], bytes] | None:
        """What answers a GET of the path with a PNG; None: there is nothing."""
        return None

    def posted_to(self, path: str) -> Callable[[Any], Any] | None:
        """What answers a POST of JSON to the path; None: there is nothing."""
        return None

    @property
    def address(self) -> str:
        """Of the page, with the secret."""
        return f"http://{_HOST}:{self.server_address[1]}/{self.secret}/"

    def finish(self) -> None:
        """Called when the server ends."""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, exc_type: object, exc_val: object, exc_tb: object) -> None:
        self.ending.set()
        self.finish()
        self.shutdown()
        self._thread.join()
        self.server_close()

    def wait(self, *, until_closed: bool, grace: float = 3.0) -> None:
        """Return when the last page has been closed for `grace` seconds; else only when interrupted."""
        while True:
            time.sleep(0.1)
            with self._counting:
                left = self._left
            if until_closed and left is not None and time.monotonic() - left > grace:
                return

    @contextmanager
    def page_open(self) -> Iterator[None]:
        """While the block runs, a page is open."""
        with self._counting:
            self._pages += 1
            self._left = None
        try:
            yield
        finally:
            with self._counting:
                self._pages -= 1
                self._left = None if self._pages else time.monotonic()


class _Timely(RawIOBase):
    """What a page sends, up to the time by which a request must be whole, however slowly its bytes come.

    Raises
    ------
    TimeoutError
    """

    def __init__(self, connection: socket.socket, seconds: float):
        self._connection, self._seconds = connection, seconds
        self.begin()

    def begin(self) -> None:
        """From now on the seconds count."""
        self._until = time.monotonic() + self._seconds

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._until - time.monotonic()
        if left <= 0:
            raise TimeoutError("the request takes too long")
        self._connection.settimeout(left)
        try:
            return self._connection.recv_into(buffer)
        finally:
            self._connection.settimeout(self._seconds)  # for the answer


class _Handler(BaseHTTPRequestHandler):
    server: PageServer  # ty: ignore[incompatible-mutable-override]
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "millisight", ""
    timeout = 60  # for the whole of a request, and until the next one begins [s]
    disable_nagle_algorithm = True  # it holds every answer back for 40 ms

    def setup(self) -> None:
        super().setup()
        self.rfile.close()  # whose timeout begins anew at every byte
        seconds: Any = self.timeout
        self._sent = _Timely(self.connection, seconds)
        self._requests = self.rfile = BufferedReader(self._sent)

    def handle_one_request(self) -> None:
        self._sent.begin()
        self._requests.peek(1)
        self._sent.begin()
        super().handle_one_request()

    def do_GET(self) -> None:
        path = self._path()
        if path is None:
            return
        name = self.server.static.get(path)
        if name is not None:
            body = files(self.server.room).joinpath(name).read_bytes()
            self._send(HTTPStatus.OK, body, _KINDS[name.rpartition(".")[2]])
        elif path == "open":
            self._stay_open()
        elif (told := self.server.json_at(path)) is not None:
            self._answer(told)
        elif (drawn := self.server.picture_at(path)) is not None:
            self._answer(drawn, "image/png")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "not found")

    def do_POST(self) -> None:
        path = self._path()
        if path is None:
            return
        ask = self.server.posted_to(path)
        if ask is None:
            self._refuse(HTTPStatus.NOT_FOUND, "not found")
            return
        try:
            length = int(self.headers.get("Content-Length", ""))
            if not 0 <= length <= _LARGEST_BODY:
                raise ValueError("too long")
            asked = json.loads(self.rfile.read(length))
        except (ValueError, RecursionError):
            self._refuse(HTTPStatus.BAD_REQUEST, "the request is not JSON; reload the page")
            return
        self._answer(lambda: ask(asked))

    def _path(self) -> str | None:
        """What is asked for, after the secret; None, refused, where the request is not the page's own."""
        hosts, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        once = len(hosts) == 1 and len(origins) <= 1 and not self.headers.defects
        ours = once and asked_by_own_page(_HOST, hosts[0], (origins or [None])[0]) and self.path.startswith("/")
        try:
            secret, _, rest = urlsplit(self.path).path.removeprefix("/").partition("/")
        except ValueError:  # of an address such as http://[/
            ours = False
            secret, rest = "", ""
        if ours and secrets.compare_digest(secret.encode(), self.server.secret.encode()):
            self.server.judged(self.connection)
            return rest
        self._refuse(HTTPStatus.FORBIDDEN, "open the address that millisight printed")
        return None

    def _answer(self, ask: Any, kind: str | None = None) -> None:
        try:
            answer = ask()
        except (MillisightError, ImportError, MemoryError, OSError) as error:
            self._refuse(HTTPStatus.UNPROCESSABLE_ENTITY, str(error) or type(error).__name__)
            return
        if kind is None:
            self._send_json(HTTPStatus.OK, answer)
        else:
            self._send(HTTPStatus.OK, answer, kind)

    def _stay_open(self) -> None:
        """An event stream that ends with the page, or with the server: so each knows of the other."""
        self.close_connection = True
        self._head(HTTPStatus.OK, "text/event-stream")
        self.end_headers()
        self.wfile.write(b": open\n\n")
        with self.server.page_open(), selectors.DefaultSelector() as selector:  # any number of connections
            selector.register(self.connection, selectors.EVENT_READ)
            while not self.server.ending.wait(0.05):
                if selector.select(0) and not self.connection.recv(1):
                    return
        self.wfile.write(b"event: ended\ndata:\n\n")

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True
        self._send_json(status, {"error": why})

    def _send_json(self, status: HTTPStatus, value: Any) -> None:
        self._send(status, json.dumps(value).encode(), "application/json")

    def _send(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self._head(status, kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def send_response(self, code: int, message: str | None = None) -> None:
        """The first lines of every answer, of those that the library gives itself as well."""
        super().send_response(code, message)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")

    def _head(self, status: HTTPStatus, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if self.close_connection:
            self.send_header("Connection", "close")

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing."""

    def handle(self) -> None:
        try:
            super().handle()
        except OSError:  # the page was closed, the request took too long, or no more files may be opened
            self.close_connection = True
