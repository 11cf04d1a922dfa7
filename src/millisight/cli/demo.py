"""`millisight demo`: the main job from end to end, on objects that need no download."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import progress, say
from millisight.data import Capture, Radar, SarImage, Scene, Trajectory
from millisight.imaging import combine, form_image, grid_around
from millisight.simulation import simulate

if TYPE_CHECKING:
    from millisight.viz import PageItem

OBJECTS = ("mug", "adjustable_wrench", "cracker_box")
RADARS = {"77 GHz": "mito-sim-77ghz", "24 GHz": "mito-sim-24ghz"}

# One aperture for all three objects, as of a small scanner, and the largest step without ghosts.
_SIZE = (0.30, 0.24)  # [m]

NEXT = {
    "millisight view {folder}/carton-77ghz.image.h5": "turn the image in the browser",
    "millisight image {folder}/shut_carton/77_ghz.toml --clutter lid": "form it from the raw frames, without the lid",
    "millisight locate {folder}/shut_carton/77_ghz.toml --mesh scissors --clutter lid": "how they lie, by their mesh",
    "millisight segment {folder}/carton-77ghz.image.h5 --condition nlos": "what lies in the carton: a mask",
    "millisight segment {folder}/mug-77ghz.image.h5": "the mug's mask",
    "millisight classify {folder}/mug-77ghz.image.h5": "and its class",
    "millisight simulate your.stl --unit mm -o your.capture.h5": "a mesh of your own",
}
"""Commands to try next, and what each shows."""

_INTRODUCTION = """
Millimetre waves pass through cardboard. The first picture shows what a radar sees in a shut carton, by the virtual rig.

In the others the radar moves over a mug, a wrench and a box, and measures at every position of a raster 20 cm above
them. A single frame shows no shape; all frames together, fused into one synthetic aperture, show it. They are simulated
as in the MITO paper (ICCV 2025): the visible vertices of a mesh are point reflectors, and Eq. 1 of the paper forms the
image. Nothing here was measured by a real radar.

