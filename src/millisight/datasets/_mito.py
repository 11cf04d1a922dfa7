"""The published dataset on disk: what there is and what is missing, told by names alone; no file is opened.

A converted dataset has the same folders, with `.h5` files in them, and is found in the same way.
"""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from millisight.core import checked_path, printable
from millisight.core.errors import FileError
from millisight.datasets._dataset import CANNOT_LIST, Dataset, Experiment, Item, ObjectFolder, Simulation
from millisight.datasets._published import published_experiment
from millisight.io import mito

SIMULATED_EXTS = ("_specular", "_edges")
"""The simulated images that are published of every object."""
_MESHES = (".stl", ".obj", ".ply")
_TEXTURES = (".mtl", ".png", ".jpg")
_PROMPTS = ".prompts.json"  # points that `millisight annotate` writes beside a mask
_BESIDE = (mito.SPLITS_NAME, mito.TRUTH)

logger = logging.getLogger(__name__)


def open(root: str | os.PathLike[str]) -> Dataset:
    """Open a dataset in the published layout, by file names, without reading files.

    Folders in it that cannot be listed are logged as warnings, and named in `unreadable`.

    Raises
    ------
    FileError
        There is no such folder, it may not be read, or no object is in it.
    """
    root = checked_path(root)
    objects, stray = [], []
    entries = _listed(root)
    generated = any(entry.name in _BESIDE for entry in entries)
    for entry in entries:
        if entry.is_dir() and mito.object_of(entry.name):
            objects.append(_Walk(Path(entry.path), generated=generated).object())
        elif not _belongs_beside(entry.name):
            stray.append(entry.name)
    # A folder of the layout has at least one of these; any other folder may be named with an underscore too.
    known = [one for one in objects if one.parts or one.unreadable]
    stray += [one.folder.name for one in objects if one not in known]
    dataset = Dataset(root=root, objects=tuple(known), stray=tuple(sorted(stray)))
    for path in dataset.unreadable:
        logger.warning("%s: %s", printable(root / path), CANNOT_LIST)
    if not len(dataset):
        raise FileError(
            f"{printable(root)} holds no object of the published layout; expected folders such as "
            "004_sugar_box/robot_collected/0_0_0/exp1/los" + (" that may be read" if dataset.unreadable else "")
        )
    return dataset


def _belongs_beside(name: str) -> bool:
    """Whether a file or folder belongs into a dataset's root, beside its objects."""
    return name in _BESIDE or mito.is_split(name) or name.startswith(".") or name.endswith((".md", ".jsonl"))


def find_object(folder: str | os.PathLike[str]) -> ObjectFolder:
    """The object that `folder`, its own or one within it, belongs to; found as by `open`.

    Raises
    ------
    FileError
        It belongs to none.
    """
    given = Path(os.path.abspath(checked_path(folder)))
    for above in (given, *given.parents):
        if mito.object_of(above.name) and any((above / name).is_dir() for name in ("robot_collected", "simulation")):
            return _Walk(above).object()
    raise FileError(
        f"{printable(folder)} is not an object or experiment of the published layout; expected a folder <id>_<name>, "
        "or one in it such as robot_collected/0_0_0/exp1/los"
    )


class RawExperiment(NamedTuple):
    """Raw files of one radar: the experiment's folder, a name for what is made of them, the radar."""

    folder: Path
    name: str
    radar: str


def experiments_under(folder: str | os.PathLike[str]) -> list[RawExperiment]:
    """The raw files at or under `folder`, an experiment and a radar at a time; it may be any folder of the layout.

    Raises
    ------
    FileError
        There is no such folder, or it may not be read.
    """
    folder = Path(os.path.abspath(checked_path(folder)))
    levels = [level for level in range(len(_LEVELS)) if _LEVELS[level](folder.name)]
    # The last: 0_0_0 could be an object, too.
    return list(_raw_folders(folder, levels[-1] if levels else -1))


# The names of the layout's folders, from an object's down to a radar's.
_LEVELS: tuple[Callable[[str], object], ...] = (
    mito.object_of,
    "robot_collected".__eq__,
    mito.angles_of,
    lambda name: mito.experiment_of(name) is not None,
    mito.SIGHTS.__contains__,
    "unprocessed".__eq__,
    "radars".__eq__,
    mito.RADARS.__contains__,
)


