"""The published dataset as its facts have it, in every variation: true names, one image of the true shape, tiny others.

    python tests/helpers/published_mock.py DIR

makes `DIR/MITO_Dataset`. Shapes, keys and types are those of the published files; what they show is a disc.
"""

import json
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from helpers.miniature import recorded, small_scene
from millisight.data import Intrinsics
from millisight.datasets import published_split
from millisight.evaluation import published_radar_from_camera
from millisight.io.mito import BASE_ORIGIN, experiment_folder, write_raw_experiment

MUG, CRACKERS, SUGAR, WRENCH, TUNA = "025_mug", "003_cracker_box", "004_sugar_box", "042_wrench", "007_tuna_fish_can"
PEACH = "015_peach"
ANGLES = {MUG: (0, 0, 90)}
SIMULATED_SCALE = 230 * 550 * 300  # that published simulated images are larger by
SECONDS = 1_700_000_000
TURN = np.array([0.7071, 0.7071, 0.0, 0.0])  # of the tool, as the arm holds it
DEPTH, RADIUS = 0.45, 60  # of the object in the camera's picture [m], [pixels]
LEFT_OUT = ("007_tuna_fish_can/0_0_0/exp2/los",)
MESHES = ("nontextured.stl", "uniform.stl", "uniform_10000.stl", "textured.obj")  # of all but the can
WITHOUT_24_GHZ = (SUGAR, TUNA, PEACH, WRENCH)
FIRST = {"aperture size": "normal", "rx offset": "x", "background": "tripod", "date": "0128", "occlusion": "paper"}
SECOND = {"aperture size": "almost-square", "rx offset": "y", "background": "styrofoam", "mount type": "new"}


def make(folder):
    """The dataset under `folder`."""
    root = Path(folder) / "MITO_Dataset"
    root.mkdir(parents=True)
    (root / "README.md").write_text("# MITO\n")
    (root / ".gitattributes").write_text("*.pkl filter=lfs\n")
    for name, experiments in (("1709602125", False), ("1729816641", True)):
        dump(root / f"test_split_{name}.pkl", split_values(published_split(name), experiments=experiments))
    add_experiment(root, MUG, 1, FIRST, antennas="array", true_shape=True)
    add_experiment(root, CRACKERS, 1, {**FIRST, "aperture size": "large"}, antennas="dictionary")
    add_experiment(root, SUGAR, 1, FIRST, antennas="none", logged=True)
    add_experiment(root, WRENCH, 1, FIRST, antennas="none")
    add_experiment(root, PEACH, 1, FIRST, antennas="nones", slices=6)
    add_experiment(root, MUG, 2, SECOND, antennas="array")
    add_experiment(root, CRACKERS, 2, SECOND, antennas="boxed")
    add_experiment(root, TUNA, 2, SECOND, antennas="array", sights=("los",))
    add_raw(root)
    for name in (MUG, CRACKERS, SUGAR, TUNA, PEACH, WRENCH):
        add_simulation(root, name)
    for date, number in (("0128", 1), ("0228", 1), ("0830", 2)):
        add_empty(root, date, number)
    return root


def split_values(split, *, experiments):
    """What the published pickle of a split holds: tuples as entries and as keys."""

    def key(folder):
        number, _, name = folder.partition("_")
        return number, name

    def entry(image):
        plain = (*key(image.folder), image.simulated, image.sight == "los")
        return (*plain, None if image.simulated else str(image.experiment)) if experiments else plain

    sides = {"train": split.training, "validation": split.validation, "test": split.test}
    classes = {key(folder): shape for folder, shape in split.classes.items()}
    return {side: [entry(one) for one in images] for side, images in sides.items()} | {"classes": classes}


def dump(path, values):
    """A pickle, in folders made for it: of one protocol or another, as NumPy 1 wrote it or NumPy 2."""
    path.parent.mkdir(parents=True, exist_ok=True)
    protocol = 2 + len(path.name) % 4
    held = pickle.dumps(values, protocol=protocol)
    path.write_bytes(held.replace(b"cnumpy._core.", b"cnumpy.core.") if protocol < 4 else held)


