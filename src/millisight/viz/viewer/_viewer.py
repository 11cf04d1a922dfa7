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
from millisight.viz.viewer._address import from_address, to_address
from millisight.viz.viewer._contents import Contents
from millisight.viz.viewer._keys import KEYS, VIEW_KEYS, changes_of, limits_text, note_on, under_the_lid
from millisight.viz.viewer._layout import PaneGrid
from millisight.viz.viewer._levels import FLOOR_DB
from millisight.viz.viewer._page_link import PageLink
from millisight.viz.viewer._panel import ControlPanel, explained
from millisight.viz.viewer._server import HOST, first_client, headless_browser, start, url_of
from millisight.viz.viewer._settings import ViewSettings, reference_text
from millisight.viz.viewer._share import page, title_of

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
        self._links: dict[int, PageLink] = {}  # by the browser's number
        self._painter = threading.Thread(target=self._paint, daemon=True)
        self.server: Any = start(host, port)
        try:
            self.panes: PaneGrid = PaneGrid(self.server, contents, self.settings)
            self.server.gui.set_panel_label(f"millisight: {self.title}")
            self._panel = ControlPanel(
                self.server.gui, self.panes, self.settings, change=self._set, look_from=self.look_from,
                picture=self.picture, page=self._page,
            )  # fmt: skip
        except BaseException:
            self.server.stop()
            raise
        self._painter.start()
        self.server.on_client_connect(self._greet)
        self.server.on_client_disconnect(lambda client: self._links.pop(client.client_id, None))

    @property
    def title(self) -> str:
        """What is shown, in a few words."""
        return title_of(self.panes.contents)

    @property
    def url(self) -> str:
        """Where a browser on this machine finds it."""
        return url_of(self.server)

    def change(self, **settings: Any) -> None:
        """Change settings by name; the scene follows, and skips what was changed again before it was drawn."""
        self._set(**settings, followed=True)

    def _set(self, *, followed: bool = False, **settings: Any) -> None:
        """Change settings; `followed`: the controls do not show them yet."""
        with self._wanted:
            self.settings = dataclasses.replace(self.settings, **settings)
            self._wanted.notify_all()
        if followed:
            self._panel.follow(self.settings)
        for link in [*self._links.values()]:
            self._tell(link)

    def _tell(self, link: PageLink) -> None:
        """Let a page write the settings into its address, and say what is hidden."""
        link.tell(address=to_address(self.settings), **note_on(self.settings, self.panes.contents.exhibits))

    def _hear(self, link: PageLink, message: dict[str, Any]) -> None:
        """Do what a page asks for."""
        if "ray" in message:
            ray = np.array(message["ray"], dtype=float)
            link.tell(picked=self.panes.told_at(ray[:3], ray[3:], self.settings))
        elif message.get("key") in VIEW_KEYS:
            self.look_from(link.client, VIEW_KEYS[message["key"]])
        elif message.get("key") in KEYS:
            self.change(**changes_of(message["key"], self.settings, self.panes.contents.exhibits))
        elif "address" in message:
            with explained(link.client, "the address is not understood"):
                if message["address"] is not None:
                    asked = from_address(message["address"])
                    self.change(**{field.name: getattr(asked, field.name) for field in dataclasses.fields(asked)})
            self._tell(link)

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
        link = PageLink(client, title=self.title, keys=[*KEYS.items()], heard=self._hear)
        self._links[client.client_id] = link

        async def follow(camera: Any) -> None:
            self.panes.place(camera.position, camera.up_direction)

        if len(self.panes.panes) > 1:
            client.camera.on_update(follow)

    def look_from(self, client: Any, view: str) -> None:
        """Move a browser's camera to one of `VIEWS`."""
        with client.atomic():
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position = tuple(self.panes.camera_of(view))
            client.camera.look_at = tuple(self.panes.look_at)

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
        camera = client.camera.position, client.camera.up_direction, client.camera.look_at
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
    """How to show these contents first: under the lid where there is one, planes through the first image's strongest
    voxel there, weights as they are.
    """
    settings = {**under_the_lid(contents.exhibits), **settings}
    shown = ViewSettings(**settings)
    for exhibit in contents.exhibits:
        if exhibit.levels is not None:
            levels = exhibit.levels
            if exhibit.cover is not None and exhibit.cover.levels is not None and not shown.clutter:
                levels = exhibit.cover.levels
            strongest = levels.strongest(FLOOR_DB, 1, shown.limits).points
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
        told = [f"|I|  [dB under {reference_text(settings)}], from {settings.threshold_db:g} dB", limits_text(settings)]
        colours.set_label("; ".join(filter(None, told)).replace("-", "\u2212"))
    written = BytesIO()
    figure.savefig(written, format="png", dpi=dpi, metadata={"Software": None})
    return written.getvalue()
