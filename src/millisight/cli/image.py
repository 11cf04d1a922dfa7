"""`millisight image`: from captures to 3-D images, one or a whole dataset."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import check_outputs, end_with_failures, in_options, progress, say
from millisight.cli.grids import outline_mesh, parse_grid
from millisight.cli.options import RadarChoice
from millisight.cli.sources import Opened, Source, sources
from millisight.core import PUBLISHED_COLORMAP, check_known, make_folder
from millisight.core.errors import InputError, MillisightError, UnknownNameError
from millisight.data import Capture, SarImage, VoxelGrid
from millisight.imaging import CLUTTER, METHODS, WINDOWS, form_image, remove_sheets

_CLOCKS = ("given", "report", "apply")
_FOCUSES = ("none", "rows", "path")


@dataclass(frozen=True, slots=True)
class _Settings:
    """The options that are the same for every capture."""

    grid: str | None
    method: str | None
    window: str | None
    tolerance: float | None
    clock: str
    focus: str
    clutter: str | None
    data: Path | None
    background: list[Source]
    outline: str | None
    db: bool

    @property
    def asked(self) -> dict[str, Any]:
        """What decides the image's values, as its metadata hold it."""
        values = {name: getattr(self, name) for name in ("grid", "method", "window", "tolerance", "clock")}
        if self.focus != "none":
            values["focus"] = self.focus
        if self.clutter is not None:
            values["clutter"] = self.clutter
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
            help="Captures (HDF5 of `millisight simulate` or `ms.save`); descriptions of raw files (TOML), or folders "
            "that hold one; experiments of the published dataset, or any folder above them.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Image to write (HDF5), or a folder for several captures. [default: CAPTURE.image.h5 beside the "
            "capture; for experiments of a dataset, in the current folder]",
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
    data: Annotated[
        Path | None, typer.Option(help="Folder of the files named in a description. [default: its own folder]")
    ] = None,
    radar: RadarChoice = None,
    background: Annotated[
        Path | None,
        typer.Option(help="Capture of the empty scene; its first frame is subtracted from every frame."),
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
    clutter: Annotated[
        str | None,
        typer.Option(
            help="none: image everything. lid: the objects are covered; take the echo of lids and other sheets off the "
            "frames, or off the image where the frames do not show them. auto: likewise, if a sheet is very sure. "
            "[default: none, or as the description states]"
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Write a picture of the three projections (PNG, SVG, PDF); a folder for several captures."),
    ] = None,
    slices: Annotated[
        Path | None,
        typer.Option(help="Write a picture of three slices (PNG, SVG, PDF); a folder for several captures."),
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
    resume: Annotated[bool, typer.Option("--resume", help="Skip captures that are already imaged.")] = False,
) -> None:
    """Form a 3-D image from each capture. A capture that fails does not stop the others.

    Example: millisight image mug.capture.h5 --grid 2mm -o mug.image.h5 --plot mug.png

    Example: millisight image my_scan.toml --data raw/ --slices scan.png

    Example: millisight image MITO_Dataset/004_sugar_box -o images/ --plot images/ --clock apply
    """
    check_known("--clock", clock, _CLOCKS)
    check_known("--focus", focus, _FOCUSES)
    if clutter is not None:
        check_known("--clutter", clutter, CLUTTER)
    if outline is not None and plot is None and slices is None:
        raise InputError("--outline is drawn over pictures; add --plot or --slices")
    settings = _Settings(
        grid=grid,
        method=method,
        window=window,
        tolerance=tolerance,
        clock=clock,
        focus=focus,
        clutter=clutter,
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
    already = f", {passed_over} already done" if passed_over else ""
    say(f"imaged {len(found) - len(failures) - passed_over} of {len(found)} captures{already}")
    end_with_failures(failures)


def _image_one(source: Source, outputs: _Outputs, settings: _Settings, *, label: str) -> None:
    from millisight.io import save

    with source.opened(settings.data, f"{label}read") as opened:
        for note in (*opened.notes, *_oddities(opened.capture)):
            say(note)
        _check_stated(opened.capture, settings)
        capture = _without_background(opened.capture, source, settings)
        mesh = None if settings.outline is None else outline_mesh(settings.outline, capture)
        voxels = parse_grid(settings.grid, capture)
        capture = _on_time(Opened(capture, opened.log), voxels, settings.clock, label)
        say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {capture.channels} channels")
        capture = _in_focus(capture, voxels, settings.focus, label)
        clutter = settings.clutter or _stated(capture).get("clutter") or "none"
        capture, taken = _uncovered(capture, clutter)
        formed = _form(capture, voxels, settings, label)
        if not taken:
            formed = _uncovered(formed, clutter, capture.radar.waveform.center_frequency)[0]
    metadata = {**formed.metadata, "asked": settings.asked}
    save(outputs.image, SarImage(grid=formed.grid, values=formed.values, metadata=metadata))
    say(f"peak: {formed.magnitude.max():.4g} at {', '.join(f'{p * 100:.1f}' for p in formed.peak)} cm")
    say(f"wrote {outputs.image}")
    _draw(formed, mesh, outputs, "db" if settings.db else "linear")


def _done(outputs: _Outputs, settings: _Settings) -> bool:
    """Whether an earlier run made this image with these options; pictures that are missing are drawn from it."""
    from millisight.io import load

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
    if extent > 10 and not capture.metadata.get("far_field"):
        found.append(f"warning: the aperture is {extent:.3g} m large; is the unit of the positions right?")
    return found


def _stated(capture: Capture) -> Mapping[str, Any]:
    """The image settings of the capture's description."""
    stated: Any = capture.metadata.get("imaging")
    return stated if isinstance(stated, Mapping) else {}


def _check_stated(capture: Capture, settings: _Settings) -> None:
    stated = _stated(capture)
    for key, known in (("method", METHODS), ("window", ("none", *WINDOWS)), ("clutter", CLUTTER)):
        if stated.get(key) and not getattr(settings, key) and stated[key] not in known:
            raise UnknownNameError(f"{key} in {capture.metadata.get('description')}, [image]:", stated[key], known)


def _uncovered(scene: Any, clutter: str, frequency: float | None = None) -> tuple[Any, bool]:
    """The capture or the image without the echoes of sheets over it, and whether there were any."""
    if clutter == "none":
        return scene, False
    found = remove_sheets(scene, clutter=clutter, frequency=frequency)
    what = "frames" if frequency is None else "image"
    for sheet in found.sheets:
        say(f"clutter: a sheet taken off the {what}: {sheet}; {100 * sheet.power:.0f} % of its power")
    if not found.sheets:
        say(f"clutter: nothing taken off the {what}: {found.reason}")
    return found.result, bool(found.sheets)


def _form(capture: Capture, voxels: VoxelGrid, settings: _Settings, label: str) -> SarImage:
    """The image; what the command line leaves open is as the capture's description states it."""
    stated = _stated(capture)
    method = settings.method or str(stated.get("method", "fast"))
    window = settings.window or stated.get("window") or "none"
    with progress(f"{label}image by {method}") as report:
        return form_image(
            capture, voxels, method=method, window=None if window == "none" else window,
            tolerance=settings.tolerance, progress=report,
        )  # fmt: skip


def _without_background(capture: Capture, source: Source, settings: _Settings) -> Capture:
    """The capture less the first frame of the empty scene's, where one is given for its radar."""
    if not settings.background:
        return capture
    from millisight.calibration import subtract_background

    for empty in settings.background:
        if empty.radar == source.radar:
            with empty.opened(settings.data, "read background") as opened:
                return subtract_background(capture, opened.capture, frame="first")
    say(f"background: no capture of the {source.radar} radar; nothing is subtracted")
    return capture


def _on_time(opened: Opened, voxels: VoxelGrid, clock: str, label: str) -> Capture:
    """The capture, its poses put right for the clocks' offset and drift where that was asked for."""
    if clock == "given":
        return opened.capture
    if opened.log is None:
        raise InputError(f"--clock {clock} needs a robot log, and this capture has none")
    from millisight.calibration import retime
    from millisight.imaging import estimate_clock

    with progress(f"{label}clock") as report:
        found = estimate_clock(opened.capture, opened.log, voxels, progress=report)
    if found.clock is None:
        say(f"clock: not observable: {found.reason}")
        return opened.capture
    offset, drift = found.clock.offset * 1e3, found.clock.drift * 1e6
    say(
        f"clock: the robot's clock is ahead by {offset:.2f} +- {found.offset_uncertainty * 1e3:.2f} ms at "
        f"{found.clock.reference_time:.3f} s, and drifts by {drift:.1f} +- {found.drift_uncertainty * 1e6:.1f} ppm"
        f"{'' if clock == 'apply' else '; not corrected (use --clock apply)'}"
    )
    return retime(opened.capture, opened.log, found.clock) if clock == "apply" else opened.capture


def _in_focus(capture: Capture, voxels: VoxelGrid, focus: str, label: str) -> Capture:
    """The capture, its path put right by the sharpness of the image where that was asked for."""
    if focus == "none":
        return capture
    from millisight.imaging import autofocus

    with progress(f"{label}focus") as report:
        found = autofocus(capture, voxels, focus=focus, progress=report)
    if "rows" in found.applied:
        worst = float(abs(found.row_offsets).max())
        say(f"focus: rows corrected by up to {worst:.1f} +- {found.row_uncertainty:.1f} frames")
    if found.applied:
        farthest = 1e3 * float((found.displacements**2).sum(axis=1).max()) ** 0.5
        say(
            f"focus: poses corrected by up to {farthest:.2f} mm (along the line of sight +- "
            f"{1e3 * found.uncertainty:.3f} mm); contrast increased by {100 * (found.gain - 1):.0f} %"
        )
    if found.reason:
        say(f"focus: {found.reason}")
    return found.capture


def _draw(formed: SarImage, mesh: Any, outputs: _Outputs, scale: Any) -> None:
    if outputs.plot is None and outputs.slices is None:
        return
    from millisight.viz import plot_image, plot_slices, save_figure

    both = partial(plot_image, colormap=(PUBLISHED_COLORMAP, None))
    for path, draw in ((outputs.plot, both), (outputs.slices, plot_slices)):
        if path is not None:
            save_figure(draw(formed, mesh=mesh, scale=scale), path)
            say(f"wrote {path}")


def _image_path(source: Source, folder: Path | None) -> Path:
    return (source.folder if folder is None else folder) / f"{source.name}.image.h5"
