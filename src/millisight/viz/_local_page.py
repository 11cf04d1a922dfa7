"""Pages that a program serves to its own machine: the port, who may ask for the page, and the browser that shows it."""

import errno
import ipaddress
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Iterable
from urllib.parse import urlsplit

from millisight.core import checked_integer
from millisight.core.errors import InputError

MOST_WAITING = 64
"""Connections of which it is not known whether they are the page's: beyond, the oldest ends. No program can keep others
from a page by opening all that a process may open."""

_PATIENCE = 2.0  # with a browser that does not say whether it opened [s]


def listen(host: str, ports: Iterable[int]) -> socket.socket:
    """A socket that listens at the first of `ports` that is free.

    The socket is handed to the server as it is, so that no other program can take the port in between.

    Parameters
    ----------
    host : an address or name of this machine
    ports : from 0 to 65535; 0 is any free one

    Raises
    ------
    InputError
        No such host here, or none of the ports can be bound.
    """
    ports = [checked_integer(port, name="port", minimum=0) for port in ports]
    if max(ports, default=0) > 65535:
        raise InputError(f"port is {max(ports)}; expected 0 to 65535")
    for port in ports:
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            return socket.create_server(address, family=family)
        except (socket.gaierror, UnicodeError, OverflowError) as error:
            raise InputError(
                f"cannot use --host {host}, --port {port}: {error.args[-1]}; expected an address of this machine"
            ) from error
        except OSError as error:
            taken = isinstance(error, PermissionError) or error.errno == errno.EADDRINUSE
            if not taken or port == ports[-1]:
                raise InputError(
                    f"cannot bind port {port} of {host}: {os.strerror(error.errno or 0)}; choose another --port, or "
                    "leave --port out to use a free one"
                ) from error
    raise InputError("no port to bind; expected at least one")


def asked_by_own_page(listening: str, host: str | None, origin: str | None) -> bool:
    """Whether a request comes from the served page, and not from another site's page in the same browser.

    A browser names in `Origin` the page whose script makes a request; a request without `Origin` comes from no script.
    A page elsewhere whose name was made to point at this machine shows that name in `Host`: so the only names taken are
    those that were asked for, those of this machine and, where the server listens to others, addresses in numbers.

    Parameters
    ----------
    listening : address at which the server listens
    host, origin : the request's headers of these names, None where it has none
    """
    asked = _name(host or "")
    if asked is None:
        return False
    known = asked == listening.lower() or _is_local(asked)
    if not known and not (not _is_local(listening) and (_is_number(asked) or asked == socket.gethostname().lower())):
        return False
    return origin in (None, f"http://{host}", f"https://{host}")


def _name(host: str) -> str | None:
    """The name in `name:port`; None where there is none, or more than that."""
    try:
        parts = urlsplit(f"//{host}")
        port = "" if parts.port is None else f":{parts.port}"
    except ValueError:
        return None
    name = parts.hostname or ""
    return name if host.lower() == (f"[{name}]" if ":" in name else name) + port else None


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_local(name: str) -> bool:
    try:
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def open_browser(url: str) -> bool:
    """Show a page in the user's browser; False where there is no window to show it in."""
    windowed = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    )
    # Without a window system Python would start a browser for terminals in this one.
    if not windowed:
        return False
    opened: list[bool] = []
    # Some browsers return only when their window is closed.
    thread = threading.Thread(target=lambda: opened.append(webbrowser.open(url)), daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    return opened != [False]
