"""`millisight view`: images in the browser, to turn, slice and compare."""

import signal
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from millisight.cli import interrupts
from millisight.cli.console import check_outputs, progress, say
from millisight.errors import InputError


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Images, and what belongs around them: captures, robot logs, masks, meshes and scenes (HDF5 of "
            "millisight); processed_image*.pkl and radar_masks*.pkl of the published dataset; mesh files (STL, OBJ, "
            "PLY, OFF, GLB). What a file is, its content tells.",
        ),
    ],
    threshold: Annotated[float, typer.Option(help="Hide what is weaker [dB under the maximum].")] = -15.0,
    range_db: Annotated[float, typer.Option("--range", help="How far down the colours reach [dB].")] = 30.0,
    colormap: Annotated[str, typer.Option(help="Matplotlib's name, such as inferno, viridis or jet.")] = "inferno",
    slices: Annotated[bool, typer.Option("--slices", help="Begin with three planes instead of points.")] = False,
    volume: Annotated[bool, typer.Option("--volume", help="Begin with all slices, half transparent.")] = False,
    common: Annotated[
        bool, typer.Option("--common-scale", help="dB under the strongest image's maximum, not each one's own.")
    ] = False,
    alpha: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="A1 A2",
            help="Weights at first of the specular and the edge image of one simulation, which become one picture "
            "with a slider.",
        ),
    ] = (0.5, 0.5),
    separate: Annotated[
        bool, typer.Option("--separate", help="Show specular and edge images side by side instead.")
    ] = False,
    unit: Annotated[str | None, typer.Option(help="Unit of mesh files: m, cm, mm or in.")] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen at; 0.0.0.0 lets other machines look, without a password.")
    ] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="[default: 8080, or the next free one]")] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Serve, and open no window.")] = False,
    screenshot: Annotated[
        Path | None,
        typer.Option(help="Write a picture (PNG) of the start view and end; needs Chromium or Chrome, but no display."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(help="Write one HTML file that opens anywhere, without network or millisight, and end."),
    ] = None,
) -> None:
    """Look at images in the browser: as points, slices or volume, several side by side, all turned alike.

    Drag turns, the wheel zooms, the right button shifts. The panel has threshold, colours, slices, weights, and
    buttons for a screenshot and for a page to share. Ctrl-C ends it. On a machine without a display, pass
    --no-browser and reach it by `ssh -L 8080:localhost:8080`, or write --screenshot or --html.

    Example: millisight view mug.image.h5 mug.capture.h5 mug.stl

    Example: millisight view exp1/los/processed/radars/77_ghz/*.pkl exp1/nlos/processed/radars/77_ghz/*.pkl

    Example: millisight view processed_image_specular.pkl processed_image_edges.pkl --alpha 0.7 0.3

    Example: millisight view mug.image.h5 --slices --html mug.html --screenshot mug.png
    """
    check_outputs(screenshot, html)
    for option, path, suffix in (("--screenshot", screenshot, ".png"), ("--html", html, ".html")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{option} is {path}; expected a name that ends in {suffix}")
    from millisight.viz.viewer.contents import gather
    from millisight.viz.viewer.session import Viewer, first_settings

    with progress("read", compiles=False):
        contents = gather(files, combine=not separate, alpha=alpha, unit=unit)
    if alpha != (0.5, 0.5) and not any(exhibit.pair for exhibit in contents.exhibits):
        raise InputError("--alpha weighs the specular and the edge image of one simulation; give both, not --separate")
    settings = first_settings(
        contents, points=not (slices or volume), slices=slices, volume=volume, threshold_db=threshold,
        range_db=range_db, colormap=colormap, common=common,
    )  # fmt: skip
    for exhibit in contents.exhibits:
        say(f"showing {exhibit.title}")
    for note in contents.notes:
        say(f"note: {note}")
    if html is not None:
        from millisight.viz.viewer.share import write_page

        write_page(html, contents, settings)
        say(f"wrote {html}: {html.stat().st_size / 1e6:.1f} MB, opens from the disk in any browser")
    if html is not None and screenshot is None:
        return
    with Viewer(contents, settings, host=host, port=port) as viewer:
        if screenshot is not None:
            viewer.screenshot(screenshot)
            say(f"wrote {screenshot}")
            return
        _serve(viewer.url, no_browser)


def _serve(url: str, no_browser: bool) -> None:
    """Tell where the viewer is, and wait for Ctrl-C."""
    from millisight.viz.local_page import open_browser

    try:
        opened = not no_browser and open_browser(url)
        say(f"viewer: {url}" + ("" if opened else " (open it in a browser)"))
        say("Ctrl-C ends it")
        sys.stdout.flush()
        while True:
            time.sleep(3600)
    except interrupts.Interrupted:
        if interrupts.received() != signal.SIGINT:
            raise
        say("viewer closed")
