"""`millisight image`: from captures to 3-D images, one or a whole dataset."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.capture.capture import Capture
from millisight.cli.console import check_outputs, end_with_failures, in_options, progress, say
from millisight.cli.grids import outline_mesh, parse_grid
from millisight.cli.options import RadarChoice
from millisight.cli.sources import Opened, Source, sources
from millisight.errors import InputError, MillisightError, UnknownNameError
from millisight.files import make_folder
from millisight.imaging.form import form_image
from millisight.imaging.grid import VoxelGrid
from millisight.imaging.image import SarImage

_CLOCKS = ("given", "report", "apply")


@dataclass(frozen=True, slots=True)
class _Settings:
    """The options that are the same for every capture."""

    grid: str | None
    method: str | None
    window: str | None
    clock: str
    data: Path | None
    background: list[Source]
    outline: str | None
    db: bool

    @property
    def asked(self) -> dict[str, Any]:
        """What decides the image's values, as its metadata hold it."""
        values = {name: getattr(self, name) for name in ("grid", "method", "window", "clock")}
        return {**values, "background": [source.name for source in self.background]}


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
            help="What `millisight simulate` or `ms.save` wrote (HDF5); a description of raw files (TOML) or a folder "
            "that holds one; experiments of the published dataset, or any folder above them.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Image to write (HDF5); a folder where there are several captures. [default: CAPTURE.image.h5, beside "
            "the capture, or here for experiments of a dataset]",
        ),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Voxels: one spacing such as 2mm, or lower:upper:spacing for x,y,z, such as "
            "-10cm:10cm:2mm,-10cm:10cm:2mm,-5cm:5cm:5mm. [default: as the description or the dataset states; of "
            "simulated captures 2 cm around the scene, half a wavelength]"
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="fast; backprojection, more accurate; or exact, in float64 and very slow. [default: fast, or as the "
            "description states]"
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            help="none, hann or taylor: lower sidelobes for a wider main lobe. [default: none, or as the description "
            "states]"
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Where the files that a description names lie. [default: beside it]")
    ] = None,
    radar: RadarChoice = None,
    background: Annotated[
        Path | None,
        typer.Option(help="A capture of the empty scene, whose first frame is subtracted from every one."),
    ] = None,
    clock: Annotated[
        str,
        typer.Option(
            help="given: trust the times. report: estimate offset and drift between the robot's and the radar's "
            "clock. apply: and correct them."
        ),
    ] = "given",
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Write a picture of the three projections (PNG, SVG, PDF); a folder where there are several."
        ),
    ] = None,
    slices: Annotated[
        Path | None,
        typer.Option(help="Write a picture of three slices (PNG, SVG, PDF); a folder where there are several."),
    ] = None,
    outline: Annotated[
        str | None,
        typer.Option(
            metavar="MESH",
            help="Draw the outline of the mesh that was simulated, a file or a catalogue name, over the pictures. "
            "It is centred and turned as `millisight simulate` did.",
        ),
    ] = None,
    db: Annotated[bool, typer.Option("--db", help="Pictures in decibels.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Of several captures, pass over those already imaged.")
    ] = False,
) -> None:
    """Fuse a capture's frames into a 3-D image; with several captures, one bad one does not stop the rest.

    Example: millisight image mug.capture.h5 --grid 2mm -o mug.image.h5 --plot mug.png

    Example: millisight image my_scan.toml --data raw/ --slices scan.png

    Example: millisight image MITO_Dataset/004_sugar_box -o images/ --plot images/ --clock apply
    """
    if clock not in _CLOCKS:
        raise UnknownNameError("--clock", clock, _CLOCKS)
    if outline is not None and plot is None and slices is None:
        raise InputError("--outline is drawn over pictures, and there is none; add --plot or --slices")
    settings = _Settings(
        grid=grid,
        method=method,
        window=window,
        clock=clock,
        data=data,
        background=[] if background is None else sources([background], radar),
        outline=outline,
        db=db,
    )
    found = sources(captures, radar)
    empties = {(source.path, source.radar) for source in settings.background}
    found = [source for source in found if (source.path, source.radar) not in empties]
    if settings.background and not {source.radar for source in found} & {radar for _, radar in empties}:
        raise InputError(
            "--background holds no capture of a radar that is to be imaged; pass one, or choose with --radar"
        )
    if len(found) == 1:
        outputs = _Outputs(output or _image_path(found[0], None), plot, slices)
        check_outputs(outputs.image, figures=(plot, slices), source=found[0].path)
        _image_one(found[0], outputs, settings, label="")
        return
    _image_all(found, output, plot, slices, settings, resume=resume)


def _image_all(
    found: list[Source],
    output: Path | None,
    plot: Path | None,
    slices: Path | None,
    settings: _Settings,
    *,
    resume: bool,
) -> None:
    """Every capture after the other; what failed is said again at the end."""
    for folder in (output, plot, slices):
        if folder is not None:
            make_folder(folder)
    failures: list[str] = []
    passed_over = 0
    for number, source in enumerate(found, 1):
        label = f"[{number}/{len(found)}] {source.name}"
        outputs = _Outputs(
            _image_path(source, output),
            None if plot is None else plot / f"{source.name}.png",
            None if slices is None else slices / f"{source.name}.slices.png",
        )
        say(label)
        try:
            if resume and _done(outputs, settings):
                passed_over += 1
                continue
            check_outputs(outputs.image, figures=(outputs.plot, outputs.slices), source=source.path)
            _image_one(source, outputs, settings, label=f"[{number}/{len(found)}] ")
        except (MillisightError, MemoryError, OSError) as error:
            failures.append(f"{source.name}: {' '.join(in_options(str(error)).split())}")
            typer.echo(f"millisight: {failures[-1]}", err=True)
    already = f", {passed_over} done before" if passed_over else ""
    say(f"imaged {len(found) - len(failures) - passed_over} of {len(found)} captures{already}")
    end_with_failures(failures)


