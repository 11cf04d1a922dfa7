"""`millisight locate`: where an object of known shape lies, and which of several it is."""

from pathlib import Path
from typing import Annotated

import typer

from millisight.cli.console import answer_json, answer_table, json_only, optional_length, progress, say
from millisight.cli.grids import check_memory, parse_grid
from millisight.cli.image_steps import one_capture, tell_sheets
from millisight.cli.options import DataFolder, FalseAlarms, RadarChoice, SheetClutter, SupportHeight
from millisight.cli.outputs import check_outputs
from millisight.core import check_known, printable, write_text
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Located, TriangleMesh
from millisight.imaging import CLUTTER

_UNCLEAR = 0.25  # share of all poses below which the best may be far off


def locate(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="CAPTURE",
            help="Capture (HDF5), description of raw files (TOML), or an experiment of the published layout.",
        ),
    ],
    mesh: Annotated[
        list[str],
        typer.Option(
            "--mesh",
            metavar="MESH",
            help="Mesh of the object: a file, or a name of the catalogue. Repeatable.",
        ),
    ],
    unit: Annotated[
        str | None, typer.Option(help="Unit of the mesh files: m, cm, mm or in. [default: as they state, or metres]")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Poses to write (JSON). [default: NAME.pose.json in the source's folder]"),
    ] = None,
    placed: Annotated[
        Path | None, typer.Option(help="Also write the most probable mesh where it was found (PLY).")
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Voxels in which surfaces are searched: one spacing such as 2mm, or lower:upper:spacing for x,y,z. "
            "[default: as for `millisight image`]"
        ),
    ] = None,
    clutter: SheetClutter = "none",
    false_alarms: FalseAlarms = 1e-6,
    support: SupportHeight = None,
    materials: Annotated[
        bool,
        typer.Option(
            "--materials",
            help="Also fit how strong the specular and the edge echoes of the most probable mesh are.",
        ),
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Also plot the mesh where it was found, and the points on it, from three sides.")
    ] = None,
    radar: RadarChoice = None,
    data: DataFolder = None,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help='Print what is written as one JSON document: {"source", "poses": [{"name", "T_world_mesh", '
            '"rotation", "translation", "middle", "covariance", "free_axes", "score", "explained", "shown", '
            '"weight", "symmetry", "agreement", "alpha", "alpha_sigma"}], "probabilities", "points"}; metres, radians.',
        ),
    ] = False,
) -> None:
    """Find the pose of an object of known shape: place and turn. Tells their uncertainty, and which of several it is.

    Points on the object's surface are compared with what of the mesh would shine, turned all ways. Where the mesh looks
    the same after a turn, that is told, and the turn is left open. Tell the height of the floor by --support, if you
    know it: the object is taken to lie on it.

    Example: millisight locate mug.capture.h5 --mesh mug.stl --unit mm --grid 2mm --plot mug.pose.png

    Example: millisight locate scan.capture.h5 --mesh mug --mesh bowl --clutter lid
    """
    check_known("--clutter", clutter, CLUTTER)
    if placed is not None and placed.suffix.lower() != ".ply":
        raise UnknownNameError("mesh format", placed.suffix or placed.name, (".ply",))
    floor = optional_length(support, option="--support")
    with json_only(as_json):
        meshes = _meshes(mesh, unit)
        capture, name = one_capture(source, radar, data)
        to = output or source.parent / f"{name}.pose.json"
        check_outputs(to, placed, figures=(plot,), source=source, data=data)
        voxels = parse_grid(grid, capture)
        check_memory(capture, voxels, advice="")
        say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {capture.channels} channels")
        from millisight.geometry import locate as locate_in

        with progress("locate") as report:
            found = locate_in(
                capture, meshes, voxels, clutter=clutter, false_alarms=false_alarms, support=floor,
                materials=materials, progress=report,
            )  # fmt: skip
        tell_sheets(found.points.metadata, clutter)
        say(f"{len(found.points)} oriented points")
        for pose in found.poses:
            say(f"{pose.name}: {pose.symmetry}")
        best = found.poses[0]
        if best.alpha is not None and best.alpha_sigma is not None and best.agreement is not None:
            (specular, edge), sigma = best.alpha, best.alpha_sigma
            say(
                f"{best.name}: echoes specular {specular:.2f}, edge {edge:.2f} ± {sigma:.2f}; the simulated image "
                f"agrees with the measured one by {best.agreement:.2f}"
            )
        elif materials:
            say(f"{best.name}: weights of its echoes {found.metadata['history'][-1]['materials']}")
        _write(to, source, found)
        say(f"wrote {to}")
        if placed is not None:
            from millisight.meshes import write_mesh

            write_mesh(placed, best.placed(meshes[best.name]))
            say(f"wrote {placed}")
        if plot is not None:
            from millisight.viz import save_figure

            title = printable(f"{name}: {best.name}, score {best.score:.2f}")
            save_figure(found.plot(meshes[best.name], title=title), plot)
            say(f"wrote {plot}")
        for remark in _remarks(found, support=floor):
            say(remark)
    if as_json:
        answer_json({"source": str(source)} | found.to_dict())
    else:
        answer_table(_rows(found))


