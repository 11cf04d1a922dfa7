"""The viewer's scene as one HTML file, which opens from the disk without a network.

viser puts its scene into its own page. On top come a legend with sliders for the threshold and the limits, and
`share.js`, which keeps several panes side by side as the camera turns; in the live viewer the server does that.
"""

import dataclasses
import json
import os
from html import escape

import numpy as np

from millisight.core import write_text
from millisight.viz.viewer._contents import Contents
from millisight.viz.viewer._keys import KEYS, VIEW_KEYS, lids_text, note_on
from millisight.viz.viewer._layout import PaneGrid
from millisight.viz.viewer._levels import FLOOR_DB, Cloud
from millisight.viz.viewer._page_link import mark_of, script
from millisight.viz.viewer._panel import in_millimetres
from millisight.viz.viewer._server import start
from millisight.viz.viewer._settings import EVERYTHING, ViewSettings, colour_bar

_STEP_DB = 0.5  # of the page's threshold


def write_page(path: str | os.PathLike[str], contents: Contents, settings: ViewSettings) -> None:
    """Write `page` to a file.

    Raises
    ------
    DeviceError, FileError, InputError
    """
    write_text(path, page(contents, settings))


def page(
    contents: Contents,
    settings: ViewSettings,
    camera: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> str:
    """A self-contained HTML page that shows what the viewer shows, with a threshold and limits of its own.

    `camera` is its place (3,), what is up, and what it looks at; None: as the viewer starts.
    """
    # A server of its own, since the page has points down to the end of the colours and outside of the limits, whatever
    # is shown now; not so where slices show both, too.
    alone = settings.points and not (settings.slices or settings.volume)
    lowest = max(min(settings.threshold_db, -settings.range_db), FLOOR_DB) if alone else settings.threshold_db
    free = dict.fromkeys(("clip_x", "clip_y", "clip_z"), EVERYTHING) if alone else {}
    server = start()
    try:
        panes = PaneGrid(server, contents, dataclasses.replace(settings, threshold_db=lowest, **free))
        covered = [pane.draw_covered(settings, lowest) if alone else None for pane in panes.panes]
        if camera is not None:
            server.initial_camera.position = tuple(camera[0])
            server.initial_camera.up = tuple(camera[1])
            server.initial_camera.look_at = tuple(camera[2])
            panes.place(*camera[:2])
        html = server.scene.as_html(dark_mode=True)
    finally:
        server.stop()
    told = note_on(settings, contents.exhibits)["note"]
    title = title_of(contents)
    shown = {
        "title": title,
        "of": mark_of(title),
        "radius": panes.radius,
        "step": _STEP_DB,
        "range": settings.range_db,
        "lid": settings.clutter,
        "note": lids_text(contents.exhibits),
        "fixed": told,  # where nothing can be set
        "keys": [(key, KEYS[key]) for key in ("+", "-", "l", "0", *VIEW_KEYS) if alone or key in VIEW_KEYS],
        "views": {key: [*panes.camera_of(view), *panes.look_at] for key, view in VIEW_KEYS.items()},
        "panes": [
            {
                "name": pane.name,
                "counts": _counts(pane.cloud, pane.offset_db, lowest),
                "covered": cloud and _counts(cloud, pane.offset_db, lowest),
                "middle": pane.middle.tolist(),
                "size": pane.point_size,
            }
            for pane, cloud in zip(panes.panes, covered, strict=True)
        ],
    }
    html = html.replace("<title>Viser</title>", f"<title>{escape(title)}</title>", 1)
    controls = _controls(settings, lowest, panes) + (_limits(settings, contents) if alone else "")
    legend = f'<div id="millisight">{controls}</div>' if controls else ""
    end = html.rindex("</body>")
    # What is a file's name must not end the script.
    facts = json.dumps(shown).replace("<", "\\u003c")
    scripts = f"<script>window.shown = {facts};\n{script('view.js')}\n{script('share.js')}</script>"
    return f"{html[:end]}<style>{script('share.css')}</style>{legend}{scripts}{html[end:]}"


def title_of(contents: Contents) -> str:
    """What is shown, in a few words."""
    return ", ".join(exhibit.title for exhibit in contents.exhibits)


def _controls(settings: ViewSettings, lowest: float, panes: PaneGrid) -> str:
    """The colour bar and, where points are shown, the threshold."""
    if all(pane.levels is None for pane in panes.panes):
        return ""
    slider = (
        f'<label>threshold <output class="millisight-value">{settings.threshold_db:g} dB</output>'
        f'<input class="millisight-threshold" type="range" min="{lowest:g}" max="0" '
        f'step="{_STEP_DB}" value="{settings.threshold_db:g}"></label>'
    )
    return (slider if settings.points else "") + colour_bar(settings)


def _limits(settings: ViewSettings, contents: Contents) -> str:
    """Two sliders for each axis; at its end each is no limit."""
    rows = []
    for axis, (first, last) in enumerate(in_millimetres([exhibit.bounds for exhibit in contents.exhibits])):
        for end, name, free in ((0, "from", "min"), (1, "to", "max")):
            at = float(np.clip(settings.limits[end, axis], first, last))
            rows.append(
                f'<label>{"xyz"[axis]} {name} <input class="{free}" type="range" min="{first:g}" max="{last:g}" '
                f'step="0.0001" value="{at:.4f}"><output></output></label>'
            )
    opened = " open" if settings.clipped else ""
    return f'<details class="millisight-limits"{opened}><summary>Clip</summary>{"".join(rows)}</details>'


def _counts(cloud: Cloud | None, offset_db: float, lowest: float) -> list[int]:
    """How many of some points, the strongest first, reach 0, -0.5, -1, … dB down to the lowest."""
    if cloud is None:
        return []
    steps = np.arange(0, -lowest + _STEP_DB, _STEP_DB)
    return np.searchsorted(-(cloud.db + offset_db), steps, side="right").tolist()
