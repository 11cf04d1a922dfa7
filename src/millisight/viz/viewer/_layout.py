"""Panes side by side in one view, as if each had a camera of its own and all cameras moved alike.

One camera turns around the origin. The panes are put side by side across its line of sight, and each is turned by as
much as the camera sees it from aside: so all are seen from the same direction, wherever the camera is.
"""

import math
from typing import Any

import numpy as np

from millisight.viz.viewer._contents import Contents
from millisight.viz.viewer._pane import Pane, Placement
from millisight.viz.viewer._settings import ViewSettings

FOV = math.radians(24)
"""The view's angle, upright: narrow, so that what is beside is hardly seen from aside."""


MOST_POINTS = 400_000
"""Drawn in all panes together: what turns smoothly without a graphics card."""

VIEWS = {
    "aslant": (-0.28, -0.80, 0.62),
    "above": (0.0, -1e-3, 1.0),
    "front": (0.0, -1.0, 0.0),
    "right": (1.0, 0.0, 0.0),
}
"""Where the camera looks from."""


class PaneGrid:
    """The panes in a server's scene.

    Parameters
    ----------
    server : viser's
    contents, settings : what is shown, and how
    """

    def __init__(self, server: Any, contents: Contents, settings: ViewSettings):
        self.contents: Contents = contents
        self._server = server
        server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, control_width="medium", brand_color=(34, 139, 230)
        )
        most = MOST_POINTS // len(contents.exhibits)
        self.panes: list[Pane] = [Pane(server.scene, e, f"/pane{i}", most) for i, e in enumerate(contents.exhibits)]
        self.radius: float = max(pane.radius for pane in self.panes) * 1.12
        look_at, reach = self._focus()
        self.look_at: np.ndarray = look_at
        self.distance: float = start_camera(len(self.panes), reach)
        camera = self.camera_of("aslant")
        server.initial_camera.fov = FOV
        server.initial_camera.near = self.distance / 100
        server.initial_camera.far = self.distance * 100
        server.initial_camera.look_at = tuple(self.look_at)
        server.initial_camera.position = tuple(camera)
        self.place(camera, np.array([0.0, 0.0, 1.0]))
        self.show(settings)

    def camera_of(self, view: str) -> np.ndarray:
        """(3,) where the camera stands for one of `VIEWS`, so that all panes are seen."""
        return self.look_at + self.distance * _unit(np.array(VIEWS[view]))

    def _focus(self) -> tuple[np.ndarray, float]:
        """What the camera looks at (3,), and how far around it is seen [m]: a lone image's carton, or all panes."""
        (pane, *others), everything = self.panes, (np.zeros(3), self.radius)
        cover = pane.exhibit.cover
        if others or cover is None:
            return everything
        middle = np.append(cover.extent.mean(axis=0), cover.ceiling) - pane.middle
        reach = 1.12 * float(np.linalg.norm(np.ptp(cover.extent, axis=0))) / 2
        return (middle, reach) if 0 < reach < self.radius else everything

    def place(self, camera: np.ndarray, up: np.ndarray) -> None:
        """Put the panes side by side as seen from a camera at (3,)."""
        if not np.linalg.norm(camera) > 0:
            return
        with self._server.atomic():
            for pane, placement in zip(self.panes, placed(len(self.panes), self.radius, camera, up), strict=True):
                pane.place(placement)

    def told_at(self, origin: np.ndarray, direction: np.ndarray, settings: ViewSettings) -> str:
        """Value and place of what a ray (3,), (3,) in the scene meets first, in words; empty for nothing."""
        met = [one for pane in self.panes if (one := pane.pick(origin, direction, settings)) is not None]
        if not met:
            return ""
        first = min(met, key=lambda one: one.distance)
        place = ", ".join(f"{name} {100 * at:.1f}" for name, at in zip("xyz", first.place, strict=True))
        return f"{place} cm: {first.db:.1f} dB, |I| {first.magnitude:.3g}".replace("-", "\u2212")

    def show(self, settings: ViewSettings) -> None:
        """Draw the panes by these settings."""
        for pane in self.panes:
            pane.weigh(settings)
        peaks = [pane.levels.peak if pane.levels is not None else 0.0 for pane in self.panes]
        with self._server.atomic():
            for pane, peak in zip(self.panes, peaks, strict=True):
                under = 20 * np.log10(peak / max(peaks)) if settings.common and peak > 0 else 0.0
                pane.show(settings, float(under))


def rows_and_columns(count: int) -> tuple[int, int]:
    """How many panes stand above each other and beside each other: up to three in a row, then nearly a square."""
    columns = count if count <= 3 else math.ceil(math.sqrt(count))
    return math.ceil(count / columns), columns


def placed(count: int, radius: float, camera: np.ndarray, up: np.ndarray) -> list[Placement]:
    """Where `count` panes go, in balls of `radius` [m], for a camera at (3,) that looks at the origin."""
    ahead = _unit(-camera)
    right = np.cross(ahead, up)
    if np.linalg.norm(right) < 1e-6:  # straight down, where `up` says nothing
        right = np.array([1.0, 0.0, 0.0])
    right = _unit(right)
    above = np.cross(right, ahead)
    rows, columns = rows_and_columns(count)
    result = []
    for number in range(count):
        row, column = divmod(number, columns)
        in_row = min(columns, count - row * columns)
        offset = 2 * radius * ((column - (in_row - 1) / 2) * right + ((rows - 1) / 2 - row) * above)
        result.append(Placement(offset, _turn(ahead, _unit(offset - camera)), above * radius))
    return result


def start_camera(count: int, radius: float, *, aspect: float = 1.5) -> float:
    """How far off a camera sees all panes [m], in a view `aspect` times as wide as it is high."""
    rows, columns = rows_and_columns(count)
    half = max(rows, columns / aspect) * radius
    return 1.08 * half / math.tan(FOV / 2)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The quaternion w x y z of the shortest turn of one unit vector into another, less than half a turn away."""
    return _unit(np.concatenate([[1 + start @ end], np.cross(start, end)]))
