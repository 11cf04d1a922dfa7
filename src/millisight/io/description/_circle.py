"""`circle` in [positions]: an antenna that goes round the scene, or a turntable that turns the scene before it."""

import math

import numpy as np

from millisight.io.description._tables import TomlTable

_KEYS = (
    "radius", "far_field", "angles", "step", "start", "unit", "height", "axis", "center", "turns", "range_from",
)  # fmt: skip
_FAR = 1e4  # radius of a circle that stands for a far field [m]


def circle(table: TomlTable, scan: dict[str, int]) -> tuple[np.ndarray, np.ndarray, float]:
    """The poses (P, 3) [m] and orientations (P, 4) of a circle about an axis, and its path offset [m].

    At the angle 0 the radar is on the next axis after the circle's own (x of a circle about z), its own frame as the
    world's; it turns with the angle, by the right hand. Ranges that count from the circle's centre are longer by the
    path there and back, which the path offset takes off.

    Raises
    ------
    FormatError
        The table cannot be right, or does not fit the frames.
    """
    about = table.table("circle", _KEYS)
    for axis in ("x", "y"):
        if axis in scan:
            raise table.error("circle", "raster, since the axes include x or y; a circle has the axis angle or pose")
    center = about.array("center", "m", (3,)) if "center" in about else np.zeros(3)
    far = about.flag("far_field")
    if far == ("radius" in about):
        raise about.error("radius", "either the antenna's distance from the axis [m], or far_field = true")
    radius = _FAR if far else about.number("radius", "m")
    if not radius > 0:
        raise about.error("radius", "more than 0 [m]")
    poses = math.prod(scan.values())
    count = scan.get("angle", 1 if "height" in scan else poses)
    angles = _angles(about, count)
    height = about.array("height", "m") if "height" in about else np.zeros(())
    if height.size not in (1, scan.get("height", poses)):
        raise about.error("height", f"one number or {scan.get('height', poses)} [m], and not {height.size}")
    heights = np.broadcast_to(height.reshape(-1), (scan.get("height", poses),))
    if "height" in scan:
        slow_is_angle = next(iter(scan)) == "angle"
        grids = np.meshgrid(*((angles, heights) if slow_is_angle else (heights, angles)), indexing="ij")
        angles, heights = (grid.ravel() for grid in (grids if slow_is_angle else grids[::-1]))
    frm = about.text("range_from", "axis" if far else "antenna", among=("antenna", "axis"))
    if far and frm == "antenna":
        raise about.error("range_from", '"axis": ranges cannot be counted from an antenna far away')
    if far and heights.any():
        raise about.error("height", "none in a far field")
    if frm == "axis" and np.ptp(np.abs(heights)) > 0:
        raise about.error("range_from", '"antenna", since the antenna\'s height changes')
    axis = "xyz".index(about.text("axis", "z", among=("x", "y", "z")))
    positions = np.zeros((poses, 3))
    positions[:, (axis + 1) % 3] = radius * np.cos(angles)
    positions[:, (axis + 2) % 3] = radius * np.sin(angles)
    positions[:, axis] = heights
    turned = np.zeros((poses, 4))
    turned[:, axis], turned[:, 3] = np.sin(angles / 2), np.cos(angles / 2)
    offset = -2 * float(np.hypot(radius, heights[0])) if frm == "axis" else 0.0
    return positions + center, turned, offset


def _angles(about: TomlTable, count: int) -> np.ndarray:
    """(count,) angles of the antenna as the scene sees it [rad]."""
    factor = about.unit("rad")
    if about.only_one("angles", "step") == "angles":
        for key in ("start",):
            if key in about:
                raise about.error(key, "this key only beside step")
        listed = about.get("angles")
        if isinstance(listed, dict) and "unit" in listed:
            if "unit" in about:
                raise about.error("unit", "a single unit, in the circle or in the reference to the angles")
            factor = 1.0
        angles = about.array("angles", "rad").reshape(-1) * factor
        if len(angles) != count:
            raise about.error(
                "angles", f"{count} angles, as many as there are frames on the circle, and not {len(angles)}"
            )
    else:
        angles = factor * (about.number("start", "rad", 0.0) + about.number("step", "rad") * np.arange(count))
    stated = "unit" in about or (isinstance(about.get("angles"), dict) and "unit" in about.get("angles"))
    if not stated and np.ptp(angles) > 2.01 * np.pi:
        turns = np.ptp(angles) / (2 * np.pi)
        raise about.error("unit", f'"deg" or "rad": in radians the angles go {turns:.4g} times round')
    return -angles if about.text("turns", "antenna", among=("antenna", "object")) == "object" else angles
