"""What tasks ask of a dataset: its scenes, read when they are needed, and its simulated images.

Rooms above this one implement these protocols; `millisight.datasets` does for the published layout.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from millisight.core import record
from millisight.core.errors import InputError, MillisightError
from millisight.data import Capture, Mask, SarImage, TriangleMesh
from millisight.evaluation._scenes import LabelledScene


class Origin(NamedTuple):
    """Where a scene comes from.

    Attributes
    ----------
    shape : of the object: "built" by the catalogue, a real "scan", a "file" of the recipe's own; "unknown" of what was
        not generated
    seeds : with which it was made; none of what was not generated
    """

    shape: str
    seeds: frozenset[int]


class TestSplit(NamedTuple):
    """Who trains and who tests a classifier, as others chose it.

    Attributes
    ----------
    name : of the split
    test : images by folder of the object, number of the experiment and sight
    classes : of objects, by folder; "" of no class
    training, validation : names of objects
    """

    __test__ = False  # pytest takes it for tests

    name: str
    test: frozenset[tuple[str, int, str]]
    classes: Mapping[str, str]
    training: frozenset[str]
    validation: frozenset[str]


@record
class SceneSource(ABC):
    """A scene of a dataset that is read when it is needed. Records of other rooms inherit it and say how.

    Attributes
    ----------
    name : unique in the dataset; `<id>_<name>/<angles>/exp<N>/<sight>` in the published layout
    object : name of the object, in the catalogue where it is in it; by it networks tell what they saw
    folder : of the object, `<id>_<name>`
    angles : of the object about the fixed axes x, y and z [degrees]
    number : N of `exp<N>`
    sight : "los" or "nlos"
    """

    name: str
    object: str
    folder: str
    angles: tuple[int, int, int]
    number: int
    sight: str

    @property
    @abstractmethod
    def bands(self) -> tuple[str, ...]:
        """Of its images: "24 GHz" and "77 GHz", or one of them."""

    @property
    @abstractmethod
    def paths(self) -> tuple[Path, ...]:
        """Of all its files."""

    @abstractmethod
    def physics(self) -> str:
        """What made its captures, never blank where it is marked as simulated; "" where it is not."""

    def shape_class(self) -> str:
        """The object's class that the dataset states; "" where it states none."""
        return ""

    @abstractmethod
    def read(self, *, view: bool = True, **reading: Any) -> LabelledScene:
        """Images, true masks and, with `view`, the camera's picture."""

    @abstractmethod
    def read_image(self, band: str, *, crop: tuple[int, int] | None = None) -> tuple[SarImage, str]:
        """An image, and what made it by its own file; "" where it is not marked as simulated.

        `crop` is the number of the lowest and of the highest slices that a 77 GHz image loses; None: as published of
        this scene, and none of others.
        """

    def shape_paths(self, band: str) -> tuple[Path, ...]:
        """Of a capture of that band first, then of the object's true shape; () where the dataset has not both."""
        return ()

    def read_capture(self, band: str) -> Capture:
        """The capture of a band that `shape_paths` names."""
        raise InputError(f"{self.name} has no capture of known shape at {band}")

    def read_shape(self, band: str) -> tuple[TriangleMesh, ...]:
        """Meshes of the object's parts, in the frame of its capture."""
        raise InputError(f"{self.name} has no object of known shape at {band}")

    def metal(self, band: str) -> bool:
        """Whether most of the surface of the object that `read_shape` reads is metal."""
        raise InputError(f"{self.name} has no object of known material at {band}")

    def published_mask(self, band: str) -> Mask | None:
        """The mask that the dataset has beside an image; None: there is none."""
        return None


class SimulationSource(Protocol):
    """Simulated images of an object at one set of angles."""

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of its files."""
        ...

    def read_image(self, band: str, part: str) -> tuple[SarImage, str]:
        """The "specular" or the "edges" image of a band, and what made it; cropped as published."""
        ...


class EvaluationData(Protocol):
    """What a task asks of a dataset."""

    @property
    def path(self) -> Path:
        """Of the dataset."""
        ...

    @property
    def scenes(self) -> Sequence[SceneSource]:
        """To be evaluated."""
        ...

    @property
    def empties(self) -> Sequence[SceneSource]:
        """Scenes with no object, where nothing is to be found."""
        ...

    def origins(self) -> Mapping[str, Origin]:
        """Where the scenes come from, by name."""
        ...

    def split(self, name: str) -> TestSplit:
        """A published split by name, "published": the newest; UnknownNameError where there is none of that name."""
        ...

    def simulations(self, band: str) -> Mapping[tuple[str, tuple[int, int, int]], SimulationSource]:
        """By folder and angles of the object, where there are both a specular and an edge image of that band."""
        ...


class Survey(NamedTuple):
    """What the scenes of a dataset are, and how to read them.

    Attributes
    ----------
    data : what the data are, in words for titles
    simulated : whether the data are simulated
    physics : what simulated each scene, by its name; "" for real ones
    failures : (name, reason) of scenes that do not state it
    reading : options of `SceneSource.read`
    """

    data: str
    simulated: bool
    physics: dict[str, str]
    failures: tuple[tuple[str, str], ...]
    reading: dict[str, Any]


def survey(data: EvaluationData, *, transform: str | None, **reading: Any) -> Survey:
    """What the scenes of a dataset are: all simulated, or all real.

    `transform`, camera to radar, is "file" for simulated scenes by default, "published" for others; `reading` are the
    other options of `SceneSource.read`.
    """
    if not data.scenes:
        raise InputError(f"{data.path} has no radar image of an object; expected processed_image.pkl in experiments")
    physics, failures = {}, []
    for scene in data.scenes:
        try:
            physics[scene.name] = scene.physics()
        except MillisightError as error:
            failures.append((scene.name, str(error)))
    kinds = set(physics.values())
    if len(kinds) > 1 and "" in kinds:
        raise InputError(f"{data.path} mixes simulated and other scenes; evaluate them separately, by choosing objects")
    made = ", ".join(sorted(kinds - {""}))
    if made and "virtual rig" not in made:  # scenes are of `robot_collected`, and no other robot is simulated
        made = f"virtual rig, {made}"
    described = f"{made}; simulated, not real data" if made else "not marked as simulated"
    reading["transform"] = transform or ("file" if made else "published")
    name = data.path.resolve().name
    return Survey(f"{name} ({described})", bool(made), physics, tuple(failures), reading)
