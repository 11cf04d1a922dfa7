"""How well radius, centre and axis of balls and cylinders are known, in sight and in shut cartons.

    python benchmarks/round_things.py make FOLDER --seed 9
    millisight generate FOLDER/round.toml -o DATASET
    python benchmarks/round_things.py measure DATASET

`make` writes 32 meshes and a recipe of scenes of the virtual rig: balls, ellipsoids, cylinders that lie and stand,
bottles, cones, cups, screwdrivers and spoons of random sizes. The rules of `find_round` were chosen on seed 8.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from manifold3d import Manifold
from odd_shapes import SCENES, block, mesh_of, union

import millisight as ms
from millisight import datasets
from millisight.evaluation import HIGH, score_mask
from millisight.meshes import write_mesh
from millisight.perception import project
from millisight.perception.segmentation import find_mask, find_round, segmenter
from millisight.rig.virtual import World, build_layout

MATERIALS = ("abs", "steel", "wood", "plastic", "rubber", "aluminium", "polyethylene_foam", "abs")
ROUND = ("ball", "lying")
RECIPE = (
    SCENES
    + """\
[rig.covers]
cartons = 1
clearance = [0.01, 0.06]
thickness = [0.0025, 0.004]
tilt_deg = 2.0
gap = [0.005, 0.03]

[rig.image]
spacing = [0.0025, 0.0025, 0.01]
margin = 0.09
beyond = 0.06

[rig.world.scan]
size = [0.56, 0.56]
corner = [-0.08, 0.02]
row_spacing = 0.0039

