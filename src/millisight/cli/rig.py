"""`millisight rig`: check real devices, move the arm without radar, and emulate devices; and a scan with them."""

import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import Commands, answer, duration, end_with_failures, progress, say
from millisight.cli.outputs import check_outputs
from millisight.cli.scanning import published_grids, scan, scan_live
from millisight.core import check_folder, make_folder, read_toml, turn_between_deg, write_text
from millisight.core.errors import FileError, InputError, MillisightError

if TYPE_CHECKING:
    from millisight.data import VoxelGrid
    from millisight.rig import Lab, RowWriter

app: typer.Typer = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Work with real devices, or with emulators of them. A rig file names an arm or a gantry, radars and a camera; "
    "emulators need no hardware.\n\nStart with: millisight rig emulate examples/worlds/mug.toml -o rig.toml",
)

RigPath = Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: devices, mounts, limits and scan.")]


@app.command()
def check(rig: RigPath) -> None:
    """Talk to each device. Prints how it is, what is wrong, and what to do.

    Exit code 1 if a device cannot be used.

    Example: millisight rig check rig.toml
    """
    from millisight.rig import Lab

    lab = Lab.from_toml(rig)
    say(_scan_of(lab))
    failures = []
    for report in lab.check():
        answer(f"{report.name}: {'ready' if report.error is None else 'not ready'}")
        for line in report.lines:
            say(f"warning: {report.name}: {line[9:]}" if line.startswith("warning: ") else f"  {line}")
        if report.error is not None:
            failures.append(f"{report.name}: {report.error}")
    end_with_failures(failures)


@app.command()
def move(
    rig: RigPath,
    rows: Annotated[
        int | None, typer.Option(min=1, help="Number of rows to move over. [default: all]", show_default=False)
    ] = None,
) -> None:
    """Move the arm over the rows of the scan, with the radars off.

    Example: millisight rig move rig.toml --rows 2
    """
    from millisight.rig import Lab, sweep_rows

    lab = Lab.from_toml(rig)
    say(_scan_of(lab))
    lab.arm.open()
    try:
        with progress("move", compiles=False) as report:
            sweep_rows(lab.arm, lab.plan.rows[:rows], progress=report)
    finally:
        lab.arm.close()


@app.command()
def photo(
    rig: RigPath,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="Folder of the pictures, made where it is missing.")
    ] = Path("board"),
) -> None:
    """Take one picture where the arm is now, and save it with the pose. `millisight calibrate camera` needs several.

    Nothing is moved. Turn the arm by its pendant or by hand between calls. The radars may be off.

    Example: millisight rig photo rig.toml -o board
    """
    from millisight.calibration import POSES_NAME, add_picture, read_poses
    from millisight.rig import Lab
    from millisight.rig.drivers import GrblGantry

    lab = Lab.from_toml(rig)
    if isinstance(lab.arm, GrblGantry):
        raise InputError(
            "a gantry does not turn the camera, so that pictures of a board do not tell its offset; measure offset and "
            "tilt_deg by hand"
        )
    check_folder(output)
    before = read_poses(output).pictures if (output / POSES_NAME).exists() else ()
    try:
        lab.arm.open()
        if lab.camera is not None:
            lab.camera.open()
        frame, pose = lab.photo()
    finally:
        if lab.camera is not None:
            lab.camera.close()
        lab.arm.close()
    made = add_picture(output, frame.rgb, pose.position, pose.orientation, frame.intrinsics)
    x, y, z = pose.position
    say(f"wrote {output / made.file}, radar frame at {x:.4f}, {y:.4f}, {z:.4f} m")
    if before:
        turns = turn_between_deg([one.orientation for one in before], pose.orientation)
        near = int(turns.argmin())
        say(f"turned by {turns[near]:.1f} degrees from {before[near].file}, the nearest")
        if turns[near] < 1:
            say("warning: a picture of the same turn tells little; turn the arm by 20 to 40 degrees between pictures")


