"""What a dataset in the published layout holds, and what it lacks: records that `open` makes; files open on request."""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from millisight.core import printable, record
from millisight.core.errors import FileError, FormatError, UnknownNameError
from millisight.data import CameraFrame, CameraMask, Capture, Mask, Picture, RawScan, SarImage
from millisight.io import load, load_extras, mito, read_photo

CANNOT_LIST = "the folder cannot be listed, so what is in it is left out; check its permissions"
"""Of a folder that `unreadable` names."""


@record
class Item:
    """One thing of the dataset: a file, or the folder of one radar's raw files.

    Attributes
    ----------
    path : of the file, or the folder
    kind : "image", "radar mask", "camera mask", "camera frame", "camera picture" (PNG), "raw", "raw simulation",
        "robot log" (without raw files beside it) or "info"
    radar : "77_ghz" or "24_ghz"; "" where none is concerned
    ext : what follows the file's usual name, such as "_specular"
    """

    path: Path
    kind: str
    radar: str = ""
    ext: str = ""

    @property
    def converted(self) -> bool:
        """Whether it is an HDF5 file of millisight."""
        return self.path.suffix == ".h5"

    def read(self) -> Any:
        """The record that the item holds; of "info" a dictionary, of raw files that were not converted a RawScan.

        Of a camera picture it is a Picture, of a robot log a Trajectory, of a raw simulation a Capture.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        if self.kind == mito.INFO:
            return mito.read_info(self.path)
        if self.converted:
            return load(self.path)
        if self.kind == mito.RAW:
            return mito.read_experiment(self.path, self.radar)
        if self.kind == mito.CAMERA_PICTURE:
            return Picture(rgb=read_photo(self.path))
        return self.read_with_extras()[0]

    def read_with_extras(self) -> tuple[Any, dict[str, Any]]:
        """The record of an image, a mask, a camera frame, a raw simulation or a robot log, and all else of its file.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        if self.converted:
            return load(self.path), load_extras(self.path)
        read = mito.read_log(self.path, self.radar) if self.kind == mito.LOG else mito.read_published(self.path)
        return read.record, read.extras


class _Part:
    """What experiments and simulations share: their items, read by kind."""

    __slots__ = ()
    folder: Path
    items: tuple[Item, ...]

    def item(self, kind: str, *, radar: str = "", ext: str = "") -> Item:
        """The item of that kind, radar ("": the first) and extension; FileError if there is none."""
        for item in self.items:
            if item.kind == kind and item.ext == ext and radar in ("", item.radar):
                return item
        wanted = " ".join(filter(None, (radar, kind, ext)))
        there = ", ".join(" ".join(filter(None, (i.radar, i.kind, i.ext))) for i in self.items) or "nothing"
        raise FileError(f"{printable(self.folder)} has no {wanted}; it has {there}")

    def image(self, *, radar: str = "77_ghz", ext: str = "") -> SarImage:
        """The image of a radar; `ext` is "_specular", "_edges" or "_diffuse" for the simulator's.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return read_item(self.item(mito.IMAGE, radar=radar, ext=ext), SarImage)

    def mask(self, *, radar: str = "77_ghz", ext: str = "") -> Mask:
        """The mask beside the image of a radar.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return read_item(self.item(mito.RADAR_MASK, radar=radar, ext=ext), Mask)


def read_item(item: Item, kind: type) -> Any:
    """The record of `kind` that an item holds."""
    return expect(item.read(), kind, item)


def expect(found: Any, kind: type, item: Item) -> Any:
    """What an item was `found` to hold, if it is of that kind."""
    if not isinstance(found, kind):
        raise FormatError(f"{printable(item.path)} holds a {type(found).__name__}; expected a {kind.__name__}")
    return found


@record
class Experiment(_Part):
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
    left_out : whether the authors of the published dataset do not use it; told by names, and so of theirs alone
    """

    object: str
    angles: tuple[int, int, int]
    number: int
    sight: str
    folder: Path
    items: tuple[Item, ...]
    missing: tuple[str, ...]
    left_out: bool = False

    @property
    def angles_name(self) -> str:
        """The angles as the folder's name has them."""
        return "_".join(map(str, self.angles))

    @property
    def name(self) -> str:
        """`<id>_<name>/<angles>/exp<N>/<sight>`."""
        return f"{self.object}/{self.angles_name}/exp{self.number}/{self.sight}"

    def camera_frame(self) -> CameraFrame:
        """The camera's picture of the scene.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return read_item(self.item(mito.CAMERA_FRAME), CameraFrame)

    def camera_mask(self) -> CameraMask:
        """The object's mask in the camera's picture.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        return read_item(self.item(mito.CAMERA_MASK), CameraMask)

    def capture(self, *, radar: str = "77_ghz") -> Capture:
        """The recorded frames at the poses of the robot's log, both clocks taken as they are.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        """
        found = self.item(mito.RAW, radar=radar).read()
        return found.to_capture() if isinstance(found, RawScan) else found


