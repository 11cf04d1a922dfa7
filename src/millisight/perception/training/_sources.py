"""Where examples come from besides the catalogue: folders of mesh files, and simulated images of a dataset."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from millisight.core import printable
from millisight.core.errors import FileError, InputError
from millisight.io import mito
from millisight.meshes import find_meshes, object_name

SIMULATED_STEMS = tuple(
    f"{stem}{part}" for stem in ("processed_image", "radar_masks") for part in ("_specular", "_edges")
)
"""Names without suffix of what a simulation must hold: two images, and their masks."""


@lru_cache(maxsize=4)
def meshes_in(folder: str) -> Mapping[str, Path]:
    """The meshes of a folder by name; none of "".

    Raises
    ------
    FileError
        The folder cannot be read, or holds none.
    """
    return MappingProxyType(find_meshes(folder) if folder else {})


@lru_cache(maxsize=4)
def simulations_in(root: str) -> Mapping[str, tuple[Path, ...]]:
    """Simulations `<id>_<name>/simulation/<ax>_<ay>_<az>` with images and masks of both parts, by the object's name.

    Parameters
    ----------
    root : of a dataset in the published layout, as downloaded or converted; "": none

    Raises
    ------
    FileError
        It cannot be read, or holds none.
    """
    if not root:
        return MappingProxyType({})
    found: dict[str, list[Path]] = {}
    try:
        for place in sorted(Path(root).glob("*/simulation/*/processed/radars/77_ghz")):
            folder = place.parents[2]
            if mito.object_of(folder.parents[1].name) is None or mito.angles_of(folder.name) is None:
                continue
            if {path.stem for path in place.iterdir() if path.suffix in (".pkl", ".h5")}.issuperset(SIMULATED_STEMS):
                found.setdefault(object_name(folder.parents[1].name), []).append(folder)
    except OSError as error:
        raise FileError(f"cannot read {printable(root)}: {error.strerror or error}; check published") from error
    if not found:
        raise FileError(
            f"{printable(root)} holds no simulated images with masks; expected "
            "<id>_<name>/simulation/<ax>_<ay>_<az>/processed/radars/77_ghz with processed_image_specular, "
            "processed_image_edges, radar_masks_specular and radar_masks_edges"
        )
    return MappingProxyType({name: tuple(folders) for name, folders in found.items()})


def check_classes(objects: Mapping[str, Sequence[str]], drawn: int) -> None:
    """Refuse classes too few, without objects though none are `drawn`, or with an object twice; `InputError`."""
    if len(objects) < 2:
        raise InputError(f"classes are {list(objects)}; expected at least two")
    for shape, names in objects.items():
        if not names and not drawn:
            raise InputError(
                f"no object is left for the class {shape!r}; name some in classes, or fewer in without and tests, or "
                "have shapes drawn at random"
            )
    every = [name for names in objects.values() for name in names]
    for name in every:
        if every.count(name) > 1:
            raise InputError(f"{name} is named more than once in classes; expected each object in one class, once")
