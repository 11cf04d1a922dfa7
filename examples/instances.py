"""Several objects side by side, in sight and in a carton: how well `segment_instances` finds one mask for each.

    python examples/instances.py OUT [WORLD ...]

Worlds of the virtual rig at 77 GHz, with an aperture 5 cm wider than the objects and an eighth of the samples. The
settings were chosen on the first six worlds; the other six show other objects.
The carton's lid is taken off the frames first. Prints a table in Markdown: instances found and true, precision and
recall at an IoU of 0.5, and the mean IoU of the true objects with what they are matched with, each beside a blind
baseline: as many equal discs as there are objects, placed without looking at the image. Draws the masks into OUT, and
keeps the echoes there, since a world takes minutes of one core.
"""

import sys
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.data import LAYERED
from millisight.evaluation import score_instances
from millisight.imaging import remove_sheets
from millisight.rig.virtual import (
    Carton,
    EchoModel,
    Part,
    RadarSettings,
    ScanSettings,
    Sheet,
    Support,
    World,
    WorldObject,
    build_layout,
    footprint,
)
from millisight.viz import plot_instances, save_figure

MARGIN = 0.05  # of aperture and image around the objects [m]
NOISE = 1e-3  # power over that of the echoes
STEPS = (0.0078, 0.0019)  # between poses along x and y [m]
DISC, RING = 0.03, 0.055  # radius of the blind baseline's discs, and of the ring of their middles [m]
KEEP = 8  # of so many samples one is kept, over the same band
# Objects, their rotation about z [degrees] and place off the middle [m], some of them touching almost.
CALIBRATION = {
    "fruit": [("plum", 0, (-0.05, -0.05)), ("peach", 0, (0.05, -0.03)), ("golf_ball", 0, (0.0, 0.06))],
    "tins": [("tuna_fish_can", 0, (-0.05, 0.0)), ("gelatin_box", 30, (0.06, 0.0))],
    "desk": [("large_marker", 90, (-0.05, 0.0)), ("dice", 20, (0.02, 0.04)), ("c_cups", 0, (0.04, -0.05))],
    "close": [("golf_ball", 0, (-0.025, 0.0)), ("plum", 0, (0.03, 0.0)), ("dice", 0, (0.0, 0.06))],
    "four": [("dice", 0, (-0.06, -0.06)), ("c_cups", 0, (0.05, -0.06)), ("plum", 0, (-0.05, 0.06)),
             ("golf_ball", 0, (0.05, 0.06))],
    "alone": [("tuna_fish_can", 0, (0.0, 0.0))],
}  # fmt: skip
TEST = {
    "trio": [("padlock", 20, (-0.05, -0.05)), ("strawberry", 0, (0.04, -0.04)), ("lemon", 30, (0.0, 0.06))],
    "pair": [("tomato_soup_can", 90, (-0.055, 0.0)), ("rubiks_cube", 15, (0.05, 0.0))],
    "touching": [("lemon", 0, (-0.03, 0.0)), ("strawberry", 90, (0.03, 0.0)), ("g_cups", 0, (0.0, 0.08))],
    "table": [("mug", 40, (-0.06, 0.0)), ("spoon", 80, (0.05, 0.0))],
    "quartet": [("a_lego_duplo", 30, (-0.06, -0.06)), ("strawberry", 0, (0.05, -0.06)), ("g_cups", 0, (-0.05, 0.06)),
                ("padlock", 45, (0.06, 0.06))],
    "one": [("mug", 0, (0.0, 0.0))],
}  # fmt: skip
WORLDS = CALIBRATION | TEST
IN_CARTON = ("close", "fruit", "trio", "quartet")  # in sight and in a carton; the others in sight alone
MIDDLE = (0.2, 0.25)


def radar() -> ms.Radar:
    """The preset with fewer samples and receivers twice as far apart, so that half the rows do."""
    full = RadarSettings().radar
    receivers = full.array.rx_positions
    w = full.waveform
    return ms.Radar(
        name=full.name,
        waveform=ms.Waveform(
            start_frequency=w.start_frequency,
            slope=w.slope * KEEP,
            sample_rate=w.sample_rate,
            samples_per_chirp=w.samples_per_chirp // KEEP,
        ),
        array=ms.AntennaArray(tx_positions=full.array.tx_positions, rx_positions=2 * receivers - receivers[-1:]),
        path_offset=full.path_offset,
    )


def world_of(name: str) -> World:
    """Of the objects of this name, in a carton around them all."""
    things = tuple(
        WorldObject(object=item, rotate_deg=(0.0, 0.0, turn), at=(MIDDLE[0] + x, MIDDLE[1] + y))
        for item, turn, (x, y) in WORLDS[name]
    )
    return World(
        objects=things,
        support=Support(at=things[0].at[:2] if things[0].at else None),
        carton=Carton(clearance=0.06),
        radars=(RadarSettings(),),
        scan=ScanSettings(size=(0.45, 0.55)),
    )


