"""Lids, cloths and bags over objects: how well a threshold finds the object before and after `remove_sheets`.

    python examples/sheets.py OUT [SCENE ...]

Scenes of the virtual rig with 9 cm of margin around each object, at 77 and 24 GHz: in sight, under the sheet, and with
the sheet taken off the image or the frames. Prints a table in Markdown: F1 of the best threshold of the projected image
against the object's true outline [%], by how much the image in sight changes [%], and the object's peak over that in
sight [dB], with the loss of the sheet in it. Draws the images of a few scenes into OUT, and keeps the echoes there,
since each scene takes some two minutes on one core.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import millisight as ms
from millisight.core import rotation_from_euler_deg
from millisight.data import LAYERED, Layer
from millisight.evaluation import bootstrap_interval
from millisight.imaging import remove_sheets
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
    footprint,
)

MARGIN = 0.09  # of aperture and image around the object [m]
NOISE = 1e-3  # power over that of the echoes
BAG = ((2.25 - 0.002j, 6e-5),)
CLOTH = LAYERED["cloth"]
# Preset, steps between poses along x and y [m], and of how many samples one is kept, over the same band.
BANDS = {
    "77": (RadarSettings(), (0.0078, 0.0025), 8),
    "24": (RadarSettings(preset="position2go", mount=(0.0, 0.0, 0.0)), (0.006, 0.006), 8),
}


def board(thickness: float) -> tuple[Any, ...]:
    """Corrugated board: liner, flute, liner [m]."""
    front, flute, back = LAYERED["carton"]
    return front, Layer(flute.material, thickness - front.thickness - back.thickness), back


def lid(layers: Any, above: float, **place: Any) -> dict[str, Any]:
    """A sheet `above` the object's top [m]: its `size`, its place `at` off the image's middle [m], `tilt` about x and
    y [degrees], `bow` along x [m]."""
    return {"layers": layers, "above": above, "size": (0.3, 0.3), "at": (0, 0), "tilt": (0, 0), "bow": 0.0, **place}


# Object, its rotation [degrees], its place off the image's middle [m], and sheets; or the clearance of a carton [m].
# The method was chosen on the first twenty.
SCENES: dict[str, tuple[str, tuple[float, float, float], tuple[float, float], Any]] = {
    "mug3": ("mug", (0, 0, 30), (0, 0), [lid(board(3e-3), 0.02)]),
    "golf3t": ("golf_ball", (0, 0, 0), (0.02, -0.01), [lid(board(3e-3), 0.03, tilt=(2, 1))]),
    "padlock25": ("padlock", (0, 0, 20), (-0.01, 0.02), [lid(board(2.5e-3), 0.005)]),
    "tuna35": ("tuna_fish_can", (0, 0, 0), (0, 0.02), [lid(board(3.5e-3), 0.05, tilt=(-1, 0.5))]),
    "banana3b": ("banana", (0, 0, 40), (0, 0), [lid(board(3e-3), 0.015, bow=0.003)]),
    "strawhalf": ("strawberry", (0, 0, 0), (0, 0), [lid(board(3e-3), 0.02, size=(0.3, 0.2), at=(0, 0.09))]),
    "rubik2": ("rubiks_cube", (0, 0, 15), (0.02, 0), [lid(board(3e-3), 0.03, tilt=(0, 1)), lid(CLOTH, 0.06)]),
    "clamp5": ("medium_clamp", (0, 0, 50), (0, 0), [lid(board(2.8e-3), 0.03, tilt=(5, 0))]),
    "lemon3": ("lemon", (0, 0, 0), (0.01, 0.02), [lid(board(3e-3), 0.02, tilt=(0.5, -1))]),
    "meat3": ("potted_meat_can", (0, 0, 25), (-0.02, 0), [lid(board(3.2e-3), 0.03, tilt=(1, 1))]),
    "pear25": ("pear", (0, 90, 0), (0, 0), [lid(board(2.5e-3), 0.01)]),
    "cup4": ("g_cups", (0, 0, 0), (0.02, 0.02), [lid(board(4e-3), 0.1, tilt=(-2, 2))]),
    "lego3b": ("a_lego_duplo", (0, 0, 30), (0, -0.02), [lid(board(3e-3), 0.02, bow=0.004, tilt=(1, 0))]),
    "softpart": ("softball", (0, 0, 0), (0, 0), [lid(board(3e-3), 0.015, size=(0.2, 0.3), at=(-0.06, 0))]),
    "mark35": ("large_marker", (90, 0, 40), (0, 0.01), [lid(board(3.5e-3), 0.04, tilt=(3, 0))]),
    "foam2": ("foam_brick", (0, 0, 10), (0.01, 0), [lid(board(3e-3), 0.03), lid(CLOTH, 0.035)]),
    "gelbag": ("gelatin_box", (0, 0, 35), (0, 0), [lid(BAG, 0.01, tilt=(2, -1))]),
    "applec": ("apple", (0, 0, 0), (0.01, 0.01), 0.06),
    "lockbox": ("padlock", (0, 0, 20), (0.01, 0), 0.02),
    "meatbox": ("potted_meat_can", (0, 0, 10), (0, 0.01), 0.02),
    "orangebox": ("orange", (0, 0, 0), (0.01, -0.02), 0.02),
    "peach2": ("peach", (0, 0, 0), (-0.02, 0.01), [lid(board(2.7e-3), 0.03, tilt=(-1.5, 0.7))]),
    "soup3": ("tomato_soup_can", (0, 0, 0), (0, 0.01), [lid(board(3.2e-3), 0.06, tilt=(0.5, 0.5))]),
    "tennisb": ("tennis_ball", (0, 0, 0), (0.01, 0), [lid(board(3.5e-3), 0.04, tilt=(-1, 0), bow=0.002)]),
    "pudpart": ("pudding_box", (0, 0, 20), (0, 0), [lid(board(2.5e-3), 0.02, size=(0.22, 0.3), at=(0.08, 0.02))]),
    "plum3": ("plum", (0, 0, 0), (0.02, 0.01), [lid(board(3e-3), 0.02, tilt=(4, -2))]),
    "soupbox": ("tomato_soup_can", (0, 0, 0), (0.01, 0.01), 0.02),
}
CHOSEN_ON = 20
DRAWN = ("golf3t", "pear25", "strawhalf", "tuna35")


def radar(band: str) -> ms.Radar:
    """The preset with fewer samples, and at 77 GHz with receivers twice as far apart, so that half the rows do."""
    settings, _, keep = BANDS[band]
    full = settings.radar
    receivers = full.array.rx_positions
    if len(receivers) == 4:
        receivers = 2 * receivers - receivers[-1:]
    w = full.waveform
    return ms.Radar(
        name=full.name,
        waveform=ms.Waveform(
            start_frequency=w.start_frequency,
            slope=w.slope * keep,
            sample_rate=w.sample_rate,
            samples_per_chirp=w.samples_per_chirp // keep,
        ),
        array=ms.AntennaArray(tx_positions=full.array.tx_positions, rx_positions=receivers),
        path_offset=full.path_offset,
    )


def sheets_of(spec: dict[str, Any], middle: np.ndarray, top: float) -> tuple[Sheet, ...]:
    """A flat sheet, or one bowed along x as 30 strips."""
    turn = rotation_from_euler_deg((*spec["tilt"], 0.0))
    (long, wide), bow = spec["size"], spec["bow"]
    centre = np.array([middle[0] + spec["at"][0], middle[1] + spec["at"][1], top + spec["above"]])
    edges = np.linspace(-long / 2, long / 2, 31 if bow else 2)
    heights = bow * (1 - (2 * edges / long) ** 2)
    return tuple(
        Sheet(
            corner=centre + turn @ [a, -wide / 2, low],
            u=turn @ [b - a, 0, high - low],
            v=turn @ [0, wide, 0],
            layers=spec["layers"],
        )
        for a, b, low, high in zip(edges[:-1], edges[1:], heights[:-1], heights[1:], strict=True)
    )


def layout_of(name: str, band: str) -> WorldLayout:
    """The object on its support, and the carton's panels where it lies in one."""
    item, rotation, _, cover = SCENES[name]
    thing = WorldObject(object=item, rotate_deg=rotation)
    carton = Carton(clearance=cover) if isinstance(cover, float) else None
    return build_layout(
        World(objects=(thing,), carton=carton, radars=(BANDS[band][0],), scan=ScanSettings(size=(0.45, 0.55)))
    )


