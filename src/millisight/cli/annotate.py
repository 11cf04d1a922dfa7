"""`millisight annotate`: mark an object by clicks, and save its mask and the points."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import complain, length, say
from millisight.cli.interrupts import Interrupted
from millisight.cli.options import SamDevice, check_sam_device
from millisight.cli.outputs import check_outputs
from millisight.core import make_folder, printable
from millisight.core.errors import InputError

if TYPE_CHECKING:
    from millisight.viz.annotator import OpenedPicture


def annotate(
    image: Annotated[
        Path,
        typer.Argument(
            metavar="IMAGE",
            help="Image to annotate: HDF5 of `millisight image`; processed_image*.pkl or continuous*.pkl of the "
            "published dataset; a photograph (PNG, JPEG).",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Mask to write: HDF5 for a radar image, PNG for a photograph; radar_masks*.pkl or camera_masks*.pkl: "
            "in the published form. The points go to NAME.prompts.json beside it. [default: NAME.mask.h5 or "
            "NAME.mask.png beside the image; for files of a dataset, in the current folder]",
        ),
    ] = None,
    published: Annotated[
        bool,
        typer.Option(
            "--published",
            help="Write the mask into the dataset that the image is of, where evaluations look for it: radar_masks "
            "beside a radar image, processed/camera/camera_masks of a camera frame.",
        ),
    ] = False,
    depths: Annotated[
        str,
        typer.Option(metavar="NEAR:FAR", help="Depths of the object in a camera frame, for camera_masks."),
    ] = "20cm:50cm",
    other_band: Annotated[
        Path | None,
        typer.Option(help="Image of the same scene at the radar's other frequency, for segmenters that use both."),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="Segmenter to start with: wave, classical or sam. [default: the first available]"),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="Model for sam: vit-b, vit-l, vit-h, sam2-tiny or sam2-large (downloaded), or a folder with a model. "
            "[default: no sam; vit-b with --method sam]"
        ),
    ] = None,
    device: SamDevice = "cpu",
    port: Annotated[
        int, typer.Option(min=0, max=65535, show_default=False, help="Port to serve the page on. [default: a free one]")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Do not open a browser window; serve until Ctrl-C.")
    ] = False,
) -> None:
    """Mark an object in the browser: click on it. Right-click what does not belong to it.

    The mask is updated after each click. An earlier annotation of the same image is continued. Close the page or press
    Ctrl-C to stop.

    Example: millisight annotate mug.image.h5

    Example: millisight annotate photo.jpg -o mug.mask.png
    """
    from millisight.viz import open_browser
    from millisight.viz.annotator import Annotation, AnnotatorServer, open_picture, segmenters_for

    check_sam_device(device, (method, None if model is None else "sam"))
    subject = open_picture(image, other_band=other_band)
    if published and output is not None:
        raise InputError("--published and --output cannot be combined: pass one of them")
    mask_path = mask_in_dataset(subject) if published else output or _beside(subject)
    segmenters = segmenters_for(subject, sam=model or ("vit-b" if method == "sam" else None), device=device)
    annotation = Annotation(subject, mask_path, segmenters=segmenters, method=method, depth_range=_depths(depths))
    check_outputs(annotation.mask_path, annotation.prompts_path, source=image)
    with AnnotatorServer(annotation, port) as server:
        try:
            say(f"annotate {image} at {server.address}")
            sys.stdout.flush()
            opened = not no_browser and open_browser(server.address)
            ways = ("close the page or press Ctrl-C to stop", "open it in a browser; press Ctrl-C to stop")
            say(ways[0] if opened else ways[1])
            sys.stdout.flush()
            server.wait(until_closed=opened)
            say("the page was closed")
        except Interrupted:  # the usual way to end
            say("ended")
    if annotation.saved_now:
        for path in (annotation.mask_path, annotation.prompts_path):
            say(f"wrote {path}")
    if annotation.unsaved:
        complain("the last points were not saved")


def _depths(text: str) -> tuple[float, float]:
    """Two lengths [m]."""
    near, colon, far = text.partition(":")
    if not colon:
        raise InputError(f"--depths is {text!r}; expected two lengths such as 20cm:50cm")
    return length(near, option="--depths"), length(far, option="--depths")


def mask_in_dataset(subject: "OpenedPicture") -> Path:
    """Where in its dataset the mask of a picture belongs, as a file of the picture's kind.

    Raises
    ------
    InputError
        The picture is of no dataset, or a mask is there that `annotate` did not make.
    """
    from millisight.viz.annotator import prompts_beside

    path, suffix = subject.path, subject.path.suffix
    if subject.is_radar and path.name.startswith("processed_image"):
        target = path.with_name(path.name.replace("processed_image", "radar_masks", 1))
    elif subject.frame is not None and path.parent.name == "camera" and path.parents[1].name == "unprocessed":
        target = path.parents[2] / "processed" / "camera" / f"camera_masks{suffix}"
    else:
        raise InputError(
            f"--published needs a processed_image* or a camera's continuous* of a dataset; {printable(path)} is neither"
        )
    if target.exists() and not prompts_beside(target).exists():
        raise InputError(f"{printable(target)} exists, and was not made by millisight annotate; choose with --output")
    make_folder(target.parent)
    return target


def _beside(subject: "OpenedPicture") -> Path:
    """The mask's path where none is given."""
    suffix = ".mask.h5" if subject.is_radar else ".mask.png"
    parts = Path(subject.origin).parts
    if len(parts) > 1:  # in a dataset, whose folders are no place for it
        passed_over = ("robot_collected", "processed", "unprocessed", "radars")
        name = ".".join(part for part in parts[:-1] if part not in passed_over)
        return Path(name + subject.path.stem.removeprefix("processed_image").removeprefix("continuous") + suffix)
    return subject.path.with_name(subject.path.name.removesuffix(subject.path.suffix).removesuffix(".image") + suffix)