def camera_pose(number):
    """(4, 4) of the camera of an experiment."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = (0.45, 0.05, 0.4) if number == 1 else (0.585, -0.003, 0.46)
    return pose


def center_of(number, *, told=True):
    """(2,) x and y of the object in the images [m]: where the published transform puts the middle of its picture."""
    turn = np.diag([1.0, -1.0, -1.0]) if not told else np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, -1]])
    transform = published_radar_from_camera(number, camera_pose(number), BASE_ORIGIN, turn)
    return (transform @ [0, 0, DEPTH, 1])[:2]


def disc(center, radius, grid):
    """(X, Y) bool pixels of x and y around a centre [m]."""
    x, y = grid
    return (x[:, None] - center[0]) ** 2 + (y - center[1]) ** 2 < radius**2


def published_image(center, *, z, true_shape=False, scale=1.0, seed=0, columns=24):
    """Keys and shapes of `processed_image.pkl`, less the antennas'."""
    rng = np.random.default_rng(seed)
    if true_shape:
        x, y = np.arange(-0.1, 0.45, 0.0025), np.arange(-0.05, 0.55, 0.0025)
    else:
        x, y = (round(c, 3) + 0.01 * (np.arange(n) - 12) for c, n in zip(center, (columns, 24), strict=True))
    inside = disc(center, 0.045, (x, y))
    shape = (len(x), len(y), len(z))
    noise = rng.normal(0, 0.01, shape) + 1j * rng.normal(0, 0.01, shape)
    lit = inside[..., None] * np.exp(-0.5 * ((np.arange(len(z)) - 13) / 1.5) ** 2)
    values = scale * (noise + lit * np.exp(2j * np.pi * rng.random(shape)))
    return {"image": values.astype(np.complex64), "x_locs": x, "y_locs": y, "z_locs": z}


def antenna_locs(form, number):
    """What an image says of its antennas, in each published form."""
    table = np.column_stack([np.random.default_rng(number).uniform(0, 0.4, (30, 3)), np.tile(TURN, (30, 1))])
    return {
        "array": table,
        "dictionary": {"tx_77_locs": table, "times_77": np.arange(30.0), "tx_24_locs": table},
        "boxed": np.array({"tx_77_locs": table, "times_77": np.arange(30.0), "tx_24_locs": table}, dtype=object),
        "none": np.array(None),
        "nones": np.array([None] * 30),
    }[form]


def add_experiment(root, name, number, info, *, antennas, true_shape=False, logged=False, slices=None, sights=None):
    """Both sights' images, masks and pictures; of line of sight the camera's mask, too."""
    z = np.arange(-0.37, -0.15, 0.01) if info["background"] == "tripod" else np.arange(-0.55, -0.3, 0.01)
    center = center_of(number, told=antennas in ("array", "dictionary", "boxed") or logged)
    for sight in sights or ("los", "nlos"):
        folder = experiment_folder(root, name, ANGLES.get(name, (0, 0, 0)), number, sight)
        folder.mkdir(parents=True)
        (folder.parent / "experiment_info.json").write_text(json.dumps(info))
        for radar, whole in (("77_ghz", true_shape and sight == "los"), ("24_ghz", False)):
            held = published_image(center, z=z[:slices], true_shape=whole, seed=number)
            place = folder / "processed" / "radars" / radar
            if antennas == "nones":  # in another order and precision, axes as lists
                held |= {
                    "image": np.asfortranarray(held["image"].astype(np.complex128)),
                    "x_locs": list(held["x_locs"]),
                }
            dump(place / "processed_image.pkl", held | {"antenna_locs": antenna_locs(antennas, number)})
            mask = disc(center, 0.04, (np.array(held["x_locs"]), held["y_locs"]))
            dump(place / "radar_masks.pkl", {"radar_mask": mask})
        add_pictures(folder, number)
        if sight == "los":
            add_camera_mask(folder, number)
        if logged:
            add_log(folder)


def add_log(folder):
    """The robot's log alone, as where an image holds no antennas."""
    times = np.linspace(SECONDS, SECONDS + 10, 30)
    table = antenna_locs("array", 1)
    place = folder / "unprocessed" / "radars" / "77_ghz"
    place.mkdir(parents=True)
    np.savez(place / "antenna_1.npz", times_77=times, tx_77_locs=table, times_24=times, tx_24_locs=table)


def picture():
    """(rgb, depth [mm], inside) of the object in the middle of the camera's picture."""
    rows, columns = np.mgrid[:480, :640]
    inside = (rows - 240) ** 2 + (columns - 320) ** 2 < RADIUS**2
    rgb = np.where(inside[..., None], np.uint8([200, 40, 40]), np.uint8([30, 90, 30]))
    return rgb, np.where(inside, 1000 * DEPTH, 600).astype(np.uint16), inside


def add_pictures(folder, number):
    """The camera's frame and its two PNG files, which are there out of sight, too."""
    rgb, depth, _ = picture()
    place = folder / "unprocessed" / "camera"
    stem = f"continuous_experiment_{SECONDS}_camera"
    pose = camera_pose(number)
    dump(place / f"{stem}.pkl", {"rgb": rgb, "depth": depth, "pose": pose.ravel().tolist() if number == 1 else pose})
    Image.fromarray(rgb).save(place / f"{stem}_RGB.png")
    Image.fromarray(depth).save(place / f"{stem}_depth.png")


