"""The published dataset in miniature, in its true layout, made from simulated captures; and one of each thing that
goes wrong with it.

    python tests/helpers/miniature.py DIR

makes `DIR/MITO_Miniature`, which is whole but for what is told missing, and `DIR/MITO_Faults`, one object a fault.
"""

import json
import os
import pickle
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

import millisight as ms
from millisight.data import CameraFrame, CameraMask, Intrinsics
from millisight.io.mito import (
    BASE_ORIGIN,
    FRAME_PERIODS,
    RecordedRow,
    angles_folder,
    experiment_folder,
    experiment_radar,
    published_grid,
    radar_folder,
    write_published,
    write_raw_experiment,
)
from millisight.io.raw import read_dca1000, write_dca1000

MUG, BOX = "025_mug", "004_sugar_box"
EMPTY, BACKGROUND = "0210_EMPTY", "000_background"
ANGLES = (0, 0, 90)
INFOS = {
    1: {"aperture size": "normal", "rx offset": "x", "background": "tripod"},
    2: {"aperture size": "almost-square", "rx offset": "y", "background": "styrofoam"},
}
CENTER = np.array([0.12, 0.14, -0.26])  # of an object, in the world frame [m]
ROWS, FRAMES, PAUSE = {"77_ghz": 4, "24_ghz": 3}, {"77_ghz": 12, "24_ghz": 4}, 2
STEP = {"77_ghz": 0.002, "24_ghz": 0.008}  # of the robot between frames, and between rows [m]
FULL_SCALE = 20_000  # of the quantised frames
NUMBERS = {"77_ghz": 1_700_000_000, "24_ghz": 1_700_500_000}


class Miniature(NamedTuple):
    """Where it lies; the two datasets are read, never written to."""

    healthy: Path
    faults: Path


def make(folder):
    """The two datasets under `folder`."""
    healthy, faults = Path(folder) / "MITO_Miniature", Path(folder) / "MITO_Faults"
    for name in (MUG, BOX):
        scene = small_scene(name)
        for number in INFOS:
            for sight in ("los", "nlos"):
                if (name, number, sight) == (BOX, 2, "nlos"):
                    continue  # not every experiment was made
                add_experiment(healthy, name, number, sight, scene, raw=(name, number) != (BOX, 2))
        add_simulation(healthy, name, scene)
    add_scenes(healthy)
    make_faults(faults, healthy)
    return Miniature(healthy, faults)


def small_scene(name):
    """A few vertices of an object of the catalogue, where the published images are."""
    return ms.Scene.from_mesh(name[4:], vertices=100, rotate_deg=ANGLES).moved(CENTER)


def add_experiment(root, name, number, sight, scene, *, raw=True):
    """Both radars' images, masks, raw files; of the mug in sight a camera frame and its mask."""
    folder = experiment_folder(root, name, ANGLES, number, sight)
    folder.mkdir(parents=True)
    info = INFOS[number]
    (folder.parent / "experiment_info.json").write_text(json.dumps(info))
    for radar in ("77_ghz", "24_ghz"):
        rows, log = recorded(scene, radar, info, dim=sight == "nlos")
        if raw:
            write_raw_experiment(folder, radar, rows, log, info=info, fill=False)
        add_image(folder, radar, scene, info, log, rows)
    if name == MUG and sight == "los":
        add_camera(folder, number)


def scanned(radar, info):
    """(log, row times): a serpentine of rows along y, the robot pausing at each row's start."""
    period = FRAME_PERIODS[radar, info["aperture size"]]
    rows, frames, step = ROWS[radar], FRAMES[radar], STEP[radar]
    lead, length = 8, frames + PAUSE
    start = 1_700_000_000.0 if info["aperture size"] == "normal" else 1_710_000_000.0
    along = np.concatenate([np.zeros(PAUSE), np.arange(frames)]) * step
    ticks, places = [], []
    for row in range(rows):
        ys = along if row % 2 == 0 else along[PAUSE:].max() - along
        ticks.append(row * (length + lead) + np.arange(length))
        places.append(np.column_stack([np.full(length, row * step), ys, np.zeros(length)]))
    known = np.concatenate(ticks)
    path = np.concatenate(places) - [rows * step / 2, frames * step / 2, 0] + [*CENTER[:2], 0.0]
    fine = np.arange(-2, known[-1] + 2.01, 0.25)
    positions = np.column_stack([np.interp(fine, known, path[:, axis]) for axis in range(3)])
    log = ms.Trajectory(times=start + fine * period, positions=positions)
    return log, [start + tick * period for tick in ticks]


