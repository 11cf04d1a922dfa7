"""`millisight surface`: from a capture or an image to oriented points, a mesh and a depth map."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from millisight.cli.console import SMALL, answer_json, json_only, optional_length, progress, say
from millisight.cli.grids import check_memory, parse_grid
from millisight.cli.image_sources import image_sources
from millisight.cli.image_steps import one_capture, tell_sheets
from millisight.cli.options import DataFolder, FalseAlarms, RadarChoice, SheetClutter, SupportHeight, checked_window
from millisight.cli.outputs import check_outputs
from millisight.core import atomic_path, check_known, checked_colormap, printable
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Capture, PointCloud, SarImage, Surface
from millisight.imaging import CLUTTER

_DEPTHS = (".npz", ".png")
_UNSEEN = 128  # grey
_UNIT, _LEVELS = 1e-5, 65535  # of a depth picture: least distance of grey levels [m], and their number


def surface(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="CAPTURE_OR_IMAGE",
            help="Capture (HDF5), description of raw files (TOML), or an experiment of the published layout; or an "
            "image (HDF5, processed_image*.pkl), which tells less: see below.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Mesh to write (PLY). [default: NAME.surface.ply in the source's folder]"),
    ] = None,
    points: Annotated[
        Path | None, typer.Option(help="Also write the oriented points: PLY or PCD with normals, or HDF5.")
    ] = None,
    depth: Annotated[
        Path | None,
        typer.Option(
            help="Also write a depth map seen from above: NPZ with x, y, z and sigma [m], or a PNG of 16 bits, 0.01 mm "
            "a level, or more where heights differ by over 65 cm, above the lowest place; 0 where nothing was seen."
        ),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Voxels of a capture in which surfaces are searched: one spacing such as 2mm, or lower:upper:spacing "
            "for x,y,z. Leave a quarter of each slice free around the object. [default: as for `millisight image`]"
        ),
    ] = None,
    clutter: SheetClutter = "none",
    false_alarms: FalseAlarms = 1e-6,
    support: SupportHeight = None,
    spacing: Annotated[
        str | None, typer.Option(help="Spacing of the mesh, such as 1mm. [default: that of the points]")
    ] = None,
    least: Annotated[int, typer.Option(min=3, help="Patches of fewer points are left out, as false alarms.")] = 12,
    window: Annotated[
        str, typer.Option(help="taylor; hann: normals of small round things to a degree, but less of their rim; none.")
    ] = "taylor",
    watertight: Annotated[
        bool, typer.Option("--watertight", help="Close the mesh by walls down to a floor, grey: they were not seen.")
    ] = False,
    completed: Annotated[
        bool,
        typer.Option(
            "--complete",
            help="Guess what was not seen of balls, cylinders and cones: grey, and 0 in the file's property seen. "
            "Also writes the guess alone, MESH.guessed.ply.",
        ),
    ] = False,
    base: Annotated[
        str | None,
        typer.Option(help="z of that floor, such as --base=-30cm. [default: just below the surface]"),
    ] = None,
    frequency: Annotated[
        float | None, typer.Option(metavar="HZ", help="Centre of an image's band, if its file does not tell.")
    ] = None,
    radar: RadarChoice = None,
    data: DataFolder = None,
    no_picture: Annotated[
        bool, typer.Option("--no-picture", help="Do not plot the surface (MESH.surface.png).")
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help='Print one JSON document: {"source", "output", "points", "patches", "vertices", "faces", "area", '
            '"bounds", "sigma", "guessed"}; "guessed" lists shapes, of --complete; areas and lengths in metres.',
        ),
    ] = False,
) -> None:
    """Make a mesh of the surface that a radar saw. What it did not see stays open.

    Of a capture, the delay of each echo tells where the surface is, to fractions of a millimetre, and where the echo
    comes to tells its normal. Of an image alone, the phase tells the normals and the maximum of |I| the place: rounded
    things then lie centimetres too deep. Vertices carry normals and their standard deviation (place_sigma), and are
    coloured by it.

    Example: millisight surface mug.capture.h5 --grid 2mm -o mug.ply

    Example: millisight surface scan.capture.h5 --clutter lid --points points.ply --depth depth.png

    Example: millisight surface mug.capture.h5 --watertight --base=-30cm -o mug.ply

    Example: millisight surface mug.capture.h5 --grid 2mm --complete -o mug.ply

    Example: millisight surface mug.image.h5 -o mug.ply
    """
    check_known("--clutter", clutter, CLUTTER)
    tapered = checked_window(window)
    if depth is not None and depth.suffix.lower() not in _DEPTHS:
        raise UnknownNameError("depth map format", depth.suffix or depth.name, _DEPTHS)
    step = optional_length(spacing, option="--spacing", metres=SMALL)
    if base is not None and not watertight:
        raise InputError("--base is of a closed mesh; pass --watertight as well")
    if completed and watertight:
        raise InputError("--complete and --watertight guess in two ways; pass one of them")
    floor = optional_length(base, option="--base")
    rests_on = optional_length(support, option="--support")
    with json_only(as_json):
        opened, name = _opened(source, radar, data)
        to = output or source.parent / f"{name}.surface.ply"
        if to.suffix.lower() != ".ply":
            raise UnknownNameError("mesh format", to.suffix or to.name, (".ply",))
        picture = None if no_picture else to.with_name(f"{to.stem.removesuffix('.surface')}.surface.png")
        alone = to.with_name(f"{to.stem}.guessed.ply") if completed else None
        checked_colormap(None)  # of the vertices
        check_outputs(to, points, depth, alone, figures=(picture,), source=source, data=data)
        if completed and not isinstance(opened, Capture):
            raise InputError("--complete asks which antennas saw the object; pass a capture, not an image")
        found = _points(
            opened, grid, clutter=clutter, false_alarms=false_alarms, frequency=frequency,
            window=tapered, support=rests_on,
        )  # fmt: skip
        tell_sheets(found.metadata, clutter)
        say(f"{len(found)} oriented points")
        from millisight.geometry import surface as surface_of

        made = surface_of(found, spacing=step, least=least)
        shown = made
        if watertight:
            from millisight.geometry import closed

            _write(to, closed(made, base=floor))
        elif alone is not None and isinstance(opened, Capture):
            shown = _completed(made, found, opened, alone)
            _write(to, shown)
        else:
            _write(to, made)
        say(
            f"{_patches(made.metadata['patches'])}, {1e4 * made.mesh.area:.1f} cm², standard deviation "
            f"{1e3 * float(np.median(made.sigma)):.2f} mm in the median"
        )
        say(f"wrote {to}")
        if points is not None:
            _write_points(points, found)
            say(f"wrote {points}")
        if depth is not None:
            say(f"wrote {depth}{_write_depth(depth, made, float(made.metadata['history'][-1]['spacing']))}")
        if picture is not None:
            from millisight.viz import plot_surface, save_figure

            save_figure(plot_surface(shown, title=printable(name)), picture)
            say(f"wrote {picture}")
    if as_json:
        answer_json({
            "source": str(source), "output": str(to), "points": len(found), "patches": made.metadata["patches"],
            "vertices": len(made.mesh.vertices), "faces": len(made.mesh.faces), "area": made.mesh.area,
            "bounds": made.mesh.bounds, "sigma": float(np.median(made.sigma)),
            "guessed": list(shown.metadata.get("shapes", ())),
        })  # fmt: skip


def _patches(count: int) -> str:
    return f"{count} patch{'' if count == 1 else 'es'}"


def _opened(source: Path, radar: str | None, data: Path | None) -> tuple[Capture | SarImage, str]:
    """The image or the capture, in memory, and a name for its outputs."""
    if source.suffix.lower() in (".h5", ".hdf5") or source.name.startswith("processed_image"):
        from millisight.io import provenance

        if source.suffix.lower() == ".pkl" or provenance(source)["record"] == "SarImage":
            (found,) = image_sources([source], radar=radar)
            return found.images()[0], source.name.removesuffix(source.suffix).removesuffix(".image")
    return one_capture(source, radar, data)


def _points(opened: Capture | SarImage, grid: str | None, **settings: Any) -> PointCloud:
    from millisight.geometry import surface_points

    if isinstance(opened, SarImage):
        if grid is not None:
            raise InputError("--grid is of captures; an image has its own voxels")
        settings.pop("window")
        return surface_points(opened, **settings)
    voxels = parse_grid(grid, opened)
    check_memory(opened, voxels, advice="")
    say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {opened.channels} channels")
    with progress("surface points") as report:
        return surface_points(opened, voxels, progress=report, **settings)


def _write(to: Path, made: Surface) -> None:
    """The mesh, its vertices coloured by their standard deviation; those that were not seen are grey."""
    from millisight.meshes import write_mesh

    seen = made.sigma[: made.metadata.get("seen_vertices")]
    worst = float(np.percentile(seen, 95)) if len(seen) else 1.0
    share = np.clip(made.sigma / max(worst, 1e-9), 0, 1)
    colours = checked_colormap(None)(share, bytes=True)[:, :3]
    colours[len(seen) :] = _UNSEEN
    write_mesh(to, made.mesh, sigma=made.sigma, colours=colours, seen=np.arange(len(made.sigma)) < len(seen))


def _completed(made: Surface, found: PointCloud, capture: Capture, alone: Path) -> Surface:
    """The surface and what is guessed of it, which is written to `alone` as well; says what it is."""
    from millisight.data import TriangleMesh
    from millisight.geometry import channel_middles, complete

    antennas = channel_middles(capture).reshape(-1, 3)
    whole = complete(made, found, antennas)
    count, shapes = whole.metadata["seen_vertices"], whole.metadata["shapes"]
    if not shapes:
        say("nothing was guessed: no ball, cylinder or cone fits what was seen")
        return whole
    for one in shapes:
        say(
            f"guessed: a {one['shape']} of radius {1e3 * one['radius']:.1f} mm; of what of it should "
            f"shine {100 * one['shown']:.0f} % was seen"
        )
    faces = whole.mesh.faces[(whole.mesh.faces >= count).all(axis=1)] - count
    guess = TriangleMesh(vertices=whole.mesh.vertices[count:], faces=faces)
    _write(alone, Surface(mesh=guess, sigma=whole.sigma[count:], metadata={"seen_vertices": 0}))
    say(f"wrote {alone}")
    return whole


def _write_points(to: Path, found: PointCloud) -> None:
    from millisight.io import CLOUD_SUFFIXES, save, write_point_cloud

    if to.suffix.lower() in CLOUD_SUFFIXES:
        write_point_cloud(to, found)
    else:
        save(to, found)


def _write_depth(to: Path, made: Surface, step: float) -> str:
    """The depth map; returns what is to be said of it."""
    from PIL import Image

    from millisight.data import PixelGrid
    from millisight.geometry import depth_map

    lower, upper = made.mesh.bounds[:, :2]
    x, y = (
        low + step * np.arange(int(np.ceil((high - low) / step)) + 1) for low, high in zip(lower, upper, strict=True)
    )
    z, sigma = depth_map(made, PixelGrid(x=x, y=y))
    with atomic_path(to) as temporary:
        if to.suffix.lower() == ".npz":
            with open(temporary, "wb") as file:
                np.savez_compressed(file, x=x, y=y, z=z, sigma=sigma)
            return f": {' x '.join(map(str, z.shape))} pixels, {step * 1e3:.2g} mm apart"
        low, high = float(np.nanmin(z)), float(np.nanmax(z))
        unit = max(_UNIT, (high - low) / (_LEVELS - 1))
        lowest = low - unit
        levels = np.nan_to_num(np.round((z - lowest) / unit), nan=0.0).clip(0, _LEVELS).astype(np.uint16)
        # Rows of the picture run down y, columns along x, as the figures show it.
        Image.fromarray(levels.T[::-1]).save(temporary, format="PNG")
    return f": {unit * 1e3:.6g} mm a level above z = {lowest:.5f} m, {step * 1e3:.3g} mm a pixel"
