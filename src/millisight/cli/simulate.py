"""`millisight simulate`: from a mesh to a capture."""

import inspect
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import SMALL, length, optional_length, progress, say, say_sampling, size
from millisight.cli.outputs import check_outputs
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Radar, Scene, Trajectory, radar_names
from millisight.imaging import checked_alpha, combine, grid_around, sampling
from millisight.simulation import (
    SCATTERING_MODELS,
    ScatteringModel,
    add_noise,
    aperture_over,
    check_coverage,
    check_noise,
    check_spreading,
    parameters_of,
    scattering_model,
)
from millisight.simulation import simulate as simulate_capture

_COMBINED = ("specular", "edge")


def _with_parameters(function: Any) -> Any:
    """The command with one option more for each parameter of each scattering model, after --height."""
    signature = inspect.signature(function)
    own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    options = {}
    for model in SCATTERING_MODELS:
        try:
            fields = parameters_of(SCATTERING_MODELS[model])
        except InputError:  # a plug-in that cannot be loaded: told when it is asked for
            continue
        for name, field in fields.items():
            option, about = f"--{name.replace('_', '-')}", field.metadata.get("about", f"For the model {model}.")
            default = "" if isinstance(field.default, bool) else f" [default: {field.default:g}]"
            of: Any = type(field.default)
            kind = Annotated[of | None, typer.Option(option, help=about + default)]
            options.setdefault(
                name, inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            )
    place = [p.name for p in own].index("height") + 1
    own[place:place] = options.values()
    function.__signature__ = signature.replace(parameters=[p.replace(kind=p.KEYWORD_ONLY) for p in own])
    function.__annotations__ |= {name: option.annotation for name, option in options.items()}
    return function


