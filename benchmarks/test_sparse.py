"""Sparse reconstruction of ten scenes of the virtual rig: PSNR from all rows, from half and from a quarter of them.

    make bench TESTS=benchmarks/test_sparse.py

Takes about twenty minutes on two cores, most of it for the rig's echoes. Each scene is scanned by the 77 GHz radar over
14 x 14 cm in rows 2.2 mm apart, as published, with the rig's noise and errors of the path. What is measured is the
middle of it, 10.5 x 10.5 cm, 48 rows; half and a quarter of them are spread evenly over the same aperture.

PSNR is 20 log10 of the largest magnitude of a reference over the rms difference of magnitudes, over all voxels of the
grid. There are two references, both without noise and from the true path: "finer", the image of the whole 14 x 14 cm,
which no image of the middle is; and "same", the image of all rows of the middle. Against the first, the rows that are
missing count beside what the aperture resolves; against the second, beside the noise of all rows alone.
"""

import tempfile
import time

import numpy as np
import pytest

import millisight as ms
from millisight.io.mito import read_experiment
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import (
    ArmSettings,
    Carton,
    OpticsSettings,
    RadarSettings,
    ScanSettings,
    VirtualRig,
    World,
    WorldObject,
    build_layout,
    experiment_folder_of,
    experiment_info,
    optics_of,
)

SCENES = {
    "mug": 0, "padlock": -20, "golf_ball": 0, "medium_clamp": 30, "padlock, carton": -20, "potted_meat_can": 0,
    "large_marker": 45, "gelatin_box": 0, "rubiks_cube": 30, "tuna_fish_can": 0,
}  # fmt: skip
"""Objects, and how they are turned [degrees]."""

SIZE, MIDDLE, SPACING = 0.14, 0.105, 0.0022  # of the scan, of what is measured of it, of its rows [m]


def scanned(name: str) -> tuple[ms.Capture, ms.Capture, np.ndarray]:
    """A scan as measured, the same from the true path without noise, and the object's box (2, 3) [m]."""
    thing, _, box = name.partition(", ")
    world = World(
        seed=len(name),
        objects=(WorldObject(object=thing, rotate_deg=(0, 0, SCENES[name])),),
        carton=Carton() if box else None,
        scan=ScanSettings(size=(SIZE, SIZE), row_spacing=SPACING),
        arm=ArmSettings(speed=0.65, acceleration=8.0, settle=0.02),
        radars=(RadarSettings(),),
        optics=OpticsSettings(bounces=1),
    )
    layout = build_layout(world)
    optics, echoes = optics_of(layout), {}

    def kept(settings, trajectory):
        made = optics(settings, trajectory)
        echoes.update(zip(map(bytes, trajectory.positions), made, strict=True))
        return made

    rig = VirtualRig(world, layout=layout, frames=kept)
    with tempfile.TemporaryDirectory() as folder:
        out = experiment_folder_of(world, folder, 1)
        record_scan(rig.arm, rig.radars, None, rig.plan, PublishedWriter(out, info=experiment_info(world), hdf5=False))
        capture = read_experiment(out, "77_ghz").to_capture()
    truth = rig.truth("77_ghz")
    places = truth.positions[np.searchsorted(truth.times, capture.trajectory.times - 1e-4)]
    perfect = ms.Capture(
        radar=capture.radar,
        trajectory=ms.Trajectory(times=capture.trajectory.times, positions=places),
        frames=np.stack([echoes[bytes(place)] for place in places]),
    )
    return capture, perfect, np.array(rig.layout.objects[0].bounds)


def part(capture: ms.Capture, keep: np.ndarray) -> ms.Capture:
    path = ms.Trajectory(times=capture.trajectory.times[keep], positions=capture.trajectory.positions[keep])
    return ms.Capture(radar=capture.radar, trajectory=path, frames=capture.frames[keep])


def of_rows(capture: ms.Capture, share: int = 1) -> ms.Capture:
    """The middle of a scan, all of its rows or one in `share`, the outermost among them."""
    x, y = capture.trajectory.positions[:, :2].T
    row = np.rint(x / SPACING)
    inside = (np.abs(row * SPACING - SIZE / 2) <= MIDDLE / 2) & (np.abs(y - SIZE / 2) <= MIDDLE / 2)
    rows = np.unique(row[inside])
    some = rows[np.linspace(0, len(rows) - 1, round(len(rows) / share)).round().astype(int)]
    return part(capture, inside & np.isin(row, some))


def psnr(image: np.ndarray, reference: np.ndarray) -> float:
    """Of magnitudes [dB]."""
    error = np.sqrt(np.mean((np.abs(image) - np.abs(reference)) ** 2))
    return float(20 * np.log10(np.abs(reference).max() / error))


def measured(capture: ms.Capture, perfect: ms.Capture, box: np.ndarray) -> tuple[dict, dict, float]:
    """Images by (rows' share, method), PSNR of each against both references [dB], and the seconds of both sparse."""
    grid = ms.VoxelGrid.regular(box[0] - 0.015, box[1] + 0.015, (0.002, 0.002, 0.01))
    references = {
        "finer": ms.form_image(perfect, grid).values,
        "same": ms.form_image(of_rows(perfect), grid).values,
    }
    images = {(1, "fast"): ms.form_image(of_rows(capture), grid)}
    # The converter counts in units of its own.
    everything, same = images[1, "fast"].values, references["same"]
    gain = abs(np.vdot(same, everything)) / np.linalg.norm(same) ** 2
    taken = 0.0
    for share in (2, 4):
        few = of_rows(capture, share)
        images[share, "fast"] = ms.form_image(few, grid)
        start = time.perf_counter()
        images[share, "sparse"] = ms.form_image(few, grid, method="sparse")
        taken += time.perf_counter() - start
    found = {
        (name, *key): psnr(image.values / gain, reference)
        for name, reference in references.items()
        for key, image in images.items()
    }
    return images, found, taken


COLUMNS = ((1, "fast"), (2, "fast"), (2, "sparse"), (4, "fast"), (4, "sparse"))


def line(name: str, found: dict, reference: str) -> str:
    return f"| {name} | " + " | ".join(f"{found[reference, *key]:.1f}" for key in COLUMNS) + " |"


def table(rows: dict[str, dict], reference: str) -> str:
    """Markdown: PSNR of every scene against a reference, and the mean."""
    mean = {key: np.mean([found[key] for found in rows.values()]) for key in next(iter(rows.values()))}
    head = f"| {reference} | all rows | half | half, sparse | a quarter | a quarter, sparse |\n|---{'|---' * 5}|"
    return "\n".join([head, *(line(name, found, reference) for name, found in {**rows, "mean": mean}.items())])


@pytest.fixture(scope="module")
def figures():
    rows = {}
    for name in SCENES:
        _, rows[name], taken = measured(*scanned(name))
        print(f"\n{name}: {taken:.0f} s for both sparse images", end="", flush=True)
    return rows


@pytest.mark.parametrize("reference", ["finer", "same"])
def test_ten_scenes(figures, reference):
    """Against the finer image: half of the rows within 1 dB of all, a quarter within 2 dB. Always above plain ones."""
    assert len(figures) == 10
    print(f"\n{table(figures, reference)}")
    for found in figures.values():
        of = {key: found[reference, *key] for key in COLUMNS}
        assert of[2, "sparse"] > of[2, "fast"] - 0.1
        assert of[4, "sparse"] > of[4, "fast"] + 3
        if reference == "finer":
            assert of[2, "sparse"] > of[1, "fast"] - 1
            assert of[4, "sparse"] > of[1, "fast"] - 2