def scan(name: str) -> dict[str, np.ndarray]:
    """Frames in sight and in the carton, positions, grid, and the outline of each object."""
    layout, device = build_layout(world_of(name)), radar()
    bounds = np.array([item.bounds for item in layout.objects])
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    middle, reach = (lower + upper) / 2, (upper - lower)[:2] / 2 + MARGIN
    x, y = (m + s * np.arange(-(h // s), h // s + 1) for m, h, s in zip(middle, reach, STEPS, strict=False))
    shift = np.ptp(device.array.rx_positions, axis=0)[0] / 2
    places = np.stack([*np.meshgrid(x + shift, y, [0.0], indexing="ij")], axis=-1).reshape(-1, 3)
    path = trajectory(places)
    sheets = tuple(Sheet(corner=p.corner, u=p.u, v=p.v, layers=LAYERED["carton"]) for p in layout.panels)
    parts = [Part(mesh=part.mesh, material=part.material) for part in layout.parts]
    found: dict[str, np.ndarray] = {"places": places}
    for condition, occluders in (("open", ()), *([("carton", sheets)] if name in IN_CARTON else [])):
        model = EchoModel(parts, device, path, occluders=occluders, bounces=1, antenna=RadarSettings().antenna, rng=0)
        frames, rng = model.frames(path), np.random.default_rng(1)
        noise = (rng.normal(size=frames.shape) + 1j * rng.normal(size=frames.shape)).astype(np.complex64)
        found[condition] = frames + noise * np.float32(np.sqrt((abs(frames) ** 2).mean() / 2 * NOISE))
    grid = ms.VoxelGrid.regular(
        (*(middle[:2] - reach), -0.32), (*(middle[:2] + reach), -0.1499), (0.0025, 0.0025, 0.01)
    )
    outlines = np.stack([footprint(layout, grid.xy, item.number).inside for item in layout.objects])
    return found | {"outlines": outlines, "x": grid.x, "y": grid.y, "z": grid.z}


def trajectory(places: np.ndarray) -> ms.Trajectory:
    return ms.Trajectory(times=np.arange(float(len(places))), positions=places)


def truth_of(found: dict[str, np.ndarray], grid: ms.PixelGrid) -> ms.Instances:
    """The outlines; where one object lies over another, the later one."""
    labels = np.zeros(grid.shape, np.int32)
    for number, inside in enumerate(found["outlines"], 1):
        labels[inside] = number
    return ms.Instances(grid_xy=grid, labels=labels, scores=np.zeros(len(found["outlines"])))


def blind(count: int, grid: ms.PixelGrid) -> ms.Instances:
    """As many equal discs as there are objects, the first in the middle if it is alone, else evenly on a ring."""
    middle = np.array([grid.x.mean(), grid.y.mean()])
    angles = 2 * np.pi * np.arange(count) / count
    ring = 0.0 if count == 1 else RING
    labels = np.zeros(grid.shape, np.int32)
    for number, center in enumerate(middle + ring * np.stack([np.cos(angles), np.sin(angles)], axis=1), 1):
        labels[np.hypot(grid.x[:, None] - center[0], grid.y - center[1]) < DISC] = number
    return ms.Instances(grid_xy=grid, labels=labels, scores=np.zeros(count))


def images_of(found: dict[str, np.ndarray]) -> dict[str, ms.SarImage]:
    """In sight; in the carton; and with its lid taken off, as `millisight image --clutter lid` does."""
    grid = ms.VoxelGrid(x=found["x"], y=found["y"], z=found["z"])
    made = {}
    for condition in ("open", "carton"):
        if condition in found:
            capture = ms.Capture(radar=radar(), trajectory=trajectory(found["places"]), frames=found[condition])
            made[condition] = ms.form_image(capture, grid, tolerance=0.02)
            if condition == "carton":
                removal = remove_sheets(capture)
                frequency = capture.radar.waveform.center_frequency
                made["lid off"] = (
                    ms.form_image(removal.result, grid, tolerance=0.02)
                    if removal.sheets
                    else remove_sheets(made[condition], frequency=frequency).result
                )
    return made


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1].startswith("-") or set(sys.argv[2:]) - set(WORLDS):
        print(f"usage: {__doc__.splitlines()[2].strip()}\nworlds: {', '.join(WORLDS)}", file=sys.stderr)
        sys.exit(2)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    print("| world | | found / true | precision | recall | mean IoU | blind: mean IoU |")
    print("|---|---|---|---|---|---|---|")
    totals: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    for name in sys.argv[2:] or WORLDS:
        kept = folder / f"{name}.npz"
        if not kept.exists():
            np.savez(kept, **scan(name))
        with np.load(kept) as data:
            found = dict(data)
        for condition, image in images_of(found).items():
            truth = truth_of(found, image.grid.xy)
            seen = ms.segment_instances(image)
            save_figure(
                plot_instances(seen, image=image, title=f"{name}, {condition}"), folder / f"{name}-{condition}.png"
            )
            one, other = (score_instances(given, truth) for given in (seen, blind(len(truth), image.grid.xy)))
            print(
                f"| {name} | {condition} | {one.found} / {one.true} | {one.precision:.2f} | {one.recall:.2f} | "
                f"{one.mean_iou:.2f} | {other.mean_iou:.2f} |",
                flush=True,
            )
            side = "calibration" if name in CALIBRATION else "test"
            exact = float(one.found == one.true)
            row = (exact, one.precision, one.recall, one.mean_iou, other.precision, other.recall, other.mean_iou)
            totals.setdefault((side, condition), []).append(row)
    print(
        "\n| means | | images | right number | precision | recall | mean IoU | blind: precision | recall | mean IoU |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for (side, condition), rows in totals.items():
        values = " | ".join(f"{value:.2f}" for value in np.mean(rows, axis=0))
        print(f"| {side} | {condition} | {len(rows)} | {values} |")


if __name__ == "__main__":
    main()