def recorded(scene, radar, info, *, dim=False):
    """(rows, log) of a simulated capture, quantised as a recorder does."""
    log, times = scanned(radar, info)
    model = full_radar(radar, info)
    frames = ms.simulate(scene, model, log.at(np.concatenate(times)), model="diffuse").frames
    counts = frames * (FULL_SCALE / np.abs(frames).max() / (4 if dim else 1))
    counts = (np.round(counts.real) + 1j * np.round(counts.imag)).astype(np.complex64)
    parts = np.split(counts, len(times))
    rows = [
        RecordedRow(NUMBERS[radar] + i, float(t[0]), part) for i, (t, part) in enumerate(zip(times, parts, strict=True))
    ]
    return rows, log


def full_radar(radar, info):
    """With every receiver that the recorder writes, whether it is used or not."""
    return experiment_radar(radar, {**info, "aperture size": "almost-square"})


def small_grid(radar, info):
    """A corner of the published grid, around the object and coarse."""
    whole = published_grid(radar, info["background"])
    near = [np.flatnonzero(np.abs(a - c) < 0.06)[::5] for a, c in zip((whole.x, whole.y), CENTER, strict=False)]
    return ms.VoxelGrid(x=whole.x[near[0]], y=whole.y[near[1]], z=whole.z[::6])


def add_image(folder, radar, scene, info, log, rows):
    """The processed image and, at 77 GHz, a mask; old files (exp1) say little of the antennas, new ones all."""
    grid = small_grid(radar, info)
    times = np.concatenate(
        [r.created + np.arange(len(r.frames)) * FRAME_PERIODS[radar, info["aperture size"]] for r in rows]
    )
    capture = ms.Capture(
        radar=full_radar(radar, info), trajectory=log.at(times), frames=np.concatenate([r.frames for r in rows])
    )
    image = ms.form_image(capture, grid)
    new = info["aperture size"] == "almost-square"
    values = image.values.astype(np.complex128) * (1 + 1e-12) if new else image.values
    turned = np.tile([0, 0, 0, 1.0], (len(times), 1))
    extras = {"antenna_locs": np.column_stack([capture.trajectory.positions, turned])} if new else {}
    if not new and radar == "77_ghz":
        extras = {"antenna_locs.times_77": log.times, "antenna_locs.tx_77_locs": log.positions + BASE_ORIGIN}
    target = radar_folder(folder, radar, processed=True)
    target.mkdir(parents=True)
    write_published(target / "processed_image.pkl", ms.SarImage(grid=grid, values=values), extras)
    if radar == "77_ghz":
        seen = image.project("z")
        inside = seen > 0.4 * seen.max()
        stored = {"radar_mask": inside[None]} if new else {}  # as the network returns it
        write_published(target / "radar_masks.pkl", ms.Mask(grid_xy=grid.xy, inside=inside), stored)


def add_camera(folder, number):
    """A picture of a ball; its depth in whole millimetres (exp1) or as floats (exp2), with holes."""
    intrinsics = Intrinsics.published()
    rows, columns = np.mgrid[: intrinsics.height, : intrinsics.width]
    pixels = (rows - 240) ** 2 + (columns - 320) ** 2 < 80**2
    depth = np.where(pixels, 400.0, 600.0)
    rgb = np.where(pixels[..., None], np.uint8([200, 40, 40]), np.uint8([30, 30, 30]))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0.585, -0.003, 0.46
    stored = depth.astype(np.uint16) if number == 1 else np.where(rows == 0, np.nan, depth).astype(np.float32)
    frame = CameraFrame(rgb=rgb, depth=stored, pose=pose, intrinsics=intrinsics)
    target = folder / "unprocessed" / "camera"
    target.mkdir(parents=True)
    write_published(target / "continuous_1.pkl", frame, {"pose": pose.ravel().tolist()} if number == 1 else {})
    masked = np.where(pixels & (rows % 50 > 0), depth, np.nan).astype(np.float32)
    points = intrinsics.points(masked * 1e-3).astype(np.float32)
    target = folder / "processed" / "camera"
    target.mkdir(parents=True)
    write_published(target / "camera_masks.pkl", CameraMask(pixels=pixels, depth=masked, points=points, pose=pose))


