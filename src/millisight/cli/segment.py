"""`millisight segment`: from images to masks, one or a whole dataset."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from millisight.cli.console import answer_json, in_options, json_only, optional_length, say
from millisight.cli.image_sources import (
    INSTANCES_SUFFIX,
    MASK_SUFFIX,
    VOLUME_SUFFIX,
    ImageSource,
    about,
    check_single,
    image_sources,
    named_segmenter,
    one_by_one,
)
from millisight.cli.options import Images, Multispectral, RadarChoice, SamDevice, check_sam_device
from millisight.cli.outputs import check_outputs, folders_of_many, is_folder, of_folder, output_path
from millisight.cli.segment_outputs import (
    entry,
    forms_of,
    objects_of,
    provenance_of,
    say_no_forms,
    write_instances,
    write_mask,
    write_volume,
)
from millisight.core import check_readable, printable
from millisight.core.errors import FormatError, InputError, MillisightError
from millisight.data import Prompts, SarImage
from millisight.perception.segmentation import (
    Segmented,
    Segmenter,
    doubts_of,
    extend_mask,
    find_mask,
    segment_instances,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OtherBand = Annotated[
    Path | None,
    typer.Option(
        help="Image of the same scene at the other frequency. wave uses both images; prompts are drawn where both are "
        "bright."
    ),
]
Condition = Annotated[
    str | None,
    typer.Option(
        help="los: object in line of sight. nlos: object hidden; a lid that ends within the image is then taken off, "
        "too, wave judges whether anything lies there at all, and prompts beside the object are drawn below 0.05 of "
        "the maximum instead of 0.02. [default: the name of the experiment's folder, else los]"
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
            metavar="PATH",
            parser=output_path,
            help="Mask to write (HDF5), or a folder for several images. [default: IMAGE.mask.h5 beside the image; for "
            "experiments of a dataset, in the current folder]",
        ),
    ] = None,
    instances: Annotated[
        bool,
        typer.Option(
            "--instances",
            help="Find every object, and write one file with a mask for each (IMAGE.instances.h5) and a picture in "
            "colours. Under a carton's lid: --condition nlos.",
        ),
    ] = False,
    volume: Annotated[
        bool,
        typer.Option(
            "--volume",
            help="Also find the depths of the object, and write a mask of voxels (IMAGE.volume.h5), its surface "
            "(IMAGE.volume.ply) and a picture of three views, in place of the mask of pixels.",
        ),
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(
            help="wave: a small network for radar images. classical: a random walker that starts from bright and dark "
            "pixels. sam: Segment Anything. Or the name of a plug-in. With --instances, objects are restricted to its "
            "mask. [default: wave; with --instances none]"
        ),
    ] = None,
    other_band: OtherBand = None,
    multispectral: Multispectral = False,
    radar: RadarChoice = None,
    condition: Condition = None,
    seed: PromptSeed = 0,
    prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help='Prompts to use instead of random ones: {"points": [[i, j], ...], "positive": [true, ...]}, indices '
            "of pixels along x and y, as `millisight annotate` writes them.",
        ),
    ] = None,
    values: Annotated[str, typer.Option(help="Projection of |I| along z: mean, max or rms.")] = "mean",
    largest: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=100,
            metavar="PERCENT",
            help="Reject masks that cover more of the picture. [default: 20; for pictures smaller than 0.55 x 0.60 m "
            "the same area, up to 60]",
        ),
    ] = None,
    support: Annotated[
        str | None,
        typer.Option(
            help="Height z of what the object stands on, such as -30cm: what rises no higher is left out of the mask, "
            "such as an empty stand. [default: unknown]"
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="Model for sam: vit-b, vit-l, vit-h, sam2-tiny or sam2-large (downloaded), or a folder with a model."
        ),
    ] = "vit-b",
    device: SamDevice = "cpu",
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Do not plot prompts and mask over the image (MASK.png).")
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help='Print one JSON document: {"images": [{"image", "name", "output", "kind", "method", "found", "sizes", '
            '"score"} or {"image", "name", "error"}]}; sizes are numbers of pixels, or of voxels. Masks of pixels '
            'also have "doubts", "round", their balls and cylinders: {"kind", "radius", "centre", "axis", "length", '
            '"cut"}, and "flat", their flat tops: {"kind", "centre", "normal", "axis", "sides", "curvatures", "share", '
            '"cut"}; instances have "objects", of each these three and {"pixels", "score", "centre", "height", '
            '"lower", "upper"}. Places are in the world frame, lengths in metres, scores of instances in decibels.',
        ),
    ] = False,
) -> None:
    """Segment the object in each image. An image that fails does not stop the others.

    The image is projected along z. If the segmenter needs prompts, they are drawn at random: positive ones from pixels
    above 0.4 of the maximum, negative ones from dark pixels. The mask with the highest score that is not too large is
    taken. If all masks are too large, prompts are drawn once more: 5 positive ones above 0.5 of the maximum and 5
    negative ones below 0.2.

    Example: millisight segment mug.image.h5

    Example: millisight segment mug_77.h5 --other-band mug_24.h5 --method classical --seed 3 -o mug.mask.h5

    Example: millisight segment MITO_Dataset/004_sugar_box --multispectral -o masks/

    Example: millisight segment carton.image.h5 --instances

    Example: millisight segment mug.image.h5 --volume
    """
    if instances and volume:
        raise InputError("--instances gives masks of pixels, and --volume a mask of voxels; pass one of them")
    check_sam_device(device, (method,))
    with json_only(as_json):
        found = image_sources(
            images, radar=radar, condition=condition, multispectral=multispectral, other_band=other_band
        )
    check_single(found, prompts=prompts, other_band=other_band)
    given = None if prompts is None else _read_prompts(prompts)
    method = method or (None if instances else "wave")
    by = (
        None
        if method is None
        else named_segmenter(method, **({"model": model, "device": device} if method == "sam" else {}))
    )
    suffix = INSTANCES_SUFFIX if instances else VOLUME_SUFFIX if volume else MASK_SUFFIX
    share = None if largest is None else largest / 100
    height = optional_length(support, option="--support")

    def one(source: ImageSource, to: Path) -> "tuple[dict[str, Any], Callable[[], Figure], Path | None]":
        """What is told of an image whose mask was written, and its picture, not yet drawn, with where that goes."""
        drawn = None if no_picture else to.with_suffix(".png")
        _check_not_marked(to, drawn, named=output is not None)
        check_outputs(
            drawn, to.with_suffix(".ply") if volume else None, records=(to,), source=source.path, others=(source.other,)
        )
        if by is None or instances:
            return *several(source, to), drawn
        image, other = source.images()
        segmented = mask_of(
            source, image, other, by, seed=seed, prompts=given, values=values, largest=share, support=height
        )
        drawn_by = None if given is not None else seed
        told = provenance_of(segmented, image, source, by, seed=drawn_by, values=values, support=height)
        if volume:
            return *in_depth(source, to, image, segmented, told), drawn
        covered = segmented.picture.covered
        forms = forms_of(segmented.mask, image, covered=covered)
        write_mask(to, segmented, source, by, told | forms.plain)
        doubts = [in_options(one) for one in doubts_of(segmented.mask, image, covered=covered)]
        for one in (*forms.things, *doubts):
            say(f"  {one}")
        say_no_forms(image, segmented.mask)

        def picture() -> "Figure":
            from millisight.viz import plot_segmentation

            return plot_segmentation(segmented, forms=forms.things, title=source.name)

        kept = entry(source, to, "mask", by.name, [segmented.inside], segmented.score)
        return {**kept, **forms.plain, "doubts": doubts}, picture, drawn

    def several(source: ImageSource, to: Path) -> "tuple[dict[str, Any], Callable[[], Figure]]":
        image, other = source.images()
        found = segment_instances(
            image, other_band=other, method=by, prompts=given, rng=seed, condition=source.condition, values=values,
            largest=share, support=height,
        )  # fmt: skip
        covered = source.condition == "nlos"
        objects = objects_of(found, image, covered=covered)
        name = None if by is None else by.name
        write_instances(to, found, image, source, objects, method=name, values=values, support=height)

        def picture() -> "Figure":
            from millisight.perception import HIGH_BAND, without_sheets
            from millisight.viz import plot_instances

            shown = without_sheets(image, frequency=HIGH_BAND, covered=True) if covered else image
            things = [thing for one in objects for thing in one.forms.things]
            return plot_instances(found, image=shown, forms=things, title=source.name)

        kept = entry(source, to, "instances", name, [mask.inside for mask in found], None)
        return {**kept, "objects": [one.plain for one in objects]}, picture

    def in_depth(
        source: ImageSource, to: Path, image: SarImage, segmented: Segmented, told: dict[str, Any]
    ) -> "tuple[dict[str, Any], Callable[[], Figure]]":
        from millisight.perception import HIGH_BAND, without_sheets

        cleaned = without_sheets(image, frequency=HIGH_BAND, covered=segmented.picture.covered)
        voxels = extend_mask(segmented.mask, cleaned)
        write_volume(to, voxels, source, told)

        def picture() -> "Figure":
            from millisight.viz import plot_volume

            return plot_volume(voxels, image=cleaned, title=source.name)

        return entry(source, to, "volume", told["method"], [voxels.inside], told["score"]), picture

    entries: list[dict[str, Any]] = []

    def noted(source: ImageSource, to: Path) -> None:
        before = len(entries)
        try:
            told, picture, drawn = one(source, to)
            entries.append(told)  # before the picture is drawn: if that is interrupted, the mask is there
            if drawn is not None:
                from millisight.viz import save_figure

                save_figure(picture(), drawn)
        except (MillisightError, MemoryError, OSError) as error:
            entries[before:] = [{"image": str(source.path), "name": source.name, "error": in_options(str(error))}]
            raise

    try:
        with json_only(as_json):
            output = of_folder(output) if any(map(is_folder, images)) else output
            if len(found) == 1 and not is_folder(output):
                with about(found[0].path):
                    noted(found[0], output or found[0].output(suffix))
                return
            (folder,) = folders_of_many(output, count=len(found))
            one_by_one(
                found, lambda source: noted(source, source.output(suffix, folder)), verb="segment", past="segmented"
            )
    finally:
        if as_json:
            answer_json({"images": entries})


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


def _check_not_marked(*outputs: Path | None, named: bool) -> None:
    """Refuse to write over masks that were marked by hand, where the user has not named the output."""
    there = [] if named else [path for path in outputs if path is not None and path.exists()]
    if not there:
        return
    from millisight.viz.annotator import prompts_beside

    for path in there:
        if prompts_beside(path).exists():
            raise InputError(f"{path} was made by `millisight annotate`; choose another name with --output")


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
        raise FormatError(f"{printable(path)} is not JSON: {error}") from error
    if not isinstance(held, dict) or not {"points", "positive"} <= held.keys():
        raise FormatError(f"{printable(path)} holds no prompts; expected an object with points and positive")
    try:
        return Prompts.from_plain({name: held[name] for name in ("points", "positive")})
    except InputError as error:
        raise FormatError(f"{printable(path)}: {error}") from error
