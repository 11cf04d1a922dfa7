"""The published layout's names: which folder is which object and experiment, and which file is what.

    <id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/experiment_info.json
    <id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/{los,nlos}/{unprocessed,processed}/{radars/{77_ghz,24_ghz},camera}
    <id>_<name>/simulation/<ax>_<ay>_<az>/{unprocessed,processed}/radars/{77_ghz,24_ghz}

A converted dataset has the same folders; its files end in `.h5`, and a folder of raw radar files became two of them.
"""

import os
import re
from pathlib import Path
from typing import NamedTuple

from millisight.core import check_known, checked_path, printable
from millisight.core.errors import FileError, InputError

RADARS = ("77_ghz", "24_ghz")
SIGHTS = ("los", "nlos")
INFO_NAME = "experiment_info.json"
RAW_CAPTURE, RAW_LOG = "capture.h5", "robot_log.h5"
"""What a converted folder of raw radar files holds."""

TRUTH, SPLITS_NAME = "truth", "splits.json"
"""What a generated dataset has beside its objects: what only a virtual rig can know, and who trains and who tests."""

EMPTY_SCENES = {"EMPTY": "empty", "background": "background"}
"""Names of what is no object, and what it is for: images, and raw files, of a set-up with nothing in it."""

IMAGE, RADAR_MASK, CAMERA_FRAME, CAMERA_PICTURE, CAMERA_MASK, RAW, RAW_SIMULATION, LOG, INFO = (
    "image", "radar mask", "camera frame", "camera picture", "camera mask", "raw", "raw simulation", "robot log",
    "info",
)  # fmt: skip
"""The kinds of item that the layout holds."""

_OBJECT = re.compile(r"(?P<id>[^_]+)_(?P<name>.+)")
_ANGLES = re.compile(r"(-?\d{1,6})_(-?\d{1,6})_(-?\d{1,6})")
_EXPERIMENT = re.compile(r"exp(\d{1,9})")
_FILES = {
    "radars": ((IMAGE, "processed_image"), (RADAR_MASK, "radar_masks")),
    "camera": ((CAMERA_MASK, "camera_masks"), (CAMERA_FRAME, "continuous")),
    "simulated": ((RAW_SIMULATION, "raw_sim_files"),),
}
_PICTURES = ((CAMERA_PICTURE, "continuous"),)  # PNG
_SPLIT = re.compile(r"test_split_\w+\.pkl")


def object_of(folder: str) -> tuple[str, str] | None:
    """(id, name) of an object's folder `<id>_<name>`; None where it is named otherwise."""
    match = _OBJECT.fullmatch(folder)
    return (match["id"], match["name"]) if match else None


def angles_of(folder: str) -> tuple[int, int, int] | None:
    """The angles [degrees] of a folder `<ax>_<ay>_<az>`; None where it is named otherwise."""
    match = _ANGLES.fullmatch(folder)
    return (int(match[1]), int(match[2]), int(match[3])) if match else None


def experiment_of(folder: str) -> int | None:
    """N of a folder `exp<N>`; None where it is named otherwise."""
    match = _EXPERIMENT.fullmatch(folder)
    return int(match[1]) if match else None


def kind_of(section: str, name: str) -> tuple[str, str] | None:
    """The kind of a file `name` and its ext; None: none of ours.

    Parameters
    ----------
    section : "radars" or "camera", of processed images and of pictures; "simulated", of raw simulations

    Examples
    --------
    >>> kind_of("radars", "processed_image_specular.pkl")
    ('image', '_specular')
    """
    stem, suffix = os.path.splitext(name)
    known = (
        _FILES[section] if suffix in (".pkl", ".h5") else _PICTURES if (section, suffix) == ("camera", ".png") else ()
    )
    for kind, start in known:
        if stem.startswith(start):
            return kind, stem[len(start) :]
    return None