def add_simulation(root, name, scene):
    """Specular and edge images by both radars."""
    for radar, preset in (("77_ghz", "mito-sim-77ghz"), ("24_ghz", "mito-sim-24ghz")):
        trajectory = ms.Trajectory.raster(size=(0.03, 0.03), step=0.01, center=(*CENTER[:2], 0.0))
        target = radar_folder(angles_folder(root, name, (0, 0, 0), simulated=True), radar, processed=True)
        target.mkdir(parents=True)
        grid = small_grid(radar, INFOS[1])
        for ext, model in (("_specular", "specular"), ("_edges", "edge")):
            capture = ms.simulate(scene, ms.Radar.preset(preset), trajectory, model=model, tau_deg=60)
            image = ms.form_image(capture, grid)
            write_published(target / f"processed_image{ext}.pkl", image, {"antenna_locs": trajectory.positions})
    (root / name / "nontextured.stl").write_text("solid none\nendsolid none\n")


def add_scenes(root):
    """The empty scene: an image to subtract, and a raw capture to subtract."""
    still = ms.Scene.from_mesh("golf_ball", vertices=100).moved(CENTER + np.array([0.1, 0, -0.1]))
    empty = experiment_folder(root, EMPTY, (0, 0, 0), 1, "los")
    empty.mkdir(parents=True)
    (empty.parent / "experiment_info.json").write_text(json.dumps(INFOS[1]))
    rows, log = recorded(still, "24_ghz", INFOS[1])
    add_image(empty, "24_ghz", still, INFOS[1], log, rows)
    background = experiment_folder(root, BACKGROUND, (0, 0, 0), 1, "los")
    write_raw_experiment(background, "24_ghz", rows, log, info=INFOS[1], fill=False)


FAULTS = (
    "truncated_pickle", "hostile_pickle", "nan_in_image", "wrong_shape", "mask_without_image", "row_missing",
    "row_unlisted", "two_lane", "zero_gap", "cut_file", "big_endian", "short_block", "unequal_log", "log_backwards",
    "log_truncated", "list_unequal", "no_info", "odd_info", "empty_files", "stray_files",
)  # fmt: skip
"""What goes wrong, each in an object of its own, `9<nn>_<fault>`, in experiment 1, in line of sight."""


def fault_folder(faults, name):
    """The experiment in which the fault `name` is."""
    return experiment_folder(faults, f"9{FAULTS.index(name):02d}_{name}", ANGLES, 1, "los")


def make_faults(root, healthy):
    """One object a fault: the mug's first experiment, with one thing wrong."""
    source = experiment_folder(healthy, MUG, ANGLES, 1, "los").parent
    for name in FAULTS:
        folder = fault_folder(root, name)
        folder.mkdir(parents=True)
        shutil.copy(source / "experiment_info.json", folder.parent)
        needed = _NEEDED.get(name, ("processed/radars/77_ghz",))
        for part in needed:
            shutil.copytree(source / "los" / part, folder / part)
        globals()[f"_{name}"](folder)


_RAW_77, _RAW_24 = ("unprocessed/radars/77_ghz",), ("unprocessed/radars/24_ghz",)
_NEEDED = dict.fromkeys(
    ("row_missing", "row_unlisted", "two_lane", "zero_gap", "cut_file", "big_endian", "unequal_log", "log_backwards",
     "log_truncated", "list_unequal", "no_info", "odd_info", "empty_files"), _RAW_77
) | {"short_block": _RAW_24}  # fmt: skip


def raw_file(folder, row=1, radar="77_ghz"):
    """The file of a row of an experiment."""
    return sorted((radar_folder(folder, radar, processed=False) / "radar_data").iterdir())[row]


def image_file(folder):
    return radar_folder(folder, "77_ghz", processed=True) / "processed_image.pkl"


def values_of(path):
    """What a pickle of it holds, a lone None or dictionary unwrapped."""
    values = pickle.loads(path.read_bytes())  # noqa: S301, we made it
    return {k: v.item() if isinstance(v, np.ndarray) and v.dtype == object else v for k, v in values.items()}


