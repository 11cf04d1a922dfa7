"""A dataset in the published layout with two blocks to be segmented, seen by both radars and the camera; in seconds.

The 24 GHz image is blunt, the 77 GHz one is sharp; out of sight a streak of the carton's is in the 77 GHz image alone,
and the camera sees the carton.
"""

import json

import numpy as np

import millisight as ms
from millisight.data import CameraFrame, Intrinsics
from millisight.io.mito import BASE_ORIGIN, experiment_folder, radar_folder, write_published
from millisight.rig.virtual import camera_mask

K = Intrinsics.published()
X, Y = np.arange(0, 0.2, 0.005), np.arange(0.05, 0.22, 0.005)
BLOCKS = {"073-a_lego_duplo": (0.10, 0.14, 0.0475, 0.0175), "074-x_wide": (0.11, 0.13, 0.0375, 0.0375)}
"""By folder: middle and half edges along x and y [m]; the top lies at -0.25, on a support at -0.30."""
TOP, LID = -0.25, -0.22
INFO = {"aperture size": "normal", "rx offset": "x", "background": "tripod", "simulated": True, "physics": "by hand"}
POSE = np.diag([1.0, -1.0, -1.0, 1.0])
POSE[:3, 3] = [0.1, 0.13, 0.15]


def make(root, info=INFO):
    """The dataset, under `root`."""
    for folder, block in BLOCKS.items():
        for sight in ("los", "nlos"):
            add(experiment_folder(root, folder, (0, 0, 0), 1, sight), block, info, hidden=sight == "nlos")
    return root


def inside(block, x=X, y=Y):
    """(X, Y) bool, the pixels over which the block lies."""
    u, v, a, b = block
    return (np.abs(np.asarray(x)[:, None] - u) <= a) & (np.abs(np.asarray(y) - v) <= b)


def add(folder, block, info, *, hidden):
    folder.mkdir(parents=True)
    (folder.parent / "experiment_info.json").write_text(json.dumps(info))
    for radar in ("77_ghz", "24_ghz"):
        target = radar_folder(folder, radar, processed=True)
        target.mkdir(parents=True)
        write_published(target / "processed_image.pkl", image(block, radar, hidden=hidden))
        mask = ms.Mask(grid_xy=grid().xy, inside=inside(block))
        write_published(target / "radar_masks.pkl", mask)
    frame, pixels = shot(block, hidden=hidden)
    for state, name, written in (
        ("unprocessed", "continuous.pkl", frame),
        ("processed", "camera_masks.pkl", None if hidden else camera_mask(frame, pixels)),
    ):
        if written is not None:
            target = folder / state / "camera"
            target.mkdir(parents=True)
            write_published(target / name, written)


def grid():
    return ms.VoxelGrid(x=X, y=Y, z=np.array([-0.27, -0.26, -0.25]))


def image(block, radar, *, hidden):
    from scipy.ndimage import gaussian_filter

    wide = 2.0 if radar == "24_ghz" else 0.5
    seen = gaussian_filter(inside(block).astype(float), wide)
    if hidden and radar == "77_ghz":
        seen[2:6, 2:] += 0.9
    values = np.repeat(seen[..., None], 3, axis=2).astype(np.complex64)
    return ms.SarImage(grid=grid(), values=values)


def shot(block, *, hidden):
    """(frame, pixels on the block): straight down, the floor at -0.6 m."""
    height = POSE[2, 3]

    def seen(level):
        """Where the camera's rays are at that height."""
        points = K.points(np.full((480, 640), height - level)) @ POSE[:3, :3].T + POSE[:3, 3]
        return points[..., 0], points[..., 1]

    u, v, a, b = block
    depth = np.full((480, 640), height + 0.6)
    x, y = seen(TOP)
    pixels = (np.abs(x - u) <= a) & (np.abs(y - v) <= b)
    depth[pixels] = height - TOP
    colour = np.where(pixels, 200, 60)
    if hidden:
        x, y = seen(LID)
        lid = (np.abs(x - u) <= a + 0.03) & (np.abs(y - v) <= b + 0.03)
        depth[lid], colour[lid] = height - LID, 140
    pose = POSE.copy()
    pose[:3, 3] += BASE_ORIGIN
    rgb = np.repeat(colour[..., None], 3, axis=2).astype(np.uint8)
    stored = np.rint(depth * 1000).astype(np.uint16)
    return CameraFrame(rgb=rgb, depth=stored, pose=pose, intrinsics=K), pixels
