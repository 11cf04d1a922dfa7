"""[positions] and [times] of a description: where the radar was at each frame, and when."""

import math
from collections.abc import Sequence

import numpy as np

from millisight.capture.trajectory import Trajectory
from millisight.io.description_tables import TEXT_SUFFIXES, Table

KEYS = ("raster", "points", "orientations", "log", "origin")
TIMES_KEYS = ("start", "period", "array")
_RASTER_KEYS = ("step", "center", "start", "counts", "along", "serpentine")
_LOG_KEYS = ("file", "times", "positions", "orientations", "unit")
_INTERVAL = 1e-3  # between frames whose times nobody needs [s]


def read_log(table: Table) -> Trajectory | None:
    """The robot's log that [positions] names, in the frame that `origin` shifts it to; None: it names none."""
    if "log" not in table:
        return None
    table.only_one("raster", "points", "log")
    from millisight.io.robot_log import read_robot_log

    if isinstance(table.get("log"), str):
        log = read_robot_log(table.files.one(table.text("log")))
    else:
        about = table.table("log", _LOG_KEYS)
        path = about.file()
        names = {key: about.text(key) for key in ("times", "positions", "orientations") if key in about}
        if names and path.suffix.lower() in TEXT_SUFFIXES:
            raise about.error(next(iter(names)), "it of arrays alone: a text names its columns in its first line")
        log = read_robot_log(path, **names, scale=about.unit("m"))
    with table.errors(), _unbounded():
        return Trajectory(times=log.times, positions=log.positions - _origin(table), orientations=log.orientations)


def read_poses(table: Table, times: np.ndarray | None, scan: dict[str, int]) -> Trajectory:
    """The poses of frames that lie on a raster or at listed points.

    Parameters
    ----------
    times : (P,) [s]; None: nobody says
    scan : how many frames there are along the axes of the scan, the slow one first

    Raises
    ------
    FormatError
        The table cannot be right, or does not fit the frames.
    """
    count = math.prod(scan.values())
    orientations = None
    with table.errors(), _unbounded():
        if table.only_one("raster", "points", "log") == "raster":
            positions = _raster(table.table("raster", _RASTER_KEYS), scan)
        else:
            positions = table.array("points", "m")
            if positions.shape != (count, 3):
                raise table.error("points", f"({count}, 3), one for each frame, and not shape {positions.shape}")
        if "orientations" in table:
            orientations = table.array("orientations", "")
            if orientations.shape not in ((4,), (count, 4)):
                raise table.error("orientations", f"a quaternion x, y, z, w, or one for each of the {count} frames")
            orientations = np.broadcast_to(orientations, (count, 4))
        return Trajectory(
            times=_INTERVAL * np.arange(count) if times is None else times,
            positions=positions - _origin(table),
            orientations=orientations,
        )


def read_times(table: Table, counts: Sequence[int]) -> list[np.ndarray]:
    """When the frames of each file were taken [s], by file; `counts` are their numbers.

    Raises
    ------
    FormatError
    """
    if table.only_one("array", "start") == "array":
        times = table.array("array", "s")
        if times.size != sum(counts):
            raise table.error("array", f"{sum(counts)} times, one for each frame, not {times.size}")
        return np.split(times.reshape(-1), np.cumsum(counts)[:-1])
    period = table.number("period", "s")
    starts = table.array("start", "s").reshape(-1)
    if len(starts) != len(counts):
        raise table.error("start", f"{len(counts)} times, of the first frame of each file, not {len(starts)}")
    with _unbounded():
        return [start + period * np.arange(count) for start, count in zip(starts, counts, strict=True)]


def _unbounded() -> np.errstate:
    """Within the block what overflows becomes infinite without a word: the records refuse it."""
    return np.errstate(over="ignore", invalid="ignore")


def _origin(table: Table) -> np.ndarray:
    return table.array("origin", "m", (3,)) if "origin" in table else np.zeros(3)


def _raster(table: Table, scan: dict[str, int]) -> np.ndarray:
    """(P, 3) positions on a raster parallel to x and y, the frames' slow axis first [m]."""
    counts = _counts(table, scan)
    steps = table.numbers("step", "m", 2) if "step" in table else np.zeros(2)
    corner = "start" in table and table.only_one("start", "center") == "start"
    places = np.zeros((*counts.values(), 3))
    for place, (axis, count) in enumerate(counts.items()):
        number = "xy".index(axis)
        if count > 1 and not steps[number]:
            raise table.error("step", "the distance of neighbouring positions along x and y [m], one number or two")
        index = np.arange(count) - (0 if corner else (count - 1) / 2)
        along = [-1 if other == place else 1 for other in range(len(counts))]
        places[..., number] = (index * steps[number]).reshape(along)
    if table.flag("serpentine"):
        if len(counts) < 2:
            raise table.error("serpentine", "two axes of the scan, x and y, where rows run to and fro")
        places[1::2] = places[1::2, ::-1].copy()
    key = "start" if corner else "center"
    return places.reshape(-1, 3) + (table.array(key, "m", (3,)) if key in table else 0)


def _counts(table: Table, scan: dict[str, int]) -> dict[str, int]:
    """The number of positions along x and y, the slow axis first; frames one after another are dealt out."""
    if "pose" not in scan:
        for key in ("counts", "along"):
            if key in table:
                raise table.error(key, "it only where the axes name pose, and neither x nor y")
        return scan
    if scan["pose"] == 1 and "counts" not in table:
        return {}
    counts = table.wholes("counts").tolist()
    if np.shape(counts) != (2,) or min(counts) < 1 or counts[0] * counts[1] != scan["pose"]:
        raise table.error("counts", f"the positions along x and y, {scan['pose']} in all")
    axes = "yx" if table.text("along", "y", among=("x", "y")) == "x" else "xy"
    return {axis: counts["xy".index(axis)] for axis in axes}
