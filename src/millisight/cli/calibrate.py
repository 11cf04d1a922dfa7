"""`millisight calibrate`: how radar and camera sit on the arm, and how the radar's channels answer."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from millisight.cli.console import SMALL, WARNING, Commands, answer, answer_json, json_only, length, progress, say
from millisight.cli.image_steps import on_time, one_opened, without_background
from millisight.cli.options import DataFolder, RadarChoice
from millisight.cli.outputs import check_outputs
from millisight.cli.sources import Opened, sources
from millisight.core import check_known, printable, toml_of, write_text
from millisight.core.errors import InputError
from millisight.data import VoxelGrid

if TYPE_CHECKING:
    from millisight.calibration import BoardViews, HandEye, RadarCalibration

app: typer.Typer = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Measure how the devices of a rig sit on its arm. Of a radar, it also tells how its channels "
    "answer. Each value has its uncertainty.\n\n"
    "Start with a scan of a metal sphere or a corner reflector (radar), or with millisight rig photo (camera).",
)

_BLURRED = 0.5  # an uncertainty of a corner that is told [pixels]
_LOOSE = 0.005  # and one of the offset [m]
_CLOCKS = ("given", "apply")
_MUCH = 0.35  # phase error at which the fit is doubtful [rad]
_FAR = 0.01  # by so much a mount may be off without a question [m]
_AROUND, _VOXEL = 0.02, 0.005  # of the voxels that clocks are compared on [m]


@app.command()
def camera(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="Pictures of a board that did not move, and poses.toml: see `millisight rig photo`."
        ),
    ],
    board: Annotated[
        str, typer.Option(metavar="9x6", help="Number of inner corners of the checkerboard, where four squares meet.")
    ],
    square: Annotated[str, typer.Option(metavar="LENGTH", help="Side of a square, such as 25mm.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.toml", help="Also write the [camera] lines to this file."),
    ] = None,
) -> None:
    """Find where the camera sits on the arm: hand-eye calibration. It needs pictures of a checkerboard.

    Lens and focal length are taken from poses.toml; where it has none, they are found from the pictures too. ± is one
    standard deviation.

    Example: millisight calibrate camera board --board 9x6 --square 25mm -o camera.toml
    """
    from millisight.calibration import POSES_NAME, Board, read_board_views

    columns, rows = _corners(board)
    checkerboard = Board(columns=columns, rows=rows, square=length(square, option="--square", metres=SMALL))
    check_outputs(output, source=folder / POSES_NAME)
    try:
        with progress("find the board", compiles=False) as report:
            views = read_board_views(folder, checkerboard, progress=report)
        for name in views.missed:
            say(f"{WARNING}{name}: no board of {board} inner corners in it; it is not used")
        found = views.hand_eye()
    except ImportError as error:
        raise InputError(str(error)) from error
    for name, error, used in zip(views.names, found.errors, found.used, strict=True):
        if not used:
            say(
                f"{WARNING}{name}: its corners are off by {error:.1f} pixels; it is not used: check its pose, and that "
                "the board did not move"
            )
    _tell(views, found)
    lines = _lines(found)
    if found.offset_sigma.max() > _LOOSE:
        say(f"{WARNING}the offset is uncertain; take more pictures, the arm turned by 20 to 40 degrees about two axes")
    if found.corner_sigma > _BLURRED:
        say(f"{WARNING}the corners are uncertain; check that the board is flat, and the distortion in poses.toml")
    if output is not None:
        write_text(output, lines)
        say(f"wrote {output}; put its lines into the rig file")
    else:
        for line in lines.splitlines():
            answer(line)


def _corners(text: str) -> tuple[int, int]:
    """The two numbers of --board."""
    parts = text.replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdecimal() and len(part) < 4 for part in parts):
        raise InputError(f"--board is {text!r}; expected its numbers of inner corners such as 9x6")
    return int(parts[0]), int(parts[1])


def _tell(views: "BoardViews", found: "HandEye") -> None:
    count = len(views.names) + len(views.missed)
    answer(f"pictures used: {found.used.sum()} of {count}")
    answer(f"reprojection error: {found.residual:.2f} pixels rms")
    say(
        f"of which corners {found.corner_sigma:.2f} pixels, and the arm {1000 * found.place_sigma:.2f} mm and "
        f"{np.degrees(found.turn_sigma):.3f} degrees along and about each axis"
    )
    if views.intrinsics is None:
        optics = found.intrinsics
        say(
            f"camera found from the pictures: fx {optics.fx:.1f}, fy {optics.fy:.1f}, cx {optics.cx:.1f}, "
            f"cy {optics.cy:.1f} pixels"
        )


def _lines(found: "HandEye") -> str:
    """The [camera] lines of a rig file, uncertainties as comments."""
    from millisight.rig import CameraMount

    mount = CameraMount.of(found.pose)
    sigma = mount.tilt_sigma_deg(found.covariance[3:, 3:])
    return (
        "[camera]\n"
        f"offset = {_list(mount.offset, 5)}  # ± {_list(found.offset_sigma, 5)} m\n"
        f"tilt_deg = {_list(mount.tilt_deg, 3)}  # ± {_list(sigma, 3)} degrees\n"
    )


def _list(values: np.ndarray, digits: int) -> str:
    return "[" + ", ".join(f"{value:.{digits}f}" for value in np.round(values, digits) + 0.0) + "]"


@app.command()
def radar(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="CAPTURE",
            help="Scan of the target: a capture (HDF5), description of raw files (TOML), or an experiment of the "
            "published layout.",
        ),
    ],
    target: Annotated[
        str,
        typer.Option(
            metavar="X,Y,Z",
            help="Where the target is in the frame of the images, such as 5cm,8cm,-30cm: the middle of a sphere, the "
            "apex of a corner reflector. An arm tells places in its base frame: subtract `origin` of the rig file.",
        ),
    ],
    within: Annotated[
        str, typer.Option(metavar="LENGTH", help="Standard deviation of each coordinate of --target.")
    ] = "1mm",
    sphere: Annotated[
        str | None,
        typer.Option(
            metavar="RADIUS",
            help="The target is a metal sphere of this radius, such as 20mm; without this and --corner, a point.",
        ),
    ] = None,
    corner: Annotated[bool, typer.Option("--corner", help="The target is a trihedral corner reflector.")] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Calibration to write (TOML). [default: RADAR.calibration.toml]"),
    ] = None,
    search: Annotated[
        str, typer.Option(metavar="LENGTH", help="How far either way of the radar's path offset to look.")
    ] = "30cm",
    background: Annotated[
        Path | None,
        typer.Option(
            help="Scan without the target: subtracted pose by pose where it has the same poses, else its first frame "
            "from every frame."
        ),
    ] = None,
    clock: Annotated[
        str, typer.Option(help="given: use the recorded times. apply: correct the clocks of robot and radar first.")
    ] = "given",
    radar: RadarChoice = None,
    data: DataFolder = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what is written as one JSON document.")] = False,
) -> None:
    """Fit a radar's mount, path offset and channel gains. They are fitted to a scan of one known target.

    The target stands alone, or is by far the brightest within some range cells: a metal sphere or a corner reflector on
    foam or absorber. An error of its place becomes one of the offset, one of a sphere's radius twice one of the path
    offset. What the scan does not tell is named, and left as it was. `millisight image --calibration` applies
    the result.

    Example: millisight calibrate radar scan.capture.h5 --target 1cm,2cm,0cm --sphere 20mm -o mine.calibration.toml

    Example: millisight image mug.capture.h5 --calibration mine.calibration.toml
    """
    from millisight.calibration import ReferenceTarget, calibrate_radar

    check_known("--clock", clock, _CLOCKS)
    if sphere is not None and corner:
        raise InputError("a target is a sphere or a corner reflector; leave --sphere or --corner out")
    told = ReferenceTarget(
        position=np.array(_place(target)),
        uncertainty=length(within, option="--within"),
        kind="sphere" if sphere is not None else "corner" if corner else "point",
        radius=0.0 if sphere is None else length(sphere, option="--sphere"),
    )
    with json_only(as_json), one_opened(source, radar, data) as (opened, found):
        to = output or Path(f"{opened.capture.radar.name}.calibration.toml")
        check_outputs(to, source=source, data=data)
        empties = [] if background is None else sources([background], radar)
        capture = without_background(opened.capture, found, empties, data)
        if clock == "apply":
            around = VoxelGrid.regular(told.position - _AROUND, told.position + _AROUND, _VOXEL)
            capture = on_time(Opened(capture, opened.log), around, clock, "")
        with progress("fit", compiles=False):
            fitted = calibrate_radar(capture, told, search=length(search, option="--search"))
        write_text(to, toml_of(fitted))
        _say_doubts(fitted, told.uncertainty)
        say(f"wrote {to}")
    if as_json:
        answer_json({"source": str(source)} | dataclasses.asdict(fitted))
    else:
        _answer(fitted)


def _answer(fitted: "RadarCalibration") -> None:
    for what, unit, factor, values, spreads in (
        ("offset", "mm", 1e3, fitted.offset, fitted.offset_uncertainty),
        ("turn", "degrees", 1.0, fitted.turn_deg, fitted.turn_uncertainty_deg),
        ("path offset", "mm", 1e3, (fitted.path_offset,), (fitted.path_offset_uncertainty,)),
    ):
        told = ", ".join(
            f"{factor * v:.3f} ± {factor * s:.3f}" if s else "not determined"
            for v, s in zip(values, spreads, strict=True)
        )
        answer(f"{what}: {told} {unit}")
    amplitudes = [20 * np.log10(a) for row in fitted.amplitudes for a in row]
    phases = [np.degrees(p) for row in fitted.phases for p in row]
    answer(f"gains: {', '.join(f'{a:+.2f} dB {p:+.1f} deg' for a, p in zip(amplitudes, phases, strict=True))}")


def _say_doubts(fitted: "RadarCalibration", within: float) -> None:
    say(f"phase error: {np.degrees(fitted.phase_error):.1f} degrees, root mean square")
    if fitted.undetermined:
        say(f"{WARNING}not determined by this scan, and left as it was: {', '.join(fitted.undetermined)}")
    moved = max(map(abs, fitted.offset))
    if moved > max(_FAR, 5 * within):
        say(
            f"{WARNING}the antennas would be {1e3 * moved:.0f} mm from where they were thought to be; is the target "
            "where --target says, in the frame of the images?"
        )
    if fitted.phase_error > _MUCH:
        say(
            f"{WARNING}the phases fit badly; is the target alone, its kind and place right, and are the clocks? Try "
            "--clock apply, --background, or a larger --within"
        )


def _place(text: str) -> list[float]:
    parts = text.split(",")
    if len(parts) != 3:
        raise InputError(f"--target is {printable(text)!r}; expected x,y,z such as 5cm,8cm,-30cm")
    return [length(part, option="--target") for part in parts]
