"""[positions] and [times] of a description: where the radar, or each antenna, was at each frame, and when."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from millisight.data import Trajectory
from millisight.io.arrays import TEXT_SUFFIXES
from millisight.io.description._circle import circle
from millisight.io.description._tables import TomlTable

KEYS = (
    "raster", "circle", "points", "log", "tx_points", "rx_points", "pairs", "count_from", "orientations", "origin",
)  # fmt: skip
TIMES_KEYS = ("start", "period", "array")
_RASTER_KEYS = ("step", "center", "start", "counts", "along", "serpentine")
_LOG_KEYS = ("file", "times", "positions", "orientations", "unit", "columns", "skip_rows", "rows", "decimal")
_ANTENNAS = ("tx_points", "rx_points", "pairs")
_INTERVAL = 1e-3  # between frames whose times nobody needs [s]


@dataclass(frozen=True, slots=True)
class Poses:
    """Where each frame was measured.

    Attributes
    ----------
    trajectory : the radar's poses
    path_offset : that the scan adds to the radar's [m]
    tx_points, rx_points : (P, T, 3), (P, R, 3) antennas in the world frame [m]; None: the radar's at the poses
    """

    trajectory: Trajectory
    path_offset: float = 0.0
    tx_points: np.ndarray | None = None
    rx_points: np.ndarray | None = None


def read_log(table: TomlTable) -> Trajectory | None:
    """The robot's log that [positions] names, in the frame that `origin` shifts it to; None: it names none."""
    if "log" not in table:
        return None
    table.only_one("raster", "circle", "points", "log")
    for key in (*_ANTENNAS, "count_from"):
        if key in table:
            raise table.error(key, "no such key beside log")
    from millisight.io.raw import read_robot_log

    if isinstance(table.get("log"), str):
        log = read_robot_log(table.files.one(table.text("log")))
    else:
        about = table.table("log", _LOG_KEYS)
        path = about.file()
        names: dict[str, Any] = {key: about.text(key) for key in ("times", "positions", "orientations") if key in about}
        if names and path.suffix.lower() in TEXT_SUFFIXES:
            raise about.error(
                next(iter(names)), "this key only for arrays; for a text file, columns selects time, x, y, z"
            )
        settings = about.text_settings(path)
        with about.errors():
            log = read_robot_log(path, **names, **settings, columns=about.get("columns"), scale=about.unit("m"))
    with table.errors(), _unbounded():
        return Trajectory(times=log.times, positions=log.positions - _origin(table), orientations=log.orientations)


def read_poses(table: TomlTable, times: np.ndarray | None, scan: dict[str, int], antennas: tuple[int, int]) -> Poses:
    """The poses of frames on a raster, on a circle, at listed points, or of antennas that are listed themselves.

    Parameters
    ----------
    times : (P,) [s]; None: nobody says
    scan : how many frames there are along the axes of the scan, the slow one first
    antennas : T and R of the frames

    Raises
    ------
    FormatError
        The table cannot be right, or does not fit the frames.
    """
    if "pairs" in table:
        return _paired(table, times, scan)
    for key in ("pair", "count_from"):
        if key in scan or key in table:
            raise table.error("pairs", "the two antennas of each pair, by their numbers in tx_points and rx_points")
    count = math.prod(scan.values())
    with table.errors(), _unbounded():
        points = {
            key: _antenna_points(table, key, count, number) - _origin(table)
            for key, number in zip(_ANTENNAS[:2], antennas, strict=True)
            if key in table
        }
        placed = any(key in table for key in ("raster", "circle", "points"))
        if len(points) == 1 and not placed:
            raise table.error(
                "rx_points" if "tx_points" in table else "tx_points",
                "both of tx_points and rx_points, or raster, circle or points for the other antennas",
            )
        if points and not placed:
            middle = np.concatenate(list(points.values()), axis=1).mean(axis=1)
            return Poses(Trajectory(times=_times(times, count), positions=middle), 0.0, *points.values())
        trajectory, offset = _scanned(table, times, scan)
        return Poses(trajectory, offset, points.get("tx_points"), points.get("rx_points"))


def _scanned(table: TomlTable, times: np.ndarray | None, scan: dict[str, int]) -> tuple[Trajectory, float]:
    """The poses on a raster, on a circle or at points, and the path offset that comes with them."""
    count, offset, turned = math.prod(scan.values()), 0.0, None
    way = table.only_one("raster", "circle", "points", "log")
    if way == "circle":
        positions, turned, offset = circle(table, scan)
    elif {"angle", "height"} & set(scan):
        raise table.error(way, "circle, since the axes include angle or height")
    elif way == "raster":
        positions = _raster(table.table("raster", _RASTER_KEYS), scan)
    else:
        positions = table.array("points", "m")
        if positions.shape != (count, 3):
            raise table.error("points", f"({count}, 3), one for each frame, and not shape {positions.shape}")
    if "orientations" in table:
        given = table.array("orientations", "")
        if given.shape not in ((4,), (count, 4)):
            raise table.error("orientations", f"a quaternion x, y, z, w, or one for each of the {count} frames")
        turned = np.broadcast_to(given, (count, 4))
    poses = Trajectory(times=_times(times, count), positions=positions - _origin(table), orientations=turned)
    return poses, offset


def _times(times: np.ndarray | None, count: int) -> np.ndarray:
    return _INTERVAL * np.arange(count) if times is None else times