def _meshes(given: list[str], unit: str | None) -> dict[str, TriangleMesh]:
    """The meshes by their names, in metres, as they lie in their files."""
    from millisight.data import Scene

    found: dict[str, TriangleMesh] = {}
    for one in given:
        name = Path(one).stem
        if name in found:
            raise InputError(f"two meshes are called {printable(name)}; rename one of the files")
        found[name] = Scene.from_mesh(one, unit=unit if Path(one).suffix else None, vertices=None, center=False).mesh
    return found


def _remarks(found: Located, *, support: float | None) -> list[str]:
    """What to know of the table."""
    best, made = found.poses[0], []
    if found.best is None:
        made.append("most probably it is none of the meshes")
    elif len(found.poses) == 1:
        made.append("one mesh alone does not tell whether it is this object: add --mesh for others that it may be")
    if best.weight < _UNCLEAR:
        advice = "; tell the height of what it lies on by --support, which often decides" if support is None else ""
        made.append(
            f"{best.name}: other poses agree nearly as well, this one has {100 * best.weight:.0f} % of them all and "
            f"may be far off, farther than ± says{advice}"
        )
    return [*made, "x, y, z are those of the mesh's middle; its turn is in the file"]


def _rows(found: Located) -> list[tuple[str, ...]]:
    """The table of the poses; probabilities where there is more than one mesh."""
    several = len(found.poses) > 1 or found.best is None
    rows: list[tuple[str, ...]] = [(
        "mesh", *(["probability"] if several else []), "x [mm]", "y [mm]", "z [mm]", "± [mm]", "± [°]", "of all poses",
        "score", "points explained", "shown",
    )]  # fmt: skip
    for pose in found.poses:
        rows.append((
            printable(pose.name), *([f"{100 * found.probabilities[pose.name]:.0f} %"] if several else []),
            *(f"{1e3 * one:.1f}" for one in pose.place), f"{1e3 * pose.place_sigma:.1f}", f"{pose.turn_sigma_deg:.1f}",
            f"{100 * pose.weight:.0f} %", f"{pose.score:.2f}", f"{100 * pose.explained:.0f} %",
            f"{100 * pose.shown:.0f} %",
        ))  # fmt: skip
    for name, share in found.ranking:
        if several and all(name != pose.name for pose in found.poses):
            rows.append((printable(name), f"{100 * share:.0f} %", *[""] * 9))
    return rows


def _write(to: Path, source: Path, found: Located) -> None:
    import json

    write_text(to, json.dumps({"source": str(source)} | found.to_dict(), indent=2) + "\n")
