"""`millisight collect`: run a scan with a rig, and write it in the published layout."""

import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import duration, progress, say, say_sampling
from millisight.cli.outputs import check_outputs
from millisight.cli.rig import collect_with_rig, is_rig_file
from millisight.cli.scanning import published_grids, scan, scan_live
from millisight.core import box, make_folder, printable
from millisight.core.errors import FileError, InputError, UnknownNameError

if TYPE_CHECKING:
    from millisight.imaging import Sampling
    from millisight.rig.virtual import VirtualRig

RIGS = ("virtual",)
"""Rigs that need no file; a real one has a rig file."""
_ROOM = 4  # over the raw files' size: rows as they come are twice as large, and captures of our own come on top


def collect(
    world: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.toml",
            help="World to scan with a virtual rig: objects, surroundings, devices and their errors; or a rig file, to "
            "scan with real devices (TOML).",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Dataset to add the experiment to, a folder.")] = Path(
        "data"
    ),
    rig: Annotated[
        str | None,
        typer.Option(
            help="Rig to scan a world with; virtual: arm, radars and camera are simulated. [default: virtual]"
        ),
    ] = None,
    experiment: Annotated[int, typer.Option(min=0, help="Experiment number N; its folder is exp<N>.")] = 1,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Folder for the true path and the exact masks, which only a virtual rig knows."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Write a picture of the world: from above, from the side, by its camera (PNG, SVG, PDF)."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the file, print what the scan would cost, and do not scan.")
    ] = False,
    hdf5: Annotated[bool, typer.Option(help="Also write captures as HDF5, beside the raw files.")] = True,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show the images in the browser while they grow, and end the scan there when they are good."
        ),
    ] = False,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="With --live: do not open a browser window, print the address.")
    ] = False,
) -> None:
    """Scan with a rig, real or virtual. Writes raw radar files, robot log and camera picture in the published layout.

    A rig file names real devices: see docs/how-to/rig.md, and millisight rig check. A scan with real devices that fails
    goes on at its row when the same command is run again.

    Examples:

    millisight collect --rig virtual world.toml --dry-run --plot world.png

    millisight collect --rig virtual world.toml -o data && millisight image data --clock apply

    millisight collect world.toml --live

    millisight collect rig.toml -o data

    The keys of WORLD.toml are explained in docs/how-to/virtual-rig.md. One line is enough:

    objects = [{ object = "mug" }]
    """
    from millisight.io.mito import BASE_ORIGIN
    from millisight.rig import PublishedWriter
    from millisight.rig.virtual import (
        VirtualRig,
        World,
        build_layout,
        check_truth,
        experiment_folder_of,
        experiment_info,
        write_truth,
    )

    if rig is not None and rig not in RIGS:
        raise UnknownNameError("rig", rig, RIGS, advice="Real devices are named in a rig file: see docs/how-to/rig.md.")
    if is_rig_file(world):
        if rig is not None or truth is not None or plot is not None:
            raise InputError(f"{world} is a rig file; --rig, --truth and --plot are for worlds")
        collect_with_rig(
            world, output, experiment, hdf5=hdf5, dry_run=dry_run, live=live, browser=not no_browser
        )  # fmt: skip
        return
    check_outputs(figures=(plot,), source=world)
    described = World.from_toml(world)
    with progress("build the world"):
        try:
            layout = build_layout(described)
        except InputError as error:
            raise error.at(printable(world)) from error
    virtual = VirtualRig(described, layout=layout)
    if truth is not None:
        check_truth(virtual, truth)
    folder = experiment_folder_of(described, output, experiment)
    if not dry_run and folder.exists():
        PublishedWriter(folder, info={}).clear()
        raise FileError(f"{folder} already exists; choose another --experiment, or remove it")
    for line in _summary(virtual):
        say(line)
    for number, radar in enumerate(virtual.radars):
        with progress(f"sampling of {radar.name}"):
            sampled = _sampled(virtual, number)
        say_sampling(sampled, f"sampling of {radar.name}")
    if plot is not None:
        _plot(virtual, plot)
        say(f"wrote {plot}")
    with progress("estimate the cost of the scan"):
        seconds = virtual.estimated_seconds()
    size = virtual.estimated_bytes()
    say(f"estimate: {duration(seconds)} on this machine, {size / 1e6:.0f} MB in {folder}")
    if dry_run:
        return
    make_folder(output)
    if shutil.disk_usage(output).free < 2 * size:
        raise FileError(
            f"{output} has {shutil.disk_usage(output).free / 1e6:.0f} MB of free disk space; the scan needs "
            f"{2 * size / 1e6:.0f} MB"
        )
    last = None if truth is None else partial(write_truth, virtual, truth)
    writer = PublishedWriter(folder, info=experiment_info(described), hdf5=hdf5, last=last)
    if live:
        scan_live(
            virtual, writer, title=", ".join(item.name for item in layout.objects) or "the empty scene",
            grids=published_grids(virtual, described.support.kind), origin=BASE_ORIGIN, browser=not no_browser,
        )  # fmt: skip
    else:
        scan(virtual, writer)
    say(f"wrote {folder}")
    if truth is not None:
        say(f"wrote {truth}: the true path and exact masks")