[[rig.scans]]
radars = [{{ preset = "iwr1443", frame_period = 0.125 }}]
arm = {{ speed = 0.02 }}
"""
)


def upright(height: float, below: float, above: float | None = None) -> Manifold:
    """A cylinder or cone about z, its middle at 0 [mm]."""
    solid = Manifold.cylinder(float(height), float(below), float(below if above is None else above), 72)
    return solid.translate((0, 0, -float(height) / 2))


def lying(solid: Manifold) -> Manifold:
    return solid.rotate((90, 0, 0))


def shapes(rng: np.random.Generator) -> Iterator[tuple[str, Manifold, str, str]]:
    """Names, solids [mm], materials and classes."""

    def some(name: str, index: int, solid: Manifold, first: int, kind: str) -> tuple[str, Manifold, str, str]:
        turned = solid.rotate((0, 0, float(rng.uniform(0, 90))))
        return f"{name}{index}", turned, MATERIALS[first % len(MATERIALS)], kind

    for i in range(6):
        radius = float(np.exp(rng.uniform(np.log(17), np.log(70))))
        yield some("ball", i, Manifold.sphere(radius, 96), i, "sphere")
    for i in range(4):
        a = rng.uniform(20, 50)
        half = float(a), float(a * rng.uniform(0.6, 1.0)), float(a * rng.uniform(0.6, 1.1))
        yield some("fruit", i, Manifold.sphere(1.0, 96).scale(half), i + 2, "sphere")
    for i in range(6):
        radius = float(np.exp(rng.uniform(np.log(16), np.log(50))))
        yield some("lying", i, lying(upright(rng.uniform(1.2, 5) * radius + 30, radius)), i + 1, "can")
    for i in range(3):
        yield some("standing", i, upright(rng.uniform(30, 120), rng.uniform(25, 50)), i + 3, "can")
    for i in range(3):
        radius, height, neck = rng.uniform(22, 42), rng.uniform(80, 140), rng.uniform(9, 14)
        shoulder = upright(40, radius, neck).translate((0, 0, height / 2 + 19.9))
        whole = union(upright(height, radius), shoulder, upright(30, neck).translate((0, 0, height / 2 + 54)))
        yield some("bottle", i, lying(whole), i, "other")
    for i in range(2):
        radius, height = rng.uniform(30, 42), rng.uniform(60, 100)
        yield some("cone", i, lying(upright(height, radius * 0.7, radius)), i, "cup")
    for i in range(2):
        radius, height = rng.uniform(30, 42), rng.uniform(60, 100)
        hollow = upright(height, radius * 0.75 - 2.5, radius - 2.5).translate((0, 0, 4))
        yield some("cup", i, upright(height, radius * 0.75, radius) - hollow, i + 3, "cup")
    for i in range(4):
        radius, length, shaft, reach = (rng.uniform(*span) for span in ((10, 17), (80, 120), (2.5, 5), (60, 120)))
        blade = upright(reach, shaft).translate((0, 0, (length + reach) / 2 - 0.1))
        yield some("driver", i, lying(union(upright(length, radius), blade)), i * 3 + 1, "handle")
    for i in range(2):
        bowl = Manifold.sphere(1.0, 64).scale((20.0, 28.0, 6.0))
        yield some("spoon", i, union(bowl, block(rng.uniform(6, 12), 140, 3, (0, 90, 2))), (1, 3)[i], "handle")


def make(folder: Path, seed: int) -> None:
    files = []
    for name, solid, material, kind in shapes(np.random.default_rng(seed)):
        write_mesh(folder / f"{name}.ply", mesh_of(solid))
        files.append(f'[[files]]\npath = "{name}.ply"\nunit = "m"\nmaterial = "{material}"\nclass = "{kind}"\n')
    recipe = RECIPE.format(
        name="Round", about="Round and thin things, in sight and in cartons.", seed=39 + seed,
        objects="\n".join(files), conditions='["los", "carton"]',
    )  # fmt: skip
    (folder / "round.toml").write_text(recipe)


def measure(root: Path) -> None:
    by = segmenter("wave")
    told: dict[tuple[str, str], list[tuple[str, float, float, float]]] = {}
    marked: dict[tuple[str, str], list[float]] = {}
    for files in datasets.find_scenes(datasets.open(root)):
        scene = files.read(truth="exact", view=False)
        folder, *rest = str(scene.name).split("/")
        name = folder.split("_", 1)[1].rstrip("0123456789")
        image, truth = scene.images[HIGH], scene.truth[HIGH]
        mask = find_mask(by, project(image), condition=scene.sight, rng=0).mask
        things = find_round(mask, image, covered=scene.sight != "los")
        marked.setdefault((name, scene.sight), []).append(100 * score_mask(mask, truth).f1)
        world = World.from_toml(root.joinpath("truth", folder, "robot_collected", *rest, "77_ghz", "world.toml"))
        points = np.asarray(build_layout(world).parts[0].mesh.vertices)
        middle = (points.max(axis=0) + points.min(axis=0)) / 2
        _, axes = np.linalg.eigh(np.cov((points - points.mean(axis=0)).T))
        along = (points - points.mean(axis=0)) @ axes[:, 2:]
        radius = np.linalg.norm(points - points.mean(axis=0) - along * axes[:, 2], axis=1).max()
        if name == "ball":
            radius = float(np.ptp(points, axis=0).mean() / 2)
        for one in things:
            tilt = 0.0 if one.axis is None else np.degrees(np.arccos(min(abs(float(one.axis @ axes[:, 2])), 1)))
            off = 1e3 * float(np.linalg.norm(one.centre - middle))
            told.setdefault((name, scene.sight), []).append((one.kind, 1e3 * (one.radius - radius), off, float(tilt)))
    print("| shapes | sight | scenes | balls, cylinders found | radius, centre [mm], axis [°]: median (most) | F1 |")
    print("| --- | --- | --- | --- | --- | --- |")
    for (name, sight), scores in marked.items():
        found = told.get((name, sight), [])
        kinds = [sum(kind == one[0] for one in found) for kind in ("ball", "cylinder")]
        rows = np.abs([one[1:] for one in found]) if found and name in ROUND else np.zeros((0, 3))
        errors = "; ".join(f"{np.median(one):.1f} ({one.max():.1f})" for one in rows.T) if len(rows) else ""
        print(f"| {name} | {sight} | {len(scores)} | {kinds[0]}, {kinds[1]} | {errors} | {np.median(scores):.1f} |")


def run(about: str | None, seed: int, make: Callable[[Path, int], None], measure: Callable[[Path], None]) -> None:
    """The command line of `make` and `measure`."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("do", choices=["make", "measure"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=seed)
    options = parser.parse_args()
    ms.core.make_folder(options.folder)
    if options.do == "make":
        make(options.folder, options.seed)
    else:
        measure(options.folder)


if __name__ == "__main__":
    run(__doc__, 9, make, measure)
