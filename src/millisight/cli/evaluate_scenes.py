"""What the evaluations of segmenters and of classifiers share: options, scenes and what made them, settings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from millisight.cli.options import checked_sight
from millisight.errors import InputError, MillisightError

if TYPE_CHECKING:
    from millisight.datasets.inventory import Dataset
    from millisight.datasets.judging import Settings
    from millisight.datasets.scenes import SceneFiles

Root = Annotated[Path, typer.Argument(metavar="DIR", help="A dataset in the published layout.")]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Folder for tables and pictures.")]
Transform = Annotated[
    str | None,
    typer.Option(
        help="Camera to radar: by the pose in the file (file), or the constants of the published evaluation "
        "(published). [default: file for simulated scenes, else published]"
    ),
]


def chosen_scenes(root: Path, objects: list[str] | None, sight: str | None) -> "tuple[Dataset, tuple[SceneFiles, ...]]":
    """The dataset with these objects alone, None for all, and its scenes of this sight.

    Raises
    ------
    FileError, UnknownNameError
    InputError
        There is no such scene.
    """
    from millisight.datasets.mito import find
    from millisight.datasets.scenes import find_scenes

    sight = checked_sight(sight)
    dataset = find(root).only(objects or [])
    scenes = find_scenes(dataset, sight=sight)
    if not scenes:
        raise InputError(f"{root} has no radar image of an object there; expected processed_image.pkl of experiments")
    return dataset, scenes


def physics_of_all(scenes: "Sequence[SceneFiles]") -> tuple[dict[str, str], list[tuple[str, str]]]:
    """What made each scene, by its name, "" of real ones; and the scenes that do not tell, with the reason."""
    from millisight.datasets.scenes import physics_of

    found, failures = {}, []
    for files in scenes:
        try:
            found[files.name] = physics_of(files)
        except MillisightError as error:
            failures.append((files.name, str(error)))
    return found, failures


def described(physics: Mapping[str, str], root: Path) -> tuple[str, bool]:
    """What the data are, in words for titles, and whether they are simulated.

    Raises
    ------
    InputError
        Some are simulated, and some are not.
    """
    kinds = set(physics.values())
    if len(kinds) > 1 and "" in kinds:
        raise InputError(f"{root} has simulated scenes and others; judge them apart, with --object")
    name = root.resolve().name
    made = ", ".join(sorted(kinds - {""}))
    if not made:
        return f"{name} (not marked as simulated)", False
    if "virtual rig" not in made:  # scenes are of `robot_collected`, and no other robot is simulated
        made = f"virtual rig, {made}"
    return f"{name} ({made}; simulated, not real data)", True


def checked_settings(
    methods: Sequence[str],
    *,
    seeds: Sequence[int],
    reading: Mapping[str, Any],
    options: Mapping[str, Any] | None = None,
) -> "Settings":
    """The settings, once every segmenter was made: what is wrong with one is said before the work.

    Parameters
    ----------
    methods : names of the segmenters
    seeds, reading, options : as of `Settings`

    Raises
    ------
    UnknownNameError
    InputError
        What a segmenter needs is not installed.
    """
    from millisight.datasets.judging import Settings

    settings = Settings(seeds=tuple(seeds), reading=reading, options=options or {})
    for name in methods:
        try:
            settings.segmenter(name)
        except ImportError as error:
            raise InputError(str(error)) from error
    return settings
