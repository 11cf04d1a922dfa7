"""Shared by the commands on images: finding images, choosing a segmenter, working through a list."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from millisight.cli.bands import check_band, check_named
from millisight.cli.console import complain, end_with_failures, in_options, progress, say, summed_up, warn
from millisight.core import check_known, files_under, printable
from millisight.core.errors import FileError, FormatError, InputError, MillisightError, UnknownNameError
from millisight.data import Capture, SarImage
from millisight.io.mito import EMPTY_SCENES, RADARS, SIGHTS, object_of
from millisight.perception.segmentation import Segmenter, segmenter

MASK_SUFFIX = ".mask.h5"
"""Suffix of the masks that `millisight segment` writes."""
INSTANCES_SUFFIX = ".instances.h5"
"""Suffix of what `millisight segment --instances` writes."""
VOLUME_SUFFIX = ".volume.h5"
"""Suffix of what `millisight segment --volume` writes."""

_NAMED = 4  # files in a message
_PUBLISHED = "processed_image"  # start of image file names in the published layout

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ImageSource:
    """One image found at a path.

    Attributes
    ----------
    path : the image's file
    name : name of the outputs, without suffix
    condition : "los" or "nlos"
    other : image file of the other band; None: no such image
    folder : default folder of the outputs
    asked : of a file that was named alone, the radar that it must be of; None: any
    """

    path: Path
    name: str
    condition: str
    other: Path | None
    folder: Path
    asked: str | None = None

    def output(self, suffix: str, folder: Path | None = None) -> Path:
        """Path of an output in `folder`; None: in the default folder."""
        return (self.folder if folder is None else folder) / f"{self.name}{suffix}"

    def images(self) -> tuple[SarImage, SarImage | None]:
        """The image and that of the other band.

        Raises
        ------
        FileError, FormatError, DamagedFileError
        InputError
            The image is of another radar than the one asked for.
        """
        image = read_as(SarImage, self.path)
        check_band(self.path, self.asked, image.frequency)
        return image, None if self.other is None else read_as(SarImage, self.other)


def image_sources(
    paths: Sequence[Path],
    *,
    radar: str | None = None,
    condition: str | None = None,
    multispectral: bool = False,
    other_band: Path | None = None,
) -> list[ImageSource]:
    """All images found at `paths`, in order; folders are searched, empty scenes left out.

    Parameters
    ----------
    radar : use only this radar of experiments, "77_ghz" or "24_ghz"
    condition : "los" or "nlos"; None: from the folder name of the experiment, else "los"
    multispectral : pair each 77 GHz image of an experiment with its 24 GHz image
    other_band : image of the other band, for a single image

    Raises
    ------
    FileError
        A path does not exist, or holds no image.
    InputError, UnknownNameError
        The options contradict each other, two images have the same name, there is no such radar, or a file lies in
        the folder of another.
    """
    if condition is not None:
        check_known("--condition", condition, SIGHTS)
    if multispectral and (other_band is not None or radar == "24_ghz"):
        raise InputError("--multispectral pairs 77 GHz images with 24 GHz images; remove --other-band and --radar")
    with summed_up("images"):
        found = [one for path in paths for one in _under(path, radar, condition, multispectral=multispectral)]
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two images have the same name {name}; process them one by one with --output")
    return found if other_band is None else [replace(one, other=other_band) for one in found]


def check_single(found: Sequence[ImageSource], **options: object) -> None:
    """Refuse options of a single image if there are several images.

    Raises
    ------
    InputError
    """
    if len(found) > 1 and any(value is not None for value in options.values()):
        names = " and ".join(f"--{name.replace('_', '-')}" for name in options)
        raise InputError(f"{names} work with a single image, and {len(found)} were given; pass one image")


@contextmanager
def about(path: Path) -> Iterator[None]:
    """What cannot be done within says which file it is about, where it does not yet."""
    try:
        yield
    except InputError as error:
        if printable(path.name) in str(error):
            raise
        raise error.at(printable(path)) from error


def one_by_one(
    found: Sequence[ImageSource],
    work: Callable[[ImageSource], object],
    *,
    verb: str,
    past: str,
    tell: Callable[[str], None] = say,
) -> None:
    """Process images one by one; a failure does not stop the rest and is repeated at the end.

    Parameters
    ----------
    found : images
    work : function called with each image
    verb, past : verb for messages, such as "segment" and "segmented"
    tell : prints the number of images processed

    Raises
    ------
    typer.Exit
        An image failed.
    """
    failures: list[str] = []
    with progress(verb, compiles=False) as report, summed_up("images"):
        for number, source in enumerate(found):
            report(number, len(found))
            try:
                work(source)
            except (MillisightError, MemoryError, OSError) as error:
                failures.append(f"{source.name}: {' '.join(in_options(str(error)).split())}")
                complain(failures[-1])
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
        with progress(f"load {method}", compiles=False):
            return segmenter(method, **options)
    except ImportError as error:
        raise InputError(
            f"--method {method} cannot be used: {error}; --method classical needs no other package"
        ) from error


def read_as(kind: type[T], path: Path) -> T:
    """Read an HDF5 file or a pickle of the published dataset; the record must be a `kind`.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    from millisight.io import load
    from millisight.io.mito import read_published

    record = read_published(path).record if path.suffix.lower() == ".pkl" else load(path)
    if not isinstance(record, kind):
        instead = f"expected a {kind.__name__}"
        if isinstance(record, Capture) and kind is SarImage:
            instead += ": `millisight image` makes one of it"
        raise FormatError(f"{printable(path)} holds a {type(record).__name__}; {instead}")
    return record


