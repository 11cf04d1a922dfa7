"""Scans written in the published layout, and captures of our own beside."""

import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import make_folder, printable
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Trajectory
from millisight.io import mito, save
from millisight.rig._protocols import RadarDevice
from millisight.rig._recorder import ScanPlan
from millisight.rig._rows import RowWriter

CAPTURE_NAME, LOG_NAME = "recorded.capture.h5", "recorded.log.h5"
"""Our own files beside a radar's raw ones: frames at the logged poses, clocks taken to agree; and the arm's log."""


def scan_info(radars: Iterable[Any], background: str) -> dict[str, Any]:
    """What `experiment_info.json` says of a scan by these radars.

    "aperture size" stands for the published pace of the frames and, at 24 GHz, for both receivers; "frame period" [s]
    says what the pace is where it is neither.

    Parameters
    ----------
    radars : of the published layout: what has a `name`, a `frame_period` and a `radar`, as a `RadarDevice`
    background : what the object stands on, such as "tripod"

    Raises
    ------
    UnknownNameError
        A radar is none of the layout's.
    """
    used = {mito.checked_radar(radar.name): radar for radar in radars}
    periods = {name: radar.frame_period for name, radar in used.items()}
    normal = all(period == mito.FRAME_PERIODS[name, "normal"] for name, period in periods.items())
    size = "normal" if normal and "77_ghz" in periods else "almost-square"
    axis = "x"
    if "77_ghz" in used:
        spread = np.ptp(used["77_ghz"].radar.array.rx_positions, axis=0)
        axis = "y" if spread[1] > spread[0] else "x"
    info = {"aperture size": size, "rx offset": axis, "background": background}
    other = {name: period for name, period in periods.items() if period != mito.FRAME_PERIODS[name, size]}
    return info | ({"frame period": other} if other else {})


class PublishedWriter(RowWriter):
    """Writes a scan as an experiment of the published layout: a `ScanWriter`.

    Rows go to disk as they come. The experiment appears under its name when all its files are whole, and not at all
    when something fails before. One run at a time writes an experiment.

    Parameters
    ----------
    out : the experiment's folder `<id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/los` or `nlos`
        (`experiment_folder` makes the name); it must not be there yet
    info : for `experiment_info.json`: "aperture size", "rx offset", "background", and whatever else
    hdf5 : write captures of our own besides
    fill : see `write_raw_experiment`
    origin : (3,) of the frame that images are in, in the arm's base frame [m]
    keep : the plan of the scan. What was recorded stays when the scan fails, in a hidden folder beside the
        experiment's, and another writer of the same plan goes on with it; None: nothing stays
    last : called when all is written and before the experiment appears: for what has to be there, too

    The radars' names must be those of the layout, "77_ghz" and "24_ghz".
    """

    def __init__(
        self,
        out: str | os.PathLike[str],
        *,
        info: Mapping[str, Any],
        hdf5: bool = True,
        fill: bool = True,
        origin: tuple[float, float, float] = mito.BASE_ORIGIN,
        keep: ScanPlan | None = None,
        last: Callable[[], object] | None = None,
    ):
        super().__init__(out, told=info, origin=origin, keep=keep)
        self._info, self._hdf5, self._fill, self._last = info, hdf5, fill, last

    @property
    def unfinished(self) -> Path:
        experiment = self.path.parent
        return experiment.with_name(f".{experiment.name}.{self.path.name}.unfinished")

    def recording(self, radars: Sequence[RadarDevice]) -> AbstractContextManager[None]:
        """Keep what is not whole yet in a folder beside the experiment's, gone in the end.

        Raises
        ------
        UnknownNameError
            A radar is none of the layout's.
        InputError
            The experiment is there already, or another of its number is set up differently.
        FileError
            The folder's name is none of the layout's, or something cannot be written.
        """
        return super().recording([radar for radar in radars if mito.checked_radar(radar.name)])

    @property
    def _stage(self) -> Path:
        """Where the experiment grows, with the names above it, too: provenance tells them."""
        return self._part.joinpath(*self.path.parts[-5:])

    def add_picture(self, frame: CameraFrame) -> None:
        folder = make_folder(self._stage / "unprocessed" / "camera")
        pose = np.array(frame.pose)
        pose[:3, 3] += mito.BASE_ORIGIN - self._origin  # to the layout's base frame
        mito.write_published(folder / "continuous.pkl", replace(frame, pose=pose))

    def finish(self) -> None:
        log = self._whole_log()
        for radar in self._radars:
            # From the arm's base frame to the radar's transmitter in the radar frame.
            positions = log.positions - self._origin + radar.mount
            mounted = Trajectory(times=log.times, positions=positions, orientations=log.orientations)
            mito.write_raw_experiment(
                self._stage,
                radar.name,
                self._spools[radar.name],
                mounted,
                info=self._info,
                fill=self._fill,
            )
        for radar in self._radars if self._hdf5 else ():
            raw = mito.radar_folder(self._stage, radar.name, processed=False)
            scan = mito.read_experiment(self._stage, radar.name)
            save(raw / CAPTURE_NAME, scan.to_capture(), reproducible=True)
            save(raw / LOG_NAME, scan.log, reproducible=True)
        if self._last is not None:
            self._last()
        # All of it is there: whoever is killed from here on leaves nothing to be done again.
        os.replace(self._stage.parent / mito.INFO_NAME, self.path.parent / mito.INFO_NAME)
        os.replace(self._stage, self.path)
        shutil.rmtree(self._part, ignore_errors=True)

    def _temporary(self, mark: str) -> Path:
        return self.path.parent.with_name(f".{self.path.parent.name}.{mark}.part")

    def _check(self) -> None:
        out = self.path
        mito.place_of(out)
        super()._check()
        other = out.parent / mito.INFO_NAME
        if other.exists() and mito.read_info(other) != dict(self._info):
            raise InputError(
                f"{printable(other)} says {mito.read_info(other)}; expected {dict(self._info)}: los and nlos of an "
                "experiment need the same set-up, record under another number"
            )
