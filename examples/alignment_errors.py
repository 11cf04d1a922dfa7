"""How far off the alignment of objects imaged anew is, where the true shift is known.

    millisight evaluate simulator --measured bench24 --simulated bench24 -o truth
    python examples/alignment_errors.py bench24 truth/pairs.csv

First by other physics: the shifts of `truth/pairs.csv`, against where the virtual rig (`bench24/truth`) and the
simulator had put the middle of the object: for bench24, and datasets with its [simulator]. Then by the same physics:
six objects simulated twice, the second time moved by some millimetres that are no whole voxels, and imaged on the same
voxels. A minute on two cores.
"""

import csv
import sys
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.rig.virtual import World, build_layout

SIMULATED = np.array([0.2, 0.2, -0.2])  # middle of each object: of an aperture of 40 cm, 20 cm below it [m]
GOOD = 80.0  # F from which on a shift is of the object [%]
MOVED = {  # by how much, of which object [m]
    "mug": (0.0131, -0.0073, 0.0046),
    "banana": (-0.0094, 0.0117, 0.0033),
    "padlock": (0.0058, 0.0141, -0.0062),
    "rubiks_cube": (-0.0123, -0.0036, 0.0078),
    "scissors": (0.0077, 0.0089, -0.0041),
    "tomato_soup_can": (0.0112, -0.0149, 0.0027),
}


def by_other_physics(dataset: Path, table: Path) -> None:
    """The errors of every pair of the table, and their medians."""
    errors = {"los": [], "nlos": []}
    for row in csv.DictReader(table.read_text(encoding="utf-8").splitlines()):
        if row["shift [mm]"]:
            there = middle_in_the_rig(dataset, row) - SIMULATED
            off = np.array([float(value) for value in row["shift [mm]"].split()]) - 1000 * there
            errors[row["sight"]].append((float(row["F [%]"]), np.hypot(*off[:2]), abs(off[2])))
            print(f"{row['object']:24} {row['sight']:4} F {float(row['F [%]']):5.1f} %, off by {off.round(1)} mm")
    for sight, found in errors.items():
        some = np.array(found)
        for name, chosen in (("all", some), (f"F >= {GOOD:g} %", some[some[:, 0] >= GOOD])):
            across, deep = np.median(chosen[:, 1:], axis=0)
            print(f"{sight:4} {name:9}: {len(chosen)} pairs, median {across:.1f} mm along x and y (worst "
                  f"{chosen[:, 1].max():.1f}), {deep:.1f} mm along z (worst {chosen[:, 2].max():.1f})")  # fmt: skip


def middle_in_the_rig(dataset: Path, row: dict[str, str]) -> np.ndarray:
    """(3,) of the object's bounding box [m]."""
    place = Path(row["object"], "robot_collected", row["pose"], f"exp{row['exp']}", row["sight"], "77_ghz")
    lower, upper = build_layout(World.from_toml(dataset / "truth" / place / "world.toml")).objects[0].bounds
    return (lower + upper) / 2


def by_the_same_physics() -> None:
    """Objects simulated where they are, and moved."""
    radar = ms.Radar.preset("mito-sim-77ghz")
    found = []
    for name, shift in MOVED.items():
        scene = ms.Scene.from_mesh(name, vertices=6000).moved((0, 0, -0.2))
        lower, upper = scene.mesh.bounds
        path = ms.Trajectory.raster(size=tuple((upper - lower)[:2] + 0.1), step=radar.waveform.wavelength / 2)
        grid = ms.VoxelGrid.regular(lower - 0.04, upper + 0.04, (0.0025, 0.0025, 0.01))
        clouds = [cloud(one, radar, path, grid) for one in (scene, scene.moved(shift))]
        off = 1000 * (ms.align(clouds[0], clouds[1]).translation - shift)
        found.append((np.hypot(*off[:2]), abs(off[2])))
        print(f"{name:24} moved by {1000 * np.array(shift)} mm, off by {off.round(1)} mm")
    (across, deep), (worst, deepest) = np.median(found, axis=0), np.max(found, axis=0)
    print(f"{len(found)} objects, median {across:.1f} mm along x and y (worst {worst:.1f}), {deep:.1f} mm along z "
          f"(worst {deepest:.1f})")  # fmt: skip


def cloud(scene: ms.Scene, radar: ms.Radar, path: ms.Trajectory, grid: ms.VoxelGrid) -> np.ndarray:
    """(N, 3) points of the scene's image, 30 % of the maximum and more [m]."""
    specular, edge = (ms.simulate(scene, radar, path, model=model) for model in ("specular", "edge"))
    return ms.point_cloud(ms.form_image(ms.combine(specular, edge, scene.alpha), grid), 0.3).points


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print("usage: python examples/alignment_errors.py DATASET PAIRS.csv", file=sys.stderr)
        sys.exit(2)
    by_other_physics(Path(sys.argv[1]), Path(sys.argv[2]))
    by_the_same_physics()
