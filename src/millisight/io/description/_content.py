"""A description as a whole: its tables, and the capture or the scan that they add up to."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import printable, with_step
from millisight.core.errors import InputError
from millisight.data import (
    CalibrationStep,
    Capture,
    Radar,
    RawCapture,
    RawScan,
    ScanRow,
    Trajectory,
    VoxelGrid,
)
from millisight.io.description import _calibration, _frames, _positions, _radar
from millisight.io.description._frames import FrameReader, Frames
from millisight.io.description._tables import Files, TomlTable

Progress = Callable[[int, int], None]


def _tables() -> dict[str, tuple[str, ...]]:
    """The tables of a description, and their keys."""
    return {
        "radar": _radar.KEYS,
        "frames": _frames.keys(),
        "positions": _positions.KEYS,
        "times": _positions.TIMES_KEYS,
        "calibration": _calibration.KEYS,
        "medium": _calibration.MEDIUM_KEYS,
        "image": ("lower", "upper", "spacing", "method", "window", "clutter"),
    }


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
        known = _tables()
        whole = TomlTable(content, "", source, files, ("title", "simulated", *known))
        self._source = source
        self._title, self._simulated = whole.text("title", source.stem), whole.flag("simulated")
        self._tables = {name: whole.table(name, keys, f"[{name}]") for name, keys in known.items() if name in whole}
        for name in ("radar", "frames"):
            if name not in self._tables:
                raise whole.error(f"[{name}]", f"a table of that name: {', '.join(known[name])}")
        self._config = _radar.read_config(self._tables["radar"])
        self._reader = FrameReader(self._tables["frames"], self._tables["radar"], self._config)
        self._image = self._read_image()

    @cached_property
    def log(self) -> Trajectory | None:
        """The robot's log that it names, by the robot's clock; None: it names none."""
        table = self._tables.get("positions")
        return None if table is None else _positions.read_log(table)

    def radar(self, shape: tuple[int, ...], placed: dict[str, np.ndarray] | None = None) -> Radar:
        """The radar of frames (F, T, R, N) of `shape`; `placed`: its antennas, where [positions] says them."""
        reader = self._reader
        radar = _radar.read_radar(
            self._tables["radar"], self._config, shape, self._title,
            receivers=reader.receivers, recorded=reader.recorded, frequencies=reader.frequencies, placed=placed,
        )  # fmt: skip
        frames, rising = self._tables["frames"], radar.waveform.frequency_step > 0
        if frames.flag("analytic") and reader.phase_sign != (sign := 1 if rising else -1):
            raise frames.error(
                "phase_sign",
                f"{sign}: the positive half of the spectrum of real samples is kept, and their frequency "
                f"{'rises' if rising else 'falls'}; with another sign the image is out of focus",
            )
        return radar

    def frames(self) -> np.ndarray:
        """(F, T, R, N) complex64 frames of all files, of the phase sign inside millisight, not calibrated."""
        return _joined([frames.values for frames in self._read(None)])

    def capture(self, progress: Progress | None) -> RawCapture:
        """The capture, where the positions follow from the order of the frames, and its calibration.

        Raises
        ------
        InputError
            There are no positions.
        """
        if "positions" not in self._tables:
            raise InputError(
                f"{printable(self._source)} has no table [positions]: its frames can be read, but not imaged; add "
                "raster, circle, points or log with the positions of the radar"
            )
        table = self._tables["positions"]
        read = list(self._read(progress))
        frames, kept = _joined([part.values for part in read]), ~np.concatenate([part.lost for part in read])
        times = self._times([len(part.values) for part in read])
        poses = _positions.read_poses(
            table,
            None if times is None else np.concatenate(times),
            read[0].scan if len(read) == 1 else {"pose": len(frames)},
            frames.shape[1:3],
        )
        # The radar's array is that of the first pose; where antennas are at the others, the capture says itself.
        points = {"tx_positions": poses.tx_points, "rx_positions": poses.rx_points}
        center = poses.trajectory.positions[0]
        radar = self.radar(frames.shape, {key: p[0] - center for key, p in points.items() if p is not None})
        if poses.path_offset:
            if "path_offset" in self._tables["radar"]:
                raise table.error("circle", 'range_from = "antenna", or no path_offset in [radar]: both set it')
            radar = replace(radar, path_offset=poses.path_offset)
        trajectory, placed = poses.trajectory, {"tx_points": poses.tx_points, "rx_points": poses.rx_points}
        if not kept.all():
            turned = None if trajectory.orientations is None else trajectory.orientations[kept]
            trajectory = Trajectory(
                times=trajectory.times[kept], positions=trajectory.positions[kept], orientations=turned
            )
            frames = frames[kept]
            placed = {name: None if points is None else points[kept] for name, points in placed.items()}
        metadata = self._metadata(read[0].settings, lost=int((~kept).sum()))
        capture = Capture(
            radar=radar, trajectory=trajectory, frames=frames, metadata=metadata,
            tx_points=placed["tx_points"], rx_points=placed["rx_points"],
        )  # fmt: skip
        return RawCapture(capture=capture, calibration=tuple(self._steps(radar, capture)))

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
                f"{printable(self._source)} names a robot log, but has no table [times] with the times of the frames"
            )
        rows = [
            ScanRow(times=t, read=partial(self._values, path), source=printable(path.name), missing=lost)
            for path, (_, lost, _), t in zip(self._reader.parts, looked, times, strict=True)
        ]
        shape, _, settings = looked[0]
        radar = self.radar(shape)
        steps = tuple(self._steps(radar, None))
        return RawScan(radar=radar, rows=tuple(rows), log=log, metadata=self._metadata(settings), calibration=steps)

    def _steps(self, radar: Radar, capture: Capture | None) -> Iterator[CalibrationStep]:
        """What is still to be done with the frames."""
        if "calibration" in self._tables:
            yield from _calibration.calibration_steps(self._tables["calibration"], self._reader, radar, capture)
        if self._tables["frames"].flag("one_way"):
            yield CalibrationStep(name="set_one_way", source=self._tables["frames"].place)
        if "medium" in self._tables:
            reach = None if capture is None else self._reach(capture)
            yield from _calibration.medium_steps(self._tables["medium"], reach)

    def _reach(self, capture: Capture) -> tuple[float, float] | None:
        """The longest way across and the shortest depth from an antenna to the image [m]; None: no image is stated."""
        grid: Any = self._image.get("image_grid")
        if grid is None:
            return None
        normal = "xyz".index(self._tables["medium"].text("towards", "-z")[-1:])
        antennas = np.concatenate([capture.tx_positions.reshape(-1, 3), capture.rx_positions.reshape(-1, 3)])
        corners = np.array([grid["lower"], grid["upper"]])
        apart = np.abs(np.stack([antennas.min(axis=0), antennas.max(axis=0)])[:, None] - corners)
        across = np.delete(apart.max(axis=(0, 1)), normal)
        return float(np.linalg.norm(across)), float(apart[:, :, normal].min())

    def _read(self, progress: Progress | None) -> Iterator[Frames]:
        """The frames of each file in turn."""
        first, paths = None, self._reader.parts
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
        return _positions.read_times(self._tables["times"], counts) if "times" in self._tables else None

    def _read_image(self) -> dict[str, Any]:
        """What [image] says, as metadata: the grid that is wanted, method, window and clutter."""
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
        # What there is of each is known to the imagers, who are asked when the image is formed.
        told["imaging"] = {key: table.text(key) for key in ("method", "window", "clutter") if key in table}
        return told

    def _metadata(self, settings: dict[str, Any], **counts: int) -> dict[str, Any]:
        metadata = {"source": self._title, "description": printable(self._source.name), **self._image}
        if self._simulated:
            metadata["simulated"] = True
        if "positions" in self._tables and "circle" in self._tables["positions"]:
            metadata["far_field"] = bool(self._tables["positions"].get("circle").get("far_field"))
        if self._reader.notes:
            metadata["notes"] = self._reader.notes
        files = [printable(path.name) for path in self._reader.paths]
        sign = self._reader.phase_sign
        return with_step(metadata, "read_capture", files=files, phase_sign=sign, **settings, **counts)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """The parts one after the other; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
