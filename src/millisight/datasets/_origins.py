"""Where the scenes of a dataset come from: shapes and seeds of generated ones."""

from collections.abc import Mapping, Sequence
from typing import Any

from millisight.core import read_toml
from millisight.datasets._dataset import Dataset
from millisight.datasets._manifest import read_manifest
from millisight.evaluation import Origin, SceneSource
from millisight.io import mito
from millisight.meshes import CATALOGUE


def origins(dataset: Dataset, scenes: Sequence[SceneSource]) -> dict[str, Origin]:
    """Where each scene comes from, by its name: of generated ones, by `truth` and the manifest.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    manifest = read_manifest(dataset.root)
    seed = None if manifest is None else manifest.settings.get("seed")
    common = {seed} if isinstance(seed, int) else set()
    found = {}
    for files in scenes:
        folder, turned, rest = files.name.split("/", 2)
        places = sorted((dataset.root / mito.TRUTH / folder / "robot_collected" / turned / rest).glob("*/world.toml"))
        worlds = [read_toml(path, "world") for path in places]
        found[files.name] = Origin(
            shape=_shape(worlds[0], files.object) if worlds else "unknown",
            seeds=frozenset(common | {world["seed"] for world in worlds if isinstance(world.get("seed"), int)}),
        )
    return found


def _shape(world: Mapping[str, Any], name: str) -> str:
    objects = world.get("objects") or [{}]
    if not (isinstance(objects, list) and isinstance(objects[0], dict)):
        return "unknown"
    if objects[0].get("object"):
        return "built"
    return "scan" if name in CATALOGUE else "file"  # a mesh of what the catalogue would have drawn
