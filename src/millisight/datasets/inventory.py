"""What a dataset in the published layout holds, and what it lacks: records that `datasets.mito.find` fills."""

import os
from pathlib import Path

from millisight.errors import UnknownNameError
from millisight.io.mito_names import SIGHTS
from millisight.records import record


@record
class Item:
    """One thing of the dataset: a file, or the folder of one radar's raw files.

    Attributes
    ----------
    path : of the file, or the folder
    kind : "image", "radar mask", "camera mask", "camera frame", "raw" or "info"
    radar : "77_ghz" or "24_ghz"; "" where none is concerned
    ext : what follows the file's usual name, such as "_specular"
    """

    path: Path
    kind: str
    radar: str = ""
    ext: str = ""

    @property
    def converted(self) -> bool:
        """Whether it is in our own format."""
        return self.path.suffix == ".h5"


@record
class Experiment:
    """What was measured of an object turned one way, in line of sight or not.

    Attributes
    ----------
    object : `<id>_<name>`
    angles : the object's, about x, y and z [degrees]
    number : N of `exp<N>`
    sight : "los" or "nlos"
    folder : of the experiment
    items : what there is
    missing : what is not there, one text an item
    """

    object: str
    angles: tuple[int, int, int]
    number: int
    sight: str
    folder: Path
    items: tuple[Item, ...]
    missing: tuple[str, ...]


@record
class Simulation:
    """Simulated images of an object turned one way; attributes as of Experiment."""

    object: str
    angles: tuple[int, int, int]
    folder: Path
    items: tuple[Item, ...]
    missing: tuple[str, ...]


@record
class ObjectFolder:
    """An object of the dataset, or a scene without one.

    Attributes
    ----------
    id, name : of the folder `<id>_<name>`
    role : "object"; "empty", an image of the empty scene; "background", a raw capture of it
    folder : Path
    experiments, simulations : by angles, number and sight
    meshes : names of mesh files
    stray : paths within the folder that the layout has no place for
    """

    id: str
    name: str
    role: str
    folder: Path
    experiments: tuple[Experiment, ...]
    simulations: tuple[Simulation, ...]
    meshes: tuple[str, ...]
    stray: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """What is not there of the whole object; what its experiments lack they say themselves."""
        lacks = [] if self.experiments else ["experiments"]
        if self.role == "object":
            lacks += [] if self.simulations else ["simulations"]
            made = {(one.angles, one.number, one.sight) for one in self.experiments}
            lacks += [
                f"{sight} of exp{number} at {'_'.join(map(str, angles))}"
                for angles, number in sorted({key[:2] for key in made})
                for sight in SIGHTS
                if (angles, number, sight) not in made
            ]
        return tuple(lacks)

    @property
    def parts(self) -> tuple[Experiment | Simulation, ...]:
        """Experiments, then simulations."""
        return (*self.experiments, *self.simulations)


@record
class Dataset:
    """A dataset in the published layout.

    Attributes
    ----------
    root : Path
    objects : ObjectFolder, by folder name
    stray : names in the root that the layout has no place for
    """

    root: Path
    objects: tuple[ObjectFolder, ...]
    stray: tuple[str, ...]

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """Of all objects."""
        return tuple(experiment for one in self.objects for experiment in one.experiments)

    @property
    def items(self) -> tuple[Item, ...]:
        """Of all objects, each once: what the two experiments of a folder `exp<N>` share comes with the first."""
        found = {item.path: item for one in self.objects for part in one.parts for item in part.items}
        return tuple(found.values())

    def message(self, text: str, path: str) -> str:
        """A message about the item `path` [relative], with files named as in the dataset, and this one left out."""
        text = text.replace(f"{os.path.abspath(self.root)}{os.sep}", "")
        if self.root != Path():
            text = text.replace(f"{self.root}{os.sep}", "")
        return text.removeprefix(path).lstrip(":,/ ")

    def only(self, names: list[str]) -> "Dataset":
        """The objects whose id, name or folder is among `names`; all where there are none.

        Raises
        ------
        UnknownNameError
            A name is no object's.
        """
        known = [(one.id, one.name, one.folder.name) for one in self.objects]
        for name in names:
            if not any(name in one for one in known):
                raise UnknownNameError("object", name, [folder for _, _, folder in known])
        chosen = tuple(o for o, k in zip(self.objects, known, strict=True) if not names or set(names) & set(k))
        return Dataset(root=self.root, objects=chosen, stray=self.stray)
