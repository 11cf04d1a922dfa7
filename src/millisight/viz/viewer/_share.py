"""The viewer's scene as one HTML file, which opens from the disk without a network.

viser puts its scene into its own page. On top come a legend with a slider for the threshold, and `share.js`, which
keeps several panes side by side as the camera turns; in the live viewer the server does that.
"""

import dataclasses
import json
import os
from html import escape
from importlib.resources import files

import numpy as np

from millisight.core import write_text
from millisight.viz.viewer._contents import Contents
from millisight.viz.viewer._layout import PaneGrid
from millisight.viz.viewer._pane import Pane
from millisight.viz.viewer._server import start
from millisight.viz.viewer._settings import ViewSettings, colour_bar

_STEP_DB = 0.5  # of the page's threshold


def write_page(path: str | os.PathLike[str], contents: Contents, settings: ViewSettings) -> None:
    """Write `page` to a file.

    Raises
    ------
    DeviceError, FileError, InputError
    """
    write_text(path, page(contents, settings))


def page(contents: Contents, settings: ViewSettings, camera: tuple[np.ndarray, np.ndarray] | None = None) -> str:
    """A self-contained HTML page that shows what the viewer shows, with a threshold of its own.

    `camera` is its place (3,), looking at the origin, and what is up; None: as the viewer starts.
    """
    # A server of its own, since the page has points down to the end of the colours, whatever is shown now; not so where
    # slices show the threshold, too.
    alone = not (settings.slices or settings.volume)
    lowest = min(settings.threshold_db, -settings.range_db) if alone else settings.threshold_db
    server = start()
    try:
        panes = PaneGrid(server, contents, dataclasses.replace(settings, threshold_db=lowest))
        if camera is not None:
            server.initial_camera.position = tuple(camera[0])
            server.initial_camera.up = tuple(camera[1])
            panes.place(*camera)
        html = server.scene.as_html(dark_mode=True)
    finally:
        server.stop()
    shown = {
        "radius": panes.radius,
        "step": _STEP_DB,
        "range": settings.range_db,
        "panes": [{"name": pane.name, "counts": _counts(pane, lowest)} for pane in panes.panes],
    }
    title = escape(title_of(contents))
    html = html.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    style, script = (files("millisight.viz.viewer").joinpath(name).read_text() for name in ("share.css", "share.js"))
    legend = f'<div id="millisight"><b>{title}</b>{_controls(settings, lowest, panes)}</div>'
    end = html.rindex("</body>")
    script = f"<script>const shown = {json.dumps(shown)};\n{script}</script>"
    return f"{html[:end]}<style>{style}</style>{legend}{script}{html[end:]}"


def title_of(contents: Contents) -> str:
    """What is shown, in a few words."""
    return ", ".join(exhibit.title for exhibit in contents.exhibits)


def _controls(settings: ViewSettings, lowest: float, panes: PaneGrid) -> str:
    """The colour bar and, where points are shown, the threshold."""
    if all(pane.levels is None for pane in panes.panes):
        return ""
    slider = (
        f'<label>threshold <output>{settings.threshold_db:g} dB</output><input type="range" min="{lowest:g}" max="0" '
        f'step="{_STEP_DB}" value="{settings.threshold_db:g}"></label>'
    )
    return (slider if settings.points else "") + colour_bar(settings)


def _counts(pane: Pane, lowest: float) -> list[int]:
    """How many of a pane's points, the strongest first, reach 0, -0.5, -1, … dB down to the lowest."""
    if pane.cloud is None:
        return []
    steps = np.arange(0, -lowest + _STEP_DB, _STEP_DB)
    return np.searchsorted(-(pane.cloud.db + pane.offset_db), steps, side="right").tolist()
