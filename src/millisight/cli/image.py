"""`millisight image`: from captures to 3-D images, one or a whole dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from millisight.cli.console import complain, end_with_failures, in_options, say, summed_up
from millisight.cli.grids import outline_mesh, parse_bytes
from millisight.cli.image_steps import ImageSettings, check_stated, image_of, large_image_of, oddities
from millisight.cli.options import DataFolder, RadarChoice, checked_window
from millisight.cli.outputs import check_outputs, folders_of_many, is_folder, named, of_folder, output_path
from millisight.cli.sources import Source, sources
from millisight.core import (
    check_device,
    check_known,
    checked_colormap,
    colormap_in_use,
    record_from_file,
)
from millisight.core.errors import InputError, MillisightError
from millisight.data import SarImage
from millisight.imaging import CLUTTER, WINDOWS, check_tolerance

if TYPE_CHECKING:
    from millisight.calibration import RadarCalibration

_CLOCKS = ("given", "report", "apply")
_FOCUSES = ("none", "rows", "path")


@dataclass(frozen=True, slots=True)
class _Outputs:
    image: Path
    plot: Path | None
    slices: Path | None


def image(
    captures: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAPTURE",
            help="Captures (HDF5 of `millisight simulate` or `ms.save`); descriptions of raw files (TOML), or folders "
            "that hold one; experiments of the published dataset, or any folder above them.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            parser=output_path,
            help="Image to write (HDF5), or a folder for several captures, and for those of a folder. [default: "
            "CAPTURE.image.h5 beside the capture; for experiments of a dataset, in the current folder]",
        ),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Voxels: one spacing such as 2mm, or lower:upper:spacing for x,y,z, such as "
            "-10cm:10cm:2mm,-10cm:10cm:2mm,-5cm:5cm:5mm. [default: as the description or the dataset states; for "
            "simulated captures, the scene and 2 cm around it at half a wavelength]"
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="fast; backprojection: more accurate; exact: in float64, very slow; sparse: for scans with half or a "
            "quarter of the rows. [default: fast, or as the description states]"
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            help=f"none, {', '.join(WINDOWS)}: lower the sidelobes, widen the main lobe. [default: none, or as the "
            "description states]"
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Largest relative error of fast and backprojection, from 0.0005 to 0.1. [default: 0.005]"),
    ] = None,
    data: DataFolder = None,
    radar: RadarChoice = None,
    background: Annotated[
        Path | None,
        typer.Option(
            help="Capture of the empty scene: subtracted pose by pose where it has the same poses, else its first "
            "frame from every frame."
        ),
    ] = None,
    calibration: Annotated[
        list[Path] | None,
        typer.Option(
            help="Mount, path offset and gains of a radar, as `millisight calibrate radar` wrote them. Repeatable, for "
            "several radars."
        ),
    ] = None,
    clock: Annotated[
        str,
        typer.Option(
            help="given: use the recorded times. report: estimate offset and drift between the clocks of robot and "
            "radar. apply: also correct them."
        ),
    ] = "given",
    focus: Annotated[
        str,
        typer.Option(
            help="none: use the recorded path. rows: estimate by how many frames each row began late. path: also "
            "estimate errors of the path. Both maximise the sharpness of the image."
        ),
    ] = "none",
    as_published: Annotated[
        bool,
        typer.Option(
            "--as-published",
            help="Image as the published code does, for comparison: positions interpolated linearly, the nearest of "
            "4096 range bins below, the phase of one frequency, both receivers at 24 GHz; divided by poses.",
        ),
    ] = False,
    clutter: Annotated[
        str | None,
        typer.Option(
            help="none: image everything. lid: the objects are covered; take the echo of lids and other sheets off the "
            "frames, or off the image where the frames do not show them. auto: likewise, if a sheet is very sure. "
            "[default: none, or as the description states]"
        ),
    ] = None,
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Memory to use at most, such as 8GB: an image that needs more is formed in slabs, kept on disk; an "
            "interrupted run goes on with those that are done. [default: the image at once]",
        ),
    ] = None,
    device: Annotated[
        str, typer.Option(help="cpu, or cuda: an NVIDIA GPU, for the methods fast and backprojection.")
    ] = "cpu",
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            parser=output_path,
            help="Write a picture of the three projections (PNG, SVG, PDF); a folder for several captures.",
        ),
    ] = None,
    slices: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            parser=output_path,
            help="Write a picture of three slices (PNG, SVG, PDF); a folder for several captures.",
        ),
    ] = None,
    outline: Annotated[
        str | None,
        typer.Option(
            metavar="MESH",
            help="Mesh whose outline to draw over the pictures: the file or catalogue name that was simulated. It is "
            "placed as by `millisight simulate`.",
        ),
    ] = None,
    db: Annotated[bool, typer.Option("--db", help="Plot in decibels.")] = False,
    colormap: Annotated[
        str | None,
        typer.Option(help=f"Colour map of the pictures, such as jet or viridis. [default: {colormap_in_use()}]"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Skip captures that are already imaged.")] = False,
) -> None:
    """Form a 3-D image from each capture. A capture that fails does not stop the others.

    Example: millisight image mug.capture.h5 --grid 2mm -o mug.image.h5 --plot mug.png

    Example: millisight image my_scan.toml --data raw/ --slices scan.png

    Example: millisight image hall.capture.h5 --grid 2.5mm --memory 8GB

    Example: millisight image MITO_Dataset/004_sugar_box -o images/ --plot images/ --clock apply
    """
    if colormap is not None or plot is not None or slices is not None:
        checked_colormap(colormap)
    checked_window(window)
    check_known("--clock", clock, _CLOCKS)
    check_known("--focus", focus, _FOCUSES)
    if clutter is not None:
        check_known("--clutter", clutter, CLUTTER)
    if outline is not None and plot is None and slices is None:
        raise InputError("--outline is drawn over pictures; add --plot or --slices")
    if memory is not None and (as_published or plot is not None or slices is not None):
        raise InputError("--memory writes the image alone; leave --as-published, --plot and --slices out")
    if as_published and any(one is not None for one in (method, window, tolerance)):
        raise InputError("--as-published is a method of its own; leave --method, --window and --tolerance out")
    if device != "cpu" and (as_published or memory is not None):
        raise InputError(f"--device {device} is for whole images; leave --as-published and --memory out")
    check_device(device)
    if tolerance is not None:
        check_tolerance(tolerance)
    settings = ImageSettings(
        grid=grid,
        method=method,
        window=window,
        tolerance=tolerance,
        clock=clock,
        focus=focus,
        clutter=clutter,
        data=data,
        background=[] if background is None else sources([background], radar),
        calibration=_calibrations(calibration or []),
        as_published=as_published,
        outline=outline,
        db=db,
        colormap=colormap,
        memory=None if memory is None else parse_bytes(memory),
        device=device,
    )
    found = sources(captures, radar)
    empties = {(source.path, source.radar) for source in settings.background}
    found = [source for source in found if (source.path, source.radar) not in empties]
    if settings.background and not {source.radar for source in found} & {radar for _, radar in empties}:
        raise InputError(
            "--background holds no capture of a radar that is to be imaged; pass one, or choose with --radar"
        )
    if any(map(is_folder, captures)):
        output, plot, slices = map(of_folder, (output, plot, slices))
    if len(found) == 1:
        to, name = _image_path(found[0], None), found[0].name
        figures = named(plot, f"{name}.png"), named(slices, f"{name}.slices.png")
        outputs = _Outputs(named(output, to.name) or to, *figures)
        check_outputs(records=(outputs.image,), figures=figures, source=found[0].path, data=data)
        _image_one(found[0], outputs, settings, label="")
        return
    _image_all(found, output, plot, slices, settings, resume=resume)


def _calibrations(paths: list[Path]) -> "list[RadarCalibration]":
    if not paths:
        return []
    from millisight.calibration import RadarCalibration

    found = [record_from_file(RadarCalibration, path, "a calibration") for path in paths]
    names = [one.radar for one in found]
    if len(set(names)) < len(names):
        raise InputError(f"the calibrations are of the radars {', '.join(names)}; expected one for each radar")
    return found


def _image_all(
    found: list[Source],
    output: Path | None,
    plot: Path | None,
    slices: Path | None,
    settings: ImageSettings,
    *,
    resume: bool,
) -> None:
    """Every capture after the other; what failed is said again at the end."""
    folders_of_many(output, plot, slices, count=len(found))
    failures: list[str] = []
    passed_over = 0
    with summed_up("captures"):
        for number, source in enumerate(found, 1):
            label = f"[{number}/{len(found)}] {source.name}"
            outputs = _Outputs(
                _image_path(source, output),
                None if plot is None else plot / f"{source.name}.png",
                None if slices is None else slices / f"{source.name}.slices.png",
            )
            say(label)
            try:
                if resume and _done(source, outputs, settings):
                    passed_over += 1
                    continue
                figures = outputs.plot, outputs.slices
                check_outputs(records=(outputs.image,), figures=figures, source=source.path, data=settings.data)
                _image_one(source, outputs, settings, label=f"[{number}/{len(found)}] ")
            except (MillisightError, MemoryError, OSError) as error:
                failures.append(f"{source.name}: {' '.join(in_options(str(error)).split())}")
                complain(failures[-1])
    already = f", {passed_over} already done" if passed_over else ""
    say(f"imaged {len(found) - len(failures) - passed_over} of {len(found)} captures{already}")
    end_with_failures(failures)


def _image_one(source: Source, outputs: _Outputs, settings: ImageSettings, *, label: str) -> None:
    from millisight.io import save

    with source.opened(settings.data, f"{label}read", as_published=settings.as_published) as opened:
        for note in (*opened.notes, *oddities(opened.capture)):
            say(note)
        check_stated(opened.capture, settings)
        if settings.memory is not None:
            large = large_image_of(outputs.image, opened, source, settings, settings.memory, label)
            if large is not None:
                _say_written(*large, outputs.image)
                return
        mesh = None if settings.outline is None else outline_mesh(settings.outline, opened.capture)
        formed = image_of(opened, source, settings, label)
    metadata = {**formed.metadata, "asked": settings.asked(source)}
    save(outputs.image, SarImage(grid=formed.grid, values=formed.values, metadata=metadata))
    _say_written(float(formed.magnitude.max()), formed.peak, outputs.image)
    _draw(formed, mesh, outputs, settings, source)


def _say_written(peak: float, place: Any, path: Path) -> None:
    say(f"peak: {peak:.4g} at {', '.join(f'{p * 100:.1f}' for p in place)} cm")
    say(f"wrote {path}")


def _done(source: Source, outputs: _Outputs, settings: ImageSettings) -> bool:
    """Whether an earlier run made this image of these files with these options; missing pictures are drawn from it."""
    from millisight.io import load

    if not outputs.image.exists():
        return False
    image = load(outputs.image)
    if not isinstance(image, SarImage) or image.metadata.get("asked") != settings.asked(source):
        return False
    made = outputs.image.stat().st_mtime_ns
    plot, slices = (None if path is None or _is_since(path, made) else path for path in (outputs.plot, outputs.slices))
    if settings.outline is not None and (plot, slices) != (None, None):
        return False  # what lies in the scene is told by the capture
    _draw(image, None, _Outputs(outputs.image, plot, slices), settings, source)
    return True


def _is_since(path: Path, nanoseconds: int) -> bool:
    """Whether a picture is there, and no older than that: an older one may show an earlier image."""
    return path.exists() and path.stat().st_mtime_ns >= nanoseconds


def _draw(formed: SarImage, mesh: Any, outputs: _Outputs, settings: ImageSettings, source: Source) -> None:
    if outputs.plot is None and outputs.slices is None:
        return
    from millisight.viz import image_title, plot_image, plot_slices, save_figure

    scale, colormap = "db" if settings.db else "linear", settings.colormap
    title = image_title(formed, source.name)
    for path, draw in ((outputs.plot, plot_image), (outputs.slices, plot_slices)):
        if path is not None:
            save_figure(draw(formed, mesh=mesh, scale=scale, colormap=colormap, title=title), path)
            say(f"wrote {path}")


def _image_path(source: Source, folder: Path | None) -> Path:
    return (source.folder if folder is None else folder) / f"{source.name}.image.h5"
