"""The one table of the published dataset: its objects, experiments and splits, by name of folder (`published.toml`).

The files themselves hold none of this. It concerns measured data of the authors alone: what `experiment_info.json`
calls simulated is left as it is, whatever its folder is named.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from millisight.core import check_known, put, read_toml, record, record_from_table
from millisight.core.errors import DamagedFileError
from millisight.io import mito
from millisight.io.arrays import read_pickle
from millisight.meshes import CATALOGUE, object_name

SIMULATED = "simulated"
_TABLE = Path(__file__).with_name("published.toml")
_SIDES = {"train": "training", "validation": "validation", "test": "test"}


@record
class PublishedExperiment:
    """One experiment with one object, as the authors use it.

    Attributes
    ----------
    available : of "simulated", "los" and "nlos" those that they use; the others they leave out
    crop : number of the lowest and of the highest slices that 77 GHz images lose
    calibration : id of the `<id>_background` whose first frame is subtracted from 24 GHz frames
    empty : by "los" and "nlos" the id of the `<id>_EMPTY` whose 24 GHz image is subtracted
    """

    available: tuple[str, ...]
    crop: tuple[int, int] = (0, 0)
    calibration: str = ""
    empty: Mapping[str, str] = field(default_factory=dict[str, str])


@record
class PublishedObject:
    """One object of the published dataset.

    Attributes
    ----------
    folder : `<id>_<name>`
    shape_class : of the authors' newer split: "can", "handle", "box", "sphere", "cup", "clamp"; "" of no class
    material : such as "metal"; "" where it is not stated
    size : largest extent [m]; None where it is not stated
    angles : how the mesh was turned to lie as the measured object, about x, y and z [degrees]; None: not stated
    large_aperture : whether it was simulated with the larger aperture
    experiments : by number, 1 and 2
    catalogue : name in millisight's catalogue; "" where it is not in it
    """

    folder: str
    shape_class: str = field(default="", metadata={"key": "class"})
    material: str = ""
    size: float | None = None
    angles: tuple[float, float, float] | None = None
    large_aperture: bool = False
    catalogue: str = ""
    exp1: PublishedExperiment | None = None
    exp2: PublishedExperiment | None = None

    @property
    def experiments(self) -> dict[int, PublishedExperiment]:
        """By number."""
        return {number: one for number, one in ((1, self.exp1), (2, self.exp2)) if one is not None}

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the authors do not use: "exp2" where it is both sights, else "exp2 nlos"."""
        told = []
        for number, one in self.experiments.items():
            lacks = [sight for sight in mito.SIGHTS if sight not in one.available]
            told += [f"exp{number}"] if len(lacks) == len(mito.SIGHTS) else [f"exp{number} {one}" for one in lacks]
        return tuple(told)


class SplitImage(NamedTuple):
    """An image of a split; of a simulated one `sight` is "los" and `experiment` 1."""

    folder: str
    simulated: bool
    sight: str
    experiment: int


@record
class PublishedSplit:
    """Which images train, validate and test a classifier.

    Attributes
    ----------
    name : of the file, without `test_split_`
    classes : of the objects, by folder; "" of no class
    training, validation, test : SplitImage
    """

    name: str
    classes: Mapping[str, str]
    training: tuple[SplitImage, ...]
    validation: tuple[SplitImage, ...]
    test: tuple[SplitImage, ...]

    def __post_init__(self) -> None:
        put(self, classes=MappingProxyType(dict(self.classes)))


def read_split(path: str | os.PathLike[str]) -> PublishedSplit:
    """Read a published split, `test_split_<name>.pkl`. Nothing in it is run.

    Raises
    ------
    FileError, FormatError
    DamagedFileError
        It holds something else than lists of (id, name, simulated, los) or (id, name, simulated, los, experiment).
    """
    held = read_pickle(path)
    name = Path(path).stem.removeprefix("test_split_")
    try:
        classes = {f"{number}_{title}": str(shape) for (number, title), shape in held["classes"].items()}
        sides = {side: tuple(_split_image(*one) for one in held[key]) for key, side in _SIDES.items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DamagedFileError(
            f"{path} holds no split ({error!r}); expected train, validation and test, lists of (id, name, simulated, "
            "los[, experiment]), and classes by (id, name)"
        ) from error
    return PublishedSplit(name=name, classes=classes, **sides)


def _split_image(number: Any, name: Any, simulated: Any, los: Any, experiment: Any = None) -> SplitImage:
    measured = int(experiment) if experiment not in (None, "None") and not simulated else 1
    return SplitImage(f"{number}_{name}", bool(simulated), "los" if los else "nlos", measured)


def _objects(table: Mapping[str, Any]) -> dict[str, PublishedObject]:
    made = {}
    for folder, row in table.items():
        name = object_name(folder)
        catalogue = name if name in CATALOGUE else ""
        made[folder] = record_from_table(
            PublishedObject, {"catalogue": catalogue, **row}, _TABLE.name, folder, folder=folder
        )
    return made


def _splits(table: Mapping[str, Any], objects: Iterable[PublishedObject]) -> dict[str, PublishedSplit]:
    every = {one.folder: one.shape_class for one in objects}
    made = {}
    for name, row in table.items():
        sides = {side: tuple(map(_listed_image, row[key])) for key, side in _SIDES.items()}
        named = {one.folder for one in sides["training"]}
        classes = {folder: shape for folder, shape in every.items() if folder in named} | row.get("classes", {})
        made[name] = PublishedSplit(name=name, classes=classes, **sides)
    return made


def _listed_image(text: str) -> SplitImage:
    folder, *rest = text.split()
    if rest == [SIMULATED]:
        return SplitImage(folder, True, "los", 1)
    return SplitImage(folder, False, rest[1], int(rest[0].removeprefix("exp")))


_HELD = read_toml(_TABLE, "the table of the published dataset")

PUBLISHED_OBJECTS: Mapping[str, PublishedObject] = MappingProxyType(_objects(_HELD["objects"]))
"""Objects of the published dataset, by name of folder."""
PUBLISHED_SPLITS: Mapping[str, PublishedSplit] = MappingProxyType(_splits(_HELD["splits"], PUBLISHED_OBJECTS.values()))
"""Both published splits, by name, the newest last."""


def published_experiment(folder: str, number: int) -> PublishedExperiment | None:
    """What the table says of experiment `number` with the object `<id>_<name>`; None: nothing."""
    one = PUBLISHED_OBJECTS.get(folder)
    return None if one is None else one.experiments.get(number)


def empty_scenes_of(folder: str) -> set[str]:
    """Folders of the empty scenes, images and raw files, that belong to an object of the published dataset."""
    experiments = PUBLISHED_OBJECTS[folder].experiments.values() if folder in PUBLISHED_OBJECTS else ()
    images = {f"{number}_EMPTY" for one in experiments for number in one.empty.values()}
    return images | {f"{one.calibration}_background" for one in experiments if one.calibration}


def published_split(name: str = "") -> PublishedSplit:
    """A published split by name; by default the newest, of which the paper's table of classifiers is.

    Raises
    ------
    UnknownNameError
    """
    name = name or list(PUBLISHED_SPLITS)[-1]
    check_known("published split", name, PUBLISHED_SPLITS)
    return PUBLISHED_SPLITS[name]