def _antenna_points(table: TomlTable, key: str, count: int, antennas: int) -> np.ndarray:
    """(P, A, 3) places of the antennas of one kind at each pose [m]."""
    points = table.array(key, "m")
    if antennas == 1 and points.shape in ((count, 3), (3,)):
        points = points.reshape(-1, 1, 3)
    if points.shape not in ((count, antennas, 3), (1, antennas, 3), (antennas, 3)):
        one = f", or ({count}, 3)" if antennas == 1 else ""
        raise table.error(
            key, f"({count}, {antennas}, 3), each antenna at each frame, or ({antennas}, 3) if they do not move{one}; "
                "its "
            f"shape is {points.shape}"
        )  # fmt: skip
    return np.array(np.broadcast_to(points, (count, antennas, 3)))


def _paired(table: TomlTable, times: np.ndarray | None, scan: dict[str, int]) -> Poses:
    """The poses of measured pairs: each pair of each pose becomes a pose of one transmitter and one receiver."""
    pairs = table.wholes("pairs")
    first = table.integer("count_from", 0, minimum=0)
    with table.errors(), _unbounded():
        if "tx_points" not in table:
            raise table.error("tx_points", "the positions of the antennas in pairs, one [x, y, z] each [m]")
        antennas = [table.array(key, "m", ("antenna", 3)) for key in ("tx_points", "rx_points") if key in table]
        antennas = [antennas[0], antennas[-1]]
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise table.error("pairs", f"(pairs, 2), a transmitter and a receiver each; its shape is {pairs.shape}")
        if "count_from" not in table and pairs.min() == 1:
            raise table.error("count_from", "0 or 1, the number of the first antenna, since no pair has the number 0")
        numbers = pairs - first
        for column, points in enumerate(antennas):
            low, high = numbers[:, column].min(), numbers[:, column].max()
            if low < 0 or high >= len(points):
                raise table.error(
                    "pairs",
                    f"numbers from {first} to {first + len(points) - 1}, of the {len(points)} antennas, and they go "
                    f"from {low + first} to {high + first}",
                )
        rest = {axis: count for axis, count in scan.items() if axis != "pair"}
        there = scan.get("pair")
        placed = any(key in table for key in ("raster", "circle", "points"))
        if there is None and not placed:  # the poses are the pairs
            there, rest = math.prod(scan.values()), {}
        if there != len(pairs):
            axis = "pair" if "pair" in scan else "pose"
            raise table.error(
                "pairs", f"{there} of them, as many as the frames have along {axis!r}; there are {len(pairs)}"
            )
        count, offset = math.prod(rest.values()), 0.0
        if placed:
            # One time for each pair of each pose: the poses have those of their first pairs.
            trajectory, offset = _scanned(table, None if times is None else times[:: len(pairs)], rest)
        elif count > 1:
            raise table.error("points", "raster, circle or points, with the positions of the antennas")
        else:
            trajectory = Trajectory(times=np.zeros(1), positions=-_origin(table)[None])
        tx, rx = (
            trajectory.placed(points)[:, numbers[:, column]].reshape(-1, 1, 3) for column, points in enumerate(antennas)
        )
        turned = trajectory.orientations
        return Poses(
            Trajectory(
                times=_times(times, len(tx)),
                positions=(tx + rx)[:, 0] / 2,
                orientations=None if turned is None else np.repeat(turned, len(pairs), axis=0),
            ),
            offset,
            tx,
            rx,
        )


def read_times(table: TomlTable, counts: Sequence[int]) -> list[np.ndarray]:
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


def _origin(table: TomlTable) -> np.ndarray:
    return table.array("origin", "m", (3,)) if "origin" in table else np.zeros(3)


def _raster(table: TomlTable, scan: dict[str, int]) -> np.ndarray:
    """(P, 3) positions on a raster parallel to x and y, the frames' slow axis first [m]."""
    counts = _counts(table, scan)
    steps = table.numbers("step", "m", 2) if "step" in table else np.zeros(2)
    corner = "start" in table and table.only_one("start", "center") == "start"
    places = np.zeros((*counts.values(), 3))
    for place, (axis, count) in enumerate(counts.items()):
        number = "xy".index(axis)
        if count > 1 and not steps[number]:
            raise table.error(
                "step", "the distance between neighbouring positions along x and y [m], one number or two"
            )
        index = np.arange(count) - (0 if corner else (count - 1) / 2)
        along = [-1 if other == place else 1 for other in range(len(counts))]
        places[..., number] = (index * steps[number]).reshape(along)
    if table.flag("serpentine"):
        if len(counts) < 2:
            raise table.error("serpentine", "two axes of the scan, x and y, where rows alternate in direction")
        places[1::2] = places[1::2, ::-1].copy()
    key = "start" if corner else "center"
    return places.reshape(-1, 3) + (table.array(key, "m", (3,)) if key in table else 0)


def _counts(table: TomlTable, scan: dict[str, int]) -> dict[str, int]:
    """The number of positions along x and y, the slow axis first; frames one after another are dealt out."""
    if "pose" not in scan:
        for key in ("counts", "along"):
            if key in table:
                raise table.error(key, "this key only if the axes include pose, and neither x nor y")
        return scan
    if scan["pose"] == 1 and "counts" not in table:
        return {}
    if "counts" not in table:
        raise table.error("counts", f"[along x, along y], {scan['pose']} positions in all, as the axes name pose alone")
    counts = table.wholes("counts").tolist()
    if np.shape(counts) != (2,) or min(counts) < 1 or counts[0] * counts[1] != scan["pose"]:
        raise table.error("counts", f"the positions along x and y, {scan['pose']} in all")
    axes = "yx" if table.text("along", "y", among=("x", "y")) == "x" else "xy"
    return {axis: counts["xy".index(axis)] for axis in axes}