def scan(name: str, band: str) -> dict[str, Any]:
    """Frames in sight and under the sheets, positions, grid and true outline of a scene."""
    _, _, offset, cover = SCENES[name]
    settings, steps, _ = BANDS[band]
    device, layout = radar(band), layout_of(name, band)
    lower, upper = layout.objects[0].bounds
    middle, reach = (lower + upper) / 2 - [*offset, 0], (upper - lower)[:2] / 2 + MARGIN
    x, y = (m + s * np.arange(-(h // s), h // s + 1) for m, h, s in zip(middle, reach, steps, strict=False))
    shift = np.ptp(device.array.rx_positions, axis=0)[0] / 2
    places = np.stack([*np.meshgrid(x + shift, y, [0.0], indexing="ij")], axis=-1).reshape(-1, 3)
    path = trajectory(places)
    if layout.panels:
        hidden = tuple(Sheet(corner=p.corner, u=p.u, v=p.v, layers=board(3e-3)) for p in layout.panels)
    else:
        hidden = tuple(sheet for spec in cover for sheet in sheets_of(spec, middle, upper[2]))
    parts = [Part(mesh=part.mesh, material=part.material) for part in layout.parts]
    found: dict[str, Any] = {"places": places}
    for condition, sheets in (("open", ()), ("hidden", hidden)):
        model = EchoModel(parts, device, path, occluders=sheets, bounces=1, antenna=settings.antenna, rng=0)
        frames, rng = model.frames(path), np.random.default_rng(1)
        noise = (rng.normal(size=frames.shape) + 1j * rng.normal(size=frames.shape)).astype(np.complex64)
        found[condition] = frames + noise * np.float32(np.sqrt((abs(frames) ** 2).mean() / 2 * NOISE))
    grid = ms.VoxelGrid.regular(
        (*(middle[:2] - reach), -0.32), (*(middle[:2] + reach), -0.1499), (0.0025, 0.0025, 0.01)
    )
    return found | {"mask": footprint(layout, grid.xy).inside, "x": grid.x, "y": grid.y, "z": grid.z}


def trajectory(places: np.ndarray) -> ms.Trajectory:
    return ms.Trajectory(times=np.arange(float(len(places))), positions=places)


def kept_scan(name: str, band: str, folder: Path) -> dict[str, Any]:
    """What `scan` gives, kept in the folder."""
    kept = folder / f"{name}-{band}.npz"
    if not kept.exists():
        np.savez(kept, **scan(name, band))
    with np.load(kept) as data:
        return dict(data)


def best_f1(image: ms.SarImage, mask: np.ndarray) -> float:
    """Of the threshold that suits the mask best [%]."""
    order = np.argsort(image.project(), axis=None)[::-1]
    hits = np.cumsum(mask.ravel()[order])
    return 100 * float((2 * hits / (np.arange(1, len(order) + 1) + mask.sum())).max())


def measure(name: str, band: str, folder: Path) -> tuple[list[float], list[ms.SarImage]]:
    """F1 in sight, hidden, cleaned image, cleaned frames, and change in sight; and the images of the first four."""
    found = kept_scan(name, band, folder)
    grid = ms.VoxelGrid(x=found["x"], y=found["y"], z=found["z"])
    captures = [
        ms.Capture(radar=radar(band), trajectory=trajectory(found["places"]), frames=found[condition])
        for condition in ("open", "hidden")
    ]
    sight, hidden = (ms.form_image(capture, grid, tolerance=0.02) for capture in captures)
    frequency = captures[0].radar.waveform.center_frequency
    image = remove_sheets(hidden, frequency=frequency).result
    removal = remove_sheets(captures[1])
    # As the command line does: the frames, and the image where nothing was found in them.
    frames = ms.form_image(removal.result, grid, tolerance=0.02) if removal.sheets else image
    changes = (
        remove_sheets(sight, frequency=frequency).result.values - sight.values,
        ms.form_image(remove_sheets(captures[0]).result, grid, tolerance=0.02).values - sight.values,
    )
    change = 100 * max(float(np.linalg.norm(c)) for c in changes) / float(np.linalg.norm(sight.values))
    images = [sight, hidden, image, frames]
    mask = found["mask"]
    peaks = [20 * np.log10(one.magnitude[mask].max() / sight.magnitude[mask].max()) for one in (image, frames)]
    return [*(best_f1(one, mask) for one in images), change, *peaks], images


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1].startswith("-") or set(sys.argv[2:]) - set(SCENES):
        print(f"usage: {__doc__.splitlines()[2].strip()}\nscenes: {', '.join(SCENES)}", file=sys.stderr)
        sys.exit(2)
    folder, names = Path(sys.argv[1]), sys.argv[2:] or list(SCENES)
    folder.mkdir(parents=True, exist_ok=True)
    print("| scene | GHz | in sight | hidden | image | frames | change in sight | peak, image | peak, frames |")
    print("|---|---|---|---|---|---|---|---|---|")
    table: dict[str, list[list[float]]] = {band: [] for band in BANDS}
    drawn: dict[str, ms.SarImage] = {}
    for name in names:
        for band in BANDS:
            row, images = measure(name, band, folder)
            table[band].append(row)
            print(f"| {name} | {band} |" + "".join(f" {value:.1f} |" for value in row), flush=True)
            if name in DRAWN and band == "77":
                titles = ("in sight", "hidden", "taken off the image", "taken off the frames")
                drawn |= {f"{name}, {title}": one for title, one in zip(titles, images, strict=True)}
    parts = {"chosen on": list(SCENES)[:CHOSEN_ON], "others": list(SCENES)[CHOSEN_ON:]}
    for label, of in parts.items():
        for band, rows in table.items():
            some = np.array([row for name, row in zip(names, rows, strict=True) if name in of])
            if len(some) < 2:
                continue
            print(
                f"| **{label}, {len(some)}: median** | {band} |"
                + "".join(f" {v:.1f} |" for v in np.median(some, axis=0))
            )
            for what, column in (("image", 2), ("frames", 3)):
                gain = some[:, column] - some[:, 1]
                low, high = bootstrap_interval(gain, np.mean, rng=0)
                print(f"\n{label}, {band} GHz, {what}: mean gain {gain.mean():+.1f} ({low:+.1f} to {high:+.1f})\n")
    if drawn:
        from millisight.viz import plot_sheet, save_figure

        save_figure(plot_sheet(drawn, columns=4), folder / "sheets.png")
        print(f"wrote {folder / 'sheets.png'}")


if __name__ == "__main__":
    main()