@record
class Simulation(_Part):
    """Simulated images of an object turned one way; attributes as of Experiment."""

    object: str
    angles: tuple[int, int, int]
    folder: Path
    items: tuple[Item, ...]
    missing: tuple[str, ...]

    @property
    def name(self) -> str:
        """`<id>_<name>/<angles>/simulation`."""
        return f"{self.object}/{'_'.join(map(str, self.angles))}/simulation"


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
    unreadable : paths within the folder, of folders that cannot be listed, so that nobody knows what is in them
    """

    id: str
    name: str
    role: str
    folder: Path
    experiments: tuple[Experiment, ...]
    simulations: tuple[Simulation, ...]
    meshes: tuple[str, ...]
    stray: tuple[str, ...]
    unreadable: tuple[str, ...] = ()

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
                for sight in mito.SIGHTS
                if (angles, number, sight) not in made
            ]
        return tuple(lacks)

    @property
    def parts(self) -> tuple[Experiment | Simulation, ...]:
        """Experiments, then simulations."""
        return (*self.experiments, *self.simulations)


@record
class Dataset:
    """A dataset in the published layout: a sequence of experiments and simulations.

    Its length is their number; `dataset[i]` is one of them, and iteration goes through all. No file is opened before
    an image, a mask or another item is asked for.

    Attributes
    ----------
    root : Path
    objects : ObjectFolder, by folder name
    stray : names in the root that the layout has no place for
    """

    root: Path
    objects: tuple[ObjectFolder, ...]
    stray: tuple[str, ...]

    def __repr__(self) -> str:
        simulations = len(self) - len(self.experiments)
        return (
            f"Dataset({printable(self.root)}: {len(self.objects)} objects, {len(self.experiments)} experiments, "
            f"{simulations} simulations)"
        )

    @property
    def unreadable(self) -> tuple[str, ...]:
        """Folders in the dataset that cannot be listed, relative to its root."""
        return tuple((Path(one.folder.name) / path).as_posix() for one in self.objects for path in one.unreadable)

    def __len__(self) -> int:
        return sum(len(one.parts) for one in self.objects)

    def __iter__(self) -> Iterator[Experiment | Simulation]:
        return (part for one in self.objects for part in one.parts)

    def __getitem__(self, index: int) -> Experiment | Simulation:
        return tuple(self)[index]

    def filter(
        self,
        *,
        objects: str | Sequence[str] = (),
        sight: str | None = None,
        experiment: int | None = None,
        simulated: bool | None = None,
        keep: Callable[[Experiment | Simulation], bool] | None = None,
    ) -> "Dataset":
        """The part of the dataset that fits every argument given.

        Parameters
        ----------
        objects : ids, names or folders of objects; none: all
        sight : "los" or "nlos": experiments in line of sight, or not
        experiment : N of `exp<N>`: experiments of this number
        simulated : True: simulations alone; False: experiments alone
        keep : called with an experiment or a simulation; returns whether it stays

        Raises
        ------
        UnknownNameError
            An object or a sight is not known.

        Examples
        --------
        `ms.datasets.open("MITO_Dataset").filter(sight="nlos", simulated=False)`
        """
        if sight not in (None, *mito.SIGHTS):
            raise UnknownNameError("sight", sight, mito.SIGHTS)
        if sight is not None or experiment is not None:
            simulated = False if simulated is None else simulated

        def fits(part: Experiment | Simulation) -> bool:
            measured = isinstance(part, Experiment)
            return (
                simulated in (None, not measured)
                and (sight is None or (measured and part.sight == sight))
                and (experiment is None or (measured and part.number == experiment))
                and (keep is None or keep(part))
            )

        chosen = self.only([objects] if isinstance(objects, str) else list(objects))
        narrowed = (
            replace(
                one,
                experiments=tuple(part for part in one.experiments if fits(part)),
                simulations=tuple(part for part in one.simulations if fits(part)),
            )
            for one in chosen.objects
        )
        return replace(chosen, objects=tuple(one for one in narrowed if one.parts or one.unreadable))

    def torch(
        self,
        *,
        radar: str = "77_ghz",
        ext: str = "",
        mask: bool = False,
        transform: Callable[[dict[str, Any]], Any] | None = None,
    ) -> Any:
        """The images as a `torch.utils.data.Dataset`: see `millisight.datasets.TorchDataset`.

        Raises
        ------
        ImportError
            torch is not installed: `pip install "millisight[train]"`.
        """
        try:
            from millisight.datasets._torch import TorchDataset
        except ImportError as error:
            raise ImportError('a torch Dataset needs torch: pip install "millisight[train]"') from error
        return TorchDataset(self, radar=radar, ext=ext, mask=mask, transform=transform)

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
        return text.removeprefix(path).lstrip(":,/ ") if text.startswith(path) else text

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
