"""What keys do, and what the page says about what is hidden."""

from typing import Any

import numpy as np

from millisight.viz.viewer._contents import Exhibit
from millisight.viz.viewer._levels import FLOOR_DB
from millisight.viz.viewer._settings import UNLIMITED, ViewSettings

KEYS = {
    "1": "points on and off",
    "2": "slices on and off",
    "3": "volume on and off",
    "m": "meshes on and off",
    "n": "normals on and off",
    "p": "radar's path on and off",
    "b": "box and axes on and off",
    "+": "threshold 1 dB up",
    "-": "threshold 1 dB down",
    ",": "z slice down",
    ".": "z slice up",
    "[": "top of the depth range down",
    "]": "top of the depth range up",
    "l": "under the lid, or everything",
    "0": "show everything",
    "t": "look from above",
    "f": "look from the front",
    "r": "look from the right",
    "h": "look from aslant, as at first",
}
"""Keys of the live viewer; viser's own move the camera: w, a, s, d, q, e and arrows."""

VIEW_KEYS = {"t": "above", "f": "front", "r": "right", "h": "aslant"}
_SWITCHES = {"1": "points", "2": "slices", "3": "volume", "m": "mesh", "n": "normals", "p": "path", "b": "box"}


def changes_of(key: str, settings: ViewSettings, exhibits: tuple[Exhibit, ...]) -> dict[str, Any]:
    """The settings that a key changes."""
    if key in _SWITCHES:
        return {_SWITCHES[key]: not getattr(settings, _SWITCHES[key])}
    if key in "+-":
        step = 1.0 if key == "+" else -1.0
        return {"threshold_db": float(np.clip(settings.threshold_db + step, FLOOR_DB, 0))}
    if key == "0":
        return dict(UNLIMITED)
    if key == "l":
        uncovered = under_the_lid(exhibits)
        hides = uncovered and settings.clip_z == uncovered["clip_z"] and settings.clutter == uncovered["clutter"]
        return dict(UNLIMITED) if hides else uncovered
    heights = np.unique(np.concatenate([e.levels.grid.z for e in exhibits if e.levels is not None] or [[0.0]]))
    if key in ",.":
        return {"at": (*settings.at[:2], _next(heights, settings.at[2], up=key == "."))}
    if key in "[]":
        low, high = settings.clip_z
        top = _next(heights, float(np.clip(high, heights[0], heights[-1])), up=key == "]")
        return {"clip_z": (low, max(low, top) if key == "[" or top < heights[-1] else np.inf)}
    return {}


def _next(heights: np.ndarray, at: float, *, up: bool) -> float:
    """The next height above or below `at`, or the last one."""
    beyond = heights[heights > at + 1e-6] if up else heights[heights < at - 1e-6][::-1]
    return float(beyond[0]) if len(beyond) else float(np.clip(at, heights[0], heights[-1]))


def under_the_lid(exhibits: tuple[Exhibit, ...]) -> dict[str, Any]:
    """Settings that show what lies under a lid, in full brightness; none where no image has one."""
    covers = [exhibit.cover for exhibit in exhibits if exhibit.cover is not None]
    if not covers:
        return {}
    return {
        "clip_z": (-np.inf, min(cover.ceiling for cover in covers)),
        "top_db": max(cover.top_db for cover in covers),
        "clutter": all(cover.levels is None for cover in covers),
    }


def note_on(settings: ViewSettings, exhibits: tuple[Exhibit, ...]) -> dict[str, str]:
    """What the page says about what is hidden, in one line, and what a button beside it does: its text and its key."""
    lids, limits = lids_text(exhibits), limits_text(settings)
    off = ", its echo taken off" if not settings.clutter and lids else ""
    if limits or off:
        told = f"{lids}{off}. " if lids else ""
        shown = f"Shown: {limits or 'everything else'}."
        return {"note": told + shown, "action": "Show everything", "key": "0"}
    if lids:
        return {"note": f"{lids}.", "action": "Look under the lid", "key": "l"}
    return {"note": "", "action": "", "key": ""}


def lids_text(exhibits: tuple[Exhibit, ...]) -> str:
    """Where lids are, in words; empty where there are none."""
    heights = dict.fromkeys(_centimetres(e.cover.lid) for e in exhibits if e.cover is not None)
    return f"There is a lid at z = {' and '.join(heights)}" if heights else ""


def limits_text(settings: ViewSettings) -> str:
    """The limits in words: "z under −2.5 cm"; empty where there are none."""
    told = []
    for axis, (low, high) in zip("xyz", (settings.clip_x, settings.clip_y, settings.clip_z), strict=True):
        if np.isfinite(low) and np.isfinite(high):
            told.append(f"{axis} from {_centimetres(low)} to {_centimetres(high)}")
        elif np.isfinite(high):
            told.append(f"{axis} under {_centimetres(high)}")
        elif np.isfinite(low):
            told.append(f"{axis} over {_centimetres(low)}")
    return ", ".join(told)


def _centimetres(metres: float) -> str:
    return f"{100 * metres:.1f} cm".replace("-", "\u2212")
