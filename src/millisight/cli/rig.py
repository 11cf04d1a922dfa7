"""`millisight rig`: check real devices, move the arm without radar, and emulate devices; and a scan with them."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import Commands, answer, check_outputs, duration, end_with_failures, progress, say
from millisight.cli.scanning import scan, scan_live
from millisight.core import make_folder, read_toml, write_text
from millisight.core.errors import FileError, InputError, MillisightError

if TYPE_CHECKING:
    from millisight.rig import Lab

app: typer.Typer = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Work with real devices: an arm or a gantry, radars and a camera, as a rig file names them; or with emulators "
    "of them, which need no hardware.\n\nStart with: millisight rig emulate examples/worlds/mug.toml -o rig.toml",
)

RigPath = Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: devices, mounts, limits and scan.")]


@app.command()
def check(rig: RigPath) -> None:
    """Talk to each device, and print how it is, what is wrong, and what to do.

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
    """Move the arm over the rows of the scan, with the radars off: a dry run.

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
    """Write the Lua script with which mmWave Studio runs a radar that has start_file: xWR12xx and xWR14xx boards.

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
) -> None:
    """Start emulators of an arm, and of a TI radar with its DCA1000, and write the rig file that leads to them.

    They speak the devices' protocols over real sockets and a serial line of this computer, and share one virtual world.
    Leave this running, and scan in another terminal:

    millisight rig emulate world.toml -o rig.toml

    millisight rig check rig.toml && millisight collect rig.toml -o data
    """
    from millisight.rig.emulators import EmulatedLab, PacketFaults
    from millisight.rig.virtual import World

    check_outputs(output, source=world)
    described = World.from_toml(world)
    faults = PacketFaults(loss=loss, disorder=disorder, duplicates=duplicates, seed=described.seed)
    with progress("build the world"):
        lab = EmulatedLab(described, faults=faults, arm=arm)
    with lab:
        path = lab.write(output.absolute().parent, output.name)
        say(f"wrote {output}; the emulators run until {'Ctrl-C' if seconds is None else f'{seconds:g} s have passed'}")
        say(f"in another terminal: millisight collect {path}")
        until = None if seconds is None else time.monotonic() + seconds
        while until is None or time.monotonic() < until:
            time.sleep(0.1)


def is_rig_file(path: Path) -> bool:
    """Whether a TOML file describes a rig, not a world: its arm has a driver."""
    arm = read_toml(path, "a world or a rig").get("arm")
    return isinstance(arm, dict) and "driver" in arm


def collect_with_rig(
    path: Path, output: Path, experiment: int, *, hdf5: bool, dry_run: bool, live: bool, browser: bool
) -> None:
    """Scan with the devices of a rig file; see `collect`."""
    from millisight.io.mito import experiment_folder
    from millisight.rig import Lab, PublishedWriter, scan_info

    lab = Lab.from_toml(path)
    file = lab.file
    x, y, z = (round(angle) for angle in file.rotate_deg)
    folder = experiment_folder(output, file.object, (x, y, z), experiment, file.sight)
    if folder.exists():
        raise FileError(f"{folder} already exists; choose another --experiment, or remove it")
    say(_scan_of(lab))
    for radar in lab.radars:
        say(f"{radar.name}: {lab.plan.frames(radar.frame_period)} frames per row")
    info = scan_info(lab.radars, file.background)
    if dry_run:
        return
    make_folder(output)
    writer = PublishedWriter(folder, info=info, hdf5=hdf5, origin=file.origin, keep=lab.plan)
    try:
        with lab:
            if live:
                scan_live(
                    lab, writer, title=file.object, origin=file.origin, background=file.background, browser=browser
                )
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


def _scan_of(lab: "Lab") -> str:
    scan, limits, plan = lab.file.scan, lab.arm.limits, lab.plan
    return (
        f"scan: {len(plan.rows)} rows of {scan.size[1] * 100:g} cm, {scan.row_spacing * 1000:g} mm apart, at "
        f"{limits.speed:g} m/s, about {duration(len(plan.rows) * (plan.row_time + limits.duration(scan.row_spacing)))}"
    )
