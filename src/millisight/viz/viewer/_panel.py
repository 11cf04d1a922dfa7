"""The viewer's panel: every control, and what it says about the files."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

import numpy as np

from millisight.core import colormap_names
from millisight.core.errors import MillisightError
from millisight.viz import grid_box
from millisight.viz.viewer._layout import VIEWS, PaneGrid
from millisight.viz.viewer._levels import FLOOR_DB
from millisight.viz.viewer._settings import UNLIMITED, ViewSettings, colour_bar


class ControlPanel:
    """The controls of a viewer, beside its scene; `change` takes settings by name, `picture` gives PNG, `page` HTML."""

    def __init__(
        self, gui: Any, panes: PaneGrid, settings: ViewSettings, *, change: Any, look_from: Any, picture: Any, page: Any
    ):
        self._gui, self._panes, self._change, self._look_from = gui, panes, change, look_from
        self._exhibits = panes.contents.exhibits
        self._images = [e for e in self._exhibits if e.levels is not None]
        self._controls: dict[str, tuple[Any, Callable[[Any], Any]]] = {}  # by setting; what each shows of its value
        self._sliders: list[Any] = []  # of the slices
        gui.main_panel.dock_right()
        if any(e.pair for e in self._exhibits):
            self._add_weights(settings)
        if self._images:
            self._add_image(settings)
        self._add_limits(settings)
        self._add_around(settings)
        self._add_views()
        self._add_export(picture, page)
        self._about = gui.add_html("")
        self.update(settings)

    def follow(self, settings: ViewSettings) -> None:
        """Let the controls show settings that were not made by them."""
        for name, (control, shown) in self._controls.items():
            control.value = shown(getattr(settings, name))
        for slider, at in zip(self._sliders, settings.at, strict=False):
            slider.value = float(np.clip(round(at, 3), slider.min, slider.max))

    def update(self, settings: ViewSettings) -> None:
        """Show the colour bar, the weights and the facts of what is shown now."""
        if self._images:
            self._bar.content = colour_bar(settings)
        for slider in self._sliders:
            slider.visible = settings.slices
        if any(e.pair for e in self._exhibits):
            self._weights.content = _formula(settings.share)
        self._about.content = self._facts(settings)

    # The controls --------------------------------------------------------------------------------------------------

    def _add_weights(self, settings: ViewSettings) -> None:
        with self._gui.add_folder("Weights"):
            slider = self._gui.add_slider("edge share", 0.0, 1.0, 0.01, settings.share, hint="a2 / (a1 + a2)")
            self._weights = self._gui.add_html(_formula(settings.share))
        self._bind(slider, "share")

    def _add_image(self, settings: ViewSettings) -> None:
        with self._gui.add_folder("Image"):
            self._check("points", "points", settings, "voxels above the threshold")
            self._check("slices", "slices", settings, "three planes, which can be moved")
            self._add_slices(settings)
            self._check("volume", "volume", settings, "all slices along z, semi-transparent")
            threshold = self._gui.add_slider(
                "threshold [dB]", FLOOR_DB, 0.0, 0.5, settings.threshold_db, hint="weaker voxels are hidden"
            )
            top = self._gui.add_slider(
                "0 dB at [dB]", FLOOR_DB, 0.0, 0.5, settings.top_db,
                hint="the level that dB count from, under the image's maximum: lower it to see what is weak",
            )  # fmt: skip
            reach = self._gui.add_slider(
                "range [dB]", 5.0, -FLOOR_DB, 1.0, float(np.clip(settings.range_db, 5, -FLOOR_DB)),
                hint="dynamic range of the colours",
            )  # fmt: skip
            names = dict.fromkeys((settings.colormap, *colormap_names()))
            colormap = self._gui.add_dropdown("colours", tuple(names), initial_value=settings.colormap)
            if len(self._images) > 1:
                self._check("common", "one scale for all", settings, "dB under the strongest image's maximum")
            self._bar = self._gui.add_html(colour_bar(settings))
        self._bind(threshold, "threshold_db")
        self._bind(top, "top_db")
        self._bind(reach, "range_db", shown=lambda value: float(np.clip(value, 5, -FLOOR_DB)))
        self._bind(colormap, "colormap")

    def _add_slices(self, settings: ViewSettings) -> None:
        boxes = [grid_box(e.levels.grid) for e in self._images if e.levels is not None]
        for axis, (first, last) in enumerate(in_millimetres(boxes)):
            at = float(np.clip(round(settings.at[axis], 3), first, last))
            slider = self._gui.add_slider(f"{'xyz'[axis]} [m]", first, last, 0.001, at, visible=settings.slices)
            slider.on_update(lambda event: event.client and self._change(at=tuple(s.value for s in self._sliders)))
            self._sliders.append(slider)

    def _add_limits(self, settings: ViewSettings) -> None:
        with self._gui.add_folder("Clip"):
            hint = "what is outside is hidden"
            for axis, (first, last) in enumerate(in_millimetres([e.bounds for e in self._exhibits])):
                label = f"{'xyz'[axis]} [m]" if axis < 2 else "depth z [m]"

                def shown(limits: tuple[float, float], first: float = first, last: float = last) -> Any:
                    low, high = (float(round(limit, 3)) for limit in np.clip(limits, first, last))
                    return low, high

                def meant(value: Any, first: float = first, last: float = last) -> Any:
                    return (-np.inf if value[0] <= first else value[0]), (np.inf if value[1] >= last else value[1])

                name = f"clip_{'xyz'[axis]}"
                control = self._gui.add_multi_slider(
                    label, first, last, 0.001, shown(getattr(settings, name)), hint=hint
                )
                self._bind(control, name, shown=shown, meant=meant)
            opacity = self._gui.add_slider(
                "opacity", 0.0, 1.0, 0.05, settings.opacity, hint="of slices, volume and meshes"
            )
            if any(e.cover is not None and e.cover.levels is not None for e in self._exhibits):
                self._check("clutter", "lid", settings, "the echo of lids and other sheets")
            everything = self._gui.add_button("Show everything", hint="no limits, and the lid as it is")
        self._bind(opacity, "opacity")
        everything.on_click(lambda _: self._change(**UNLIMITED, followed=True))

    def _add_around(self, settings: ViewSettings) -> None:
        with self._gui.add_folder("Surroundings"):
            if any(e.meshes for e in self._exhibits):
                self._check("mesh", "mesh", settings, "surfaces, and their outlines in the slices")
                self._check("normals", "normals", settings, "the mesh's vertices as oriented points")
            if any(e.paths for e in self._exhibits):
                self._check("path", "radar's path", settings, "positions and outline of the aperture")
            if any(e.masks for e in self._exhibits):
                self._check("mask", "mask", settings)
            self._check("box", "box and axes", settings)

    def _add_views(self) -> None:
        with self._gui.add_folder("View from"):
            buttons = self._gui.add_button_group("", tuple(VIEWS))

        @buttons.on_click
        def _(event: Any) -> None:
            if event.client is not None:
                self._look_from(event.client, buttons.value)

    def _add_export(self, picture: Any, page: Any) -> None:
        with self._gui.add_folder("Export"):
            shoot = self._gui.add_button("Screenshot (PNG)", hint="the current view, with the colour bar")
            share = self._gui.add_button("Share (HTML)", hint="one file that opens in any browser, without network")

        for button, kind, take, suffix in ((shoot, "picture", picture, "png"), (share, "page", page, "html")):

            @button.on_click
            def _(event: Any, kind: str = kind, take: Any = take, suffix: str = suffix) -> None:
                with explained(event.client, f"no {kind}"):
                    event.client.send_file_download(f"millisight.{suffix}", take(event.client), save_immediately=True)

    def _check(self, name: str, label: str, settings: ViewSettings, hint: str | None = None) -> None:
        self._bind(self._gui.add_checkbox(label, getattr(settings, name), hint=hint), name)

    def _bind(
        self, control: Any, name: str, *, shown: Callable[[Any], Any] = lambda value: value, meant: Any = None
    ) -> None:
        """Let a control change the setting of that name, and follow it: it shows `shown(setting)`, and means
        `meant(value)`.
        """
        self._controls[name] = control, shown

        def update(event: Any) -> None:
            if event.client is not None:  # a user's, and not the viewer's own
                self._change(**{name: meant(control.value) if meant else control.value})

        control.on_update(update)

    # What it says --------------------------------------------------------------------------------------------------

    def _facts(self, settings: ViewSettings) -> str:
        lines = []
        for pane in self._panes.panes:
            facts = [f"<b>{escape(pane.exhibit.title)}</b>"]
            if pane.levels is not None:
                voxels = " × ".join(map(str, pane.levels.grid.shape))
                facts.append(f"{voxels} voxels, maximum {pane.levels.peak:.3g}")
            if pane.cloud is not None and settings.points:
                shown = f"{len(pane.cloud.db)} voxels shown"
                if len(pane.cloud.db) < pane.cloud.above:
                    shown += f", the strongest of {pane.cloud.above} above the threshold"
                facts.append(shown)
            lines.append("<br>".join(facts))
        lines += [escape(note) for note in self._panes.contents.notes]
        return '<div style="padding:4px 12px;font-size:0.8em;line-height:1.45">' + "<br>".join(lines) + "</div>"


def in_millimetres(boxes: list[np.ndarray]) -> list[tuple[float, float]]:
    """The ends of sliders along each axis that reach over all boxes (2, 3), in whole millimetres [m]."""
    lower, upper = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    lower, upper = np.floor(lower * 1e3 - 1e-6) / 1e3, np.ceil(upper * 1e3 + 1e-6) / 1e3
    return [(float(round(low, 3)), float(round(high, 3))) for low, high in zip(lower, upper, strict=True)]


def _formula(share: float) -> str:
    return f'<div style="padding:0 12px 6px;font-size:0.82em">I = {1 - share:.2f} specular + {share:.2f} edge</div>'


@contextmanager
def explained(client: Any, title: str) -> Iterator[None]:
    """Tell the user in the browser why what was asked for did not come."""
    try:
        yield
    except MillisightError as error:
        client.add_notification(title, str(error), color="red")
