"""A description as a whole: its tables, and the capture or the scan that they add up to."""

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from millisight.capture.capture import Capture
from millisight.capture.radar import Radar
from millisight.capture.scan import RawScan, ScanRow
from millisight.capture.trajectory import Trajectory
from millisight.errors import InputError
from millisight.files import printable
from millisight.imaging.form import METHODS
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.windows import WINDOWS
from millisight.io import description_calibration, description_frames, description_positions, description_radar
from millisight.io.description_calibration import Calibration
from millisight.io.description_frames import FrameReader, Frames
from millisight.io.description_tables import Files, Table
from millisight.records import record, with_step

_TABLES = {
    "radar": description_radar.KEYS,
    "frames": description_frames.KEYS,
    "positions": description_positions.KEYS,
    "times": description_positions.TIMES_KEYS,
    "calibration": description_calibration.KEYS,
    "image": ("lower", "upper", "spacing", "method", "window"),
}
Progress = Callable[[int, int], None]


@record
class CalibratedScan(RawScan):
    """A scan whose captures are calibrated.

    Attributes
    ----------
    calibrate : makes the calibrated capture of one as recorded
    """

    calibrate: Callable[[Capture], Capture]

    def to_capture(self, **settings: Any) -> Capture:
        """The frames at the poses that the log gives their times, as for any `RawScan`, and then calibrated."""
        return self.calibrate(RawScan.to_capture(self, **settings))


class Description:
    """A description whose keys are checked.

    Parameters
    ----------
    content : what the TOML file holds
    files : finds the files that it names
    source : its file, for messages and provenance

    Raises
    ------
    FileError, UnknownNameError
        A table or a key is missing or not known, or a file that it names is not there.
    """

    def __init__(self, content: dict[str, Any], files: Files, source: Path):
        whole = Table(content, "its tables", source, files, ("title", *_TABLES))
        self._source = source
        self._title = whole.text("title", source.stem)
        self._tables = {name: whole.table(name, keys, f"[{name}]") for name, keys in _TABLES.items() if name in whole}
        for name in ("radar", "frames"):
            if name not in self._tables:
                raise whole.error(f"[{name}]", f"a table of that name: {', '.join(_TABLES[name])}")
        self._config = description_radar.read_config(self._tables["radar"])
        self._reader = FrameReader(self._tables["frames"], self._config)
        self._image = self._read_image()
        table = self._tables.get("calibration")
        self._calibration = None if table is None else Calibration(table, self._reader)

    @cached_property
    def log(self) -> Trajectory | None:
        """The robot's log that it names, by the robot's clock; None: it names none."""
        table = self._tables.get("positions")
        return None if table is None else description_positions.read_log(table)

    def radar(self, shape: tuple[int, ...]) -> Radar:
        """The radar of frames (F, T, R, N) of `shape`."""
        return description_radar.read_radar(self._tables["radar"], self._config, shape, self._title)

    def frames(self) -> np.ndarray:
        """(F, T, R, N) complex64 frames of all files, of the phase sign inside millisight, not calibrated."""
        return _joined([frames.values for frames in self._read(None)])

    def capture(self, progress: Progress | None) -> Capture:
        """The capture, where the positions follow from the order of the frames.

        Raises
        ------
        InputError
            There are no positions.
        """
        if "positions" not in self._tables:
            raise InputError(
                f"{printable(self._source)} has no table [positions]: its frames can be read, but nothing can be "
                "imaged from them; say by raster, points or log where the radar was at each of them"
            )
        read = list(self._read(progress))
        frames, kept = _joined([part.values for part in read]), ~np.concatenate([part.lost for part in read])
        times = self._times([len(part.values) for part in read])
        poses = description_positions.read_poses(
            self._tables["positions"],
            None if times is None else np.concatenate(times),
            read[0].scan if len(read) == 1 else {"pose": len(frames)},
        )
        if not kept.all():
            turned = None if poses.orientations is None else poses.orientations[kept]
            poses = Trajectory(times=poses.times[kept], positions=poses.positions[kept], orientations=turned)
            frames = frames[kept]
        metadata = self._metadata(read[0].settings, lost=int((~kept).sum()))
        capture = Capture(radar=self.radar(frames.shape), trajectory=poses, frames=frames, metadata=metadata)
        return capture if self._calibration is None else self._calibration(capture)

    def scan(self, log: Trajectory, progress: Progress | None) -> RawScan:
        """The scan, its positions from the robot's `log`. Each file is read once now, and again when it is used.

        Raises
        ------
        InputError
            There are no times.
        """
        looked = [(part.values.shape, part.lost, part.settings) for part in self._read(progress)]
        times = self._times([len(lost) for _, lost, _ in looked])
        if times is None:
            raise InputError(
                f"{printable(self._source)} names a robot's log, but no table [times] says when the frames were taken"
            )
        rows = [
            ScanRow(times=t, read=partial(self._values, path), source=printable(path.name), missing=lost)
            for path, (_, lost, _), t in zip(self._reader.paths, looked, times, strict=True)
        ]
        shape, _, settings = looked[0]
        parts = {"radar": self.radar(shape), "rows": tuple(rows), "log": log, "metadata": self._metadata(settings)}
        return RawScan(**parts) if self._calibration is None else CalibratedScan(**parts, calibrate=self._calibration)

    def _read(self, progress: Progress | None) -> Iterator[Frames]:
        """The frames of each file in turn."""
        first, paths = None, self._reader.paths
        for number, path in enumerate(paths, 1):
            part = self._reader.read(path)
            first = first or part
            if part.values.shape[1:] != first.values.shape[1:]:
                raise self._tables["frames"].error(
                    "file",
                    f"files of one kind, but frames of {printable(path.name)} have shape {part.values.shape[1:]}, "
                    f"those of {printable(paths[0].name)} {first.values.shape[1:]}",
                )
            yield part
            if progress is not None:
                progress(number, len(paths))

    def _values(self, path: Path) -> np.ndarray:
        return self._reader.read(path).values

    def _times(self, counts: list[int]) -> list[np.ndarray] | None:
        """When the frames of each file were taken [s]; None: nobody says."""
        return description_positions.read_times(self._tables["times"], counts) if "times" in self._tables else None

    def _read_image(self) -> dict[str, Any]:
        """What [image] says, as metadata: the grid that is wanted, method and window."""
        if "image" not in self._tables:
            return {}
        table, told = self._tables["image"], {}
        corners = [key for key in ("lower", "upper", "spacing") if key in table]
        if corners:
            grid = {"lower": table.array("lower", "m", (3,)), "upper": table.array("upper", "m", (3,))}
            spacing = table.numbers("spacing", "m", 3)
            with table.errors(), np.errstate(over="ignore", invalid="ignore"):
                VoxelGrid.regular(grid["lower"], grid["upper"], spacing)
            told["image_grid"] = {key: values.tolist() for key, values in (grid | {"spacing": spacing}).items()}
        known = {"method": METHODS, "window": ("none", *WINDOWS)}
        told["imaging"] = {key: table.text(key, among=names) for key, names in known.items() if key in table}
        return told

    def _metadata(self, settings: dict[str, Any], **counts: int) -> dict[str, Any]:
        metadata = {"source": self._title, "description": printable(self._source.name), **self._image}
        if self._reader.notes:
            metadata["notes"] = self._reader.notes
        files = [printable(path.name) for path in self._reader.paths]
        phase_sign = self._tables["frames"].get("phase_sign")
        return with_step(metadata, "read_capture", files=files, phase_sign=phase_sign, **settings, **counts)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """The parts one after the other; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
