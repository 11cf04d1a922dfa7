"""`millisight image`: from a capture to a 3-D image."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from millisight.capture.capture import Capture
from millisight.cli.console import check_outputs, length, progress, say
from millisight.errors import InputError
from millisight.imaging.form import form_image
from millisight.imaging.grid import VoxelGrid
from millisight.records import checked_array
from millisight.scene.mesh import TriangleMesh
from millisight.scene.scene import Scene

# Around the scene's bounding box the default grid stands out by this much on every side [m].
_MARGIN = 0.02
# By so much may the box of an outline differ from that of the simulated scene, which was resampled [m].
_MISFIT = 0.01


def image(
    capture: Annotated[Path, typer.Argument(help="A capture that `millisight simulate` or `ms.save` wrote (HDF5).")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Image to write (HDF5). [default: CAPTURE with .image.h5]")
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Voxels: one spacing such as 2mm, or lower:upper:spacing for x,y,z, such as "
            "-10cm:10cm:2mm,-10cm:10cm:2mm,-5cm:5cm:5mm. [default: 2 cm around the scene, half a wavelength]"
        ),
    ] = None,
    method: Annotated[
        str, typer.Option(help="fast; backprojection, more accurate; or exact, in float64 and very slow.")
    ] = "fast",
    window: Annotated[str, typer.Option(help="none, hann or taylor: lower sidelobes for a wider main lobe.")] = "none",
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the three projections (PNG, SVG, PDF).")] = None,
    slices: Annotated[Path | None, typer.Option(help="Write a picture of three slices (PNG, SVG, PDF).")] = None,
    outline: Annotated[
        str | None,
        typer.Option(
            metavar="MESH",
            help="Draw the outline of the mesh that was simulated, a file or a catalogue name, over the pictures. "
            "It is centred and turned as `millisight simulate` did.",
        ),
    ] = None,
    db: Annotated[bool, typer.Option("--db", help="Pictures in decibels.")] = False,
) -> None:
    """Fuse a capture's frames into a 3-D image.

    Example: millisight image mug.capture.h5 --grid 2mm -o mug.image.h5 --plot mug.png
    """
    from millisight.io.hdf5 import open_capture, save

    output = output or capture.with_name(capture.name.removesuffix(".h5").removesuffix(".capture") + ".image.h5")
    check_outputs(output, figures=(plot, slices), source=capture)
    if outline is not None and plot is None and slices is None:
        raise InputError("--outline is drawn over pictures, and there is none; add --plot or --slices")
    with open_capture(capture) as source:
        mesh = None if outline is None else _placed(outline, source)
        voxels = parse_grid(grid, source)
        say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {source.channels} channels")
        with progress(f"image by {method}") as report:
            formed = form_image(
                source, voxels, method=method, window=None if window == "none" else window, progress=report
            )
    save(output, formed)
    say(f"peak: {formed.magnitude.max():.4g} at {', '.join(f'{p * 100:.1f}' for p in formed.peak)} cm")
    say(f"wrote {output}")
    if plot is not None or slices is not None:
        from millisight.viz.plots import plot_projections, plot_slices, save_figure

        scale = "db" if db else "linear"
        if plot is not None:
            save_figure(plot_projections(formed, mesh=mesh, scale=scale), plot)
            say(f"wrote {plot}")
        if slices is not None:
            save_figure(plot_slices(formed, mesh=mesh, scale=scale), slices)
            say(f"wrote {slices}")


def parse_grid(text: str | None, capture: Capture) -> VoxelGrid:
    """The grid that --grid names, or the default around the capture's scene.

    Raises
    ------
    InputError
        The text is no grid, or a spacing stands alone and the capture does not say where its scene is.
    """
    if text is not None and ":" in text:
        axes = [part.split(":") for part in text.split(",")]
        if len(axes) != 3 or any(len(axis) != 3 for axis in axes):
            raise InputError(f"--grid is {text!r}; expected lower:upper:spacing three times, for x,y,z")
        lower, upper, spacing = zip(*[[length(v, option="--grid") for v in axis] for axis in axes], strict=True)
        return VoxelGrid.regular(lower, upper, spacing)
    return around_scene(capture, length(text, option="--grid") if text is not None else None)


def _placed(outline: str, capture: Capture) -> TriangleMesh:
    """The mesh where `millisight simulate` put it.

    Raises
    ------
    InputError
        It does not fill the box that the capture's scene filled.
    """
    placed = capture.metadata.get("placed", {})
    rotate_deg = placed.get("rotate_deg", (0.0, 0.0, 0.0))
    mesh = Scene.from_mesh(outline, vertices=None, unit=placed.get("unit"), rotate_deg=rotate_deg).mesh
    bounds = _bounds(capture)
    if bounds is not None and np.abs(mesh.bounds - bounds).max() > _MISFIT:
        there, here = (" x ".join(f"{e * 100:.1f}" for e in np.ptp(b, axis=0)) for b in (bounds, mesh.bounds))
        raise InputError(
            f"--outline {outline} is {here} cm large, but the capture's scene was {there} cm; pass the mesh that was "
            "simulated"
        )
    return mesh


def _bounds(capture: Capture) -> np.ndarray | None:
    """(2, 3) the box [m] that the capture's scene fills, where the capture says."""
    bounds = capture.metadata.get("scene_bounds")
    return None if bounds is None else checked_array(bounds, name="scene_bounds", shape=(2, 3), unit="m")


def around_scene(capture: Capture, spacing: float | None = None) -> VoxelGrid:
    """A grid 2 cm around the simulated scene; `spacing` [m], or by default half a wavelength, twice that in depth.

    Raises
    ------
    InputError
        The capture does not say where its scene is, as real ones do not.
    """
    bounds = _bounds(capture)
    if bounds is None:
        raise InputError("the capture does not say where its scene is; pass --grid lower:upper:spacing for x,y,z")
    wavelength = capture.radar.waveform.wavelength
    steps = (spacing,) * 3 if spacing is not None else (wavelength / 2, wavelength / 2, wavelength)
    return VoxelGrid.regular(bounds[0] - _MARGIN, bounds[1] + _MARGIN, steps)
