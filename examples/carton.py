"""An object in the open and in a carton of 2.5, 3 and 3.5 mm of board, at 24 and 77 GHz: how alike the images are.

    python examples/carton.py fork carton.png

Prints the uncentred normalised correlation of each complex image with the open scene's, and draws their projections.
Without noise and with the arm on its plan: what differs is the carton. Takes a minute or two on two cores.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import millisight as ms
from millisight.data import LAYERED, Layer
from millisight.rig.virtual import (
    Carton,
    EchoModel,
    Part,
    RadarSettings,
    ScanSettings,
    Sheet,
    World,
    WorldLayout,
    WorldObject,
    build_layout,
)

RADARS = {
    "24 GHz": (RadarSettings(preset="position2go", mount=(0.0, 0.0, 0.0)), (0.006, 0.006)),
    "77 GHz": (RadarSettings(), (0.0039, 0.0025)),
}
MARGIN = 0.04  # of the aperture around the object [m]


def layout_of(name: str, settings: RadarSettings) -> WorldLayout:
    """The object on its tripod, with the carton's walls at hand."""
    scan = ScanSettings(size=(0.4, 0.4))
    return build_layout(World(objects=(WorldObject(object=name),), carton=Carton(), radars=(settings,), scan=scan))


def board(thickness: float) -> tuple[Layer, ...]:
    """Liner, flute, liner; the flute is what makes it so thick [m]."""
    front, flute, back = LAYERED["carton"]
    return front, Layer(flute.material, thickness - front.thickness - back.thickness), back


def image(
    layout: WorldLayout, settings: RadarSettings, steps: tuple[float, float], thickness: float | None
) -> ms.SarImage:
    """Of the layout in a carton of such a board; None: in the open."""
    lower, upper = layout.objects[0].bounds
    reach = (upper - lower)[:2] / 2 + MARGIN
    x, y = (middle + step * np.arange(-(half // step), half // step + 1)
            for middle, half, step in zip((lower + upper) / 2, reach, steps, strict=False))  # fmt: skip
    middle_of_array = np.ptp(settings.radar.array.rx_positions, axis=0)[0] / 2
    places = np.stack([*np.meshgrid(x + middle_of_array, y, [0.0], indexing="ij")], axis=-1).reshape(-1, 3)
    path = ms.Trajectory(times=np.arange(float(len(places))), positions=places)
    sheets = () if thickness is None else tuple(
        Sheet(corner=panel.corner, u=panel.u, v=panel.v, layers=board(thickness)) for panel in layout.panels
    )  # fmt: skip
    parts = [Part(mesh=part.mesh, material=part.material) for part in layout.parts]
    model = EchoModel(parts, settings.radar, path, occluders=sheets, antenna=settings.antenna, rng=0)
    capture = ms.Capture(radar=settings.radar, trajectory=path, frames=model.frames(path))
    return ms.form_image(capture, ms.VoxelGrid.regular(lower - 0.03, upper + 0.03, (0.0025, 0.0025, 0.005)))


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    name, out = sys.argv[1:]
    figure, axes = plt.subplots(2, 4, figsize=(5.8, 6.5), layout="constrained", sharex=True, sharey=True)
    for row, (band, (settings, steps)) in zip(axes, RADARS.items(), strict=True):
        layout = layout_of(name, settings)
        scene = image(layout, settings, steps, None)
        for axis, thickness in zip(row, (None, 2.5e-3, 3e-3, 3.5e-3), strict=True):
            shown, title = scene, "open"
            if thickness is not None:
                shown = image(layout, settings, steps, thickness)
                norms = np.linalg.norm(scene.values) * np.linalg.norm(shown.values)
                match = abs(np.vdot(scene.values, shown.values)) / norms
                title = f"{thickness * 1e3:.1f} mm: {match:.3f}"
                print(f"{name}, {band}, {title}", flush=True)
            x, y = 100 * scene.grid.x, 100 * scene.grid.y
            axis.imshow(shown.magnitude.mean(axis=2), extent=(y[0], y[-1], x[-1], x[0]), cmap="viridis")
            axis.set_title(title, fontsize=10)
        row[0].set_ylabel(f"{band}\nx [cm]")
    for axis in axes[-1]:
        axis.set_xlabel("y [cm]")
        axis.locator_params(axis="x", nbins=3, steps=[1, 2, 4, 5, 10])  # a fork's panel is narrow
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    main()