def add_camera_mask(folder, number):
    """The mask, with holes in its depth."""
    _, depth, inside = picture()
    masked = np.where(inside & (np.arange(480)[:, None] % 50 > 0), depth, np.nan).astype(np.float32)
    pose = camera_pose(number)
    values = {
        "rgbd_mask": inside[None],
        "masked_depth": masked,
        "pose": pose.ravel() if number == 1 else pose,
        "masked_xyz": Intrinsics.published().points(masked * 1e-3),
    }
    dump(folder / "processed" / "camera" / "camera_masks.pkl", values)


def add_raw(root):
    """Raw files, as the authors send them on request, of two experiments and the 24 GHz background; a mug's meshes."""
    scene = small_scene(MUG)
    for file in MESHES:
        write_mesh(root / MUG / file, scene.mesh)
    for name, info in ((MUG, FIRST), (CRACKERS, {**FIRST, "aperture size": "large"})):
        folder = experiment_folder(root, name, ANGLES.get(name, (0, 0, 0)), 1, "los")
        for radar in ("77_ghz", "24_ghz"):
            rows, log = recorded(scene, radar, info)
            write_raw_experiment(folder, radar, rows, log, info=info)
    empty = experiment_folder(root, "000_background", (0, 0, 0), 1, "los")
    rows, log = recorded(scene, "24_ghz", FIRST)
    write_raw_experiment(empty, "24_ghz", rows, log, info=FIRST)


def add_empty(root, date, number):
    """An empty scene's image, of fewer columns."""
    folder = experiment_folder(root, f"{date}_EMPTY", (0, 0, 0), number, "los")
    info = FIRST if number == 1 else SECOND
    z = np.arange(-0.37, -0.15, 0.01) if number == 1 else np.arange(-0.55, -0.3, 0.01)
    held = published_image(center_of(number), z=z, scale=0.1, seed=9, columns=22)
    place = folder / "processed" / "radars" / "24_ghz" / "processed_image.pkl"
    dump(place, held | {"antenna_locs": antenna_locs("array", 3)})
    (folder.parent / "experiment_info.json").write_text(json.dumps(info))


def add_simulation(root, name):
    """Specular, edge and diffuse images, their masks, numbered ones too, raw files, and meshes."""
    place = root / name / "simulation" / "0_0_0"
    z = np.arange(-0.37, -0.15, 0.01)
    locs = np.stack(np.meshgrid(0.001 * np.arange(4), 0.1 + 0.001 * np.arange(3), [0.0]), axis=-1).reshape(-1, 3)
    bands = ("77_ghz",) if name in WITHOUT_24_GHZ else ("77_ghz", "24_ghz")
    rng = np.random.default_rng(1)
    for radar in bands:
        processed, raw = (place / state / "radars" / radar for state in ("processed", "unprocessed"))
        for ext in ("_specular", "_edges", "_diffuse"):
            # Heights of one part may have been computed otherwise than those of the other.
            heights = z.astype(np.float32).astype(float) if ext == "_edges" else z
            held = published_image((0.11, 0.27), z=heights, scale=SIMULATED_SCALE, seed=len(ext))
            dump(processed / f"processed_image{ext}.pkl", held | {"antenna_locs": locs})
            mask = {"radar_mask": disc((0.11, 0.27), 0.04, (held["x_locs"], held["y_locs"]))}
            numbers = 0 if ext != "_specular" else 10 if name == MUG else 2  # all ten of one object are enough
            for number in ("", *(f"_{i}" for i in range(numbers))):
                dump(processed / f"radar_masks{ext}{number}.pkl", mask)
            channels = rng.normal(size=(len(locs), 64)) + 1j * rng.normal(size=(len(locs), 64))
            dump(raw / f"raw_sim_files{ext}.pkl", {"channels": list(channels), "radar_shifted_locs": locs.tolist()})
    for file in MESHES if name not in (MUG, TUNA) else ():
        shutil.copy(root / MUG / file, root / name / file)
    (root / name / "textured.mtl").write_text("newmtl none\n")
    Image.new("RGB", (4, 4)).save(root / name / "texture_map.png")


def write_mesh(path, mesh):
    """A mesh file, by way of trimesh."""
    import trimesh

    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/helpers/published_mock.py DIR")
    print(make(Path(sys.argv[1])))  # noqa: T201