def _raw_folders(folder: Path, level: int) -> Iterator[RawExperiment]:
    """Those at or under a folder of this level; -1: above the objects."""
    entries = _listed(folder)
    if level == len(_LEVELS) - 1:
        if any(entry.name == "radar_data" for entry in entries):
            experiment = folder.parents[2]
            yield RawExperiment(experiment, f"{_short_name(experiment)}.{folder.name}", folder.name)
        return
    for entry in entries:
        # A dataset's own folder may be named like an object's.
        for below in (level + 1, 0) if level == 0 else (level + 1,):
            if _LEVELS[below](entry.name) and entry.is_dir():
                yield from _raw_folders(Path(entry.path), below)


def _short_name(experiment: Path) -> str:
    try:
        return str(mito.place_of(experiment)).replace("/robot_collected", "").replace("/", ".")
    except FileError:
        return experiment.name


class _Walk:
    """One object's folder, looked through by names.

    What is in no known place gathers in `stray`, folders that cannot be listed in `unreadable`.
    """

    def __init__(self, folder: Path, *, generated: bool = False):
        self.folder = folder
        self._generated = generated
        self.stray: list[Path] = []
        self.unreadable: list[Path] = []

    def object(self) -> ObjectFolder:
        identity = mito.object_of(self.folder.name)
        number, name = identity or ("", self.folder.name)
        role = mito.EMPTY_SCENES.get(name, "object")
        experiments: list[Experiment] = []
        simulations: list[Simulation] = []
        meshes = []
        for entry in self._entries(self.folder):
            if entry.name == "robot_collected" and entry.is_dir():
                for folder, angles in self._turned(entry):
                    experiments += self._experiments(folder, angles, role)
            elif entry.name == "simulation" and entry.is_dir():
                simulations += [self._simulation(folder, angles) for folder, angles in self._turned(entry)]
            elif entry.name.endswith(_MESHES):
                meshes.append(entry.name)
            elif not entry.name.endswith(_TEXTURES):
                self.stray.append(Path(entry.path))
        return ObjectFolder(
            id=number,
            name=name,
            role=role,
            folder=self.folder,
            experiments=tuple(sorted(experiments, key=lambda e: (e.angles, e.number, e.sight))),
            simulations=tuple(sorted(simulations, key=lambda s: s.angles)),
            meshes=tuple(meshes),
            stray=tuple(path.relative_to(self.folder).as_posix() for path in self.stray),
            unreadable=tuple(path.relative_to(self.folder).as_posix() for path in self.unreadable),
        )

    def _turned(self, above: os.DirEntry) -> Iterator[tuple[Path, tuple[int, int, int]]]:
        for entry in self._entries(above):
            angles = mito.angles_of(entry.name)
            if angles is not None and entry.is_dir():
                yield Path(entry.path), angles
            else:
                self.stray.append(Path(entry.path))

    def _experiments(self, above: Path, angles: tuple[int, int, int], role: str) -> Iterator[Experiment]:
        for entry in self._entries(above):
            number = mito.experiment_of(entry.name)
            if number is None or not entry.is_dir():
                self.stray.append(Path(entry.path))
                continue
            info: list[Item] = []
            sights = []
            for below in self._entries(entry):
                if below.name in mito.SIGHTS and below.is_dir():
                    sights.append(below)
                elif below.name == mito.INFO_NAME:
                    info = [Item(path=Path(below.path), kind=mito.INFO)]
                else:
                    self.stray.append(Path(below.path))
            for sight in sights:
                items = (*info, *self._items(sight))
                published = None if self._generated else published_experiment(self.folder.name, number)
                yield Experiment(
                    object=self.folder.name,
                    angles=angles,
                    number=number,
                    sight=sight.name,
                    folder=Path(sight.path),
                    items=items,
                    missing=_missing(items, _expected(role, sight.name)),
                    left_out=published is not None and sight.name not in published.available,
                )

    def _simulation(self, folder: Path, angles: tuple[int, int, int]) -> Simulation:
        items = tuple(self._items(folder))
        expected = [(mito.IMAGE, radar, ext) for radar in mito.RADARS for ext in SIMULATED_EXTS]
        return Simulation(
            object=self.folder.name, angles=angles, folder=folder, items=items, missing=_missing(items, expected)
        )

    def _items(self, folder: Path | os.DirEntry) -> Iterator[Item]:
        """What the folders processed and unprocessed hold."""
        for state in self._entries(folder):
            if state.name not in ("processed", "unprocessed") or not state.is_dir():
                self.stray.append(Path(state.path))
                continue
            for section in self._entries(state):
                if section.name == "camera" and section.is_dir():
                    yield from self._files(section, "camera", "")
                elif section.name == "radars" and section.is_dir():
                    yield from self._radars(section, raw=state.name == "unprocessed")
                else:
                    self.stray.append(Path(section.path))

    def _radars(self, above: os.DirEntry, *, raw: bool) -> Iterator[Item]:
        for radar in self._entries(above):
            if radar.name not in mito.RADARS or not radar.is_dir():
                self.stray.append(Path(radar.path))
            elif raw:
                yield from self._raw(radar)
            else:
                yield from self._files(radar, "radars", radar.name)

    def _files(self, above: os.DirEntry, section: str, radar: str) -> Iterator[Item]:
        for entry in self._entries(above):
            kind = mito.kind_of(section, entry.name)
            if kind is None and entry.name.endswith(_PROMPTS):
                continue
            if kind is None:
                self.stray.append(Path(entry.path))
            else:
                yield Item(path=Path(entry.path), kind=kind[0], radar=radar, ext=kind[1])

    def _raw(self, radar: os.DirEntry) -> Iterator[Item]:
        """One item for the whole folder where it holds what can be read, published or converted; and simulations."""
        entries = self._entries(radar)
        names = {entry.name for entry in entries}
        logged = any(name.startswith("antenna") and name.endswith(".npz") for name in names)
        simulations = {entry: mito.kind_of("simulated", entry.name) for entry in entries}
        if mito.RAW_CAPTURE in names:
            yield Item(path=Path(radar.path, mito.RAW_CAPTURE), kind=mito.RAW, radar=radar.name)
        elif "radar_data" in names:
            yield Item(path=Path(radar.path), kind=mito.RAW, radar=radar.name)
        elif mito.RAW_LOG in names or logged:
            log = Path(radar.path, mito.RAW_LOG) if mito.RAW_LOG in names else Path(radar.path)
            yield Item(path=log, kind=mito.LOG, radar=radar.name)
        elif not any(simulations.values()):
            self.stray.append(Path(radar.path))
        for entry, kind in simulations.items():
            if kind is not None:
                yield Item(path=Path(entry.path), kind=kind[0], radar=radar.name, ext=kind[1])

    def _entries(self, folder: Path | os.DirEntry) -> list[os.DirEntry]:
        try:
            return _listed(folder)
        except FileError:
            self.unreadable.append(Path(folder))
            return []


