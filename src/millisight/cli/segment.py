"""`millisight segment`: from images to masks, one or a whole dataset."""

import json
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
from millisight.core import check_readable, make_folder, printable
from millisight.core.errors import FormatError, InputError
from millisight.data import Prompts, SarImage
from millisight.perception.segmentation import Segmented, Segmenter, find_mask

OtherBand = Annotated[
    Path | None,
    typer.Option(
        help="The same scene at the radar's other frequency. wave looks at both; prompts must be bright in both."
    ),
]
Condition = Annotated[
    str | None,
    typer.Option(
        help="los: in line of sight. nlos: behind something; prompts beside the object are drawn from under 0.05 of "
        "the maximum instead of 0.02. [default: los, or as an experiment's folder is named]"
    ),
]
PromptSeed = Annotated[int, typer.Option(min=0, help="Random seed for prompts.")]

_MOST_PROMPT_BYTES = 1 << 24


def segment(
    images: Images,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Mask to write (HDF5), or a folder for several. [default: IMAGE.mask.h5, beside the image, or here "
            "for experiments of a dataset]",
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="wave: a small network made for radar images. classical: a random walker from bright and dark pixels. "
            "sam: Segment Anything. Or a plug-in's name."
        ),
    ] = "wave",
    other_band: OtherBand = None,
    multispectral: Multispectral = False,
    radar: RadarChoice = None,
    condition: Condition = None,
    seed: PromptSeed = 0,
    prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help='Prompts to use instead of drawn ones: {"points": [[i, j], ...], "positive": [true, ...]}, indices '
            "along x and y, such as `millisight annotate` writes beside its mask.",
        ),
    ] = None,
    values: Annotated[str, typer.Option(help="Projection along z of |I|: mean, max or rms.")] = "mean",
    largest: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=100,
            metavar="PERCENT",
            help="Skip masks that cover more of the picture. [default: 20, and more for pictures smaller than 0.55 x "
            "0.60 m: what would be 20 there, up to 60]",
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="Model for sam: vit-b, vit-l, vit-h, sam2-tiny or sam2-large, which are downloaded; or a folder."
        ),
    ] = "vit-b",
    device: SamDevice = "cpu",
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Do not plot prompts and mask over the image (MASK.png).")
    ] = False,
) -> None:
    """Find the object in images; with several images, one bad one does not stop the rest.

    The image is projected along z. For a segmenter that needs prompts, some are drawn at random: on the object from
    pixels above 0.4 of the maximum, beside it from dark ones. The best mask that is not too large is taken; if all are,
    prompts are drawn once more, 5 of each kind above 0.5 and below 0.2.

    Example: millisight segment mug.image.h5

    Example: millisight segment mug_77.h5 --other-band mug_24.h5 --method classical --seed 3 -o mug.mask.h5

    Example: millisight segment MITO_Dataset/004_sugar_box --multispectral -o masks/
    """
    found = image_sources(images, radar=radar, condition=condition, multispectral=multispectral, other_band=other_band)
    check_single(found, prompts=prompts, other_band=other_band)
    given = None if prompts is None else _read_prompts(prompts)
    by = named_segmenter(method, **({"model": model, "device": device} if method == "sam" else {}))
    share = None if largest is None else largest / 100

    def one(source: ImageSource, to: Path) -> None:
        drawn = None if no_picture else to.with_suffix(".png")
        check_outputs(to, drawn, source=source.path)
        segmented = mask_of(source, *source.images(), by, seed=seed, prompts=given, values=values, largest=share)
        _write(to, segmented, source, by, seed=None if given is not None else seed, method=method, values=values)
        if drawn is not None:
            from millisight.viz import plot_segmentation, save_figure

            save_figure(plot_segmentation(segmented, title=source.name), drawn)

    if len(found) == 1 and not any(path.is_dir() for path in images):
        one(found[0], output or found[0].output(MASK_SUFFIX))
        return
    folder = None if output is None else make_folder(output)
    one_by_one(found, lambda source: one(source, source.output(MASK_SUFFIX, folder)), verb="segment", past="segmented")


def mask_of(
    source: ImageSource, image: SarImage, other: SarImage | None, by: Segmenter, *, values: str = "mean", seed: int,
    **options: Any,
) -> Segmented:  # fmt: skip
    """The mask of the object in an image and the other band's; `options` as for `find_mask`.

    Raises
    ------
    InputError, UnknownNameError
        See `find_mask`.
    """
    from millisight.perception import project

    picture = project(image, other_band=other, values=values)
    second = None if other is None else project(other, values=values)
    return find_mask(by, picture, other=second, rng=seed, condition=source.condition, **options)


def _write(
    to: Path, found: Segmented, source: ImageSource, by: Segmenter, *, seed: int | None, method: str, values: str
) -> None:
    """The mask, and in its file how it was made."""
    from millisight.io import save
    from millisight.io.mito import origin

    provenance = {
        "image": origin(source.path),
        "other_band": None if source.other is None else origin(source.other),
        "method": method,
        "score": found.score,
        "condition": source.condition,
        "seed": None if found.prompts is None else seed,
        "values": values,
        **({"points": [], "positive": []} if found.prompts is None else found.prompts.plain),
    }
    save(to, found.mask, extras={"segmentation": provenance})
    prompted = "" if found.prompts is None else f" from {len(found.prompts.points)} prompts"
    share = f"{int(found.inside.sum())} pixels, {100 * found.inside.mean():.1f} %"
    say(f"{source.name}: mask of {share}, by {by.name}{prompted}; wrote {to}")


def _read_prompts(path: Path) -> Prompts:
    """Raises FileError, FormatError."""
    path = check_readable(path)
    if path.stat().st_size > _MOST_PROMPT_BYTES:
        raise FormatError(
            f"{printable(path)} has {path.stat().st_size} bytes; expected a file of prompts, under 16 MiB"
        )
    try:
        held = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{printable(path)} is no JSON: {error}") from error
    if not isinstance(held, dict) or not {"points", "positive"} <= held.keys():
        raise FormatError(f"{printable(path)} holds no prompts; expected an object with points and positive")
    try:
        return Prompts.from_plain({name: held[name] for name in ("points", "positive")})
    except InputError as error:
        raise FormatError(f"{printable(path)}: {error}") from error
