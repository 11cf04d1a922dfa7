"""What can be set in the viewer, and the colours that follow."""

from dataclasses import field
from functools import cache

import numpy as np

from millisight.core import checked_colormap, checked_number, checked_numbers, colormap_in_use, put, record
from millisight.core.errors import InputError
from millisight.viz.viewer._levels import FLOOR_DB

EVERYTHING = (-np.inf, np.inf)
"""No limit along an axis."""

UNLIMITED = {"clip_x": EVERYTHING, "clip_y": EVERYTHING, "clip_z": EVERYTHING, "top_db": 0.0, "clutter": True}
"""Settings that show an image as it is: everything, with the lid, in dB under its own maximum."""


@record
class ViewSettings:
    """How images are shown.

    Attributes
    ----------
    points, slices, volume : what of them: voxels above the threshold; three planes; all slabs, half transparent
    threshold_db : weaker voxels are hidden [dB]
    range_db : what the colours reach down to [dB]
    colormap : Matplotlib's name, or a plug-in's; by default that of all pictures
    common : dB under the maximum of all images, instead of each one's own
    at : (x, y, z) of the planes [m], in world coordinates
    clip_x, clip_y, clip_z : (low, high) what is shown along each axis [m]; the last is the depth range
    top_db : the level that dB count from, under the image's maximum: 0, or less where the strongest is not shown [dB]
    opacity : of slices, volume and meshes, from 0 to 1
    clutter : whether the echo of lids and other sheets is shown, where it was found
    share : of the edge image where specular and edge are weighed, a2 / (a1 + a2)
    mesh, normals, path, mask, box : whether they are shown; normals are those of a mesh's vertices and of points
    """

    points: bool = True
    slices: bool = False
    volume: bool = False
    threshold_db: float = -15.0
    range_db: float = 30.0
    colormap: str = field(default_factory=colormap_in_use)
    common: bool = False
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clip_x: tuple[float, float] = EVERYTHING
    clip_y: tuple[float, float] = EVERYTHING
    clip_z: tuple[float, float] = EVERYTHING
    top_db: float = 0.0
    opacity: float = 1.0
    clutter: bool = True
    share: float = 0.5
    mesh: bool = True
    normals: bool = False
    path: bool = True
    mask: bool = True
    box: bool = True

    def __post_init__(self) -> None:
        checked_colormap(self.colormap)
        put(
            self,
            threshold_db=checked_number(self.threshold_db, name="threshold_db", unit="dB", minimum=FLOOR_DB),
            range_db=checked_number(self.range_db, name="range_db", unit="dB", minimum=1e-3),
            share=checked_number(self.share, name="share", minimum=0),
            top_db=checked_number(self.top_db, name="top_db", unit="dB", minimum=FLOOR_DB),
            opacity=checked_number(self.opacity, name="opacity", minimum=0),
            at=checked_numbers(self.at, name="at", count=3, unit="m"),
            **{name: _checked_range(getattr(self, name), name) for name in ("clip_x", "clip_y", "clip_z")},
        )
        if self.threshold_db > 0:
            raise InputError(f"threshold_db is {self.threshold_db:g} dB, above the maximum; expected 0 or less")
        if self.top_db > 0:
            raise InputError(f"top_db is {self.top_db:g} dB, above the maximum; expected 0 or less")
        if self.opacity > 1:
            raise InputError(f"opacity is {self.opacity:g}; expected 0 (invisible) to 1 (opaque)")
        if self.share > 1:
            raise InputError(f"share is {self.share:g}; expected 0 (specular alone) to 1 (edge alone)")

    @property
    def limits(self) -> np.ndarray:
        """(2, 3) the lowest and the highest coordinates that are shown [m], infinite where nothing is cut."""
        return np.array([self.clip_x, self.clip_y, self.clip_z]).T

    @property
    def clipped(self) -> bool:
        """Whether something may be hidden by a limit."""
        return bool(np.isfinite(self.limits).any())

    def colours(self, db: np.ndarray) -> np.ndarray:
        """(..., 3) uint8 of levels [dB]."""
        step = np.clip(db * np.float32(255 / self.range_db) + np.float32(255), 0, 255).astype(np.uint8)
        return palette(self.colormap)[step]


def _checked_range(limits: tuple[float, float], name: str) -> tuple[float, float]:
    """A range whose ends may be infinite."""
    try:
        low, high = (float(limit) for limit in limits)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is {limits!r}; expected (low, high) [m]") from error
    if not low <= high:  # so that NaN is refused, too
        raise InputError(f"{name} is ({low:g}, {high:g}) m; expected the lower end first")
    return low, high


@cache
def palette(colormap: str) -> np.ndarray:
    """(256, 3) uint8 of a colour map, from weak to strong."""
    return (checked_colormap(colormap)(np.linspace(0, 1, 256))[:, :3] * 255 + 0.5).astype(np.uint8)


def colour_bar(settings: ViewSettings) -> str:
    """The colour bar as HTML: what is under the threshold is dimmed."""
    stops = ", ".join(f"rgb({r},{g},{b})" for r, g, b in palette(settings.colormap)[::15].tolist())
    hidden = 100 * float(np.clip(1 + settings.threshold_db / settings.range_db, 0, 1))
    labels = "".join(f"<span>{db:g}".replace("-", "\u2212") + "</span>" for db in
                     (-settings.range_db, -settings.range_db * 2 / 3, -settings.range_db / 3, 0.0))  # fmt: skip
    return (
        '<div class="millisight-bar" style="padding:2px 12px 8px;font-size:0.82em">'
        f'<div style="position:relative;height:14px;border-radius:3px;background:linear-gradient(to right,{stops})">'
        f'<div style="position:absolute;left:0;top:0;bottom:0;width:{hidden:.1f}%;background:rgba(127,127,127,0.75);'
        'border-right:2px solid #888"></div></div>'
        f'<div style="display:flex;justify-content:space-between">{labels}</div>'
        f"<div>dB under {reference_text(settings)}; grey: hidden</div></div>"
    )


def reference_text(settings: ViewSettings) -> str:
    """What dB count from."""
    maximum = "the strongest image's maximum" if settings.common else "each image's maximum"
    return f"{maximum} less {-settings.top_db:g} dB" if settings.top_db else maximum
