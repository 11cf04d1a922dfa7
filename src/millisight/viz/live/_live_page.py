"""A page that shows images of a scan while it is taken."""

import io
import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.core import checked_colormap, checked_integer
from millisight.data import SarImage
from millisight.viz import PageServer, Scale, view_coordinates

if TYPE_CHECKING:
    from millisight.rig import LiveStatus

_VIEWS = ("z", "y", "x")
_SHADES = Scale.checked("db", 30)


class LivePage(PageServer):
    """Serves the images as they grow until it is closed; to be used in a `with` block.

    Parameters
    ----------
    title : what is scanned
    rows : of the whole scan
    port : 0 for any free one

    Raises
    ------
    InputError
        The port cannot be bound.
    """

    def __init__(self, title: str, rows: int, port: int = 0) -> None:
        self._title, self._rows = title, checked_integer(rows, name="rows")
        self._shown: dict[str, LiveStatus] = {}
        self._changes: dict[str, list[float]] = {}
        self._ended: str | None = None
        self._stop = threading.Event()
        self._asked_at: float | None = None
        super().__init__("millisight.viz.live", ("page.html", "page.css", "page.js"), port)

    @property
    def stop_asked(self) -> bool:
        """Whether the scan should end after its row: the image is good enough."""
        return self._stop.is_set()

    def show(self, status: "LiveStatus") -> None:
        """Show a newer image; takes no time, pictures are drawn when the page asks for them."""
        self._changes.setdefault(status.radar, []).append(status.change)
        self._shown[status.radar] = status

    def end(self, told: str) -> None:
        """The scan is over; `told` stands on the page, such as where it was written."""
        self._ended = told

    def wait_for_last_look(self, seconds: float = 2.0) -> None:
        """Return when an open page has had the time to fetch the last image."""
        if self._asked_at is None or time.monotonic() - self._asked_at > seconds:
            return
        asked = self._asked_at
        end = time.monotonic() + seconds
        while self._asked_at == asked and time.monotonic() < end:
            time.sleep(0.02)
        time.sleep(min(1.0, seconds / 2))  # for its pictures

    def json_at(self, path: str) -> Callable[[], Any] | None:
        return self._about if path == "about" else None

    def picture_at(self, path: str) -> Callable[[], bytes] | None:
        parts = path.split("/")
        if len(parts) != 4 or parts[0] != "picture" or parts[3] not in _VIEWS:
            return None
        status = {str(number): status for number, status in enumerate(list(self._shown.values()))}.get(parts[1])
        # Radars by their numbers, since names may hold anything. The poses make a new address of a new image.
        return None if status is None else lambda: _png(status.image, parts[3])

    def posted_to(self, path: str) -> Callable[[Any], Any] | None:
        return self._end_scan if path == "stop" else None

    def _end_scan(self, _: Any) -> dict[str, Any]:
        self._stop.set()
        return {}

    def _about(self) -> dict[str, Any]:
        self._asked_at = time.monotonic()
        state = "over" if self._ended is not None else "ending" if self.stop_asked else "scanning"
        return {
            "title": self._title,
            "rows": self._rows,
            "state": state,
            "told": self._ended or "",
            "radars": [self._radar(number, status) for number, status in enumerate(list(self._shown.values()))],
        }

    def _radar(self, number: int, status: "LiveStatus") -> Mapping[str, Any]:
        grid = status.image.grid
        return {
            "number": number,
            "name": status.radar,
            "rows": status.rows,
            "poses": status.poses,
            "lag": round(status.lag, 2),
            "changes": [round(change, 4) for change in self._changes[status.radar] if np.isfinite(change)],
            "views": [{"axis": axis, "extent": _extent(grid, axis)} for axis in _VIEWS],
        }


def _extent(grid: Any, axis: str) -> list[float]:
    """Lowest and highest coordinate to the right, and up, of pixel centres [m]."""
    return [float(value) for side in view_coordinates(grid, axis) for value in (side[0], side[-1])]


def _png(image: SarImage, axis: str) -> bytes:
    """The mean of |I| along an axis in dB under its maximum, a pixel a voxel, the second coordinate upwards."""
    from PIL import Image

    levels = _SHADES(image.project(axis)) / 30 + 1
    pixels = checked_colormap(None)(levels.T[::-1], bytes=True)[..., :3]
    held = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(held, "PNG", compress_level=1)
    return held.getvalue()