def _under(path: Path, radar: str | None, condition: str | None, *, multispectral: bool) -> list[ImageSource]:
    """Images at a path; an error if there are none."""
    if not path.is_dir():
        check_named(path, radar, (path.resolve().parent.name,))
        return [replace(_source(path, condition, multispectral=multispectral), asked=radar)]
    every = files_under(path)
    files = [file for file in every if _is_image(file) and not _passed_over(file.relative_to(path))]
    others = _of_other_names(path, every)
    if multispectral:
        files = [file for file in files if file.parent.name == "77_ghz"]
    elif radar is not None:
        files = [file for file in files if file.parent.name == radar]
    if not files and radar not in (None, *RADARS):
        raise UnknownNameError("radar", radar, RADARS)
    if not files:
        wanted = "" if radar is None and not multispectral else f" of the {radar or '77_ghz'} radar"
        raise FileError(
            f"{printable(path)} holds no image{wanted}: no *.image.h5, and no processed_image*.pkl of the published "
            f"layout; make some with `millisight image`{f', or pass by name what is one: {others}' if others else ''}"
        )
    if others:
        warn(f"{printable(path)}: passed over what is not called *.image.h5: {others}; pass by name what is an image")
    return [_source(file, condition, multispectral=multispectral) for file in files]


def _is_image(file: Path) -> bool:
    """Whether a file's name is that of an image, published, converted or ours."""
    published = file.name.startswith(_PUBLISHED) and file.suffix in (".pkl", ".h5")
    return published or file.name.endswith(".image.h5")


def _of_other_names(folder: Path, files: Sequence[Path]) -> str:
    """The HDF5 files right in a folder that may be images, but are not called so; "" for none."""
    ours = (MASK_SUFFIX, INSTANCES_SUFFIX, VOLUME_SUFFIX, ".image.h5", ".capture.h5")
    names = [file.name for file in files if file.parent == folder and file.suffix == ".h5"]
    names = [name for name in names if not name.endswith(ours) and not name.startswith(_PUBLISHED)]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _passed_over(file: Path) -> bool:
    """Whether a file is in a hidden folder (still being written) or belongs to an empty scene."""
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
    if other is not None and "simulation" in parts[-7:] and not other.exists():
        warn("there is no simulated 24 GHz image; the 77 GHz image is used alone")
        other = None
    return ImageSource(path, name, condition or sight, other, Path())