def same(a, b):
    """Whether values of pickles are the same to the bit."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and a == b


def _changed(path, **changes):
    """A pickled dictionary with other values."""
    values = pickle.loads(path.read_bytes())  # noqa: S301, it is ours
    path.write_bytes(pickle.dumps({**values, **changes}))


def _truncated_pickle(folder):
    path = image_file(folder)
    path.write_bytes(path.read_bytes()[:-200])


class _Hostile:
    """Asks whoever unpickles it to make a folder."""

    def __init__(self, path):
        self._path = path

    def __reduce__(self):
        return os.mkdir, (str(self._path),)


def hostile_deed(folder):
    """What the hostile pickle would make."""
    return folder / "it-ran"


def _hostile_pickle(folder):
    _changed(image_file(folder), extra=_Hostile(hostile_deed(folder)))


def _nan_in_image(folder):
    image = pickle.loads(image_file(folder).read_bytes())["image"].copy()  # noqa: S301
    image[1, 2, 3] = np.nan
    _changed(image_file(folder), image=image)


def _wrong_shape(folder):
    _changed(image_file(folder).with_name("radar_masks.pkl"), radar_mask=np.ones((3, 4), bool))


def _mask_without_image(folder):
    image_file(folder).unlink()


def _row_missing(folder):
    raw_file(folder).unlink()


def _row_unlisted(folder):
    path = raw_file(folder)
    shutil.copy(path, path.with_name("adc_data1799999999.bin"))


def _two_lane(folder):
    path = raw_file(folder)
    frames = read_dca1000(path, samples=512, order="four-lane").samples
    write_dca1000(path, frames, order="two-lane interleaved")


def _zero_gap(folder):
    path = raw_file(folder)
    content = bytearray(path.read_bytes())
    content[3 * 8192 + 100 : 3 * 8192 + 100 + 2 * 1456] = bytes(2 * 1456)
    path.write_bytes(content)


def _cut_file(folder):
    path = raw_file(folder)
    path.write_bytes(path.read_bytes()[:-5001])


def _big_endian(folder):
    path = raw_file(folder)
    path.write_bytes(np.fromfile(path, "<i2").byteswap().tobytes())


def _short_block(folder):
    path = raw_file(folder, radar="24_ghz")
    lines = path.read_text().splitlines()
    lines[70] = lines[70].rsplit(",", 9)[0]
    path.write_text("\n".join(lines) + "\n")


def _log_file(folder):
    return radar_folder(folder, "77_ghz", processed=False) / "antenna.npz"


def _relogged(folder, change):
    with np.load(_log_file(folder)) as log:
        tables = dict(log)
    change(tables)
    np.savez(_log_file(folder), **tables)


def _unequal_log(folder):
    _relogged(folder, lambda tables: tables.update(times_77=tables["times_77"][:-3]))


def _log_backwards(folder):
    def change(tables):
        tables["times_77"][[40, 41]] = tables["times_77"][[41, 40]]

    _relogged(folder, change)


def _log_truncated(folder):
    _log_file(folder).write_bytes(_log_file(folder).read_bytes()[:-500])


def _list_unequal(folder):
    path = radar_folder(folder, "77_ghz", processed=False) / "continuous.pkl"
    _changed(path, all_radar_created_ts=[1.0, 2.0])


def _no_info(folder):
    (folder.parent / "experiment_info.json").unlink()


def _odd_info(folder):
    (folder.parent / "experiment_info.json").write_text(json.dumps({**INFOS[1], "aperture size": "round"}))


def _empty_files(folder):
    for path in sorted(folder.rglob("*.*")):
        path.write_bytes(b"")


def _stray_files(folder):
    (folder / "notes.txt").write_text("out of place\n")
    (folder.parent / "exp1_backup").mkdir()
    (image_file(folder).parent / "processed_image.pkl.tmp").write_bytes(b"half")
    (folder.parents[3] / "nontextured.stl").write_text("solid none\nendsolid none\n")
    (folder.parents[4] / "figures").mkdir()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/helpers/miniature.py DIR")
    for path in make(Path(sys.argv[1])):
        print(path)  # noqa: T201
