"""The viewer: a server, the panes in its scene, and the panel beside them, kept in step."""

import dataclasses
import logging
import threading
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from millisight.errors import DeviceError
from millisight.files import atomic_path
from millisight.viz.style import Scale, checked_colormap, styled
from millisight.viz.viewer.contents import Contents
from millisight.viz.viewer.layout import FOV, placed, start_camera
from millisight.viz.viewer.pane import Pane
from millisight.viz.viewer.server import HOST, first_client, headless_browser, start, url_of
from millisight.viz.viewer.settings import Settings

MOST_POINTS = 400_000
"""Drawn in all panes together: what turns smoothly without a graphics card."""

VIEWS = {
    "aslant": (-0.28, -0.80, 0.62),
    "above": (0.0, -1e-3, 1.0),
    "front": (0.0, -1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
}
"""Where the camera looks from."""

BACKGROUND = (26, 27, 30)
_PATIENCE = 40.0  # with a browser [s]

logger = logging.getLogger(__name__)


class Stage:
    """The panes in a server's scene.

    Parameters
    ----------
    server : viser's
    """

    def __init__(self, server: Any, contents: Contents, settings: Settings):
        self.server, self.contents = server, contents
        server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, control_width="medium", brand_color=(34, 139, 230)
        )
        most = MOST_POINTS // len(contents.exhibits)
        self.panes = [Pane(server.scene, e, f"/pane{i}", most) for i, e in enumerate(contents.exhibits)]
        self.radius = max(pane.radius for pane in self.panes) * 1.12
        self.distance = start_camera(len(self.panes), self.radius)
        camera = np.multiply(VIEWS["aslant"], self.distance / np.linalg.norm(VIEWS["aslant"]))
        server.initial_camera.fov = FOV
        server.initial_camera.near = self.distance / 100
        server.initial_camera.far = self.distance * 100
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.initial_camera.position = tuple(camera)
        self.place(camera, np.array([0.0, 0.0, 1.0]))
        self.show(settings)

    def place(self, camera: np.ndarray, up: np.ndarray) -> None:
        """Put the panes side by side as seen from a camera at (3,)."""
        if not np.linalg.norm(camera) > 0:
            return
        with self.server.atomic():
            for pane, placement in zip(self.panes, placed(len(self.panes), self.radius, camera, up), strict=True):
                pane.place(placement)

    def show(self, settings: Settings) -> None:
        """Draw the panes by these settings."""
        for pane in self.panes:
            pane.weigh(settings)
        peaks = [pane.levels.peak if pane.levels is not None else 0.0 for pane in self.panes]
        with self.server.atomic():
            for pane, peak in zip(self.panes, peaks, strict=True):
                under = 20 * np.log10(peak / max(peaks)) if settings.common and peak > 0 else 0.0
                pane.show(settings, float(under))


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
        self, contents: Contents, settings: Settings | None = None, *, host: str = HOST, port: int | None = None
    ):
        from millisight.viz.viewer.panel import Panel

        self.settings = self.painted = settings or first_settings(contents)
        self._wanted, self._ended = threading.Condition(), False
        self._painter = threading.Thread(target=self._paint, daemon=True)
        self.server = start(host, port)
        try:
            self.stage = Stage(self.server, contents, self.settings)
            self.panel = Panel(self)
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
            self._wanted.notify()

    def _paint(self) -> None:
        """Draw what was asked for last, over and over."""
        while True:
            with self._wanted:
                self._wanted.wait_for(lambda: self._ended or self.settings is not self.painted)
                if self._ended:
                    return
                settings = self.settings
            try:
                self.stage.show(settings)
                self.panel.tell(settings)
            except Exception:  # a thread without it would die in silence, and the viewer with it
                logger.exception("the viewer could not draw %s", settings)
            self.painted = settings

    async def _greet(self, client: Any) -> None:
        """Let the panes follow a browser's camera; asynchronous, so that places arrive in the camera's order."""

        async def follow(camera: Any) -> None:
            self.stage.place(camera.position, camera.up_direction)

        if len(self.stage.panes) > 1:
            client.camera.on_update(follow)

    def look_from(self, client: Any, view: str) -> None:
        """Move a browser's camera to one of `VIEWS`."""
        place = np.asarray(VIEWS[view])
        with client.atomic():
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position = tuple(place * self.stage.distance / np.linalg.norm(place))
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
            raise DeviceError(f"the browser gives no picture: {error}; is its window open and in front?") from error
        return _with_colour_bar(shown, self.settings, any(pane.levels for pane in self.stage.panes))

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

    def close(self) -> None:
        """Stop drawing and serving."""
        with self._wanted:
            self._ended = True
            self._wanted.notify()
        self._painter.join(timeout=5)
        self.server.stop()

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def first_settings(contents: Contents, **settings: Any) -> Settings:
    """Settings for these contents: the planes through the first image's strongest voxel, the weights as they are."""
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
    return Settings(**settings)


@styled
def _with_colour_bar(shown: np.ndarray, settings: Settings, bar: bool) -> bytes:
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
        colours = figure.colorbar(_mappable(scale, settings), cax=axes, orientation="horizontal")
        reference = "the strongest image's maximum" if settings.common else "each image's maximum"
        colours.set_label(f"|I|  [dB under {reference}], from {settings.threshold_db:g} dB".replace("-", "\u2212"))
    written = BytesIO()
    figure.savefig(written, format="png", dpi=dpi, metadata={"Software": None})
    return written.getvalue()


def _mappable(scale: Scale, settings: Settings) -> Any:
    from matplotlib.cm import ScalarMappable

    return ScalarMappable(scale.norm, checked_colormap(settings.colormap))