_Expected = tuple[str, str, str | None]


def _expected(role: str, sight: str) -> list[_Expected]:
    """(kind, radar, ext) of what is published of an experiment; an ext of None is any."""
    if role == "empty":
        return [(mito.INFO, "", ""), (mito.IMAGE, "24_ghz", "")]
    if role == "background":
        return [(mito.INFO, "", ""), (mito.RAW, "24_ghz", "")]
    radars = [(kind, radar, "") for kind in (mito.IMAGE, mito.RAW) for radar in mito.RADARS]
    camera = [(mito.CAMERA_FRAME, "", None), (mito.CAMERA_MASK, "", None)] if sight == "los" else []
    return [(mito.INFO, "", ""), *radars, *camera]


def _missing(items: tuple[Item, ...], expected: Sequence[_Expected]) -> tuple[str, ...]:
    there = {(item.kind, item.radar, ext) for item in items for ext in (item.ext, None)}
    lacks = [one for one in expected if one not in there]
    return tuple(
        mito.INFO_NAME if kind == mito.INFO else " ".join(filter(None, (radar, kind, ext)))
        for kind, radar, ext in lacks
    )


def _listed(folder: Path | os.DirEntry) -> list[os.DirEntry]:
    """The entries of a folder, by name."""
    try:
        with os.scandir(folder) as entries:
            return sorted(entries, key=lambda entry: entry.name)
    except OSError as error:
        raise FileError(f"cannot list {printable(os.fspath(folder))}: {error.strerror}; expected a folder") from error