@app.command()
def script(
    rig: RigPath,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.lua", help="Script for mmWave Studio to write.")
    ] = Path("radar.lua"),
    start_file: Annotated[
        str | None,
        typer.Option(
            metavar="PATH",
            help="The rig file's start_file, as the computer with mmWave Studio calls it. [default: as the rig file]",
        ),
    ] = None,
) -> None:
    """Write the Lua script with which mmWave Studio runs a radar. The radar is one that has start_file: an xWR12xx or
    xWR14xx board.

    Example: millisight rig script rig.toml -o radar.lua
    """
    from millisight.rig import Lab
    from millisight.rig.drivers import Dca1000, studio_script

    check_outputs(output, source=rig)
    lab = Lab.from_toml(rig)
    found = [radar for radar in lab.radars if isinstance(radar, Dca1000) and radar.settings.start_file]
    if len(found) != 1:
        raise InputError(f"{rig} has {len(found)} radars with start_file; expected one")
    settings = found[0].settings
    if settings.profile is None:
        raise InputError(f"{rig}: {settings.name} has no profile; add the .cfg file that the script is to be made from")
    text = studio_script(
        settings.path(settings.profile),
        frames=lab.plan.frames(found[0].frame_period),
        start_file=start_file or str(settings.path(str(settings.start_file)).absolute()),
        lanes=4 if settings.order == "four-lane" else 2,
    )
    write_text(output, text)
    say(f"wrote {output}; run it in mmWave Studio, then run millisight collect")


@app.command()
def emulate(
    world: Annotated[Path, typer.Argument(metavar="WORLD.toml", help="World that the emulated devices share.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="RIG.toml", help="Rig file that leads to the emulators, to write.")
    ] = Path("rig.toml"),
    arm: Annotated[str, typer.Option(help="What moves the radar: ur, or grbl for a gantry.")] = "ur",
    loss: Annotated[float, typer.Option(help="Share of the radar's packets that get lost.")] = 0.0,
    disorder: Annotated[float, typer.Option(help="Share of the radar's packets that come late.")] = 0.0,
    duplicates: Annotated[float, typer.Option(help="Share of the radar's packets that come twice.")] = 0.0,
    seconds: Annotated[
        float | None,
        typer.Option(min=0, help="End after this many seconds. [default: at Ctrl-C]", show_default=False),
    ] = None,
    collect: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Scan with the emulators at once, into this dataset, and end with the scan."
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="With --collect: show the images in the browser while they grow.")
    ] = False,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="With --live: do not open a browser window, print the address.")
    ] = False,
) -> None:
    """Start emulators of an arm, and of a TI radar with its DCA1000. Writes the rig file that leads to them.

    They speak the devices' protocols over real sockets and a serial line of this computer, and share one virtual world.
    Scan with them in one go:

    millisight rig emulate world.toml --collect data --live

    Or leave this running, and scan in another terminal:

    millisight rig emulate world.toml -o rig.toml

    millisight rig check rig.toml && millisight collect rig.toml -o data
    """
    from millisight.rig.emulators import EmulatedLab, PacketFaults, files_of_lab
    from millisight.rig.virtual import World

    files = files_of_lab(output)
    check_outputs(*files, source=world)
    wrote = " and ".join(map(str, files))
    if collect is not None and seconds is not None:
        raise InputError("the emulators end with the scan; leave --seconds or --collect out")
    if live and collect is None:
        raise InputError("--live shows a scan; add --collect FOLDER")
    described = World.from_toml(world)
    faults = PacketFaults(loss=loss, disorder=disorder, duplicates=duplicates, seed=described.seed)
    with progress("build the world"):
        lab = EmulatedLab(described, faults=faults, arm=arm)
    with lab:
        path = lab.write(output.absolute().parent, output.name)
        if collect is not None:
            say(f"wrote {wrote}; the emulators run until the scan has ended")
            _collect_beside(path, collect, ["--live"] * live + ["--no-browser"] * no_browser)
            return
        say(f"wrote {wrote}; the emulators run until {'Ctrl-C' if seconds is None else f'{seconds:g} s have passed'}")
        say(f"in another terminal: millisight collect {path}")
        until = None if seconds is None else time.monotonic() + seconds
        while until is None or time.monotonic() < until:
            time.sleep(0.1)