def _summary(rig: "VirtualRig") -> list[str]:
    """What there is, and what the devices will do."""
    world, layout = rig.world, rig.layout
    lines = [f"object: {item.name}, {box(*item.bounds)}" for item in layout.objects]
    lines = lines or ["object: none, the empty scene"]
    stacks = [panel.stack for panel in layout.panels]
    hides = [f"{stacks.count(stack)} panels of {stack}" for stack in sorted(set(stacks))]
    support = {"tripod": "on a tripod", "styrofoam": "on a block of styrofoam"}[world.support.kind]
    lines.append(f"{support}, {' and '.join(hides) if hides else 'in line of sight'}")
    scan, arm = world.scan, world.arm
    minutes = len(rig.plan.rows) * rig.plan.row_time
    lines.append(
        f"scan: {len(rig.plan.rows)} rows of {scan.size[1] * 100:g} cm, {scan.row_spacing * 1000:g} mm apart, at "
        f"{arm.speed:g} m/s, which takes the arm {duration(minutes)}"
    )
    for radar in rig.radars:
        lines.append(f"{radar.name}: {rig.plan.frames(radar.frame_period)} frames per row")
    return lines


def _sampled(rig: "VirtualRig", number: int) -> "Sampling":
    """The sampling of the scan as planned, for the published image grid."""
    import numpy as np

    from millisight.data import Trajectory
    from millisight.imaging import sampling
    from millisight.io.mito import BASE_ORIGIN
    from millisight.rig.virtual import image_grid

    radar, positions = rig.radars[number], []
    for start, end in rig.plan.rows:
        way = end.position - start.position
        length = float(np.linalg.norm(way))
        along = np.arange(0, length, rig.world.arm.speed * radar.frame_period) / length
        positions.append(start.position + along[:, None] * way)
    placed = np.concatenate(positions) - BASE_ORIGIN + radar.mount
    path = Trajectory(times=np.arange(len(placed), dtype=float), positions=placed)
    bounds = np.array([item.bounds for item in rig.layout.objects])
    objects = None if not len(bounds) else np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    return sampling(path, image_grid(rig.world, radar.name), radar=radar.radar, reflectors=objects)


def _plot(rig: "VirtualRig", path: Path) -> None:
    import numpy as np

    from millisight.rig.virtual import object_pixels, render
    from millisight.viz import plot_world, save_figure

    pose = rig.photo_pose
    frame = render(rig.layout, pose, rig.world.camera, np.random.default_rng(rig.world.seed))
    masks = [object_pixels(rig.layout, pose, item.number) for item in rig.layout.objects]
    save_figure(plot_world(rig.layout, frame, masks), path)
