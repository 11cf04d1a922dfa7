"""`millisight segment`: from images to masks, one or a whole dataset."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import check_outputs, end_with_failures, in_options, progress, say
from millisight.errors import FileError, FormatError, InputError, MillisightError, UnknownNameError
from millisight.files import check_readable, make_folder, printable
from millisight.imaging.image import SarImage
from millisight.perception.prompts import Prompts
from millisight.perception.segmentation import Segmented, Segmenter, find_mask, segmenter

_CONDITIONS = ("los", "nlos")
_MOST_PROMPT_BYTES = 1 << 24


@dataclass(frozen=True, slots=True)
class _Source:
    """One image: its file, the other band's, in or out of sight, and what its mask is called."""

    path: Path
    name: str
    condition: str
    other: Path | None
    folder: Path


@dataclass(frozen=True, slots=True)
class _Settings:
    """The options that are the same for every image."""

    method: str
    seed: int
    prompts: Prompts | None
    values: str
    largest: float | None
    picture: bool


def segment(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE",
            help="What `millisight image` or `ms.save` wrote (HDF5), or processed_image*.pkl of the published dataset; "
            "experiments of it, or any folder above them or above HDF5 images.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Mask to write (HDF5); a folder where there are several images. [default: IMAGE.mask.h5, beside the "
            "image, or here for experiments of a dataset]",
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="wave: a small network made for radar images. classical: a random walker from bright and dark pixels. "
            "sam: Segment Anything."
        ),
    ] = "wave",
    other_band: Annotated[
        Path | None,
        typer.Option(
            help="The same scene at the radar's other frequency: prompts must be bright in both; wave looks at both."
        ),
    ] = None,
    multispectral: Annotated[
        bool,
        typer.Option("--multispectral", help="Of experiments: each 77 GHz image, with the 24 GHz image beside it."),
    ] = False,
    radar: Annotated[str | None, typer.Option(help="Of experiments only this one: 77_ghz or 24_ghz.")] = None,
    condition: Annotated[
        str | None,
        typer.Option(
            help="los: in line of sight. nlos: behind something; prompts beside the object are drawn from under 0.05 "
            "of the maximum instead of 0.02. [default: los, or as an experiment's folder is named]"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the drawing of prompts; the same seed gives the same mask.")] = 0,
    prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help='Prompts to use instead of drawn ones: {"points": [[i, j], ...], "positive": [true, ...]}, indices '
            "along x and y, such as `millisight annotate` writes beside its mask.",
        ),
    ] = None,
    values: Annotated[str, typer.Option(help="What is seen along z: the mean of |I|, its max or its rms.")] = "mean",
    largest: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=100,
            metavar="PERCENT",
            help="Pass over masks that cover more of the picture. [default: 20, and more for pictures smaller than "
            "0.55 x 0.60 m: what would be 20 there, up to 60]",
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="Of sam: vit-b, vit-l, vit-h, sam2-tiny or sam2-large, which are downloaded; or a folder with a model."
        ),
    ] = "vit-b",
    device: Annotated[str, typer.Option(help="Of sam: cpu or cuda.")] = "cpu",
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Do not draw prompts and mask over the image, MASK.png.")
    ] = False,
) -> None:
    """Find the object in images; with several images, one bad one does not stop the rest.

    The image is seen along z. A segmenter that needs prompts gets some that are drawn at random: on the object from
    pixels above 0.4 of the maximum, beside it from dark ones. Of the masks that it offers, the best is taken that is
    not too large; if all are, prompts are drawn once more, 5 of each kind above 0.5 and below 0.2.

    Example: millisight segment mug.image.h5

    Example: millisight segment mug_77.h5 --other-band mug_24.h5 --method classical --seed 3 -o mug.mask.h5

    Example: millisight segment MITO_Dataset/004_sugar_box --multispectral -o masks/
    """
    if condition is not None and condition not in _CONDITIONS:
        raise UnknownNameError("--condition", condition, _CONDITIONS)
    if multispectral and (other_band is not None or radar == "24_ghz"):
        raise InputError(
            "--multispectral pairs 77 GHz images with their 24 GHz ones; leave --other-band and --radar out"
        )
    found = [one for path in images for one in _sources(path, radar, condition, multispectral=multispectral)]
    _check_names(found, several=prompts is not None or other_band is not None)
    if other_band is not None:
        found = [_Source(found[0].path, found[0].name, found[0].condition, other_band, found[0].folder)]
    settings = _Settings(
        method=method,
        seed=seed,
        prompts=None if prompts is None else _read_prompts(prompts),
        values=values,
        largest=None if largest is None else largest / 100,
        picture=not no_picture,
    )
    by = _segmenter(method, model, device)
    if len(found) == 1 and not any(path.is_dir() for path in images):
        _segment_one(found[0], output or _mask_path(found[0], None), by, settings)
        return
    _segment_all(found, output, by, settings)


def _segmenter(method: str, model: str, device: str) -> Segmenter:
    try:
        return segmenter(method, **({"model": model, "device": device} if method == "sam" else {}))
    except ImportError as error:
        raise InputError(
            f"--method {method} cannot be used here: {error}; --method classical needs nothing more"
        ) from error