@_with_parameters
def simulate(
    mesh: Annotated[str, typer.Argument(help="A mesh file (STL, OBJ, PLY, OFF, GLB) or a catalogue name such as mug.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Capture to write (HDF5). [default: NAME.capture.h5]")
    ] = None,
    radar: Annotated[str, typer.Option(help=f"Radar preset: {', '.join(radar_names())}.")] = "mito-sim-77ghz",
    model: Annotated[
        str,
        typer.Option(help=f"{', '.join(SCATTERING_MODELS)}, or combined: specular and edge weighted by --alpha."),
    ] = "combined",
    alpha: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="A1 A2",
            help="Weights of specular and edge echoes for --model combined, such as --alpha 0.7 0.3. [default: fitted "
            "ones for a catalogue object, else those of the material]",
        ),
    ] = None,
    rotate: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y Z",
            help="Rotate the mesh about x, then y, then z [degrees], such as --rotate 0 0 45.",
        ),
    ] = (0.0, 0.0, 0.0),
    unit: Annotated[str | None, typer.Option(help="Unit of the mesh file: m, cm, mm or in.")] = None,
    vertices: Annotated[
        int, typer.Option(help="Number of evenly spaced vertices to resample to; 0 keeps those of the mesh.")
    ] = 10_000,
    material: Annotated[
        str | None,
        typer.Option(help="Material: metal, ceramic, plastic, … [default: that of the catalogue, else metal]"),
    ] = None,
    aperture: Annotated[
        str | None,
        typer.Option(
            help="Size of the aperture along x and y, such as 30x22cm, or 'published': 22x55cm with steps of a "
            "quarter wavelength. [default: 5 cm around the object]"
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            help="Distance between neighbouring positions, such as 2mm. [default: half a wavelength, or less where "
            "that gives ghosts]"
        ),
    ] = None,
    height: Annotated[str, typer.Option(help="Height of the aperture above the object's centre.")] = "20cm",
    spreading: Annotated[
        str, typer.Option(help="Decay of the amplitude with path length: none, as in the paper, or 1/d.")
    ] = "none",
    snr_db: Annotated[float | None, typer.Option(help="Add white noise at this signal-to-noise ratio [dB].")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Random seed for the noise.")] = 0,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the range profiles (PNG, SVG, PDF).")] = None,
    **parameters: Any,
) -> None:
    """Simulate a radar capture of a mesh.

    Example: millisight simulate mug --radar mito-sim-77ghz --aperture 30x22cm --step 2mm -o mug.capture.h5
    """
    from millisight.io import save

    if alpha is not None and model != "combined":
        raise InputError(
            f"--alpha weights specular and edge echoes for --model combined; leave --alpha or --model {model} out"
        )
    output = output or Path(f"{Path(mesh).stem}.capture.h5")
    check_outputs(records=(output,), figures=(plot,), source=Path(mesh))
    if snr_db is not None:
        check_noise(snr_db, seed)
    if alpha is not None:
        checked_alpha(alpha)
    check_spreading(spreading)
    chosen = Radar.preset(radar)
    models = _models(model, {name: value for name, value in parameters.items() if value is not None})
    where = _Aperture(aperture, step, height, chosen)  # what is wrong is said now, not after the mesh's work
    with progress("mesh"):
        scene = Scene.from_mesh(mesh, unit=unit, vertices=None, rotate_deg=rotate, material=material)
        # Judged before its vertices are resampled: a stray one far off would take a gigabyte.
        check_coverage(scene, where.over(scene))
        if vertices:
            resampled = Scene.from_mesh(scene.mesh, vertices=vertices, center=False).mesh
            scene = Scene(objects=(replace(scene.objects[0], mesh=resampled),))
    extent = scene.mesh.extent
    say(f"object: {scene.objects[0].name}, {' x '.join(f'{e * 100:.1f}' for e in extent)} cm, "
        f"{len(scene.mesh.vertices)} vertices, {scene.objects[0].material.name}")  # fmt: skip
    trajectory = where.over(scene)
    check_coverage(scene, trajectory)
    say(f"aperture: {len(trajectory)} positions over "
        f"{' x '.join(f'{e * 100:.1f}' for e in trajectory.extent[:2])} cm, {chosen.name}")  # fmt: skip
    if len(trajectory) > 1:
        with progress("sampling"):
            around = grid_around(scene, chosen.waveform.wavelength / 2)
            sampled = sampling(trajectory, around, radar=chosen, reflectors=scene.mesh.bounds)
        say_sampling(sampled)

    captures = []
    for scattering in models:
        with progress(f"simulate {scattering.name}") as report:
            captures.append(
                simulate_capture(scene, chosen, trajectory, model=scattering, spreading=spreading, progress=report)
            )
    capture = captures[0] if len(captures) == 1 else combine(captures[0], captures[1], alpha or scene.alpha)
    # How the mesh was placed, for who wants to draw it over the image.
    placed = {"unit": unit, "rotate_deg": rotate}
    capture = replace(capture, metadata={**capture.metadata, "placed": placed})
    if snr_db is not None:
        # After the two were combined: noise of each would be the same noise, and the stated ratio none of the sum's.
        capture = add_noise(capture, snr_db=snr_db, rng=seed)
    if not capture.metadata["lit_fraction"]:
        say(
            "warning: no vertex is lit from any position: the capture is empty; rotate the object, try another model, "
            "or --two-sided, where faces point inwards"
        )
    else:
        say(f"lit: {100 * capture.metadata['lit_fraction']:.0f} % of the vertices, from at least one position")
    save(output, capture)
    say(f"wrote {output}: {capture.channels} channels of {chosen.waveform.samples_per_chirp} samples")
    if plot is not None:
        from millisight.viz import plot_range_profiles, save_figure

        save_figure(plot_range_profiles(capture), plot)
        say(f"wrote {plot}")


def _models(model: str, parameters: dict[str, Any]) -> list[ScatteringModel]:
    """The scattering models to simulate, refused before the work where they cannot be."""
    if model != "combined" and model not in SCATTERING_MODELS:
        raise UnknownNameError("scattering model", model, (*SCATTERING_MODELS, "combined"))
    return [scattering_model(name, **parameters) for name in (_COMBINED if model == "combined" else (model,))]


class _Aperture:
    """The raster that the options ask for."""

    def __init__(self, aperture: str | None, step: str | None, height: str, radar: Radar):
        self._radar = radar
        self._height = length(height, option="--height")
        self._published = aperture == "published"
        if self._published and step is not None:
            raise InputError("--aperture published has a step of a quarter wavelength; leave --step out")
        self._size = None if aperture is None or self._published else size(aperture, option="--aperture")
        self._step = optional_length(step, option="--step", metres=SMALL)
        Trajectory.raster(size=self._size or (0.0, 0.0), step=1.0 if self._step is None else self._step)

    def over(self, scene: Scene) -> Trajectory:
        """The positions; around the scene where no size was said."""
        if self._published:
            published = Trajectory.published(self._radar.waveform.start_frequency)
            positions = published.positions - (0.0, 0.0, 0.2) + (0.0, 0.0, self._height)
            return Trajectory(times=published.times, positions=positions)
        origin = (0.0, 0.0, 0.0)  # where the mesh was centred before its vertices were resampled
        return aperture_over(scene, self._radar, size=self._size, step=self._step, height=self._height, center=origin)
