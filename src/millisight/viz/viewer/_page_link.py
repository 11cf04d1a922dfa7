"""What the script in a browser's page and the viewer tell each other.

viser passes scripts on as its `RunJavascriptMessage`, and what a user enters in a control as its update. A text field
that is never drawn is the script's way to the viewer: each of its values is one message in JSON.
"""

import json
import zlib
from collections.abc import Callable
from importlib.resources import files
from typing import Any

Heard = Callable[["PageLink", dict[str, Any]], None]


class PageLink:
    """One browser's page.

    Parameters
    ----------
    client : viser's handle of the browser
    title : of what is shown
    keys : (key, what it does)
    heard : called with each message of the page: `{"address": text}` once, then `{"key": name}` and `{"ray": numbers}`
    """

    def __init__(self, client: Any, *, title: str, keys: list[tuple[str, str]], heard: Heard):
        self.client: Any = client
        control = client.gui.add_text("", "", visible=False)

        async def update(_: Any) -> None:  # asynchronous, so that each message is heard, and in its order
            heard(self, json.loads(control.value))

        control.on_update(update)
        page = {"uuid": control._impl.uuid, "title": title, "of": mark_of(title), "keys": keys}
        self._run(f"{script('view.js')}\nconst page = {json.dumps(page)};\n{script('live.js')}")

    def tell(self, **told: Any) -> None:
        """Pass something on to the script."""
        self._run(f"window.millisightPage && window.millisightPage.told({json.dumps(told)})")

    def _run(self, source: str) -> None:
        from viser import _messages  # not in its public list; plots go the same way

        self.client._websock_connection.queue_message(_messages.RunJavascriptMessage(source))


def mark_of(title: str) -> str:
    """What stands for a title in the page's address, which viser writes anew without quotes."""
    return f"{zlib.crc32(title.encode()):08x}"


def script(name: str) -> str:
    """A file of this folder."""
    return files("millisight.viz.viewer").joinpath(name).read_text(encoding="utf-8")