def _segment_all(found: list[_Source], folder: Path | None, by: Segmenter, settings: _Settings) -> None:
    """Every image after the other; what failed is said again at the end."""
    if folder is not None:
        make_folder(folder)
    failures: list[str] = []
    with progress("segment", compiles=False) as report:
        for number, source in enumerate(found):
            report(number, len(found))
            try:
                _segment_one(source, _mask_path(source, folder), by, settings)
            except (MillisightError, MemoryError, OSError) as error:
                failures.append(f"{source.name}: {' '.join(in_options(str(error)).split())}")
                typer.echo(f"millisight: {failures[-1]}", err=True)
    say(f"segmented {len(found) - len(failures)} of {len(found)} images")
    end_with_failures(failures)


def _segment_one(source: _Source, to: Path, by: Segmenter, settings: _Settings) -> None:
    from millisight.io.hdf5 import save
    from millisight.perception.projection import project

    drawn = to.with_suffix(".png") if settings.picture else None
    check_outputs(to, drawn, source=source.path)
    image = _read_image(source.path)
    other = None if source.other is None else _read_image(source.other)
    found = find_mask(
        by,
        project(image, other_band=other, values=settings.values),
        other=None if other is None else project(other, values=settings.values),
        prompts=settings.prompts,
        rng=settings.seed,
        condition=source.condition,
        largest=settings.largest,
    )
    save(to, found.mask, extras={"segmentation": _told(found, source, settings)})
    asked = "no prompts" if found.prompts is None else f"{len(found.prompts.points)} prompts"
    share = f"{int(found.inside.sum())} pixels, {100 * found.inside.mean():.1f} %"
    say(f"{source.name}: mask of {share}, by {by.name} from {asked}; wrote {to}")
    if drawn is not None:
        from millisight.viz.segmentation import plot_segmentation
        from millisight.viz.style import save_figure

        save_figure(plot_segmentation(found, title=source.name), drawn)


def _told(found: Segmented, source: _Source, settings: _Settings) -> dict[str, Any]:
    """How the mask came about, as its file keeps it."""
    from millisight.io.mito_names import origin

    return {
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "method": settings.method,
        "score": found.score,
        "condition": source.condition,
        "seed": None if settings.prompts is not None or found.prompts is None else settings.seed,
        "values": settings.values,
        **({"points": [], "positive": []} if found.prompts is None else found.prompts.plain),
    }


def _sources(path: Path, radar: str | None, condition: str | None, *, multispectral: bool) -> list[_Source]:
    """The images that a path leads to.

    Raises
    ------
    FileError
        There is no such path, or no image under it.
    """
    if not path.is_dir():
        path = check_readable(path)
        return [_source(path, condition, multispectral=multispectral)]
    files = [*path.rglob("processed_image*.pkl"), *path.rglob("processed_image*.h5"), *path.rglob("*.image.h5")]
    # Hidden folders hold what is being made.
    files = sorted(file for file in files if not any(p.startswith(".") for p in file.relative_to(path).parts))
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


def _source(path: Path, condition: str | None, *, multispectral: bool) -> _Source:
    from millisight.io.mito_names import RADARS

    parts = path.resolve().parts
    published = path.name.startswith("processed_image") and path.parent.resolve().name in RADARS
    if not published:
        if multispectral:
            raise InputError(f"--multispectral needs images of the published layout, which {printable(path)} is not; "
                             "pass the two images, one as --other-band")  # fmt: skip
        stem = path.name.removesuffix(path.suffix).removesuffix(".image")
        return _Source(path, stem, condition or "los", None, path.parent)
    passed_over = ("robot_collected", "processed", "radars")
    named = [part for part in parts[-7 if "simulation" in parts[-7:] else -9 : -1] if part not in passed_over]
    sight = parts[-5] if parts[-5:-4] and parts[-5] in _CONDITIONS else "los"
    other = path.resolve().parent.parent / "24_ghz" / path.name if multispectral else None
    name = ".".join(named) + path.stem.removeprefix("processed_image")
    return _Source(path, name, condition or sight, other, Path())


def _check_names(found: list[_Source], *, several: bool) -> None:
    if several and len(found) > 1:
        raise InputError(f"--prompts and --other-band belong to one image, and there are {len(found)}; pass one")
    names = [source.name for source in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two images would both be called {name}; segment them one by one, with --output")


def _read_image(path: Path) -> SarImage:
    """An image of ours, or of the published dataset.

    Raises
    ------
    FileError, FormatError, DamagedFileError
    """
    from millisight.io.hdf5 import load
    from millisight.io.mito_layout import read_published

    record = read_published(path).record if path.suffix.lower() == ".pkl" else load(path)
    if not isinstance(record, SarImage):
        raise FormatError(f"{printable(path)} holds a {type(record).__name__}; expected a SarImage")
    return record


def _read_prompts(path: Path) -> Prompts:
    """Raises FileError, FormatError."""
    path = check_readable(path)
    if path.stat().st_size > _MOST_PROMPT_BYTES:
        raise FormatError(
            f"{printable(path)} has {path.stat().st_size} bytes; expected a file of prompts, under 16 MiB"
        )
    try:
        told = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{printable(path)} is no JSON: {error}") from error
    if not isinstance(told, dict) or not {"points", "positive"} <= told.keys():
        raise FormatError(f"{printable(path)} holds no prompts; expected an object with points and positive")
    try:
        return Prompts.from_plain({name: told[name] for name in ("points", "positive")})
    except InputError as error:
        raise FormatError(f"{printable(path)}: {error}") from error


def _mask_path(source: _Source, folder: Path | None) -> Path:
    return (source.folder if folder is None else folder) / f"{source.name}.mask.h5"