def _collect_beside(path: Path, folder: Path, options: list[str]) -> None:
    """Scan by a rig file in a process of its own, as if the devices were elsewhere."""
    words = ["collect", str(path), "-o", str(folder), *options]
    done = subprocess.run([sys.executable, "-P", "-m", "millisight.cli.main", *words], check=False)
    if done.returncode:
        raise typer.Exit(done.returncode)


def is_rig_file(path: Path) -> bool:
    """Whether a TOML file describes a rig, not a world: its arm has a driver."""
    arm = read_toml(path, "a world or a rig").get("arm")
    return isinstance(arm, dict) and "driver" in arm


def collect_with_rig(
    path: Path, output: Path, experiment: int, *, hdf5: bool, dry_run: bool, live: bool, browser: bool
) -> None:
    """Scan with the devices of a rig file; see `collect`."""
    from millisight.rig import Lab

    lab = Lab.from_toml(path)
    writer = _writer(lab, output, experiment, hdf5=hdf5)
    folder = output / writer.path.relative_to(output.absolute())
    if folder.exists():
        if not dry_run:
            writer.clear()
        raise FileError(f"{folder} already exists; choose another --experiment, or remove it")
    say(_scan_of(lab))
    for radar in lab.radars:
        say(f"{radar.name}: {lab.plan.frames(radar.frame_period)} frames per row")
    if live and lab.file.image is None and lab.file.layout != "published":
        raise InputError(f"{path}: --live needs the voxels to image; add a table [image] with lower, upper and spacing")
    if dry_run:
        return
    make_folder(output)
    try:
        with lab:
            if live:
                scan_live(
                    lab, writer, title=lab.file.object, grids=_grids(lab), origin=lab.file.origin, browser=browser
                )  # fmt: skip
            else:
                scan(lab, writer)
    except MillisightError:
        if writer.rows_done:
            say(
                f"{writer.rows_done} of {len(lab.plan.rows)} rows are kept; run the same command again to go on after "
                "them"
            )
        raise
    say(f"wrote {folder}")


def _writer(lab: "Lab", output: Path, experiment: int, *, hdf5: bool) -> "RowWriter":
    """What writes the scan, in the rig file's layout."""
    from millisight.io.mito import experiment_folder
    from millisight.rig import CaptureWriter, PublishedWriter, scan_info

    file = lab.file
    x, y, z = (round(angle) for angle in file.rotate_deg)
    folder = experiment_folder(output, file.object, (x, y, z), experiment, file.sight)  # which checks the names
    if file.layout == "captures":
        told = {name: getattr(file, name) for name in ("object", "sight", "background")}
        return CaptureWriter(
            output / f"{file.object}.exp{experiment}", origin=file.origin, keep=lab.plan,
            grid=None if file.image is None else file.image.box, metadata=told | {"rotate_deg": [x, y, z]},
        )  # fmt: skip
    info = scan_info(lab.radars, file.background)
    return PublishedWriter(folder, info=info, hdf5=hdf5, origin=file.origin, keep=lab.plan)


def _grids(lab: "Lab") -> "dict[str, VoxelGrid]":
    """The voxels of the live images."""
    if lab.file.image is None:
        return published_grids(lab, lab.file.background)
    return dict.fromkeys((radar.name for radar in lab.radars), lab.file.image.grid)


def _scan_of(lab: "Lab") -> str:
    scan, limits, plan = lab.file.scan, lab.arm.limits, lab.plan
    return (
        f"scan: {len(plan.rows)} rows of {scan.size[1] * 100:g} cm, {scan.row_spacing * 1000:g} mm apart, at "
        f"{limits.speed:g} m/s, about {duration(len(plan.rows) * (plan.row_time + limits.duration(scan.row_spacing)))}"
    )
