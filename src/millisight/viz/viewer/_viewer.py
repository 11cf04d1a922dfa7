"""The viewer: a server, the panes in its scene, and the panel beside them, kept in step."""

import dataclasses
import logging
import threading
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from millisight.core import atomic_path
from millisight.core.errors import DeviceError
from millisight.viz import Scale, checked_colormap, styled
from millisight.viz.viewer._contents import Contents
from millisight.viz.viewer._layout import PaneGrid
from millisight.viz.viewer._panel import ControlPanel
from millisight.viz.viewer._server import HOST, first_client, headless_browser, start, url_of
from millisight.viz.viewer._settings import ViewSettings
from millisight.viz.viewer._share import page

BACKGROUND = (26, 27, 30)
_PATIENCE = 40.0  # with a browser [s]

logger = logging.getLogger(__name__)


class Viewer:
    """Contents in a browser, until `close`; a `with` block closes it.

    Parameters
    ----------
    contents : what `gather` found
    settings : to begin with
    host, port : see `server.start`

    Raises
    ------
    DeviceError, InputError
        As `server.start`.
    """

    def __init__(
        self, contents: Contents, settings: ViewSettings | None = None, *, host: str = HOST, port: int | None = None
    ):
        self.settings: ViewSettings = settings or first_settings(contents)
        self.painted: ViewSettings = self.settings
        self._wanted, self._ended = threading.Condition(), False
        self._painter = threading.Thread(target=self._paint, daemon=True)
        self.server: Any = start(host, port)
        try:
            self.panes: PaneGrid = PaneGrid(self.server, contents, self.settings)
            self._panel = ControlPanel(
                self.server.gui, self.panes, self.settings, change=self.change, look_from=self.look_from,
                picture=self.picture, page=self._page,
            )  # fmt: skip
        except BaseException:
            self.server.stop()
            raise
        self._painter.start()
        self.server.on_client_connect(self._greet)

    @property
    def url(self) -> str:
        """Where a browser on this machine finds it."""
        return url_of(self.server)

    def change(self, **settings: Any) -> None:
        """Change settings by name; the scene follows, and skips what was changed again before it was drawn."""
        with self._wanted:
            self.settings = dataclasses.replace(self.settings, **settings)
            self._wanted.notify_all()

    def _paint(self) -> None:
        """Draw what was asked for last, over and over."""
        while True:
            with self._wanted:
                self._wanted.wait_for(lambda: self._ended or self.settings is not self.painted)
                if self._ended:
                    return
                settings = self.settings
            try:
                self.panes.show(settings)
                self._panel.update(settings)
            except Exception:  # a thread without it would die in silence, and the viewer with it
                logger.exception("the viewer could not draw %s", settings)
            self.painted = settings

    async def _greet(self, client: Any) -> None:
        """Let the panes follow a browser's camera; asynchronous, so that places arrive in the camera's order."""

        async def follow(camera: Any) -> None:
            self.panes.place(camera.position, camera.up_direction)

        if len(self.panes.panes) > 1:
            client.camera.on_update(follow)

    def look_from(self, client: Any, view: str) -> None:
        """Move a browser's camera to one of `VIEWS`."""
        with client.atomic():
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position = tuple(self.panes.camera_of(view))
            client.camera.look_at = (0.0, 0.0, 0.0)

    def picture(self, client: Any, size: tuple[int, int] | None = None) -> bytes:
        """A PNG of what a browser shows, with the colour bar.

        Raises
        ------
        DeviceError
            The browser gives none.
        """
        width, height = size or (client.camera.image_width, client.camera.image_height)
        try:
            before, end = None, time.monotonic() + _PATIENCE
            while True:  # until two pictures in a row are the same: labels and textures come a moment later
                shown = client.get_render(height, width, transport_format="png", timeout=_PATIENCE)
                if size is None or (before is not None and np.array_equal(before, shown)) or time.monotonic() > end:
                    break
                before = shown
        except (RuntimeError, TimeoutError) as error:
            raise DeviceError(f"the browser sent no picture: {error}; is its window open and in front?") from error
        return _with_colour_bar(shown, self.settings, any(pane.levels for pane in self.panes.panes))

    def _page(self, client: Any) -> bytes:
        """What a browser shows, as a page to share."""
        camera = client.camera.position, client.camera.up_direction
        return page(self.panes.contents, self.settings, camera).encode()

    def screenshot(self, path: Path, *, size: tuple[int, int] = (1200, 800)) -> None:
        """Write a PNG of the start view, drawn by a browser without a window.

        Raises
        ------
        DeviceError
            There is no such browser, or it cannot draw.
        FileError
        """
        with headless_browser(self.url, size[0] + 420, size[1] + 120):
            picture = self.picture(first_client(self.server, _PATIENCE), size)
        with atomic_path(path) as temporary:
            temporary.write_bytes(picture)

    def __repr__(self) -> str:
        shown = ", ".join(exhibit.title for exhibit in self.panes.contents.exhibits)
        return f"Viewer({'closed' if self._ended else self.url}, {shown})"

    def wait(self) -> None:
        """Wait until it is closed; Ctrl-C closes it."""
        try:
            with self._wanted:
                self._wanted.wait_for(lambda: self._ended)
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """Stop drawing and serving; once it is closed, nothing."""
        with self._wanted:
            if self._ended:
                return
            self._ended = True
            self._wanted.notify_all()
        self._painter.join(timeout=5)
        self.server.stop()

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def first_settings(contents: Contents, **settings: Any) -> ViewSettings:
    """How to show these contents first: planes through the first image's strongest voxel, weights as they are."""
    for exhibit in contents.exhibits:
        if exhibit.levels is not None:
            strongest = exhibit.levels.strongest(0.0, 1).points
            settings.setdefault("at", tuple(map(float, strongest[0] if len(strongest) else exhibit.bounds.mean(0))))
            break
    shares = [exhibit.share for exhibit in contents.exhibits if exhibit.pair is not None]
    if shares:
        settings.setdefault("share", shares[0])
    # Over several images the apertures would hide each other.
    settings.setdefault("path", len(contents.exhibits) == 1)
    return ViewSettings(**settings)


@styled
def _with_colour_bar(shown: np.ndarray, settings: ViewSettings, bar: bool) -> bytes:
    """A rendered picture (rows, columns, 4) on the viewer's background, the colour bar under it, as PNG."""
    opaque = shown[..., 3:].astype(np.float32) / 255
    rgb = (shown[..., :3] * opaque + np.array(BACKGROUND) * (1 - opaque)).astype(np.uint8)
    rows, columns = rgb.shape[:2]
    under, dpi = (70 if bar else 0), 100
    figure = Figure(figsize=((columns + 0.5) / dpi, (rows + under + 0.5) / dpi), dpi=dpi, facecolor="white")
    figure.figimage(rgb, 0, under)
    if bar:
        place = (0.3, 42 / (rows + under), 0.4, 14 / (rows + under))
        axes = figure.add_axes(place)
        scale = Scale("db", -settings.range_db)
        shades = ScalarMappable(scale.norm, checked_colormap(settings.colormap))
        colours = figure.colorbar(shades, cax=axes, orientation="horizontal")
        reference = "the strongest image's maximum" if settings.common else "each image's maximum"
        colours.set_label(f"|I|  [dB under {reference}], from {settings.threshold_db:g} dB".replace("-", "\u2212"))
    written = BytesIO()
    figure.savefig(written, format="png", dpi=dpi, metadata={"Software": None})
    return written.getvalue()
