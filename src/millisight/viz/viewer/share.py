"""The viewer's scene as one HTML file, which opens from the disk without a network.

viser puts its scene into its own page. On top come a legend with a slider for the threshold, and the script that
keeps several panes side by side as the camera turns, which the server does in the live viewer.
"""

import dataclasses
import json
import os
from html import escape

import numpy as np

from millisight.files import write_text
from millisight.viz.viewer.contents import Contents
from millisight.viz.viewer.pane import Pane
from millisight.viz.viewer.server import start
from millisight.viz.viewer.session import Stage
from millisight.viz.viewer.settings import Settings, colour_bar

_STEP_DB = 0.5  # of the page's threshold


def write_page(path: str | os.PathLike[str], contents: Contents, settings: Settings) -> None:
    """Write `page` to a file.

    Raises
    ------
    DeviceError, FileError, InputError
    """
    write_text(path, page(contents, settings))


def page(contents: Contents, settings: Settings, camera: tuple[np.ndarray, np.ndarray] | None = None) -> str:
    """What the viewer shows by these settings, as a self-contained HTML page with a threshold of its own.

    Parameters
    ----------
    camera : its place (3,), looking at the origin, and what is up; None: as the viewer starts

    Raises
    ------
    DeviceError
        viser is not installed.
    """
    # A server of its own, since the page has points down to the end of the colours, whatever is shown now; not so where
    # slices show the threshold, too.
    alone = not (settings.slices or settings.volume)
    lowest = min(settings.threshold_db, -settings.range_db) if alone else settings.threshold_db
    server = start()
    try:
        stage = Stage(server, contents, dataclasses.replace(settings, threshold_db=lowest))
        if camera is not None:
            server.initial_camera.position = tuple(camera[0])
            server.initial_camera.up = tuple(camera[1])
            stage.place(*camera)
        html = server.scene.as_html(dark_mode=True)
    finally:
        server.stop()
    told = {
        "radius": stage.radius,
        "step": _STEP_DB,
        "range": settings.range_db,
        "panes": [{"name": pane.name, "counts": _counts(pane, lowest)} for pane in stage.panes],
    }
    title = escape(", ".join(exhibit.title for exhibit in contents.exhibits))
    html = html.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    legend = f'<div id="millisight"><b>{title}</b>{_controls(settings, lowest, stage)}</div>'
    end = html.rindex("</body>")
    return f"{html[:end]}{_STYLE}{legend}<script>const shown = {json.dumps(told)};{_SCRIPT}</script>{html[end:]}"


def _controls(settings: Settings, lowest: float, stage: Stage) -> str:
    """The colour bar and, where points are shown, the threshold."""
    if all(pane.levels is None for pane in stage.panes):
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


_STYLE = """<style>
#millisight { position: fixed; left: 12px; bottom: 12px; width: 290px; z-index: 50; padding: 10px 0 2px;
  border-radius: 6px; background: rgba(36, 38, 42, 0.92); color: #d5d9de; font: 14px/1.45 system-ui, sans-serif; }
#millisight b, #millisight label { display: block; padding: 0 12px 6px; }
#millisight input { display: block; width: 100%; margin: 4px 0 0; }
</style>"""

# `window.__viserMutable` is viser's own, in the page that this file carries; without it nothing moves, and no harm is
# done. The placing is that of `layout.placed`.
_SCRIPT = """
(function () {
  const cross = (a, b) => [a[1]*b[2] - a[2]*b[1], a[2]*b[0] - a[0]*b[2], a[0]*b[1] - a[1]*b[0]];
  const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
  const unit = a => a.map(v => v / Math.sqrt(dot(a, a)));
  const add = (a, s, b) => a.map((v, i) => v + s * b[i]);
  const count = shown.panes.length, columns = count <= 3 ? count : Math.ceil(Math.sqrt(count));
  const rows = Math.ceil(count / columns);
  const input = document.querySelector("#millisight input");
  let before = "";

  function place(m, camera, up) {
    const ahead = unit(camera.map(v => -v));
    let right = cross(ahead, up);
    right = dot(right, right) < 1e-12 ? [1, 0, 0] : unit(right);
    const above = cross(right, ahead);
    shown.panes.forEach((pane, i) => {
      const row = Math.floor(i / columns), inRow = Math.min(columns, count - row * columns);
      const beside = (i % columns - (inRow - 1) / 2) * 2 * shown.radius;
      const offset = add(right.map(v => v * beside), ((rows - 1) / 2 - row) * 2 * shown.radius, above);
      const seen = unit(add(offset, -1, camera));
      const pose = (name, wxyz, position) => {
        m.nodePoseData[name] = { wxyz: wxyz, position: position, poseUpdateState: "needsUpdate" };
      };
      pose(pane.name, unit([1 + dot(ahead, seen)].concat(cross(ahead, seen))), offset);
      pose(pane.name + "/title", [1, 0, 0, 0], above.map(v => v * shown.radius));
    });
  }

  function hide(m) {
    const threshold = Number(input.value);
    shown.panes.forEach(pane => {
      const node = m.nodeRefFromName[pane.name + "/points"];
      if (node) node.traverse(part => {
        if (part.isPoints) part.geometry.setDrawRange(0, pane.counts[Math.round(-threshold / shown.step)]);
      });
    });
    document.querySelector("#millisight output").textContent = threshold + " dB";
    document.querySelector("#millisight .millisight-bar div div").style.width =
      100 * Math.min(1, Math.max(0, 1 + threshold / shown.range)) + "%";
  }

  function follow() {
    requestAnimationFrame(follow);
    const m = window.__viserMutable, first = m && m.nodeRefFromName[shown.panes[0].name];
    if (!first || !m.camera) return;
    const root = first.parent, local = v => root.worldToLocal(v);
    const origin = local(m.camera.position.clone().set(0, 0, 0));
    const camera = local(m.camera.position.clone()).sub(origin).toArray();
    const up = local(m.camera.up.clone()).sub(origin).toArray();
    const points = shown.panes.filter(pane => m.nodeRefFromName[pane.name + "/points"]).length;
    const now = [camera, up, input && input.value, points].join();
    if (now === before) return;
    before = now;
    if (count > 1) place(m, camera, up);
    if (input) hide(m);
    m.requestRender();
  }
  follow();
})();
"""
