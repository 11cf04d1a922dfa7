"""`millisight annotate`: tell a segmenter by clicks what belongs to the object, and save mask and points."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import check_outputs, say
from millisight.cli.interrupts import Interrupted
from millisight.cli.options import SamDevice

if TYPE_CHECKING:
    from millisight.viz.annotator import Subject


def annotate(
    image: Annotated[
        Path,
        typer.Argument(
            metavar="IMAGE",
            help="What to annotate: an image of `millisight image` (HDF5); processed_image*.pkl or a camera's "
            "continuous*.pkl of the published dataset; a photograph (PNG, JPEG).",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Mask to write: HDF5 of a radar image, PNG of a photograph; the points go beside it, into "
            "NAME.prompts.json. [default: NAME.mask.h5 or NAME.mask.png beside the image; here for files of a dataset]",
        ),
    ] = None,
    other_band: Annotated[
        Path | None,
        typer.Option(help="The same scene at the radar's other frequency, for the segmenter that looks at both."),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="Segmenter to begin with: wave, classical or sam. [default: the first that can work]"),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help="Offer sam, with this model: vit-b, vit-l, vit-h, sam2-tiny or sam2-large, which are downloaded; or a "
            "folder with a model. [default: sam is not offered; vit-b with --method sam]"
        ),
    ] = None,
    device: SamDevice = "cpu",
    port: Annotated[
        int, typer.Option(min=0, max=65535, show_default=False, help="To serve the page at. [default: a free one]")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Serve the page until Ctrl-C, and open no window.")
    ] = False,
) -> None:
    """Open a page on which clicks mark what belongs to the object (left) and what does not (right).

    The mask follows every click. An earlier annotation of the same picture is gone on from. The command ends when the
    page is closed, or with Ctrl-C.

    Example: millisight annotate mug.image.h5

    Example: millisight annotate photo.jpg -o mug.mask.png
    """
    from millisight.viz.annotator import AnnotatorServer, Session, open_subject, segmenters_for
    from millisight.viz.local_page import open_browser

    subject = open_subject(image, other_band=other_band)
    mask_path = output or _beside(subject)
    segmenters = segmenters_for(subject, sam=model or ("vit-b" if method == "sam" else None), device=device)
    session = Session(subject, mask_path, segmenters=segmenters, method=method)
    check_outputs(session.mask_path, session.prompts_path, source=image)
    with AnnotatorServer(session, port) as server:
        try:
            say(f"annotate {image} at {server.address}")
            sys.stdout.flush()
            opened = not no_browser and open_browser(server.address)
            ways = ("close the page to end, or press Ctrl-C here", "open it in a browser; Ctrl-C here ends")
            say(ways[0] if opened else ways[1])
            sys.stdout.flush()
            server.wait(until_closed=opened)
            say("the page was closed")
        except Interrupted:  # the usual way to end
            say("ended")
    if session.saved_now:
        for path in (session.mask_path, session.prompts_path):
            say(f"wrote {path}")
    if session.unsaved:
        typer.echo("millisight: the last points were not saved", err=True)


def _beside(subject: "Subject") -> Path:
    """The mask's path where none is given."""
    suffix = ".mask.h5" if subject.is_radar else ".mask.png"
    parts = Path(subject.origin).parts
    if len(parts) > 1:  # in a dataset, whose folders are no place for it
        passed_over = ("robot_collected", "processed", "unprocessed", "radars")
        name = ".".join(part for part in parts[:-1] if part not in passed_over)
        return Path(name + subject.path.stem.removeprefix("processed_image").removeprefix("continuous") + suffix)
    return subject.path.with_name(subject.path.name.removesuffix(subject.path.suffix).removesuffix(".image") + suffix)
