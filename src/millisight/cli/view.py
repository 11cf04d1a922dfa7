"""`millisight view`: show images in the browser."""

import math
import signal
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from millisight.cli import interrupts
from millisight.cli.console import length, progress, say
from millisight.cli.outputs import check_outputs
from millisight.core import colormap_in_use, files_under, printable
from millisight.core.errors import FileError, InputError


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Images, captures, robot logs, masks, meshes and scenes (HDF5 of millisight); processed_image*.pkl "
            "and radar_masks*.pkl of the published dataset, or a folder of it; mesh files (STL, OBJ, PLY, OFF, GLB).",
        ),
    ],
    threshold: Annotated[float, typer.Option(help="Hide weaker voxels [dB relative to the maximum].")] = -15.0,
    range_db: Annotated[float, typer.Option("--range", help="Dynamic range of the colours [dB].")] = 30.0,
    colormap: Annotated[
        str | None, typer.Option(help=f"Colour map, such as viridis or jet. [default: {colormap_in_use()}]")
    ] = None,
    slices: Annotated[bool, typer.Option("--slices", help="Start with three slices instead of points.")] = False,
    volume: Annotated[bool, typer.Option("--volume", help="Start with all slices, semi-transparent.")] = False,
    common: Annotated[
        bool, typer.Option("--common-scale", help="Scale all images to the maximum of the strongest.")
    ] = False,
    alpha: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="A1 A2",
            help="Initial weights of the specular and the edge image of one simulation; a slider changes them.",
        ),
    ] = (0.5, 0.5),
    depth: Annotated[
        str | None,
        typer.Option(
            metavar="LOW:HIGH", help="Depth range along z to show, such as -40cm:-27cm; an end may be left out."
        ),
    ] = None,
    clip_x: Annotated[str | None, typer.Option(metavar="LOW:HIGH", help="Range along x to show.")] = None,
    clip_y: Annotated[str | None, typer.Option(metavar="LOW:HIGH", help="Range along y to show.")] = None,
    clutter: Annotated[
        str,
        typer.Option(
            help="auto: if there is a lid over the objects, open under it, its echo taken off. lid: likewise, in large "
            "images too and if it is less sure. none: open with everything in view."
        ),
    ] = "auto",
    opacity: Annotated[float, typer.Option(help="Opacity of slices, volume and meshes, from 0 to 1.")] = 1.0,
    separate: Annotated[bool, typer.Option("--separate", help="Show specular and edge images side by side.")] = False,
    unit: Annotated[str | None, typer.Option(help="Unit of mesh files: m, cm, mm or in.")] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets other machines in that know the printed address.")
    ] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="[default: 8080, or the next free one]")] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open a browser window.")] = False,
    screenshot: Annotated[
        Path | None,
        typer.Option(help="Write a screenshot (PNG) and exit; needs Chromium or Chrome, but no display."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(help="Write one HTML file that opens in any browser without network, and exit."),
    ] = None,
) -> None:
    """Show images in the browser as points, slices or a volume. Several images stand side by side and rotate together.

    Drag to rotate, scroll to zoom, drag with the right button to pan; press ? for the keys. The panel sets threshold,
    colours, slices, limits and weights, takes a screenshot and saves a page to share. The page's address keeps the
    view. Press Ctrl-C to stop. Without a display, use --no-browser
    and `ssh -L 8080:localhost:8080`, or write --screenshot or --html.

    Example: millisight view mug.image.h5 mug.capture.h5 mug.stl

    Example: millisight view exp1/los/processed/radars/77_ghz/*.pkl exp1/nlos/processed/radars/77_ghz/*.pkl

    Example: millisight view processed_image_specular.pkl processed_image_edges.pkl --alpha 0.7 0.3

    Example: millisight view scan.image.h5 --depth=:-27cm --slices

    Example: millisight view mug.image.h5 --slices --html mug.html --screenshot mug.png
    """
    read = [one for path in files for one in _files_of(path)]
    check_outputs(screenshot, html, others=read)
    for option, path, suffix in (("--screenshot", screenshot, ".png"), ("--html", html, ".html")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} is {path}; expected a name that ends in {suffix}")
    limits = _limits(depth, clip_x, clip_y)
    from millisight.viz.viewer import Viewer, first_settings, gather, note_on

    with progress("read", compiles=False):
        contents = gather(
            read, combine=not separate, alpha=alpha, unit=unit, clutter=clutter,
        )  # fmt: skip
    if alpha != (0.5, 0.5) and not any(exhibit.pair for exhibit in contents.exhibits):
        raise InputError(
            "--alpha weights the specular and the edge image of one simulation; pass both, without --separate"
        )
    settings = first_settings(
        contents, points=not (slices or volume), slices=slices, volume=volume, threshold_db=threshold,
        range_db=range_db, common=common, colormap=colormap or colormap_in_use(),
        opacity=opacity, **limits,
    )  # fmt: skip
    for exhibit in contents.exhibits:
        say(f"showing {exhibit.title}")
    if hidden := note_on(settings, contents.exhibits)["note"]:
        say(f"note: {hidden}" + ("" if limits else " --clutter none opens with everything in view"))
    for note in contents.notes:
        say(f"note: {note}")
    if html is not None:
        from millisight.viz.viewer import write_page

        write_page(html, contents, settings)
        say(f"wrote {html}: {html.stat().st_size / 1e6:.1f} MB, opens in any browser")
    if html is not None and screenshot is None:
        return
    with Viewer(contents, settings, host=host, port=port) as viewer:
        if screenshot is not None:
            viewer.screenshot(screenshot)
            say(f"wrote {screenshot}")
            return
        _serve(viewer.url, no_browser)


def _limits(depth: str | None, clip_x: str | None, clip_y: str | None) -> dict[str, tuple[float, float]]:
    """The settings that the ranges LOW:HIGH name."""
    found = {}
    for option, name, text in (
        ("--depth", "clip_z", depth),
        ("--clip-x", "clip_x", clip_x),
        ("--clip-y", "clip_y", clip_y),
    ):
        if text is None:
            continue
        low, colon, high = text.partition(":")
        if not colon or not (low or high):
            raise InputError(f"{option} is {text!r}; expected LOW:HIGH, such as -40cm:-27cm, -40cm: or :-27cm")
        ends = (length(low, option=option) if low else -math.inf, length(high, option=option) if high else math.inf)
        if not ends[0] < ends[1]:
            raise InputError(f"{option} is {text!r}; expected the lower end first")
        found[name] = ends
    return found


def _files_of(path: Path) -> list[Path]:
    """The path itself; of a folder of the published layout its images and masks."""
    if not path.is_dir():
        return [path]
    from millisight.io.mito import IMAGE, RADAR_MASK, kind_of

    files = [file for file in files_under(path) if not file.name.startswith(".")]
    found = [file for file in files if (kind_of("radars", file.name) or ("",))[0] in (IMAGE, RADAR_MASK)]
    if not found:
        raise FileError(f"{printable(path)} holds no processed_image*.pkl of the published layout; pass files")
    return found


def _serve(url: str, no_browser: bool) -> None:
    """Print the viewer's address and wait for Ctrl-C."""
    from millisight.viz import open_browser

    try:
        opened = not no_browser and open_browser(url)
        say(f"viewer: {url}" + ("" if opened else " (open it in a browser)"))
        say("press Ctrl-C to stop")
        sys.stdout.flush()
        while True:
            time.sleep(3600)
    except interrupts.Interrupted:
        if interrupts.received() != signal.SIGINT:
            raise
        say("viewer closed")
