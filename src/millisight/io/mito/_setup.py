"""How the published experiments were set up: radars, frames, the world frame, and the grid of the images."""

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.data import AntennaArray, Radar, VoxelGrid
from millisight.io.mito._names import checked_radar

BASE_ORIGIN = (0.42, -0.23, 0.23)
"""The origin of the frame that images are in, the world frame here, in the robot's base frame; axes parallel [m]."""

PRESETS = {"77_ghz": "iwr1443", "24_ghz": "position2go"}
SIMULATED_PRESETS = {"77_ghz": "mito-sim-77ghz", "24_ghz": "mito-sim-24ghz"}
SUFFIXES = {"77_ghz": ".bin", "24_ghz": ".txt"}
CHIRPS = {"77_ghz": 1, "24_ghz": 16}
"""In a frame; the first is used."""

FRAME_PERIODS = {
    ("77_ghz", "normal"): 0.125,
    ("77_ghz", "almost-square"): 0.003,
    ("77_ghz", "large"): 0.125,
    ("24_ghz", "normal"): 0.1,
    ("24_ghz", "almost-square"): 0.1,
    ("24_ghz", "large"): 0.1,
}
"""Between frames of a file [s], by radar and aperture size; a "large" one is scanned as a "normal" one."""
FRAMES = {("77_ghz", "normal"): 110, ("77_ghz", "almost-square"): 4000, ("77_ghz", "large"): 110} | {
    ("24_ghz", aperture): 110 for aperture in ("normal", "almost-square", "large")
}
"""In a file."""

_LARGEST_INFO = 1 << 20  # bytes
_STEPS = (0.0025, 0.0025, 0.01)  # of the published images [m]
_MARGIN = 0.05  # of 24 GHz images past the antennas [m]
_FARTHEST = 0.45  # where they end when no antenna is known [m]


def read_info(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What `experiment_info.json` says; at least "aperture size", "rx offset" and "background".

    Raises
    ------
    FileError
        It cannot be read.
    DamagedFileError
        It is no JSON, or a key is missing or has a value that is not known.
    """
    path = check_readable(path)
    name = printable(path)
    if path.stat().st_size > _LARGEST_INFO:
        raise FormatError(f"{name} has {path.stat().st_size} bytes; expected a few lines of JSON")
    try:
        info = json.loads(path.read_bytes(), parse_constant=str)  # NaN and Infinity are no JSON
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(f"{name} is not JSON: {error}") from error
    apertures = tuple(aperture for radar, aperture in FRAME_PERIODS if radar == "77_ghz")
    for key, known in (("aperture size", apertures), ("rx offset", ("x", "y")), ("background", None)):
        if not isinstance(info, dict) or not isinstance(info.get(key), str):
            raise DamagedFileError(f"{name} has no text {key!r}; expected 'aperture size', 'rx offset', 'background'")
        if known is not None and info[key] not in known:
            raise DamagedFileError(f"{name}: {key!r} is {info[key]!r}; expected {' or '.join(map(repr, known))}")
    if not isinstance(info.get("class", ""), str):
        raise DamagedFileError(f"{name}: 'class' is {info['class']!r}; expected the name of a class, or no such key")
    periods = info.get("frame period", {})
    if not isinstance(periods, dict) or not all(_is_period(value) for value in periods.values()):
        raise DamagedFileError(
            f"{name}: 'frame period' is {periods!r}; expected seconds above 0 by radar, or no such key"
        )
    return info


def _is_period(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e6


def frame_period(info: Mapping[str, Any], radar: str) -> float:
    """From frame to frame of an experiment [s]: the published one, or what `info`'s "frame period" has of the radar."""
    return float(info.get("frame period", {}).get(radar, FRAME_PERIODS[radar, info["aperture size"]]))


def experiment_radar(radar: str, info: Mapping[str, Any], *, every_receiver: bool = False) -> Radar:
    """The radar as it was set up in an experiment: receivers along `info`'s "rx offset" (77 GHz), one or two (24 GHz).

    Two are of the aperture "almost-square", or of any with `every_receiver`.

    Raises
    ------
    UnknownNameError
    """
    if checked_radar(radar) == "77_ghz":
        return Radar.preset(PRESETS[radar], rx_axis=info["rx offset"])
    preset = Radar.preset(PRESETS[radar])
    used = 2 if every_receiver or info["aperture size"] == "almost-square" else 1
    receivers = preset.array.rx_positions[:used]
    array = AntennaArray(tx_positions=preset.array.tx_positions, rx_positions=receivers)
    return Radar(name=preset.name, waveform=preset.waveform, array=array, path_offset=preset.path_offset)


def published_box(radar: str, background: str, *, farthest: float | None = None) -> dict[str, list[float]]:
    """First and last voxel and spacing [m] of the published images, as `VoxelGrid.regular` takes them.

    The published axes are ranges by a step whose end is left out, up to rounding: along y it lets the end in at 77 GHz,
    and along z over styrofoam.

    Parameters
    ----------
    radar : "77_ghz" or "24_ghz"
    background : what the object stood on, as in `experiment_info.json`: "tripod", or the styrofoam block
    farthest : largest x of the antennas [m], 5 cm past which 24 GHz images end; None: that of a typical scan, 0.40

    Raises
    ------
    UnknownNameError
    """
    high = checked_radar(radar) == "77_ghz"
    end = 0.45 if high else _FARTHEST if farthest is None else farthest + _MARGIN
    z = (-0.37, -0.15) if background == "tripod" else (-0.55, -0.30)
    ranges = ((-0.10, end), (-0.05, 0.55), z) if high else ((-0.05, end), (0.05, 0.65), z)
    return _box(ranges)


def published_grid(radar: str, background: str, *, farthest: float | None = None) -> VoxelGrid:
    """The voxels of the published images: `published_box` as a grid.

    Examples
    --------
    >>> published_grid("77_ghz", "tripod").shape
    (220, 241, 22)
    """
    return VoxelGrid.regular(**published_box(radar, background, farthest=farthest))


def simulated_box(farthest: float) -> dict[str, list[float]]:
    """As `published_box`, of simulated images: along x from 0 to the `farthest` antenna [m]."""
    return _box(((0.0, farthest), (0.05, 0.5), (-0.37, -0.15)))


def _box(ranges: Sequence[tuple[float, float]]) -> dict[str, list[float]]:
    # As floating-point ranges come out, not as they are meant: 0.55 is among np.arange(-0.05, 0.55, 0.0025).
    counts = [len(np.arange(start, end, step)) for (start, end), step in zip(ranges, _STEPS, strict=True)]
    lower = [float(start) for start, _ in ranges]
    upper = [round(a + (max(n, 1) - 1) * s, 4) for a, n, s in zip(lower, counts, _STEPS, strict=True)]
    return {"lower": lower, "upper": upper, "spacing": list(_STEPS)}