def is_split(name: str) -> bool:
    """Whether a file of a dataset's root is a published split, by its name."""
    return _SPLIT.fullmatch(name) is not None


def angles_folder(root: str | os.PathLike[str], name: str, angles: tuple[int, int, int], *, simulated: bool) -> Path:
    """Where the simulations, or the experiments, of object `<id>_<name>` turned by `angles` [degrees] lie.

    Raises
    ------
    InputError
        The object's name or the angles are none.
    """
    folder = "_".join(map(str, angles))
    if object_of(name) is None or angles_of(folder) is None or os.path.basename(name) != name:
        raise InputError(f"object {name!r} at angles {angles!r}; expected <id>_<name> and three whole numbers")
    return checked_path(root) / name / ("simulation" if simulated else "robot_collected") / folder


def experiment_folder(
    root: str | os.PathLike[str], name: str, angles: tuple[int, int, int], number: int, sight: str
) -> Path:
    """Where experiment `number` of object `<id>_<name>` lies, in line of sight ("los") or not ("nlos").

    Examples
    --------
    >>> experiment_folder("data", "004_sugar_box", (0, 0, 90), 2, "nlos").as_posix()
    'data/004_sugar_box/robot_collected/0_0_90/exp2/nlos'

    Raises
    ------
    InputError, UnknownNameError
        A name is none.
    """
    check_known("kind of sight", sight, SIGHTS)
    if experiment_of(f"exp{number}") is None:
        raise InputError(f"experiment is {number!r}; expected a whole number")
    return angles_folder(root, name, angles, simulated=False) / f"exp{number}" / sight


def radar_folder(folder: str | os.PathLike[str], radar: str, *, processed: bool) -> Path:
    """Where the files of one radar lie within an experiment or a simulation.

    Raises
    ------
    UnknownNameError
    """
    return checked_path(folder) / ("processed" if processed else "unprocessed") / "radars" / checked_radar(radar)


def checked_radar(radar: str) -> str:
    """`radar`, which must be "77_ghz" or "24_ghz"; `UnknownNameError` otherwise."""
    check_known("radar of the published layout", radar, RADARS)
    return radar


class Place(NamedTuple):
    """Where in the layout an experiment is."""

    object_id: str
    object_name: str
    angles: tuple[int, int, int]
    number: int
    sight: str

    def __str__(self) -> str:
        angles = "_".join(map(str, self.angles))
        return f"{self.object_id}_{self.object_name}/robot_collected/{angles}/exp{self.number}/{self.sight}"


def place_of(folder: str | os.PathLike[str]) -> Place:
    """The place of an experiment's folder `<id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/{los,nlos}`.

    Raises
    ------
    FileError
        The folder is named otherwise.
    """
    parts = Path(os.path.abspath(checked_path(folder))).parts[-5:]
    if len(parts) == 5 and parts[1] == "robot_collected" and parts[4] in SIGHTS:
        named, angles, number = object_of(parts[0]), angles_of(parts[2]), experiment_of(parts[3])
        if named and angles and number is not None:
            return Place(*named, angles, number, parts[4])
    raise FileError(
        f"{printable(folder)} is not an experiment of the published layout; expected a folder "
        "<id>_<name>/robot_collected/<ax>_<ay>_<az>/exp<N>/los or nlos"
    )


def is_experiment(folder: str | os.PathLike[str]) -> bool:
    """Whether a folder is that of an experiment, by its name and the names above it."""
    try:
        place_of(folder)
    except FileError:
        return False
    return os.path.isdir(folder)


def origin(path: str | os.PathLike[str]) -> str:
    """The path of a file from its object's folder on, as provenance tells it: the same on every machine."""
    parts = Path(os.path.abspath(path)).parts
    starts = [i for i, part in enumerate(parts) if part in ("robot_collected", "simulation") and i]
    return printable("/".join(parts[starts[-1] - 1 :] if starts else parts[-1:]))
