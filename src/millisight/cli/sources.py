"""What the paths on a command line lead to: captures of ours, descriptions, experiments of the published layout."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from millisight.capture.capture import Capture
from millisight.capture.scan import RawScan
from millisight.capture.trajectory import Trajectory
from millisight.cli.console import progress
from millisight.errors import FileError, InputError
from millisight.files import check_readable

# What is read by a description: one of the user's, or one shipped that knows the arrays.
_DESCRIBED = (".toml", ".npz", ".npy", ".mat")


@dataclass(frozen=True, slots=True)
class Opened:
    """A capture, the robot's log where its poses come from one, and what is odd about the files."""

    capture: Capture
    log: Trajectory | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Source:
    """One capture that a path leads to.

    Attributes
    ----------
    path : a file, or a folder of the published layout
    name : of its outputs, without suffix
    radar : folder name of an experiment's radar, "77_ghz" or "24_ghz"; None: not an experiment
    folder : where its outputs go by default
    """

    path: Path
    name: str
    radar: str | None
    folder: Path

    @contextmanager
    def opened(self, data: Path | None, label: str = "read") -> Iterator[Opened]:
        """The capture, while the `with` block runs; one of ours stays on disk.

        Parameters
        ----------
        data : where the files lie that a description names; None: beside it
        label : of the progress shown while raw files are read

        Raises
        ------
        FileError, InputError, UnknownNameError
            As the readers do.
        """
        if self.radar is not None:
            from millisight.io.mito_layout import read_experiment

            yield _placed(read_experiment(self.path, self.radar), label)
            return
        if self.path.suffix.lower() not in _DESCRIBED:
            from millisight.io.hdf5 import open_capture

            with open_capture(self.path) as capture:
                yield Opened(capture, _log_beside(self.path))
            return
        from millisight.io.description import read

        with progress(label, compiles=False) as report:
            content = read(self.path, data=data, progress=report)
        yield _placed(content, label) if isinstance(content, RawScan) else Opened(content, notes=_notes(content))


def sources(paths: list[Path], radar: str | None = None) -> list[Source]:
    """Every capture that `paths` lead to, in order; a folder of the published layout leads to all under it.

    Parameters
    ----------
    radar : of experiments only this one, "77_ghz" or "24_ghz"

    Raises
    ------
    FileError
        A path does not exist, or leads to nothing that can be imaged.
    """
    found: list[Source] = []
    for path in paths:
        found += _under(path, radar)
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two captures would both be called {name}; image them one by one, with --output")
    return found


def _under(path: Path, radar: str | None) -> list[Source]:
    if not path.is_dir():
        path = check_readable(path)
        stem = path.name.removesuffix(".h5").removesuffix(".capture") if path.suffix == ".h5" else path.stem
        return [Source(path, stem, None, path.parent)]
    from millisight.datasets.mito import experiments_under
    from millisight.io.description import description_in

    described = description_in(path)
    if described is not None:
        return [Source(described, path.resolve().name, None, path)]
    experiments = experiments_under(path)
    found = [Source(raw.folder, raw.name, raw.radar, Path()) for raw in experiments if radar in (None, raw.radar)]
    found += _converted(path, radar)
    if not found:
        wanted = "" if not experiments else f" of the {radar} radar"
        raise FileError(
            f"{path} holds no capture{wanted}: no description (*.toml), and no experiment of the published layout "
            "with raw radar data; pass a file, or a folder with one of these"
        )
    return found


def _converted(folder: Path, radar: str | None) -> list[Source]:
    """The captures that `millisight dataset convert` made of raw experiments, at or under a folder."""
    from millisight.io.mito_names import RAW_CAPTURE

    found = []
    for path in sorted(folder.rglob(RAW_CAPTURE)):
        parts = path.resolve().parts
        places = [part for part in parts[-9:-1] if part not in ("robot_collected", "unprocessed", "radars")]
        if radar in (None, places[-1]):
            found.append(Source(path, ".".join(places[-5:]), None, Path()))
    return found


def _placed(scan: RawScan, label: str) -> Opened:
    """The scan's frames at the poses of the robot's log."""
    with progress(label, compiles=False) as report:
        capture = scan.to_capture(progress=report)
    placing = next(step for step in reversed(capture.metadata["history"]) if step["step"] == "place_frames")
    left_out = {
        "lost": placing["lost"],
        "outside the robot's log": placing["outside_log"],
        "repeats": placing["repeats"],
    }
    told = ", ".join(f"{count} {why}" for why, count in left_out.items() if count)
    kept = f"kept {placing['kept']} of {placing['frames']} frames" + (f": {told}" if told else "")
    return Opened(capture, scan.log, (kept, *_notes(scan)))


def _notes(record: Capture | RawScan) -> tuple[str, ...]:
    """What the reader found odd, as it stands in the metadata."""
    return tuple(f"warning: {note}" for name in ("left_out", "notes") for note in record.metadata.get(name, ()))


def _log_beside(path: Path) -> Trajectory | None:
    """The robot's log of a converted capture."""
    from millisight.io.hdf5 import load
    from millisight.io.mito_names import RAW_CAPTURE, RAW_LOG

    log = path.with_name(RAW_LOG)
    return load(log) if path.name == RAW_CAPTURE and log.is_file() else None
