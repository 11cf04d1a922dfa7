"""`millisight simulate`: from a mesh to a capture."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from millisight.capture.capture import Capture
from millisight.capture.noise import add_noise, check_noise
from millisight.capture.radar import Radar
from millisight.capture.scattering import MODELS, ScatteringModel
from millisight.capture.simulate import simulate as simulate_capture
from millisight.capture.trajectory import Trajectory
from millisight.cli.console import check_outputs, length, progress, say, size
from millisight.errors import CoverageError, InputError, UnknownNameError
from millisight.imaging.image import combine
from millisight.scene.scene import Scene

# Around an object the default aperture stands out by this much on every side [m].
_MARGIN = 0.05


def simulate(
    mesh: Annotated[str, typer.Argument(help="A mesh file (STL, OBJ, PLY, OFF, GLB) or a catalogue name such as mug.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Capture to write (HDF5). [default: NAME.capture.h5]")
    ] = None,
    radar: Annotated[
        str, typer.Option(help="Radar preset: mito-sim-77ghz, mito-sim-24ghz, iwr1443 or position2go.")
    ] = "mito-sim-77ghz",
    model: Annotated[
        str, typer.Option(help="specular, edge, diffuse, or combined: specular and edge weighted by --alpha.")
    ] = "combined",
    alpha: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="A1 A2",
            help="Weights of specular and edge, such as --alpha 0.7 0.3, for --model combined. "
            "[default: as fitted to the catalogue's object, or as the material's]",
        ),
    ] = None,
    rotate: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y Z",
            help="Turn the mesh about x, then y, then z, such as --rotate 0 0 45 [degrees].",
        ),
    ] = (0.0, 0.0, 0.0),
    unit: Annotated[str | None, typer.Option(help="Unit of the mesh file: m, cm, mm or in.")] = None,
    vertices: Annotated[
        int, typer.Option(help="Resample to so many evenly spaced vertices; 0 keeps the mesh's own.")
    ] = 10_000,
    material: Annotated[
        str | None, typer.Option(help="metal, ceramic, plastic, … [default: metal, or as the catalogue says]")
    ] = None,
    aperture: Annotated[
        str | None,
        typer.Option(
            help="Size along x and y, such as 30x22cm, or 'published': 22x55cm at a quarter wavelength. "
            "[default: 5 cm around the object]"
        ),
    ] = None,
    step: Annotated[
        str | None, typer.Option(help="Distance of neighbouring positions, such as 2mm. [default: half a wavelength]")
    ] = None,
    height: Annotated[str, typer.Option(help="Of the aperture above the object's centre.")] = "20cm",
    tau_deg: Annotated[float, typer.Option(help="Specular: largest angle off the normal [degrees].")] = 5.0,
    edge_deg: Annotated[float, typer.Option(help="Edge: faces further apart make an edge [degrees].")] = 20.0,
    two_sided: Annotated[bool, typer.Option("--two-sided", help="Specular: opposite normals count too.")] = False,
    spreading: Annotated[str, typer.Option(help="Amplitude over path length: none, as in the paper, or 1/d.")] = "none",
    snr_db: Annotated[float | None, typer.Option(help="Add white noise at this signal-to-noise ratio [dB].")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the range profiles (PNG, SVG, PDF).")] = None,
) -> None:
    """Simulate what a radar measures of a mesh.

    Example: millisight simulate mug --radar mito-sim-77ghz --aperture 30x22cm --step 2mm -o mug.capture.h5
    """
    from millisight.io.hdf5 import save

    if alpha is not None and model != "combined":
        raise InputError(f"--alpha weighs specular against edge and has no meaning for --model {model}; leave one out")
    output = output or Path(f"{Path(mesh).stem}.capture.h5")
    check_outputs(output, figures=(plot,), source=Path(mesh))
    if snr_db is not None:
        check_noise(snr_db, seed)
    chosen = Radar.preset(radar)
    _check_model(model, tau_deg, edge_deg)
    _trajectory(aperture, step, height, chosen, np.zeros(3))  # what is wrong is said now, not after the mesh's work
    with progress("mesh"):
        scene = Scene.from_mesh(mesh, unit=unit, vertices=vertices or None, rotate_deg=rotate, material=material)
    extent = scene.mesh.extent
    say(f"object: {scene.objects[0].name}, {' x '.join(f'{e * 100:.1f}' for e in extent)} cm, "
        f"{len(scene.mesh.vertices)} vertices, {scene.objects[0].material.name}")  # fmt: skip
    trajectory = _trajectory(aperture, step, height, chosen, extent)
    check_coverage(trajectory, extent, trajectory.positions[0, 2])
    say(f"aperture: {len(trajectory)} positions over "
        f"{' x '.join(f'{e * 100:.1f}' for e in trajectory.extent[:2])} cm, {chosen.name}")  # fmt: skip

    captures = []
    for name in ("specular", "edge") if model == "combined" else (model,):
        with progress(f"simulate {name}") as report:
            captures.append(
                simulate_capture(
                    scene, chosen, trajectory, model=name, tau_deg=tau_deg, edge_deg=edge_deg, two_sided=two_sided,
                    spreading=spreading, progress=report,
                )
            )  # fmt: skip
    capture = captures[0] if len(captures) == 1 else combine(captures[0], captures[1], alpha or scene.alpha)
    # How the mesh was placed, for who wants to draw it over the image.
    placed = {"unit": unit, "rotate_deg": rotate}
    capture = Capture(radar=chosen, trajectory=trajectory, frames=capture.frames,
                      metadata={**capture.metadata, "placed": placed})  # fmt: skip
    if snr_db is not None:
        # After the two were combined: noise of each would be the same noise, and the stated ratio none of the sum's.
        capture = add_noise(capture, snr_db=snr_db, rng=seed)
    if not capture.metadata["lit_fraction"]:
        say("warning: no vertex is lit from anywhere: the capture is empty; turn the object, or try another model")
    else:
        say(f"lit: {100 * capture.metadata['lit_fraction']:.0f} % of the vertices, from somewhere")
    save(output, capture)
    say(f"wrote {output}: {capture.channels} channels of {chosen.waveform.samples_per_chirp} samples")
    if plot is not None:
        from millisight.viz.plots import plot_range_profiles, save_figure

        save_figure(plot_range_profiles(capture), plot)
        say(f"wrote {plot}")


def _check_model(model: str, tau_deg: float, edge_deg: float) -> None:
    """Refuse before the work a model that is none, and angles that are none of its own."""
    if model not in (*MODELS, "combined"):
        raise UnknownNameError("scattering model", model, (*MODELS, "combined"))
    ScatteringModel(tau_deg=tau_deg, edge_deg=edge_deg)


def _trajectory(aperture: str | None, step: str | None, height: str, radar: Radar, extent: np.ndarray) -> Trajectory:
    """The raster asked for, around an object of this (3,) extent [m] where no aperture is."""
    center = (0.0, 0.0, length(height, option="--height"))
    if aperture == "published":
        if step is not None:
            raise InputError("--aperture published has its own step, a quarter wavelength; leave --step out")
        published = Trajectory.published(radar.waveform.start_frequency)
        return Trajectory(times=published.times, positions=published.positions - [0, 0, 0.2] + center)
    spacing = length(step, option="--step") if step is not None else radar.waveform.wavelength / 2
    area = size(aperture, option="--aperture") if aperture is not None else tuple(extent[:2] + 2 * _MARGIN)
    return Trajectory.raster(size=area, step=spacing, center=center)


def check_coverage(trajectory: Trajectory, extent, height: float) -> None:
    """Refuse an aperture that the object outgrows, in width or in height.

    Raises
    ------
    CoverageError
    """
    for name, wide, covered in zip("xy", extent, trajectory.extent, strict=False):
        if wide > covered + 1e-9:
            raise CoverageError(
                f"the object is {wide * 100:.1f} cm wide along {name}, the aperture only {covered * 100:.1f} cm; "
                "pass a larger --aperture, --rotate the object, or check the mesh's --unit"
            )
    if extent[2] / 2 >= height:
        raise CoverageError(
            f"the object reaches {extent[2] / 2 * 100:.1f} cm above its centre, the aperture hangs at "
            f"{height * 100:.1f} cm; pass a larger --height or --rotate the object"
        )
