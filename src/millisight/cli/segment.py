"""`millisight segment`: from images to masks, one or a whole dataset."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import check_outputs, say
from millisight.cli.image_sources import (
    MASK_SUFFIX,
    ImageSource,
    check_single,
    image_sources,
    named_segmenter,
    one_by_one,
)
from millisight.cli.options import Images, Multispectral, RadarChoice, SamDevice
from millisight.errors import FormatError, InputError
from millisight.files import check_readable, make_folder, printable
from millisight.perception.prompts import Prompts
from millisight.perception.segmentation import Segmented, Segmenter, find_mask

_MOST_PROMPT_BYTES = 1 << 24


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
    images: Images,
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
    multispectral: Multispectral = False,
    radar: RadarChoice = None,
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
    device: SamDevice = "cpu",
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
    found = image_sources(images, radar=radar, condition=condition, multispectral=multispectral, other_band=other_band)
    check_single(found, prompts=prompts, other_band=other_band)
    settings = _Settings(
        method=method,
        seed=seed,
        prompts=None if prompts is None else _read_prompts(prompts),
        values=values,
        largest=None if largest is None else largest / 100,
        picture=not no_picture,
    )
    by = named_segmenter(method, **({"model": model, "device": device} if method == "sam" else {}))
    if len(found) == 1 and not any(path.is_dir() for path in images):
        _segment_one(found[0], output or found[0].output(MASK_SUFFIX), by, settings)
        return
    folder = None if output is None else make_folder(output)
    one_by_one(
        found,
        lambda source: _segment_one(source, source.output(MASK_SUFFIX, folder), by, settings),
        verb="segment",
        past="segmented",
    )


def _segment_one(source: ImageSource, to: Path, by: Segmenter, settings: _Settings) -> None:
    from millisight.io.hdf5 import save
    from millisight.perception.projection import project

    drawn = to.with_suffix(".png") if settings.picture else None
    check_outputs(to, drawn, source=source.path)
    image, other = source.images()
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
    asked = "" if found.prompts is None else f" from {len(found.prompts.points)} prompts"
    share = f"{int(found.inside.sum())} pixels, {100 * found.inside.mean():.1f} %"
    say(f"{source.name}: mask of {share}, by {by.name}{asked}; wrote {to}")
    if drawn is not None:
        from millisight.viz.segmentation import plot_segmentation
        from millisight.viz.style import save_figure

        save_figure(plot_segmentation(found, title=source.name), drawn)


def _told(found: Segmented, source: ImageSource, settings: _Settings) -> dict[str, Any]:
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
