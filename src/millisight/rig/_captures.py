"""Scans written as captures of our own: any radar, any name."""

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import numpy as np

from millisight.core import make_folder, printable
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Radar, RawScan, ScanRow, Trajectory, VoxelGrid
from millisight.io import save
from millisight.rig._protocols import RadarDevice
from millisight.rig._recorder import ScanPlan
from millisight.rig._rows import RowWriter


class CaptureWriter(RowWriter):
    """Writes a scan as a folder of captures: a `ScanWriter`.

    For each radar there are `<name>.capture.h5`, its frames at the logged poses, clocks taken to agree, and
    `<name>.log.h5`, the arm's log, with which `millisight image --clock apply` corrects the clocks; with a camera,
    `camera.npz` as well: `rgb`, `depth` [m], `pose` (4, 4) to the frame of the images, `intrinsics` fx, fy, cx, cy
    [pixels]. Of each frame the first chirp is taken.

    Parameters
    ----------
    out : the folder, which must not be there yet
    origin : (3,) of the frame that images are in, in the arm's base frame [m]
    grid : voxels that the captures' images have where no others are asked for; None: those of the aperture
    keep : the plan of the scan. What was recorded stays when the scan fails, in a hidden folder beside `out`, and
        another writer of the same plan goes on with it; None: nothing stays
    metadata : of the captures: what JSON can hold
    """

    def __init__(
        self,
        out: str | os.PathLike[str],
        *,
        origin: tuple[float, float, float],
        grid: Mapping[str, Any] | None = None,
        keep: ScanPlan | None = None,
        metadata: Mapping[str, Any] | None = None,
    ):
        super().__init__(out, told=metadata or {}, origin=origin, keep=keep)
        if grid is not None:
            VoxelGrid.regular(**grid)
        self._metadata = dict(metadata or {}) | ({} if grid is None else {"image_grid": dict(grid)})

    def recording(self, radars: Sequence[RadarDevice]) -> AbstractContextManager[None]:
        """Keep what is not whole yet in a folder beside `out`, gone in the end.

        Raises
        ------
        InputError
            A radar's name is none of a file; `out` is there already, or an unfinished scan is of another plan.
        FileError
            Something cannot be written.
        """
        for radar in radars:
            if os.path.basename(radar.name) != radar.name or radar.name.startswith(".") or not radar.name:
                raise InputError(f"a radar is called {printable(radar.name)!r}; expected a name that files can have")
        return super().recording(radars)

    def add_picture(self, frame: CameraFrame) -> None:
        pose, known = np.array(frame.pose), frame.intrinsics
        pose[:3, 3] -= self._origin
        np.savez(
            make_folder(self._part / "scan") / "camera.npz", allow_pickle=False, rgb=frame.rgb,
            depth=frame.depth * frame.depth_unit, pose=pose, intrinsics=[known.fx, known.fy, known.cx, known.cy],
        )  # fmt: skip

    def finish(self) -> None:
        folder, log = make_folder(self._part / "scan"), self._whole_log()
        placed = Trajectory(times=log.times, positions=log.positions - self._origin, orientations=log.orientations)
        for radar in self._radars:
            rows = tuple(self._row(radar, number) for number in range(self.rows_done))
            scan = RawScan(radar=mounted(radar), rows=rows, log=placed, metadata=self._metadata)
            save(folder / f"{radar.name}.capture.h5", scan.to_capture(), reproducible=True)
            save(folder / f"{radar.name}.log.h5", placed, reproducible=True)
        os.replace(folder, self.path)
        shutil.rmtree(self._part, ignore_errors=True)

    def _row(self, radar: RadarDevice, number: int) -> ScanRow:
        kept = self._spools[radar.name][number]
        frames = kept.frames
        return ScanRow(
            times=kept.created + radar.frame_period * np.arange(len(frames)),
            read=lambda: self._spools[radar.name][number].frames[:, :1],  # anew: memory need not hold every row
            source=f"row {number + 1}",
            missing=~frames.any(axis=(1, 2, 3)),  # the mark of a frame that was lost
        )


def mounted(device: RadarDevice) -> Radar:
    """The radar by its name in the rig, its antennas in the frame that the arm's poses are of."""
    return replace(device.radar, name=device.name, array=device.radar.array.moved(translation=device.mount))