def _image_one(source: Source, outputs: _Outputs, settings: _Settings, *, label: str) -> None:
    from millisight.io.hdf5 import save

    with source.opened(settings.data, f"{label}read") as opened:
        for note in (*opened.notes, *_oddities(opened.capture)):
            say(note)
        capture = _without_background(opened.capture, source, settings)
        mesh = None if settings.outline is None else outline_mesh(settings.outline, capture)
        voxels = parse_grid(settings.grid, capture)
        capture = _on_time(Opened(capture, opened.log), voxels, settings.clock, label)
        say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {capture.channels} channels")
        formed = _form(capture, voxels, settings, label)
    save(outputs.image, SarImage(grid=formed.grid, values=formed.values, metadata=_told(formed, settings)))
    say(f"peak: {formed.magnitude.max():.4g} at {', '.join(f'{p * 100:.1f}' for p in formed.peak)} cm")
    say(f"wrote {outputs.image}")
    _draw(formed, mesh, outputs, "db" if settings.db else "linear")


def _told(formed: SarImage, settings: _Settings) -> dict[str, Any]:
    return {**formed.metadata, "asked": settings.asked}


def _done(outputs: _Outputs, settings: _Settings) -> bool:
    """Whether an earlier run made this image with these options; pictures that are missing are drawn from it."""
    from millisight.io.hdf5 import load

    if not outputs.image.exists():
        return False
    image = load(outputs.image)
    if not isinstance(image, SarImage) or image.metadata.get("asked") != settings.asked:
        return False
    missing = (path if path is not None and not path.exists() else None for path in (outputs.plot, outputs.slices))
    _draw(image, None, _Outputs(outputs.image, *missing), "db" if settings.db else "linear")
    return True


def _oddities(capture: Capture) -> list[str]:
    """Warnings of what is possible, but more often a unit that was forgotten."""
    found = []
    frequency, extent = capture.radar.waveform.center_frequency, float(capture.trajectory.extent.max())
    if not 1e8 <= frequency <= 1e12:
        found.append(f"warning: the centre frequency is {frequency:.3g} Hz; is its unit right?")
    if extent > 10:
        found.append(f"warning: the aperture is {extent:.3g} m large; is the unit of the positions right?")
    return found


def _form(capture: Capture, voxels: VoxelGrid, settings: _Settings, label: str) -> SarImage:
    """The image; what the command line leaves open is as the capture's description states it."""
    stated: Any = capture.metadata.get("imaging")
    stated = stated if isinstance(stated, Mapping) else {}
    method = settings.method or str(stated.get("method", "fast"))
    window = settings.window or stated.get("window") or "none"
    with progress(f"{label}image by {method}") as report:
        return form_image(capture, voxels, method=method, window=None if window == "none" else window, progress=report)


def _without_background(capture: Capture, source: Source, settings: _Settings) -> Capture:
    """The capture less the first frame of the empty scene's, where one is given for its radar."""
    if not settings.background:
        return capture
    from millisight.capture.calibrate import subtract_background

    for empty in settings.background:
        if empty.radar == source.radar:
            with empty.opened(settings.data, "read background") as opened:
                return subtract_background(capture, opened.capture, frame="first")
    say(f"background: none of the {source.radar} radar; nothing is subtracted")
    return capture


def _on_time(opened: Opened, voxels: VoxelGrid, clock: str, label: str) -> Capture:
    """The capture, its poses put right for the clocks' offset and drift where that was asked for."""
    if clock == "given":
        return opened.capture
    if opened.log is None:
        raise InputError(f"--clock {clock} needs a robot's log, and this capture has none: its poses are given")
    from millisight.capture.clock import retime
    from millisight.imaging.synchronise import estimate_clock

    with progress(f"{label}clock") as report:
        found = estimate_clock(opened.capture, opened.log, voxels, progress=report)
    if found.clock is None:
        say(f"clock: not observable: {found.reason}")
        return opened.capture
    offset, drift = found.clock.offset * 1e3, found.clock.drift * 1e6
    say(
        f"clock: the robot's is ahead by {offset:.2f} +- {found.offset_uncertainty * 1e3:.2f} ms at "
        f"{found.clock.reference_time:.3f} s, and gains {drift:.1f} +- {found.drift_uncertainty * 1e6:.1f} ppm"
        f"{'' if clock == 'apply' else '; not applied (--clock apply does)'}"
    )
    return retime(opened.capture, opened.log, found.clock) if clock == "apply" else opened.capture


def _draw(formed: SarImage, mesh: Any, outputs: _Outputs, scale: Any) -> None:
    if outputs.plot is None and outputs.slices is None:
        return
    from millisight.viz.plots import plot_projections, plot_slices, save_figure

    for path, draw in ((outputs.plot, plot_projections), (outputs.slices, plot_slices)):
        if path is not None:
            save_figure(draw(formed, mesh=mesh, scale=scale), path)
            say(f"wrote {path}")


def _image_path(source: Source, folder: Path | None) -> Path:
    return (source.folder if folder is None else folder) / f"{source.name}.image.h5"