Two kinds of echo are simulated. Specular echoes come from places where the surface reflects the wave straight back to
the radar. Edge echoes come from edges, which scatter in every direction. Their weighted sum stands for the material.
"""


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")] = Path("demo"),
) -> None:
    """Image a few objects, and explain the pictures.

    A mug, a wrench and a box are imaged at 77 and 24 GHz, then scissors in a shut carton.

    Example: millisight demo -o demo && xdg-open demo/index.html
    """
    from millisight.cli.demo_carton import look_into_carton
    from millisight.core import beside, own_folder
    from millisight.viz import PageItem, write_page

    started = time.monotonic()
    own_folder(output)
    # Beside the three objects: on two cores the first run, which compiles, takes three quarters of the time.
    with beside(look_into_carton, output) as looked_into:
        items = _three_objects(output)
        with progress("scissors in a shut carton"):
            carton = looked_into()
    say(f"scissors in a shut carton: {carton.facts['class']}")
    items = [
        carton,
        PageItem(
            heading="Three objects, imaged by two radars",
            picture="sheet.png",
            caption="Each image is seen from above, in decibels below its own maximum, with the outline of the mesh. "
            "At 77 GHz the wavelength is 3.8 mm and the shapes are sharp. At 24 GHz it is 12.4 mm and the images "
            "are three times as coarse. The bandwidth there is only 200 MHz, so depth comes from the curvature of "
            "the wavefront alone. In return, waves at 24 GHz pass through cartons with little loss.",
        ),
        *items,
        PageItem(
            heading="Three slices through the brightest voxel of the mug at 77 GHz",
            picture="slices.png",
            caption="The image is a volume. The slices pass through its brightest voxel, in decibels. Bright streaks "
            "away from the outline are sidelobes, caused by the sharp ends of the aperture. A window (millisight "
            "image --window taylor) lowers them.",
        ),
        PageItem(
            heading="The raw data: range profiles of the mug",
            picture="range.png",
            caption="A single frame resolves range only, to 5 cm at 3 GHz of bandwidth. All finer detail in the "
            "images above comes from combining the positions.",
        ),
    ]
    page = write_page(output, title="What a millimetre-wave radar sees", introduction=_INTRODUCTION, items=items)
    say(f"wrote {page} and its pictures in {time.monotonic() - started:.0f} s: open it in a browser")
    say("what to try next:")
    commands = {command.format(folder=output): what for command, what in NEXT.items()}
    for command, what in commands.items():
        say(f"  {command:<{max(map(len, commands))}}  {what}")


_CAPTIONS = {
    "mug": "The mug stands upright and is seen from above: its rim and handle are edges, its bottom reflects like a "
    "mirror. The line is the outline of the mesh. Upper row: rainbow colours, as in the paper. Lower row: the "
    "same values in a perceptually uniform colour map.",
    "adjustable_wrench": "The flat faces of the wrench reflect like mirrors and its edges scatter: the jaw is visible.",
    "cracker_box": "A flat face reflects like a mirror, only to positions straight above it. It is visible because "
    "the aperture is wider than the box. The rim of the box consists of edges.",
}


def _three_objects(output: Path) -> "list[PageItem]":
    """Image each object by both radars, and write its files below `output`; what the page shows of each at 77 GHz."""
    from millisight.core import PUBLISHED_COLORMAP
    from millisight.io import save
    from millisight.viz import PageItem, plot_image, plot_range_profiles, plot_sheet, plot_slices, save_figure

    items, sheet, meshes = [], {}, {}
    for name in OBJECTS:
        with progress(f"{name}: mesh"):
            scene = Scene.from_mesh(name)
        for band, radar in RADARS.items():
            capture = _capture(scene, Radar.preset(radar), f"{name}, {band}")
            with progress(f"{name}, {band}: image") as report:
                image = form_image(capture, grid_around(capture), progress=report)
            label = f"{name}, {band}"
            sheet[label], meshes[label] = image, scene.mesh
            stem = f"{name}-{band.split()[0]}ghz"
            save(output / f"{stem}.image.h5", image)
            if band == "77 GHz":
                save(output / f"{stem}.capture.h5", capture)
                both = plot_image(image, mesh=scene.mesh, colormap=(PUBLISHED_COLORMAP, None), title=label)
                save_figure(both, output / f"{stem}.png")
                items.append(
                    PageItem(
                        heading=f"{name.replace('_', ' ')}, seen along three axes at {band}",
                        picture=f"{stem}.png",
                        caption=_CAPTIONS[name],
                        facts=_facts(scene, capture, image),
                    )
                )
            if band == "77 GHz" and name == "mug":
                save_figure(plot_slices(image, mesh=scene.mesh), output / "slices.png")
                save_figure(plot_range_profiles(capture), output / "range.png")
    with progress("sheet"):
        save_figure(plot_sheet(sheet, meshes=meshes, columns=2, scale="db"), output / "sheet.png")
    return items


def _capture(scene: Scene, radar: Radar, label: str) -> Capture:
    """Specular and edge frames over the raster, added with the material's weights."""
    trajectory = Trajectory.raster(size=_SIZE, step=radar.waveform.wavelength / 2)
    parts = []
    for model in ("specular", "edge"):
        with progress(f"{label}: {model}") as report:
            parts.append(simulate(scene, radar, trajectory, model=model, progress=report))
    return combine(parts[0], parts[1], scene.alpha)


def _facts(scene: Scene, capture: Capture, image: SarImage) -> dict[str, object]:
    a1, a2 = scene.alpha
    return {
        "object": " x ".join(f"{e * 100:.1f}" for e in scene.mesh.extent) + f" cm, {scene.objects[0].material.name}",
        "weights": f"specular {a1:g}, edge {a2:g}",
        "capture": f"{capture.channels} positions, {capture.radar.waveform.samples_per_chirp} samples each",
        "image": " x ".join(map(str, image.grid.shape)) + " voxels",
        "lit": f"{100 * capture.metadata['lit_fraction']:.0f} % of the vertices of the mesh, from at least one "
        "position",
    }
