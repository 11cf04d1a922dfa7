"""Captures given on the command line: HDF5 files, descriptions, experiments in the published layout."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from millisight.cli.bands import check_band, check_named
from millisight.cli.console import progress
from millisight.core import SPEED_OF_LIGHT, check_readable, files_under, printable
from millisight.core.errors import FileError, FormatError, InputError, MillisightError, UnknownNameError
from millisight.data import Capture, RawScan, Trajectory

CAPTURE_SUFFIX = ".capture.h5"
# Read with a description: the user's own, or a shipped one that fits the arrays.
_DESCRIBED = (".toml", ".npz", ".npy", ".mat")
_LEAST_KEPT = 0.5  # of the frames; where fewer have a pose, times are rarely right
_LOG_GAP = 5  # times as long as usual between two poses of a log


@dataclass(frozen=True, slots=True)
class Opened:
    """A capture, the robot log its poses come from (None: no log), and notes on the files."""

    capture: Capture
    log: Trajectory | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Source:
    """One capture found at a path.

    Attributes
    ----------
    path : a file, or a folder of the published layout
    name : name of the outputs, without suffix
    radar : radar folder of an experiment, "77_ghz" or "24_ghz"; None: not an experiment
    folder : default folder of the outputs
    asked : of a file that was named alone, the radar that it must be of; None: any
    """

    path: Path
    name: str
    radar: str | None
    folder: Path
    asked: str | None = None

    def files(self, data: Path | None) -> list[Path]:
        """The files that are read for it, as far as they are there; `data` as of `opened`."""
        found = [self.path, *_read_with(self, data)]
        return sorted(path for path in found if path.is_file())

    @contextmanager
    def opened(self, data: Path | None, label: str = "read", *, as_published: bool = False) -> Iterator[Opened]:
        """Open the capture for a `with` block; the frames of an HDF5 capture stay on disk.

        Parameters
        ----------
        data : folder of the files named in a description; None: the folder of the description
        label : progress label while raw files are read
        as_published : of raw experiments, linear poses and both receivers at 24 GHz

        Raises
        ------
        FileError, InputError, UnknownNameError
            The file cannot be read: see the readers; or it is of another radar than the one asked for.
        """
        with self._read(data, label, as_published=as_published) as found:
            check_band(self.path, self.asked, found.capture.radar.waveform.center_frequency)
            yield found

    @contextmanager
    def _read(self, data: Path | None, label: str, *, as_published: bool) -> Iterator[Opened]:
        if self.radar is not None:
            from millisight.io.mito import read_experiment

            scan = read_experiment(self.path, self.radar, every_receiver=as_published)
            yield _placed(scan, label, poses="linear" if as_published else "cubic")
            return
        if self.path.suffix.lower() == ".pkl":
            from millisight.io.mito import read_published

            yield Opened(_expect_capture(read_published(self.path).record, self.path))
            return
        if self.path.suffix.lower() not in _DESCRIBED:
            from millisight.io import open_capture

            with open_capture(self.path) as capture:
                yield Opened(capture, _log_beside(self.path))
            return
        from millisight.io.description import read

        with progress(label, compiles=False) as report:
            content = read(self.path, data=data, progress=report)
        if isinstance(content, RawScan):
            yield _placed(content, label)
        else:
            capture = content.to_capture()
            yield Opened(capture, notes=_notes(capture))


def sources(paths: list[Path], radar: str | None = None) -> list[Source]:
    """All captures found at `paths`, in order; a folder of the published layout is searched.

    Parameters
    ----------
    radar : use only this radar of experiments, "77_ghz" or "24_ghz"

    Raises
    ------
    FileError
        A path does not exist, or holds nothing that can be imaged.
    InputError, UnknownNameError
        Two captures have the same name; there is no such radar, or a file is of another.
    """
    found: list[Source] = []
    for path in paths:
        found += _under(path, radar)
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two captures have the same name {name}; image them one by one with --output")
    return found


def _under(path: Path, radar: str | None) -> list[Source]:
    if not path.is_dir():
        path = check_readable(path)
        stem = path.name.removesuffix(".h5").removesuffix(".capture") if path.suffix == ".h5" else path.stem
        check_named(path, radar, (stem, path.resolve().parent.name))
        return [Source(path, stem, None, path.parent, radar)]
    from millisight.datasets import experiments_under
    from millisight.io.description import description_in
    from millisight.io.mito import RADARS

    described = description_in(path)
    if described is not None:
        check_named(described, radar, ())
        return [Source(described, path.resolve().name, None, path, radar)]
    experiments = experiments_under(path)
    found = [Source(raw.folder, raw.name, raw.radar, Path()) for raw in experiments if radar in (None, raw.radar)]
    found += _converted(path, radar)
    found += _simulated(path, radar)
    if not found:
        found = _captures_in(path, radar)
    if not found and radar not in (None, *RADARS):
        raise UnknownNameError("radar", radar, {*RADARS, *map(_radar_of, _capture_files(path))})
    if not found:
        wanted = "" if not experiments else f" of the {radar} radar"
        raise FileError(
            f"{path} holds no capture{wanted}: neither a description (*.toml) nor an experiment of the published "
            "layout with raw radar data; pass a file, or a folder that holds one of them"
        )
    return found


def _converted(folder: Path, radar: str | None) -> list[Source]:
    """Captures that `millisight dataset convert` wrote, at or below a folder."""
    from millisight.io.mito import RAW_CAPTURE

    found = []
    for path in (path for path in files_under(folder) if path.name == RAW_CAPTURE):
        parts = path.resolve().parts
        places = [part for part in parts[-9:-1] if part not in ("robot_collected", "unprocessed", "radars")]
        if radar in (None, places[-1]):
            found.append(Source(path, ".".join(places[-5:]), None, Path()))
    return found


def _captures_in(folder: Path, radar: str | None) -> list[Source]:
    """Captures in a folder or in those below it, as `millisight collect` writes with `layout = "captures"`."""
    found = []
    for path in _capture_files(folder):
        name = _radar_of(path)
        if radar in (None, name):
            within = "" if path.parent == folder else f"{path.parent.name}."
            found.append(Source(path, within + name, None, path.parent))
    return found


def _capture_files(folder: Path) -> list[Path]:
    return [*sorted(folder.glob(f"*{CAPTURE_SUFFIX}")), *sorted(folder.glob(f"*/*{CAPTURE_SUFFIX}"))]


def _radar_of(path: Path) -> str:
    """The radar that a capture in a folder is of: `millisight collect` names the file by it."""
    return path.name.removesuffix(CAPTURE_SUFFIX)


def _simulated(folder: Path, radar: str | None) -> list[Source]:
    """Raw simulations of the published layout, as published or converted, at or below a folder."""
    from millisight.io.mito import RADARS, RAW_SIMULATION, kind_of

    found = []
    files = files_under(folder)
    for path in (p for p in files if p.name.startswith("raw_sim_files") and p.suffix in (".pkl", ".h5")):
        kind, band = kind_of("simulated", path.name), path.resolve().parent.name
        if kind is not None and kind[0] == RAW_SIMULATION and band in RADARS and radar in (None, band):
            places = [part for part in path.resolve().parts[-7:-1] if part not in ("unprocessed", "radars")]
            found.append(Source(path, ".".join(places) + kind[1], None, Path()))
    return found


def _expect_capture(record: object, path: Path) -> Capture:
    if not isinstance(record, Capture):
        raise FormatError(f"{printable(path)} holds a {type(record).__name__}; expected a capture")
    return record


def _placed(scan: RawScan, label: str, *, poses: str = "cubic") -> Opened:
    """Place the frames of a scan at the poses of the robot log."""
    with progress(label, compiles=False) as report:
        capture = scan.to_capture(poses=poses, progress=report)
    placing = next(step for step in reversed(capture.metadata["history"]) if step["step"] == "place_frames")
    left_out = {
        "lost": placing["lost"],
        "outside the robot log": placing["outside_log"],
        "repeats": placing["repeats"],
    }
    reasons = ", ".join(f"{count} {why}" for why, count in left_out.items() if count)
    kept = f"kept {placing['kept']} of {placing['frames']} frames" + (f": {reasons}" if reasons else "")
    few = placing["kept"] < _LEAST_KEPT * placing["frames"]
    lost = ("warning: most frames were left out; check the unit and the zero of [times] and of the log",) if few else ()
    return Opened(capture, scan.log, (kept, *lost, *_log_gaps(scan.log, capture), *_notes(scan)))


def _log_gaps(log: Trajectory, capture: Capture) -> tuple[str, ...]:
    """A warning where poses of the log are missing while the arm moved: what lies between is only interpolated."""
    steps, ways = np.diff(log.times), np.linalg.norm(np.diff(log.positions, axis=0), axis=1)
    usual, quarter = float(np.median(steps)), SPEED_OF_LIGHT / capture.radar.waveform.start_frequency / 4
    wide = (steps > _LOG_GAP * usual) & (ways > quarter)
    times = capture.trajectory.times
    frames = wide[np.clip(np.searchsorted(log.times, times) - 1, 0, len(wide) - 1)]
    if not frames.any():
        return ()
    worst = int(np.argmax(np.where(wide, ways, 0)))
    return (
        f"warning: the robot log tells nothing for {1e3 * steps[worst]:.0f} ms, in which the arm moved "
        f"{1e3 * ways[worst]:.0f} mm; else a pose comes every {1e3 * usual:.3g} ms: the places of {int(frames.sum())} "
        "frames are guessed; check the connection to the robot, and scan again",
    )


def _notes(record: Capture | RawScan) -> tuple[str, ...]:
    """Warnings of the reader, from the metadata."""
    return tuple(f"warning: {note}" for name in ("left_out", "notes") for note in record.metadata.get(name, ()))


def files_read(path: Path, data: Path | None = None) -> list[Path]:
    """Files that are read along with `path`: those that a description, a world or a rig names, in the folder `data` or
    beside it; the robot log beside a capture; of a folder, all of that for what is imaged in it."""
    from millisight.io.description import files_named

    if path.is_dir():
        try:
            found = _under(path, None)
        except MillisightError:
            return []  # what cannot be read is not read
        return [file for source in found for file in (source.path, *_read_with(source, data))]
    if path.suffix.lower() == ".toml":
        return files_named(path, data)
    log = _log_path(path)
    return [] if log is None else [log]


def _read_with(source: Source, data: Path | None) -> list[Path]:
    """Files that are read along with a capture; of an experiment the raw ones, not images made of them, and what tells
    of its set-up."""
    if source.radar is None:
        return files_read(source.path, data)
    from millisight.io.mito import INFO_NAME

    raw, told = source.path / "unprocessed", source.path.parent / INFO_NAME
    return [*([told] if told.is_file() else []), *(files_under(raw) if raw.is_dir() else [])]


def _log_beside(path: Path) -> Trajectory | None:
    """Robot log beside a converted or a recorded capture."""
    from millisight.io import load

    log = _log_path(path)
    return None if log is None else load(log)


def _log_path(path: Path) -> Path | None:
    from millisight.io.mito import RAW_CAPTURE, RAW_LOG

    name = RAW_LOG if path.name == RAW_CAPTURE else f"{path.name.removesuffix(CAPTURE_SUFFIX)}.log.h5"
    log = path.with_name(name)
    return log if path.name.endswith((RAW_CAPTURE, CAPTURE_SUFFIX)) and log.is_file() else None
