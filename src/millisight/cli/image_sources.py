"""What the commands on images share: the images that paths lead to, a segmenter by name, one image after the other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import typer

from millisight.cli.console import end_with_failures, in_options, progress, say
from millisight.errors import FileError, FormatError, InputError, MillisightError, UnknownNameError
from millisight.files import check_readable, printable
from millisight.imaging.image import SarImage
from millisight.io.mito_names import EMPTY_SCENES, RADARS, SIGHTS, object_of
from millisight.perception.segmentation import Segmenter, segmenter

MASK_SUFFIX = ".mask.h5"
"""Of the masks that `millisight segment` writes."""

_PUBLISHED = "processed_image"  # begins the names of images in the published layout

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ImageSource:
    """One image that a path leads to.

    Attributes
    ----------
    path : the image's file
    name : of its outputs, without suffix
    condition : "los" or "nlos"
    other : file of the other band's image; None: there is none
    folder : where its outputs go by default
    """

    path: Path
    name: str
    condition: str
    other: Path | None
    folder: Path

    def output(self, suffix: str, folder: Path | None = None) -> Path:
        """What an output is called, in `folder` or where it goes by default."""
        return (self.folder if folder is None else folder) / f"{self.name}{suffix}"

    def images(self) -> tuple[SarImage, SarImage | None]:
        """The image and the other band's; raises FileError, FormatError, DamagedFileError."""
        return read_as(SarImage, self.path), None if self.other is None else read_as(SarImage, self.other)


def image_sources(
    paths: Sequence[Path],
    *,
    radar: str | None = None,
    condition: str | None = None,
    multispectral: bool = False,
    other_band: Path | None = None,
) -> list[ImageSource]:
    """Every image that `paths` lead to, in order; a folder leads to all under it but those of empty scenes.

    Parameters
    ----------
    radar : of experiments only this one, "77_ghz" or "24_ghz"
    condition : "los" or "nlos"; None: as an experiment's folder is named, or "los"
    multispectral : of experiments each 77 GHz image, with the 24 GHz image beside it
    other_band : the other band's image, where there is one image

    Raises
    ------
    FileError
        A path does not exist, or leads to no image.
    InputError, UnknownNameError
        The options contradict each other, or two images would have one name.
    """
    if condition is not None and condition not in SIGHTS:
        raise UnknownNameError("--condition", condition, SIGHTS)
    if multispectral and (other_band is not None or radar == "24_ghz"):
        raise InputError(
            "--multispectral pairs 77 GHz images with their 24 GHz ones; leave --other-band and --radar out"
        )
    found = [one for path in paths for one in _under(path, radar, condition, multispectral=multispectral)]
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two images would both be called {name}; name them one by one, with --output")
    return found if other_band is None else [replace(one, other=other_band) for one in found]


def check_single(found: Sequence[ImageSource], **options: object) -> None:
    """Refuse options that belong to one image where there are several; their names with _ for -.

    Raises
    ------
    InputError
    """
    if len(found) > 1 and any(value is not None for value in options.values()):
        names = " and ".join(f"--{name.replace('_', '-')}" for name in options)
        raise InputError(f"{names} belong to one image, and there are {len(found)}; pass one")


def one_by_one(
    found: Sequence[ImageSource],
    work: Callable[[ImageSource], object],
    *,
    verb: str,
    past: str,
    tell: Callable[[str], None] = say,
) -> None:
    """Every image after the other; one that fails does not stop the rest, and what failed is said again at the end.

    Parameters
    ----------
    found : images
    work : what is done with each
    verb, past : what it is called, "segment" and "segmented"
    tell : how many did not fail

    Raises
    ------
    typer.Exit
        An image failed.
    """
    failures: list[str] = []
    with progress(verb, compiles=False) as report:
        for number, source in enumerate(found):
            report(number, len(found))
            try:
                work(source)
            except (MillisightError, MemoryError, OSError) as error:
                failures.append(f"{source.name}: {' '.join(in_options(str(error)).split())}")
                typer.echo(f"millisight: {failures[-1]}", err=True)
    tell(f"{past} {len(found) - len(failures)} of {len(found)} images")
    end_with_failures(failures)


def named_segmenter(method: str, **options: Any) -> Segmenter:
    """The segmenter that --method names.

    Raises
    ------
    UnknownNameError
    InputError
        What it needs is not installed.
    """
    try:
        return segmenter(method, **options)
    except ImportError as error:
        raise InputError(
            f"--method {method} cannot be used here: {error}; --method classical needs nothing more"
        ) from error


def read_as(kind: type[T], path: Path) -> T:
    """A record of ours, or of the published dataset, that must be of this kind.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    from millisight.io.hdf5 import load
    from millisight.io.mito_layout import read_published

    record = read_published(path).record if path.suffix.lower() == ".pkl" else load(path)
    if not isinstance(record, kind):
        raise FormatError(f"{printable(path)} holds a {type(record).__name__}; expected a {kind.__name__}")
    return record


def _under(path: Path, radar: str | None, condition: str | None, *, multispectral: bool) -> list[ImageSource]:
    """The images that a path leads to.

    Raises
    ------
    FileError
        There is no such path, or no image under it.
    """
    if not path.is_dir():
        path = check_readable(path)
        return [_source(path, condition, multispectral=multispectral)]
    files = [*path.rglob(f"{_PUBLISHED}*.pkl"), *path.rglob(f"{_PUBLISHED}*.h5"), *path.rglob("*.image.h5")]
    files = sorted(file for file in files if not _passed_over(file.relative_to(path)))
    if multispectral:
        files = [file for file in files if file.parent.name == "77_ghz"]
    elif radar is not None:
        files = [file for file in files if file.parent.name == radar]
    if not files:
        wanted = "" if radar is None and not multispectral else f" of the {radar or '77_ghz'} radar"
        raise FileError(
            f"{printable(path)} holds no image{wanted}: no *.image.h5, and no processed_image*.pkl of the published "
            "layout; make some with `millisight image`"
        )
    return [_source(file, condition, multispectral=multispectral) for file in files]


def _passed_over(file: Path) -> bool:
    """Whether it is still being made, in a hidden folder, or is of the published layout's empty scenes: no object."""
    if any(part.startswith(".") for part in file.parts):
        return True
    folders = map(object_of, file.parent.parts if file.name.startswith(_PUBLISHED) else ())
    return any(named is not None and named[1] in EMPTY_SCENES for named in folders)


def _source(path: Path, condition: str | None, *, multispectral: bool) -> ImageSource:
    parts = path.resolve().parts
    published = path.name.startswith(_PUBLISHED) and path.parent.resolve().name in RADARS
    if not published:
        if multispectral:
            raise InputError(f"--multispectral needs images of the published layout, which {printable(path)} is not; "
                             "pass the two images, one as --other-band")  # fmt: skip
        stem = path.name.removesuffix(path.suffix).removesuffix(".image")
        return ImageSource(path, stem, condition or "los", None, path.parent)
    passed_over = ("robot_collected", "processed", "radars")
    named = [part for part in parts[-7 if "simulation" in parts[-7:] else -9 : -1] if part not in passed_over]
    sight = parts[-5] if parts[-5:-4] and parts[-5] in SIGHTS else "los"
    other = path.resolve().parent.parent / "24_ghz" / path.name if multispectral else None
    name = ".".join(named) + path.stem.removeprefix(_PUBLISHED)
    return ImageSource(path, name, condition or sight, other, Path())
