"""Raw captures written in the published layout: `write_raw_experiment`, the inverse of `read_experiment`."""

import json
import os
import pickle
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import (
    as_array,
    atomic_path,
    checked_integer,
    checked_number,
    checked_path,
    make_folder,
    printable,
    write_text,
)
from millisight.core.errors import InputError
from millisight.data import Trajectory
from millisight.io.mito._names import INFO_NAME, RADARS, checked_radar, radar_folder
from millisight.io.mito._setup import BASE_ORIGIN, CHIRPS, FRAMES, frame_period, read_info
from millisight.io.raw import write_dca1000, write_position2go

_FILE_NAMES = {"77_ghz": "adc_data{:010d}.bin", "24_ghz": "p2g_data_{:010d}.txt"}
_RECEIVERS = {"77_ghz": 4, "24_ghz": 2}
"""In a file, whether they are used or not."""


class RecordedRow(NamedTuple):
    """A row of the aperture, as recorded.

    Attributes
    ----------
    number : in the file's name, of ten digits at most
    created : when the first frame was taken, on the robot's clock [s]
    frames : (F, C, R, N) complex of whole numbers that fit int16, the phase sign ours; C is 1 (77 GHz) or 16 (24 GHz),
        or 1 for 16 alike; R is 4 or 2
    """

    number: int
    created: float
    frames: np.ndarray


def write_raw_experiment(
    folder: str | os.PathLike[str],
    radar: str,
    rows: Sequence[RecordedRow],
    log: Trajectory,
    *,
    info: Mapping[str, Any],
    fill: bool = True,
) -> Path:
    """Write one radar's raw capture into an experiment of the published layout.

    Frames are conjugated at the door. The log goes into the robot's base frame, and into the tables of both radars; its
    orientations too, which the published imaging ignores. At 24 GHz a frame of one chirp is written 16 times over. The
    published code takes a 24 GHz file for zeros unless it has 110 frames: with `fill`, a file of fewer gets empty ones
    at its end, which `read_experiment` leaves out and notes, and a row of more becomes several files.

    Parameters
    ----------
    folder : `.../exp<N>/los` or `nlos`, made where it is missing
    radar : "77_ghz" or "24_ghz"
    rows : by file
    log : poses of the radar frame in the world frame of the published images, on the robot's clock
    info : for `experiment_info.json`: "aperture size", "rx offset", "background"
    fill : give every 24 GHz file the published number of frames

    Returns
    -------
    The folder of the radar's raw files.

    Raises
    ------
    InputError
        A row does not fit the radar, or the experiment has another `experiment_info.json` already.
    UnknownNameError, FileError
    """
    raw = radar_folder(folder, checked_radar(radar), processed=False)
    data = make_folder(raw / "radar_data")
    _write_info(checked_path(folder).parent / INFO_NAME, dict(info))
    numbers: list[int] = []
    created: list[float] = []
    for row in _filled(rows, dict(info)) if fill and radar == "24_ghz" else rows:
        number = checked_integer(row.number, name="number", minimum=0)
        if number >= 10**10:
            raise InputError(f"number is {number}; expected ten digits at most")
        numbers.append(number)
        created.append(checked_number(row.created, name="created", unit="s"))
        path = data / _FILE_NAMES[radar].format(number)
        chirps = CHIRPS[radar]
        shape = ("F", chirps if np.shape(row.frames)[1:2] == (chirps,) else 1, _RECEIVERS[radar], "N")
        frames = np.conj(as_array(row.frames, name=f"frames of row {number}", shape=shape, dtype=np.complex64))
        if radar == "77_ghz":
            write_dca1000(path, frames)
        else:
            write_position2go(path, np.repeat(frames, chirps // frames.shape[1], axis=1))
    _write_log(raw / "antenna.npz", log)
    listed = {"all_radar_filenames": numbers, "all_radar_created_ts": created, "pattern": 0.5}
    with atomic_path(raw / "continuous.pkl") as temporary, open(temporary, "wb") as file:
        pickle.dump(listed, file)
    return raw


def _filled(rows: Sequence[RecordedRow], info: Mapping[str, Any]) -> Iterator[RecordedRow]:
    """Rows of the published number of frames each: longer ones split, shorter ones with frames of zeros at the end."""
    count, period = FRAMES["24_ghz", info["aperture size"]], frame_period(info, "24_ghz")
    numbers = {row.number for row in rows}
    for row in rows:
        frames, number = np.asarray(row.frames), row.number
        for start in range(0, max(len(frames), 1), count):
            part = frames[start : start + count]
            empty = np.zeros((count - len(part), *frames.shape[1:]), frames.dtype)
            if start:
                number = next(n for n in range(number + 1, 10**10) if n not in numbers)
                numbers.add(number)
            yield RecordedRow(number, row.created + start * period, np.concatenate([part, empty]))


def _write_info(path: Path, info: dict[str, Any]) -> None:
    if path.exists():
        there = read_info(path)
        if there != info:
            raise InputError(f"{printable(path)} says {there}; expected {info}: choose another experiment")
        return
    write_text(path, json.dumps(info, indent=2) + "\n")
    read_info(path)


def _write_log(path: Path, log: Trajectory) -> None:
    turned = np.tile([0.0, 0.0, 0.0, 1.0], (len(log), 1)) if log.orientations is None else log.orientations
    locations = np.column_stack([log.positions + BASE_ORIGIN, turned])
    bands = [radar[:2] for radar in RADARS]
    tables = {f"times_{band}": log.times for band in bands} | {f"tx_{band}_locs": locations for band in bands}
    with atomic_path(path) as temporary:
        np.savez(temporary, allow_pickle=False, **tables)
