"""Pages that a program serves to its own machine: who may ask for them, and the browser that shows them."""

import ipaddress
import os
import sys
import threading
import webbrowser
from urllib.parse import urlsplit

_PATIENCE = 2.0  # with a browser that does not say whether it opened [s]


def asked_by_own_page(listening: str, host: str | None, origin: str | None) -> bool:
    """Whether a request can be the served page's own, and not that of another site's page in the same browser.

    A browser says of every request that a script makes elsewhere which page it comes from; what comes without that is
    no page's script. A page elsewhere whose name is made to lead here gives itself away by that name, where the server
    listens to this machine alone.

    Parameters
    ----------
    listening : address at which the server listens
    host, origin : the request's headers of these names, None where it has none
    """
    asked = _name(host or "")
    if asked is None or (_is_local(listening) and not _is_local(asked) and asked != listening):
        return False
    return origin in (None, f"http://{host}", f"https://{host}")


def _name(host: str) -> str | None:
    """The name in `name:port`; None where there is none."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


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
    # Some browsers come back when their window is closed.
    thread = threading.Thread(target=lambda: opened.append(webbrowser.open(url)), daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    return opened != [False]
